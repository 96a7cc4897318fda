"""(config, index) to pairs of scans with their truth: a pure function, so any machine can make any part of a data set.

R rooms, P pixels. World frame: metres, z up.
"""

import dataclasses
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np

from warp_scanner import draws
from warp_scanner.launches import thread_count
from warp_scanner.rooms.rooms import THESIS, VARIED, RoomConfig
from warp_scanner.rooms.scenarios import SceneConfig, Scenes, TrueBox, make_scenes
from warp_scanner.rooms.settings import check_seed
from warp_scanner.rooms.standing import Standing
from warp_scanner.scenes.scenes import GAP, Primitives
from warp_scanner.sensors.poses import Pose
from warp_scanner.sensors.scan import Rays, Scan, cast_slots
from warp_scanner.sensors.sense import cast, cast_which, measured, rays_of, with_noise, within_reach
from warp_scanner.sensors.sensors import OAK_D_PRO_SMALL, Sensor

_SCENES_AT_ONCE = 64  # scenes are drawn together, so that few of them wait for the last
_MOST = {"sensor_pitch_spread": 60.0, "angle_error": 45.0}  # [deg]; of lengths 10 m
_RAYS_AT_ONCE = 2**20  # bounds the memory of what is only needed on the way


@dataclasses.dataclass(frozen=True)
class PairConfig:
    """Which pairs to make; lengths in metres."""

    seed: int = 0
    scenario: str = "pillar_added"  # see SceneConfig
    condition: str = "clean"  # or "occluded"
    room: RoomConfig = RoomConfig()
    sensor: Sensor = OAK_D_PRO_SMALL  # errs in the robot scan only; the DT scan shares its reach
    sensor_height: float = 1.0  # above the floor
    sensor_gap: float = 0.3  # least distance from the sensor to anything that stands in the room
    range_noise: float = 0.0  # standard deviation of the robot's ranges, on top of the sensor's own
    range_noise_spread: float = 0.0  # each room draws its own up to this above or below, but none below 0
    erring_share: float = 1.0  # of the rooms in which the sensor has its imperfections, and the robot its pose error
    testable_margin: float = 0.1  # ranges must differ by more than this to tell prior and reality apart
    furniture_share: float = 0.05  # least share of rays that hit furniture in the occluded scene
    sensor_height_spread: float = 0.0  # the height is drawn up to this above or below
    sensor_pitch_spread: float = 0.0  # [deg] the pitch is drawn up to this above or below level
    wall_length: tuple[float, float] = (1.5, 4.5)  # of changed walls; see SceneConfig
    mismatch_gap: float = 0.3  # least gap between a changed object and everything else
    minimum_rays: int = 60  # of 320 x 200 that hit each changed object in the clean scene, from the assumed pose
    touching: str = "never"  # see SceneConfig
    prior_furniture: str = "none"  # see SceneConfig
    position_error: float = 0.0  # standard deviation of each coordinate of the robot's true place about the assumed one
    angle_error: float = 0.0  # [deg] standard deviation of its true yaw and pitch about the assumed ones

    def __post_init__(self):
        check_seed(self.seed)
        spreads = (
            "sensor_height_spread", "sensor_pitch_spread", "position_error", "angle_error", "range_noise_spread",
        )  # fmt: skip
        for name in ("sensor_gap", "range_noise", "testable_margin", *spreads):
            if not 0.0 <= getattr(self, name) <= _MOST.get(name, 10.0):
                raise ValueError(f"{name} must lie within 0 and {_MOST.get(name, 10.0):g}, got {getattr(self, name)}")
        if not hasattr(self.sensor, "directions"):
            raise ValueError(f"sensor must be one as sensors.sensor_named gives, got {self.sensor!r}")
        if not 0.0 <= self.erring_share <= 1.0:
            raise ValueError(f"erring_share must be between 0 and 1, got {self.erring_share}")
        if self.position_error > 0.0 and self.sensor_gap == 0.0:
            raise ValueError("position_error needs a sensor_gap: it puts the robot anywhere within that")
        lowest, highest = self.sensor_height - self.sensor_height_spread, self.sensor_height + self.sensor_height_spread
        if not 0.0 < lowest <= highest < self.room.size[2] - self.room.size_spread[2]:
            raise ValueError(f"sensor_height must lie inside the room, got {lowest} to {highest}")
        if lowest < self.sensor_gap:
            raise ValueError(f"sensor_height must leave sensor_gap to the floor, got {lowest} and {self.sensor_gap}")
        _ = self.scene  # checks scenario and condition

    @property
    def scene(self) -> SceneConfig:
        """The part of the settings that fixes the scenes."""
        return SceneConfig(
            scenario=self.scenario,
            condition=self.condition,
            room=self.room,
            standing=Standing(
                (self.sensor_height - self.sensor_height_spread, self.sensor_height + self.sensor_height_spread),
                self.sensor_gap,
                pitch=(-self.sensor_pitch_spread, self.sensor_pitch_spread),
            ),
            sensor=self.sensor,
            furniture_share=self.furniture_share,
            wall_length=self.wall_length,
            mismatch_gap=self.mismatch_gap,
            minimum_rays=self.minimum_rays,
            touching=self.touching,
            prior_furniture=self.prior_furniture,
        )


