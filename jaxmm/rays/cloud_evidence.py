"""Evidence where the prior is a cloud, and the robot's rays are known by their points alone, filtered and thinned.

Each point of one side is looked at along the points of the other, as both lie around one viewpoint. A direction without
points tells nothing: it is unseen, whatever stood there. R pairs, N points of a scan. World frame: metres, z up.
"""

from typing import NamedTuple

import numpy as np

from jaxmm.rays.evidence import BLOCKED, SUPPORT, THROUGH, UNSEEN, Frame, View, frame_of, margins
from jaxmm.rays.noise_model import noise_of, sigma_at
from jaxmm.rays.pools import Surfaces, normals_of
from jaxmm.vectors import lengths
from warp_scanner.clouds.sightlines import Targets, look, sort_directions

FOOTPRINT = 0.08  # [m] half width of what a point stands for: half the diagonal of a voxel of 0.1 m
MOST_ANGLE = 0.1  # [rad] of a footprint
STEEPEST = 6.0  # tangent of the incidence beyond which a margin grows no further
LEVELS = (1.0, 99.0)  # percentiles of the heights that are taken for floor and ceiling


class CloudPair(NamedTuple):
    """Both clouds of one pair, after preprocessing, and where they were scanned from."""

    prior: np.ndarray  # (N, 3) [m] world
    robot: np.ndarray  # (M, 3) [m] world
    sensor: np.ndarray  # (3,) [m] world
    element: np.ndarray | None = None  # (N,) int: of the prior's points, where known


class Side(NamedTuple):
    """One cloud as seen from the viewpoint."""

    points: np.ndarray  # (N, 3)
    direction: np.ndarray  # (N, 3) float32 unit vectors
    reach: np.ndarray  # (N,) float32 [m]
    cosine: np.ndarray  # (N,) of the incidence on the surface around the point


def side_of(points: np.ndarray, sensor: np.ndarray, surfaces: Surfaces | None = None) -> Side:
    """A cloud as seen from a place; points at the place itself look along x. `surfaces` are its `normals_of`."""
    direction, reach = toward(points, sensor)
    facing = reach.astype(np.float64)
    if len(points):
        normal, _ = surfaces or normals_of(points)
        facing = np.abs(np.einsum("nc,nc->n", normal, direction))
    return Side(np.asarray(points), direction.astype(np.float32), reach.astype(np.float32), facing)


def toward(points: np.ndarray, sensor: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Unit directions (N, 3) and ranges (N,) [m] of points as seen from a place, float64."""
    offset = np.asarray(points, np.float64) - sensor
    reach = lengths(offset)
    return np.where(reach[:, None] > 1e-6, offset / np.maximum(reach, 1e-6)[:, None], [1.0, 0.0, 0.0]), reach


def prior_view(
    pair: CloudPair, apart: np.ndarray, threads: int | None = None, surfaces: Surfaces | None = None
) -> View:
    """What the robot's points say of the prior's.

    Args:
        pair: both clouds.
        apart: (N,) [m] from each point of the prior to the nearest of the robot's.
        threads: how many to use; by default one for each core it may run on.
        surfaces: `normals_of` the prior's points, where they are known already.
    """
    seen = side_of(pair.prior, pair.sensor, surfaces)
    count, residual, margin = _looked(seen, toward(pair.robot, pair.sensor), threads)
    candidate = (count[:, THROUGH] > count[:, SUPPORT]) & (count[:, THROUGH] > count[:, BLOCKED])
    element = np.full(len(seen.reach), -1) if pair.element is None else np.asarray(pair.element)
    return View(pair.prior, element, count, residual, margin, apart, seen.cosine, candidate)


def robot_view(
    pair: CloudPair, apart: np.ndarray, threads: int | None = None, surfaces: Surfaces | None = None
) -> View:
    """What the prior's points say of the robot's.

    `apart` (M,) [m] is from each of those to the nearest of the prior's; all else as of `prior_view`.
    """
    seen = side_of(pair.robot, pair.sensor, surfaces)
    count, residual, margin = _looked(seen, toward(pair.prior, pair.sensor), threads)
    # Where the prior lies beyond the robot's point, the ray was blocked before it; where before, it went through.
    count, residual = count[:, [BLOCKED, SUPPORT, THROUGH, UNSEEN]], 0.0 - residual
    before = count[:, BLOCKED] > np.maximum(count[:, SUPPORT], count[:, THROUGH])
    candidate = (before | (count[:, :UNSEEN].sum(axis=1) == 0)) & (apart > margins(np.ones(1), 0.0) + FOOTPRINT)
    return View(pair.robot, np.full(len(seen.reach), -1), count, residual, margin, apart, seen.cosine, candidate)


def frame_of_pair(pair: CloudPair) -> Frame:
    """What heights are judged against: the view is what either cloud reaches."""
    both = np.concatenate([pair.prior, pair.robot])
    # Where all was filtered out there is nothing to judge, and any floor will do.
    floor, ceiling = np.percentile(both[:, 2], LEVELS) if len(both) else (pair.sensor[2], pair.sensor[2])
    return frame_of(pair.sensor, both - pair.sensor, floor, max(ceiling, floor + 0.5))


def _looked(
    seen: Side, other: tuple[np.ndarray, np.ndarray], threads: int | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rays (directions and ranges) in the footprint of every point: counts (N, 4), mean residuals, margins (N,)."""
    count, (direction, reach) = len(seen.reach), (part.astype(np.float32) for part in other)
    if not count or not len(reach):
        return np.zeros((count, 4), np.int64), np.full(count, np.nan), margins(seen.cosine, 0.0)
    grid = sort_directions(direction)
    angle, width = (np.clip(FOOTPRINT / np.maximum(one, 1e-3), 0.0, MOST_ANGLE) for one in (seen.reach, reach))
    steep = np.minimum(np.sqrt(1.0 / np.maximum(seen.cosine, 1e-3) ** 2 - 1.0), STEEPEST)
    slope, nobody = seen.reach * steep, np.full(count, -1)

    def looked(margin: np.ndarray):
        targets = Targets(seen.direction, seen.reach, angle, margin, slope, nobody)
        return look(grid, reach[None], [targets], width=width[None], threads=threads)[0]

    # Once to learn how far ranges are apart where nothing changed, once with margins that allow for it.
    noise = noise_of(looked(np.zeros(count)).residual, seen.cosine, seen.reach)
    margin = margins(seen.cosine, sigma_at(noise, seen.reach))
    found = looked(margin)
    return found.count.astype(np.int64), found.residual, margin
