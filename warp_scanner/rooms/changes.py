"""Which objects a scenario changes, and where they can stand. R rooms, N places tried, M changed objects."""

from typing import NamedTuple

import numpy as np

from warp_scanner import draws
from warp_scanner.rooms import footprints
from warp_scanner.rooms.footprints import Footprints
from warp_scanner.scenes import scenes
from warp_scanner.scenes.scenes import BOX, CYLINDER, PILLAR, WALL, Primitives
from warp_scanner.sensors.poses import Pose
from warp_scanner.sensors.scan import Rays, cast_slots

ADDED, REMOVED = 1, -1
TOUCHING = ("never", "structure", "walls")


class Part(NamedTuple):
    """One changed object of a scenario."""

    semantic: int  # scenes.PILLAR or scenes.WALL
    change: int  # ADDED or REMOVED
    moved_from: int = -1  # the part that this one is, elsewhere
    optional: bool = False  # only there in scenes that draw so many


_PA, _WA, _PR, _WR = (Part(what, change) for change in (ADDED, REMOVED) for what in (PILLAR, WALL))
# The order counts: keys of the draws hold a scenario's number.
PARTS: dict[str, tuple[Part, ...]] = {
    "pillar_added": (_PA,),
    "wall_added": (_WA,),
    "pillar_removed": (_PR,),
    "wall_removed": (_WR,),
    "unchanged": (),
    "pillars_added": (_PA, _PA, _PA._replace(optional=True)),
    "walls_added": (_WA, _WA, _WA._replace(optional=True)),
    "pillars_removed": (_PR, _PR, _PR._replace(optional=True)),
    "walls_removed": (_WR, _WR, _WR._replace(optional=True)),
    "pillar_and_wall_added": (_WA, _PA),
    "pillar_and_wall_removed": (_WR, _PR),
    "pillar_added_and_removed": (_PA, _PR),
    "wall_added_and_removed": (_WA, _WR),
    "all_four": (_WA, _WR, _PA, _PR),
    "pillar_moved": (_PR, _PA._replace(moved_from=0)),
    "wall_moved": (_WR, _WA._replace(moved_from=0)),
    "many_added": (_WA, _PA, *2 * (_WA._replace(optional=True), _PA._replace(optional=True))),
}


class Ranges(NamedTuple):
    """What changed objects are drawn from, and how they stand; metres and radians."""

    pillar_width: tuple[float, float]
    wall_length: tuple[float, float]
    wall_thickness: tuple[float, float]
    pillar_rotation: tuple[float, float]  # to either side
    wall_rotation: tuple[float, float]
    gap: float  # least gap to everything else
    sensor_gap: float
    azimuths: tuple[float, float]  # [deg] right and left edge of the view that the centre lies in
    touching: str  # one of TOUCHING: what the ends of walls may touch instead
    places: int  # tried


class Room(NamedTuple):
    """Where changed objects are to stand: R rooms, all of them standing so far, and the sensor."""

    primitives: Primitives
    size: np.ndarray  # (R, 3) [m]
    pose: Pose
    key: np.ndarray  # (R,) uint64


def place_parts(parts: tuple[Part, ...], ranges: Ranges, room: Room, element: int) -> tuple[Primitives, np.ndarray]:
    """One full-height primitive for each part, at the first free place in view.

    Args:
        parts: of the scenario, M.
        ranges: sizes and gaps.
        room: what stands already.
        element: id of the first part; the others follow.

    Returns:
        The parts as a table of M slots, and (R,) bool whether all of them found a place.
    """
    found = np.ones(len(room.key), bool)
    layout, placed = room.primitives, []
    for number, part in enumerate(parts):
        suffix = f" {number}" if number else ""
        there = found.copy()
        if part.optional:
            there &= draws.uniform(room.key, f"change there{suffix}", 1)[:, 0] < 0.5
        here = room._replace(primitives=scenes.join(layout, *placed))
        marks, kind = _shapes(part, ranges, here, suffix)
        if part.moved_from >= 0:
            marks, kind = _same_shape(marks, placed[part.moved_from])
        # A hair more than the gap, so that it still holds once everything is rounded to float32.
        obstacles, gap = footprints.of_primitives(here.primitives), ranges.gap + 1e-5
        earlier = [number for number, other in enumerate(parts[:number]) if other.semantic == WALL]
        if part.semantic == WALL and ranges.touching == "walls" and earlier:
            touched = placed[earlier[0]]
            marks = _against(marks, touched, here, suffix)
            obstacles = obstacles._replace(valid=obstacles.valid & (here.primitives.element != touched.element))
        elif part.semantic == WALL and ranges.touching == "structure":
            marks, obstacles, gap = _pushed(marks, here, suffix), _thickened(here.primitives, gap), 0.0
        first = footprints.first_clear(_in_reach(marks, ranges, here), obstacles, gap)
        found &= (first >= 0) | ~there
        placed.append(_one_slot(part, marks, (kind, np.maximum(first, 0), there), (room.size, element + number)))
    return scenes.join(*placed) if placed else scenes.take_slots(layout, slice(0, 0)), found


