"""Seed to rooms: a shell with interior walls, doors, pillars, furniture and clutter, as padded tables of primitives.

Every step works on all rooms and all objects of a kind at once: places are drawn on jittered grids and those that
would touch something are dropped. R rooms, N objects of a kind. World frame: metres, z up; a room is centred on the
origin, its floor half its height below it.
"""

import dataclasses
from concurrent.futures import ThreadPoolExecutor
from math import ceil, pi

import numpy as np

from warp_scanner import draws
from warp_scanner.launches import thread_count
from warp_scanner.rooms import footprints
from warp_scanner.rooms.clutter import ClutterConfig, build_clutter, spread_clutter
from warp_scanner.rooms.footprints import Footprints
from warp_scanner.rooms.furniture import FurnitureConfig, build_furniture, chosen_places, spread_furniture
from warp_scanner.rooms.settings import Range, check_settings
from warp_scanner.rooms.shells import Site
from warp_scanner.rooms.walls import WallConfig, cut_doors, draw_walls, wall_footprints
from warp_scanner.scenes.scenes import (
    BOX,
    CEILING,
    CYLINDER,
    FLOOR,
    PILLAR,
    WALL,
    Primitives,
    Tags,
    join,
    solids,
    take_slots,
)

_ROOMS_AT_ONCE = 512  # bounds the memory; many enough that calls cost less than numbers
_SHELL = 6  # floor, ceiling and four outer walls


@dataclasses.dataclass(frozen=True)
class RoomConfig(WallConfig, FurnitureConfig, ClutterConfig):
    """Ranges that rooms and what stands in them are drawn from, uniformly; the defaults are the thesis's. Metres."""

    size: tuple[float, float, float] = (10.0, 10.0, 3.0)  # inside of the largest shell
    size_spread: tuple[float, float, float] = (0.0, 0.0, 0.0)  # a room is smaller by up to this, drawn for each axis
    shell_thickness: float = 0.1
    corner_share: float = 0.0  # chance that one corner is closed, which makes the room an L
    corner_part: Range = (0.25, 0.5)  # of the room's length and width that the closed corner takes
    pillar_spacing: Range = (2.0, 5.0)
    pillar_width: Range = (0.3, 1.3)
    pillar_density: Range = (0.2, 0.7)  # chance that a place on the grid carries a pillar
    pillar_randomness: Range = (0.0, 0.8)  # offset from the regular place, in spacings, end to end
    pillar_rotation: Range = (0.0, 0.0)  # [rad]
    pillar_limit: int = 200  # places tried, at most
    clearance: float = 0.03  # least gap between things that do not belong together

    def __post_init__(self):
        check_settings(self, "room")
        least = np.subtract(self.size, self.size_spread)
        tallest = max(
            self.door_height,
            self.table_height,
            self.chair_height[1],
            self.cabinet_height[1] if self.cabinet_limit else 0.0,
            self.person_height[1] if self.person_limit else 0.0,
            1.5 * self.carton_size[1] if self.carton_limit else 0.0,
        )
        if min(least[:2]) < 2.0 or least[2] <= tallest:
            came = f"{self.size}" + (f" less up to {self.size_spread}" if any(self.size_spread) else "")
            raise ValueError(f"room.size must be at least 2 m across and higher than doors and furniture, got {came}")

    @property
    def pillar_count(self) -> int:
        """Pillars that a room has slots for."""
        places = [ceil(length / self.pillar_spacing[0]) for length in self.size[:2]]
        return min(places[0] * places[1], self.pillar_limit)


THESIS = RoomConfig()  # 10 x 10 x 3 m, as the thesis's generator
VARIED = RoomConfig(  # everything from a closet to a hall; what models should be trained on
    size=(20.0, 20.0, 8.0),
    size_spread=(17.0, 17.0, 5.6),
    corner_share=0.3,
    wall_count_x=(0, 3),
    wall_count_y=(0, 3),
    wall_rotation=(0.0, 0.26),
    pillar_rotation=(0.0, pi / 2),
    pillar_limit=36,
    cabinet_limit=8,
    carton_limit=10,
    person_limit=6,
)
PRESETS = {"thesis": THESIS, "varied": VARIED}


