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
# Units that scans are read in only where somebody says so.
OTHER_UNITS = {0.1: "decimetres", 0.9144: "yards", 1.0: "metres"}
SHORTEST, LONGEST, STEP, FINER = 2e-4, 50.0, 0.015, 3  # [m] of units that are tried, in steps, and these by an eighth
FEWER = 1000  # points that tell which
CLOSELY = 0.01  # by which a factor may differ from a unit's, to name that
_THIN = 4000

Distance = Callable[[np.ndarray, float], np.ndarray]  # points (N, 3) [m], reach [m] -> (N,) [m] to the prior, or inf


class Fit(NamedTuple):
    """How a scan lies on the prior."""

    unit: float  # [m] of its coordinates
    share: float  # of its points, within NEAR of the prior
    on: float  # of its points, within ON of it
    height: float  # [m] of those, see `height`

    @property
    def upright(self) -> float:
        """`on`, of what is no mere floor: drawn together, all points of a scan come near one surface."""
        return self.on if self.height > LEAST_HEIGHT else 0.0


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


def unit_that_fits(points: np.ndarray, distance: Distance) -> Fit:
    """How a scan lies on the prior in the unit of any length in which most of it does.

    Args:
        points: (N, 3) as in the file, z up.
        distance: to the prior's surface.
    """
    points = points[:: max(1, len(points) // FEWER)]
    units = np.exp(np.arange(np.log(SHORTEST), np.log(LONGEST), STEP))
    fits = [_fit(points, distance, float(unit)) for unit in units]
    about = max(fits, key=lambda fit: (fit.upright, fit.on))
    units = about.unit * np.exp(np.linspace(-FINER * STEP, FINER * STEP, 8 * FINER + 1))
    apart = [np.minimum(distance(points * unit, NEAR), ON).mean() for unit in units]
    return _fit(points, distance, float(units[np.argmin(apart)]))


def scale_in_words(factor: float, unit: float = 1.0) -> str:
    """At which size a scan fits: a factor times the one that it has in a unit [m]."""
    told = f"{float(f'{factor:.3g}'):.15g}"  # 1000, not 1e+03
    return f"at {told} times its size: {_asked(factor * unit)}"


def _asked(unit: float) -> str:
    """What a user is asked about a unit [m] that fits."""
    named = {**UNITS, **OTHER_UNITS}
    near = next((length for length in named if abs(unit / length - 1.0) < CLOSELY), None)
    if near is None:
        return f"check its unit (--unit {unit:.4g} would fit), and that of the prior (--prior-unit)"
    return f"are its units {named[near]} (--unit {near:g})?"


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
