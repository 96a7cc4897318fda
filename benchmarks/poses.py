"""Given poses that are wrong: are they put right, refused, doubted, or believed?

    python -m benchmarks.poses [--ifc FOLDER] [--rooms 10] [--seed 42] [--json FILE]     ten minutes

Scans of generated rooms (`varied`; seed 42 is of validation), unchanged and with changes, and with --ifc from places in
IFC files, by sensors as built. Their poses are off by up to 0, 0.1 and 0.5 m, 0, 2 and 10 degrees of yaw, and 0, 1 and
3 degrees of pitch and roll. *Right* is within 3 cm and 0.5 degrees; *open* is wrong, but the report says along which
direction nothing holds the place; *believed* is wrong without a word. Peers are plain GICP (small_gicp) and ICP
from points to planes (Open3D, where it is installed), from the same start on the same surfaces; they refuse nothing.
Prints Markdown.
"""

from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import small_gicp
from scipy.spatial.transform import Rotation

from benchmarks.command_line import CommandLine
from benchmarks.peers import has
from benchmarks.timing import write_report
from benchmarks.views.building_views import building_places, scanned
from jaxmm.inputs import InputError
from jaxmm.rays.scan_rays import PosedScan, rays_of_scan
from jaxmm.runs.room_scans import room_cases
from jaxmm.verdicts.building_evidence import surfaces_along
from jaxmm.verdicts.named_scans import NamedScan, placed_scan, settled_scan
from jaxmm.verdicts.priors import Prior
from jaxmm.verdicts.settings import DetectSettings
from warp_scanner.sensors.sensors import sensor_named

SEED = 42  # of validation
ERRORS = ((0.0, 0.0, 0.0), (0.1, 2.0, 1.0), (0.5, 10.0, 3.0))  # most [m], [deg] of yaw, [deg] of pitch and roll
LEAST_POINTS = 1000  # of a view
RIGHT = 0.03, 0.5  # [m], [deg]
SPACING, REACH = 0.1, 1.0  # [m] of the peer's clouds, and within which it matches points
FULL = {
    "sensors": ("oak-d-pro-real", "velodyne-16-real", "ouster-64-real"),
    "scenes": ("unchanged", "wall_removed", "all_four"),
    "rooms": 10,
}
SMOKE = {"sensors": ("oak-d-pro-real",), "scenes": ("unchanged",), "rooms": 1}
KINDS = ("right", "refused or doubted", "open", "believed")


# The motion (4, 4) of points (N, 3) onto others (M, 3).
Peer = Callable[[np.ndarray, np.ndarray], np.ndarray]


class View(NamedTuple):
    """A scan with its true pose, and the model that it is of."""

    prior: Prior
    scan: PosedScan


def room_views(sensor: str, scene: str, count: int, seed: int) -> Iterator[View]:
    """Of generated rooms."""
    for case in room_cases(scene, "occluded", seed, range(count), sensor=sensor):
        yield View(case.prior, case.scan)


def building_views(folder: Path, sensor: str, count: int, seed: int) -> Iterator[View]:
    """Of every IFC file in a folder, from places inside of it."""
    for prior, pose, number in building_places(folder, count, seed):
        present = np.ones(len(prior.building.elements.guid), bool)
        scan, _ = scanned(prior.scene, present, (sensor_named(sensor), pose), (seed, number))
        if len(scan.points) >= LEAST_POINTS:  # some look out of a building, at nothing
            yield View(prior, scan)


def disturbed(scan: PosedScan, most: tuple[float, float, float], rng: np.random.Generator) -> PosedScan:
    """The scan as it would lie with a pose that is off by up to `most`."""
    position = np.asarray(scan.position, np.float64)
    shift = rng.normal(size=3)
    shift *= most[0] * rng.uniform() / np.linalg.norm(shift)
    angles = rng.uniform(-1.0, 1.0, 3) * (most[1], most[2], most[2])
    turn = Rotation.from_euler("ZYX", angles, degrees=True).as_matrix()
    points = (scan.points.astype(np.float64) - position) @ turn.T + position + shift
    return scan._replace(points=points.astype(np.float32), position=position + shift, rotation=turn @ scan.rotation)


def outcome(view: View, believed: PosedScan) -> tuple[str, float]:
    """Which of KINDS our registration makes of it, and how far [m] off its place it then is; NaN where refused."""
    try:
        one = settled_scan(NamedScan(believed, "scan", len(believed.points), "given"))
        placed = placed_scan(view.prior, one, DetectSettings())
    except InputError:
        return "refused or doubted", np.nan
    off = float(np.linalg.norm(placed.scan.position - view.scan.position))
    if is_right(view.scan, placed.scan.position, placed.scan.rotation):
        return "right", off
    return "refused or doubted" if placed.notes else "open" if placed.open else "believed", off


