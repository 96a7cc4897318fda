"""What a sensor sees, as angles: azimuth and elevation of points and boxes from where it stands and looks.

Azimuth is counter-clockwise from the sensor's heading, elevation upwards from its horizon, both in degrees. N points.
"""

from typing import NamedTuple

import numpy as np

from jaxmm.vectors import by_blocks
from jaxmm.verdicts.results import Drawing, Mismatch, Pose

CELL = 1.0  # [deg] of the grid that decides what hides what
DEPTH = 0.5  # [m] behind the nearest point of a cell that is still seen: a slanted surface is no screen to itself
EDGE_POINTS = 25  # along an edge of a box, which is a curve in a panorama
EDGES = [(a, b) for a in range(8) for b in range(a) if bin(a ^ b).count("1") == 1]  # of the corners of a box


class Seen(NamedTuple):
    """Points from one place."""

    azimuth: np.ndarray  # (N,) [deg] in [-180, 180)
    elevation: np.ndarray  # (N,) [deg]
    distance: np.ndarray  # (N,) [m]


def seen_from(pose: Pose, offsets: np.ndarray, origin: np.ndarray) -> Seen:
    """Points as a sensor sees them.

    Args:
        pose: of the sensor, world.
        offsets: (N, 3) [m] from `origin`.
        origin: (3,) float64 [m] world.
    """
    place = np.array(pose[:3], np.float64) - origin
    return Seen(*by_blocks(lambda some: np.column_stack(_seen(sensor_frame(pose, some - place))), offsets).T)


def sensor_frame(pose: Pose, away: np.ndarray) -> np.ndarray:
    """Vectors (N, 3) turned from the world to the sensor: x forward, y left, z up."""
    yaw, pitch = np.radians(pose[3:])
    forward = np.array([np.cos(yaw) * np.cos(pitch), np.sin(yaw) * np.cos(pitch), np.sin(pitch)])
    left = np.array([-np.sin(yaw), np.cos(yaw), 0.0])
    return away @ np.column_stack([forward, left, np.cross(forward, left)])


def box_edges(pose: Pose, one: Mismatch) -> list[np.ndarray]:
    """The edges of a box as lines (n, 2) of azimuth and elevation, cut where they pass behind the sensor."""
    signs = np.array([[(corner >> bit & 1) - 0.5 for bit in range(3)] for corner in range(8)])
    yaw = np.radians(one.rotation)
    turn = np.array([[np.cos(yaw), np.sin(yaw), 0], [-np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
    away = np.asarray(one.center, np.float64) - np.array(pose[:3], np.float64)
    corners = sensor_frame(pose, (signs * np.asarray(one.dimensions, np.float64)) @ turn + away)
    lines = []
    for a, b in EDGES:
        seen = _seen(np.linspace(corners[a], corners[b], EDGE_POINTS))
        line = np.column_stack([seen.azimuth, seen.elevation])
        lines += np.split(line, np.flatnonzero(np.abs(np.diff(seen.azimuth)) > 180.0) + 1)
    return lines


def in_view(drawing: Drawing, scan: int, pose: Pose, seen: Seen) -> np.ndarray:
    """Which points (N,) one scan could meet: those in its field of view that no nearer ones hide.

    The points of the prior are of all scans together, so that one scan alone sees them all.
    """
    if len(drawing.fields_of_view) < 2:
        return np.ones(len(seen.azimuth), bool)
    inside = np.ones(len(seen.azimuth), bool)
    corners = drawing.fields_of_view[scan]
    if len(corners):
        # A camera sees what lies on the inner side of the planes through its edges.
        forward = sensor_frame(pose, corners.astype(np.float64))
        wide, high = (np.abs(forward[:, axis] / forward[:, 0]).max() for axis in (1, 2))
        azimuth, elevation = np.radians(seen.azimuth), np.radians(seen.elevation)
        inside = (np.abs(seen.azimuth) < 90.0) & (np.abs(np.tan(azimuth)) <= wide)
        inside &= np.abs(np.tan(elevation)) <= high * np.cos(azimuth)
    column, row = (np.floor(angle / CELL).astype(np.int32) for angle in (seen.azimuth, seen.elevation))
    rows = int(180.0 / CELL) + 1
    place = (column - int(-180.0 / CELL)) * rows + row - int(-90.0 / CELL)
    nearest = np.full(int(360.0 / CELL) * rows, np.inf)
    np.minimum.at(nearest, place, seen.distance)
    return inside & (seen.distance <= nearest[place] + DEPTH)


def _seen(vectors: np.ndarray) -> Seen:
    level = np.hypot(vectors[:, 0], vectors[:, 1])
    azimuth = np.degrees(np.arctan2(vectors[:, 1], vectors[:, 0]))
    return Seen(
        np.where(azimuth >= 180.0, azimuth - 360.0, azimuth),
        np.degrees(np.arctan2(vectors[:, 2], level)),
        np.hypot(level, vectors[:, 2]),
    )