def room_sizes(config: RoomConfig, seed: int, index: np.ndarray, variant: np.ndarray | int = 0) -> np.ndarray:
    """Inside of the shells that make_rooms draws for the same arguments: (R, 3) float64 [m]."""
    index = np.asarray(index)
    return _sizes(config, draws.keys(seed, index, np.broadcast_to(np.asarray(variant), index.shape)))


def make_rooms(
    config: RoomConfig, seed: int, index: np.ndarray, variant: np.ndarray | int = 0, threads: int | None = None
) -> Primitives:
    """Rooms with everything in them; a pure function of (config, seed, index, variant) for every single room.

    Args:
        config: the ranges.
        seed: at least 0.
        index: (R,) room numbers.
        variant: (R,) or one number; another layout of the same room number.
        threads: how many to use; by default one for each core it may run on.

    Returns:
        R rooms with the same number of slots whatever the batch. Element ids are fixed places: floor 0, ceiling 1,
        outer walls 2-5, the closed corner if the settings have any, then room for every interior wall, door, pillar,
        table, chair, cabinet, carton and person.
    """
    index = np.asarray(index)
    variant = np.broadcast_to(np.asarray(variant), index.shape)
    starts = range(0, max(len(index), 1), _ROOMS_AT_ONCE)

    def part(start: int) -> Primitives:
        rows = slice(start, start + _ROOMS_AT_ONCE)
        return _make_rooms(config, draws.keys(seed, index[rows], variant[rows]))

    threads = thread_count(threads)
    if threads == 1 or len(starts) == 1:
        parts = [part(start) for start in starts]
    else:
        with ThreadPoolExecutor(threads) as pool:
            parts = list(pool.map(part, starts))
    return Primitives(*(np.concatenate(fields) for fields in zip(*parts, strict=True)))


def rearranged(config: RoomConfig, seed: int, index: np.ndarray, variant: np.ndarray | int = 0) -> Primitives:
    """The furniture and clutter of the same rooms, the same pieces at other places; what no longer fits is gone.

    Args: as make_rooms.

    Returns:
        A table of the last `furniture_slots(config)` slots of make_rooms; structure is left out.
    """
    index = np.asarray(index)
    variant = np.broadcast_to(np.asarray(variant), index.shape)
    key, place_key = draws.keys(seed, index, variant), draws.keys(seed, index, variant, 1)
    slots = slice(-furniture_slots(config), None)
    parts = [
        take_slots(_make_rooms(config, key[s : s + _ROOMS_AT_ONCE], place_key[s : s + _ROOMS_AT_ONCE]), slots)
        for s in range(0, max(len(key), 1), _ROOMS_AT_ONCE)
    ]
    return Primitives(*(np.concatenate(fields) for fields in zip(*parts, strict=True)))


def furniture_slots(config: RoomConfig) -> int:
    """How many of the slots of make_rooms, the last ones, are there for furniture and clutter."""
    parts = (
        (5, config.table_limit),
        (6, config.chair_limit),
        (1, config.cabinet_limit),
        (2, config.carton_limit),
        (4, config.person_limit),
    )
    return sum(primitives * limit for primitives, limit in parts)


