"""Sensors: which directions they look in, where they stand, and how their ranges err.

Sensor frame: x forward, y left, z up. Angles of poses and fields of view are in degrees. R rooms, P pixels.
"""

import dataclasses
from typing import NamedTuple

import numpy as np

from warp_scanner import draws, footprints
from warp_scanner.scenes import Primitives


@dataclasses.dataclass(frozen=True)
class Pinhole:
    """A depth camera without distortion; pixels are row-major from the top left, rays go through their centres."""

    width: int
    height: int
    horizontal_fov: float = 80.0  # [deg] between the outer edges of the first and the last column
    vertical_fov: float = 55.0  # [deg]

    def __post_init__(self):
        if self.width < 1 or self.height < 1:
            raise ValueError(f"sensor width and height must be at least 1, got {self.width} x {self.height}")
        for name in ("horizontal_fov", "vertical_fov"):
            if not 0.0 < getattr(self, name) < 180.0:
                raise ValueError(f"sensor {name} must be between 0 and 180 degrees, got {getattr(self, name)}")

    def directions(self) -> np.ndarray:
        """Unit ray directions (P, 3) float32 in the sensor frame."""
        u, v = (
            np.tan(np.radians(fov) / 2) * (1.0 - (2.0 * np.arange(count) + 1.0) / count)
            for fov, count in ((self.horizontal_fov, self.width), (self.vertical_fov, self.height))
        )
        y, z = np.meshgrid(u, v)
        directions = np.stack([np.ones_like(y), y, z], axis=-1).reshape(-1, 3)
        return (directions / np.linalg.norm(directions, axis=1, keepdims=True)).astype(np.float32)


OAK_D_PRO = Pinhole(1280, 800)
OAK_D_PRO_SMALL = Pinhole(320, 200)


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


@dataclasses.dataclass(frozen=True)
class Standing:
    """Where a sensor may stand."""

    height: float = 1.0  # [m] above the floor
    gap: float = 0.3  # [m] at least, to anything that stands in the room
    tries: int = 32  # places drawn before giving up on a room
    height_spread: float = 0.0  # [m] the height is drawn up to this above or below
    pitch_spread: float = 0.0  # [deg] the pitch is drawn up to this above or below level


def draw_poses(
    primitives: Primitives, size: tuple[float, float, float] | np.ndarray, standing: Standing, key: np.ndarray
) -> tuple[Pose, np.ndarray]:
    """Poses at random free places, looking anywhere.

    Args:
        primitives: everything that stands in the R rooms.
        size: (x, y, z) or (R, 3) [m] inside of the shells, centred on the origin.
        standing: height, gap, number of tries, and spreads.
        key: (R,) uint64 from draws.keys.

    Returns:
        The poses, and (R,) bool: False where no free place was found and the pose means nothing.
    """
    size = np.broadcast_to(np.asarray(size, np.float64), (len(key), 3))
    place = []
    for axis in (0, 1):
        reach = size[:, axis, None] / 2 - standing.gap
        place.append((reach - -reach) * draws.uniform(key, f"sensor {axis}", standing.tries) - reach)
    place = np.stack(place, axis=-1)
    # A hair more than the gap, so that it still holds once the place is rounded to float32.
    first = footprints.first_clear_point(place, footprints.of_primitives(primitives), standing.gap + 1e-5)
    rooms = np.arange(len(key))
    height = standing.height + standing.height_spread * draws.between(key, "sensor height", (-1.0, 1.0), 1)[:, 0]
    # Floor and ceiling are kept away from too, where the room is high enough.
    height = np.clip(
        height, np.minimum(standing.gap, size[:, 2] / 2), np.maximum(size[:, 2] - standing.gap, size[:, 2] / 2)
    )
    height -= size[:, 2] / 2
    position = np.column_stack([place[rooms, first], height]).astype(np.float32)
    yaw = draws.between(key, "sensor yaw", (-180.0, 180.0), 1)[:, 0].astype(np.float32)
    pitch = 0.0 + standing.pitch_spread * draws.between(key, "sensor pitch", (-1.0, 1.0), 1)[:, 0]
    return Pose(position, yaw, pitch.astype(np.float32)), first >= 0


def add_range_noise(distance: np.ndarray, sigma: float, seed: int, index: np.ndarray) -> np.ndarray:
    """Ranges (R, P) float32 with independent Gaussian errors of `sigma` [m]; misses stay misses, none turns negative.

    Args:
        distance: (R, P) float32 [m], inf = no return.
        sigma: standard deviation [m], at least 0; 0 returns the ranges as they are.
        seed: of the draws; with `index` (R,) it fixes every error.
        index: (R,) room numbers.
    """
    if not 0.0 <= sigma < np.inf:
        raise ValueError(f"sigma must be at least 0 and finite, got {sigma}")
    if sigma == 0.0:
        return distance
    error = draws.normal(draws.keys(seed, index), "range noise", distance.shape[1])
    return np.maximum(distance + np.float32(sigma) * error, np.float32(0.0))
