"""A room becomes a prior and a reality that differ in one object, seen from one pose.

Draws are rejected until the changed object stands free and in view; every attempt has its own keys, so a room's
outcome depends on nothing but its seed and index. R rooms, K slots of primitives (the last one is the changed object).
"""

import dataclasses
from typing import NamedTuple

import numpy as np

from warp_scanner import draws, footprints, rooms, scenes
from warp_scanner.footprints import Footprints
from warp_scanner.rooms import RoomConfig
from warp_scanner.scan import Rays, cast_slots
from warp_scanner.scenes import BOX, CHAIR, CYLINDER, GAP, PILLAR, TABLE, WALL, Primitives
from warp_scanner.sensors import Pinhole, Pose, Standing, draw_poses, rotation_of

SCENARIOS = ("pillar_added", "wall_added", "pillar_removed", "wall_removed")
CONDITIONS = ("clean", "occluded")

_ATTEMPT_LIMIT = 2000
_COARSE = 4  # the preview casts every 4th column and row of the grid that counts


@dataclasses.dataclass(frozen=True)
class SceneConfig:
    """Which scenes to draw; lengths in metres."""

    scenario: str = "pillar_added"  # one of SCENARIOS, or "unchanged"
    condition: str = "clean"  # "clean": no furniture in reality; "occluded": with it
    room: RoomConfig = RoomConfig()
    standing: Standing = Standing()
    horizontal_fov: float = 80.0  # [deg] of the sensor that has to see the changed object
    vertical_fov: float = 55.0
    pillar_width: tuple[float, float] = (0.3, 1.3)  # of the changed object
    wall_length: tuple[float, float] = (1.5, 4.5)
    wall_thickness: tuple[float, float] = (0.1, 0.3)
    mismatch_gap: float = 0.3  # least gap between the changed object and everything else
    minimum_rays: int = 60  # of a 320 x 200 grid that hit the changed object when there is no furniture
    furniture_share: float = 0.05  # least share of rays that hit furniture in the occluded scene
    places: int = 96  # places of the changed object tried per attempt
    attempts_per_layout: int = 20  # attempts before the room itself is drawn anew

    def __post_init__(self):
        if self.scenario not in (*SCENARIOS, "unchanged"):
            raise ValueError(f"scenario must be one of {(*SCENARIOS, 'unchanged')}, got {self.scenario!r}")
        if self.condition not in CONDITIONS:
            raise ValueError(f"condition must be one of {CONDITIONS}, got {self.condition!r}")
        if not 0.0 <= self.furniture_share <= 0.5:
            raise ValueError(f"furniture_share must be between 0 and 0.5, got {self.furniture_share}")

    @property
    def grid(self) -> Pinhole:
        """The 320 x 200 grid that `minimum_rays` counts on."""
        return Pinhole(320, 200, self.horizontal_fov, self.vertical_fov)


class TrueBox(NamedTuple):
    """The changed objects of R rooms; NaN and NOTHING where nothing changed."""

    center: np.ndarray  # (R, 3) float32 [m] world
    size: np.ndarray  # (R, 3) float32 [m] full edge lengths along the own axes
    yaw: np.ndarray  # (R,) float32 [deg]
    object_type: np.ndarray  # (R,) uint8: scenes.PILLAR or scenes.WALL


class Scenes(NamedTuple):
    """R pairs of prior and reality."""

    primitives: Primitives  # (R, K) everything that is in the prior, in reality or in both
    in_prior: np.ndarray  # (R, K) bool
    in_real: np.ndarray  # (R, K) bool
    change: np.ndarray  # (R, K) int8: +1 added, -1 removed, 0 the same
    box: TrueBox
    pose: Pose  # of the sensor in both


