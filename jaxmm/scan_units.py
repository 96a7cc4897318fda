"""In which unit a scan is, told by where it comes to lie: against the prior, metres fit or something else does.

N points of a scan.
"""

from collections.abc import Callable

import numpy as np

from jaxmm.inputs import InputError

NEAR = 0.5  # [m] points this close to the prior overlap with it
LEAST_OVERLAP = 0.05  # share of points, below which a scan is not of the prior's place
ON = 0.1  # [m] points this close to the prior lie on it
CLEARLY = 0.3  # so much more of a scan must lie on the prior in another unit, to be of that
LEAST_SPAN = 2.0  # [m] diagonal of the smallest scan of a room
FITS = 0.5  # share of points from which another unit, or axis, fits
UNITS = {0.001: "millimetres", 0.01: "centimetres", 0.0254: "inches", 0.3048: "feet"}
_THIN = 4000

Distance = Callable[[np.ndarray, float], np.ndarray]  # world points (N, 3) [m], reach [m] -> (N,) [m] to the prior


def unit_of(points: np.ndarray, distance: Distance) -> tuple[float, str | None]:
    """Length [m] of a scan's unit, and its name where it is not the metre.

    Args:
        points: (N, 3) as in the file.
        distance: to the prior's surface.

    Raises:
        InputError: it does not lie on the prior in any unit.
    """
    share, on = overlap(points, distance), overlap(points, distance, ON)
    span = float(np.linalg.norm(np.ptp(points, axis=0)))
    # Drawn together, all points come near the prior, but surfaces lie on surfaces in the right unit alone.
    others = {factor: overlap(points * factor, distance, ON) for factor in UNITS if factor * span > LEAST_SPAN}
    if others and share < FITS:
        best = max(others, key=others.__getitem__)
        if others[best] > on + CLEARLY and overlap(points * best, distance) >= FITS:
            return best, UNITS[best]
    if share < LEAST_OVERLAP:
        raise InputError(
            f"expected a scan of the prior's place, got {share:.1%} of its points within {NEAR:g} m of it; check that "
            "both are in one frame (--frame), and their units (--unit, --prior-unit) and axes (--up)"
        )
    return 1.0, None


def overlap(points: np.ndarray, distance: Distance, near: float = NEAR) -> float:
    """Share of the points (N, 3) [m] within `near` [m] of the prior."""
    step = max(1, len(points) // _THIN)
    return float(np.mean(distance(points[::step], near) < near))
