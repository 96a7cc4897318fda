"""A room becomes a prior and a reality that differ in one object or several, seen from one pose.

Draws are rejected until the changed objects stand free and in view; every attempt has its own keys, so a room's
outcome depends on nothing but its seed and index. R rooms, K slots of primitives, the last M for the changed objects.
"""

import dataclasses
from typing import NamedTuple

import numpy as np

from warp_scanner import draws
from warp_scanner.rooms import rooms
from warp_scanner.rooms.changes import ADDED, PARTS, REMOVED, TOUCHING, Part, Ranges, Room, place_parts
from warp_scanner.rooms.rooms import RoomConfig
from warp_scanner.rooms.standing import Standing, draw_poses
from warp_scanner.scenes import scenes
from warp_scanner.scenes.scenes import GAP, Primitives
from warp_scanner.sensors.poses import Pose
from warp_scanner.sensors.sense import cast_which
from warp_scanner.sensors.sensors import OAK_D_PRO_SMALL, Sensor

SCENARIOS = ("pillar_added", "wall_added", "pillar_removed", "wall_removed")
CROWDED = "many_added"  # two to six: to learn from, not for data sets, which hold up to four
MULTI_SCENARIOS = tuple(name for name in PARTS if name not in (*SCENARIOS, "unchanged", CROWDED))
CONDITIONS = ("clean", "occluded")

_ATTEMPT_LIMIT = 2000
_AT_ONCE = 32  # attempts, of all rooms that wait together
_GRID = (320, 200)  # columns and rows
_COARSE = 4  # the preview casts every 4th column and row of the grid that counts


