"""Clouds to measure with: scans of generated rooms, before and after thinning."""

import itertools
from collections.abc import Iterator
from itertools import islice

import numpy as np

from warp_scanner.clouds.points import points_of
from warp_scanner.clouds.voxels import thin_clouds
from warp_scanner.rooms.pairs import PairConfig, make_pairs

NOISE = 0.005  # [m] of the robot's ranges
VOXEL = 0.1  # [m]
ROOMS_AT_ONCE = 32


def scanned_pairs(first: int, count: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """Returns of a DT scan and a robot scan of rooms, (N, 3) float32 [m] each, of a 320 x 200 camera: up to 64,000."""
    pairs = make_pairs(
        PairConfig(scenario="pillar_removed", condition="occluded", range_noise=NOISE), np.arange(first, first + count)
    )
    sides = [points_of(pairs.pose, pairs.directions, scan.distance) for scan in (pairs.dt, pairs.robot)]
    dt, robot = ([points[np.isfinite(points[:, 0])] for points in side] for side in sides)
    return list(zip(dt, robot, strict=True))


def thinned_pairs(count: int, sizes: tuple[int, int]) -> list[tuple[np.ndarray, np.ndarray]]:
    """The first `count` pairs that keep between sizes[0] and sizes[1] points a side at one per 0.1 m voxel."""
    return list(islice((pair for pair in _all_thinned() if all(sizes[0] <= len(c) <= sizes[1] for c in pair)), count))


def _all_thinned() -> Iterator[tuple[np.ndarray, np.ndarray]]:
    for first in itertools.count(0, ROOMS_AT_ONCE):
        clouds = [cloud for pair in scanned_pairs(first, ROOMS_AT_ONCE) for cloud in pair]
        thinned = [cloud[kept] for cloud, kept in zip(clouds, thin_clouds(clouds, VOXEL), strict=True)]
        yield from zip(thinned[::2], thinned[1::2], strict=True)
