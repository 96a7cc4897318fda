"""Small, low and crowded flats, and what a laser on a tilting mount, or any other sensor, sees of them.

The other rooms are 3 to 20 m across and at least 2.4 m high, and changed walls stand free in them. Here rooms are from
1.2 m across and 2 to 2.8 m high, walls end at doors and corners, in half of the flats in between, too, and things stand
close before them. One flat a seed; K slots of primitives, N rays. World frame: metres, z up, the floor at 0.
"""

from typing import NamedTuple

import numpy as np

from warp_scanner.scenes.scenes import BOX, CEILING, CYLINDER, DOOR, FLOOR, FURNITURE, PILLAR, WALL, Primitives
from warp_scanner.sensors.scan import Rays, cast_rays
from warp_scanner.sensors.sensors import Sensor

WIDTH, DEPTH, HEIGHT = (3.5, 8.0), (3.0, 6.5), (2.0, 2.8)  # [m] of a flat
THICKNESS = (0.08, 0.2)  # [m] of its walls
NARROWEST, PARTS = 1.2, (2, 5)  # [m] of a room, and how many times a flat is parted
OUTER_DOOR, INNER_DOOR, DOOR_WIDTH, DOOR_TOP = 0.15, 0.85, (0.65, 0.9), (1.9, 2.05)  # shares and [m]
LINTEL, LEAF = 0.7, 0.3  # shares of the doors with a wall above, and with an open leaf
PARTED, STRETCH = 0.5, (0.6, 3.0)  # share of the flats whose walls are parted into elements so long [m]
COLUMN, COLUMNS = (0.15, 0.45), 0.4  # [m] width, and share of the flats that have one, about
SENSOR_HEIGHT, TO_WALLS, TO_THINGS = (0.3, 1.4), 0.45, 0.3  # [m]
SLAB = 0.1  # [m] thickness
BESIDE_WALL = 0.75  # share of the things that stand along walls
LEAST_KEPT = 0.3  # share of the points that a file keeps, at least
MOST_KEPT = 40_000
NEAREST, FARTHEST = 0.1, 15.0  # [m]


class Flat(NamedTuple):
    """A flat: each element is one primitive."""

    primitives: Primitives  # (1, K); the element of a slot is its number
    height: float  # [m]
    place: np.ndarray  # (3,) [m] where a sensor may stand


class Seen(NamedTuple):
    """What a sensor saw."""

    points: np.ndarray  # (N, 3) float64 [m]
    element: np.ndarray  # (N,) int32
    rotation: np.ndarray  # (3, 3) sensor frame to world


class _Solid(NamedTuple):
    center: np.ndarray  # (3,) [m]
    size: np.ndarray  # (3,) [m] along its own axes
    yaw: float  # [rad]
    semantic: int
    kind: int = BOX


def make_flat(rng: np.random.Generator, built_in: bool = False) -> Flat:
    """Rooms behind each other, doors, things, perhaps a column, and a place for a sensor in one of the rooms.

    Args:
        rng: draws it.
        built_in: whether cupboards reach up to the ceiling, too.
    """
    width, depth, height, thickness = (float(rng.uniform(*one)) for one in (WIDTH, DEPTH, HEIGHT, THICKNESS))
    rooms, lines = _parted(rng, width, depth)
    middle, over = np.array([width / 2, depth / 2]), np.array([width + 1.0, depth + 1.0, SLAB])
    solids = [
        _Solid(np.array([*middle, z]), over, 0.0, kind)
        for z, kind in ((-SLAB / 2, FLOOR), (height + SLAB / 2, CEILING))
    ]
    corners = np.array([(0.0, 0.0), (width, 0.0), (width, depth), (0.0, depth)])
    parted = bool(rng.random() < PARTED)
    shell = [(corners[one], corners[(one + 1) % 4], OUTER_DOOR) for one in range(4)]
    for start, end, doors in [*shell, *((*line, INNER_DOOR) for line in lines)]:
        solids += _wall(rng, (start, end), (thickness, height), (rng.random() < doors, parted))
    low, high = rooms[rng.integers(len(rooms))]
    place = np.array([*rng.uniform(low + TO_WALLS, high - TO_WALLS), rng.uniform(*SENSOR_HEIGHT)])
    things = [one for low, high in rooms for one in _things(rng, (low, high), thickness, height)]
    things += [one for low, high in rooms for one in _columns(rng, (low, high), thickness, height, len(rooms))]
    if built_in:
        things += [one for room in rooms for one in _cupboards(rng, room, thickness, height)]
    movable = [one.semantic in (DOOR, FURNITURE, PILLAR) for one in [*solids, *things]]
    away = [np.linalg.norm(one.center[:2] - place[:2]) - one.size[:2].max() / 2 for one in [*solids, *things]]
    kept = [
        one for one, moves, far in zip([*solids, *things], movable, away, strict=True) if not moves or far > TO_THINGS
    ]
    return Flat(_table(kept), height, place)


