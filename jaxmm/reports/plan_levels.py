"""Which storeys the plan of a detection shows, where each is cut, and how much of it is of interest.

Positions are offsets from the drawing's origin [m], z up.
"""

from typing import NamedTuple

import numpy as np

from jaxmm.classes.unexplained import Unexplained
from jaxmm.verdicts.results import Detection, Drawing, Mismatch

CUT = 1.2  # [m] above the floor: through doors and windows, as plans are drawn
STOREY = 1.5  # [m] between the heights of sensors that stand on different storeys
FAR_ORIGIN = 1e4  # [m] beyond this, axes count from nearby: labels of seven digits cannot be read
AROUND = 1.0  # [m] left free about all that is of interest


class Level(NamedTuple):
    """One storey that was scanned."""

    scans: tuple[int, ...]  # their numbers
    floor: float  # z offset [m]


def base_of(drawing: Drawing) -> np.ndarray:
    """(3,) [m] from which the axes of a plan count: the world's origin, or whole metres near to what is drawn."""
    return np.round(drawing.origin) if np.abs(drawing.origin).max() > FAR_ORIGIN else np.zeros(3)


def levels_of(detection: Detection) -> list[Level]:
    """Scans by storey, from the lowest up: those between whose sensors there is no gap of STOREY are on one."""
    drawing = detection.drawing
    height = [scan.pose[2] - drawing.origin[2] for scan in detection.scans]
    order = sorted((n for n in range(len(height)) if np.isfinite(height[n])), key=lambda n: height[n])
    groups: list[list[int]] = []
    for n in order:
        if groups and height[n] - height[groups[-1][-1]] < STOREY:
            groups[-1].append(n)
        else:
            groups.append([n])
    levels = []
    for group in groups or [[]]:
        own = drawing.robot[np.isin(drawing.robot_scan, group)]
        points = own if len(own) else drawing.prior
        # A few points below the floor are mirror images or seen through a stair.
        levels.append(Level(tuple(group), float(np.percentile(points[:, 2], 2.0)) if len(points) else 0.0))
    return levels


def level_of_mismatches(detection: Detection, levels: list[Level]) -> np.ndarray:
    """Each is drawn once, where its middle is nearest to the middle of what one sees of a storey."""
    middle = np.array([level.floor + CUT for level in levels])
    height = np.array([one.center[2] - detection.drawing.origin[2] for one in detection.mismatches])
    return np.argmin(np.nan_to_num(np.abs(height[:, None] - middle)), axis=1)


def region_of(detection: Detection, level: Level) -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper corner (2,) of what the plan shows: all that was seen, and the sensors."""
    drawing = detection.drawing
    own = drawing.robot[np.isin(drawing.robot_scan, level.scans)]
    corners = [np.array([detection.scans[n].pose[:2]]) - drawing.origin[:2] for n in level.scans]
    corners += [np.percentile(points[:, :2], [0.5, 99.5], axis=0) for points in (own, drawing.prior) if len(points)]
    corners += [footprint(one, drawing.origin) for one in detection.mismatches]
    every = np.concatenate(corners) if corners else np.zeros((1, 2))
    every = every[np.isfinite(every).all(axis=1)]
    low, high = (every.min(axis=0), every.max(axis=0)) if len(every) else (np.zeros(2), np.zeros(2))
    return low - AROUND, high + AROUND


def footprint(mismatch: Mismatch | Unexplained, origin: np.ndarray) -> np.ndarray:
    """Corners (4, 2) of the footprint of a box, as offsets from `origin` [m]."""
    yaw = np.radians(mismatch.rotation)
    along, across = np.array([np.cos(yaw), np.sin(yaw)]), np.array([-np.sin(yaw), np.cos(yaw)])
    length, width = np.asarray(mismatch.dimensions[:2], np.float64) / 2
    middle = np.asarray(mismatch.center[:2], np.float64) - origin[:2]
    return np.array([middle + a * length * along + b * width * across for a, b in ((1, 1), (-1, 1), (-1, -1), (1, -1))])