def _shapes(part: Part, ranges: Ranges, room: Room, suffix: str) -> tuple[Footprints, np.ndarray]:
    """N objects each whose centres lie in unobstructed view, and their kinds."""
    key, tries = room.key, ranges.places
    spread = draws.uniform(key, f"change angle{suffix}", tries) - 0.5
    right, left = ranges.azimuths
    angle = np.radians(room.pose.yaw[:, None] + (right + left) / 2 + (left - right) * spread)
    heading = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=-1)
    sight, _ = cast_slots(
        room.primitives, scenes.is_structure(room.primitives), Rays(room.pose.position, heading), threads=1
    )
    # The root makes every square metre within sight as likely as any other in its direction.
    reach = sight * np.sqrt(draws.uniform(key, f"change distance{suffix}", tries))
    place = room.pose.position[:, None, :2] + reach[..., None] * heading[..., :2]
    # One size for all places that are tried: were each to have its own, small ones would be found room for more often.
    if part.semantic == WALL:
        along = draws.between(key, f"change length{suffix}", ranges.wall_length, 1)
        across = draws.between(key, f"change thickness{suffix}", ranges.wall_thickness, 1)
        turned = draws.uniform(key, f"change turned{suffix}", tries) < 0.5
        half = np.stack([np.where(turned, across, along), np.where(turned, along, across)], axis=-1) / 2
        kind = np.full(turned.shape, BOX)
    else:
        width = np.repeat(draws.between(key, f"change width{suffix}", ranges.pillar_width, 1), tries, axis=1)
        half = np.stack([width, width], axis=-1) / 2
        kind = np.repeat(np.where(draws.uniform(key, f"change round{suffix}", 1) < 0.5, CYLINDER, BOX), tries, axis=1)
    rotation = ranges.wall_rotation if part.semantic == WALL else ranges.pillar_rotation
    yaw = draws.between(key, f"change rotation{suffix}", rotation, tries)
    yaw = np.where(draws.uniform(key, f"change side{suffix}", tries) < 0.5, 0.0 - yaw, yaw)
    return Footprints(place, half, np.where(kind == BOX, yaw, 0.0), np.ones(kind.shape, bool)), kind


def _same_shape(marks: Footprints, other: Primitives) -> tuple[Footprints, np.ndarray]:
    """The places, each with the shape of the one object of `other`."""
    shape = marks.valid.shape
    half = np.broadcast_to(other.half_size[:, :, :2].astype(np.float64), (*shape, 2))
    return marks._replace(half_size=half, yaw=np.broadcast_to(other.yaw, shape)), np.broadcast_to(other.kind, shape)


def _axes(yaw: np.ndarray, long_x: np.ndarray) -> np.ndarray:
    """(..., 2) unit vectors along the longer edge of rectangles."""
    yaw = yaw + np.where(long_x, 0.0, np.pi / 2)
    return np.stack([np.cos(yaw), np.sin(yaw)], axis=-1)