PRESETS = {
    "thesis": PairConfig(room=THESIS),
    "varied": PairConfig(
        room=VARIED,
        sensor_height=1.3,  # 0.4 to 2.2 m
        sensor_height_spread=0.9,
        sensor_pitch_spread=15.0,
    ),
}


# Poses of R sensors, their P directions, ranges (R, P) [m] of both scans, inf = none: DT, robot -> better poses.
Localise = Callable[[Pose, np.ndarray, np.ndarray, np.ndarray], Pose]


class Pairs(NamedTuple):
    """A DT scan and a robot scan of each of R rooms with the truth about every ray; M changed objects, with gaps.

    The truth is that of the robot scan before its sensor erred, but for what is out of the sensor's reach: a ray
    without a return tells nothing, so no DT point is testable by it. Without a pose error both scans share their rays.
    With one, testability is still of the noise-free geometry as the robot's true place shows it: a robot ray is
    compared with the prior along itself, a DT point with reality along the ray from the true place to the point, if
    that ray lies in the true field of view.
    """

    pose: Pose  # of the DT scan, and where the robot is believed to be
    directions: np.ndarray  # (P, 3) float32 unit vectors in the sensor frame, shared by all rooms
    dt: Scan  # of the prior, (R, P)
    robot: Scan  # of reality, (R, P), from `true_pose`, ranges with noise
    changed_dt: np.ndarray  # (R, P) bool: the ray hits a removed element in the prior
    changed_robot: np.ndarray  # (R, P) bool: the ray hits an added element in reality
    testable_dt: np.ndarray  # (R, P) bool: reality returns from behind the prior's point by more than the margin
    testable_robot: np.ndarray  # (R, P) bool: reality ends in front of the prior by more than the margin
    observable_fraction: np.ndarray  # (R, M) float32: testable rays of a changed object / rays that hit it alone; NaN
    box: TrueBox  # of the changed objects, (R, M)
    true_pose: Pose  # where the robot scan was taken from
    size: np.ndarray  # (R, 3) float32 [m] inside of the shells
    prior: Primitives  # (R, K) what the building model holds


