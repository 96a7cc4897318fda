"""What arrows show of a displaced element: where on it, and how far it is off there.

Positions are offsets from the drawing's origin [m].
"""

from typing import NamedTuple

import numpy as np

from jaxmm.deviations.deviation import Deviation
from jaxmm.reports.deviation_words import is_off_at_ends


class Offset(NamedTuple):
    """How far a place of an element is off."""

    place: np.ndarray  # (3,) [m] where the model has it
    step: np.ndarray  # (3,) [m] from there to where it stands


Limits = tuple[np.ndarray, np.ndarray]
WHOLE = (np.full(2, -np.inf), np.full(2, np.inf))


def offsets_of(one: Deviation, corners: np.ndarray, limits: Limits = WHOLE) -> list[Offset]:
    """The offset of its middle; of what is turned or leans, and is farther off there, of its ends or its head.

    Args:
        one: of the element.
        corners: (n, 3) [m] of it, at least one.
        limits: lower and upper corner (2,) [m] in plan of what is drawn; of an end beyond, where the drawing ends.
    """
    low, high = corners.min(axis=0), corners.max(axis=0)
    middle, step, turned = (low + high) / 2.0, np.array(one.offset), np.array(one.turned)
    if not is_off_at_ends(one):
        start, end = np.maximum(low[:2], limits[0]), np.minimum(high[:2], limits[1])
        return [Offset(np.array([*(start + end) / 2.0, middle[2]]), step)]
    in_plan = corners[:, :2] - middle[:2]
    way = np.linalg.eigh(in_plan.T @ in_plan)[1][:, 1]
    along = np.array([*way * np.abs(in_plan @ way).max(), 0.0])
    up = np.array([0.0, 0.0, (high[2] - low[2]) / 2.0])
    ends = (along, -along) if np.linalg.norm(np.cross(turned, along)) >= np.linalg.norm(np.cross(turned, up)) else (up,)
    places = [middle + end for end in ends]
    places = [np.array([*np.clip(place[:2], *limits), place[2]]) for place in places]
    return [Offset(place, step + np.cross(turned, place - middle)) for place in places]
