"""What `detect` finds in building files: walls and columns taken out or put in by script, scanned, and looked for.

    python -m benchmarks.buildings FOLDER --out runs/buildings [--pairs 10] [--condition occluded]

Every IFC file below FOLDER; for each of the six changes as many views as asked for, from free places of the building.
Removed: the model's element is not there. Added: something stands free. Missing: one of the building's own, where it
belongs, that the model lacks. A view of a change with an observable fraction of at least 0.2 is right when exactly that
element is called removed, or exactly that object is found; of a change that shows less, finding nothing is right as
well, but nothing that is gone may be called present. Most of a missing wall is out of view, so boxes of its type have
to hold half of the rays that show it, and none may be on anything else. Views in which something of another kind would
look the same, see `lookalikes`, are told apart from the others. Of all boxes that touch an added object it tells how
often their type is right, by how probable the report calls it. What is there is not made again. Prints Markdown, and
how long a scan of 1280 x 800 takes: from loaded arrays to the report, warm; and the whole command `jaxmm detect`, with
empty caches, as on a new machine, and again with those that the first left.
"""

import argparse
import itertools
import json
import os
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from benchmarks.command_line import CommandLine
from benchmarks.lookalikes import lookalikes, sections_of, view_of
from benchmarks.views.building_views import ifc_files, made_building
from jaxmm.config import SCENARIOS
from jaxmm.files import load_json, write_json
from jaxmm.inputs import InputError
from jaxmm.learning.box_match import match_boxes
from jaxmm.learning.boxes import Box
from jaxmm.learning.object_scores import LEAST_SHOWN
from jaxmm.learning.prediction import Judges, read_judges
from jaxmm.rays.scan_rays import PosedScan
from jaxmm.reports.report_json import to_json
from jaxmm.runs.room_scans import true_boxes
from jaxmm.verdicts.detection import detect_scans
from jaxmm.verdicts.mismatch_points import inside
from jaxmm.verdicts.named_scans import NamedScan
from jaxmm.verdicts.priors import Prior, prior_of_building, read_prior
from jaxmm.verdicts.results import Mismatch, box_of
from jaxmm.verdicts.settings import DetectSettings
from jaxmm.verdicts.verdicts import PRESENT, REMOVED
from jaxmm.weights import DEFAULT
from warp_scanner.buildings.pairs import MISSING, BuildingPairConfig, make_building_pairs
from warp_scanner.clouds.points import points_of
from warp_scanner.rooms.pairs import Pairs
from warp_scanner.scenes.building_edits import without
from warp_scanner.sensors.poses import rotation_of
from warp_scanner.sensors.sensors import OAK_D_PRO_SMALL, Sensor, sensor_named

SEED = 3  # of the test rooms
CHANGES = (*SCENARIOS, *MISSING)
# Views of each change, which changes, and of what is timed the sensor, and whether it is with empty caches, too.
FULL = {"pairs": 10, "changes": CHANGES, "sensor": "oak-d-pro", "cold": True}
SMOKE = {
    "pairs": 1, "changes": ("pillar_added", "wall_removed", "wall_missing"), "sensor": "oak-d-pro-small", "cold": False,
}  # fmt: skip
SURE = (0.5, 0.75, 0.95, 0.99)  # from these probabilities of a type on, types are told together
HELD = 0.5  # share of the rays that show a missing element, that must end in boxes of its type


def main(asked: argparse.Namespace) -> None:
    paths, judges = ifc_files(asked.folder), read_judges(asked.model)
    asked.out.mkdir(parents=True, exist_ok=True)
    for path in paths:
        kept = _kept(asked.out, path.stem, asked.condition, asked.seed)
        if not _is_whole(kept):
            write_json(kept, _file(path, judges, asked))
        print(path.stem, flush=True)
    print(table(asked.out, asked.condition, asked.seed))


def _kept(out: Path, stem: str, condition: str, seed: int) -> Path:
    return out / f"{stem}_{condition}_{seed}.json"


def _is_whole(kept: Path) -> bool:
    """Whether a file is there, and of this table: earlier ones knew no probability of types."""
    return kept.exists() and all("types" in one or "refused" in one for one in load_json(kept)["views"])


def _file(path: Path, judges: Judges, asked: argparse.Namespace) -> dict[str, Any]:
    begun = time.perf_counter()
    prior = read_prior(path)
    told: dict[str, Any] = {"loading": time.perf_counter() - begun, "views": [], "without": []}
    for scenario in asked.changes:
        for number in range(asked.pairs):
            try:
                case = _case(prior, (scenario, asked.condition, asked.seed, number), OAK_D_PRO_SMALL)
            except (ValueError, RuntimeError) as error:
                told["without"].append(f"{scenario}: {error}")
                break
            told["views"].append(_view(prior, judges, scenario, *case))
    told["seconds"] = _timed(prior, path, judges, asked)
    return told


