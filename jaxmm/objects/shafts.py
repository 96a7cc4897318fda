"""The shaft of a column: what a cluster of points has but for a capital, a plinth and corbels, which are wider.

A box is that of the shaft. n points. World frame: metres, z up. Plan: x and y.
"""

from typing import NamedTuple

import numpy as np

from jaxmm.objects.patches import Patch, Sight, crossings

SLICE = 0.2  # height of what is looked at together
LEAST_IN_SLICE = 3  # points that tell how wide it is
WIDER = 0.1  # that a capital is on either side, at least
WIDEST = 2.5  # capital; what is wider is no column's
MOST_SHAFT = 1.2  # width, as one sees it
LEAST_SLICES = 4  # that are the shaft's
FREE = 0.5  # share of the rays beside a shaft that pass
OUT = 0.45  # that corbels in the plane of a face stick out, at most
NEAREST, EDGE = 0.1, 0.02  # quantiles of places, as errors move the first and the last


class Slices(NamedTuple):
    """How far a thing reaches to either side, height by height (H,)."""

    left: np.ndarray  # [m] NaN where too few points tell
    right: np.ndarray


def shaft_of(sight: Sight, members: np.ndarray, tolerance: float) -> np.ndarray:
    """Those of the points (n,) int of one thing that are a column's shaft; all of them where it is nowhere wider.

    A capital or a base is wider on both sides, as one sees it. What juts out toward the sensor hides the shaft there.

    Args:
        sight: of all points.
        members: of the thing.
        tolerance: [m] of points from a surface.
    """
    points = sight.points[members]
    middle = points[:, :2].mean(axis=0)
    ahead = middle - np.median(sight.origin[members, :2], axis=0)
    ahead = ahead / max(float(np.linalg.norm(ahead)), 1e-6)
    along = np.array([-ahead[1], ahead[0]])
    wider = _is_wider(sight, members, along, tolerance)
    if not wider.any():
        return members
    reach = (points[:, :2] - middle) @ ahead
    juts_out = np.quantile(reach[wider], NEAREST) < np.quantile(reach[~wider], NEAREST) - tolerance
    return members[~wider] if juts_out else members[~_sticks_out(points[:, :2] @ along, wider, tolerance)]


def face_of_shaft(sight: Sight, members: np.ndarray, along: np.ndarray, tolerance: float) -> np.ndarray:
    """Those of the points (n,) int of one face, along (2,), that are a column's, and not of corbels in its plane."""
    wider = _is_wider(sight, members, along, tolerance)
    if not wider.any():
        return members
    return members[~_sticks_out(sight.points[members, :2] @ along, wider, tolerance)]


def _sticks_out(place: np.ndarray, wider: np.ndarray, tolerance: float) -> np.ndarray:
    """(n,) bool: of places along a thing (n,) those beside its shaft, where it is wider.

    None where they go on for more than OUT: a door beside a pier is wider than that, and what is above it is wall.
    """
    low, high = np.quantile(place[~wider], (EDGE, 1.0 - EDGE))
    if place.min() < low - OUT or place.max() > high + OUT:
        return np.zeros(len(place), bool)
    return wider & ((place < low - tolerance) | (place > high + tolerance))


def _is_wider(sight: Sight, members: np.ndarray, along: np.ndarray, tolerance: float) -> np.ndarray:
    """(n,) bool: points at heights at which a thing is wider on both sides, along (2,), than a column's shaft.

    None where one does not look past the shaft beside it: something may just hide how wide the thing is there.
    """
    points, none = sight.points[members], np.zeros(len(members), bool)
    middle, low = points[:, :2].mean(axis=0), float(points[:, 2].min())
    place = (points[:, :2] - middle) @ along
    if np.ptp(place) > WIDEST:
        return none
    level = np.floor((points[:, 2] - low) / SLICE).astype(int)
    slices = _slices(place, level)
    told = np.isfinite(slices.left)
    left, right = (float(np.median(side[told])) if told.any() else np.nan for side in slices)
    if not right - left <= MOST_SHAFT:
        return none
    wider = (slices.left < left - WIDER) & (slices.right > right + WIDER)
    if not wider.any() or (told & ~wider).sum() < max(LEAST_SLICES, wider.sum()):
        return none
    run = _longest_run(~wider)
    heights = tuple(low + SLICE * one + way * tolerance for one, way in zip(run, (1.0, -1.0), strict=True))
    for edge, end in ((left, np.nanmin(slices.left)), (right, np.nanmax(slices.right))):
        start = edge + np.sign(end - edge) * 2.0 * tolerance
        patch = Patch(middle + along * start, middle + along * end, *heights)
        if crossings(sight, patch, tolerance).free <= FREE:
            return none
    of_told = np.flatnonzero(told)  # a height where few points tell is as the nearest where more do
    return wider[of_told[np.abs(level[:, None] - of_told).argmin(axis=1)]]


def _slices(place: np.ndarray, level: np.ndarray) -> Slices:
    count = int(level.max()) + 1
    left, right = np.full(count, np.inf), np.full(count, -np.inf)
    np.minimum.at(left, level, place)
    np.maximum.at(right, level, place)
    few = np.bincount(level, minlength=count) < LEAST_IN_SLICE
    left[few] = right[few] = np.nan
    return Slices(left, right)


def _longest_run(marked: np.ndarray) -> tuple[int, int]:
    """Where the longest run of what is marked begins, and where it has ended."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], marked, [False]])))
    begin, end = edges[::2], edges[1::2]
    longest = int(np.argmax(end - begin))
    return int(begin[longest]), int(end[longest])
