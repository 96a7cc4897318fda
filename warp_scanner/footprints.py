"""Rectangles on the floor: how far apart they are, and which of many can stay without touching.

R rooms, N or M rectangles. Plan view of the world frame, metres.
"""

from typing import NamedTuple

import numpy as np

from warp_scanner.scenes import CEILING, FLOOR, GAP, Primitives


class Footprints(NamedTuple):
    """Rectangles of R rooms, N each."""

    center: np.ndarray  # (R, N, 2) [m]
    half_size: np.ndarray  # (R, N, 2) [m] along the own axes
    yaw: np.ndarray  # (R, N) [rad]
    valid: np.ndarray  # (R, N) bool; False marks a gap


def join(*footprints: Footprints) -> Footprints:
    """All rectangles of the same rooms side by side."""
    return Footprints(*(np.concatenate(fields, axis=1) for fields in zip(*footprints, strict=True)))


def of_primitives(primitives: Primitives) -> Footprints:
    """What stands between floor and ceiling, seen from above; a cylinder is the square around it."""
    valid = (primitives.kind != GAP) & (primitives.semantic != FLOOR) & (primitives.semantic != CEILING)
    return Footprints(primitives.center[..., :2], primitives.half_size[..., :2], primitives.yaw, valid)


def gaps(a: Footprints, b: Footprints) -> np.ndarray:
    """Gap between each rectangle of `a` and each of `b` along the best separating axis.

    Returns:
        (R, N, M) float [m]: never more than the true distance, negative where the two overlap, inf beside a gap slot.
    """
    yaw_a, yaw_b = a.yaw[:, :, None], b.yaw[:, None]
    x, y = (b.center[:, None, :, axis] - a.center[:, :, None, axis] for axis in (0, 1))
    half_a = (a.half_size[:, :, None, 0], a.half_size[:, :, None, 1])
    half_b = (b.half_size[:, None, :, 0], b.half_size[:, None, :, 1])
    cosine, sine = np.abs(np.cos(yaw_b - yaw_a)), np.abs(np.sin(yaw_b - yaw_a))
    gap = np.maximum(_axis_gaps(x, y, yaw_a, half_a, half_b, (cosine, sine)),
                     _axis_gaps(x, y, yaw_b, half_b, half_a, (cosine, sine)))  # fmt: skip
    return np.where(a.valid[:, :, None] & b.valid[:, None], gap, np.inf)


def _axis_gaps(x, y, yaw, own, other, turn) -> np.ndarray:
    """The larger gap along the two axes of the rectangle whose yaw and half sizes are `yaw` and `own`."""
    cosine, sine = np.cos(yaw), np.sin(yaw)
    along = np.abs(cosine * x + sine * y) - own[0] - (other[0] * turn[0] + other[1] * turn[1])
    across = np.abs(cosine * y - sine * x) - own[1] - (other[0] * turn[1] + other[1] * turn[0])
    return np.maximum(along, across)


def point_distance(points: np.ndarray, footprints: Footprints) -> np.ndarray:
    """Distance (R, M, N) [m] of points (R, M, 2) to rectangles: 0 inside, inf for gaps."""
    x, y = (points[:, :, None, axis] - footprints.center[:, None, :, axis] for axis in (0, 1))
    cosine, sine = np.cos(footprints.yaw)[:, None], np.sin(footprints.yaw)[:, None]
    along = np.abs(cosine * x + sine * y) - footprints.half_size[:, None, :, 0]
    across = np.abs(cosine * y - sine * x) - footprints.half_size[:, None, :, 1]
    distance = np.hypot(np.maximum(along, 0.0), np.maximum(across, 0.0))
    return np.where(footprints.valid[:, None], distance, np.inf)


def inside(footprints: Footprints, half_extent: np.ndarray) -> np.ndarray:
    """(R, N) bool: the whole rectangle lies within the axis-aligned rectangle of that half size around the origin."""
    cosine, sine = np.abs(np.cos(footprints.yaw)), np.abs(np.sin(footprints.yaw))
    half = footprints.half_size
    reach = np.stack([half[..., 0] * cosine + half[..., 1] * sine, half[..., 0] * sine + half[..., 1] * cosine], -1)
    return np.all(np.abs(footprints.center) + reach <= half_extent, axis=-1)


def thin_out(footprints: Footprints, gap: float, rounds: int = 2) -> np.ndarray:
    """Which rectangles stay so that all that stay are at least `gap` apart; earlier slots go first.

    A rectangle leaves when it crowds an earlier one (Matern's second hard-core process, without a loop over objects);
    later rounds readmit what only crowded others that left.

    Returns:
        (R, N) bool.
    """
    crowded = gaps(footprints, footprints) < gap
    earlier = np.tri(crowded.shape[1], k=-1, dtype=bool)
    stays = np.zeros_like(footprints.valid)
    for _ in range(rounds):
        waiting = footprints.valid & ~stays & ~np.any(crowded & stays[:, None], axis=2)
        stays |= waiting & ~np.any(crowded & earlier & waiting[:, None], axis=2)
    return stays
