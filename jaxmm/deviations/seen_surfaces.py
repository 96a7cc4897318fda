"""What was seen of elements' surfaces: how flat it is, how much is within the tolerance, how far off its ends are."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from jaxmm.deviations.element_motion import NORMAL, Motion, Seen
from jaxmm.deviations.fits import CELL, UNKNOWN_SLOPE
from jaxmm.deviations.heights import Heights
from jaxmm.deviations.pose_errors import PoseError, rows_of


class Faces(NamedTuple):
    """What one scan shows of the faces of the elements; small, whatever the scan."""

    sensor: np.ndarray  # (3,) float64 [m]
    poses: list[PoseError]  # how far off it may be, the likeliest first
    seen: list[Seen]
    heights: Heights  # at which its rays end on them, or pass
    ends: np.ndarray = np.zeros(0, np.int64)  # rows of walls that it meets at their ends alone
    unlikely: Sequence[PoseError] = ()  # how far off it may be only if other scans tell so


def surface_of(seen: list[Seen], pose: int, tolerance: float) -> tuple[float, float, float]:
    """Flatness [m]; 95 % of its places are so near to the model [m]; area [m2] seen that is within the tolerance.

    `pose` is 0 with the likeliest of each scan, 1 with those that they have.
    """
    faces = [one for one in seen if one.fit.first]
    cells = []
    for one in faces:
        within = np.abs(one.off[pose]) <= tolerance
        cells.append(np.column_stack([np.full(within.sum(), one.group), one.cell[within]]))
    covered = len(np.unique(np.concatenate(cells), axis=0)) * CELL**2
    apart, offs = [one.apart for one in faces], [np.abs(one.off[pose]) for one in faces]
    # Values that were measured: what lies between two of them, of few, holds less than the share.
    flatness, worst = (
        float(np.quantile(np.concatenate(all_of), 0.95, method="inverted_cdf")) for all_of in (apart, offs)
    )
    return flatness, worst, covered


def ends_of(seen: list[Seen], motion: Motion, middle: np.ndarray, pose: int, half: float) -> float:
    """`worst`: what a twentieth of some face is surely off, and `half`; 0 [m] where none surely is.

    Of faces as they were fitted, for ranges that err displace nothing. The errors of slopes add to those of the middle:
    of all that tells how the element is turned, about its middle (3,) [m], and how the pose is.
    """
    least = 0.0
    for one in (one for one in seen if one.fit.first):
        slopes = rows_of(one.fit, middle)[1][1:]
        known = np.diag(one.fit.variance)[1:] < (UNKNOWN_SLOPE / 2.0) ** 2
        errors = np.sqrt(np.einsum("ij,jk,ik->i", slopes, motion.covariance, slopes))
        ends = np.where(known, 2.0 * one.fit.extent * errors, 0.0)
        error = float(np.hypot(half, NORMAL * np.linalg.norm(ends)))
        least = max(least, float(np.percentile(np.abs(one.face[pose]), 95.0)) - error)
    return least + half if least > 0.0 else 0.0
