"""How far off their places elements stand: errors, intervals, and what is called removed or new because of it.

    python -m benchmarks.deviations [--ifc FOLDER] [--rooms 20] [--places 2] [--seed 42] [--sensors NAME ...]
        [--kept JSONL] [--figure PNG]

Generated rooms (`varied`; seed 42 is of validation) and, with --ifc, places in IFC files. One to three walls or columns
stand 5 to 300 mm off their places, or are turned by 0.2 to 3 degrees about their middle, or lean as much. Each sensor
meets each place once, in a way that is drawn, each as often as any other: clean, or with boxes as furniture before the
walls, and the pose exact, or off by up to 5 cm and 1 degree; one time of nine with furniture, a pose that is off, and
three scans from different places that are told together. Sensors err as built. Of elements that 500 rays or more end
on. *held* is the share of intervals that hold the truth, of what moved and of what did not. The peers, from the true
pose, on the same points: the median of signed distances to the nearest surface of the model (cloud to mesh), of the
points whose nearest surface is the element's, and M3C2 (Lague et al. 2013, by py4dgeo) at points of the element's own
faces; both are of points within 0.4 m, and of one scan. Of the camera, elements whose middle is within 4 m count.
Prints Markdown: the views, shares with intervals of 95 % (Wilson), and from which offset on an element is told from one
in its place, by sensor and range, and by how much of it was seen; --figure draws that. With --kept, what was told of
each view stays in that file, a line each, and is not told again: a long run may be ended and gone on with.
"""

import argparse
import math
import sys
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks import peers
from benchmarks.command_line import CommandLine
from benchmarks.timing import write_report
from benchmarks.views.building_views import building_places, scanned
from benchmarks.views.furniture import furniture_before_walls
from benchmarks.views.kept_views import KeptViews
from benchmarks.views.place_rivals import told_by_rivals
from benchmarks.views.told_offsets import draw_told, share_with_interval, told_table
from benchmarks.views.wrong_poses import disturbed
from jaxmm.inputs import InputError
from jaxmm.learning.prediction import Judges, read_judges
from jaxmm.rays.scan_rays import PosedScan
from jaxmm.runs.room_scans import room_cases
from jaxmm.verdicts.detection import detect_scans
from jaxmm.verdicts.named_scans import NamedScan
from jaxmm.verdicts.priors import Prior
from jaxmm.verdicts.settings import DetectSettings
from jaxmm.verdicts.verdicts import DISPLACED, OCCLUDED, REMOVED, UNSCANNED, VerdictSettings
from jaxmm.weights import DEFAULT
from warp_scanner import draws
from warp_scanner.buildings.changes import of_element
from warp_scanner.buildings.positions import draw_positions
from warp_scanner.rooms.standing import Standing
from warp_scanner.scenes.building import element_bounds
from warp_scanner.scenes.building_edits import join, move_element
from warp_scanner.scenes.scenes import PILLAR, WALL
from warp_scanner.sensors.poses import Pose
from warp_scanner.sensors.sense import rays_of
from warp_scanner.sensors.sensors import sensor_named
from warp_scanner.sensors.triangles import cast_triangles, prepare

SEED = 42  # of validation
FULL = {"sensors": ("tls-real", "ouster-64-real", "velodyne-16-real", "oak-d-pro-real"), "rooms": 20, "places": 2}
SMOKE = {"sensors": ("ouster-64-real",), "rooms": 2, "places": 1}
LEAST_RAYS = 500  # that end on an element, to be counted
LEAST_SHOWN = VerdictSettings().least_rays  # noise-free rays that end on an element, or furniture hides it
LEAST_SEEN = 0.002  # share of the rays that would meet an element, for it to be moved
SHIFT, TURN = (0.005, 0.3), (0.2, 3.0)  # [m], [deg]
SCANS = 3  # that are told together
NEAR = 0.2  # [m] about a box in plan, within which something new is that box
NOT_THERE = REMOVED, OCCLUDED, UNSCANNED
AT_ONCE = 8  # rooms that are made together: of all at once a scanner's rays fill the memory
MOST_RANGE = {sensor_named("oak-d-pro-real"): 4.0}  # [m]
COLUMNS = (
    "view", "views", "refused", "doubted", "moved", "measured", "median error [mm]", "of what stands still [mm]",
    "held", "median half interval [mm]", "C2M [mm]", "M3C2 [mm]", "moved, told removed or hidden",
    f"of those that {LEAST_SHOWN} rays meet",
    "still, told displaced", "false new", "of these furniture", "false removed",
)  # fmt: skip


SHARES = ("held", "gone", "gone though shown", "falsely displaced")


class Kind(NamedTuple):
    """A kind of view."""

    name: str
    furnished: bool
    scans: int
    most: tuple[float, float, float]  # that the pose is off: [m], and [deg] about the vertical and about the others


