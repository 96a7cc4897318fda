"""From a raw scan to the cloud that a network sees: filter objects, thin to voxels, measure distances, move copies.

N and M points, world frame, metres, z up. Functions return masks and indices rather than clouds, so that labels and
elements can follow their points.
"""

from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

MAX_TURN = np.pi / 2  # [rad] of an augmentation
MAX_SHIFT = 5.0  # [m] of an augmentation, along each axis
FLOOR_TOLERANCE = 0.1  # [m] median height of what still counts as floor or ceiling
EQUALLY_NEAR = 1e-6  # [voxels] difference of two distances that counts as none


class Rigid(NamedTuple):
    """A turn about the world origin, then a shift."""

    rotation: np.ndarray  # (3, 3) float64
    translation: np.ndarray  # (3,) float64 [m]

    def apply(self, points: np.ndarray) -> np.ndarray:
        """Moved points, (N, 3) float32; computed in float64, so that distances survive to float32's rounding."""
        return (np.asarray(points, np.float64) @ self.rotation.T + self.translation).astype(np.float32)


def object_filter(
    points: np.ndarray,
    element: np.ndarray,
    floor: float,
    ceiling: float,
    threshold: float = 2.0,
    tolerance: float = FLOOR_TOLERANCE,
) -> np.ndarray:
    """Where points belong to structure rather than furniture, judged by each element's height alone.

    An element stays when its top reaches `threshold` above the floor, or when its median height lies within
    `tolerance` of floor or ceiling.

    Args:
        points: (N, 3) [m].
        element: (N,) int, the object that each point was measured on.
        floor: height of the floor [m].
        ceiling: height of the ceiling [m].
        threshold: [m] above the floor.
        tolerance: [m].

    Returns:
        (N,) bool, True where the point stays.

    Raises:
        ValueError: shapes disagree.
    """
    points, element = _check_points(points), np.asarray(element)
    if element.shape != points.shape[:1]:
        raise ValueError(f"element must be ({len(points)},), got {element.shape}")
    if not len(points):
        return np.zeros(0, bool)
    index = _numbered(element)
    counts = np.bincount(index)
    # Sorted by element: each is one run.
    height = points[np.argsort(index, kind="stable"), 2]
    end = np.cumsum(counts)
    stays = np.maximum.reduceat(height, end - counts) - floor >= threshold
    for low in np.flatnonzero(~stays):  # only these need their median
        count = counts[low]
        middle = np.partition(height[end[low] - count : end[low]], [(count - 1) // 2, count // 2])
        median = (middle[(count - 1) // 2] + middle[count // 2]) / 2
        stays[low] = min(abs(median - floor), abs(median - ceiling)) <= tolerance
    return stays[index]


def _numbered(element: np.ndarray) -> np.ndarray:
    """(N,) the elements numbered from 0 without gaps; in 16 bits where they fit, which NumPy sorts far faster."""
    low, high = int(element.min()), int(element.max())
    if high - low < 2**16:
        there = np.bincount((element - low).astype(np.uint16))
        return (np.cumsum(there > 0) - 1).astype(np.uint16)[element - low]
    return np.unique(element, return_inverse=True)[1]


def structural_filter(semantic: np.ndarray, structure: tuple[int, ...]) -> np.ndarray:
    """Where points lie on one of the semantic classes `structure`; (N,) bool. Needs a simulator's or a model's ids."""
    return np.isin(semantic, structure)


def voxel_downsample(points: np.ndarray, size: float = 0.1) -> np.ndarray:
    """Choose one real point per voxel: the one nearest to the mean of its voxel, the lowest index among equals.

    Voxels are cubes centred on multiples of `size`, so a wall that stands on a multiple never splits into two layers.
    Permuted points give the same choice, but where several are equally near to the mean, as in every voxel with two
    points: then whichever comes first.

    Args:
        points: (N, 3) [m], finite.
        size: edge of a voxel [m].

    Returns:
        (V,) int64 indices into `points`, ascending, one per occupied voxel.

    Raises:
        ValueError: wrong shape, points that are not finite, size not above zero, or too small for the cloud's extent.
    """
    points = _check_points(points)
    if not size > 0:
        raise ValueError(f"size must be above 0 m, got {size}")
    if not len(points):
        return np.zeros(0, np.int64)
    cell = np.floor(points / size + 0.5)
    low = cell.min(axis=0)
    span = cell.max(axis=0) - low + 1
    if np.prod(span) >= 2.0**62:
        raise ValueError(f"size {size} m is too small for points that span {np.ptp(points, axis=0).max():.6g} m")
    x, y, z = (cell - low).astype(np.int64).T
    key = (x * int(span[1]) + y) * int(span[2]) + z
    order = np.argsort(key, kind="stable")  # within a voxel the order of indices stays
    start = np.flatnonzero(np.diff(key[order], prepend=-1))
    counts = np.diff(start, append=len(points))
    # Coordinates within the voxel: means of large world coordinates would lose digits.
    local = (points - cell * size)[order]
    mean = np.add.reduceat(local, start) / counts[:, None]
    apart = np.linalg.norm(local - np.repeat(mean, counts, axis=0), axis=1)
    # Two points alone in a voxel are equally near to their mean; rounding must not choose between them.
    nearest = apart <= np.repeat(np.minimum.reduceat(apart, start), counts) + EQUALLY_NEAR * size
    voxel = np.repeat(np.arange(len(start)), counts)[nearest]
    first = np.diff(voxel, prepend=-1) > 0
    return np.sort(order[nearest][first])


def outlier_mask(points: np.ndarray, neighbours: int = 20, std: float = 2.0) -> np.ndarray:
    """Where points stand unusually alone (statistical outlier removal, Rusu et al., 2008; Open3D's, but for copies).

    A point's spacing is its mean distance to its `neighbours` nearest points, itself counted as the first. It is an
    outlier when that exceeds the cloud's mean spacing by `std` standard deviations, or is zero (all copies of one).

    Returns:
        (N,) bool, True on outliers.

    Raises:
        ValueError: wrong shape, fewer than two neighbours, or std not above zero.
    """
    points = _check_points(points)
    if neighbours < 2 or not std > 0:
        raise ValueError(f"neighbours must be >= 2 and std > 0, got {neighbours} and {std}")
    if len(points) < 2:
        return np.zeros(len(points), bool)
    distance, _ = cKDTree(points).query(points, k=min(neighbours, len(points)))
    spacing = distance.mean(axis=1)
    apart = spacing[spacing > 0]
    if len(apart) < 2:
        return spacing == 0
    return (spacing == 0) | (spacing >= apart.mean() + std * apart.std(ddof=1))


def nearest_distance(points: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Distance of each point to the nearest of `other`.

    Args:
        points: (N, 3) [m].
        other: (M, 3) [m], M >= 1.

    Returns:
        (N,) float32 [m], searched and measured in float64.

    Raises:
        ValueError: wrong shape, points that are not finite, or no other points.
    """
    points, other = _check_points(points), _check_points(other, "other")
    if not len(other):
        raise ValueError("other must have at least one point, got none")
    return cKDTree(other).query(points)[0].astype(np.float32)


def augmentations(rng: np.random.Generator) -> tuple[Rigid, Rigid, Rigid]:
    """The thesis's three moves of one pair: a turn, a shift, and that turn with that shift.

    The turn is by up to 90 degrees either way about a random one of the world axes x, y, z; the shift is up to 5 m
    along each.
    """
    axis = int(rng.integers(3))
    angle = rng.uniform(-MAX_TURN, MAX_TURN)
    shift = rng.uniform(-MAX_SHIFT, MAX_SHIFT, 3)
    first, second = (axis + 1) % 3, (axis + 2) % 3
    turn = np.eye(3)
    turn[first, first] = turn[second, second] = np.cos(angle)
    turn[second, first], turn[first, second] = np.sin(angle), -np.sin(angle)
    return Rigid(turn, np.zeros(3)), Rigid(np.eye(3), shift), Rigid(turn, shift)


def _check_points(points: np.ndarray, name: str = "points") -> np.ndarray:
    points = np.asarray(points, np.float64)
    if points.ndim != 2 or points.shape[1] != 3:
        raise ValueError(f"{name} must be (N, 3), got {points.shape}")
    if not np.isfinite(points).all():
        raise ValueError(f"{name} must be finite, got {np.count_nonzero(~np.isfinite(points))} values that are not")
    return points
