"""What `detect` finds in held-out rooms, from scan to mismatches and verdicts, with either preset.

    python -m benchmarks.detections --out runs/detections [--rooms 200] [--kind varied|thesis]
        [--only wall_removed ...] [--presets default ...] [--model RUN|FILE]

Every room is one scan of 320 x 200 with furniture and one without, against its own building model. For each kind of
scene and condition a JSON file with what was found in every room; what is there is not made again, unless a preset is
missing in it. Prints Markdown: precision and recall of objects, errors of centres, and verdicts against the
simulator's truth. Recall is of objects with an observable fraction of at least 0.2. Precision is told twice: of all
that is found, and without what is found, rightly or not, where an object shows less than that.
"""

import itertools
from argparse import Namespace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.command_line import CommandLine
from benchmarks.views.detection_scores import COUNTS, objects_of, share_of
from jaxmm.config import CONDITIONS, MULTI_SCENARIOS, SCENARIOS, UNCHANGED
from jaxmm.files import load_json, write_json
from jaxmm.learning.object_scores import LEAST_SHOWN
from jaxmm.learning.prediction import Judges, read_judges
from jaxmm.objects.finder import ObjectSettings
from jaxmm.runs.room_scans import RoomCase, room_cases
from jaxmm.runs.room_truth import true_verdicts
from jaxmm.verdicts.detection import detect_scans
from jaxmm.verdicts.named_scans import NamedScan
from jaxmm.verdicts.results import Detection
from jaxmm.verdicts.settings import PRESETS as HOW
from jaxmm.verdicts.settings import DetectSettings
from jaxmm.verdicts.verdicts import PRESENT, REMOVED, VERDICTS
from jaxmm.weights import DEFAULT
from warp_scanner.cores import worker_pool
from warp_scanner.rooms.pairs import PRESETS

TEST_SEED = 3  # of configs/weights.toml: neither training nor any choice has seen its rooms
FULL = {"rooms": 200, "only": [], "conditions": CONDITIONS, "presets": list(HOW)}
SMOKE = {"rooms": 1, "only": ["pillar_added_and_removed"], "conditions": ("occluded",)}
SCENES = (*SCENARIOS, UNCHANGED, *MULTI_SCENARIOS)
AT_ONCE = 20  # rooms
UNCHANGED_SHARE = 1.25  # of the rooms of a scene with changes, in each condition
FURNITURE = ObjectSettings().furniture_height  # [m] what is seen no higher may be furniture


def main(asked: Namespace) -> None:
    asked.out.mkdir(parents=True, exist_ok=True)
    source = (asked.model, asked.seed, asked.kind)
    parts = [
        (scene, condition, start, min(AT_ONCE, count - start), asked.presets, source, asked.out)
        for scene, condition in itertools.product(asked.only or SCENES, asked.conditions)
        for count in [round(asked.rooms * (UNCHANGED_SHARE if scene == UNCHANGED else 1.0))]
        for start in range(0, count, AT_ONCE)
    ]
    with worker_pool() as pool:
        for line in pool.map(_part, parts):
            print(line, flush=True)
    print(table(asked.out))


def _part(task: tuple) -> str:
    scene, condition, start, count, presets, (model, seed, kind), out = task
    path = out / f"{scene}_{condition}_{start}.json"
    if not path.exists() or not set(presets) <= load_json(path)[0].keys():
        judges, numbers = read_judges(model), range(start, start + count)
        found = [_room(judges, case, presets) for case in room_cases(scene, condition, seed, numbers, preset=kind)]
        write_json(path, found)
    return f"{scene} {condition}: rooms {start} to {start + count - 1}"


def _room(judges: Judges, case: RoomCase, presets: list[str]) -> dict[str, Any]:
    told: dict[str, Any] = {}
    for preset in presets:
        settings = DetectSettings(preset=preset, refine=False, propose_views=False)
        scan = NamedScan(case.scan, "scan", len(case.scan.points), "given")
        found = detect_scans(case.prior, [scan], judges, settings)
        told[preset] = objects_of(found.mismatches, case)
        told["elements"] = [list(one) for one, _ in elements_of(found, case)]
    return told


def elements_of(found: Detection, case: RoomCase) -> list[tuple[tuple[str, str, float], str]]:
    """Truth (`room_truth.true_verdicts`), verdict and probability of every wall and column, with its guid."""
    said, guids = {one.guid: one for one in found.elements}, case.prior.building.elements.guid
    asked = [row for row, guid in enumerate(guids) if guid in said]
    truth = true_verdicts(case, asked)
    return [
        ((truth[row], said[guids[row]].verdict, round(said[guids[row]].probability, 6)), guids[row]) for row in asked
    ]


