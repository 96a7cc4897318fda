"""Scans without a pose: is their place in the building found, refused, or wrong?

    python -m benchmarks.pose_search [--ifc FOLDER] [--views 3] [--json FILE]     half an hour

Scans from every storey of generated buildings (seed 42 upward: validation) and with --ifc of the IFC files in a folder,
by sensors that look around and err as such devices do, tilted by up to 2 degrees, among furniture, and with none to
three elements of the building gone and up to one wall or column new. Only the points are known, in the sensor's frame.
*Right* is within 5 cm and 0.5 degrees once the scan is registered, as in `detect`; *refused* is a line that names
places that look alike or says that none fits; anything else is *wrong*. The peer takes the best of the same places by
the same coarse ranges and lays the scan there with GICP (small_gicp); it refuses nothing. Prints Markdown.
"""

import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import small_gicp
from scipy.spatial.transform import Rotation

from benchmarks.command_line import CommandLine
from benchmarks.timing import write_report
from benchmarks.views.building_views import scanned
from benchmarks.views.floor_plans import building_of_plans
from jaxmm.inputs import InputError
from jaxmm.rays.scan_rays import PosedScan, rays_of_scan
from jaxmm.verdicts.building_evidence import surfaces_along
from jaxmm.verdicts.named_scans import NamedScan, placed_scan, settled_scan
from jaxmm.verdicts.panoramas import AZIMUTHS, fits_of, panorama_of, upright_of
from jaxmm.verdicts.pose_search import search
from jaxmm.verdicts.priors import Prior, prior_of_building, read_prior
from jaxmm.verdicts.settings import DetectSettings
from warp_scanner import draws
from warp_scanner.buildings.changes import added_object, furniture_around
from warp_scanner.buildings.free_places import free_places
from warp_scanner.buildings.positions import draw_positions
from warp_scanner.rooms.standing import Standing
from warp_scanner.scenes.building import fixed
from warp_scanner.scenes.building_edits import join
from warp_scanner.scenes.scenes import PILLAR, WALL
from warp_scanner.sensors.poses import Pose
from warp_scanner.sensors.scan import Rays
from warp_scanner.sensors.sense import rays_of
from warp_scanner.sensors.sensors import Sensor, sensor_named
from warp_scanner.sensors.triangles import cast_triangles, prepare

SEED = 42  # of validation
RIGHT = 0.05, 0.5  # [m], [deg]
SPACING, REACH = 0.1, 1.0  # [m] of the peer's clouds, and within which it matches points
FULL = {"sensors": ("ouster-64-real", "tls-real"), "buildings": 12, "views": 3}
SMOKE = {"sensors": ("ouster-64-real",), "buildings": 1, "views": 1}
KINDS = ("right", "refused", "wrong")
STANDS = Standing(height=(0.4, 1.8), pitch=(-2.0, 2.0))
MOST_GONE, LEAST_SHOWN = 3, 0.01  # elements, and share of the rays that would meet each
COLUMNS, ROWS = 900, 300  # of the scanner's rays that are cast at most


class View(NamedTuple):
    """A scan with its true pose, and the model that it is of."""

    prior: Prior
    scan: PosedScan


def generated(count: int) -> Iterator[tuple[str, Prior]]:
    """Buildings of one to three storeys, every third with storeys that repeat."""
    for number in range(count):
        repeated = number % 3 == 2
        building = building_of_plans(SEED + number, storeys=2 if repeated else 1 + number % 3, repeated=repeated)
        yield "storeys that repeat" if repeated else "generated", prior_of_building(building)


def from_files(folder: Path) -> Iterator[tuple[str, Prior]]:
    for path in sorted(folder.glob("*.ifc")):
        yield path.stem, read_prior(path)


def views_of(prior: Prior, name: str, count: int) -> Iterator[View]:
    """So many views of every storey that has a free place."""
    sensor = sensor_named(name)
    if sensor.shape[0] > ROWS:
        sensor = sensor.resampled(COLUMNS, ROWS)
    for storey in range(len(prior.building.storeys.name)):
        numbers = np.arange(3 * count) + 1000 * storey
        pose, found = draw_positions(prior.building, prior.scene, STANDS, draws.keys(SEED, numbers), storey)
        for number in np.flatnonzero(found)[:count]:
            one = Pose(*(field[number : number + 1] for field in pose))
            yield View(prior, _changed_scan(prior, (sensor, one), int(numbers[number])))


def _changed_scan(prior: Prior, seen: tuple[Sensor, Pose], number: int) -> PosedScan:
    """A scan of the building as it has become."""
    sensor, pose = seen
    rng, key = np.random.default_rng([SEED, number]), draws.keys(SEED, np.array([number]))
    building, triangles = prior.building, prior.building.triangles
    meets = cast_triangles(prior.scene, rays_of(sensor, pose)).element[0]
    count = np.bincount(meets[meets >= 0], minlength=len(triangles.semantic))
    shown = np.isin(triangles.semantic, (WALL, PILLAR)) & (count >= LEAST_SHOWN * len(meets))
    gone = rng.permutation(np.flatnonzero(shown))[: rng.integers(0, MOST_GONE + 1)]
    change = None
    if rng.random() < 0.5:
        change = added_object(building, prior.scene, (int(rng.choice([WALL, PILLAR])), 0.3), (pose, sensor), key)
    below = cast_triangles(prior.scene, Rays(pose.position, np.array([[0.0, 0.0, -1.0]], np.float32)),
                           fixed(triangles)).distance[0, 0]  # fmt: skip
    floor = float(pose.position[0, 2] - (below if np.isfinite(below) else 1.0))
    furniture = furniture_around(prior.scene, pose, floor, change, key)
    for more in (change and change.triangles, furniture):
        triangles = join(triangles, more) if more else triangles
    scan, _ = scanned(prepare(triangles), ~np.isin(np.arange(len(triangles.semantic)), gone), seen, (SEED, number))
    # A tilt to the side as well: the simulated sensor only looks up and down.
    roll = Rotation.from_euler("x", rng.uniform(*STANDS.pitch), degrees=True).as_matrix()
    return scan._replace(rotation=scan.rotation @ roll)


