"""What `detect` finds where the prior is a cloud itself: an earlier scan, from the place where the robot stands.

    python -m benchmarks.clouds --out runs/clouds [--rooms 50] [--only pillar_added ...] [--seed 3]

Rooms of the thesis's kind. *Filtered*: as the thesis's files are, one point in a voxel of 0.1 m, without objects whose
top is not seen, and without a pose, which is estimated. *Whole*: every point of a scan of 320 x 200, and its pose. For
each kind of scene and condition a JSON file with what was found; what is there is not made again. Prints Markdown:
pairs that are refused, objects that are found of those with an observable fraction of at least 0.2 that the clouds
still hold, and how many of those found are right.
"""

import itertools
from argparse import Namespace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from benchmarks.command_line import CommandLine
from benchmarks.detections import TEST_SEED
from benchmarks.views.detection_scores import COUNTS, objects_of, share_of
from jaxmm.commands.detect_files import Reading, detect
from jaxmm.config import CONDITIONS, SCENARIOS, UNCHANGED
from jaxmm.files import load_json, write_json
from jaxmm.formats.poses import GivenPose
from jaxmm.inputs import InputError
from jaxmm.learning.preprocess import object_filter, voxel_downsample
from jaxmm.runs.room_scans import RoomCase, room_cases
from jaxmm.verdicts.settings import DetectSettings
from warp_scanner.clouds.points import points_of
from warp_scanner.cores import worker_pool
from warp_scanner.rooms.pairs import Pairs
from warp_scanner.sensors.scan import Scan
from warp_scanner.sensors.sensors import OAK_D_PRO_SMALL

SCENES = (*SCENARIOS, UNCHANGED)
FULL = {"rooms": 50, "only": [], "conditions": CONDITIONS}
SMOKE = {"rooms": 1, "only": ["wall_added"], "conditions": ("occluded",)}
FORMS = ("filtered", "whole")
VOXEL, LEAST_TOP = 0.1, 2.0  # [m] of the thesis's files: voxels, and the height above the floor that stays
LEAST_LEFT = 20  # points of an object in both clouds together, below which the filter took it away
SENSOR_HEIGHT = 1.5  # [m] as of most released scans


def main(asked: Namespace) -> None:
    asked.out.mkdir(parents=True, exist_ok=True)
    same = [asked.rooms], [asked.seed], [asked.out]
    tasks = list(itertools.product(asked.only or SCENES, asked.conditions, *same))
    with worker_pool() as pool:
        for line in pool.map(_part, tasks):
            print(line, flush=True)
    print(table(asked.out, asked.rooms, asked.seed))


def _path(out: Path, scene: str, condition: str, rooms: int, seed: int) -> Path:
    return out / f"{scene}_{condition}_{seed}_{rooms}.json"


def _part(task: tuple[str, str, int, int, Path]) -> str:
    scene, condition, rooms, seed, out = task
    path = _path(out, scene, condition, rooms, seed)
    if not path.exists():
        cases = room_cases(
            scene, condition, seed, range(rooms), preset="thesis", sensor=OAK_D_PRO_SMALL, sensor_height=SENSOR_HEIGHT
        )
        write_json(path, [{form: _found(case, form) for form in FORMS} for case in cases])
    return f"{scene} {condition}"


def _found(case: RoomCase, form: str) -> dict[str, Any]:
    """Counts of one room, or why it is refused."""
    pairs, row = case.pairs, case.row
    prior, kept_dt = _cloud(pairs, row, pairs.dt, form)
    scan, kept_robot = _cloud(pairs, row, pairs.robot, form)
    pose = GivenPose(pairs.pose.position[row].astype(float), float(pairs.pose.yaw[row]), float(pairs.pose.pitch[row]))
    with TemporaryDirectory() as folder:
        files = Path(folder) / "prior.npy", Path(folder) / "scan.npy"
        for file, points in zip(files, (prior, scan), strict=True):
            np.save(file, points)
        try:
            found = detect(
                *files, pose if form == "whole" else None, reading=Reading(sensor=OAK_D_PRO_SMALL),
                settings=DetectSettings(propose_views=False),
            )  # fmt: skip
        except InputError as error:
            return {"refused": str(error).removeprefix(f"{files[1]}: ")}
    elements = np.concatenate([kept_dt, kept_robot])
    left = np.array([np.sum(elements == one) for one in pairs.box.element[row]])
    fraction = pairs.observable_fraction.copy()
    fraction[row, left < LEAST_LEFT] *= 0.0  # what the filter took away shows nothing; a gap stays one
    return objects_of(found.mismatches, case._replace(pairs=pairs._replace(observable_fraction=fraction)))


def _cloud(pairs: Pairs, row: int, scan: Scan, form: str) -> tuple[np.ndarray, np.ndarray]:
    """Points (N, 3) [m] of one scan of a room, and the element (N,) that each is of."""
    pose = type(pairs.pose)(*(field[row : row + 1] for field in pairs.pose))
    back = np.isfinite(scan.distance[row])
    points = points_of(pose, pairs.directions, scan.distance[row : row + 1])[0, back]
    element = scan.element[row, back]
    if form == "filtered":
        half = float(pairs.size[row, 2]) / 2
        stays = object_filter(points, element, -half, half, LEAST_TOP)
        points, element = points[stays], element[stays]
        kept = voxel_downsample(points, VOXEL)
        points, element = points[kept], element[kept]
    return points, element


def table(out: Path, rooms: int, seed: int) -> str:
    """All that was found, as Markdown."""
    cells = "refused | found | of those found, right"
    lines = [
        f"| scene | condition | pairs | filtered, no pose: {cells} | whole, with its pose: {cells} |",
        "| --- |" + " --- |" * 8,
    ]
    for scene, condition in itertools.product(SCENES, CONDITIONS):
        path = _path(out, scene, condition, rooms, seed)
        if not path.exists():
            continue
        told, row = load_json(path), [scene.replace("_", " "), condition, str(rooms)]
        for form in FORMS:
            scored = [one[form] for one in told if "refused" not in one[form]]
            total = {name: sum(one[name] for one in scored) for name in COUNTS}
            row += [str(len(told) - len(scored)), share_of(total["reached"], total["wanted"])]
            row += [share_of(total["reached"], total["found"] - total["hidden"])]
        lines.append(f"| {' | '.join(row)} |")
    return "\n".join(lines)


if __name__ == "__main__":
    parser = CommandLine(__doc__, FULL, SMOKE)
    parser.add_out()
    parser.add_argument("--rooms", type=int, metavar="N", help="of each kind and condition")
    parser.add_argument("--only", nargs="+", choices=SCENES, metavar="SCENE")
    parser.add_argument("--seed", type=int, default=TEST_SEED, metavar="N")
    asked = parser.parse_args()
    main(asked)
