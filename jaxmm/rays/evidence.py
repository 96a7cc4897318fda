"""Evidence: what the robot's rays say of every point of the prior, and what the prior says of every point of the robot.

N points of one scan, S of them stand in one pool. World frame: metres, z up. Counts are of rays (N, 4), in the order of
FRACTIONS. For a point of the prior they tell what the robot's rays within its footprint did; for a point of the robot,
where the prior's surface lies along the same ray.
"""

from typing import NamedTuple

import numpy as np

from jaxmm.rays.pools import Surfaces, neighbourhood_of, pools_of
from jaxmm.vectors import lengths

FRACTIONS = ("through", "support", "blocked", "unseen")
THROUGH, SUPPORT, BLOCKED, UNSEEN = range(4)
FEATURES = (
    *FRACTIONS,  # of the point's own footprint
    "residual",  # measured less expected range over 2 m, cut to [-1, 1]
    "surprise",  # the same over three of the margins within which ranges are taken for equal, cut to [-1, 1]
    "apart",  # distance to the other side's surface [m], at most 1
    "height",  # above the floor, over the height of the room
    "range",  # from the sensor, over 10 m
    "facing",  # cosine of the incidence
    "pooled",  # 1 where the point belongs to a pool
    *(f"pool {name}" for name in FRACTIONS),
    "pool size",  # logarithm of its rays, base 10, over 4
    "pool low", "pool high",  # lowest and highest point, as heights
    "pool floor gap", "pool ceiling gap",  # what of the visible height it leaves free below and above, over the room's
    "pool length", "pool width",  # over 5 m and over 1 m, cut to 1
    *(f"surface {name}" for name in FRACTIONS),  # of all that hangs together with the point, explained or not
    "column low", "column high", "column ceiling gap",  # as above, of the candidates right below and above the point
)  # fmt: skip

BASE_MARGIN = 0.03  # [m] of ranges without errors
EXPLAINED = 0.5  # of a point's rays must support it, or it is in need of an explanation
SIGMAS = 3.0  # errors of ranges that the margin covers
LEAST_COSINE = 0.15  # beyond this incidence the margin grows no further
MOST_MARGIN = 1.0  # [m]
COLUMN = 0.2  # [m] edge of the cells of a column
AZIMUTHS = 180  # cells of the outline of the field of view


class View(NamedTuple):
    """One side of a pair: N points that are to be judged, with what was found out about each."""

    points: np.ndarray  # (N, 3) [m] world
    element: np.ndarray  # (N,) int: of the prior; -1 where elements are unknown
    count: np.ndarray  # (N, 4) rays
    residual: np.ndarray  # (N,) [m] measured less expected range; NaN where nothing is known
    margin: np.ndarray  # (N,) [m] within which they are taken for equal
    apart: np.ndarray  # (N,) [m] to the surface of the other side
    cosine: np.ndarray  # (N,) of the incidence
    candidate: np.ndarray  # (N,) bool: what could be a mismatch by its own evidence
    levels: np.ndarray | None = None  # (N, 2) [m] world, of floor and ceiling of each point; None: the frame's, of all

    def at(self, chosen: np.ndarray) -> "View":
        """The view of some of its points, (n,) int or (N,) bool."""
        return View(*(None if field is None else field[chosen] for field in self))


class Heights(NamedTuple):
    """Where N points are between the floor and the ceiling above each, as shares of the height of the ceiling."""

    height: np.ndarray  # (N,) above the floor
    below: np.ndarray  # (N,) what could be seen below it
    above: np.ndarray  # (N,) and above it


class Frame(NamedTuple):
    """What heights are judged against."""

    sensor: np.ndarray  # (3,) [m] world
    floor: float  # [m] world
    ceiling: float
    top: np.ndarray  # (AZIMUTHS,) greatest and least tangent of the elevation that rays reach in a direction; NaN: none
    bottom: np.ndarray


