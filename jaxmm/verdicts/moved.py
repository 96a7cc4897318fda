"""What moved: which new objects may be what is gone, off its place, and which are held for the same.

Mismatches are in one frame: metres, z up.
"""

import math

import numpy as np

from jaxmm.learning.box_match import MIN_OVERLAP, box_overlap, match_boxes
from jaxmm.learning.boxes import long_axis
from jaxmm.objects.finder import ObjectSettings
from jaxmm.verdicts.mismatch_points import inside
from jaxmm.verdicts.results import Mismatch, box_of

OFF_PLACE, MOST_TURNED = 1.2, 0.1  # [m] and sine of a wall's angle, by which things may be built off their place
STRAIGHT, BENT = 1.0, 5.0  # [m] least edge of a wall's box, between which it is bent; beyond, it goes around rooms
FURNITURE = ObjectSettings().furniture_height  # [m]
SAME_SIZE = (0.1, 0.15)  # [m], share: sides of an object that moved differ by no more than the greater of both
AS_FAR = 20.0  # metres that an object moved count as much as one by which its sides differ: rows of columns are alike


def with_more(found: list[Mismatch], more: list[Mismatch]) -> list[Mismatch]:
    """What was found and more, which takes the place of what it was held for when less of it seemed to be new.

    Of what is told of one object in two places, the first counts.
    """
    kept = [one for one in found if not any(_is_part_of(one, whole) for whole in more)]
    boxes = [box_of(one) for one in kept]

    def is_told(one: Mismatch) -> bool:
        return bool(match_boxes([box_of(one)], boxes)) and not any(_is_part_of(part, one) for part in found)

    return [*kept, *(one for one in more if not is_told(one))]


def _is_part_of(part: Mismatch, whole: Mismatch) -> bool:
    if part.object_type != whole.object_type:
        return False
    overlap = box_overlap(box_of(part), box_of(whole))
    return overlap >= MIN_OVERLAP or bool(inside(whole, part.center[None], np.zeros(3))[0])


def is_off_its_place(new: Mismatch, gone: Mismatch) -> bool:
    """Whether something new may be what is gone: a wall along it and beside it, or a column of its size near by."""
    if new.object_type != gone.object_type or new.dimensions[2] < FURNITURE or not _is_as_high(new, gone):
        return False
    along, offset = long_axis(gone.dimensions, gone.rotation), (new.center - gone.center)[:2]
    if new.object_type == "pillar":
        is_alike = new.shape == gone.shape and math.isfinite(_unlike(new, gone))
        return is_alike and bool(np.linalg.norm(offset) <= OFF_PLACE)
    across = np.array([-along[1], along[0]])
    length, depth = np.sort(gone.dimensions[:2])[::-1]
    ahead, beside = abs(float(offset @ along)), abs(float(offset @ across))
    if STRAIGHT < depth <= BENT:  # its parts stand in any direction
        near = ahead <= length / 2 + OFF_PLACE and beside <= depth / 2 + OFF_PLACE
        return bool(near and max(new.dimensions[:2]) <= length)
    overlap = (max(new.dimensions[:2]) + length) / 2 - ahead
    turned = abs(float(long_axis(new.dimensions, new.rotation) @ across))
    return bool(turned <= MOST_TURNED and beside <= OFF_PLACE and overlap >= max(new.dimensions[:2]) / 2)


def _is_as_high(one: Mismatch, other: Mismatch) -> bool:
    """Whether both stand in one storey: the middle of the lower one is in the height of the other."""
    return bool(abs(one.center[2] - other.center[2]) <= max(one.dimensions[2], other.dimensions[2]) / 2)


def linked(found: list[Mismatch]) -> list[Mismatch]:
    """Added objects of the size of a removed one point to it: the likest and nearest pairs first, each object once."""
    pairs = sorted(
        (difference * AS_FAR + float(np.linalg.norm(one.center - other.center)), new, old)
        for new, one in enumerate(found)
        for old, other in enumerate(found)
        if one.mismatch_type == "added" and other.mismatch_type == "removed"
        and one.object_type == other.object_type and one.shape == other.shape
        and math.isfinite(difference := _unlike(one, other))
    )  # fmt: skip
    used: set[tuple[str, int]] = set()
    for _, new, old in pairs:
        if not {("new", new), ("old", old)} & used:
            used |= {("new", new), ("old", old)}
            found[new] = found[new]._replace(moved_from=old)
    return found


def _unlike(one: Mismatch, other: Mismatch) -> float:
    """How much the edges of two boxes differ [m]; infinite beyond what one object may."""
    a, b = (np.append(np.sort(_section(box)), box.dimensions[2]) for box in (one, other))
    off = np.abs(a - b)
    return float(off.sum()) if np.all(off <= np.maximum(SAME_SIZE[0], SAME_SIZE[1] * np.maximum(a, b))) else math.inf


def _section(one: Mismatch) -> np.ndarray:
    """Edges (2,) [m] that it is known again by: what is new has no capital, of what is gone a box may hold one."""
    return one.dimensions[:2] if one.shaft is None else one.shaft
