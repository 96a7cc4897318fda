"""Compares a robot scan with a prior that is a cloud itself: only what of it the sensor could see counts.

M points of the prior, N of the robot. Positions are offsets from the prior's origin, world axes: metres, z up.
"""

from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from jaxmm.inputs import InputError
from jaxmm.rays.cloud_evidence import FOOTPRINT, LEVELS, MOST_ANGLE, CloudPair, frame_of_pair, prior_view, robot_view
from jaxmm.rays.cloud_levels import NEAR, UNKNOWN, levels_about, own_ceilings
from jaxmm.rays.evidence import BLOCKED, SUPPORT, Frame, View, margins
from jaxmm.rays.scan_rays import ScanRays, measured_points
from jaxmm.vectors import lengths
from warp_scanner.clouds.neighbours import nearest
from warp_scanner.clouds.sightlines import Targets, cells_of, look, sort_directions
from warp_scanner.clouds.voxels import thin_clouds

VOXEL = 0.1  # [m]
LEAST_ROOM = 0.5  # [m] from floor to ceiling
LEAST_POINTS = 50  # of the prior in view
LEAST_BESIDE, BESIDE = 4, 0.25  # points of a prior so near [m] to one of its own that is of a surface: of a full one 20
SPARSE = 0.5  # share of points that have them, below which a prior is too sparse to tell what hangs


class Compared(NamedTuple):
    """Both sides of one scan, as evidence has them."""

    prior: View
    robot: View
    frame: Frame
    notes: tuple[str, ...] = ()


def compare(cloud: np.ndarray, rays: ScanRays) -> Compared:
    """What the two clouds say of each other.

    Raises:
        InputError: hardly any of the prior lies in view.
    """
    prior = visible(cloud, rays)
    if len(prior) < LEAST_POINTS:
        raise InputError(f"the prior has {len(prior)} points in view, expected at least {LEAST_POINTS}; check the pose")
    robot = measured_points(rays)
    robot = robot[thin_clouds([robot], VOXEL)[0]]
    pair = CloudPair(prior, robot, rays.position)
    forth, back = (nearest([a], [b])[0].distance.astype(np.float32) for a, b in ((prior, robot), (robot, prior)))
    of_prior = prior_view(pair, forth).at(on_surfaces(prior))
    sides, frame = (of_prior, robot_view(pair, back)), frame_of_pair(pair)
    # A view that looks down ends below the ceiling: heights are those of all that is known of the storey.
    levels = levels_about(np.concatenate([cloud, robot]), rays.position)
    floor = frame.floor if levels.floor is None else levels.floor
    ceiling = _highest(cloud, rays.position, frame) if levels.ceiling is None else levels.ceiling
    frame = frame._replace(floor=floor, ceiling=max(ceiling, floor + LEAST_ROOM))
    if levels.ceiling is not None:
        return Compared(*sides, frame)
    if levels.floor is not None:  # of a cloud without level surfaces, walls tell where the ceiling was
        both = np.concatenate([prior, robot])
        told = [own_ceilings(one.points, both, (frame.floor, frame.ceiling)) for one in sides]
        sides = tuple(one._replace(levels=own) for one, own in zip(sides, told, strict=True))
    return Compared(*sides, frame, (UNKNOWN,))


def _highest(cloud: np.ndarray, sensor: np.ndarray, frame: Frame) -> float:
    """The height [m] of the highest parts of a cloud (M, 3) near a sensor (3,), no lower than its view has it."""
    near = cloud[np.hypot(*(cloud[:, :2] - sensor[:2]).T) <= NEAR, 2]
    return max(frame.ceiling, float(np.percentile(near, LEVELS[1]))) if len(near) else frame.ceiling


def on_surfaces(points: np.ndarray) -> np.ndarray:
    """(N,) bool: points (N, 3), one a voxel, that have others beside them, as surfaces have.

    At the edges of things a scanner mixes the ranges of both sides. Such points hang in the air, in a thin sheet along
    its line of sight; from another place one looks through that, as through a wall that is gone. Of a cloud that is
    sparse everywhere nobody can tell: all are.
    """
    beside = cKDTree(points).query(points, LEAST_BESIDE + 1, distance_upper_bound=BESIDE)[0]
    found = np.isfinite(beside[:, -1])
    return found if found.mean() >= SPARSE else np.ones(len(points), bool)


def visible(cloud: np.ndarray, rays: ScanRays) -> np.ndarray:
    """The points of a cloud that lie in the field of view and are not behind others of its own."""
    offset = cloud.astype(np.float64) - rays.position
    reach = lengths(offset)
    near = (reach > 1e-3) & (reach <= rays.limit)
    points, direction, reach = cloud[near], (offset[near] / reach[near, None]).astype(np.float32), reach[near]
    cell = 3.0 * rays.spacing
    inside = np.isin(cells_of(direction, cell)[0], np.unique(cells_of(rays.pattern, cell)[0]))
    points, direction, reach = points[inside], direction[inside], reach[inside].astype(np.float32)
    if not len(points):
        return points
    angle = np.clip(FOOTPRINT / reach, 0.0, MOST_ANGLE).astype(np.float32)
    margin = margins(np.full(len(reach), 0.3), 0.03)  # thinned surfaces that slant are not behind themselves
    nobody, level = np.full(len(reach), -1), np.zeros(len(reach), np.float32)
    targets = Targets(direction, reach, angle, margin, level, nobody)
    count = look(sort_directions(direction), reach[None], [targets], width=angle[None])[0].count
    return points[count[:, SUPPORT] > count[:, BLOCKED]]
