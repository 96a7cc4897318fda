"""Given poses that are wrong: are they put right, refused, doubted, or believed?

    python -m benchmarks.poses --out runs/poses [--ifc FOLDER] [--rooms 200] [--places 5] [--seed 77] [--against TREE]

Each generated room (`varied`, furnished) is met once by each sensor as built; whether nothing changed in it or one to
three things, and by how much the pose is off, is drawn: up to 0.5 m in any direction, 10 degrees of yaw, and 3 of pitch
and roll, and in every sixth view nothing. With --ifc likewise from places in building files, of which walls and
columns are gone. *Right* is within 3 cm and 0.5 degrees; *open* is wrong, but the report says along which direction
nothing holds the place; *believed* is wrong without a word. Peers are plain GICP (small_gicp) and ICP from points to
planes (Open3D, where it is installed), both from coarse to fine, from the same start on the same surfaces; they refuse
nothing. With --against, the build in another checkout is asked the same. What --out holds is not made again, unless
somebody was not asked yet: with fewer rooms and --against, another build is asked of these alone. Prints Markdown.
Two hours of one core.
"""

import itertools
from argparse import Namespace
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import small_gicp
from scipy.spatial.transform import Rotation

from benchmarks.command_line import CommandLine
from benchmarks.peers import has
from benchmarks.peers.earlier_build import EarlierBuild
from benchmarks.views.building_views import made_building
from benchmarks.views.told_offsets import share_with_interval
from benchmarks.views.wrong_poses import View, apart, disturbed, file_views, room_views
from jaxmm.files import load_json, write_json
from jaxmm.inputs import InputError
from jaxmm.rays.scan_rays import PosedScan, rays_of_scan
from jaxmm.verdicts.building_evidence import surfaces_along
from jaxmm.verdicts.named_scans import NamedScan, placed_scan, settled_scan
from jaxmm.verdicts.settings import DetectSettings
from warp_scanner.cores import worker_pool

SEED = 77  # of rooms by which nothing was chosen
MOST = 0.5, 10.0, 3.0  # [m], [deg] of yaw, [deg] of pitch and roll
EXACT = 1 / 6  # share of the views whose pose is right as it is given
RIGHT = 0.03, 0.5  # [m], [deg]
SPACING = 0.1  # [m] of the peers' clouds
REACHES = (
    1.0,
    0.5,
    0.2,
    0.1,
)  # [m] within which they match points, from coarse to fine; with the first alone most fail
FULL = {
    "sensors": ("oak-d-pro-real", "velodyne-16-real", "ouster-64-real", "tls-real"),
    "rooms": 200,
    "places": 5,
}
SMOKE = {"sensors": ("velodyne-16-real",), "rooms": 2, "places": 2}
AT_ONCE = 10  # rooms of a part
KINDS = ("right", "refused or doubted", "open", "believed")
BINS = {"shift": (0.0, 0.1, 0.2, 0.3, 0.4, 0.5), "yaw": (0.0, 2.5, 5.0, 7.5, 10.0)}  # [m], [deg]
PEERS = {"gicp": "GICP alone", "open3d": "Open3D's ICP alone", "earlier": "the other build"}


# The motion (4, 4) of points (N, 3) onto others (M, 3).
Peer = Callable[[np.ndarray, np.ndarray], np.ndarray]
# What one makes of a view from a start: one of KINDS, and how far [m], [deg] off its place it then is; None: nowhere.
Told = tuple[str, float | None, float | None]
Asker = Callable[[View, PosedScan], Told]
Task = tuple[str, int | None, tuple[str, ...], Namespace]  # sensor, first room or None of IFC files, who is asked


def start_of(view: View) -> PosedScan:
    """The scan as it lies by the pose that is given."""
    rng = np.random.default_rng((*view.key, 1))
    return view.scan if rng.random() < EXACT else disturbed(view.scan, MOST, rng)


def by_us(view: View, believed: PosedScan) -> Told:
    """What our registration makes of it."""
    try:
        one = settled_scan(NamedScan(believed, "scan", len(believed.points), "given"))
        placed = placed_scan(view.prior, one, DetectSettings())
    except InputError:
        return "refused or doubted", None, None
    return _told(view, placed.scan.position, placed.scan.rotation, (placed.notes, placed.open))


def by_earlier(build: EarlierBuild, sensor: str, view: View, believed: PosedScan) -> Told:
    """The same by another build."""
    found = build.placed(view.model, view.prior.origin, believed, sensor)
    if not found:
        return "refused or doubted", None, None
    return _told(view, np.array(found["position"]), np.array(found["rotation"]), (found["doubts"], found["open"]))


