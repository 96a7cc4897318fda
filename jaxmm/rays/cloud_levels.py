"""Which floor and which ceiling the place of a sensor has in a cloud: those of the storey about it, in view or not.

M points of a prior, N of a view. Positions are offsets from the prior's origin, world axes: metres, z up.
"""

from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from jaxmm.rays.cloud_evidence import LEVELS
from jaxmm.rays.pools import normals_of
from warp_scanner.clouds.voxels import thin_clouds

NEAR = 6.0  # [m] beside a sensor, where its floor and its ceiling are looked for
VOXEL = 0.1  # [m] edge of the cells in which a surface counts once, however dense its points are
LEVEL = 0.9  # least share of z in the normal of what one may walk on, or under
BIN = 0.1  # [m] of the histogram of heights
LEAST_CELLS = 50  # of a floor or a ceiling, half a square metre
STANDING = (0.1, 2.5)  # [m] least and most height of a sensor above its floor
LEAST_STOREY = 1.8  # [m] from a floor to its ceiling: what is lower is a table
WIDE = 0.3  # of the cells of the widest surface above or below: no shelf and no lamp has as many
SLOPE = 0.4  # [m] of heights beyond which a ceiling slopes, and its highest places count
GAP = 0.08  # [m] of heights without any surface, that parts a ceiling from what is above
HIGHER_THAN_FURNITURE = 2.25  # [m]
COLUMN = 0.3  # [m] beside a point, within which something higher stands on it
UNKNOWN = "neither it nor the prior shows a ceiling: whether what is new reaches up to one is not asked"


class CloudLevels(NamedTuple):
    """Heights of a storey, where known."""

    floor: float | None  # [m]
    ceiling: float | None  # [m]


def levels_about(points: np.ndarray, sensor: np.ndarray) -> CloudLevels:
    """The storey about a sensor (3,), by the heights of the near-horizontal surfaces of a cloud (M, 3) around it.

    The floor is the widest surface that a sensor may stand on, or else the highest wide one below; the ceiling is the
    lowest wide one far enough above the floor. None where there is no such surface.
    """
    near = points[np.hypot(*(points[:, :2] - sensor[:2]).T) <= NEAR]
    near = near[thin_clouds([near], VOXEL)[0]].astype(np.float64)
    if len(near) < LEAST_CELLS:
        return CloudLevels(None, None)
    height = near[np.abs(normals_of(near)[0][:, 2]) > LEVEL, 2]
    floor = _floor(height, float(sensor[2]))
    lowest = float(sensor[2]) if floor is None else max(float(sensor[2]), floor + LEAST_STOREY)
    return CloudLevels(floor, _ceiling(height, lowest))


def _counts(height: np.ndarray, low: float) -> np.ndarray:
    """Cells (B,) in each pair of neighbouring bins from `low` [m] on, so that no edge of a bin parts a surface."""
    if not (height >= low).any():
        return np.zeros(0, np.int64)
    each = np.bincount(((height[height >= low] - low) / BIN).astype(int))
    return each + np.append(each[1:], 0)


def _floor(height: np.ndarray, sensor: float) -> float | None:
    below = sensor - height[height <= sensor - STANDING[0]]  # downwards, from the sensor
    for bound, pick in ((below <= STANDING[1], np.argmax), (below > 0.0, None)):
        count = _counts(below[bound], STANDING[0])
        if count.max(initial=0) < LEAST_CELLS:
            continue
        start = STANDING[0] + BIN * (pick(count) if pick else _first_wide(count))
        return sensor - float(np.median(below[(below >= start) & (below <= start + 2 * BIN)]))
    return None


def _ceiling(height: np.ndarray, lowest: float) -> float | None:
    count = _counts(height, lowest)
    if count.max(initial=0) < LEAST_CELLS:
        return None
    first = _first_wide(count)
    wide = count >= WIDE * count.max()
    last = first + int(np.argmin(np.append(wide[first:], False))) - 1
    low, high = lowest + BIN * first, lowest + BIN * (last + 2)
    heights = np.sort(height[(height >= low) & (height <= high)])
    heights = heights[: 1 + np.argmax(np.append(np.diff(heights), np.inf) > GAP)]  # beyond is the next floor
    return float(np.percentile(heights, LEVELS[1]) if np.ptp(heights) > SLOPE else np.median(heights))


def _first_wide(count: np.ndarray) -> int:
    return int(np.argmax(count >= max(WIDE * count.max(), LEAST_CELLS)))


def own_ceilings(points: np.ndarray, others: np.ndarray, levels: tuple[float, float]) -> np.ndarray:
    """Floor and ceiling (N, 2) [m] of points (N, 3) where nobody knows a ceiling: what is highest right there is one.

    Not of what is no higher than furniture: that ends below whatever is highest. `others` (K, 3) may stand on them;
    `levels` are the floor and what is highest of all.
    """
    if not len(points):
        return np.zeros((0, 2))
    cell, number = np.unique(np.floor(others[:, :2] / COLUMN).astype(np.int64), axis=0, return_inverse=True)
    top = np.full(len(cell), -np.inf)
    np.maximum.at(top, number.ravel(), others[:, 2])
    near = cKDTree(cell).query_ball_point(np.floor(points[:, :2] / COLUMN), 1.5)
    highest = np.array([max(top[one].max(initial=-np.inf), z) for one, z in zip(near, points[:, 2], strict=True)])
    is_high = highest >= levels[0] + HIGHER_THAN_FURNITURE
    return np.column_stack([np.full(len(points), levels[0]), np.where(is_high, highest, levels[1])])
