"""Which of a detection's drawn points show which mismatch.

N points of the robot's scans, M of the prior's, as in `report.Drawing`.
"""

from typing import NamedTuple

import numpy as np

from jaxmm.learning.boxes import Box
from jaxmm.rays.evidence import SUPPORT, THROUGH
from jaxmm.verdicts.results import Detection, Mismatch

MARGIN = 0.1  # [m] about a box: points are thinned to about this, and a box need not hold the noise


class MismatchPoints(NamedTuple):
    """What each point shows."""

    robot: np.ndarray  # (N,) int32 index of the added mismatch; -1 for points that show none
    prior: np.ndarray  # (M,) int32 index of the removed mismatch; -1


def mismatch_points(detection: Detection) -> MismatchPoints:
    """Find the points of every mismatch.

    A removed element owns all its points. Otherwise points belong to the box that they lie in, but for those of other
    things that stand in it: of an added object those on a surface of the prior, of a removed one those that no ray went
    through. A box that is not finite holds nothing.
    """
    drawing = detection.drawing
    robot, prior = (np.full(len(points), -1, np.int32) for points in (drawing.robot, drawing.prior))
    row_of = {name: row for row, name in enumerate(drawing.guid)}
    for index, one in enumerate(detection.mismatches):
        if one.mismatch_type == "added":
            robot[inside(one, drawing.robot, drawing.origin) & (drawing.robot_evidence != SUPPORT)] = index
        elif one.element in row_of:
            prior[drawing.prior_element == row_of[one.element]] = index
        else:
            prior[inside(one, drawing.prior, drawing.origin) & (drawing.prior_evidence == THROUGH)] = index
    return MismatchPoints(robot, prior)


def inside(mismatch: Mismatch | Box, offsets: np.ndarray, origin: np.ndarray) -> np.ndarray:
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