def own_points(scan: PosedScan) -> np.ndarray:
    """All that is known of a scan: its points (N, 3) in the sensor's frame."""
    return (scan.points.astype(np.float64) - scan.position) @ scan.rotation


def outcome(view: View) -> str:
    """Which of KINDS our search makes of it."""
    points = own_points(view.scan)
    try:
        place = search(view.prior, points).place
        scan = posed(points, place.position, place.rotation)
        one = settled_scan(NamedScan(scan, "scan", len(points), "searched"))
        placed = placed_scan(view.prior, one, DetectSettings()).scan
    except InputError:
        return "refused"
    return "right" if is_right(view.scan, placed.position, placed.rotation) else "wrong"


def by_peer(view: View) -> str:
    """The same of the best coarse place and GICP."""
    points = own_points(view.scan)
    upright = upright_of(points)
    places = free_places(view.prior.building, view.prior.scene, upright.heights)
    fits = fits_of(view.prior.scene, places, panorama_of(points @ upright.rotation.T))
    place, turn = np.unravel_index(np.argmax(fits), fits.shape)
    rotation = Rotation.from_euler("z", 2.0 * np.pi * turn / AZIMUTHS).as_matrix() @ upright.rotation
    start = posed(points, places[place], rotation)
    surfaces = surfaces_along(view.prior.scene, rays_of_scan(start)).astype(np.float64) - start.position
    if len(surfaces) < 100:
        return "wrong"
    target, tree = small_gicp.preprocess_points(surfaces, downsampling_resolution=SPACING)
    source, _ = small_gicp.preprocess_points(points @ rotation.T, downsampling_resolution=SPACING)
    motion = small_gicp.align(
        target, source, tree, registration_type="GICP", max_correspondence_distance=REACH
    ).T_target_source
    is_there = is_right(view.scan, start.position + motion[:3, 3], motion[:3, :3] @ rotation)
    return "right" if is_there else "wrong"


def posed(points: np.ndarray, position: np.ndarray, rotation: np.ndarray) -> PosedScan:
    return PosedScan((points @ rotation.T + position).astype(np.float32), position, rotation)


def is_right(true: PosedScan, position: np.ndarray, rotation: np.ndarray) -> bool:
    apart = np.asarray(rotation, np.float64) @ np.asarray(true.rotation, np.float64).T
    angle = np.degrees(np.arccos(np.clip((np.trace(apart) - 1.0) / 2.0, -1.0, 1.0)))
    return bool(np.linalg.norm(position - true.position) <= RIGHT[0] and angle <= RIGHT[1])


def row_of(case: str, views: list[View]) -> dict[str, Any]:
    """Shares of all views, and seconds for one."""
    start = time.perf_counter()
    ours = Counter(map(outcome, views))
    seconds = (time.perf_counter() - start) / len(views)
    peer = Counter(map(by_peer, views))
    shares = {kind: ours[kind] / len(views) for kind in KINDS}
    wrong, more = peer["wrong"] / len(views), 1.0 / len(views)  # one view more for each, so that the ratio is finite
    return {
        "case": case, "views": len(views), **shares, "peer_right": peer["right"] / len(views), "seconds": seconds,
        "ours": shares["wrong"], "peer": wrong, "peer_name": "best coarse place, then GICP (small_gicp)",
        "unit": "share wrong", "ratio": (wrong + more) / (shares["wrong"] + more),
    }  # fmt: skip


def main() -> None:
    parser = CommandLine(__doc__, FULL, SMOKE)
    parser.add_argument("--ifc", type=Path, metavar="FOLDER", help="also every storey of the IFC files of a folder")
    parser.add_argument("--views", type=int, metavar="N", help="of each storey")
    parser.add_argument("--buildings", type=int, metavar="N", help="that are generated")
    parser.add_json()
    asked = parser.parse_args()
    priors: dict[str, list[Prior]] = {}
    for name, prior in (*generated(asked.buildings), *(from_files(asked.ifc) if asked.ifc else ())):
        priors.setdefault(name, []).append(prior)
    print("| building | sensor | views | right | refused | wrong | s each | peer: right | peer: wrong |")
    print(f"|{' --- |' * 9}")
    rows = []
    for name, same in priors.items():
        for sensor in asked.sensors:
            views = [view for prior in same for view in views_of(prior, sensor, asked.views)]
            if not views:
                continue
            row = row_of(f"{name}, {sensor}", views)
            told = " | ".join(f"{row[kind]:.2f}" for kind in KINDS)
            print(
                f"| {name} | {sensor} | {len(views)} | {told} | {row['seconds']:.1f} | {row['peer_right']:.2f} "
                f"| {row['peer']:.2f} |",
                flush=True,
            )
            rows.append(row)
    if asked.json:
        write_report(asked.json, rows, "small-gicp")


if __name__ == "__main__":
    main()
