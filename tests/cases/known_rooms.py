"""Rooms whose every object is known, scanned: what the tests of objects look at."""

import numpy as np

from jaxmm.objects.face_finish import Rays
from jaxmm.objects.finder import Judged
from jaxmm.objects.judge import KINDS, ObjectJudge
from warp_scanner.clouds.points import points_of
from warp_scanner.clouds.voxels import thin_clouds
from warp_scanner.scenes.scenes import BOX, Tags, join, solids
from warp_scanner.sensors.poses import Pose
from warp_scanner.sensors.sense import cast
from warp_scanner.sensors.sensors import OAK_D_PRO_SMALL

FLOOR, CEILING = 0.0, 3.0
SENSOR = (0.0, 0.0, 1.4)  # looks along x; the room reaches from -5 to 5

NO_RAYS = Rays(np.array(SENSOR), np.zeros((0, 3)), np.zeros(0))


def slab(x, y, low, high, yaw=0.0, kind=BOX, element=1):
    """A primitive as a table of one room: centre and full edges in plan, lowest and highest z."""
    (cx, sx), (cy, sy) = x, y
    center, half = [cx, cy, (low + high) / 2], [sx / 2, sy / 2, (high - low) / 2]
    one = [np.full((1, 1), value, np.float32) for value in (*center, *half)]
    return solids(np.ones((1, 1), bool), one[:3], one[3:], np.full((1, 1), np.radians(yaw)), Tags(kind, element, 3))


SHELL = (
    slab((0, 10), (0, 10), -0.1, 0.0, element=0), slab((0, 10), (0, 10), 3.0, 3.1, element=0),
    slab((5.05, 0.1), (0, 10), 0, 3, element=0), slab((-5.05, 0.1), (0, 10), 0, 3, element=0),
    slab((0, 10), (5.05, 0.1), 0, 3, element=0), slab((0, 10), (-5.05, 0.1), 0, 3, element=0),
)  # fmt: skip


def pillar(x, y, width, yaw=0.0, kind=BOX, high=CEILING):
    return slab((x, width), (y, width), FLOOR, high, yaw, kind)


def i_section(x, y, width, yaw, thickness=0.02):
    """A column of two flanges and a web."""
    away = (width - thickness) / 2 * np.array([-np.sin(np.radians(yaw)), np.cos(np.radians(yaw))])
    flanges = (wall(x + side * away[0], y + side * away[1], width, thickness, yaw) for side in (-1.0, 1.0))
    return *flanges, wall(x, y, thickness, width, yaw)


def wall(x, y, length, thickness, yaw, high=CEILING):
    return slab((x, length), (y, thickness), FLOOR, high, yaw)


def judged(*changed, others=(), poses=((*SENSOR, 0.0),), noise=0.0):
    """Scans of the room with changed things and others, the former with probability 0.95."""
    scene = join(*SHELL, *changed, *(other._replace(element=np.full((1, 1), 2, np.int32)) for other in others))
    points, element, scan, rays = [], [], [], []
    for number, (x, y, z, yaw) in enumerate(poses):
        pose = Pose(np.array([[x, y, z]], np.float32), np.array([yaw], np.float32), np.zeros(1, np.float32))
        seen = cast(scene, None, OAK_D_PRO_SMALL, pose)
        rng = np.random.default_rng(number)
        ranges = seen.distance + noise * rng.standard_normal(seen.distance.shape).astype(np.float32)
        cloud = points_of(pose, OAK_D_PRO_SMALL.directions(), ranges)[0]
        (kept,) = thin_clouds([cloud], 0.1)
        away = points_of(pose, OAK_D_PRO_SMALL.directions(), np.ones_like(ranges))[0] - pose.position[0]
        rays.append(Rays(np.array([x, y, z]), away, ranges[0]))
        points.append(cloud[kept]), element.append(seen.element[0, kept]), scan.append(np.full(len(kept), number))
    points, new = np.concatenate(points), np.concatenate(element) == 1
    sensors = np.array([pose[:3] for pose in poses])
    probability = np.where(new, 0.95, 0.02)
    apart = np.where(new, 1.0, 0.0)
    return Judged(points, probability, probability, apart, sensors, FLOOR, CEILING, np.concatenate(scan), tuple(rays))


def says(nothing: float, pillar: float, wall: float) -> ObjectJudge:
    """A judge that gives every candidate the same probabilities."""
    no_clue, no_limit = np.zeros((1, len(KINDS), 1), np.uint8), np.full((1, len(KINDS), 1), np.inf, np.float32)
    odds = np.log([nothing, pillar, wall]).astype(np.float32)
    no_leaf = np.zeros((1, len(KINDS), 2), np.float32)
    return ObjectJudge(odds, no_clue, no_limit, no_leaf, np.zeros(1, np.uint8))
