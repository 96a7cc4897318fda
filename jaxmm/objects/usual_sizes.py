"""What is usual in a building: the sizes of its walls and columns, and how they stand. What is new is mostly alike.

O own walls and columns. Plan: x and y of the frame of the building, metres.
"""

from typing import NamedTuple

import numpy as np

from jaxmm.objects.main_directions import NEAR, UNKNOWN, off_grid
from jaxmm.vectors import lengths

WIDEST = 2.0  # [m] beyond which a column is as good as a wall


class OwnElements(NamedTuple):
    """The walls and columns of a building."""

    is_wall: np.ndarray  # (O,) bool
    is_round: np.ndarray  # (O,) bool: stands along nothing
    place: np.ndarray  # (O, 2) [m]
    turn: np.ndarray  # (O,) [rad] of one of its sides, from 0 to a quarter turn
    longer: np.ndarray  # (O,) [m] its longer side in plan


class Habits(NamedTuple):
    """What is usual in a building, all its storeys together, and around a place how askew things stand."""

    walls: float = 0.0  # logarithm of 1 + their number
    shortest: float = 0.0  # [m] the least of their lengths; 0 without any
    columns: float = 0.0  # logarithm of 1 + their number
    slimmest: float = 0.0  # [m] the least of their widths; 0 without any
    widest: float = 0.0  # [m] the greatest, WIDEST at most
    columns_askew: float = UNKNOWN  # [deg] mean angle between them and the grid; UNKNOWN where nobody knows
    walls_askew: float = UNKNOWN  # [deg] and between the walls and the grid, by length


def habits_around(own: OwnElements | None, place: np.ndarray, grid: float | None) -> Habits:
    """Sizes and numbers of all walls and columns, and their angles around a place, where near ones count more.

    Args:
        own: of the building; None where nobody knows.
        place: [m] in plan.
        grid: [rad] the direction that most of the building stands along or across there; None where nobody knows.
    """
    if own is None:
        return Habits()
    width, length = np.minimum(own.longer[~own.is_wall], WIDEST), own.longer[own.is_wall]
    weight = np.exp(-lengths(own.place - place) / NEAR)
    columns, walls = ~own.is_wall & ~own.is_round, own.is_wall
    return Habits(
        float(np.log1p(len(length))), _least(length), float(np.log1p(len(width))), _least(width),
        float(width.max(initial=0.0)), _askew(own.turn[columns], weight[columns], grid),
        _askew(own.turn[walls], weight[walls] * own.longer[walls], grid),
    )  # fmt: skip


def _least(size: np.ndarray) -> float:
    return float(size.min()) if len(size) else 0.0


def _askew(turn: np.ndarray, weight: np.ndarray, grid: float | None) -> float:
    """Weighted mean angle [deg], 0 to 45, between directions and the grid."""
    if grid is None or not weight.sum() > 0.0:
        return UNKNOWN
    return float(np.average(off_grid(turn, grid), weights=weight))