def make_scenes(config: SceneConfig, seed: int, index: np.ndarray, threads: int | None = None) -> Scenes:
    """Scenes of the given indices; each a pure function of (config, seed, its index).

    The two conditions of one index share room, pose and changed object. The changed object stands at least
    `mismatch_gap` from all else, furniture included, wholly inside the shell.

    Raises:
        RuntimeError: a room admits no scene within 2000 attempts.
    """
    index = np.asarray(index)
    layout = rooms.make_rooms(config.room, seed, index)
    nobody = scenes.take(layout, np.zeros(0, int))
    parts = [_attempt(config, (seed, index[:0], 0), nobody, threads)]  # gives a call without rooms its shapes
    pending, attempt = np.arange(len(index)), 0
    while len(pending):
        if attempt == _ATTEMPT_LIMIT:
            where = f"{config.scenario} scene for index {index[pending[0]]}"
            raise RuntimeError(f"no {where} in {_ATTEMPT_LIMIT} attempts; the room settings leave too little space")
        if attempt and attempt % config.attempts_per_layout == 0:
            variant = attempt // config.attempts_per_layout
            layout = rooms.make_rooms(config.room, seed, index[pending], variant)
        chosen, primitives, pose = _attempt(config, (seed, index[pending], attempt), layout, threads)
        parts.append((pending[chosen], primitives, pose))
        waiting = np.delete(np.arange(len(pending)), chosen)
        pending, layout = pending[waiting], scenes.take(layout, waiting)
        attempt += 1
    order = np.argsort(np.concatenate([part[0] for part in parts]), kind="stable")
    primitives = Primitives(*(np.concatenate(f)[order] for f in zip(*(part[1] for part in parts), strict=True)))
    pose = Pose(*(np.concatenate(f)[order] for f in zip(*(part[2] for part in parts), strict=True)))
    return _as_scenes(config, primitives, pose)


def _as_scenes(config: SceneConfig, primitives: Primitives, pose: Pose) -> Scenes:
    structure = scenes.is_structure(primitives)
    furniture = (primitives.kind != GAP) & ~structure
    changed = np.zeros_like(structure)
    changed[:, -1] = primitives.kind[:, -1] != GAP
    added = config.scenario.endswith("added")
    in_real = structure | furniture if config.condition == "occluded" else structure
    in_prior = structure & ~changed if added else structure
    in_real = in_real if added else in_real & ~changed
    change = np.where(changed, np.int8(1 if added else -1), np.int8(0))
    last = Primitives(*(field[:, -1] for field in primitives))
    there = last.kind != GAP
    box = TrueBox(
        np.where(there[:, None], last.center, np.nan).astype(np.float32),
        np.where(there[:, None], 2.0 * last.half_size, np.nan).astype(np.float32),
        np.where(there, np.degrees(last.yaw), np.nan).astype(np.float32),
        last.semantic,
    )
    return Scenes(primitives, in_prior, in_real, change, box, pose)


def _attempt(
    config: SceneConfig, which: tuple, layout: Primitives, threads: int | None
) -> tuple[np.ndarray, Primitives, Pose]:
    """One attempt at every room of the layout: which rooms succeeded, with their primitives and poses.

    The tests go from cheap to dear, and each sees only the rooms that passed those before.
    """
    seed, index, attempt = which
    key = draws.keys(seed, index, attempt, (*SCENARIOS, "unchanged").index(config.scenario))
    pose, good = draw_poses(layout, config.room.size, config.standing, key)
    mismatch, placed = _place_mismatch(config, layout, pose, key)
    chosen = np.flatnonzero(good & placed)
    primitives, pose = _rows(scenes.join(layout, mismatch), pose, chosen)
    for test in (_has_furniture_in_view, _shows_the_change):
        good = np.flatnonzero(test(config, primitives, pose, threads))
        chosen, (primitives, pose) = chosen[good], _rows(primitives, pose, good)
    return chosen, primitives, pose


def _rows(primitives: Primitives, pose: Pose, chosen: np.ndarray) -> tuple[Primitives, Pose]:
    return scenes.take(primitives, chosen), Pose(*(field[chosen] for field in pose))