def by_peer(motion_of: Peer, view: View, believed: PosedScan) -> Told:
    """The same by one that refuses nothing."""
    surfaces = surfaces_along(view.prior.scene, rays_of_scan(believed)).astype(np.float64)
    if len(surfaces) < 100:
        return "believed", None, None
    centre = np.asarray(believed.position, np.float64)
    motion = motion_of(surfaces - centre, believed.points.astype(np.float64) - centre)
    return _told(view, centre + motion[:3, 3], motion[:3, :3] @ believed.rotation)


def _told(view: View, position: np.ndarray, rotation: np.ndarray, said: tuple = ((), ())) -> Told:
    off, angle = apart(view.scan, position, rotation)
    if off <= RIGHT[0] and angle <= RIGHT[1]:
        return "right", off, angle
    doubts, ways = said
    return "refused or doubted" if doubts else "open" if ways else "believed", off, angle


def by_gicp(target: np.ndarray, source: np.ndarray) -> np.ndarray:
    """The motion (4, 4) of points (N, 3) onto others, by plain GICP, from coarse to fine."""
    target, tree = small_gicp.preprocess_points(target, downsampling_resolution=SPACING)
    source, _ = small_gicp.preprocess_points(source, downsampling_resolution=SPACING)
    motion = np.eye(4)
    for reach in REACHES:
        found = small_gicp.align(
            target,
            source,
            tree,
            init_T_target_source=motion,
            registration_type="GICP",
            max_correspondence_distance=reach,
        )
        motion = found.T_target_source
    return motion


def by_open3d(target: np.ndarray, source: np.ndarray) -> np.ndarray:
    """The same by Open3D's ICP from points to planes."""
    import open3d

    clouds = [
        open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points)).voxel_down_sample(SPACING)
        for points in (target, source)
    ]
    clouds[0].estimate_normals(open3d.geometry.KDTreeSearchParamHybrid(3 * SPACING, 30))
    registration, motion = open3d.pipelines.registration, np.eye(4)
    for reach in REACHES:
        motion = registration.registration_icp(
            clouds[1], clouds[0], reach, motion, registration.TransformationEstimationPointToPlane()
        ).transformation
    return motion


def _part(task: Task) -> str:
    """Asks who was not asked yet of one part, and keeps what they say."""
    sensor, start, names, asked = task
    path = _path(asked, sensor, start)
    kept = load_json(path)["views"] if path.exists() else []
    missing = [name for name in names if not path.exists() or any(name not in one["told"] for one in kept)]
    if missing:
        with TemporaryDirectory(prefix="poses_") as scratch:
            build = EarlierBuild(asked.against) if "earlier" in missing else None
            askers: dict[str, Asker] = {
                "ours": by_us,
                "gicp": lambda *one: by_peer(by_gicp, *one),
                "open3d": lambda *one: by_peer(by_open3d, *one),
                "earlier": lambda *one: by_earlier(build, sensor, *one),
            }
            views = _views(sensor, start, asked, Path(scratch) if build else None)
            asking = {name: askers[name] for name in missing}
            for row, view in enumerate(views):
                if row == len(kept):
                    kept.append(_record(view, sensor, start is None))
                believed = start_of(view)
                kept[row]["told"] |= {name: list(ask(view, believed)) for name, ask in asking.items()}
            if build:
                build.close()
        write_json(path, {"views": kept})
    return path.stem


def _path(asked: Namespace, sensor: str, start: int | None) -> Path:
    what = f"files_{asked.places}" if start is None else f"rooms_{start}_{_numbers(start, asked).stop}"
    return asked.out / f"{sensor}_{what}_{asked.seed}.json"


def _numbers(start: int, asked: Namespace) -> range:
    return range(start, min(start + AT_ONCE, asked.rooms))


def _views(sensor: str, start: int | None, asked: Namespace, folder: Path | None) -> Iterator[View]:
    if start is None:
        return file_views(asked.ifc, sensor, asked.places, asked.seed)
    return room_views(sensor, _numbers(start, asked), asked.seed, folder)


