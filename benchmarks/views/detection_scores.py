"""What `detect` found in one room against what is true there.

An object that shows less than `LEAST_SHOWN` need not be found, and what is found where it stands is neither right nor
wrong: it is `hidden`, and precision can be told without it.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import linear_sum_assignment

from jaxmm.learning.box_match import Match, clip, footprint, match_boxes, polygon_area
from jaxmm.learning.boxes import Box
from jaxmm.runs.room_scans import RoomCase, true_boxes
from jaxmm.verdicts.results import Mismatch, box_of
from warp_scanner.rooms.pairs import Pairs
from warp_scanner.sensors.poses import rotation_of

LEAST_SHOWN = 0.2  # observable fraction from which an object is to be found
LEAST_INSIDE = 0.5  # share of a box's footprint inside an object, from which it stands there
COUNTS = ("found", "right", "hidden", "wanted", "reached")


class Scored(NamedTuple):
    """Found boxes against true ones, of one change."""

    matches: list[Match]  # those that stand for each other
    hidden: set[int]  # found boxes, right or wrong, where an object stands that shows too little to be asked for
    wanted: set[int]  # true boxes that show enough
    reached: set[int]  # true boxes that were found

    @property
    def right(self) -> set[int]:
        """Found boxes that stand for a true one."""
        return {match.found for match in self.matches}


def objects_of(found: Sequence[Mismatch], case: RoomCase) -> dict[str, Any]:
    """Counts of found and true objects, and each of them: a record that goes to JSON.

    `found` boxes, of which `right` stand for a true one, `hidden` as in `Scored`; `wanted` true ones, of which
    `reached` were found; `off`: type, change, and how far off centres are [m]; `boxes` found and `objects` true.
    """
    pairs, row = case.pairs, case.row
    told: dict[str, Any] = dict.fromkeys(COUNTS, 0) | {"off": [], "objects": [], "boxes": []}
    for change, sign in (("added", 1), ("removed", -1)):
        true, shown = true_boxes(pairs, row, sign)
        boxes = [box_of(one) for one in found if one.mismatch_type == change]
        scored = score(boxes, true, shown)
        counted = boxes, scored.right, scored.hidden, scored.wanted, scored.reached & scored.wanted
        for name, those in zip(COUNTS, counted, strict=True):
            told[name] += len(those)
        told["boxes"] += [
            _as_found(box) | {"change": change, "right": number in scored.right, "hidden": number in scored.hidden}
            for number, box in enumerate(boxes)
        ]
        sensor = pairs.pose.position[row]
        told["objects"] += [
            _as_seen(box, share, sensor)
            | {"change": change, "found": number in scored.reached, "top": _top(pairs, row, box) if sign > 0 else None}
            for number, (box, share) in enumerate(zip(true, shown, strict=True))
        ]
        for match in scored.matches:
            off = _off(boxes[match.found], true[match.truth])
            told["off"].append([true[match.truth].object_type, change, *off])
    return told


def score(boxes: list[Box], true: list[Box], shown: list[float]) -> Scored:
    """Compare found boxes with true ones of the same change, of which so much is `shown`, each in [0, 1]."""
    matches = match_boxes(boxes, true)
    truth_of = {match.found: match.truth for match in matches}
    wanted = {number for number, share in enumerate(shown) if share >= LEAST_SHOWN}
    reached = set(truth_of.values())
    wrong = [number for number in range(len(boxes)) if number not in truth_of]
    unmet = [box for number, box in enumerate(true) if number not in wanted | reached]
    hidden = {number for number, truth in truth_of.items() if truth not in wanted}
    hidden |= {wrong[number] for number in standing_at([boxes[number] for number in wrong], unmet)}
    return Scored(matches, hidden, wanted, reached)


def standing_at(boxes: list[Box], objects: list[Box]) -> list[int]:
    """Which boxes stand where an object is, one to one, whatever their type.

    A box stands there as boxes match (`match_boxes`), or with at least `LEAST_INSIDE` of its footprint inside, as what
    one sees of a long wall does. Ascending indices into `boxes`.
    """
    if not boxes or not objects:
        return []
    there = np.array([[_stands(box, one) for one in objects] for box in boxes])
    rows, columns = linear_sum_assignment(there, maximize=True)
    return [int(row) for row, column in zip(rows, columns, strict=True) if there[row, column]]


def _stands(box: Box, one: Box) -> bool:
    if match_boxes([box._replace(object_type=one.object_type)], [one]):
        return True
    origin = np.asarray(one.center[:2], np.float64)
    inside = polygon_area(clip(footprint(box, origin), footprint(one, origin)))
    return bool(inside >= LEAST_INSIDE * box.dimensions[0] * box.dimensions[1])


def _as_found(box: Box) -> dict[str, Any]:
    """A found box, to look at later [m], [degrees]."""
    return {
        "type": box.object_type, "center": np.round(box.center, 3).tolist(),
        "dimensions": np.round(box.dimensions, 3).tolist(), "rotation": round(float(box.rotation), 2),
        "probability": round(float(box.probability), 4),
    }  # fmt: skip


def _as_seen(box: Box, shown: float, sensor: np.ndarray) -> dict[str, Any]:
    """What makes a true object hard to see: its size, how far and how slantwise it stands, and what hides it."""
    toward = np.asarray(box.center[:2], np.float64) - sensor[:2]
    reach = float(np.linalg.norm(toward))
    turn = np.radians(box.rotation) + (np.pi / 2 if box.dimensions[0] >= box.dimensions[1] else 0.0)
    facing = abs(float(toward @ [np.cos(turn), np.sin(turn)])) / max(reach, 1e-6)
    return {
        "type": box.object_type, "shown": round(shown, 4), "range": round(reach, 3),
        "size": round(float(max(box.dimensions[:2])), 3),
        "incidence": round(float(np.degrees(np.arccos(min(facing, 1.0)))), 1),
    }  # fmt: skip


def _top(pairs: Pairs, row: int, box: Box) -> float | None:
    """How high above the floor [m] the robot sees an added object; None where it does not."""
    nearest = np.argmin(np.linalg.norm(pairs.box.center[row] - box.center, axis=1))
    on_it = pairs.robot.element[row] == pairs.box.element[row, nearest]
    if not on_it.any():
        return None
    pose = pairs.true_pose
    turned = rotation_of(pose.yaw[row : row + 1], pose.pitch[row : row + 1])[0]
    z = pose.position[row, 2] + pairs.robot.distance[row, on_it] * (pairs.directions[on_it] @ turned.T)[:, 2]
    return round(float(z.max() + pairs.size[row, 2] / 2), 3)


def _off(found: Box, true: Box) -> tuple[float, float]:
    """How far a centre is off [m]: in plan, and across the longer horizontal edge of the true box."""
    offset = (np.asarray(found.center) - true.center)[:2]
    turn = np.radians(true.rotation) + (np.pi / 2 if true.dimensions[0] >= true.dimensions[1] else 0.0)
    return float(np.linalg.norm(offset)), abs(float(offset @ [np.cos(turn), np.sin(turn)]))


def share_of(part: int, whole: int) -> str:
    """A share with its counts, as tables have it; "-" of nothing."""
    return f"{part / whole:.3f} ({part}/{whole})" if whole else "-"