def _case(prior: Prior, which: tuple[str, str, int, int], sensor: Sensor) -> tuple[Pairs, PosedScan]:
    """A view of one change, by scenario, condition, seed and number, and its scan."""
    scenario, condition, seed, number = which
    config = BuildingPairConfig(seed=seed, scenario=scenario, condition=condition, sensor=sensor)
    pairs = make_building_pairs(prior.building, config, np.array([number]))
    back = np.isfinite(pairs.robot.distance[0])
    points = points_of(pairs.pose, pairs.directions, pairs.robot.distance)[0, back]
    turn = rotation_of(pairs.pose.yaw, pairs.pose.pitch)[0].astype(np.float64)
    return pairs, PosedScan(points, pairs.pose.position[0].astype(np.float64), turn, sensor)


def _view(prior: Prior, judges: Judges, scenario: str, pairs: Pairs, scan: PosedScan) -> dict[str, Any]:
    """What one view shows and what was found in it."""
    removed, missing = scenario.endswith("removed"), scenario in MISSING
    true, shown = true_boxes(pairs, 0, -1 if removed else 1)
    row = int(pairs.box.element[0, 0])
    guid = prior.building.elements.guid[row] if removed else None
    if missing:
        prior = prior_of_building(without(prior.building, np.array([row])))
    told = {"scenario": scenario, "shown": shown[0], "pose": [float(one) for one in scan.position]}
    there = true[0]._replace(center=true[0].center + prior.origin)
    told["alike"] = [] if removed else sorted(lookalikes(view_of(pairs), true[0], sections_of(prior.building)))
    try:
        settings = DetectSettings(propose_views=False)
        detection = detect_scans(prior, [NamedScan(scan, "scan", len(scan.points), "given")], judges, settings)
    except InputError as error:
        return told | {"refused": str(error)}
    own = [one for one in detection.mismatches if one.mismatch_type == ("removed" if removed else "added")]
    if removed:
        found = right = sum(one.element == guid for one in own)
    elif missing:
        found, right = _held([one for one in own if one.object_type == true[0].object_type], pairs, scan, prior.origin)
    else:
        found = right = len(match_boxes([box_of(one) for one in own], [there]))
    verdict = next((one.verdict for one in detection.elements if one.guid == guid), None)
    gone = [one.guid for one in detection.elements if one.verdict == REMOVED and one.guid != guid]
    return told | {
        "found": found, "false": len(detection.mismatches) - right, "verdict": verdict, "wrong_elements": gone,
        "types": [] if removed or missing else _types(own, there), "sentences": list(detection.sentences),
    }  # fmt: skip


def _types(found: list[Mismatch], true: Box) -> list[tuple[float, bool]]:
    """Of boxes that may touch the true one: how probable their type is called, and whether it is right."""

    def touches(one: Mismatch) -> bool:
        reach = (max(one.dimensions[:2]) + max(true.dimensions[:2])) / 2
        return bool(np.linalg.norm((one.center - true.center)[:2]) <= reach)

    return [(one.type_probability, one.object_type == true.object_type) for one in found if touches(one)]


def _held(found: list[Mismatch], pairs: Pairs, scan: PosedScan, origin: np.ndarray) -> tuple[int, int]:
    """Whether boxes hold enough of the rays that show what is missing, and how many boxes have their rays from it."""
    back = np.isfinite(pairs.robot.distance[0])
    new, shows = pairs.testable_robot[0, back], (pairs.changed_robot & pairs.testable_robot)[0, back]
    held, right = np.zeros(len(shows), bool), 0
    for one in found:
        here = inside(one, scan.points, origin)
        if 2 * (here & shows).sum() > (here & new).sum():
            held |= here & shows
            right += 1
    return int(held.sum() >= HELD * max(shows.sum(), 1)), right


def _timed(prior: Prior, path: Path, judges: Judges, asked: argparse.Namespace) -> dict[str, float]:
    """Seconds for a scan of 1280 x 800: warm from loaded arrays to the report's text, and of the command."""
    try:
        _, scan = _case(prior, ("wall_added", asked.condition, asked.seed, 0), sensor_named(asked.sensor))
    except (ValueError, RuntimeError):
        return {}
    seconds = {}
    one = NamedScan(scan, "scan", len(scan.points), "given")
    for name in ("first", "warm"):
        begun = time.perf_counter()
        try:
            json.dumps(to_json(detect_scans(prior, [one], judges, DetectSettings())))
        except InputError:
            return {}
        seconds[name] = time.perf_counter() - begun
    return seconds | _command(prior, path, scan, asked)