def _place_mismatch(
    config: SceneConfig, layout: Primitives, pose: Pose, key: np.ndarray
) -> tuple[Primitives, np.ndarray]:
    """The changed object as a table of one slot, at the first free place in view; and whether there is one."""
    room_count, tries = len(key), config.places
    wall = config.scenario.startswith("wall")
    angle = np.radians(pose.yaw[:, None] + config.horizontal_fov * (draws.uniform(key, "change angle", tries) - 0.5))
    heading = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=-1)
    sight, _ = cast_slots(layout, scenes.is_structure(layout), Rays(pose.position, heading), threads=1)
    # The root makes every square metre within sight as likely as any other in its direction.
    reach = sight * np.sqrt(draws.uniform(key, "change distance", tries))
    place = pose.position[:, None, :2] + reach[..., None] * heading[..., :2]
    if wall:
        along = draws.between(key, "change length", config.wall_length, tries)
        across = draws.between(key, "change thickness", config.wall_thickness, tries)
        turned = draws.uniform(key, "change turned", tries) < 0.5
        half = np.stack([np.where(turned, across, along), np.where(turned, along, across)], axis=-1) / 2
        kind = np.full((room_count, tries), BOX)
    else:
        width = draws.between(key, "change width", config.pillar_width, tries)
        half = np.stack([width, width], axis=-1) / 2
        kind = np.where(draws.uniform(key, "change round", tries) < 0.5, CYLINDER, BOX)

    everywhere = np.ones((room_count, tries), bool)
    marks = Footprints(place, half, np.zeros((room_count, tries)), everywhere)
    clear = footprints.inside(marks, np.array(config.room.size[:2]) / 2)
    # A hair more than the gaps, so that they still hold once everything is rounded to float32.
    clear &= footprints.gaps(marks, _compact(footprints.of_primitives(layout))).min(axis=2) > config.mismatch_gap + 1e-5
    sensor = footprints.point_distance(pose.position[:, None, :2].astype(np.float64), marks)[:, 0]
    clear &= sensor > config.standing.gap + 1e-5

    rows, first = np.arange(room_count), np.argmax(clear, axis=1)
    found = clear[rows, first]
    if config.scenario == "unchanged":
        return _one_slot(config, np.zeros_like(kind[:, 0]), place[rows, first], half[rows, first]), np.ones_like(found)
    return _one_slot(config, kind[rows, first], place[rows, first], half[rows, first]), found


def _one_slot(config: SceneConfig, kind: np.ndarray, place: np.ndarray, half: np.ndarray) -> Primitives:
    """A table of one full-height primitive per room, standing at `place` (R, 2); kind GAP leaves the slot empty."""
    there = kind != GAP
    semantic = WALL if config.scenario.startswith("wall") else PILLAR
    center = np.column_stack([place, np.zeros(len(kind))]) * there[:, None]
    half_size = np.column_stack([half, np.full(len(kind), config.room.size[2] / 2)]) * there[:, None]
    return Primitives(
        kind[:, None].astype(np.uint8),
        center[:, None].astype(np.float32),
        half_size[:, None].astype(np.float32),
        np.zeros((len(kind), 1), np.float32),
        np.where(there, rooms.element_count(config.room), -1)[:, None].astype(np.int32),
        np.where(there, semantic, 0)[:, None].astype(np.uint8),
    )


def _compact(marks: Footprints) -> Footprints:
    """The same rectangles without the columns that are gaps in every room."""
    order = np.argsort(~marks.valid, axis=1, kind="stable")[:, : max(1, int(marks.valid.sum(axis=1).max(initial=0)))]
    center, half_size = (np.take_along_axis(field, order[..., None], axis=1) for field in marks[:2])
    yaw, valid = (np.take_along_axis(field, order, axis=1) for field in marks[2:])
    return Footprints(center, half_size, yaw, valid)


def _rays(pose: Pose, directions: np.ndarray) -> Rays:
    return Rays(pose.position, directions, rotation_of(pose.yaw, pose.pitch))


def _has_furniture_in_view(config: SceneConfig, primitives: Primitives, pose: Pose, threads: int | None) -> np.ndarray:
    """(R,) bool: enough furniture is in view, and at least a glimpse of the changed object.

    Asked of clean scenes too, because the two conditions share room, pose and changed object.
    """
    grid = config.grid
    preview = dataclasses.replace(grid, width=grid.width // _COARSE, height=grid.height // _COARSE).directions()
    rays = _rays(pose, preview)
    _, slot = cast_slots(primitives, None, rays, threads)
    furniture = (slot >= 0) & np.isin(np.take_along_axis(primitives.semantic, np.maximum(slot, 0), 1), (TABLE, CHAIR))
    enough = furniture.mean(axis=1) >= config.furniture_share
    if config.scenario == "unchanged":
        return enough
    _, slot = cast_slots(primitives, scenes.is_structure(primitives), rays, threads)
    return enough & np.any(slot == primitives.kind.shape[1] - 1, axis=1)


def _shows_the_change(config: SceneConfig, primitives: Primitives, pose: Pose, threads: int | None) -> np.ndarray:
    """(R,) bool: enough rays hit the changed object in the clean scene that contains it."""
    if config.scenario == "unchanged" or len(primitives.kind) == 0:
        return np.ones(len(primitives.kind), bool)
    rays = _rays(pose, config.grid.directions())
    _, slot = cast_slots(primitives, scenes.is_structure(primitives), rays, threads)
    return np.sum(slot == primitives.kind.shape[1] - 1, axis=1) >= config.minimum_rays
