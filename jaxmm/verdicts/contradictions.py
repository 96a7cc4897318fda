"""Doubts about a pose: its rays would pass through what the scan's own points show to stand.

Positions are offsets from the prior's origin, world axes: metres, z up. K places where rays pass.

Where points are in the world and the place of the sensor is not, they lie on the prior as they should, and no fit tells
that the place is wrong. Rays from there do: they pass through the middle of walls on which the scan's own points lie.
From the right place none does, but for a few along edges, and through what is full of holes.
"""

import numpy as np
from scipy.spatial import cKDTree

from jaxmm.rays.scan_rays import PosedScan, drawn
from jaxmm.vectors import lengths
from jaxmm.verdicts.building_evidence import passes
from warp_scanner.clouds.voxels import thin_clouds
from warp_scanner.scenes.building import bounds
from warp_scanner.scenes.scenes import CEILING, FLOOR, PILLAR, WALL
from warp_scanner.sensors.scan import Rays
from warp_scanner.sensors.triangles import TriangleScene, cast_faces, face_normals

CLOSED = (WALL, PILLAR, FLOOR, CEILING)  # without holes, unlike railings and stairs; and one sees through windows
MOST_ASKED = 30_000  # rays, or somewhat more
SURFACES, BEYOND = 2, 0.005  # along a ray that are asked, and [m] behind one, from where the next is looked for
SPACING = 0.05  # [m] that the points are thinned to
AROUND, UPON = 0.2, 0.04  # [m] from where a ray passes, and off the surface, within which points show that it stands
NEIGHBOURS = 24  # points that are looked at; a square of twice AROUND holds 64
# Of the rays. In 338 views of eight buildings, of which some element is new or gone, right places have 0.001 at most,
# whatever the sensor; of 110 places 0.1 m off 3 have more than this, of 95 that are 3 m off 51: 35 of the 49 where a
# standing element looks gone.
MOST_CONTRADICTED = 0.01


def doubts_by_rays(scene: TriangleScene, scan: PosedScan) -> tuple[str, ...]:
    """What the rays of a scan say against its place; nothing where all may be."""
    share = contradicted(scene, scan)
    if share <= MOST_CONTRADICTED:
        return ()
    return (f"{share:.1%} of its rays would pass through what its own points show to stand: is its pose right?",)


def contradicted(scene: TriangleScene, scan: PosedScan) -> float:
    """Share of a scan's rays that pass through a wall, column or slab amid points of the scan which lie upon it.

    Asked is the surface where a ray first enters one, and the next behind it: points may lie upon the far side. They
    lie about a place where each quarter around it, as seen along the normal of the surface, holds one.

    Args:
        scene: the prior's.
        scan: where it is believed to be; of its points as many are used as `scan_rays` draws.
    """
    points = drawn(scan.points, scan.position)
    low, high = bounds(scene.triangles)
    near = points[np.all((points > low - AROUND) & (points < high + AROUND), axis=1)]
    if not len(near):
        return 0.0
    offset = points[:: max(1, len(points) // MOST_ASKED)] - scan.position
    reach = lengths(offset)
    direction = offset / reach[:, None]
    stand = cKDTree(near[thin_clouds([near.astype(np.float32)], SPACING)[0]])
    closed = np.isin(scene.triangles.semantic, CLOSED)
    amid, gone, rows = np.zeros(len(reach), bool), np.zeros(len(reach)), np.arange(len(reach))
    for _ in range(SURFACES):
        start = scan.position + direction[rows] * gone[rows, None]
        met, face = cast_faces(scene, Rays(start[None], direction[None, rows].astype(np.float32)), closed)
        gone[rows] += met.distance[0]
        behind = passes(reach[rows], gone[rows])
        rows, normal = rows[behind], _unit(face_normals(scene.triangles, face)[0, behind])
        amid[rows] |= _amid(stand, scan.position + direction[rows] * gone[rows, None], normal)
        gone[rows] += BEYOND
    return float(amid.mean())


def _unit(normal: np.ndarray) -> np.ndarray:
    """Normals (K, 3) float64 of length 1, or 0 of what has none."""
    normal = normal.astype(np.float64)
    return normal / np.maximum(lengths(normal)[:, None], np.finfo(np.float64).tiny)


def _amid(stand: cKDTree, places: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """(K,) bool: whether points lie in all four quarters about places (K, 3) of a surface with unit normals (K, 3)."""
    apart, nearest = stand.query(places, NEIGHBOURS, distance_upper_bound=AROUND)
    offset = stand.data[np.minimum(nearest, stand.n - 1)] - places[:, None]
    upon = np.isfinite(apart) & (np.abs(np.einsum("knc,kc->kn", offset, normal)) < UPON)
    level = np.eye(3)[np.argmin(np.abs(normal), axis=1)]
    one = np.cross(normal, level)
    one, other = (np.einsum("knc,kc->kn", offset, axis) > 0.0 for axis in (one, np.cross(normal, one)))
    quarters = [(upon & (one == left) & (other == low)).any(axis=1) for left in (True, False) for low in (True, False)]
    return np.all(quarters, axis=0)
