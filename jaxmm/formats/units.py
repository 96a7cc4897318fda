"""In which unit a scan is, told by where it comes to lie: against the prior, metres fit or something else does.

N points of a scan.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

NEAR = 0.5  # [m] points this close to the prior overlap with it
LEAST_OVERLAP = 0.05  # share of points, below which a scan is not of the prior's place
ON = 0.1  # [m] points this close to the prior lie on it
CLEARLY = 0.3  # so much more of a scan must lie on the prior in another unit, to be of that
LEAST_HEIGHT = 1.0  # [m] of what lies on the prior, to tell a unit by it
TALLEST = 500.0  # [m] no scan is higher
FITS = 0.5  # share of points from which another unit fits
UNITS = {0.001: "millimetres", 0.01: "centimetres", 0.0254: "inches", 0.3048: "feet"}
_THIN = 4000

Distance = Callable[[np.ndarray, float], np.ndarray]  # points (N, 3) [m], reach [m] -> (N,) [m] to the prior, or inf


class Fit(NamedTuple):
    """How a scan lies on the prior."""

    unit: float  # [m] of its coordinates
    share: float  # of its points, within NEAR of the prior
    on: float  # of its points, within ON of it
    height: float  # [m] of those, see `height`


def fit_of(points: np.ndarray, distance: Distance, unit: float | None = None) -> Fit:
    """How a scan lies on the prior in its unit: metres, unless it clearly fits in another.

    Args:
        points: (N, 3) as in the file, z up.
        distance: to the prior's surface.
        unit: [m] if it is known.
    """
    points = thinned(points)
    told = _fit(points, distance, 1.0 if unit is None else unit)
    if unit is not None or told.share >= FITS:
        return told
    # Drawn together, all points come near the prior, but surfaces lie on surfaces in the right unit alone; unless what
    # lies there is flat, as wide ground around any building then lies on its floor.
    others = [fit for fit in (_fit(points, distance, factor) for factor in UNITS) if fit.height > LEAST_HEIGHT]
    best = max(others, key=lambda fit: fit.on, default=told)
    if height(points) > TALLEST:  # no metres, however little of it lies anywhere
        return best if best.on > told.on and best.share >= LEAST_OVERLAP else told
    return best if best.on > told.on + CLEARLY and best.share >= FITS else told


def height(points: np.ndarray) -> float:
    """Between 2 and 98 % of the points (N, 3), in their unit; 0 of none. Ground and birds around add nothing."""
    if not len(points):
        return 0.0
    low, high = np.percentile(thinned(points)[:, 2], [2, 98])
    return float(high - low)


def thinned(points: np.ndarray) -> np.ndarray:
    """Some thousand of the points (N, 3), which tell as much of a whole scan."""
    return points[:: max(1, len(points) // _THIN)]


def _fit(points: np.ndarray, distance: Distance, unit: float) -> Fit:
    points = points * unit
    apart = distance(points, NEAR)
    on = apart < ON
    return Fit(unit, float(np.mean(apart < NEAR)), float(np.mean(on)), height(points[on]))
