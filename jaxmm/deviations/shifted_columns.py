"""Columns, and ends of walls, that stand beside their places: where the same shape fits what belongs to nothing else.

K points, T tried shifts. Positions are offsets from the prior's origin, world axes: metres, z up.

A ray tells how far a face is off along its normal; of a column that moved across the view, rays that should meet it
pass, and what it now shows belongs to no face of the model. So the column's own surface is laid over those points. So
is a wall's that a scan meets at its end alone.
"""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from jaxmm.deviations.meetings import STEEP, Meetings
from jaxmm.rays.scan_rays import ScanRays, measured_points
from jaxmm.vectors import lengths
from warp_scanner.clouds.voxels import thin_clouds
from warp_scanner.scenes.building import Triangles, element_bounds, faces_by_element
from warp_scanner.scenes.scenes import DOOR, PILLAR, WINDOW
from warp_scanner.sensors.triangles import TriangleScene, clearance, prepare_part

# [m] along x and y, at most, of what may be a column, and of what the model calls one, which may stand at an angle; and
# its height, at least.
WIDE, WIDEST, LOWEST = 1.25, 2.0, 1.0
STEP = 0.02  # [m] between shifts that are tried
CLOSE, ON = 0.015, 0.03  # [m] off the surface, to tell shifts apart, and at most
THIN = 0.03  # [m] to which points are thinned
EXPLAINED = 0.02  # [m] from the surface of something else, within which a point is of that
ENDS = 0.1  # [m] at foot and head that are left out: floors and ceilings are there
AROUND = 0.25  # [m] farther than it may have moved: what reaches there is something else
LEAST_POINTS, LEAST_SHARE = 40, 0.75  # points there that belong to nothing else, and how many of them lie on it
FEWER, OF_FEWER = 20, 0.9  # of fewer nearly all
SQUARE, STRIP = 0.5, 1 << 32  # [m] edge of squares in plan; more than there are squares in a strip
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
    size, semantic = high - low, scene.triangles.semantic
    slender = (size[:, :2].max(axis=1) < np.where(semantic == PILLAR, WIDEST, WIDE)) & (size[:, 2] > LOWEST)
    return np.flatnonzero(slender & ~np.isin(semantic, (DOOR, WINDOW)))


def met_at_ends(scene: TriangleScene, met: Meetings) -> np.ndarray:
    """Rows of what is no column, and which rays meet at narrow upright faces alone: of a wall its end."""
    triangles = scene.triangles
    low, high = element_bounds(triangles)
    may = (high[:, 2] - low[:, 2] > LOWEST) & ~np.isin(triangles.semantic, (DOOR, WINDOW))
    may[columns_of(scene)] = False
    order, starts = faces_by_element(triangles)
    first = np.flatnonzero(np.diff(met.group, prepend=-1))
    is_narrow: dict[int, bool] = {}
    for row, normal in zip(met.element[first].tolist(), met.normal[first], strict=True):
        if may[row] and abs(normal[2]) <= STEEP and is_narrow.get(row, True):
            own = triangles.vertices[triangles.faces[order[starts[row] : starts[row + 1]]].ravel(), :2]
            is_narrow[row] = bool(np.ptp(own @ np.array([-normal[1], normal[0]])) < WIDE)
    return np.array(sorted(row for row, narrow in is_narrow.items() if narrow), np.int64)


class Beside(NamedTuple):
    """The points of one scan about each of C columns, those of one after another."""

    rows: np.ndarray  # (C,) int, ascending
    points: np.ndarray  # (K, 3) float32 [m]
    start: np.ndarray  # (C + 1,) int

    def of(self, row: int) -> np.ndarray:
        """(k, 3) float32 [m] about one of them; none about any other element."""
        place = int(np.searchsorted(self.rows, row))
        if place == len(self.rows) or self.rows[place] != row:
            return self.points[:0]
        return self.points[self.start[place] : self.start[place + 1]]


def beside_columns(scene: TriangleScene, rays: ScanRays, most: float, ends: np.ndarray | None = None) -> Beside:
    """What one scan shows about each of `columns_of`, up to `most` [m] and a little farther off its place.

    Args:
        scene: the model.
        rays: of the scan.
        most: [m].
        ends: (n,) int rows of walls of which it shows ends alone; None: of none.
    """
    low, high = (bound.astype(np.float64) for bound in element_bounds(scene.triangles))
    points, found = measured_points(rays), [np.zeros((0, 3), np.float32)]
    squares = _Squares(points[:, :2])
    reach = np.array([most + AROUND, most + AROUND, -ENDS])
    rows = np.union1d(columns_of(scene), () if ends is None else ends).astype(np.int64)
    for row in rows:
        first, last = low[row] - reach, high[row] + reach
        near = squares.between(first[:2], last[:2])
        about = points[near]
        inside = np.all((about > first) & (about < last), axis=1)
        found.append(points[np.sort(near[inside])])
    return Beside(rows, np.concatenate(found), np.cumsum([len(one) for one in found]))


