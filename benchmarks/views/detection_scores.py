"""What `detect` found in one room against what is true there."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from jaxmm.learning.boxes import Box
from jaxmm.learning.object_scores import score
from jaxmm.runs.room_scans import RoomCase, true_boxes
from jaxmm.verdicts.results import Mismatch, box_of
from warp_scanner.rooms.pairs import Pairs
from warp_scanner.sensors.poses import rotation_of

COUNTS = ("found", "right", "hidden", "wanted", "reached")


def objects_of(found: Sequence[Mismatch], case: RoomCase) -> dict[str, Any]:
    """Counts of found and true objects, and each of them: a record that goes to JSON.

    `found` boxes, of which `right` stand for a true one, `hidden` as in `object_scores.Scored`; `wanted` true ones, of
    which `reached` were found; `off`: type, change, and how far off centres are [m]; `boxes` found and `objects` true.
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