@dataclasses.dataclass(frozen=True)
class SceneConfig:
    """Which scenes to draw; lengths in metres."""

    scenario: str = "pillar_added"  # one of SCENARIOS or MULTI_SCENARIOS, "unchanged" or CROWDED
    condition: str = "clean"  # "clean": no furniture; "occluded": with it
    room: RoomConfig = RoomConfig()
    standing: Standing = Standing()
    sensor: Sensor = OAK_D_PRO_SMALL  # its view, not its rays, has to hold the changed object
    # Of changed walls; all else is drawn from the ranges of the room's own walls and pillars, so that nothing tells
    # what changed by its size or its turn.
    wall_length: tuple[float, float] = (1.5, 4.5)
    mismatch_gap: float = 0.3  # least gap between the changed object and everything else
    touching: str = "never"  # changed walls end at existing "structure", or "walls": further ones at the first of them
    prior_furniture: str = "none"  # or "moved": the occluded prior holds reality's furniture at other places
    minimum_rays: int = 60  # of a 320 x 200 grid that hit the changed object when there is no furniture
    furniture_share: float = 0.05  # least share of rays that hit furniture in the occluded scene
    places: int = 96  # places of the changed object tried per attempt
    attempts_per_layout: int = 20  # attempts before the room itself is drawn anew

    def __post_init__(self):
        words = (
            ("scenario", tuple(PARTS)),
            ("condition", CONDITIONS),
            ("touching", TOUCHING),
            ("prior_furniture", ("none", "moved")),
        )
        for name, allowed in words:
            if getattr(self, name) not in allowed:
                raise ValueError(f"{name} must be one of {allowed}, got {getattr(self, name)!r}")
        if not 0.0 < self.wall_length[0] <= self.wall_length[1] <= 100.0:
            raise ValueError(f"wall_length must be (low, high) within 0 and 100 m, got {self.wall_length}")
        if not 0.0 <= self.mismatch_gap <= 10.0 or not 0 <= self.minimum_rays <= 64_000:
            got = f"{self.mismatch_gap} and {self.minimum_rays}"
            raise ValueError(f"mismatch_gap must lie within 0 and 10 m, minimum_rays within 0 and 64000, got {got}")
        if not 0.0 <= self.furniture_share <= 0.5:
            raise ValueError(f"furniture_share must be between 0 and 0.5, got {self.furniture_share}")

    @property
    def parts(self) -> tuple[Part, ...]:
        """The objects that change."""
        return PARTS[self.scenario]

    @property
    def prior_slots(self) -> int:
        """Slots for furniture that stands in the prior only, just before those of the changed objects."""
        return rooms.furniture_slots(self.room) if self.prior_furniture == "moved" else 0

    @property
    def ranges(self) -> Ranges:
        """What the changed objects are drawn from."""
        room = self.room
        sizes = (room.pillar_width, self.wall_length, room.wall_thickness)
        turns = (room.pillar_rotation, room.wall_rotation)
        gaps = (self.mismatch_gap, self.standing.gap)
        return Ranges(*sizes, *turns, *gaps, self.sensor.azimuths, self.touching, self.places)

    @property
    def grid(self) -> Sensor:
        """The sensor with the 320 x 200 rays that `minimum_rays` counts on."""
        return self.sensor.resampled(*_GRID)

    @property
    def least_rays(self) -> int:
        """`minimum_rays` for the rays that the grid really has: a sensor of one channel has one row."""
        rows, columns = self.grid.shape
        return max(1, self.minimum_rays * rows * columns // (_GRID[0] * _GRID[1]))


class TrueBox(NamedTuple):
    """The changed objects of R rooms, M each; NaN, NOTHING, 0 and -1 where there are fewer."""

    center: np.ndarray  # (R, M, 3) float32 [m] world
    size: np.ndarray  # (R, M, 3) float32 [m] full edge lengths along the own axes
    yaw: np.ndarray  # (R, M) float32 [deg]
    object_type: np.ndarray  # (R, M) uint8: scenes.PILLAR or scenes.WALL
    change: np.ndarray  # (R, M) int8: +1 added, -1 removed
    element: np.ndarray  # (R, M) int32 id in the scans
    moved_from: np.ndarray  # (R, M) int32: which of the M it was before it moved; -1 for what did not


class Scenes(NamedTuple):
    """R pairs of prior and reality."""

    primitives: Primitives  # (R, K) everything that is in the prior, in reality or in both
    in_prior: np.ndarray  # (R, K) bool
    in_real: np.ndarray  # (R, K) bool
    change: np.ndarray  # (R, K) int8: +1 added, -1 removed, 0 the same
    box: TrueBox
    pose: Pose  # of the sensor in both
    size: np.ndarray  # (R, 3) float32 [m] inside of the shells


def make_scenes(config: SceneConfig, seed: int, index: np.ndarray, threads: int | None = None) -> Scenes:
    """Scenes of the given indices; each a pure function of (config, seed, its index).

    The two conditions of one index share room, pose and changed object. The changed object stands at least
    `mismatch_gap` from all else, furniture included, wholly inside the shell.

    Raises:
        RuntimeError: a room admits no scene within 2000 attempts.
    """
    index = np.asarray(index)
    layout, size = _layout(config, seed, index, 0)
    nobody = scenes.take(layout, np.zeros(0, int)), size[:0]
    parts = [_attempt(config, (seed, index[:0], 0), nobody, threads)]  # gives a call without rooms its shapes
    pending, attempt = np.arange(len(index)), 0
    while len(pending):
        if attempt >= _ATTEMPT_LIMIT:
            where = f"{config.scenario} scene for index {index[pending[0]]}"
            raise RuntimeError(f"no {where} in {_ATTEMPT_LIMIT} attempts; the room settings leave too little space")
        if attempt and attempt % config.attempts_per_layout == 0:
            layout, size = _layout(config, seed, index[pending], attempt // config.attempts_per_layout)
        # Few rooms try several times at once, within their layout: each keeps the first attempt that succeeds.
        ahead = max(1, _AT_ONCE // len(pending))
        ahead = min(ahead, config.attempts_per_layout - attempt % config.attempts_per_layout, _ATTEMPT_LIMIT - attempt)
        room = np.repeat(np.arange(len(pending)), ahead)
        tried = (seed, index[pending[room]], attempt + np.tile(np.arange(ahead), len(pending)))
        chosen, primitives, pose = _attempt(config, tried, (scenes.take(layout, room), size[room]), threads)
        done, first = np.unique(room[chosen], return_index=True)
        parts.append((pending[done], *_rows(primitives, pose, first), size[done]))
        waiting = np.delete(np.arange(len(pending)), done)
        pending, layout, size = pending[waiting], scenes.take(layout, waiting), size[waiting]
        attempt += ahead
    parts[0] = (*parts[0], size[:0])
    order = np.argsort(np.concatenate([part[0] for part in parts]), kind="stable")
    primitives = Primitives(*(np.concatenate(f)[order] for f in zip(*(part[1] for part in parts), strict=True)))
    pose = Pose(*(np.concatenate(f)[order] for f in zip(*(part[2] for part in parts), strict=True)))
    size = np.concatenate([part[3] for part in parts])[order]
    return _as_scenes(config, primitives, pose, size)


def _layout(config: SceneConfig, seed: int, index: np.ndarray, variant: int) -> tuple[Primitives, np.ndarray]:
    """Rooms without changes, with the furniture of the prior if it has any, and their sizes."""
    layout = rooms.make_rooms(config.room, seed, index, variant, threads=1)
    if config.prior_slots:
        layout = scenes.join(layout, rooms.rearranged(config.room, seed, index, variant))
    return layout, rooms.room_sizes(config.room, seed, index, variant)


def _as_scenes(config: SceneConfig, primitives: Primitives, pose: Pose, size: np.ndarray) -> Scenes:
    structure, there = scenes.is_structure(primitives), primitives.kind != GAP
    columns, count = _columns(config, primitives), len(config.parts)
    change = np.zeros(there.shape, np.int8)
    last = slice(there.shape[1] - count, None)
    change[:, last] = np.array([part.change for part in config.parts], np.int8) * there[:, last]
    occluded = config.condition == "occluded"
    in_prior = (structure | (there & ~columns & occluded)) & (change != ADDED)
    in_real = (structure | (there & columns & occluded)) & (change != REMOVED)
    moved_from = np.array([part.moved_from for part in config.parts], np.int32)
    objects, here = scenes.take_slots(primitives, last), there[:, last]
    box = TrueBox(
        np.where(here[..., None], objects.center, np.nan).astype(np.float32),
        np.where(here[..., None], 2.0 * objects.half_size, np.nan).astype(np.float32),
        np.where(here, np.degrees(objects.yaw), np.nan).astype(np.float32),
        objects.semantic,
        change[:, last],
        objects.element,
        np.where(here, moved_from, -1).astype(np.int32),
    )
    return Scenes(primitives, in_prior, in_real, change, box, pose, size.astype(np.float32))


def _attempt(
    config: SceneConfig, which: tuple, layout: tuple[Primitives, np.ndarray], threads: int | None
) -> tuple[np.ndarray, Primitives, Pose]:
    """One attempt at every room of the layout: which rooms succeeded, with their primitives and poses.

    The tests go from cheap to dear, and each sees only the rooms that passed those before.
    """
    (seed, index, attempt), (primitives, size) = which, layout
    key = draws.keys(seed, index, attempt, list(PARTS).index(config.scenario))
    pose, good = draw_poses(primitives, size, config.standing, key)
    chosen = np.flatnonzero(good)
    primitives, pose = _rows(primitives, pose, chosen)
    room = Room(primitives, size[chosen], pose, key[chosen])
    objects, placed = place_parts(config.parts, config.ranges, room, rooms.element_count(config.room))
    chosen, placed = chosen[placed], np.flatnonzero(placed)
    primitives, pose = _rows(scenes.join(primitives, objects), pose, placed)
    for test in (_has_furniture_in_view, _shows_the_change):
        good = np.flatnonzero(test(config, primitives, pose, threads))
        chosen, (primitives, pose) = chosen[good], _rows(primitives, pose, good)
    return chosen, primitives, pose


def _rows(primitives: Primitives, pose: Pose, chosen: np.ndarray) -> tuple[Primitives, Pose]:
    return scenes.take(primitives, chosen), Pose(*(field[chosen] for field in pose))


def _has_furniture_in_view(config: SceneConfig, primitives: Primitives, pose: Pose, threads: int | None) -> np.ndarray:
    """(R,) bool: enough furniture is in view, and at least a glimpse of each changed object.

    Asked of clean scenes too, because the two conditions share room, pose and changed objects.
    """
    preview = config.sensor.resampled(*(count // _COARSE for count in _GRID))
    structure = scenes.is_structure(primitives)
    furniture = ~structure & _columns(config, primitives)
    slot = _reached(primitives, structure | furniture, (preview, pose), threads)
    hit = (slot >= 0) & np.take_along_axis(furniture, np.maximum(slot, 0), 1)
    enough = hit.mean(axis=1) >= config.furniture_share
    if not config.parts:
        return enough
    slot = _reached(primitives, structure, (preview, pose), threads)
    return enough & _all_seen(config, primitives, slot, 1)


def _columns(config: SceneConfig, primitives: Primitives) -> np.ndarray:
    """(K,) bool: False for the slots of furniture that stands in the prior only."""
    column = np.arange(primitives.kind.shape[1])
    end = len(column) - len(config.parts)
    return (column < end - config.prior_slots) | (column >= end)


def _all_seen(config: SceneConfig, primitives: Primitives, slot: np.ndarray, least: int) -> np.ndarray:
    """(R,) bool: at least so many rays (R, P), told by the slot they hit, hit each changed object that is there."""
    first = primitives.kind.shape[1] - len(config.parts)
    hits = [np.sum(slot == first + part, axis=1) for part in range(len(config.parts))]
    return np.all(
        [(count >= least) | (primitives.kind[:, first + part] == GAP) for part, count in enumerate(hits)], axis=0
    )


def _shows_the_change(config: SceneConfig, primitives: Primitives, pose: Pose, threads: int | None) -> np.ndarray:
    """(R,) bool: enough rays hit each changed object in the clean scene that contains them all."""
    if not config.parts or len(primitives.kind) == 0:
        return np.ones(len(primitives.kind), bool)
    slot = _reached(primitives, scenes.is_structure(primitives), (config.grid, pose), threads)
    return _all_seen(config, primitives, slot, config.least_rays)


def _reached(primitives: Primitives, present: np.ndarray, seen: tuple[Sensor, Pose], threads: int | None) -> np.ndarray:
    """(R, P) slot that each ray meets within the sensor's reach, -1 for none."""
    (sensor, pose), (low, high) = seen, np.float32(seen[0].range_limits)
    distance, slot = cast_which(primitives, present, sensor, pose, threads)
    return np.where((distance >= low) & (distance <= high), slot, -1)
