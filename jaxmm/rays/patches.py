"""Flat pieces of what one scan sees: all that is kept of it where many scans are laid upon each other.

K patches of a scan. Positions are offsets from the prior's origin, world axes: metres, z up.
"""

from typing import NamedTuple

import numpy as np

from jaxmm.rays.scan_rays import drawn

SIZE = 0.4  # [m] edge of the cells of which each gives one patch at most
LEAST = 12  # points of a patch
THIN, WIDE = 0.02, 0.05  # [m] standard deviations of its points: off its plane at most, and along it at least
MOST = 800  # patches of a scan


class Patches(NamedTuple):
    """What one scan sees of flat surfaces; small, whatever the scan."""

    middle: np.ndarray  # (K, 3) float64 [m]
    normal: np.ndarray  # (K, 3) float64 unit vectors, toward the sensor


def patches_of(points: np.ndarray, sensor: np.ndarray) -> Patches:
    """The flat pieces of a scan, by principal axes of the points of each cell (Pauly, Gross and Kobbelt 2002).

    Args:
        points: (N, 3) [m]; of many as many as `scan_rays` draws.
        sensor: (3,) [m] where they are seen from.
    """
    points = drawn(points, sensor)
    if not len(points):
        return Patches(np.zeros((0, 3)), np.zeros((0, 3)))
    x, y, z = np.floor((points - points.min(axis=0)) / SIZE).astype(np.int64).T
    _, number, count = np.unique((x * (y.max() + 1) + y) * (z.max() + 1) + z, return_inverse=True, return_counts=True)

    def mean(values: np.ndarray) -> np.ndarray:
        return np.bincount(number, values) / count

    middle = np.stack([mean(values) for values in points.T], axis=1)
    away = points - middle[number]
    spread = np.zeros((len(count), 3, 3))
    for row, column in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)):
        spread[:, row, column] = spread[:, column, row] = mean(away[:, row] * away[:, column])
    kept = np.flatnonzero(count >= LEAST)
    square, axes = np.linalg.eigh(spread[kept])
    flat = (square[:, 0] <= THIN**2) & (square[:, 1] >= WIDE**2)
    middle, normal = middle[kept[flat]], axes[flat, :, 0]
    normal = normal * np.where(np.einsum("kc,kc->k", normal, sensor - middle) < 0.0, -1.0, 1.0)[:, None]
    every = -(-len(middle) // MOST) or 1
    return Patches(middle[::every], normal[::every])
