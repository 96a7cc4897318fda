"""The horizontal cross-section of a column, as all rays show it: a rectangle, and between which sizes it may be.

The points that objects are fitted to are thinned to one a voxel of 0.1 m, and of a side at which one looks along few
are left. All rays tell more: where they end on the column, and where they pass beside it. Each side of the section lies
between both; where nothing passes, nobody knows how far on it lies. M rays, n ends. World frame: metres, z up. Plan: x
and y.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from jaxmm.learning.upright_shapes import circle_through
from jaxmm.objects.face_finish import Rays
from jaxmm.vectors import lengths

SEEN_AT = (0.1, 0.9)  # quantiles of the heights of a thing, between which rays are asked: its rims are no part of it
NEAR = 0.12  # [m] in plan from a thinned point: what ends there is of the same thing
CELL = 0.02  # [m] of a grid that tells what is so near
WIDEST = 1.6  # [m] in plan: a thing that spans more is no column
SLICE = 0.2  # [m] of height, in each of which one looks how far the thing reaches
LEAST_ENDS = 20  # of rays on it, that tell a section
LEAST_IN_SLICE = 3
ANGLES, FINER = 30, 9  # directions tried over a quarter turn, then about the best, again and again
FINEST = 2e-3  # [rad] between them, at last
INSIDE = 0.05  # [m] from the outline: what is farther inside it counts no more, a web between flanges, say
ON = 0.02  # [m] from the outline, within which an end lies on it
LEAST_ON = 0.6  # share of the ends that lie on the outline
AT_MOST = 800  # ends, for which directions are tried
RIM = 0.005  # [m] from its sides: rays that pass as near tell nothing of the others
LEAST_DEPTH = 0.05  # [m] along which one looks past a side, where nothing is seen of those beside it
ROUNDED = 1e-3  # [rad] more than a thing fills, in which rays are looked for: directions are single
STRAYS = 2  # rays that pass where the thing is, and do not make it smaller
SURE = 0.06  # [m] within which a side is known


class Section(NamedTuple):
    """A rectangle in plan, and how much larger it may be."""

    center: np.ndarray  # (2,) [m]
    along: np.ndarray  # (2,) unit vector along the first edge
    edges: np.ndarray  # (2,) [m] as far as something is seen of it
    room: np.ndarray  # (2, 2) [m] that it may go on: edge by edge, at its first end and at its second; inf: not known

    @property
    def most(self) -> np.ndarray:
        """(2,) [m] the largest edges that the rays allow."""
        return self.edges + self.room.sum(axis=1)

    @property
    def turned(self) -> "Section":
        """The same rectangle, its other edge first."""
        along = np.array([-self.along[1], self.along[0]])
        return Section(self.center, along, self.edges[::-1], np.stack([self.room[1], self.room[0, ::-1]]))

    @property
    def known(self) -> np.ndarray:
        """(2,) bool: edges both of whose ends are seen."""
        return (self.room <= SURE).all(axis=1)


class _Ends(NamedTuple):
    """What ends on a thing, and what comes past."""

    places: np.ndarray  # (n, 2) [m] where rays end on it
    level: np.ndarray  # (n,) int slice of height, from 0
    start: np.ndarray  # (M, 2) [m] of all rays that come near, at its heights
    end: np.ndarray  # (M, 2) [m]


def sections_of(rays: Sequence[Rays], things: Sequence[np.ndarray]) -> list[Section | None]:
    """The section of each thing; None where rays end on no outline of a rectangle, or it is too large for a column.

    Heights vote: a plinth, a head or a corbel, flush with a side or not, is at fewer of them than the shaft.

    Args:
        rays: all rays, scan by scan; each scan is asked for once, as it may have to be loaded.
        things: (n, 3) [m] points of each, thinned.
    """
    small = [row for row, one in enumerate(things) if np.linalg.norm(np.ptp(one[:, :2], axis=0)) <= WIDEST]
    parts: dict[int, list[_Ends]] = {row: [] for row in small}
    for one in rays if small else ():
        ways = _Ways(one)
        for row in small:
            parts[row].append(_ends_on(ways, things[row]))
    found = {
        row: _section(_Ends(*(np.concatenate(each) for each in zip(*of, strict=True)))) for row, of in parts.items()
    }
    return [found.get(row) for row in range(len(things))]


def _section(found: _Ends) -> Section | None:
    if len(found.places) < LEAST_ENDS:
        return None
    every = max(len(found.places) // AT_MOST, 1)
    fewer = found._replace(places=found.places[::every], level=found.level[::every])
    along = _along(fewer)
    if along is None:
        return None
    axes = np.stack([along, [-along[1], along[0]]])
    turned = found.places @ axes.T
    low, high = _as_faces_lie(turned, *_sides(turned, found.level))
    off = np.abs(_off(turned, low, high))
    if np.mean(off <= ON) < LEAST_ON or _is_rounder(fewer.places, off):
        return None
    room = _room(found.start @ axes.T, found.end @ axes.T, low, high)
    return Section((low + high) / 2 @ axes, along, high - low, room)


def _is_rounder(places: np.ndarray, off: np.ndarray) -> bool:
    """Whether places (n, 2) [m] lie on a circle better than others, or they, lie on an outline (m,) [m]."""
    circle = circle_through(places, INSIDE)
    if circle is None or circle.radius > WIDEST / 2:
        return False
    round_off = np.abs(lengths(places - circle.center) - circle.radius)
    return bool(np.mean(np.minimum(round_off, INSIDE) ** 2) < np.mean(np.minimum(off, INSIDE) ** 2))


class _Ways:
    """The rays of one scan by the way that they go in plan: of a thing far away few head for it."""

    def __init__(self, rays: Rays):
        self.rays = rays
        origin = np.asarray(rays.origin)
        self._origin = origin if origin.ndim == 1 else None
        if self._origin is not None:
            azimuth = np.arctan2(rays.direction[:, 1], rays.direction[:, 0])
            self._order = np.argsort(azimuth)
            self._azimuth = azimuth[self._order]

    def toward(self, middle: np.ndarray, around: float) -> np.ndarray:
        """Rays (m,) int in their order: all that pass within a distance [m] of a place (2,) [m], and some others."""
        offset = middle - self._origin[:2] if self._origin is not None else np.zeros(2)
        away = float(np.hypot(*offset))
        if away <= around:  # from within, or nobody knows from where
            return np.arange(len(self.rays.distance))
        way, open_by = np.arctan2(offset[1], offset[0]), np.arcsin(around / away) + ROUNDED
        low, high = way - open_by, way + open_by
        spans = [(low, high), (low + 2.0 * np.pi, high + 2.0 * np.pi), (low - 2.0 * np.pi, high - 2.0 * np.pi)]
        rows = [self._order[slice(*np.searchsorted(self._azimuth, span))] for span in spans]
        return np.sort(np.concatenate(rows))


def _ends_on(ways: _Ways, points: np.ndarray) -> _Ends:
    low, high = np.quantile(points[:, 2], SEEN_AT)
    middle = points[:, :2].mean(axis=0)
    around = float(lengths(points[:, :2] - middle).max()) + WIDEST / 2
    rays, rows = ways.rays, ways.toward(middle, around)
    rows = rows[np.isfinite(rays.distance[rows])]
    origin, direction = _of_rows(rays.origin, rows), rays.direction.take(rows, axis=0)
    offset = middle - origin[..., :2]
    ahead = offset[..., 0] * direction[:, 0] + offset[..., 1] * direction[:, 1]
    beside = offset[..., 0] * direction[:, 1] - offset[..., 1] * direction[:, 0]
    length = lengths(direction[:, :2])
    near = np.flatnonzero((ahead > 0.0) & (np.abs(beside) <= around * length))
    rows, origin, direction = rows[near], _of_rows(origin, near).astype(np.float64), direction[near].astype(np.float64)
    reach = rays.distance[rows].astype(np.float64)
    z = origin[..., 2] + np.minimum(ahead[near] / np.maximum(length[near] ** 2, 1e-12), reach) * direction[:, 2]
    inside = np.flatnonzero((z >= low) & (z <= high))
    origin = _of_rows(origin, inside)
    end = origin + reach[inside, None] * direction[inside]
    at = (end[:, 2] >= low) & (end[:, 2] <= high)
    at[at] = _are_near(end[at, :2], points[:, :2])
    start = np.broadcast_to(origin[..., :2], (len(inside), 2))
    return _Ends(end[at, :2], np.floor((end[at, 2] - low) / SLICE).astype(int), start, end[:, :2])


def _are_near(places: np.ndarray, points: np.ndarray) -> np.ndarray:
    """(n,) bool: places (n, 2) [m] that are within NEAR of one of some points (k, 2) [m].

    Of most the cell that they are in tells: one of a grid over the points, all of which is near, or nothing.
    """
    tree, low = cKDTree(points), points.min(axis=0) - NEAR
    shape = np.ceil((points.max(axis=0) + NEAR - low) / CELL).astype(int) + 1
    middle = low + (np.indices(shape).reshape(2, -1).T + 0.5) * CELL
    apart, half = tree.query(middle)[0], 0.75 * CELL  # more than from a cell's middle to its corners
    known = np.where(apart <= NEAR - half, 1, np.where(apart <= NEAR + half, 2, 0)).astype(np.int8)
    step, row = (places - low) / CELL, np.zeros(len(places), np.int8)
    inside = np.flatnonzero(((step >= 0.0) & (step < shape)).all(axis=1))
    row[inside] = known[np.ravel_multi_index(step[inside].astype(int).T, shape)]
    found, asked = row == 1, np.flatnonzero(row == 2)
    found[asked] = tree.query(places[asked], distance_upper_bound=NEAR)[0] <= NEAR
    return found


def _of_rows(origin: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Where some rays (m,) int start: (m, 3) [m], or (3,) of all."""
    return origin if np.ndim(origin) == 1 else origin[rows]