def is_right_by_peer(view: View, believed: PosedScan, motion_of: Peer) -> bool:
    """Whether a peer puts it right."""
    surfaces = surfaces_along(view.prior.scene, rays_of_scan(believed)).astype(np.float64)
    if len(surfaces) < 100:
        return False
    centre = np.asarray(believed.position, np.float64)
    motion = motion_of(surfaces - centre, believed.points.astype(np.float64) - centre)
    return is_right(view.scan, centre + motion[:3, 3], motion[:3, :3] @ believed.rotation)


def by_gicp(target: np.ndarray, source: np.ndarray) -> np.ndarray:
    """The motion (4, 4) of points (N, 3) onto others, by plain GICP."""
    target, tree = small_gicp.preprocess_points(target, downsampling_resolution=SPACING)
    source, _ = small_gicp.preprocess_points(source, downsampling_resolution=SPACING)
    return small_gicp.align(
        target, source, tree, registration_type="GICP", max_correspondence_distance=REACH
    ).T_target_source


def by_open3d(target: np.ndarray, source: np.ndarray) -> np.ndarray:
    """The same by Open3D's ICP from points to planes."""
    import open3d

    clouds = [
        open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points)).voxel_down_sample(SPACING)
        for points in (target, source)
    ]
    clouds[0].estimate_normals(open3d.geometry.KDTreeSearchParamHybrid(3 * SPACING, 30))
    registration = open3d.pipelines.registration
    return registration.registration_icp(
        clouds[1], clouds[0], REACH, np.eye(4), registration.TransformationEstimationPointToPlane()
    ).transformation


def is_right(true: PosedScan, position: np.ndarray, rotation: np.ndarray) -> bool:
    apart = np.asarray(rotation, np.float64) @ np.asarray(true.rotation, np.float64).T
    angle = np.degrees(np.arccos(np.clip((np.trace(apart) - 1.0) / 2.0, -1.0, 1.0)))
    return bool(np.linalg.norm(position - true.position) <= RIGHT[0] and angle <= RIGHT[1])


def row_of(
    case: str, views: list[View], most: tuple[float, float, float], seed: int, with_open3d: bool
) -> dict[str, Any]:
    """Shares of all views, one error of each."""
    rng = np.random.default_rng(seed)
    starts = [disturbed(view.scan, most, rng) for view in views]
    told = [outcome(view, start) for view, start in zip(views, starts, strict=True)]
    ours = Counter(kind for kind, _ in told)
    shares = {kind: ours[kind] / len(views) for kind in KINDS}
    pairs = list(zip(views, starts, strict=True))
    mine, theirs = shares["right"], float(np.mean([is_right_by_peer(*pair, by_gicp) for pair in pairs]))
    others = {"open3d": float(np.mean([is_right_by_peer(*pair, by_open3d) for pair in pairs]))} if with_open3d else {}
    more = 1.0 / len(views)  # one right view more for each, so that the ratio is finite
    return {
        "case": case, "up_to": list(most), "views": len(views), **shares,
        "farthest": max((off for kind, off in told if kind == "right"), default=0.0), "ours": mine, "peer": theirs,
        "peer_name": "GICP (small_gicp)", "unit": "share right", "ratio": (mine + more) / (theirs + more), **others,
    }  # fmt: skip


def main() -> None:
    parser = CommandLine(__doc__, FULL, SMOKE)
    parser.add_places(SEED)
    asked = parser.parse_args()
    cases = {
        f"rooms, {scene}, {sensor}": list(room_views(sensor, scene, asked.rooms, asked.seed))
        for sensor in asked.sensors
        for scene in asked.scenes
    }
    if asked.ifc:
        cases |= {
            f"IFC files, {one}": list(building_views(asked.ifc, one, asked.rooms, asked.seed)) for one in asked.sensors
        }
    columns = (
        "views",
        "off by up to",
        *KINDS,
        "right ones: most off [m]",
        "GICP alone: right",
        "Open3D's ICP alone: right",
    )
    print(f"| {' | '.join(columns)} |\n|{' --- |' * len(columns)}")
    rows, with_open3d = [], has("open3d")
    for case, views in cases.items():
        for most in ERRORS:
            row = row_of(f"{case} ({len(views)})", views, most, asked.seed, with_open3d)
            told = " | ".join(f"{row[kind]:.2f}" for kind in KINDS)
            other = f"{row['open3d']:.2f}" if with_open3d else "-"
            print(
                f"| {row['case']} | {most[0]:g} m, {most[1]:g}° | {told} | {row['farthest']:.3f} | {row['peer']:.2f} "
                f"| {other} |",
                flush=True,
            )
            rows.append(row)
    if asked.json:
        write_report(asked.json, rows, "small-gicp")


if __name__ == "__main__":
    main()