EXACT, OFF = (0.0, 0.0, 0.0), (0.05, 1.0, 0.5)
KINDS = (
    Kind("clean, pose exact", False, 1, EXACT),
    Kind("clean, pose off by up to 5 cm, 1°", False, 1, OFF),
    Kind("furniture, pose exact", True, 1, EXACT),
    Kind("furniture, pose off by up to 5 cm, 1°", True, 1, OFF),
    Kind(f"furniture, {SCANS} scans, pose off by up to 5 cm, 1°", True, SCANS, OFF),
)
TURNS = (*KINDS[:4], *KINDS)  # several scans take as many times as long


class Case(NamedTuple):
    """A view of a model of which something stands off its place."""

    prior: Prior
    scans: list[PosedScan]
    moved: dict[int, np.ndarray]  # row -> (3,) [m] by which the middle of the element was moved
    turned: set[int]  # rows that were turned, or lean
    shows: dict[int, int]  # row -> noise-free rays of all scans that end on what was moved, where it stands
    boxes: np.ndarray  # (2, F, 3) [m] lower and upper corners of furniture
    rivals: dict[str, dict[int, float]]  # by peer: row -> [m] off its place; of several scans no peer tells


def drawn(seed: int, sensor: str, number: int) -> Kind:
    """In which way a sensor meets a place: of as many places as there are TURNS each comes once, in a drawn order."""
    block, place = divmod(number, len(TURNS))
    return TURNS[np.random.default_rng((seed, zlib.crc32(sensor.encode()), block)).permutation(len(TURNS))[place]]


def case_of(prior: Prior, sensor: str, pose: Pose, kind: Kind, key: tuple[int, int]) -> Case | None:
    """One view; None where the first of its scans shows no wall or column."""
    rng = np.random.default_rng(key)
    rays = rays_of(sensor_named(sensor), pose)
    meets = cast_triangles(prior.scene, rays).element[0]
    seen = np.bincount(meets[meets >= 0], minlength=len(prior.building.elements.guid)) >= LEAST_SEEN * len(meets)
    seen &= np.isin(prior.building.triangles.semantic, (WALL, PILLAR))
    if not seen.any():
        return None
    chosen = rng.permutation(np.flatnonzero(seen))[: rng.integers(1, 4)]
    triangles, steps, turned = prior.building.triangles, {}, set()
    for row in chosen:
        step, turn = _motion(prior, int(row), rng)
        steps[int(row)] = step
        if np.any(turn):
            turned.add(int(row))
        triangles = move_element(triangles, int(row), step, turn)
    furniture = furniture_before_walls(prior.scene, rays, rng) if kind.furnished else None
    if furniture is not None:
        triangles = join(triangles, furniture)
    boxes = np.zeros((2, 0, 3)) if furniture is None else np.stack(element_bounds(furniture))
    scene, stands = prepare(triangles), np.ones(len(triangles.semantic), bool)
    poses = [pose, *_other_places(prior, key)][: kind.scans]
    scans = [scanned(scene, stands, (sensor_named(sensor), one), (key[0], key[1] + 1000 * number))[0]
             for number, one in enumerate(poses)]  # fmt: skip
    ends = [cast_triangles(scene, rays_of(sensor_named(sensor), one)).element[0] for one in poses]
    shows = {row: sum(int(np.sum(one == row)) for one in ends) for row in steps}
    rivals = told_by_rivals(prior.scene, scans[0]) if kind.scans == 1 else {}
    return Case(prior, scans, steps, turned, shows, boxes, rivals)


def _other_places(prior: Prior, key: tuple[int, int]) -> list[Pose]:
    """Poses (R = 1 each) inside of the building."""
    keys = draws.keys(key[0] + key[1], np.arange(8 * SCANS))
    pose, found = draw_positions(prior.building, prior.scene, Standing(height=(1.0, 1.8)), keys)
    return [Pose(*(field[place : place + 1] for field in pose)) for place in np.flatnonzero(found)]


