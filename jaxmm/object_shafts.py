"""The shaft of a column: what a cluster of points has but for a capital, a plinth and corbels, which are wider.

A box is that of the shaft. n points. World frame: metres, z up. Plan: x and y.
"""

from typing import NamedTuple

import numpy as np

from jaxmm.object_sight import Patch, Sight, crossings

SLICE = 0.2  # height of what is looked at together
LEAST_IN_SLICE = 3  # points that tell how wide it is
WIDER = 0.1  # that a capital is on either side, at least
WIDEST = 2.5  # capital; what is wider is no column's
MOST_SHAFT = 1.2  # width, as one sees it
LEAST_SLICES = 4  # that are the shaft's
FREE = 0.5  # share of the rays beside a shaft that pass


class Slices(NamedTuple):
    """How far a thing reaches to either side, height by height (H,)."""

    left: np.ndarray  # [m] NaN where too few points tell
    right: np.ndarray


def shaft_of(sight: Sight, members: np.ndarray, tolerance: float, along: np.ndarray | None = None) -> np.ndarray:
    """Those of some points (n,) int that are a column's shaft; all of them where it is nowhere wider.

    What is wider on both sides at some heights is no shaft, if one looks past the shaft beside it: else something may
    just hide how wide the thing is there.

    Args:
        sight: of all points.
        members: of one thing, or of one face of it.
        tolerance: [m] of points from a surface.
        along: (2,) unit vector of the face; None: what is wide is as one sees it.
    """
    points = sight.points[members]
    middle = points[:, :2].mean(axis=0)
    in_plane = along is not None
    if not in_plane:
        ahead = middle - np.median(sight.origin[members, :2], axis=0)
        along = np.array([-ahead[1], ahead[0]]) / max(float(np.linalg.norm(ahead)), 1e-6)
    place, low = (points[:, :2] - middle) @ along, float(points[:, 2].min())
    if np.ptp(place) > WIDEST:
        return members
    level = np.floor((points[:, 2] - low) / SLICE).astype(int)
    slices = _slices(place, level)
    left, right = (float(np.nanmedian(side)) if np.isfinite(side).any() else np.nan for side in slices)
    if not right - left <= MOST_SHAFT:
        return members
    wider = (slices.left < left - WIDER) & (slices.right > right + WIDER)
    told = np.isfinite(slices.left)
    if not wider.any() or (told & ~wider).sum() < max(LEAST_SLICES, wider.sum()):
        return members
    run = _longest_run(~wider)
    heights = tuple(low + SLICE * one + way * tolerance for one, way in zip(run, (1.0, -1.0), strict=True))
    for edge, end in ((left, np.nanmin(slices.left)), (right, np.nanmax(slices.right))):
        start = edge + np.sign(end - edge) * 2.0 * tolerance
        patch = Patch(middle + along * start, middle + along * end, *heights)
        if crossings(sight, patch, tolerance).free <= FREE:
            return members
    of_told = np.flatnonzero(told)  # a height where few points tell is as the nearest where more do
    out = wider[of_told[np.abs(level[:, None] - of_told).argmin(axis=1)]]
    if in_plane:  # as one sees it, a capital is before the shaft, too
        out &= (place < left - tolerance) | (place > right + tolerance)
    return members[~out]


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
