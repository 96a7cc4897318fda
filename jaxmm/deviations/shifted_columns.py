"""Columns that stand beside their places: where the same shape fits what is there, and belongs to nothing else.

K points, T tried shifts. Positions are offsets from the prior's origin, world axes: metres, z up.

A ray tells how far a face is off along its normal; of a column that moved across the view, rays that should meet it
pass, and what it now shows belongs to no face of the model. So the column's own surface is laid over those points.
"""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from jaxmm.rays.scan_rays import ScanRays, measured_points
from warp_scanner.clouds.voxels import thin_clouds
from warp_scanner.scenes.building import Triangles, element_bounds
from warp_scanner.scenes.scenes import DOOR, WINDOW
from warp_scanner.sensors.triangles import TriangleScene, clearance, prepare_part

WIDEST, LOWEST = 1.2, 1.0  # [m] edges in plan of what may be a column, at most, and its height, at least
STEP, CLOSE = 0.02, 0.015  # [m] between shifts that are tried, and off the surface
THIN = 0.03  # [m] to which points are thinned
EXPLAINED = 0.02  # [m] from the surface of something else, within which a point is of that
ENDS = 0.1  # [m] at foot and head that are left out: floors and ceilings are there
AROUND = 0.25  # [m] farther than it may have moved: what reaches there is something else
LEAST_POINTS, LEAST_SHARE = 40, 0.75  # points there that belong to nothing else, and how many of them lie on it
MOST_POINTS = 2000  # of them that are laid
AS_GOOD = 0.97  # of the most points: shifts with so many are as likely
MOST_SPREAD = 0.1  # [m] of those shifts, beyond which nobody knows where it stands


class Shift(NamedTuple):
    """Where a column stands."""

    step: np.ndarray  # (3,) [m] off its place
    half: np.ndarray  # (2,) [m] in x and y, half of what it may as well be


def columns_of(scene: TriangleScene) -> np.ndarray:
    """Rows of the elements that are slender and stand; no doors and windows, for their leaves turn."""
    low, high = element_bounds(scene.triangles)
    size = high - low
    slender = (size[:, :2].max(axis=1) < WIDEST) & (size[:, 2] > LOWEST)
    return np.flatnonzero(slender & ~np.isin(scene.triangles.semantic, (DOOR, WINDOW)))


class Beside(NamedTuple):
    """The points of one scan about each of C columns, those of one after another."""

    points: np.ndarray  # (K, 3) float32 [m]
    start: np.ndarray  # (C + 1,) int

    def of(self, column: int) -> np.ndarray:
        """(k, 3) float32 [m] about one of them."""
        return self.points[self.start[column] : self.start[column + 1]]


def beside_columns(scene: TriangleScene, rays: ScanRays, most: float) -> Beside:
    """What one scan shows about each of `columns_of`, up to `most` [m] and a little farther off its place."""
    low, high = (bound.astype(np.float64) for bound in element_bounds(scene.triangles))
    points, found = measured_points(rays), [np.zeros((0, 3), np.float32)]
    cells = _Cells(points[:, 0])
    reach = np.array([most + AROUND, most + AROUND, -ENDS])
    for row in columns_of(scene):
        first, last = low[row] - reach, high[row] + reach
        near = cells.between(first[0], last[0])
        about = points[near]
        inside = np.all((about > first) & (about < last), axis=1)
        found.append(points[np.sort(near[inside])])
    return Beside(np.concatenate(found), np.cumsum([len(one) for one in found]))


class _Cells:
    """Numbers (N,) float32 in order of 16 bits, which takes a fifth of the time that their own order would."""

    def __init__(self, values: np.ndarray):
        self._least = values.min() if len(values) else np.float32(0.0)
        self._per_unit = np.float32(2**16 - 1) / max(values.max(initial=self._least) - self._least, np.float32(1e-6))
        cell = self._cell(values)
        self._order = np.argsort(cell, kind="stable")
        self._sorted = cell[self._order]

    def between(self, first: float, last: float) -> np.ndarray:
        """Indices of all numbers from first to last, and of some beside them: no cell is lower than one before it."""
        begin, end = self._cell(np.array([first, last], np.float32))
        return self._order[np.searchsorted(self._sorted, begin, "left") : np.searchsorted(self._sorted, end, "right")]

    def _cell(self, values: np.ndarray) -> np.ndarray:
        return np.clip((values - self._least) * self._per_unit, 0, 2**16 - 1).astype(np.uint16)


def shifts_of(scene: TriangleScene, shown: Iterable[Beside], rows: np.ndarray, most: float) -> dict[int, Shift]:
    """Of some columns, by their rows, those that stand up to `most` [m] off their places, by what each scan shows.

    One scan is held at a time, and of it what is about `rows`.
    """
    place = {int(row): number for number, row in enumerate(columns_of(scene)) if row in rows}
    about: dict[int, list[np.ndarray]] = {row: [] for row in place}
    for one in shown if place else ():
        for row, number in place.items():
            about[row].append(one.of(number).copy())
    low, high = (bound.astype(np.float64) for bound in element_bounds(scene.triangles))
    found = {int(row): _shift(scene.triangles, np.concatenate(about[row]), (low, high), row, most) for row in place}
    return {row: one for row, one in found.items() if one is not None}


def _shift(
    triangles: Triangles, about: np.ndarray, bounds: tuple[np.ndarray, np.ndarray], row: int, most: float
) -> Shift | None:
    low, high = bounds
    if len(about) < LEAST_POINTS:
        return None
    about = about[thin_clouds([about], THIN)[0]]
    near = np.all((high > low[row] - 1.0) & (low < high[row] + 1.0), axis=1)
    near[row] = False
    if (near := near[triangles.element]).any():
        about = about[clearance(prepare_part(triangles, near), about, 2.0 * EXPLAINED) > EXPLAINED]
    if len(about) < LEAST_POINTS:
        return None
    about = about[:: -(-len(about) // MOST_POINTS)]
    line = np.arange(-most, most + STEP / 2.0, STEP)
    x, y = (part.ravel() for part in np.meshgrid(line, line))
    tried = np.column_stack([x, y, np.zeros(len(x))])
    tried = tried[np.linalg.norm(tried, axis=1) <= most]
    laid = (about[None] - tried[:, None].astype(np.float32)).reshape(-1, 3)
    own = prepare_part(triangles, triangles.element == row)
    on = np.sum(clearance(own, laid, 2.0 * CLOSE).reshape(len(tried), -1) < CLOSE, axis=1)
    in_place = on[np.argmin(np.linalg.norm(tried, axis=1))]
    if on.max() < LEAST_SHARE * len(about) or in_place > AS_GOOD * on.max():
        return None
    good = tried[on >= AS_GOOD * on.max(), :2]
    if np.ptp(good, axis=0).max() > MOST_SPREAD:
        return None
    middle = (good.min(axis=0) + good.max(axis=0)) / 2.0
    return Shift(np.array([*middle, 0.0]), np.ptp(good, axis=0) / 2.0 + STEP)