def _record(view: View, sensor: str, of_file: bool) -> dict[str, Any]:
    """What is to be known of a view, as JSON; whoever was asked stands in `told`."""
    believed = start_of(view)
    turn = Rotation.from_matrix(believed.rotation @ view.scan.rotation.T).as_euler("ZYX", degrees=True)
    shift, _ = apart(view.scan, believed.position, believed.rotation)
    return {
        "sensor": sensor, "of": "building files" if of_file else "rooms", "model": view.prior.file and
        view.prior.file.file, "number": view.key[1], "changes": view.changes, "exact": believed is view.scan,
        "shift": shift, "yaw": abs(float(turn[0])), "told": {},
    }  # fmt: skip


def table(views: list[dict[str, Any]]) -> str:
    """All that was told, as Markdown: by sensor, by how far poses are off, and the sum."""
    peers = [name for name in PEERS if any(name in view["told"] for view in views)]
    columns = ["views", "", *KINDS, "right ones: most off [m]"]
    for name in peers:
        columns += [f"{PEERS[name]}: right", *([f"{PEERS[name]}: believed"] if name == "earlier" else [])]
    lines = [f"| {' | '.join(columns)} |", f"|{' --- |' * len(columns)}"]
    off = [view for view in views if not view["exact"]]
    groups = {"poses that are right": [view for view in views if view["exact"]]}
    for of, sensor in itertools.product(("rooms", "building files"), dict.fromkeys(view["sensor"] for view in views)):
        groups[f"{of}, `{sensor}`"] = [view for view in off if (view["of"], view["sensor"]) == (of, sensor)]
    for name, unit in (("shift", "m"), ("yaw", "°")):
        for low, high in itertools.pairwise(BINS[name]):
            last = high == BINS[name][-1]
            groups[f"{name} of {low:g} to {high:g} {unit}"] = [
                view for view in off if low <= view[name] and (view[name] < high or last)
            ]
    groups["all that are off, unchanged"] = [view for view in off if view["changes"] in ("unchanged", "0 gone")]
    groups["all that are off"] = off
    lines += [_line(name, some, peers) for name, some in groups.items() if some]
    wrong = sum(view["told"]["ours"][0] == "believed" for view in off)
    return "\n".join(
        [*lines, "", f"Believed though wrong: {wrong} of {len(off)}, {share_with_interval(wrong, len(off))}"]
    )


def _line(name: str, views: list[dict[str, Any]], peers: list[str]) -> str:
    told = Counter(view["told"]["ours"][0] for view in views)
    farthest = max((view["told"]["ours"][1] for view in views if view["told"]["ours"][0] == "right"), default=0.0)
    cells = [name, str(len(views)), *(f"{told[kind] / len(views):.3f}" for kind in KINDS), f"{farthest:.3f}"]
    for peer in peers:
        kinds = Counter(view["told"][peer][0] for view in views if peer in view["told"])
        few = f" of {kinds.total()}" if kinds.total() < len(views) else ""
        for kind in ("right", "believed") if peer == "earlier" else ("right",):
            cells.append(f"{kinds[kind] / kinds.total():.3f}{few}" if kinds else "-")
    return f"| {' | '.join(cells)} |"


def main() -> None:
    parser = CommandLine(__doc__, FULL, SMOKE)
    parser.add_out()
    parser.add_argument("--ifc", type=Path, metavar="FOLDER", help="also from places in the IFC files of a folder")
    parser.add_argument("--rooms", type=int, metavar="N")
    parser.add_argument("--places", type=int, metavar="N", help="in each IFC file")
    parser.add_argument("--sensors", nargs="+", metavar="NAME")
    parser.add_argument("--seed", type=int, default=SEED, metavar="N")
    parser.add_argument(
        "--peers", nargs="*", choices=("gicp", "open3d"), default=("gicp", "open3d"), help="to ask, too"
    )
    parser.add_argument("--against", type=Path, metavar="TREE", help="a checkout of another build, asked the same")
    asked = parser.parse_args()
    if parser.smoke:
        asked.ifc = asked.ifc or made_building(parser.scratch / "ifc")
    asked.out.mkdir(parents=True, exist_ok=True)
    peers = [name for name in asked.peers if name == "gicp" or has(name)]
    names = ("ours", *peers, *(["earlier"] if asked.against else []))
    starts = [*range(0, asked.rooms, AT_ONCE), *([None] if asked.ifc else [])]
    tasks = [(sensor, start, names, asked) for start, sensor in itertools.product(starts, asked.sensors)]
    with worker_pool() as pool:
        for line in pool.map(_part, tasks):
            print(line, flush=True)
    print(table([view for sensor, start, *_ in tasks for view in load_json(_path(asked, sensor, start))["views"]]))


if __name__ == "__main__":
    main()