def table(out: Path) -> str:
    """All that was found, as Markdown."""
    lines = [
        "| scene | condition | rooms | precision | of what shows | recall | thesis's preset: precision | of what shows "
        "| recall | rooms without a false object |",
        "| --- |" + " --- |" * 9,
    ]
    every, off = [], {preset: [] for preset in HOW}
    for scene, condition in itertools.product(SCENES, CONDITIONS):
        paths = sorted(out.glob(f"{scene}_{condition}_[0-9]*.json"))
        rooms = [room for path in paths for room in load_json(path)]
        if not rooms:
            continue
        every += [element for room in rooms for element in room["elements"]]
        cells = []
        for preset in HOW:
            scored = [room[preset] for room in rooms if preset in room]
            off[preset] += [each for one in scored for each in one["off"]]
            cells += _scores({key: sum(one[key] for one in scored) for key in COUNTS})
        clean = np.mean([room["default"]["found"] == room["default"]["right"] for room in rooms])
        lines.append(f"| {scene.replace('_', ' ')} | {condition} | {len(rooms)} | {' | '.join(cells)} | {clean:.3f} |")
    tops = _by_top(out)
    return "\n".join([*lines, "", *tops, "", *_offsets(off), "", *_confusion(every), "", *_risk(every)])


def _scores(total: dict[str, int]) -> list[str]:
    """Precision of everything found, precision without what hardly shows, and recall."""
    return [
        share_of(total["right"], total["found"]), share_of(total["reached"], total["found"] - total["hidden"]),
        share_of(total["reached"], total["wanted"]),
    ]  # fmt: skip


def _by_top(out: Path) -> list[str]:
    """Recall of added objects by how high they are seen: what one sees only below a cabinet's height may be one."""
    rooms = [room for path in sorted(out.glob("*_[0-9]*.json")) for room in load_json(path)]
    added = [
        one for room in rooms for one in room["default"]["objects"]
        if one["change"] == "added" and one["shown"] >= LEAST_SHOWN and one["top"] is not None
    ]  # fmt: skip
    lines = ["| added objects | found |", "| --- | --- |"]
    for name, low in ((f"seen above {FURNITURE} m", False), ("seen only below", True)):
        mine = [one["found"] for one in added if (one["top"] < FURNITURE) == low]
        lines.append(f"| {name} | {share_of(sum(mine), len(mine))} |")
    return lines


def _offsets(off: dict[str, list]) -> list[str]:
    """Median and 95th percentile of how far centres of pillars, and planes of walls, are off."""
    lines = ["| preset | pillar centres [m], median, 95 % | wall planes [m], median, 95 % |", "| --- | --- | --- |"]
    for preset, rows in off.items():
        cells = []
        for kind, place in (("pillar", 2), ("wall", 3)):
            values = [one[place] for one in rows if one[0] == kind and one[1] == "added"]
            cells.append(f"{np.median(values):.3f}, {np.percentile(values, 95):.3f}" if values else "-")
        lines.append(f"| {preset}, added objects | {cells[0]} | {cells[1]} |")
    return lines


def _confusion(elements: list[list[Any]]) -> list[str]:
    lines = [f"| truth | {' | '.join(VERDICTS)} |", "| --- |" + " --- |" * len(VERDICTS)]
    for truth in VERDICTS:
        counts = [sum(one[0] == truth and one[1] == verdict for one in elements) for verdict in VERDICTS]
        lines.append(f"| {truth} | {' | '.join(str(count) for count in counts)} |")
    return lines


def _risk(elements: list[list[Any]]) -> list[str]:
    """Share of wrong verdicts among the surest ones, of what could be told at all."""
    told = [one for one in elements if one[0] in (PRESENT, REMOVED) and one[1] in (PRESENT, REMOVED)]
    testable = sum(one[0] in (PRESENT, REMOVED) for one in elements)
    if not told:
        return []
    sure = np.array([abs(one[2] - 0.5) for one in told])
    wrong = np.array([one[0] != one[1] for one in told])[np.argsort(-sure, kind="stable")]
    lines = ["| coverage of testable elements | risk |", "| --- | --- |"]
    for share in (0.5, 0.8, 0.9, 0.95, 1.0):
        count = max(1, round(share * len(wrong)))
        lines.append(f"| {count / testable:.3f} | {wrong[:count].mean():.4f} |")
    return lines


if __name__ == "__main__":
    parser = CommandLine(__doc__, FULL, SMOKE)
    parser.add_out()
    parser.add_argument("--rooms", type=int, metavar="N")
    parser.add_argument("--only", nargs="+", choices=SCENES, metavar="SCENE")
    parser.add_argument("--presets", nargs="+", choices=HOW, help="'default' must be among them")
    parser.add_argument("--model", type=Path, default=DEFAULT, metavar="RUN|FILE")
    parser.add_argument("--seed", type=int, default=TEST_SEED, metavar="N")
    parser.add_argument("--kind", choices=sorted(PRESETS), default="varied", help="of rooms")
    asked = parser.parse_args()
    if "default" not in asked.presets:
        parser.error("--presets: 'default' must be among them, for its verdicts")
    main(asked)