def _pushed(marks: Footprints, room: Room, suffix: str) -> Footprints:
    """Walls pushed along their length until the end meets structure."""
    long_x = marks.half_size[..., 0] > marks.half_size[..., 1]
    length, thickness = marks.half_size.max(axis=-1), marks.half_size.min(axis=-1)
    way = np.where(draws.uniform(room.key, f"change push{suffix}", long_x.shape[1]) < 0.5, -1.0, 1.0)
    axis = _axes(marks.yaw, long_x) * way[..., None]
    normal = np.stack([-axis[..., 1], axis[..., 0]], axis=-1)
    # Both edges and the middle look ahead; the nearest of what they meet stops the wall.
    starts = [marks.center + side * thickness[..., None] * normal for side in (-1.0, 0.0, 1.0)]
    origin = np.concatenate(starts, axis=1)
    origin = np.concatenate([origin, np.broadcast_to(room.pose.position[:, None, 2:], (*origin.shape[:2], 1))], axis=-1)
    direction = np.tile(np.concatenate([axis, np.zeros_like(axis[..., :1])], axis=-1), (1, 3, 1))
    structure = scenes.is_structure(room.primitives)
    distance, _ = cast_slots(room.primitives, structure, Rays(origin, direction), threads=1)
    distance = distance.reshape(len(distance), 3, long_x.shape[1]).min(axis=1)
    met = np.isfinite(distance)
    # A tenth of a millimetre keeps what touches from sharing a volume once it is rounded.
    shift = np.where(met, distance - length - 1e-4, 0.0)
    return marks._replace(center=marks.center + shift[..., None] * axis, valid=marks.valid & met)


def _against(marks: Footprints, wall: Primitives, room: Room, suffix: str) -> Footprints:
    """Walls whose end meets a face of the one wall of `wall`: anywhere along it (a T) or at its end (an L)."""
    half = wall.half_size[:, :, :2].astype(np.float64)
    long_x = half[..., 0] > half[..., 1]
    along = _axes(wall.yaw.astype(np.float64), long_x)
    across = np.stack([-along[..., 1], along[..., 0]], axis=-1)
    length, thickness = marks.half_size.max(axis=-1), marks.half_size.min(axis=-1)
    spread = 2.0 * draws.uniform(room.key, f"change along{suffix}", length.shape[1]) - 1.0
    corner = draws.uniform(room.key, f"change corner{suffix}", length.shape[1]) < 0.5
    slide = np.where(corner, np.sign(spread), spread) * (half.max(axis=-1) - thickness)
    side = np.where(draws.uniform(room.key, f"change face{suffix}", length.shape[1]) < 0.5, -1.0, 1.0)
    away = side * (half.min(axis=-1) + length + 1e-4)
    center = wall.center[:, :, :2] + slide[..., None] * along + away[..., None] * across
    own = np.stack([np.where(long_x, thickness, length), np.where(long_x, length, thickness)], axis=-1)
    return Footprints(center, own, np.broadcast_to(wall.yaw.astype(np.float64), length.shape), marks.valid)


def _thickened(primitives: Primitives, gap: float) -> Footprints:
    """Everything that stands, furniture grown by the gap, so that nothing but structure can be touched."""
    marks = footprints.of_primitives(primitives)
    grown = np.where(scenes.is_structure(primitives), 0.0, gap)[..., None]
    return marks._replace(half_size=marks.half_size + grown)


def _in_reach(marks: Footprints, ranges: Ranges, room: Room) -> Footprints:
    """Only what lies inside the shell and far enough from the sensor."""
    sensor = room.pose.position[:, :2].astype(np.float64)
    valid = marks.valid & footprints.inside(marks, room.size[:, None, :2] / 2)
    valid &= footprints.point_distance(sensor, marks) > ranges.sensor_gap + 1e-5
    return marks._replace(valid=valid)


def _one_slot(part: Part, marks: Footprints, chosen: tuple, where: tuple) -> Primitives:
    """A table of one full-height primitive per room: the chosen place, or a gap where none is wanted."""
    (kinds, first, there), (size, element) = chosen, where
    rows = np.arange(len(first))
    center, half, yaw = (field[rows, first] for field in marks[:3])
    tags = scenes.Tags(kinds[rows, first][:, None], element, part.semantic)
    half = [half[:, 0, None], half[:, 1, None], size[:, 2, None] / 2]
    return scenes.solids(there[:, None], [center[:, 0, None], center[:, 1, None], 0.0], half, yaw[:, None], tags)