def frame_of(sensor: np.ndarray, directions: np.ndarray, floor: float, ceiling: float) -> Frame:
    """The frame of a scan.

    Args:
        sensor: (3,) [m] world.
        directions: (P, 3) of its rays, world frame, of any length.
        floor, ceiling: heights [m].
    """
    level = np.hypot(directions[:, 0], directions[:, 1])
    slope = directions[:, 2] / np.maximum(level, 1e-6)
    cell = _azimuth_cell(directions)
    top, bottom = np.full(AZIMUTHS, -np.inf), np.full(AZIMUTHS, np.inf)
    np.maximum.at(top, cell, slope)
    np.minimum.at(bottom, cell, slope)
    empty = top < bottom
    top[empty] = bottom[empty] = np.nan
    return Frame(np.asarray(sensor, np.float64), float(floor), float(ceiling), top, bottom)


def margins(cosine: np.ndarray, sigma: np.ndarray | float) -> np.ndarray:
    """Ranges that differ by less are the same (N,) float32 [m].

    A surface that is a little off is off by more along a slanting ray.
    """
    widened = SIGMAS * sigma / np.clip(np.nan_to_num(cosine, nan=1.0), LEAST_COSINE, 1.0)
    return np.minimum(BASE_MARGIN + widened, MOST_MARGIN).astype(np.float32)


def fractions(count: np.ndarray) -> np.ndarray:
    """Counts of rays (N, 4) as fractions that sum to 1, float32; a point without rays is unseen."""
    total = count.sum(axis=-1, keepdims=True)
    share = (count / np.maximum(total, 1)).astype(np.float32)
    share[total[..., 0] == 0, UNSEEN] = 1.0
    return share


def features_of(view: View, frame: Frame, surfaces: Surfaces | None = None) -> np.ndarray:
    """The network's input (N, F) float32, columns as FEATURES; 0 where a point is in no pool or column.

    Pools are the prior's elements where they are known, else surfaces of points that most of their rays do not support.
    `surfaces` are the `normals_of` the points, where they are known already.
    """
    points = np.asarray(view.points, np.float64)
    share, (surface, pool) = fractions(view.count), _groups(view, surfaces)
    stands = _heights(view, frame)
    own = [
        share,
        np.clip(np.nan_to_num(view.residual) / 2.0, -1.0, 1.0),
        np.clip(np.nan_to_num(view.residual) / (3.0 * view.margin), -1.0, 1.0),
        np.clip(view.apart, 0.0, 1.0),
        stands.height,
        lengths(points - frame.sensor) / 10.0,
        np.nan_to_num(view.cosine, nan=1.0),
    ]
    of_surface = fractions(_rays_of(view.count, surface)[surface])
    columns = [*own, pool >= 0, *_of_pools(view, stands, pool), of_surface, *_of_columns(view, stands)]
    return np.column_stack(columns).astype(np.float32)


def _heights(view: View, frame: Frame) -> Heights:
    """Where each point is between the floor and the ceiling above it."""
    points = np.asarray(view.points, np.float64)
    levels = np.tile((frame.floor, frame.ceiling), (len(points), 1)) if view.levels is None else view.levels
    floor, ceiling = levels.T
    height = ceiling - floor
    below, above = (gap / height for gap in _visible_gaps(points, levels, frame))
    return Heights((points[:, 2] - floor) / height, below, above)


def _groups(view: View, surfaces: Surfaces | None) -> tuple[np.ndarray, np.ndarray]:
    """Number (N,) of the surface and of the pool that each point is of, the latter -1 for points in none."""
    known = view.element >= 0
    if known.all():
        return view.element, view.element
    near = neighbourhood_of(np.asarray(view.points, np.float64), surfaces)
    first = view.element.max(initial=-1) + 1
    surface = np.where(known, view.element, pools_of(near, ~known) + first)
    unexplained = pools_of(near, ~known & (fractions(view.count)[:, SUPPORT] < EXPLAINED))
    return surface, np.where(known, view.element, np.where(unexplained >= 0, unexplained + first, -1))


def _rays_of(count: np.ndarray, group: np.ndarray) -> np.ndarray:
    """Rays (G, 4) of each group, numbered from 0."""
    return np.column_stack([np.bincount(group, count[:, side]) for side in range(4)])


