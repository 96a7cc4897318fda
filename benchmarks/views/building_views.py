"""Views of building files by several sensors: what is told of each, a file of JSON lines for each file and sensor.

A run that was ended goes on where it was, and one of more views keeps what fewer have told. And the building files
themselves: those of a folder, or one of a generated room, for smoke runs.
"""

import argparse
import itertools
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.command_line import CommandLine, end_without
from benchmarks.rays import rooms_and_poses
from benchmarks.views.kept_views import KeptViews
from jaxmm.learning.prediction import Judges, read_judges
from jaxmm.rays.scan_rays import PosedScan
from jaxmm.verdicts.priors import Prior, read_prior
from jaxmm.weights import DEFAULT
from warp_scanner import draws
from warp_scanner.buildings.model_files import model_of
from warp_scanner.buildings.positions import draw_positions
from warp_scanner.buildings.room_ifc import write_room
from warp_scanner.clouds.points import points_of
from warp_scanner.cores import worker_pool
from warp_scanner.rooms.standing import Standing
from warp_scanner.sensors.imperfections import imperfect
from warp_scanner.sensors.poses import Pose, rotation_of
from warp_scanner.sensors.sense import rays_of
from warp_scanner.sensors.sensors import Sensor
from warp_scanner.sensors.surface import incidence_of
from warp_scanner.sensors.triangles import TriangleScene, cast_faces, face_normals

SEED = 3  # of the test places
# What is told of one view, by prior, models, sensor, and seed and number; None where there is no such view.
Teller = Callable[[Prior, Judges, str, tuple[int, int]], dict[str, Any] | None]


def asked_for(about: str, full: dict[str, Any], smoke: dict[str, Any], projects: bool = False) -> argparse.Namespace:
    """The command line: FOLDER, --out, --views, --seed, and --project if asked for; sizes: `views` and `sensors`."""
    parser = CommandLine(about, full, smoke)
    parser.add_input("folder")
    parser.add_out()
    parser.add_argument("--views", type=int, metavar="N", help="of each file and sensor")
    parser.add_argument("--seed", type=int, default=SEED, metavar="N")
    if projects:
        parser.add_argument("--project", type=Path, metavar="FOLDER", help="also in one building of all its files")
    asked = parser.parse_args()
    asked.folder = asked.folder or made_building(parser.scratch / "ifc")
    return asked


def made_building(folder: Path) -> Path:
    """A new folder with one IFC file, of a generated room."""
    folder.mkdir(parents=True)
    write_room(folder / "room.ifc", rooms_and_poses(1)[0], 0)
    return folder


def ifc_files(folder: Path) -> list[Path]:
    """All IFC files below a folder; without any the process ends."""
    paths = sorted(folder.rglob("*.ifc"))
    return paths or end_without(f"{folder}: expected IFC files, found {'none' if folder.is_dir() else 'no folder'}")


def tell_views(teller: Teller, asked: argparse.Namespace, projects: Sequence[Path] = ()) -> None:
    """Views of every IFC file below a folder by every sensor, on all cores; what is there is not made again.

    Args:
        teller: what is told of a view.
        asked: the command line.
        projects: further folders, whose files are one building each.
    """
    paths = [*ifc_files(asked.folder), *projects]
    asked.out.mkdir(parents=True, exist_ok=True)
    with worker_pool() as pool:
        tasks = [(teller, path, sensor, asked) for path, sensor in itertools.product(paths, asked.sensors)]
        for line in pool.map(_part, tasks):
            print(line, flush=True)


def kept_views(out: Path, sensor: str, seed: int) -> list[dict[str, Any]]:
    """What was told of all files by one sensor, `model` said with each."""
    found = []
    for path in sorted(out.glob(f"*_{sensor}_{seed}.jsonl")):
        model = path.stem.removesuffix(f"_{sensor}_{seed}")
        found += [{"model": model} | one for _, one in KeptViews(path).items() if one is not None]
    return found


def building_places(folder: Path, count: int, seed: int) -> Iterator[tuple[Prior, Pose, int]]:
    """Each IFC file in a folder with up to `count` places (R = 1) inside of it, and the numbers of these draws."""
    for path in sorted(folder.glob("*.ifc")):
        prior = read_prior(path)
        keys = draws.keys(seed, np.arange(3 * count))
        pose, found = draw_positions(prior.building, prior.scene, Standing(height=(1.0, 1.8)), keys)
        for number in np.flatnonzero(found)[:count].tolist():
            yield prior, Pose(*(field[number : number + 1] for field in pose)), number


def scanned(
    scene: TriangleScene, present: np.ndarray, seen: tuple[Sensor, Pose], key: tuple[int, int]
) -> tuple[PosedScan, np.ndarray]:
    """A scan as its sensor errs, and the ranges (P,) [m] of all its rays, inf without a return.

    Args:
        scene: what there is.
        present: (E,) bool, which of it stands.
        seen: by which sensor, and from where (R = 1).
        key: seed and number of the errors.
    """
    sensor, pose = seen
    rays = rays_of(sensor, pose)
    scan, face = cast_faces(scene, rays, present)
    incidence = incidence_of(face_normals(scene.triangles, face), rays)
    reach = imperfect(scan, incidence, sensor, key[0], np.array([key[1]])).distance
    ends = points_of(pose, sensor.directions(), reach)[0, np.isfinite(reach[0])]
    turn = rotation_of(pose.yaw, pose.pitch)[0].astype(np.float64)
    return PosedScan(ends, pose.position[0].astype(np.float64), turn, sensor), reach[0]


def _part(task: tuple[Teller, Path, str, argparse.Namespace]) -> str:
    teller, path, sensor, asked = task
    name = f"{path.stem}_{sensor}_{asked.seed}"
    kept = KeptViews(asked.out / f"{name}.jsonl")
    if wanted := [number for number in range(asked.views) if not kept.has((number,))]:
        prior, judges = read_prior(model_of(path)), read_judges(DEFAULT)
        for number in wanted:
            kept.add((number,), teller(prior, judges, sensor, (asked.seed, number)))
    return name