def make_pairs(
    config: PairConfig, index: np.ndarray, threads: int | None = None, localise: Localise | None = None
) -> Pairs:
    """Pairs of the given room numbers; a pure function of (config, index) for every single room.

    Args:
        config: what to make.
        index: (R,) room numbers, at least 0.
        threads: how many to use; by default one for each core it may run on.
        localise: where the robot believes to be once it has compared both scans; the prior is then scanned from there.

    Raises:
        ValueError: index is not (R,) or holds a negative number, or threads are fewer than one.
        RuntimeError: the settings leave no space for a scene.
    """
    index = np.asarray(index)
    if index.ndim != 1 or not np.issubdtype(index.dtype, np.integer) or np.any(index < 0):
        raise ValueError(f"index must be (R,) integers of at least 0, got {index.dtype} {index.shape}")
    threads = thread_count(threads)
    size = max(1, min(_SCENES_AT_ONCE, -(-len(index) // threads)))
    starts = range(0, max(len(index), 1), size)
    with ThreadPoolExecutor(threads) as pool:
        # Rooms are shared out first; only a lone part leaves threads for its rays.
        inner = threads if len(starts) == 1 else 1
        parts = list(pool.map(lambda start: _make_pairs(config, index[start : start + size], inner, localise), starts))
    return joined([part for few in parts for part in few])


def _make_pairs(config: PairConfig, index: np.ndarray, threads: int, localise: Localise | None) -> list[Pairs]:
    scenes = make_scenes(config.scene, config.seed, index, threads)
    directions = config.sensor.directions()
    at_once = max(1, _RAYS_AT_ONCE // len(directions))
    parts = [slice(start, start + at_once) for start in range(0, max(len(index), 1), at_once)]
    return [_scanned(config, rows_of(scenes, part), (index[part], directions, localise), threads) for part in parts]


def _scanned(config: PairConfig, scenes: Scenes, which: tuple, threads: int) -> Pairs:
    """Both scans of some scenes, given their room numbers, the sensor's directions, and how the robot is localised."""
    index, directions, localise = which
    true_pose = _true_pose(config, scenes.pose, index)
    prior, reality = (scenes.primitives, scenes.in_prior), (scenes.primitives, scenes.in_real)
    endless = cast(*prior, config.sensor, scenes.pose, threads)
    dt = within_reach(endless, config.sensor)
    robot = within_reach(cast(*reality, config.sensor, true_pose, threads), config.sensor)
    noisy = _erring(config, robot, (reality, true_pose), index, threads)
    if localise is not None:
        scenes = scenes._replace(pose=localise(scenes.pose, directions, dt.distance, noisy.distance))
        endless = cast(*prior, config.sensor, scenes.pose, threads)
        dt = within_reach(endless, config.sensor)
    changed_dt = _hits(scenes, dt, -1)
    changed_robot = _hits(scenes, robot, 1)

    # Misses are infinitely far, and inf < inf is False. The prior's range is known however far it is.
    margin = np.float32(config.testable_margin)
    if true_pose is scenes.pose:
        reach, beyond, expected = dt.distance, robot.distance, endless.distance
    else:
        reach, beyond = _seen_from(config, scenes, (dt, true_pose), threads)
        expected, _ = cast_which(*prior, config.sensor, true_pose, threads)
    testable = ((reach + margin < beyond) & (beyond < np.inf), robot.distance + margin < expected)
    fraction = _observable(config, scenes, ((dt, scenes.pose), (robot, true_pose), testable), threads)
    return Pairs(
        scenes.pose, directions, dt, noisy, changed_dt, changed_robot, *testable, fraction, scenes.box, true_pose,
        scenes.size, scenes.primitives._replace(kind=np.where(scenes.in_prior, scenes.primitives.kind, GAP)),
    )  # fmt: skip


def _erring(config: PairConfig, robot: Scan, scene: tuple, index: np.ndarray, threads: int) -> Scan:
    """The robot scan as its sensor reports it."""
    (reality, pose), which = scene, (config.seed, index)
    found = measured(robot, reality, (config.sensor, pose), which, threads)
    if config.erring_share < 1.0 and found is not robot:
        errs = _errs(config, index)[:, None]
        found = Scan(*(np.where(errs, erring, ideal) for erring, ideal in zip(found, robot, strict=True)))
    ends = (max(0.0, config.range_noise - config.range_noise_spread), config.range_noise + config.range_noise_spread)
    sigma = draws.between(draws.keys(*which), "range noise of the room", ends, 1)[:, 0]
    return with_noise(found, config.sensor, sigma, which)


def _errs(config: PairConfig, index: np.ndarray) -> np.ndarray:
    """(R,) bool: the rooms in which sensor and pose err."""
    return draws.uniform(draws.keys(config.seed, index), "errs", 1)[:, 0] < config.erring_share


def _true_pose(config: PairConfig, pose: Pose, index: np.ndarray) -> Pose:
    """Where the robot really stands: the same pose when there is no error."""
    if config.position_error == config.angle_error == 0.0:
        return pose
    key, errs = draws.keys(config.seed, index), _errs(config, index)[:, None]
    # Within the sensor's gap, so that no error puts the robot into something.
    shift = errs * config.position_error * draws.normal(key, "position error", 3)
    length = np.linalg.norm(shift, axis=1, keepdims=True)
    shift *= np.minimum(1.0, 0.9 * config.sensor_gap / np.maximum(length, 1e-9))
    turn = errs * config.angle_error * draws.normal(key, "angle error", 2)
    position = (pose.position + shift).astype(np.float32)
    return Pose(position, (pose.yaw + turn[:, 0]).astype(np.float32), (pose.pitch + turn[:, 1]).astype(np.float32))


def _hits(scenes: Scenes, scan: Scan, change: int) -> np.ndarray:
    """(R, P) bool: the ray hits an element that was added (+1) or removed (-1)."""
    hit = np.zeros(scan.element.shape, bool)
    # -2 can equal no id.
    for element in np.where(scenes.box.change == change, scenes.box.element, -2).T:
        hit |= scan.element == element[:, None]
    return hit


def _seen_from(
    config: PairConfig, scenes: Scenes, seen: tuple[Scan, Pose], threads: int
) -> tuple[np.ndarray, np.ndarray]:
    """From the true place: the distance to each DT point, inf outside the field of view, and how far reality goes.

    Where reality is out of the sensor's reach, it goes infinitely far.
    """
    dt, true_pose = seen
    assumed, true = (rays_of(config.sensor, pose) for pose in (scenes.pose, true_pose))
    there = np.isfinite(dt.distance)
    ray = assumed.direction[None] @ assumed.rotation.transpose(0, 2, 1)
    offset = assumed.origin[:, None] + np.where(there, dt.distance, 1.0)[..., None] * ray - true.origin[:, None]
    reach = np.linalg.norm(offset, axis=-1)
    toward = offset / reach[..., None]
    beyond, _ = cast_slots(scenes.primitives, scenes.in_real, Rays(true.origin, toward.astype(np.float32)), threads)
    seen = there & config.sensor.sees(toward @ true.rotation)
    low, high = config.sensor.range_limits
    beyond = np.where((beyond >= low) & (beyond <= high), beyond, np.float32(np.inf))
    return np.where(seen, reach, np.inf).astype(np.float32), beyond


def _observable(config: PairConfig, scenes: Scenes, sides: tuple, threads: int) -> np.ndarray:
    """(R, M) float32: testable rays of each changed object over the rays that hit it when it stands alone."""
    dt, robot, testable = sides
    room_count, count = scenes.box.change.shape
    fraction = np.full((room_count, count), np.nan, np.float32)
    first = scenes.change.shape[1] - count
    for part in range(count):
        alone = np.zeros(scenes.change.shape, bool)
        alone[:, first + part] = scenes.change[:, first + part] != 0
        if not np.any(alone):
            continue
        removed = bool(np.any(scenes.box.change[:, part] < 0))  # the same in all rooms of a scenario
        (scan, pose), told = (dt, testable[0]) if removed else (robot, testable[1])
        found = np.sum((scan.element == scenes.box.element[:, part, None]) & told, axis=1)
        distance, _ = cast_which(scenes.primitives, alone, config.sensor, pose, threads)
        low, high = config.sensor.range_limits
        hits = np.maximum(np.sum((distance >= low) & (distance <= high) & (distance < np.inf), axis=1), 1)
        fraction[:, part] = np.where(scenes.box.change[:, part] != 0, found / hits, np.nan)
    return fraction


def rows_of(arrays, rows):
    """The given rooms (a slice or indices) of a tuple of arrays, however deep.

    Of Pairs, whose directions are shared, take `pairs_at`.
    """
    if isinstance(arrays, tuple):
        return type(arrays)(*(rows_of(field, rows) for field in arrays))
    return arrays[rows]


def pairs_at(pairs: Pairs, rows) -> Pairs:
    """Some of the pairs."""
    fields = {name: rows_of(field, rows) for name, field in pairs._asdict().items() if name != "directions"}
    return Pairs(**fields, directions=pairs.directions)


def joined(parts: list[Pairs]) -> Pairs:
    """The rooms of all parts in one; they share their directions."""

    def join(*values):
        if isinstance(values[0], tuple):
            return type(values[0])(*(join(*fields) for fields in zip(*values, strict=True)))
        return np.concatenate(values)

    shared = parts[0].directions
    rooms = join(*(part._replace(directions=np.zeros((0, 3), np.float32)) for part in parts))
    return rooms._replace(directions=shared)