class _Squares:
    """Places in plan (N, 2) [m] by squares, those of a strip one after another: few are asked for each column."""

    def __init__(self, places: np.ndarray):
        self._least = places.min(axis=0).astype(np.float64) if len(places) else np.zeros(2)
        cell = self._cell(places)
        number = cell[:, 0] * STRIP + cell[:, 1]
        self._order = np.argsort(number, kind="stable")
        self._sorted = number[self._order]

    def between(self, first: np.ndarray, last: np.ndarray) -> np.ndarray:
        """Indices of all places from one corner (2,) to another, and of some beside them."""
        (a, c), (b, d) = self._cell(np.maximum(np.stack([first, last]), self._least))
        strips = np.arange(a, b + 1) * STRIP
        begins, ends = np.searchsorted(self._sorted, strips + c), np.searchsorted(self._sorted, strips + d, "right")
        return np.concatenate([self._order[begin:end] for begin, end in zip(begins, ends, strict=True)])

    def _cell(self, places: np.ndarray) -> np.ndarray:
        return np.floor((places - self._least) / SQUARE).astype(np.int64)


def shifts_of(
    scene: TriangleScene, shown: Iterable[Beside], rows: np.ndarray, most: float, others: TriangleScene | None = None
) -> dict[int, Shift]:
    """Of some columns, by their rows, those that stand up to `most` [m] off their places, by what each scan shows.

    One scan is held at a time, and of it what is about `rows`. `others` are where all other elements stand, if not
    where the scene has them.
    """
    about: dict[int, list[np.ndarray]] = {int(row): [] for row in rows}
    for one in shown if about else ():
        for row, points in about.items():
            points.append(one.of(row).copy())
    places = _Places(scene.triangles, (others or scene).triangles)
    found = {row: _shift(places, np.concatenate(points), row, most) for row, points in about.items()}
    return {row: one for row, one in found.items() if one is not None}


class _Places:
    """Where elements are, and where all others are when one of them is looked for; with their bounds."""

    def __init__(self, triangles: Triangles, others: Triangles):
        self.triangles, self.others = triangles, others
        self.bounds, self.others_bounds = element_bounds(triangles), element_bounds(others)

    def near(self, row: int) -> np.ndarray:
        """(E,) bool: other elements about one."""
        (low, high), (least, greatest) = self.others_bounds, (side[row] for side in self.bounds)
        near = np.all((high > least - 1.0) & (low < greatest + 1.0), axis=1)
        near[row] = False
        return near


def _shift(places: _Places, about: np.ndarray, row: int, most: float) -> Shift | None:
    if len(about) < FEWER:
        return None
    about = about[thin_clouds([about], THIN)[0]]
    triangles, others = places.triangles, places.others
    if (near := places.near(row)[others.element]).any():
        about = about[clearance(prepare_part(others, near), about, 2.0 * EXPLAINED) > EXPLAINED]
    if len(about) < FEWER:
        return None
    about = about[:: -(-len(about) // MOST_POINTS)]
    line = np.arange(-most, most + STEP / 2.0, STEP)
    x, y = (part.ravel() for part in np.meshgrid(line, line))
    tried = np.column_stack([x, y, np.zeros(len(x))])
    tried = tried[lengths(tried) <= most]
    laid = (about[None] - tried[:, None].astype(np.float32)).reshape(-1, 3)
    own = prepare_part(triangles, triangles.element == row)
    off = clearance(own, laid, ON).reshape(len(tried), -1)
    on = np.sum(off < CLOSE, axis=1)
    in_place = on[np.argmin(lengths(tried))]
    least = LEAST_SHARE if len(about) >= LEAST_POINTS else OF_FEWER
    # Ranges err by a centimetre and more, and so does the nearest shift that is tried.
    if np.sum(off[on.argmax()] < ON) < least * len(about) or in_place > AS_GOOD * on.max():
        return None
    good = tried[on >= AS_GOOD * on.max(), :2]
    if np.ptp(good, axis=0).max() > MOST_SPREAD:
        return None
    middle = (good.min(axis=0) + good.max(axis=0)) / 2.0
    return Shift(np.array([*middle, 0.0]), np.ptp(good, axis=0) / 2.0 + STEP)
