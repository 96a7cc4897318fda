"""What a detection's drawn points show: which mismatch, and how far off the model each lies.

N points of the robot's scans, M of the prior's, as in `report.Drawing`.
"""

from typing import NamedTuple

import numpy as np

from jaxmm.classes.unexplained import Unexplained
from jaxmm.learning.boxes import Box
from jaxmm.rays.evidence import BLOCKED, SUPPORT, THROUGH
from jaxmm.verdicts.results import Detection, Mismatch
from warp_scanner.scenes.building import Triangles
from warp_scanner.sensors.scan import Rays
from warp_scanner.sensors.triangles import cast_triangles, clearance, prepare

MARGIN = 0.1  # [m] about a box: points are thinned to about this, and a box need not hold the noise
FARTHEST = 100.0  # [m] off the model's surface, beyond which no distance is told


class MismatchPoints(NamedTuple):
    """What each point shows."""

    robot: np.ndarray  # (N,) int32 index of the added mismatch; -1 for points that show none
    prior: np.ndarray  # (M,) int32 index of the removed mismatch; -1
    unexplained: np.ndarray  # (N,) bool: of no mismatch, but of something else that is not in the model


def mismatch_points(detection: Detection) -> MismatchPoints:
    """Find the points of every mismatch.

    A removed element owns all its points. Otherwise points belong to the box that they lie in, but for those of other
    things that stand in it: of an added object those on a surface of the prior, of a removed one those that no ray went
    through. A box that is not finite holds nothing.
    """
    drawing = detection.drawing
    robot, prior = (np.full(len(points), -1, np.int32) for points in (drawing.robot, drawing.prior))
    row_of = drawing.rows()
    for index, one in enumerate(detection.mismatches):
        if one.mismatch_type == "added":
            robot[inside(one, drawing.robot, drawing.origin) & (drawing.robot_evidence != SUPPORT)] = index
        elif one.key in row_of:
            prior[drawing.prior_element == row_of[one.key]] = index
        else:
            prior[inside(one, drawing.prior, drawing.origin) & (drawing.prior_evidence == THROUGH)] = index
    unexplained = np.zeros(len(robot), bool)
    for thing in detection.unexplained:
        unexplained |= inside(thing, drawing.robot, drawing.origin)
    unexplained &= (robot < 0) & (drawing.robot_evidence == BLOCKED)
    return MismatchPoints(robot, prior, unexplained)


def inside(mismatch: Mismatch | Box | Unexplained, offsets: np.ndarray, origin: np.ndarray) -> np.ndarray:
    """Which points (N,) lie in a box, as of a mismatch, or within MARGIN of it.

    Args:
        mismatch: its box is in the world frame.
        offsets: (N, 3) [m] from `origin`.
        origin: (3,) float64 [m] world.
    """
    # The centre loses its large part first: offsets are exact only because they are small.
    away = offsets - (np.asarray(mismatch.center, np.float64) - origin)
    if not np.isfinite(mismatch.rotation):
        return np.zeros(len(offsets), bool)
    yaw = np.radians(mismatch.rotation)
    along = away[:, 0] * np.cos(yaw) + away[:, 1] * np.sin(yaw)
    across = away[:, 1] * np.cos(yaw) - away[:, 0] * np.sin(yaw)
    reach = np.asarray(mismatch.dimensions, np.float64) / 2 + MARGIN
    return (np.abs(np.column_stack([along, across, away[:, 2]])) <= reach).all(axis=1)


def signed_distances(detection: Detection) -> np.ndarray | None:
    """How far each of the robot's points lies off the model's surface, (N,) float32 [m]; None where it has none.

    Positive before the surface, as seen from where the point was measured, negative behind it; NaN beyond FARTHEST.
    """
    drawing = detection.drawing
    if drawing.faces is None or not len(drawing.faces):
        return None
    nothing = np.zeros(len(drawing.guid), np.uint8)
    scene = prepare(Triangles(drawing.vertices, drawing.faces, drawing.face_element, nothing))
    distance = clearance(scene, drawing.robot, FARTHEST)
    distance[distance >= FARTHEST] = np.nan
    for number, scan in enumerate(detection.scans):
        own = np.flatnonzero(drawing.robot_scan == number)
        sensor = np.array(scan.pose[:3], np.float64) - drawing.origin
        way = drawing.robot[own] - sensor
        reach = np.linalg.norm(way, axis=1)
        own, way, reach = own[reach > 0.0], way[reach > 0.0], reach[reach > 0.0]
        if len(own):
            rays = Rays(sensor[None], (way / reach[:, None]).astype(np.float32))
            behind = reach > cast_triangles(scene, rays).distance[0]
            distance[own[behind]] *= -1.0
    return distance