def seen_by_tilting(rng: np.random.Generator, flat: Flat) -> Seen:
    """By a line laser that a servo tilts while it scans; the file keeps points at random.

    The laser stands on an arm, and the servo errs, so that rays start and end a little off.
    """
    tilts = np.radians(np.linspace(rng.uniform(-50.0, -35.0), rng.uniform(45.0, 75.0), int(rng.integers(60, 140))))
    right, left = rng.choice([90.0, 120.0, 135.0], 2)
    across = np.radians(np.linspace(-right, left, int(rng.choice([361, 541, 721]))))
    line = np.stack([np.cos(across), np.sin(across), np.zeros_like(across)], axis=-1)
    arm, turn = rng.uniform(0.0, 0.06), _turn(rng.uniform(0.0, 2.0 * np.pi))
    tilted = np.array([turn @ _tilt(one) for one in tilts])
    ways = np.einsum("tij,aj->tai", tilted, line).reshape(-1, 3)
    starts = np.repeat(tilted @ np.array([arm, 0.0, arm / 2]), len(line), axis=0)
    slipped = np.repeat(rng.normal(0.0, rng.uniform(0.0, 0.003), len(tilts)), len(line))
    points, element, distance = _met(rng, flat, ways, starts)
    points[:, 2] += slipped * distance
    return _kept(rng, points, element, turn)


def seen_by(rng: np.random.Generator, flat: Flat, sensor: Sensor) -> Seen:
    """By any other sensor, level; the file may keep points at random, too."""
    turn = _turn(rng.uniform(0.0, 2.0 * np.pi))
    ways = sensor.directions().astype(np.float64) @ turn.T
    points, element, _ = _met(rng, flat, ways, np.zeros_like(ways))
    return _kept(rng, points, element, turn)


def _parted(rng: np.random.Generator, width: float, depth: float) -> tuple[list, list]:
    """Lowest and highest corners of rooms, and the lines between them."""
    rooms, lines = [(np.zeros(2), np.array([width, depth]))], []
    for _ in range(int(rng.integers(PARTS[0], PARTS[1] + 1))):
        low, high = rooms.pop(int(np.argmax([np.prod(high - low) for low, high in rooms])))
        size = high - low
        axis = 0 if size[0] * rng.uniform(0.7, 1.4) > size[1] else 1
        if size[axis] < 2.0 * NARROWEST + 0.2:
            rooms.append((low, high))
            continue
        cut = rng.uniform(low[axis] + NARROWEST, high[axis] - NARROWEST)
        to, since = high.copy(), low.copy()
        to[axis] = since[axis] = cut
        rooms += [(low, to), (since, high)]
        lines.append((since, to))
    return rooms, lines


def _wall(rng: np.random.Generator, line: tuple, section: tuple[float, float], how: tuple[bool, bool]) -> list[_Solid]:
    """A wall along a line in plan, perhaps with a door, perhaps parted."""
    (start, end), (thickness, height), (has_door, parted) = line, section, how
    length = float(np.linalg.norm(end - start))
    along = (end - start) / length
    yaw = float(np.arctan2(along[1], along[0]))

    def part(low: float, high: float, bottom: float = 0.0, semantic: int = WALL) -> _Solid:
        center = np.array([*(start + along * (low + high) / 2), (bottom + height) / 2])
        return _Solid(center, np.array([high - low, thickness, height - bottom]), yaw, semantic)

    runs, found = [(0.0, length)], []
    wide, top = rng.uniform(*DOOR_WIDTH), rng.uniform(*DOOR_TOP)
    if has_door and length > wide + 0.2:
        first = rng.uniform(0.05, length - wide - 0.05)
        runs = [(0.0, first), (first + wide, length)]
        if rng.random() < LINTEL and height - top > 0.05:
            found.append(part(first, first + wide, top))
        if rng.random() < LEAF:
            found.append(_leaf(rng, (start + along * first, along), wide, min(top, height - 0.05)))
    for low, high in runs:
        while high - low > 0.12:
            stop = low + rng.uniform(*STRETCH) if parted else high
            stop = high if high - stop < STRETCH[0] else stop
            found.append(part(low, stop))
            low = stop
    return found


def _leaf(rng: np.random.Generator, hinge: tuple, wide: float, top: float) -> _Solid:
    """An open door: upright, flat, nearly as high as the room, and no wall."""
    place, along = hinge
    open_by = rng.uniform(0.5, 2.0) * rng.choice([-1.0, 1.0])
    yaw = float(np.arctan2(along[1], along[0]) + open_by)
    center = place + wide / 2 * np.array([np.cos(yaw), np.sin(yaw)])
    return _Solid(np.array([*center, 0.01 + top / 2]), np.array([wide, 0.04, top - 0.02]), yaw, DOOR)


