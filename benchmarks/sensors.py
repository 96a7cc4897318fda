"""What `detect` finds with sensors that err, when their ranges settle first and when they are taken as they are.

    python -m benchmarks.sensors --out runs/sensors [--rooms 25] [--only tls ...] [--seed 3]

Four presets of sensors, ideal and as built (noise, dropouts, mixed pixels at edges), in furnished rooms in which a
wall or a pillar was added, or removed, and in unchanged ones. For each sensor a JSON file with the counts of every
room; what is there is not made again. Prints Markdown: precision and recall of objects as `benchmarks.detections` has
them, and verdicts on walls and columns that could be told.
"""

import itertools
from argparse import Namespace
from pathlib import Path
from typing import Any

from benchmarks.command_line import CommandLine
from benchmarks.detections import TEST_SEED, elements_of
from benchmarks.views.detection_scores import objects_of, share_of
from jaxmm.config import SCENARIOS, UNCHANGED
from jaxmm.files import load_json, write_json
from jaxmm.learning.object_scores import LEAST_SHOWN
from jaxmm.learning.prediction import Judges, read_judges
from jaxmm.runs.room_scans import RoomCase, room_cases
from jaxmm.verdicts.detection import detect_scans
from jaxmm.verdicts.named_scans import NamedScan
from jaxmm.verdicts.settings import DetectSettings
from jaxmm.verdicts.verdicts import OCCLUDED, PRESENT, REMOVED, UNSCANNED
from jaxmm.weights import DEFAULT
from warp_scanner.cores import worker_pool

SENSORS = ("oak-d-pro-small", "ouster-64", "velodyne-16", "tls")
# Of sensors, by the end of their names: how ranges are taken, and whether they settle. Exact ones never do.
WAYS = {"": {"exact": True}, "-real": {"settled": True, "as they are": False}}
FULL = {"rooms": 25, "only": [], "scenes": (*SCENARIOS, UNCHANGED)}
SMOKE = {"rooms": 1, "only": ["oak-d-pro-small"], "scenes": ("wall_added",)}
AT_ONCE = 10  # rooms: a scan of a terrestrial scanner has 1.6 million points


def main(asked: Namespace) -> None:
    asked.out.mkdir(parents=True, exist_ok=True)
    same = [asked.rooms], [asked.seed], [asked.out]
    tasks = list(itertools.product(asked.only or SENSORS, WAYS, asked.scenes, *same))
    with worker_pool() as pool:
        for line in pool.map(_part, tasks):
            print(line, flush=True)
    print(table(asked.out, asked.rooms, asked.seed))


def _path(out: Path, sensor: str, scene: str, rooms: int, seed: int) -> Path:
    return out / f"{sensor}_{scene}_{seed}_{rooms}.json"


def _part(task: tuple[str, str, str, int, int, Path]) -> str:
    sensor, built, scene, rooms, seed, out = task
    path = _path(out, sensor + built, scene, rooms, seed)
    if not path.exists():
        judges, found = read_judges(DEFAULT), []
        for start in range(0, rooms, AT_ONCE):
            numbers = range(start, min(start + AT_ONCE, rooms))
            cases = room_cases(scene, "occluded", seed, numbers, sensor=sensor + built)
            found += [_room(judges, case, WAYS[built]) for case in cases]
        write_json(path, found)
    return f"{sensor}{built} {scene}"


def _room(judges: Judges, case: RoomCase, ways: dict[str, bool]) -> dict[str, Any]:
    told = {}
    for name, settle in ways.items():
        settings = DetectSettings(settle=settle, refine=False, propose_views=False)
        found = detect_scans(
            case.prior, [NamedScan(case.scan, "scan", len(case.scan.points), "given")], judges, settings
        )
        elements = [list(one) for one, _ in elements_of(found, case)]
        told[name] = objects_of(found.mismatches, case) | {"elements": elements}
    return told


def table(out: Path, rooms: int, seed: int) -> str:
    """All that was found, as Markdown."""
    lines = [
        "| sensor | ranges | added: precision | recall | removed: precision | recall | unchanged rooms without one "
        "| testable elements called occluded or unscanned | removed called present, or present removed |",
        "| --- |" + " --- |" * 8,
    ]
    ways = [(built, way) for built, names in WAYS.items() for way in names]
    for sensor, (built, way) in itertools.product(SENSORS, ways):
        paths = {scene: _path(out, sensor + built, scene, rooms, seed) for scene in (*SCENARIOS, UNCHANGED)}
        told = {scene: [room[way] for room in load_json(path)] for scene, path in paths.items() if path.exists()}
        if not told:
            continue
        every = [room for found in told.values() for room in found]
        cells = [cell for change in ("added", "removed") for cell in _scores(every, change)]
        still = [not room["boxes"] for room in told.get(UNCHANGED, [])]
        cells += [_share(still), *_verdicts([one for room in every for one in room["elements"]])]
        lines.append(f"| {sensor}, {'as built' if built else 'ideal'} | {way} | {' | '.join(cells)} |")
    return "\n".join(lines)


def _scores(rooms: list[dict[str, Any]], change: str) -> list[str]:
    """Precision and recall of one change, over all rooms."""
    boxes, objects = (
        [one for room in rooms for one in room[kind] if one["change"] == change] for kind in ("boxes", "objects")
    )
    return [
        _share([one["right"] for one in boxes]),
        _share([one["found"] for one in objects if one["shown"] >= LEAST_SHOWN]),
    ]


def _verdicts(elements: list[list[Any]]) -> list[str]:
    """Of elements that could be told: how many were left open, and how many told wrong."""
    told = [one for one in elements if one[0] in (PRESENT, REMOVED)]
    left = [one[1] in (OCCLUDED, UNSCANNED) for one in told]
    wrong = [one[1] in (PRESENT, REMOVED) and one[1] != one[0] for one in told]
    return [_share(left), _share(wrong)]


def _share(those: list[bool]) -> str:
    return share_of(sum(those), len(those))


if __name__ == "__main__":
    parser = CommandLine(__doc__, FULL, SMOKE)
    parser.add_out()
    parser.add_argument("--rooms", type=int, metavar="N", help="of each scene")
    parser.add_argument("--only", nargs="+", choices=SENSORS, metavar="SENSOR")
    parser.add_argument("--seed", type=int, default=TEST_SEED, metavar="N")
    asked = parser.parse_args()
    main(asked)
