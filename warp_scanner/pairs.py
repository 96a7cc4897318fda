"""(config, index) to pairs of scans with their truth: a pure function, so any machine can make any part of a data set.

R rooms, P pixels. World frame: metres, z up.
"""

import dataclasses
import os
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np

from warp_scanner.rooms import RoomConfig
from warp_scanner.scan import Rays, Scan, cast_rays, cast_slots
from warp_scanner.scenarios import SceneConfig, Scenes, TrueBox, make_scenes
from warp_scanner.sensors import OAK_D_PRO_SMALL, Pinhole, Pose, Standing, add_range_noise, rotation_of

_ROOMS_AT_ONCE = 16  # bounds the memory of what is only needed on the way


@dataclasses.dataclass(frozen=True)
class PairConfig:
    """Which pairs to make; lengths in metres."""

    seed: int = 0
    scenario: str = "pillar_added"  # one of scenarios.SCENARIOS, or "unchanged"
    condition: str = "clean"  # or "occluded"
    room: RoomConfig = RoomConfig()
    sensor: Pinhole = OAK_D_PRO_SMALL
    sensor_height: float = 1.0  # above the floor
    sensor_gap: float = 0.3  # least distance from the sensor to anything that stands in the room
    range_noise: float = 0.0  # standard deviation of the robot's ranges; the DT scan has none
    testable_margin: float = 0.1  # ranges must differ by more than this to tell prior and reality apart
    furniture_share: float = 0.05  # least share of rays that hit furniture in the occluded scene

    def __post_init__(self):
        if self.seed < 0:
            raise ValueError(f"seed must be at least 0, got {self.seed}")
        for name in ("sensor_gap", "range_noise", "testable_margin"):
            if not 0.0 <= getattr(self, name) < np.inf:
                raise ValueError(f"{name} must be at least 0 and finite, got {getattr(self, name)}")
        if not 0.0 < self.sensor_height < self.room.size[2]:
            raise ValueError(f"sensor_height must lie inside the room, got {self.sensor_height}")
        _ = self.scene  # checks scenario and condition

    @property
    def scene(self) -> SceneConfig:
        """The part of the settings that fixes the scenes."""
        return SceneConfig(
            scenario=self.scenario,
            condition=self.condition,
            room=self.room,
            standing=Standing(self.sensor_height, self.sensor_gap),
            horizontal_fov=self.sensor.horizontal_fov,
            vertical_fov=self.sensor.vertical_fov,
            furniture_share=self.furniture_share,
        )


class Pairs(NamedTuple):
    """A DT scan and a robot scan of each of R rooms, along the same rays, with the truth about every ray."""

    pose: Pose  # of both scans
    directions: np.ndarray  # (P, 3) float32 unit vectors in the sensor frame, shared by all rooms
    dt: Scan  # of the prior, (R, P)
    robot: Scan  # of reality, (R, P), ranges with noise
    changed_dt: np.ndarray  # (R, P) bool: the ray hits a removed element in the prior
    changed_robot: np.ndarray  # (R, P) bool: the ray hits an added element in reality
    testable_dt: np.ndarray  # (R, P) bool: the noise-free robot ray passes the prior's point by more than the margin
    testable_robot: (
        np.ndarray
    )  # (R, P) bool: the noise-free robot ray ends in front of the prior by more than the margin
    observable_fraction: np.ndarray  # (R,) float32: testable rays of the changed object / rays that hit it alone; NaN
    box: TrueBox  # of the changed object


def make_pairs(config: PairConfig, index: np.ndarray, threads: int | None = None) -> Pairs:
    """Pairs of the given room numbers; a pure function of (config, index) for every single room.

    Args:
        config: what to make.
        index: (R,) room numbers, at least 0.
        threads: how many to use; by default as many as the machine has cores.

    Raises:
        ValueError: index is not (R,) or holds a negative number.
        RuntimeError: the settings leave no space for a scene.
    """
    index = np.asarray(index)
    if index.ndim != 1 or not np.issubdtype(index.dtype, np.integer) or np.any(index < 0):
        raise ValueError(f"index must be (R,) integers of at least 0, got {index.dtype} {index.shape}")
    threads = threads or os.cpu_count() or 1
    size = max(1, min(_ROOMS_AT_ONCE, -(-len(index) // threads)))
    starts = range(0, max(len(index), 1), size)
    with ThreadPoolExecutor(threads) as pool:
        # Rooms are shared out first; only a lone part leaves threads for its rays.
        inner = threads if len(starts) == 1 else 1
        parts = list(pool.map(lambda start: _make_pairs(config, index[start : start + size], inner), starts))
    return joined(parts)


def points_of(pose: Pose, directions: np.ndarray, distance: np.ndarray) -> np.ndarray:
    """World points (R, P, 3) float32 [m] of ranges (R, P) along sensor-frame directions (P, 3); NaN for misses."""
    rotation = rotation_of(pose.yaw, pose.pitch)
    reach = np.where(np.isfinite(distance), distance, np.float32(np.nan))
    return pose.position[:, None] + reach[..., None] * (directions[None] @ rotation.transpose(0, 2, 1))


def _make_pairs(config: PairConfig, index: np.ndarray, threads: int) -> Pairs:
    scenes = make_scenes(config.scene, config.seed, index, threads)
    directions = config.sensor.directions()
    rays = Rays(scenes.pose.position, directions, rotation_of(scenes.pose.yaw, scenes.pose.pitch))
    dt = cast_rays(scenes.primitives, scenes.in_prior, rays, threads)
    robot = cast_rays(scenes.primitives, scenes.in_real, rays, threads)
    # Ids of changed elements; -2 can equal no id.
    added, removed = (_changed_element(scenes, sign) for sign in (1, -1))
    changed_dt, changed_robot = dt.element == removed, robot.element == added

    # Misses are infinitely far: a ray that hits nothing passed everything, and inf > inf is False.
    testable_dt = dt.distance + np.float32(config.testable_margin) < robot.distance
    testable_robot = robot.distance + np.float32(config.testable_margin) < dt.distance
    found = np.sum((changed_dt & testable_dt) | (changed_robot & testable_robot), axis=1)
    _, alone = cast_slots(scenes.primitives, scenes.change != 0, rays, threads)
    fraction = found / np.where(np.any(scenes.change, axis=1), np.maximum(np.sum(alone >= 0, axis=1), 1), np.nan)
    noisy = robot._replace(distance=add_range_noise(robot.distance, config.range_noise, config.seed, index))
    return Pairs(
        scenes.pose, directions, dt, noisy, changed_dt, changed_robot, testable_dt, testable_robot,
        fraction.astype(np.float32), scenes.box,
    )  # fmt: skip


def _changed_element(scenes: Scenes, sign: int) -> np.ndarray:
    """(R, 1) id of the element that was added (+1) or removed (-1)."""
    changed = scenes.change == sign
    return np.max(np.where(changed, scenes.primitives.element, -2), axis=1, keepdims=True)


def joined(parts: list[Pairs]) -> Pairs:
    """The rooms of all parts in one; they share their directions."""

    def join(*values):
        if isinstance(values[0], tuple):
            return type(values[0])(*(join(*fields) for fields in zip(*values, strict=True)))
        return np.concatenate(values)

    shared = parts[0].directions
    rooms = join(*(part._replace(directions=np.zeros((0, 3), np.float32)) for part in parts))
    return rooms._replace(directions=shared)
