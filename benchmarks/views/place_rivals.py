"""What peers tell of the places of elements, from the true pose: cloud to mesh, and M3C2 by py4dgeo.

K rays of one scan that should meet a face. Metres.
"""

import logging

import numpy as np
from scipy.spatial import cKDTree

from benchmarks import peers
from jaxmm.deviations.meetings import Meetings, meetings_of
from jaxmm.rays.scan_rays import PosedScan, rays_of_scan
from warp_scanner.sensors.triangles import TriangleScene

FAR = 0.4  # [m] up to which peers look
MOST = 100_000  # points of a scan, and of the faces, that they get: medians of more are no better


def told_by_rivals(scene: TriangleScene, scan: PosedScan) -> dict[str, dict[int, float]]:
    """By each peer that is installed, how far off its place each element is: row -> median [m]."""
    met = meetings_of(scene, rays_of_scan(scan))
    shown = met._replace(end=met.end - met.normal * met.off[:, None])  # on the model's faces
    rng = np.random.default_rng(0)
    shown = shown.of(rng.permutation(len(shown.element))[:MOST])
    points = scan.points[rng.permutation(len(scan.points))[:MOST]].astype(np.float64)
    rivals = {"C2M": _cloud_to_mesh} | ({} if peers.why_missing("py4dgeo") else {"M3C2": _m3c2})
    return {name: rival(points, shown) for name, rival in rivals.items()}


def _cloud_to_mesh(points: np.ndarray, shown: Meetings) -> dict[int, float]:
    """Row -> median [m] of the signed distances of the points whose nearest surface is the element's."""
    apart, place = cKDTree(shown.end).query(points, distance_upper_bound=FAR)
    near = np.isfinite(apart)
    off = np.einsum("nc,nc->n", points[near] - shown.end[place[near]], shown.normal[place[near]])
    element = shown.element[place[near]]
    return {int(row): float(np.median(off[element == row])) for row in np.unique(element)}


def _m3c2(points: np.ndarray, shown: Meetings) -> dict[int, float]:
    """Row -> median [m] of the M3C2 distances at points of its faces."""
    import py4dgeo  # first by peers.has, where it began a log that is gone

    logging.getLogger("py4dgeo").handlers.clear()
    py4dgeo.set_num_threads(1)
    some = np.random.default_rng(0).permutation(len(shown.element))[:2_000]
    core = shown.end[some]
    search = py4dgeo.M3C2(
        epochs=(py4dgeo.Epoch(shown.end), py4dgeo.Epoch(points)), corepoints=core,
        corepoint_normals=shown.normal[some], cyl_radius=0.1, max_distance=FAR,
    )  # fmt: skip
    distance, _ = search.run()
    known = np.isfinite(distance)
    element = shown.element[some]
    return {int(row): float(np.median(distance[known & (element == row)])) for row in np.unique(element[known])}
