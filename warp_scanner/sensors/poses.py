"""Poses: where sensors stand and look.

Sensor frame: x forward, y left, z up. Angles of poses are in degrees. R rooms.
"""

from typing import NamedTuple

import numpy as np


class Pose(NamedTuple):
    """Where the sensors of R rooms stand and look."""

    position: np.ndarray  # (R, 3) float32 [m] world
    yaw: np.ndarray  # (R,) float32 [deg] counter-clockwise from world x
    pitch: np.ndarray  # (R,) float32 [deg] upwards


def rotation_of(yaw: np.ndarray, pitch: np.ndarray) -> np.ndarray:
    """Rotations (R, 3, 3) float32, sensor frame to world: first pitch up, then yaw; both (R,) in degrees."""
    yaw, pitch = np.radians(np.asarray(yaw, np.float64)), np.radians(np.asarray(pitch, np.float64))
    cy, sy, cp, sp, zero = np.cos(yaw), np.sin(yaw), np.cos(pitch), np.sin(pitch), np.zeros_like(yaw)
    rows = [[cy * cp, -sy, -cy * sp], [sy * cp, cy, -sy * sp], [sp, zero, cp]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2).astype(np.float32)
