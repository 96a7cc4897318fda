"""Found boxes against true ones where not everything need be found.

An object that shows less than `LEAST_SHOWN` need not be found, and what is found where it stands is neither right nor
wrong: it is `hidden`, and precision can be told without it.
"""

from typing import NamedTuple

import numpy as np
from scipy.optimize import linear_sum_assignment

from jaxmm.learning.box_match import Match, clip, footprint, match_boxes, polygon_area
from jaxmm.learning.boxes import Box

LEAST_SHOWN = 0.2  # observable fraction from which an object is to be found
LEAST_INSIDE = 0.5  # share of a box's footprint inside an object, from which it stands there


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