def _of_pools(view: View, stands: Heights, pool: np.ndarray) -> list[np.ndarray]:
    """Columns of each point's pool, from its fractions to its width; (N,) or (N, 4)."""
    count = len(pool)
    if not (pool >= 0).any():
        return [np.zeros((count, 4)), *(np.zeros(count) for _ in range(7))]
    _, number = np.unique(pool[pool >= 0], return_inverse=True)
    inside = pool >= 0
    rays = _rays_of(view.count[inside], number)
    low, high = _extremes(number, stands.height[inside])
    length, width = _extents(number, np.asarray(view.points, np.float64)[inside, :2])
    told = [
        fractions(rays),
        np.log10(1.0 + rays.sum(axis=1)) / 4.0,
        low,
        high,
        _extremes(number, stands.below[inside])[0],
        _extremes(number, stands.above[inside])[0],
        np.minimum(length / 5.0, 1.0),
        np.minimum(width, 1.0),
    ]
    return [_spread(values[number], inside) for values in told]


def _of_columns(view: View, stands: Heights) -> list[np.ndarray]:
    """Lowest and highest candidate of each candidate's column, and what it leaves free above; (N,) each."""
    inside = view.candidate
    if not inside.any():
        return [np.zeros(len(inside)) for _ in range(3)]
    places = np.asarray(view.points, np.float64)[inside, :2]
    _, number = np.unique(np.floor(places / COLUMN), axis=0, return_inverse=True)
    number = number.ravel()
    told = [*_extremes(number, stands.height[inside]), _extremes(number, stands.above[inside])[0]]
    return [_spread(values[number], inside) for values in told]


def _visible_gaps(points: np.ndarray, levels: np.ndarray, frame: Frame) -> tuple[np.ndarray, np.ndarray]:
    """How far each point is from the lowest and the highest place that could be seen below and above it [m]."""
    offset = points - frame.sensor
    level, cell = np.hypot(offset[:, 0], offset[:, 1]), _azimuth_cell(offset)
    top, bottom = (np.nan_to_num(slope[cell], nan=0.0, posinf=1e6, neginf=-1e6) for slope in (frame.top, frame.bottom))
    floor, ceiling = levels.T
    highest = np.minimum(ceiling, frame.sensor[2] + level * top)
    lowest = np.maximum(floor, frame.sensor[2] + level * bottom)
    return np.maximum(points[:, 2] - lowest, 0.0), np.maximum(highest - points[:, 2], 0.0)


def _azimuth_cell(offset: np.ndarray) -> np.ndarray:
    turn = (np.arctan2(offset[:, 1], offset[:, 0]) + np.pi) / (2 * np.pi)
    return np.minimum((turn * AZIMUTHS).astype(np.int64), AZIMUTHS - 1)


def _extremes(number: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Least and greatest value of each group; groups are numbered from 0 without gaps."""
    order = np.argsort(number, kind="stable")
    start = np.searchsorted(number[order], np.arange(number.max() + 1))
    return np.minimum.reduceat(values[order], start), np.maximum.reduceat(values[order], start)


def _extents(number: np.ndarray, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Length and width [m] of each group's footprint: edges of the rectangle with the same second moments."""
    size = np.bincount(number)
    mean = np.column_stack([np.bincount(number, axis) / size for axis in places.T])
    x, y = (places - mean[number]).T
    xx, yy, xy = (np.bincount(number, values) / size for values in (x * x, y * y, x * y))
    middle, apart = (xx + yy) / 2, np.sqrt(np.square((xx - yy) / 2) + np.square(xy))
    return np.sqrt(12.0 * (middle + apart)), np.sqrt(12.0 * np.maximum(middle - apart, 0.0))


def _spread(values: np.ndarray, inside: np.ndarray) -> np.ndarray:
    """Values of the chosen points, and 0 for all others."""
    spread = np.zeros((len(inside), *values.shape[1:]))
    spread[inside] = values
    return spread