def _command(prior: Prior, path: Path, scan: PosedScan, asked: argparse.Namespace) -> dict[str, float]:
    """Seconds of the whole command, in processes of their own."""
    forward = scan.rotation[:, 0]
    angles = np.degrees([np.arctan2(forward[1], forward[0]), np.arcsin(forward[2])])
    pose = ",".join(f"{value:.9f}" for value in (*(scan.position + prior.origin), *angles))
    seconds = {}
    with TemporaryDirectory() as folder:
        points = Path(folder) / "scan.npy"
        np.save(points, scan.points + prior.origin)
        empty = ("JAX_COMPILATION_CACHE_DIR", "WARP_CACHE_PATH") if asked.cold else ()
        caches = {name: f"{folder}/{name}" for name in empty}
        for name in ("command, cold", "command") if asked.cold else ("command",):
            words = [path, points, f"--pose={pose}", "--sensor", asked.sensor, "--out", f"{folder}/{name}"]
            begun = time.perf_counter()
            done = subprocess.run(
                [sys.executable, "-m", "jaxmm", "detect", *map(str, words)], env=os.environ | caches,
                stdout=subprocess.DEVNULL,
            )  # fmt: skip
            if done.returncode == 2:  # whoever sees nothing but what is new has to say in which unit
                return {}
            done.check_returncode()
            seconds[name] = time.perf_counter() - begun
    return seconds


def table(out: Path, condition: str, seed: int) -> str:
    """All files, as Markdown: what was taken out or put in, and what the model lacks."""
    lines, files = [], {path.stem: load_json(path) for path in sorted(out.glob(_kept(out, "*", condition, seed).name))}
    for changes in (SCENARIOS, MISSING):
        timed = changes is SCENARIOS
        seconds = ("reading [s]", "detection warm [s]", "command, caches empty [s]", "command again [s]")
        names = ["file", "views", "refused", "shown well", "of those right", "without look-alikes", "of those right",
                 "shown less", "of those right", "false mismatches", *(seconds if timed else ())]  # fmt: skip
        lines += [f"| {' | '.join(names)} |", f"|{' --- |' * len(names)}"]
        for stem, told in files.items():
            cells = [stem.removesuffix(f"_{condition}_{seed}"), *_counts(told["views"], changes)]
            if timed:
                cells.append(f"{told['loading']:.1f}")
                for name, digits in (("warm", 2), ("command, cold", 1), ("command", 1)):
                    taken = told["seconds"].get(name)
                    cells.append("-" if taken is None else f"{taken:.{digits}f}")
            lines.append(f"| {' | '.join(str(cell) for cell in cells)} |")
        lines.append("")
    types = [one for told in files.values() for view in told["views"] for one in view.get("types", [])]
    return "\n".join([*lines, *_by_type(types)])


def _by_type(types: list[tuple[float, bool]]) -> list[str]:
    """How often types are right, by how probable they are called."""
    lines = ["| type called probable | boxes | on average | right |", "| --- | --- | --- | --- |"]
    for least, most in itertools.pairwise((*SURE, np.inf)):
        called = np.array([one for one in types if least <= one[0] < most], float).reshape(-1, 2)
        if len(called):
            lines.append(f"| from {least} on | {len(called)} | {called[:, 0].mean():.3f} | {called[:, 1].mean():.3f} |")
    return lines


def _counts(views: list[dict[str, Any]], changes: tuple[str, ...]) -> list[int]:
    """Counts of views, as the table has them; of changes that show well all, and those without a look-alike."""
    views = [one for one in views if one["scenario"] in changes]
    believed = [one for one in views if "refused" not in one]
    well = [one for one in believed if one["shown"] >= LEAST_SHOWN]
    less = [one for one in believed if one["shown"] < LEAST_SHOWN]
    counts = [len(views), len(views) - len(believed)]
    for those in (well, [one for one in well if not one["alike"]]):
        counts += [len(those), sum(one["found"] == 1 and one["false"] == 0 for one in those)]
    right = sum(one["false"] == 0 and one["verdict"] != PRESENT for one in less)
    return [*counts, len(less), right, sum(one["false"] for one in believed)]


if __name__ == "__main__":
    parser = CommandLine(__doc__, FULL, SMOKE)
    parser.add_input("folder")
    parser.add_out()
    parser.add_argument("--pairs", type=int, metavar="N", help="views of each change")
    parser.add_argument("--condition", choices=("clean", "occluded"), default="occluded")
    parser.add_argument("--seed", type=int, default=SEED, metavar="N")
    parser.add_argument("--model", type=Path, default=DEFAULT, metavar="RUN|FILE")
    asked = parser.parse_args()
    asked.folder = asked.folder or made_building(parser.scratch / "ifc")
    main(asked)