def _things(rng: np.random.Generator, room: tuple, thickness: float, height: float) -> list[_Solid]:
    """Piles of boxes, most along walls: low ones, high ones, and some that hang."""
    (low, high), found = room, []
    for _ in range(rng.poisson(1.0 + np.prod(high - low) * rng.uniform(0.1, 1.2))):
        size, kind = np.array([rng.uniform(0.15, 0.8), rng.uniform(0.1, 0.5)]), rng.random()
        bottom, top = 0.0, rng.uniform(0.2, 1.0)
        if kind > 0.8:
            bottom, top = rng.uniform(0.7, 1.3), rng.uniform(1.4, height - 0.1)
        elif kind > 0.6:
            top = rng.uniform(1.0, height - 0.1)
        if rng.random() < BESIDE_WALL:
            center, yaw = _along_wall(rng, room, size, thickness / 2 + rng.choice([0.01, rng.uniform(0.0, 0.2)]))
        else:
            center, yaw = rng.uniform(low + 0.3, high - 0.3), rng.uniform(0.0, np.pi)
        for _ in range(int(rng.integers(1, 5))):
            share = rng.uniform(0.5, 1.0, 3)
            aside = (1.0 - share[:2]) * rng.uniform(-0.5, 0.5, 2) * size
            edges = np.array([*(size * share[:2]), (top - bottom) * share[2]])
            place = np.array([*(center + _turn(yaw)[:2, :2] @ aside), bottom + edges[2] / 2])
            found.append(_Solid(place, edges, yaw, FURNITURE))
    return found


def _cupboards(rng: np.random.Generator, room: tuple, thickness: float, height: float) -> list[_Solid]:
    """Cupboards along walls that reach up to the ceiling, or nearly so."""
    (low, high), found = room, []
    for _ in range(int(rng.integers(1, 4))):
        size = np.minimum([rng.uniform(0.5, 2.6), rng.uniform(0.3, 0.65)], 0.7 * (high - low).min())
        center, yaw = _along_wall(rng, room, size, thickness / 2 + rng.choice([0.005, rng.uniform(0.0, 0.05)]))
        edges = np.array([*size, height - rng.choice([0.0, rng.uniform(0.0, 0.06)])])
        found.append(_Solid(np.array([*center, edges[2] / 2]), edges, yaw, FURNITURE))
    return found


def _along_wall(rng: np.random.Generator, room: tuple, size: np.ndarray, gap: float) -> tuple[np.ndarray, float]:
    """A place (2,) [m] for a thing whose back is so far from the line of one of a room's walls, and its turn [rad]."""
    (low, high), side = room, int(rng.integers(4))
    axis, away = side % 2, gap + size[1] / 2
    center = rng.uniform(low, high)
    center[axis] = low[axis] + away if side < 2 else high[axis] - away
    return center, float((np.pi / 2 if axis == 0 else 0.0) + rng.normal(0.0, 0.03))


def _columns(rng: np.random.Generator, room: tuple, thickness: float, height: float, rooms: int) -> list[_Solid]:
    """A column in few rooms, against a wall or free."""
    if rng.random() > COLUMNS / rooms:
        return []
    width = rng.uniform(*COLUMN)
    center, yaw = _along_wall(rng, room, np.full(2, width), thickness / 2 + rng.choice([0.0, 0.35]))
    kind = CYLINDER if rng.random() < 0.5 else BOX
    return [_Solid(np.array([*center, height / 2]), np.array([width, width, height]), yaw, PILLAR, kind)]


def _table(solids: list[_Solid]) -> Primitives:
    count = len(solids)
    return Primitives(
        np.array([[one.kind for one in solids]], np.uint8),
        np.array([[one.center for one in solids]], np.float32),
        np.array([[one.size / 2 for one in solids]], np.float32),
        np.array([[one.yaw for one in solids]], np.float32),
        np.arange(count, dtype=np.int32)[None],
        np.array([[one.semantic for one in solids]], np.uint8),
    )


def _met(rng: np.random.Generator, flat: Flat, ways: np.ndarray, starts: np.ndarray) -> tuple:
    """Points (N, 3) [m], elements (N,) and ranges (N,) [m]; ranges are 0 where nothing comes back."""
    origin = (flat.place + starts).astype(np.float32)
    met = cast_rays(flat.primitives, None, Rays(origin[None], ways[None].astype(np.float32)))
    distance = met.distance[0].astype(np.float64)
    back = (distance > NEAREST) & (distance < FARTHEST) & (rng.random(len(distance)) > 0.01)
    distance = np.where(back, distance, 0.0)
    noisy = distance + rng.uniform(0.005, 0.025) * rng.standard_normal(len(distance)) * back
    return origin + ways * noisy[:, None], np.where(back, met.element[0], -1), distance


def _kept(rng: np.random.Generator, points: np.ndarray, element: np.ndarray, turn: np.ndarray) -> Seen:
    back = np.flatnonzero(element >= 0)
    count = min(int(rng.uniform(LEAST_KEPT, 1.0) * len(back)), MOST_KEPT)
    chosen = np.sort(rng.choice(back, count, replace=False))
    return Seen(points[chosen], element[chosen], turn)


def _turn(yaw: float) -> np.ndarray:
    cosine, sine = np.cos(yaw), np.sin(yaw)
    return np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])


def _tilt(angle: float) -> np.ndarray:
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.array([[cosine, 0.0, -sine], [0.0, 1.0, 0.0], [sine, 0.0, cosine]])
