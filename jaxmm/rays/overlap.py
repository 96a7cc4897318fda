"""Refuses two clouds that cannot be of one place: by units, and by overlap. N, M points, world frame, metres."""

import numpy as np
from scipy.spatial import cKDTree

from jaxmm.inputs import InputError

NEAR = 0.5  # [m] points of one cloud this close to the other's overlap with it
LEAST_OVERLAP = 0.05  # share of the scan's points, below which the two are not of one place
UNITS = {1e3: "millimetres", 1e2: "centimetres", 1 / 0.3048: "feet", 1 / 0.0254: "inches"}
ALIKE = 1.6  # two spans are of one unit when neither is that many times the other once the unit is taken off
CLEARLY = 0.3  # so much more of the scan must overlap in another unit, to say that it is of that
LEAST_SPAN = 0.5  # [m] no scan of a room is smaller
_THIN = 4000


def check_pair(prior: np.ndarray, scan: np.ndarray) -> None:
    """Refuse clouds that are of different units, or of different places.

    Args:
        prior: (N, 3).
        scan: (M, 3) of the robot.

    Raises:
        InputError: one line that says by how much.
    """
    spans = _span(prior), _span(scan)
    ratio = max(spans) / max(min(spans), 1e-9)
    share = max(_overlap(prior, scan), _overlap(scan, prior))  # either may be a small part of the other
    here = share >= LEAST_OVERLAP and min(spans) > LEAST_SPAN
    larger = "the scan" if spans[1] > spans[0] else "the prior"
    for factor, unit in UNITS.items():
        scaled = scan / factor if spans[1] > spans[0] else scan * factor
        if 1 / ALIKE < ratio / factor < ALIKE and (not here or _overlap(prior, scaled) > share + CLEARLY):
            told = f"the scan spans {spans[1]:.4g} and the prior {spans[0]:.4g}"
            raise InputError(f"{told}, so {larger} seems to be in {unit}; expected metres in both")
    if here:
        return
    raise InputError(f"expected a scan of the prior's place, got {share:.1%} of its points within {NEAR:g} m of it")


def _span(points: np.ndarray) -> float:
    """Diagonal of the box that holds all but the outermost hundredth of the points."""
    low, high = np.percentile(points, [1.0, 99.0], axis=0)
    return float(np.linalg.norm(high - low))


def _overlap(prior: np.ndarray, scan: np.ndarray) -> float:
    """Share of the scan's points that lie near the prior's."""
    step = max(1, len(scan) // _THIN)
    apart, _ = cKDTree(prior).query(scan[::step], distance_upper_bound=NEAR)
    return float(np.mean(np.isfinite(apart)))