def _motion(prior: Prior, row: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Shift (3,) [m] and rotation vector (3,) [rad] of an element: a wall moves across itself."""
    one = of_element(prior.building, row)
    along = np.array([np.cos(np.radians(one.yaw)), np.sin(np.radians(one.yaw)), 0.0])
    across = np.array([-along[1], along[0], 0.0]) if one.size[0] >= one.size[1] else along
    if one.semantic == PILLAR:
        turn = rng.uniform(0.0, 2.0 * np.pi)
        across = np.array([np.cos(turn), np.sin(turn), 0.0])
    kind = rng.random()
    if kind < 0.6:
        size = np.exp(rng.uniform(*np.log(SHIFT)))
        return across * size * rng.choice((-1.0, 1.0)), np.zeros(3)
    angle = np.radians(np.exp(rng.uniform(*np.log(TURN)))) * rng.choice((-1.0, 1.0))
    way = np.array([0.0, 0.0, 1.0]) if kind < 0.8 else np.cross([0.0, 0.0, 1.0], across)
    return np.zeros(3), way * angle


def places_of(asked: argparse.Namespace, sensor: str, kept: KeptViews) -> Iterator[tuple[str, int, Prior, Pose]]:
    """Where a sensor stands in rooms and in IFC files, and the number of each; without those that were told."""
    for first in range(0, asked.rooms, AT_ONCE):
        numbers = range(first, min(first + AT_ONCE, asked.rooms))
        if all(kept.has(("rooms", sensor, asked.seed, number)) for number in numbers):
            continue
        for one in room_cases("unchanged", "clean", asked.seed, numbers, sensor=sensor):
            number = numbers[one.row]
            if not kept.has(("rooms", sensor, asked.seed, number)):
                yield "rooms", number, one.prior, Pose(*(field[one.row : one.row + 1] for field in one.pairs.pose))
    places = building_places(asked.ifc, asked.places, asked.seed) if asked.ifc else ()
    for number, (prior, pose, _) in enumerate(places):
        if not kept.has(("IFC files", sensor, asked.seed, number)):
            yield "IFC files", number, prior, pose


def told_of(case: Case, judges: Judges, most: tuple[float, float, float], rng: np.random.Generator) -> dict[str, Any]:
    """What detection says of a case, and what the peers do."""
    scans = [NamedScan(disturbed(one, most, rng), "scan", len(one.points), "given") for one in case.scans]
    try:
        found = detect_scans(case.prior, scans, judges, DetectSettings(propose_views=False))
    except InputError:
        return {"refused": 1}
    told: dict[str, Any] = {"doubted": int(bool(found.doubts)), "new": 0, "gone": 0, "elements": []}
    told["sentences"] = [*found.sentences, *found.doubts]
    new = [one.center - case.prior.origin for one in found.mismatches if one.mismatch_type == "added"]
    told["new"], told["new boxes"] = len(new), sum(_is_box(case, one) for one in new)
    farthest = MOST_RANGE.get(case.scans[0].sensor, np.inf)
    rows = {guid: row for row, guid in enumerate(case.prior.building.elements.guid)}
    for one in found.elements:
        row = rows[one.guid]
        moved, deviation = row in case.moved, one.deviation
        told["gone"] += one.verdict == REMOVED
        if not moved and deviation is None:
            continue
        new: dict[str, Any] = {"row": row, "moved": moved, "verdict": one.verdict, "turned": row in case.turned}
        if moved:
            new |= {"by": float(np.linalg.norm(case.moved[row])), "shows": case.shows[row]}
        if deviation is not None and deviation.rays >= LEAST_RAYS and _range(case, row) <= farthest:
            way = np.array(deviation.direction)
            true = float(case.moved.get(row, np.zeros(3)) @ way)
            new |= {"true": true, "off": deviation.distance - true, "half": deviation.half}
            new |= {"range": _range(case, row), "coverage": deviation.coverage}
            new |= {name: scores[row] - true for name, scores in case.rivals.items() if row in scores}
        told["elements"].append(new)
    return told


def _is_box(case: Case, place: np.ndarray) -> bool:
    """Whether what is told to be new at a place (3,) [m] is furniture."""
    low, high = case.boxes[..., :2]
    return bool(np.any(np.all((place[:2] > low - NEAR) & (place[:2] < high + NEAR), axis=1)))


def _range(case: Case, row: int) -> float:
    """[m] from the nearest scanner to the middle of an element."""
    middle = of_element(case.prior.building, row).center
    return float(min(np.linalg.norm(middle - one.position) for one in case.scans))


def row_of(case: str, told: list[dict[str, Any]]) -> dict[str, Any]:
    """The figures of all views of one kind."""
    views = [one for one in told if "elements" in one]
    elements = [each for one in views for each in one["elements"]]
    moved = [each for each in elements if each["moved"]]
    known = [each for each in moved if "off" in each]
    still = [each for each in elements if not each["moved"] and "off" in each]
    everywhere = known + still

    def middle(name: str, chosen: list[dict[str, Any]]) -> float:
        values = [abs(each[name]) for each in chosen if name in each]
        return float(np.median(values)) if values else float("nan")

    return {
        "case": case, "views": len(told), "refused": len(told) - len(views),
        "doubted": sum(one["doubted"] for one in views),
        "moved": len(moved), "measured": len(known), "ours": middle("off", known), "still": middle("off", still),
        "held": _counts([abs(each["off"]) <= each["half"] for each in everywhere]),
        "half": float(np.median([each["half"] for each in everywhere])) if everywhere else float("nan"),
        "C2M": middle("C2M", known), "M3C2": middle("M3C2", known),
        "gone": _counts([each["verdict"] in NOT_THERE for each in moved]),
        "gone though shown": _counts([one["verdict"] in NOT_THERE for one in moved if one["shows"] >= LEAST_SHOWN]),
        "falsely displaced": _counts([each["verdict"] == DISPLACED for each in still]),
        "new": sum(one["new"] for one in views), "boxes": sum(one["new boxes"] for one in views),
        "removed": sum(one["gone"] for one in views),
    }  # fmt: skip


def _counts(flags: list[bool]) -> tuple[int, int]:
    """How many are, and of how many."""
    return int(np.sum(flags)), len(flags)


def main() -> None:
    parser = CommandLine(__doc__, FULL, SMOKE)
    parser.add_places(SEED)
    parser.add_argument("--places", type=int, metavar="N", help="of each IFC file")
    parser.add_argument("--sensors", nargs="+", metavar="NAME", help="of which presets")
    parser.add_argument("--kept", type=Path, metavar="JSONL", help="keep what was told of each view here, and go on")
    parser.add_argument("--figure", type=Path, metavar="PNG", help="also draw what offsets are told")
    asked = parser.parse_args()
    if why := peers.why_missing("py4dgeo"):
        print(why, file=sys.stderr)
    judges, kept = read_judges(DEFAULT), KeptViews(asked.kept)
    for sensor in asked.sensors:
        for where, number, prior, pose in places_of(asked, sensor, kept):
            kind = drawn(asked.seed, sensor, number)
            case = case_of(prior, sensor, pose, kind, (asked.seed, number))
            rng = np.random.default_rng((asked.seed, number))
            told = {"nothing to see": True} if case is None else told_of(case, judges, kind.most, rng)
            kept.add((where, sensor, asked.seed, number), {"kind": kind.name} | told)
    print(f"| {' | '.join(COLUMNS)} |\n|{' --- |' * len(COLUMNS)}")
    rows = [row_of(name, told) for name, told in _by_kind(kept, asked).items()]
    print("\n".join(map(_line, rows)))
    by_sensor: dict[str, list[dict[str, Any]]] = {}
    for (_, sensor, *_), told in kept.items():
        by_sensor.setdefault(sensor, []).extend(each for each in told.get("elements", ()) if "half" in each)
    print("\n".join(["", *told_table(by_sensor)]))
    if asked.figure:
        draw_told(by_sensor, asked.figure)
    if asked.json:
        write_report(asked.json, [_told_row(row) for row in rows if row["measured"] and math.isfinite(row["C2M"])])


def _by_kind(kept: KeptViews, asked: argparse.Namespace) -> dict[str, list[dict[str, Any]]]:
    """What was told, by where, sensor and kind of view, in that order, and of all kinds."""
    order = {
        f"{where}, `{sensor}`, {kind}": [] for where in ("rooms", "IFC files") for sensor in asked.sensors
        for kind in (*(one.name for one in KINDS), "all kinds")
    }  # fmt: skip
    for (where, sensor, *_), told in kept.items():
        for name in (f"{where}, `{sensor}`, {kind}" for kind in (told["kind"], "all kinds")):
            if name in order and "nothing to see" not in told:
                order[name].append(told)
    return {name: told for name, told in order.items() if told}


def _told_row(row: dict[str, Any]) -> dict[str, Any]:
    """What is known of it, beside the peer."""
    least = 1e-4  # [m] of either, so that the ratio is finite
    known = {name: value for name, value in row.items() if not isinstance(value, float) or math.isfinite(value)}
    for name in SHARES:
        some, every = known.pop(name)
        known |= {name: some / every, f"of {name}": every} if every else {}
    ratio = (row["C2M"] + least) / (row["ours"] + least)
    return known | {"peer": row["C2M"], "peer_name": "cloud to mesh", "unit": "m", "ratio": ratio}


def _line(row: dict[str, Any]) -> str:
    def text(value: float, digits: int) -> str:
        return f"{value:.{digits}f}" if math.isfinite(value) else "-"

    mm = {name: text(1000.0 * row[name], 1) for name in ("ours", "still", "half", "C2M", "M3C2")}
    shares = {name: share_with_interval(*row[name]) for name in SHARES}
    names = (
        "case", "views", "refused", "doubted", "moved", "measured", "ours", "still", "held", "half", "C2M", "M3C2",
        "gone", "gone though shown", "falsely displaced", "new", "boxes", "removed",
    )  # fmt: skip
    return "| " + " | ".join(str((row | mm | shares)[name]) for name in names) + " |"


if __name__ == "__main__":
    main()
