"""Both scans of generated pairs after preprocessing: objects filtered out, thinned to one point a voxel.

R pairs, P rays, N points. World frame: metres, z up.
"""

from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np

from jaxmm.config import Config
from jaxmm.learning.preprocess import FLOOR_TOLERANCE, object_filter, outlier_mask, structural_filter
from warp_scanner.clouds.points import Kept, points_of, tall_points
from warp_scanner.clouds.voxels import thin_clouds
from warp_scanner.rooms.pairs import Pairs
from warp_scanner.scenes.scenes import STRUCTURE
from warp_scanner.sensors.poses import Pose
from warp_scanner.sensors.scan import Scan


class Sides(NamedTuple):
    """Both scans of R pairs after preprocessing."""

    dt: list[Kept]
    robot: list[Kept]


def sides_of(config: Config, pairs: Pairs, threads: int | None = None) -> Sides:
    """Preprocess both scans of every pair.

    Args:
        config: how.
        pairs: scans of R rooms.
        threads: how many to use; by default one for each core it may run on.
    """
    return Sides(*(_preprocessed(config, pairs, scan, threads) for scan in (pairs.dt, pairs.robot)))


def _preprocessed(config: Config, pairs: Pairs, scan: Scan, threads: int | None) -> list[Kept]:
    """What survives the filters of one side's scans, room by room."""
    filtered = _filtered(config, pairs, scan, threads)
    chosen = thin_clouds([kept.points for kept in filtered], config.preprocess.voxel_size, threads)
    thinned = [Kept(*(field[indices] for field in kept)) for kept, indices in zip(filtered, chosen, strict=True)]
    if not config.preprocess.outlier_removal:
        return thinned
    with ThreadPoolExecutor(threads) as pool:
        outliers = pool.map(lambda kept: outlier_mask(kept.points), thinned)
        return [Kept(*(field[~mask] for field in kept)) for kept, mask in zip(thinned, outliers, strict=True)]


def own_draws(pairs: Pairs, row: int, stream: int) -> np.random.Generator:
    """Draws that are a pair's own, whatever the others of its call: its pose is as good as a key."""
    pose = [*pairs.pose.position[row], pairs.pose.yaw[row], pairs.pose.pitch[row]]
    return np.random.default_rng([stream, *np.asarray(pose, np.float32).view(np.uint32).tolist()])


def _filtered(config: Config, pairs: Pairs, scan: Scan, threads: int | None) -> list[Kept]:
    """The returns of one side's scans that the object filter lets through."""
    kind = config.preprocess.object_filter
    if kind == "height":
        return _tall(config, pairs, scan, threads)
    if kind == "mixed":
        tall, whole = _tall(config, pairs, scan, threads), _returned(pairs, scan, threads)
        draws = [own_draws(pairs, row, 0).random() for row in range(len(tall))]
        return [a if draw < 0.5 else b for a, b, draw in zip(tall, whole, draws, strict=True)]
    if kind == "semantic":
        there = structural_filter(scan.semantic, STRUCTURE)
        scan = scan._replace(distance=np.where(there, scan.distance, np.float32(np.inf)))
    return _returned(pairs, scan, threads)


def _returned(pairs: Pairs, scan: Scan, threads: int | None) -> list[Kept]:
    """All returns."""
    points, keep = points_of(pairs.pose, pairs.directions, scan.distance, threads), np.isfinite(scan.distance)
    return [Kept(points[row, kept], np.flatnonzero(kept)) for row, kept in enumerate(keep)]


def _tall(config: Config, pairs: Pairs, scan: Scan, threads: int | None) -> list[Kept]:
    """The returns of elements that reach high, or are floor or ceiling."""
    half, threshold = pairs.size[:, 2] / 2, config.preprocess.filter_height
    tall = tall_points(pairs.pose, pairs.directions, scan, (-half, half, threshold, FLOOR_TOLERANCE), threads)
    for row in (row for row, kept in enumerate(tall) if kept is None):  # a median that counts cannot tell
        there = np.flatnonzero(np.isfinite(scan.distance[row]))
        pose = Pose(*(field[row : row + 1] for field in pairs.pose))
        points = points_of(pose, pairs.directions, scan.distance[row : row + 1])[0, there]
        limits = (-float(half[row]), float(half[row]), threshold, FLOOR_TOLERANCE)
        chosen = object_filter(points, scan.element[row, there], *limits)
        tall[row] = Kept(points[chosen], there[chosen])
    return tall