def _along(found: _Ends) -> np.ndarray | None:
    """Unit vector (2,) along a side of the rectangle on whose outline the ends lie best."""
    best, angles = 0.0, np.linspace(0.0, np.pi / 2, ANGLES, endpoint=False)
    step = np.pi / 2 / ANGLES
    while True:
        misfit = [_misfit(found, angle) for angle in angles]
        best = float(angles[int(np.argmin(misfit))])
        if not np.isfinite(np.min(misfit)):
            return None
        if step < FINEST:
            return np.array([np.cos(best), np.sin(best)])
        angles = best + step * np.linspace(-1.0, 1.0, FINER)
        step *= 2.0 / (FINER - 1)


def _misfit(found: _Ends, angle: float) -> float:
    along = np.array([np.cos(angle), np.sin(angle)])
    turned = found.places @ np.stack([along, [-along[1], along[0]]]).T
    low, high = _sides(turned, found.level)
    return float(np.mean(np.minimum(np.abs(_off(turned, low, high)), INSIDE) ** 2))  # NaN where no height tells


def _sides(turned: np.ndarray, level: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Least and largest coordinates (2,) of most heights; NaN where no height has ends enough."""
    order = np.argsort(level, kind="stable")
    _, first, count = np.unique(level[order], return_index=True, return_counts=True)
    told = count >= LEAST_IN_SLICE
    if not told.any():
        return np.full(2, np.nan), np.full(2, np.nan)
    turned = turned[order]
    low, high = np.minimum.reduceat(turned, first), np.maximum.reduceat(turned, first)
    return np.median(low[told], axis=0), np.median(high[told], axis=0)


def _off(turned: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """How far (n,) [m] places are from the outline of a rectangle; negative inside."""
    beyond = np.maximum(low - turned, turned - high)  # (n, 2), negative inside
    outer = lengths(np.maximum(beyond, 0.0))
    return np.where(outer > 0.0, outer, beyond.max(axis=1))


def _as_faces_lie(turned: np.ndarray, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The sides, moved to the middle of the ends that lie on them: the outermost ones err outward."""
    low, high = low.copy(), high.copy()
    for axis in range(2):
        other = turned[:, 1 - axis]
        within = (other > low[1 - axis] + ON) & (other < high[1 - axis] - ON)
        reach = min(INSIDE, (high[axis] - low[axis]) / 3)
        for sides in (low, high):
            on = within & (np.abs(turned[:, axis] - sides[axis]) <= reach)
            if on.sum() >= LEAST_ENDS:
                sides[axis] = np.median(turned[on, axis])
    return low, high


def _room(start: np.ndarray, end: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """How far (2, 2) [m] beyond each side the first rays pass, axis by axis, below and above; inf where none does."""
    room = np.full((2, 2), np.inf)
    for axis in range(2):
        other = 1 - axis
        bottom, top = low[other] + RIM, high[other] - RIM
        if top - bottom < LEAST_DEPTH:  # of one face alone what is behind it counts: all rays to it pass before it
            behind = np.sign(low[other] + high[other] - 2.0 * np.median(start[:, other]))
            bottom, top = np.sort((low[other] + high[other]) / 2 + behind * np.array([2.0 * RIM, LEAST_DEPTH]))
        first, last = _within(start, end, other, bottom, top)
        crosses = first < last
        way = end[crosses, axis] - start[crosses, axis]
        ends = start[crosses, axis, None] + np.stack([first, last], axis=1)[crosses] * way[:, None]
        below, above = low[axis] - ends, ends - high[axis]  # (m, 2) [m]
        room[axis] = _next(below), _next(above)
    return room


def _next(beyond: np.ndarray) -> float:
    """How far [m] beyond a side the first rays pass, but for strays; they are beyond it (m, 2) [m] all of that way."""
    nearest, farthest = np.minimum(*beyond.T), np.maximum(*beyond.T)  # long rows reduce fast
    passing = np.sort(nearest[(nearest > -RIM) & (farthest > 2.0 * RIM)])
    return max(float(passing[STRAYS]), 0.0) if len(passing) > STRAYS else np.inf


def _within(start: np.ndarray, end: np.ndarray, axis: int, bottom: float, top: float) -> tuple[np.ndarray, np.ndarray]:
    """Between which parts (M,) of their way rays have a coordinate between two values; where they never do, 1 and 0."""
    begin, way = start[:, axis], end[:, axis] - start[:, axis]
    way = np.where(np.abs(way) < 1e-9, 1e-9, way)
    below, above = (bottom - begin) / way, (top - begin) / way
    first, last = np.maximum(np.minimum(below, above), 0.0), np.minimum(np.maximum(below, above), 1.0)
    never = first >= last
    return np.where(never, 1.0, first), np.where(never, 0.0, last)
