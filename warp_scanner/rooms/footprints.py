"""Rectangles on the floor: how far apart they are, and which of many can stay without touching.

R rooms, N or M rectangles. Plan view of the world frame, metres.
"""

from typing import NamedTuple

import numpy as np
import warp as wp

from warp_scanner.kernels import footprints as footprint_kernels
from warp_scanner.launches import load, share
from warp_scanner.scenes.scenes import CEILING, FLOOR, GAP, Primitives


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


def point_distance(point: np.ndarray, footprints: Footprints) -> np.ndarray:
    """Distance (R, N) [m] of one point (R, 2) of each room to the rectangles: 0 inside, inf for gaps."""
    x, y = (point[:, axis, None] - footprints.center[..., axis] for axis in (0, 1))
    cosine, sine = np.cos(footprints.yaw), np.sin(footprints.yaw)
    along = np.abs(cosine * x + sine * y) - footprints.half_size[..., 0]
    across = np.abs(cosine * y - sine * x) - footprints.half_size[..., 1]
    distance = np.hypot(np.maximum(along, 0.0), np.maximum(across, 0.0))
    return np.where(footprints.valid, distance, np.inf)


def inside(footprints: Footprints, half_extent: np.ndarray) -> np.ndarray:
    """(R, N) bool: the whole rectangle lies within the axis-aligned rectangle of that half size around the origin."""
    cosine, sine = np.abs(np.cos(footprints.yaw)), np.abs(np.sin(footprints.yaw))
    half = footprints.half_size
    reach = np.stack([half[..., 0] * cosine + half[..., 1] * sine, half[..., 0] * sine + half[..., 1] * cosine], -1)
    return np.all(np.abs(footprints.center) + reach <= half_extent, axis=-1)


def settle(footprints: Footprints, others: Footprints, gap: float, apart: float, rounds: int = 2) -> np.ndarray:
    """Which rectangles stay, more than `gap` from the others and at least `apart` from each other; the first go first.

    Among those clear of the others, a rectangle leaves when it crowds an earlier one (Matern's second hard-core
    process, without an order of its own); later rounds readmit what only crowded others that left.

    Returns:
        (R, N) bool.
    """
    stays = np.zeros(footprints.valid.shape, bool)
    # The kernel marks what is not clear of the others in its own copy.
    inputs = [*_shared(footprints._replace(valid=footprints.valid.copy())), *_shared(others), gap, apart, rounds]
    _launch(footprint_kernels.settle, len(stays), [*inputs, share(np.zeros_like(stays), wp.bool)], stays, wp.bool)
    return stays


def first_clear(footprints: Footprints, others: Footprints, gap: float) -> np.ndarray:
    """(R,) int32: the first rectangle of each room that is more than `gap` away from all others; -1 where none is."""
    first = np.zeros(len(footprints.valid), np.int32)
    inputs = [*_shared(footprints), *_shared(others), gap]
    _launch(footprint_kernels.first_clear, len(first), inputs, first, wp.int32)
    return first


def first_clear_point(points: np.ndarray, others: Footprints, gap: float) -> np.ndarray:
    """(R,) int32: the first of the points (R, M, 2) that is more than `gap` away from all rectangles, else -1."""
    first = np.zeros(len(points), np.int32)
    rectangles = _shared(others)
    inputs = [share(points.astype(np.float64, copy=False), wp.float64), *rectangles, gap]
    _launch(footprint_kernels.first_clear_point, len(first), inputs, first, wp.int32)
    return first


def _launch(kernel: wp.Kernel, room_count: int, inputs: list, output: np.ndarray, dtype: type) -> None:
    if output.size == 0:
        return
    wp.launch(kernel, dim=room_count, inputs=inputs, outputs=[share(output, dtype)], device="cpu")


def _shared(footprints: Footprints) -> tuple[wp.array, wp.array]:
    """Rectangles as the kernels want them: (R, N, 6) numbers, and (R, N) which are there."""
    load(footprint_kernels)
    packed = np.zeros((*footprints.valid.shape, 6))
    packed[..., 0:2], packed[..., 2:4] = footprints.center, footprints.half_size
    packed[..., 4], packed[..., 5] = np.cos(footprints.yaw), np.sin(footprints.yaw)
    return share(packed, wp.float64), share(footprints.valid, wp.bool)