def _make_rooms(config: RoomConfig, key: np.ndarray, place_key: np.ndarray | None = None) -> Primitives:
    place_key = key if place_key is None else place_key
    site, corner = _site(config, key)
    element = _SHELL + corner.kind.shape[1]
    walls = draw_walls(config, site)
    wall_marks = wall_footprints(walls)
    wall_parts, leaves, leaf_marks = cut_doors(config, site, (walls, wall_marks), element)
    element += 2 * config.piece_count
    structure_marks = footprints.join(wall_marks, leaf_marks, *([site.corner] if corner.kind.shape[1] else []))
    pillars, pillar_marks = _pillars(config, site, structure_marks, element)
    element += config.pillar_count
    structure_marks = footprints.join(structure_marks, pillar_marks)

    furniture, clutter = spread_furniture(config, site, place_key), spread_clutter(config, site, place_key)
    marks = footprints.join(*furniture, *clutter)
    stays = site.settled(marks, structure_marks)
    ends = np.cumsum([kind.valid.shape[1] for kind in (*furniture, *clutter)])[:-1]
    kept = [
        kind._replace(valid=stay) for kind, stay in zip((*furniture, *clutter), np.split(stays, ends, 1), strict=True)
    ]
    built = build_furniture(config, site, type(furniture)(*kept[:2]), element)
    element += config.table_limit + config.chair_limit
    built += build_clutter(config, site, type(clutter)(*kept[2:]), element)
    return join(_shell(config, site), corner, wall_parts, leaves, pillars, *built)


def element_count(config: RoomConfig) -> int:
    """Element ids that make_rooms may use: 0 to this, exclusive."""
    movable = config.table_limit + config.chair_limit + config.cabinet_limit + config.carton_limit + config.person_limit
    return _SHELL + (config.corner_share > 0) + 2 * config.piece_count + config.pillar_count + movable


def _sizes(config: RoomConfig, key: np.ndarray) -> np.ndarray:
    return np.array(config.size) - np.array(config.size_spread) * draws.uniform(key, "room size", 3)


def _site(config: RoomConfig, key: np.ndarray) -> tuple[Site, Primitives]:
    """The shells, and the solid block that closes a corner of some: a table without slots if the settings have none."""
    size = _sizes(config, key)
    closed = draws.uniform(key, "corner", 1) < config.corner_share
    half = size[:, :2] * draws.between(key, "corner part", config.corner_part, 2) / 2
    side = np.where(draws.uniform(key, "corner side", 2) < 0.5, -1.0, 1.0)
    center = side * (size[:, :2] / 2 - half)
    mark = Footprints(center[:, None], half[:, None], np.zeros_like(closed, float), closed)
    if config.corner_share == 0.0:
        closed = closed[:, :0]
    block = [half[:, 0, None], half[:, 1, None], size[:, 2, None] / 2]
    solid = solids(closed, [center[:, 0, None], center[:, 1, None], 0.0], block, 0.0, Tags(BOX, _SHELL, WALL))
    return Site(key, size, config.size[:2], config.clearance, mark), solid


def _shell(config: RoomConfig, site: Site) -> Primitives:
    x, y, z = (site.size[:, axis, None] / 2 for axis in range(3))
    t = config.shell_thickness / 2
    everywhere = np.ones((len(site.key), 1), bool)
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


def _pillars(config: RoomConfig, site: Site, others: Footprints, element: int) -> tuple[Primitives, Footprints]:
    key, count = site.key, config.pillar_count
    grid = draws.Grid(site.greatest, config.pillar_spacing, config.pillar_randomness, site.size[:, :2])
    place, exists = draws.places(key, "pillar", grid)
    if exists.shape[1] > count:
        place, exists = chosen_places(key, "pillar", grid, count)
    half = draws.between(key, "pillar width", config.pillar_width, count) / 2
    density = draws.between(key, "pillar density", config.pillar_density, 1)
    kind = np.where(draws.uniform(key, "pillar round", count) < 0.5, CYLINDER, BOX)
    yaw = np.where(kind == BOX, draws.between(key, "pillar rotation", config.pillar_rotation, count), 0.0)
    exists &= draws.uniform(key, "pillar kept", count) < density
    marks = Footprints(place, np.stack([half, half], axis=-1), yaw, exists)
    marks = marks._replace(valid=site.settled(marks, others))
    center = [place[..., 0], place[..., 1], 0.0]
    tags = Tags(kind, element + np.arange(count), PILLAR)
    return solids(marks.valid, center, [half, half, site.size[:, 2, None] / 2], yaw, tags), marks
