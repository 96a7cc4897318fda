"""Ranges become points: the thin host side of kernels/points.py.

R rooms, P rays, N points. World frame: metres, z up.
"""

from typing import NamedTuple

import numpy as np
import warp as wp

from warp_scanner.kernels import points as kernels
from warp_scanner.launches import load, share, share_out, thread_count
from warp_scanner.sensors.poses import Pose, rotation_of
from warp_scanner.sensors.scan import Scan


class Kept(NamedTuple):
    """What stays of one scan."""

    points: np.ndarray  # (N, 3) float32 [m] world
    pixel: np.ndarray  # (N,) int64 the ray of each point, ascending


def points_of(pose: Pose, directions: np.ndarray, distance: np.ndarray, threads: int | None = None) -> np.ndarray:
    """World points (R, P, 3) float32 [m] of ranges along sensor-frame directions; NaN for misses.

    Args:
        pose: of R sensors.
        directions: (P, 3) unit vectors in the sensor frame.
        distance: (R, P) [m], inf = no return.
        threads: how many to use; by default one for each core it may run on.
    """
    point = np.empty((*np.shape(distance), 3), np.float32)
    scan = _ranges(pose, directions, distance)

    def launch(first: int, count: int) -> None:
        inputs = [first, scan, share(point, wp.vec3)]
        wp.launch(kernels.find_points, dim=count, inputs=inputs, device="cpu")

    share_out(launch, len(point) if point.size else 0, thread_count(threads))
    return point


def tall_points(
    pose: Pose,
    directions: np.ndarray,
    scan: Scan,
    limits: tuple[np.ndarray, np.ndarray, float, float],
    threads: int | None = None,
) -> list[Kept | None]:
    """The returns of objects that reach high, or that are floor or ceiling, room by room.

    An object stays when its highest return is `threshold` or more above the floor, or when the median height of its
    returns lies within `tolerance` of floor or ceiling.

    Args:
        pose: of R sensors.
        directions: (P, 3) unit vectors in the sensor frame.
        scan: (R, P); elements of returns are at least 0.
        limits: heights of floor and ceiling (R,) [m], threshold [m] and tolerance [m].
        threads: how many to use; by default one for each core it may run on.

    Returns:
        For each room what stays. None, rarely, where the median of an object falls between two returns on different
        sides of a limit: it cannot be told from the counts that the kernel takes.

    Raises:
        ValueError: a return has a negative element.
    """
    room_count, ray_count = scan.distance.shape
    if room_count * ray_count == 0:
        return [Kept(np.zeros((0, 3), np.float32), np.zeros(0, np.int64))] * room_count
    if np.any((scan.element < 0) & np.isfinite(scan.distance)):
        raise ValueError("scan must have elements of at least 0 wherever it has a return")
    threads = thread_count(threads)
    ranges = _ranges(pose, directions, scan.distance)
    ranges.element = share(scan.element, wp.int32)
    floor, ceiling, threshold, tolerance = limits
    heights, kept = kernels.Heights(), kernels.Kept()
    heights.floor, heights.ceiling = (share(np.asarray(z, np.float32), wp.float32) for z in (floor, ceiling))
    heights.threshold, heights.tolerance = threshold, tolerance
    shape = (room_count, max(0, int(scan.element.max())) + 1)
    heights.top = share(np.full(shape, -np.inf, np.float32), wp.float32)
    heights.count = wp.zeros((*shape, 5), dtype=wp.int32, device="cpu")
    heights.verdict = wp.empty(shape, dtype=wp.uint8, device="cpu")
    point = np.empty((room_count, ray_count, 3), np.float32)
    pixel = np.empty((room_count, ray_count), np.int64)
    count, unsure = np.empty(room_count, np.int32), np.empty(room_count, bool)
    kept.point, kept.pixel = share(point, wp.vec3), share(pixel, wp.int64)
    kept.count, kept.unsure = share(count, wp.int32), share(unsure, wp.bool)

    def launch(first: int, size: int) -> None:
        wp.launch(kernels.keep_tall, dim=size, inputs=[first, ranges, heights, kept], device="cpu")

    share_out(launch, room_count, threads)
    return [
        None if unsure[room] else Kept(point[room, : count[room]], pixel[room, : count[room]])
        for room in range(room_count)
    ]


def _ranges(pose: Pose, directions: np.ndarray, distance: np.ndarray) -> kernels.Ranges:
    load(kernels)
    ranges = kernels.Ranges()
    ranges.position = share(np.asarray(pose.position, np.float32), wp.vec3)
    ranges.rotation = share(rotation_of(pose.yaw, pose.pitch), wp.mat33)
    ranges.direction = share(np.asarray(directions, np.float32), wp.vec3)
    ranges.distance = share(np.asarray(distance, np.float32), wp.float32)
    return ranges
