"""What several scans say of one place: their log odds are pooled, and one of their points speaks for all.

N points of one side of S scans, K kinds of change. Any frame, metres.
"""

from typing import NamedTuple

import numpy as np

from jaxmm.verdicts.verdicts import MOST_SURE

VOXEL = 0.1  # [m] edge of a place: to that, every scan was thinned


class Visits(NamedTuple):
    """The points of all scans."""

    points: np.ndarray  # (N, 3) [m]
    scan: np.ndarray  # (N,) int of the scan that saw each
    reach: np.ndarray  # (N,) [m] from where it was seen


def fused(visits: Visits, probability: np.ndarray) -> np.ndarray:
    """What all scans together say of each point.

    In a voxel that V scans have points in, it is the sum of their log odds over the root of V: scans that agree are
    surer than each, yet not as sure as strangers would be, for they share the networks, and with those the errors. The
    sum alone would be right of scans from far apart, their mean of scans from one place. Of what is known before any
    scan nothing is taken off: the share of points that change would make two doubts a certainty, as networks do not
    start from it.

    The point nearest to its sensor has what all say, and the others of the voxel have 0: how sure an object is goes by
    how many places speak for it, and none may speak twice. They are kept, since their rays still tell where nothing is.

    Args:
        visits: the points, in any order.
        probability: (N, K) that they changed, by their own scan alone.

    Returns:
        (N, K) of the same dtype; where only one scan was, it is `probability` to the bit.

    Raises:
        ValueError: the shapes disagree.
    """
    points, scan, reach = (np.asarray(field) for field in visits)
    probability, count = np.asarray(probability), len(points)
    if points.shape != (count, 3) or scan.shape != (count,) or reach.shape != (count,) or len(probability) != count:
        shapes = f"{points.shape}, {scan.shape}, {reach.shape}, {probability.shape}"
        raise ValueError(f"points, scan, reach and probability must be (N, 3), (N,), (N,), (N, K), got {shapes}")
    found = probability.copy()
    if not count or (scan == scan[0]).all():
        return found
    place = place_of(points.astype(np.float64))
    visit = place * (scan.max() + 1) + scan
    several = np.bincount(place[np.unique(visit, return_index=True)[1]]) > 1
    rows = np.flatnonzero(several[place])
    # Sums and choices must not depend on the order of points or of scans.
    rows = rows[np.lexsort((*points[rows].T, reach[rows], place[rows]))]
    found[rows] = 0.0
    _, speaker = np.unique(place[rows], return_index=True)
    for kind in range(probability.shape[1]):
        found[rows[speaker], kind] = _pooled(place[rows], visit[rows], probability[rows, kind])
    return found


def place_of(points: np.ndarray) -> np.ndarray:
    """(N,) int: number of the voxel of each point, centred on multiples of its edge as where scans are thinned."""
    cell = np.floor(points / VOXEL + 0.5).astype(np.int64)
    x, y, z = (cell - cell.min(axis=0)).T
    return np.unique((x * (y.max() + 1) + y) * (z.max() + 1) + z, return_inverse=True)[1]


def _pooled(place: np.ndarray, visit: np.ndarray, probability: np.ndarray) -> np.ndarray:
    """By all visits of each place, in the order of the places; points (n,) of one visit speak as their mean."""
    _, first, visit = np.unique(visit, return_index=True, return_inverse=True)
    logit = _logit(np.bincount(visit, probability) / np.bincount(visit))
    _, place = np.unique(place[first], return_inverse=True)
    order = np.lexsort((logit, place))
    total = np.bincount(place[order], logit[order]) / np.sqrt(np.bincount(place))
    return 1.0 / (1.0 + np.exp(-total))


def _logit(probability: np.ndarray) -> np.ndarray:
    with np.errstate(divide="ignore"):
        logit = np.log(probability) - np.log1p(-probability)
    return np.clip(logit, -MOST_SURE, MOST_SURE)
