"""What of a detection is about one file of a model that is in several.

World frame: that of the detection; a file's own may be another. Metres, z up.
"""

import math
from typing import NamedTuple

import numpy as np

from jaxmm.deviations.deviation import Deviation
from jaxmm.verdicts.results import Detection, Drawing, ElementVerdict, Mismatch, ScanRecord
from warp_scanner.scenes.building import Source

ELSEWHERE = "elsewhere"  # type of a mismatch that is of another file: they all keep their numbers
STILL = np.eye(4)


class Share(NamedTuple):
    """The part of a detection that one file is to be edited by; the fields are those of a Detection."""

    mismatches: tuple[Mismatch, ...]  # all, in their order; those of other files are ELSEWHERE
    elements: tuple[ElementVerdict, ...]  # of the file
    scans: tuple[ScanRecord, ...]
    doubts: tuple[str, ...]
    drawing: Drawing  # as the detection has it, in the world
    date: str | None  # of the scans


def share_of(detection: Detection, source: Source, added: dict[int, str]) -> Share:
    """What is about one file, in the world frame.

    Args:
        detection: the whole.
        source: the file.
        added: by number of an added mismatch: the file that gets it.
    """
    own = {one.key: one for one in detection.elements if one.file == source.file}
    twins = {key: one for one in own.values() for key in one.same_as}
    mismatches = []
    for number, one in enumerate(detection.mismatches):
        found = [own.get(key) or twins.get(key) for key in (one.key, *one.pieces)]
        here = [each for each in found if each is not None]
        if one.mismatch_type == "added" and added.get(number) != source.file:
            one = one._replace(mismatch_type=ELSEWHERE)
        elif one.mismatch_type == "removed":
            other = one._replace(mismatch_type=ELSEWHERE)
            pieces = tuple(each.key for each in here[1:])
            one = one._replace(element=here[0].guid, file=here[0].file, pieces=pieces) if here else other
        mismatches.append(one)
    told = detection.scans, detection.doubts, detection.drawing, detection.date
    return Share(tuple(mismatches), tuple(own.values()), *told)


def in_own_frame(share: Share, to_world: np.ndarray) -> Share:
    """The same, with places and offsets in the file's own frame; `to_world` (4, 4) leads from there."""
    if np.array_equal(to_world, STILL):
        return share
    back = np.linalg.inv(to_world)
    turn = back[:3, :3] / np.cbrt(np.linalg.det(back[:3, :3]))
    yaw = math.degrees(math.atan2(turn[1, 0], turn[0, 0]))
    mismatches = tuple(
        one._replace(
            center=np.linalg.solve(to_world[:3, :3], np.asarray(one.center) - to_world[:3, 3]),
            rotation=one.rotation + yaw,
        )
        for one in share.mismatches
    )
    elements = tuple(
        one if one.deviation is None else one._replace(deviation=_turned(one.deviation, turn)) for one in share.elements
    )
    return share._replace(mismatches=mismatches, elements=elements)


def _turned(one: Deviation, turn: np.ndarray) -> Deviation:
    """A deviation along other axes; its intervals are no smaller than the true ones."""
    weight = np.abs(turn)
    half = np.array([np.nan if span is None else (span[1] - span[0]) / 2.0 for span in one.interval])
    offset = turn @ np.asarray(one.offset)
    interval = []
    for axis in range(3):
        needed = weight[axis] > 1e-6
        reach = float(weight[axis][needed] @ half[needed])
        interval.append(None if math.isnan(reach) else (float(offset[axis]) - reach, float(offset[axis]) + reach))
    moved = {name: tuple((turn @ np.asarray(getattr(one, name))).tolist()) for name in ("direction", "turned", "step")}
    return one._replace(offset=tuple(offset.tolist()), interval=tuple(interval), **moved)


def files_of_added(detection: Detection, names: list[str]) -> dict[int, str]:
    """Which of some files gets each added object, by its number.

    Where it seems to have been moved, that of the removed one; else that of the nearest element of its kind, or of any.
    """
    boxes = _boxes(detection.drawing)
    rows = detection.drawing.rows()
    known = [(one, boxes[rows[one.key]]) for one in detection.elements if one.file in names and one.key in rows]
    found = {}
    for number, one in enumerate(detection.mismatches):
        if one.mismatch_type != "added":
            continue
        origin = None if one.moved_from is None else detection.mismatches[one.moved_from].file
        found[number] = origin if origin in names else _nearest(one, known, detection.drawing, names)
    return found


def _nearest(one: Mismatch, known: list, drawing: Drawing, names: list[str]) -> str:
    kind = "Column" if one.object_type == "pillar" else "Wall"
    center = np.asarray(one.center, np.float64) - drawing.origin

    def away(element: ElementVerdict, box: np.ndarray) -> tuple:
        off = np.maximum(np.maximum(box[0] - center, center - box[1]), 0.0)
        return kind not in element.ifc_class, round(float(np.linalg.norm(off)), 3), element.file, element.guid

    ranked = [(away(*each), each[0].file) for each in known]
    return min(ranked)[1] if ranked else min(names)


def _boxes(drawing: Drawing) -> np.ndarray:
    """(E, 2, 3) [m] least and greatest corners of every element, as offsets; inf and -inf of one without surface."""
    boxes = np.tile(np.array([[np.inf], [-np.inf]]), (len(drawing.guid), 1, 3))
    if drawing.faces is not None:
        corners = drawing.vertices[drawing.faces].astype(np.float64)
        np.minimum.at(boxes[:, 0], drawing.face_element, corners.min(axis=1))
        np.maximum.at(boxes[:, 1], drawing.face_element, corners.max(axis=1))
    return boxes
