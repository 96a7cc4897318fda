"""Seed to rooms: a shell with interior walls, doors, pillars, tables and chairs, as padded tables of primitives.

Every step works on all rooms and all objects of a kind at once: places are drawn on jittered grids and those that
would touch something are dropped. R rooms, N objects of a kind. World frame: metres, z up; a room is centred on the
origin.
"""

import dataclasses
from math import ceil, pi
from typing import NamedTuple

import numpy as np

from warp_scanner import draws, footprints
from warp_scanner.footprints import Footprints
from warp_scanner.furniture import FurnitureConfig, Range, furnish
from warp_scanner.scenes import BOX, CEILING, CYLINDER, DOOR, FLOOR, PILLAR, WALL, Primitives, Tags, join, solids

_LINES = 2  # interior walls in each direction, at most
_ROOMS_AT_ONCE = 64  # keeps the pairwise tables in the cache


@dataclasses.dataclass(frozen=True)
class RoomConfig(FurnitureConfig):
    """Ranges that rooms and their furniture are drawn from, uniformly; the defaults are the thesis's. Metres."""

    size: tuple[float, float, float] = (10.0, 10.0, 3.0)  # inside of the shell
    shell_thickness: float = 0.1
    wall_count_x: tuple[int, int] = (0, 2)  # walls across x; both ends included
    wall_count_y: tuple[int, int] = (0, 2)
    wall_thickness: Range = (0.1, 0.3)
    wall_density: Range = (0.7, 1.0)  # chance that a piece between two crossings is built
    wall_randomness: Range = (0.0, 0.8)  # offset from the regular place, in spacings, end to end
    door_share: float = 0.8  # chance that a piece of wall that is long enough has a door
    door_width: Range = (0.7, 1.3)
    door_height: float = 2.1
    door_rotation: Range = (pi, 1.75 * pi)  # [rad], pi is closed
    pillar_spacing: Range = (2.0, 5.0)
    pillar_width: Range = (0.3, 1.3)
    pillar_density: Range = (0.2, 0.7)  # chance that a place on the grid carries a pillar
    pillar_randomness: Range = (0.0, 0.8)  # as wall_randomness
    clearance: float = 0.03  # least gap between things that do not belong together

    def __post_init__(self):
        super().__post_init__()
        if min(self.size[:2]) < 2.0 or self.size[2] <= max(self.door_height, self.table_height):
            raise ValueError(f"room.size must be at least 2 m across and higher than doors and tables, got {self.size}")


class _Walls(NamedTuple):
    """Interior wall pieces, all (R, N): those across x run along y and the other way round."""

    across_x: np.ndarray  # bool
    place: np.ndarray  # [m] on the axis that the wall is across
    low: np.ndarray  # [m] where it begins on the axis it runs along
    high: np.ndarray
    thickness: np.ndarray  # (R, 1)
    valid: np.ndarray


def make_rooms(config: RoomConfig, seed: int, index: np.ndarray, variant: np.ndarray | int = 0) -> Primitives:
    """Rooms with all their furniture; a pure function of (config, seed, index, variant) for every single room.

    Args:
        config: the ranges.
        seed: at least 0.
        index: (R,) room numbers.
        variant: (R,) or one number; another layout of the same room number.

    Returns:
        R rooms with the same number of slots whatever the batch. Element ids are fixed places: floor 0, ceiling 1,
        outer walls 2-5, then room for every interior wall, door, pillar, table and chair.
    """
    index = np.asarray(index)
    variant = np.broadcast_to(np.asarray(variant), index.shape)
    starts = range(0, max(len(index), 1), _ROOMS_AT_ONCE)
    parts = [_make_rooms(config, draws.keys(seed, index[s : s + _ROOMS_AT_ONCE], variant[s : s + _ROOMS_AT_ONCE]))
             for s in starts]  # fmt: skip
    return Primitives(*(np.concatenate(fields) for fields in zip(*parts, strict=True)))


def _make_rooms(config: RoomConfig, key: np.ndarray) -> Primitives:
    element = 6
    shell = _shell(config, len(key))
    walls = _walls(config, key)
    wall_marks = _wall_footprints(walls)
    count = walls.valid.shape[1]
    wall_parts, leaves, leaf_marks = _doors(config, key, (walls, wall_marks), element)
    element += 2 * count
    pillars, pillar_marks = _pillars(config, key, footprints.join(wall_marks, leaf_marks), element)
    element += pillar_marks.valid.shape[1]
    structure_marks = footprints.join(wall_marks, leaf_marks, pillar_marks)
    inner = (config.size, config.clearance)
    return join(shell, wall_parts, leaves, pillars, *furnish(config, inner, key, structure_marks, element))


