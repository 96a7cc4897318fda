"""Small, low and crowded flats: are walls and columns told that the model lacks, and is nothing else called new?

    python -m benchmarks.flats [--flats 150] [--seed 42] [--judge FILE] [--json FILE]     ten minutes

Generated flats (`warp_scanner.rooms.flats`; seed 42 is of validation), scanned by a tilting laser whose file keeps
points at random, and by a camera and a spinning scanner. The model is the flat's own without one to three walls or
columns (`model`), the whole of it (`whole`), or drawn from the scan and without its two shortest walls (`drawn`, as
benchmarks.reality does it with real scans). Counted is what shows at least 300 points, and of drawn walls those that
are walls. It is *told* where a new object of its type has its centre in its box or 0.4 m beside it in plan; a new
object of which that is true of nothing is *false*. With --judge the same is asked of another judge of objects. Prints
Markdown.
"""

from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks.command_line import CommandLine
from benchmarks.timing import write_report
from benchmarks.views.drawn_models import FLAT, Block, drawn, left_out, table_of, with_openings
from jaxmm.inputs import InputError
from jaxmm.learning.boxes import Box
from jaxmm.learning.prediction import Judges, read_judges
from jaxmm.learning.upright_shapes import outside
from jaxmm.objects import finder
from jaxmm.objects.judge import ObjectJudge, load_judge
from jaxmm.rays.scan_rays import PosedScan
from jaxmm.runs.flat_scans import LEAST_DRAWN, FlatCase, flat_case
from jaxmm.verdicts.detection import detect_scans
from jaxmm.verdicts.named_scans import NamedScan
from jaxmm.verdicts.priors import Prior, prior_of_building
from jaxmm.verdicts.settings import DetectSettings
from jaxmm.weights import DEFAULT, OBJECTS
from warp_scanner.buildings.room_buildings import building_of_room
from warp_scanner.scenes.scenes import WALL

SEED = 42  # of validation
BESIDE = 0.4  # [m] of the box of what is told, in plan
FULL = {
    "sensors": ("tilting", "oak-d-pro-small", "ouster-64"),
    "models": ("model", "whole", "drawn"),
    "flats": 150,
}
SMOKE = {"sensors": ("tilting",), "models": ("drawn",), "flats": 2}


class Case(NamedTuple):
    """What is compared, and what is new."""

    prior: Prior
    scan: PosedScan
    new: list[Box]


def case_of(seed: int, number: int, sensor: str, model: str) -> Case | None:
    """One flat; None where nothing can be drawn."""
    made = flat_case(seed, number, sensor, 0 if model in ("whole", "drawn") else None)
    if model == "drawn":
        return _drawn(made)
    each = zip(made.lacking, made.seen, strict=True)
    new = [box if len(seen) >= LEAST_DRAWN else _hardly(box) for box, seen in each]
    return Case(made.prior, made.scan, new) if model == "whole" or any(box.probability for box in new) else None


def _hardly(box: Box) -> Box:
    """What hardly shows: told or not, it is not counted, and no false one either."""
    return box._replace(probability=0.0)


def _drawn(made: FlatCase) -> Case | None:
    scan, place = made.scan.points.astype(np.float64), made.scan.position
    try:
        blocks = drawn(scan, place, (0.0, made.flat.height))
    except ValueError:  # no upright face
        return None
    gone = left_out(blocks, scan)
    if not gone:
        return None
    parts = [
        (number, part)
        for number, block in enumerate(blocks)
        if not any(block is one for one in gone)
        for part in (with_openings(block, scan, place) if block.semantic == WALL else [block])
    ]
    numbers = np.array([number for number, _ in parts], np.int32)
    table = table_of([part for _, part in parts], numbers)
    return Case(prior_of_building(building_of_room(table, 0)[0]), made.scan, [_as_box(one, made) for one in gone])


def _as_box(block: Block, made: FlatCase) -> Box:
    """What is drawn as a wall may be the side of a cupboard: then it is not counted."""
    box = Box("wall", block.center, block.size, float(np.degrees(block.yaw)))
    on = _off(made.scan.points, box) <= FLAT
    is_wall = np.mean(made.flat.primitives.semantic[0, made.element[on]] == WALL) > 0.5
    return box if is_wall else _hardly(box)


def counts_of(case: Case, judges: Judges) -> Counter[str]:
    """What is told of one."""
    settings, named = DetectSettings(propose_views=False), NamedScan(case.scan, "scan", len(case.scan.points), "given")
    try:
        found = detect_scans(case.prior, [named], judges, settings)
    except InputError:
        return Counter(refused=1)
    new = [one for one in found.mismatches if one.mismatch_type == "added"]
    hits = [[_is_of(one.object_type, np.asarray(one.center), box) for box in case.new] for one in new]
    counted = [row for row, box in enumerate(case.new) if box.probability]
    return Counter(
        told=sum(any(hit[row] for hit in hits) for row in counted), new=len(counted),
        false=sum(not any(hit) for hit in hits),
        removed=sum(one.mismatch_type == "removed" for one in found.mismatches), flats=1,
    )  # fmt: skip


def _is_of(kind: str, centre: np.ndarray, box: Box) -> bool:
    return kind == box.object_type and bool(_off(centre[None], box)[0] <= BESIDE)


def _off(points: np.ndarray, box: Box) -> np.ndarray:
    """(n,) [m] that points (n, 3) are outside of a box, in plan."""
    turn = np.radians(box.rotation)
    along = np.array([np.cos(turn), np.sin(turn)])
    return outside(points[:, :2], np.asarray(box.center[:2]), np.asarray(box.dimensions[:2]), along)


def rows_of(asked: Any, judges: Judges, old: ObjectJudge | None) -> Iterator[dict[str, Any]]:
    """One of each sensor and model."""
    ours = load_judge(OBJECTS)
    for sensor in asked.sensors:
        for model in asked.models:
            sums = {"ours": Counter(), "peer": Counter()}
            for number in range(asked.flats):
                case = case_of(asked.seed, number, sensor, model)
                if case is None:
                    continue
                for name, judge in (("ours", ours), ("peer", old)):
                    if judge is not None:
                        finder.default_judge = lambda judge=judge: judge
                        sums[name] += counts_of(case, judges)
            yield {"case": f"{sensor}, {model}", **{name: dict(one) for name, one in sums.items()}}


def main() -> None:
    parser = CommandLine(__doc__, FULL, SMOKE)
    parser.add_argument("--flats", type=int, metavar="N")
    parser.add_argument("--seed", type=int, default=SEED, metavar="N")
    parser.add_argument("--judge", type=Path, metavar="FILE", help="another judge of objects, asked the same")
    parser.add_json()
    asked = parser.parse_args()
    old = None if asked.judge is None else load_judge(asked.judge)
    judges, rows = read_judges(DEFAULT), []
    columns = ("scanner, model", "flats", "refused", "told", "false new", "false removed")
    print(f"| {' | '.join(columns)} |\n|{' --- |' * len(columns)}")
    for row in rows_of(asked, judges, old):
        one, other = row["ours"], row["peer"]
        told = {
            key: ", ".join(str(each.get(key, 0)) for each in ((one, other) if old else (one,)))
            for key in ("told", "false", "removed", "refused")
        }
        print(
            f"| {row['case']} | {one.get('flats', 0)} | {told['refused']} | {told['told']} of {one.get('new', 0)} | "
            f"{told['false']} | {told['removed']} |",
            flush=True,
        )
        rows.append(row | {"unit": "counts", "peer_name": "another judge of objects"})
    if asked.json:
        write_report(asked.json, rows)


if __name__ == "__main__":
    main()
