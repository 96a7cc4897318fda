"""The main directions of a building, which most of its walls are parallel to or at right angles with.

U upright triangles. Plan: x and y of the frame of the building, metres.
"""

from typing import NamedTuple

import numpy as np

from jaxmm.vectors import lengths

UPRIGHT = 0.1  # most z of a unit normal
NEAR = 30.0  # [m] in plan over which a surface counts e times less: wings of a building have grids of their own
BINS = 90  # over a quarter of a turn
QUARTER = np.pi / 2
UNKNOWN = -10.0  # as an angle off the grid, which no angle is


class Uprights(NamedTuple):
    """The upright surface of a building."""

    turn: np.ndarray  # (U,) [rad] of the normals in plan, from 0 to a quarter turn
    area: np.ndarray  # (U,) [m^2]
    low: np.ndarray  # (U, 3) float32 [m] lowest coordinates of each triangle
    high: np.ndarray  # (U, 3) and highest
    corners: np.ndarray  # (U, 3, 3) float32 [m] of each triangle
    element: np.ndarray  # (U,) int its row among the building's elements


def uprights_of(vertices: np.ndarray, faces: np.ndarray, element: np.ndarray) -> Uprights:
    """The upright ones of the triangles of a building: vertices (V, 3) [m], faces (T, 3) int, element (T,) int."""
    corners = vertices[faces]
    normal = np.cross((corners[:, 1] - corners[:, 0]).astype(np.float64), corners[:, 2] - corners[:, 0])
    size = lengths(normal)
    upright = np.abs(normal[:, 2]) < UPRIGHT * size
    normal, corners = normal[upright], corners[upright]
    turn = np.arctan2(normal[:, 1], normal[:, 0]) % QUARTER
    return Uprights(turn, size[upright] / 2, corners.min(axis=1), corners.max(axis=1), corners, element[upright])


def grid_near(uprights: Uprights, place: np.ndarray, floor: float, ceiling: float) -> float | None:
    """Direction [rad], 0 to less than a quarter turn, along or across which most surface stands; None without any.

    Args:
        uprights: of the building.
        place: (2,) [m] near which surface counts most.
        floor: [m] what ends below it is of another storey.
        ceiling: [m] and what begins above this.
    """
    here = np.flatnonzero((uprights.low[:, 2] < ceiling) & (uprights.high[:, 2] > floor))
    if not len(here):
        return None
    turn, low, high = uprights.turn[here], uprights.low[here, :2], uprights.high[here, :2]
    away = lengths(np.maximum(np.maximum(low - place, place - high), 0.0))
    weight = uprights.area[here] * np.exp(-(away - away.min()) / NEAR)
    step = QUARTER / BINS
    count = np.bincount((turn / step).astype(int) % BINS, weight, BINS)
    best = int(np.argmax(2.0 * count + np.roll(count, 1) + np.roll(count, -1)))  # a direction may be on a border
    off = (turn - (best + 0.5) * step + QUARTER / 2) % QUARTER - QUARTER / 2
    near = np.flatnonzero(np.abs(off) <= 1.5 * step)
    near = near[np.argsort(off[near])]
    total = np.cumsum(weight[near])
    middle = near[np.searchsorted(total, total[-1] / 2)]  # a wall that is a degree off does not move it
    grid = float((best + 0.5) * step + off[middle]) % QUARTER
    return grid if grid < QUARTER else 0.0  # what is hardly below 0 comes back as a whole quarter turn


def way_to_surface(
    uprights: Uprights, start: np.ndarray, along: np.ndarray, height: float, gone: np.ndarray | None = None
) -> float:
    """How far [m] it is level from a place to the upright surface of a building; infinite where none is met.

    Args:
        uprights: of the building.
        start: (2,) [m] in plan.
        along: (2,) unit vector.
        height: [m] z of the way. Where triangles have a corner right at that height, they count as higher.
        gone: (E,) bool elements that are passed through; None for none.
    """
    met = True if gone is None else ~gone[uprights.element]
    height = np.float64(height)  # a plain number would be rounded to the float32 of some corners, and not of others
    met = met & (uprights.low[:, 2] < height) & (uprights.high[:, 2] >= height)
    corners = uprights.corners[met].astype(np.float64)
    above = corners[:, :, 2] >= height
    lone = np.argmax(above == (above.sum(axis=1) == 1)[:, None], axis=1)  # the corner on its side of that height
    each = np.arange(len(corners))
    tip = corners[each, lone]
    cut = []
    for step in (1, 2):
        other = corners[each, (lone + step) % 3]
        share = (height - tip[:, 2]) / (other[:, 2] - tip[:, 2])
        cut.append(tip[:, :2] + share[:, None] * (other - tip)[:, :2] - start)
    side = [one @ np.array([-along[1], along[0]]) for one in cut]
    ahead = [one @ along for one in cut]
    across = side[0] * side[1] <= 0.0
    in_line = side[0] == side[1]  # of those across it: from its nearer end on, or from right here
    between = np.where(across, side[0] / np.where(in_line, 1.0, side[0] - side[1]), 0.0)
    way = ahead[0] + between * (ahead[1] - ahead[0])
    far = np.maximum(*ahead)
    way = np.where(in_line, np.where(far < 0.0, far, np.maximum(np.minimum(*ahead), 0.0)), way)
    return float(way[across & (way >= 0.0)].min(initial=np.inf))


def off_grid(turn: np.ndarray | float, grid: float) -> np.ndarray:
    """Angles [deg], 0 to 45, between directions [rad] and the one that a building stands along or across."""
    off = np.degrees(turn - grid) % 90.0
    return np.minimum(off, 90.0 - off)