def element_count(config: RoomConfig) -> int:
    """Element ids that make_rooms may use: 0 to this, exclusive."""
    pillar_slots = ceil(config.size[0] / config.pillar_spacing[0]) * ceil(config.size[1] / config.pillar_spacing[0])
    walls = 2 * _LINES * (_LINES + 1)
    return 6 + 2 * walls + pillar_slots + config.table_limit + config.chair_limit


def _shell(config: RoomConfig, room_count: int) -> Primitives:
    x, y, z = (length / 2 for length in config.size)
    t = config.shell_thickness / 2
    everywhere = np.ones((room_count, 1), bool)
    rows = [
        ([0, 0, -z - t], [x + 2 * t, y + 2 * t, t], FLOOR),
        ([0, 0, z + t], [x + 2 * t, y + 2 * t, t], CEILING),
        ([-x - t, 0, 0], [t, y + 2 * t, z], WALL),
        ([x + t, 0, 0], [t, y + 2 * t, z], WALL),
        ([0, -y - t, 0], [x, t, z], WALL),
        ([0, y + t, 0], [x, t, z], WALL),
    ]
    return join(
        *(
            solids(everywhere, center, half, 0.0, Tags(BOX, element, semantic))
            for element, (center, half, semantic) in enumerate(rows)
        )
    )


def _walls(config: RoomConfig, key: np.ndarray) -> _Walls:
    """Lines across x and y at jittered regular places, cut where they cross and thinned by the density."""
    slots = _LINES * (_LINES + 1)
    thickness = draws.between(key, "wall thickness", config.wall_thickness, 1)
    randomness = draws.between(key, "wall randomness", config.wall_randomness, 1)
    density = draws.between(key, "wall density", config.wall_density, 1)
    lines = []
    for axis, limits in enumerate((config.wall_count_x, config.wall_count_y)):
        low, high = limits
        count = low + np.floor(draws.uniform(key, f"wall count {axis}", 1) * (high - low + 1))
        spacing = config.size[axis] / (count + 1)
        jitter = randomness * spacing * (draws.uniform(key, f"wall place {axis}", _LINES) - 0.5)
        lines.append((count, -config.size[axis] / 2 + spacing * np.arange(1, _LINES + 1) + jitter))

    pieces = []
    for axis in (0, 1):
        count, place = lines[axis]
        cut_count, cuts = lines[1 - axis]
        end = config.size[1 - axis] / 2
        number = np.arange(_LINES + 1)
        # A wall across x owns the square where two walls cross, so that no two pieces share a volume.
        begin_shift = (-0.5 if axis == 0 else 0.5) * thickness
        low = np.concatenate([np.full_like(thickness, -end), cuts + begin_shift], axis=1)
        high = np.concatenate([cuts - 0.5 * thickness, np.full_like(thickness, end)], axis=1)
        high = np.where(number < cut_count, high, end)
        exists = (np.arange(_LINES) < count)[:, :, None] & (number <= cut_count)[:, None, :]
        kept = draws.uniform(key, f"wall kept {axis}", slots).reshape(exists.shape) < density[:, :, None]
        shape = (len(key), slots)
        pieces.append(
            (
                np.full(shape, axis == 0),
                np.repeat(place, _LINES + 1, axis=1),
                np.tile(low, (1, _LINES)),
                np.tile(high, (1, _LINES)),
                (exists & kept).reshape(shape),
            )
        )
    across_x, place, low, high, valid = (np.concatenate(fields, axis=1) for fields in zip(*pieces, strict=True))
    return _Walls(across_x, place, low, high, thickness, valid & (high - low > 0.05))


def _on_wall(walls: _Walls, along: np.ndarray, offset: np.ndarray | float) -> list[np.ndarray]:
    """World x and y of a point at `along` on the axis a wall runs along, `offset` from its middle plane."""
    across = walls.place + offset
    return [np.where(walls.across_x, across, along), np.where(walls.across_x, along, across)]


def _wall_footprints(walls: _Walls) -> Footprints:
    center = np.stack(_on_wall(walls, (walls.low + walls.high) / 2, 0.0), axis=-1)
    half = np.stack(
        [(walls.high - walls.low) / 2, np.broadcast_to(walls.thickness / 2, walls.low.shape)],
        axis=-1,
    )
    return Footprints(center, half, np.where(walls.across_x, pi / 2, 0.0), walls.valid)


def _doors(config: RoomConfig, key: np.ndarray, built: tuple[_Walls, Footprints], element: int):
    """Wall pieces cut open by doors, and the door leaves: (wall primitives, leaf primitives, leaf footprints)."""
    walls, wall_marks = built
    count = walls.valid.shape[1]
    number = np.arange(count)
    width = draws.between(key, "door width", config.door_width, count)
    slack = walls.high - walls.low - width - 0.4  # at least 0.2 m of wall remains on either side
    opened = walls.valid & (slack > 0) & (draws.uniform(key, "door", count) < config.door_share)
    start = walls.low + 0.2 + draws.uniform(key, "door place", count) * np.maximum(slack, 0.0)
    start = np.where(opened, start, walls.high)
    stop = np.where(opened, start + width, walls.high)

    height, floor = config.size[2], -config.size[2] / 2
    wall_tags = Tags(BOX, element + number, WALL)

    def piece(valid, low, high, bottom):
        along, across, up = (high - low) / 2, walls.thickness / 2, (height - bottom) / 2
        half = [np.where(walls.across_x, across, along), np.where(walls.across_x, along, across), up]
        return solids(valid, [*_on_wall(walls, (low + high) / 2, 0.0), floor + bottom + up], half, 0.0, wall_tags)

    pieces = join(
        piece(walls.valid, walls.low, start, 0.0),
        piece(opened, stop, walls.high, 0.0),
        piece(opened, start, stop, config.door_height),
    )
    leaf_marks = _leaves(config, key, walls, (opened, start, stop))
    stays = leaf_marks.valid & footprints.inside(leaf_marks, np.array(config.size[:2]) / 2 - config.clearance)
    stays &= np.all(footprints.gaps(leaf_marks, wall_marks) > 0.005, axis=2)
    leaf_marks = leaf_marks._replace(valid=stays)
    leaf_marks = leaf_marks._replace(valid=footprints.thin_out(leaf_marks, config.clearance))
    leaf_half = [leaf_marks.half_size[..., 0], leaf_marks.half_size[..., 1], config.door_height / 2 - 0.01]
    leaf_center = [leaf_marks.center[..., 0], leaf_marks.center[..., 1], floor + config.door_height / 2]
    tags = Tags(BOX, element + count + number, DOOR)
    return pieces, solids(leaf_marks.valid, leaf_center, leaf_half, leaf_marks.yaw, tags), leaf_marks


def _leaves(config: RoomConfig, key: np.ndarray, walls: _Walls, opening: tuple) -> Footprints:
    """Door leaves turned about hinges that stand just off the wall's face, so that no angle cuts into the wall."""
    opened, start, stop = opening
    count = opened.shape[1]
    turn = draws.between(key, "door rotation", config.door_rotation, count)
    end = np.where(draws.uniform(key, "door hinge", count) < 0.5, -1.0, 1.0)  # which end of the opening
    face = np.where(draws.uniform(key, "door face", count) < 0.5, -1.0, 1.0)  # which side of the wall
    half_thickness = 0.02
    half_width = (stop - start) / 2 - half_thickness
    along, across = end * np.cos(turn), -face * np.sin(turn)
    middle = (start + stop) / 2 + end * half_width + along * half_width
    center = _on_wall(walls, middle, face * (walls.thickness / 2 + 0.03) + across * half_width)
    yaw = np.where(walls.across_x, np.arctan2(along, across), np.arctan2(across, along))
    half = np.stack([half_width, np.full_like(half_width, half_thickness)], axis=-1)
    return Footprints(np.stack(center, axis=-1), half, yaw, opened)


def _pillars(config: RoomConfig, key: np.ndarray, others: Footprints, element: int) -> tuple[Primitives, Footprints]:
    grid = draws.Grid(config.size[:2], config.pillar_spacing, config.pillar_randomness)
    place, exists = draws.places(key, "pillar", grid)
    count = exists.shape[1]
    half = draws.between(key, "pillar width", config.pillar_width, count) / 2
    density = draws.between(key, "pillar density", config.pillar_density, 1)
    marks = Footprints(place, np.stack([half, half], axis=-1), np.zeros_like(half), exists)
    valid = exists & (draws.uniform(key, "pillar kept", count) < density)
    valid &= footprints.inside(marks, np.array(config.size[:2]) / 2 - config.clearance)
    valid &= np.all(footprints.gaps(marks, others) > config.clearance, axis=2)
    marks = marks._replace(valid=valid)
    marks = marks._replace(valid=footprints.thin_out(marks, config.clearance))
    kind = np.where(draws.uniform(key, "pillar round", count) < 0.5, CYLINDER, BOX)
    center = [place[..., 0], place[..., 1], 0.0]
    tags = Tags(kind, element + np.arange(count), PILLAR)
    return solids(marks.valid, center, [half, half, config.size[2] / 2], 0.0, tags), marks
