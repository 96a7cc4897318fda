"""Generated buildings of several rooms on several storeys: boxes for walls with doors and windows, slabs and columns.

Plan coordinates are in metres, the lowest floor at z = 0. A rectangle is x and y of its low corner,
then of its high one.
"""

import numpy as np

from warp_scanner.buildings.room_buildings import building_of_room
from warp_scanner.scenes.building import Building, Storeys
from warp_scanner.scenes.scenes import BOX, CEILING, FLOOR, PILLAR, WALL, Primitives

LENGTH, DEPTH = (11.0, 26.0), (8.0, 15.0)  # [m] of a building
LEAST_ROOM, MOST_ROOM = 2.4, 6.5  # [m]
DOOR, WINDOW, SILL = (0.9, 2.1), (0.8, 2.2), (0.6, 1.0)  # [m] width and height; widths; heights of the lower edge
INNER, OUTER, SLAB = 0.12, 0.3, 0.25  # [m] thick
STOREY = (2.5, 3.1)  # [m] from floor to ceiling

# One box: low corner, high corner.
Solid = tuple[np.ndarray, np.ndarray]


def building_of_plans(seed: int, storeys: int = 2, repeated: bool = False) -> Building:
    """A building; with `repeated` all storeys have the plan of the lowest one."""
    rng = np.random.default_rng([seed, 0])
    size = np.array([rng.uniform(*LENGTH), rng.uniform(*DEPTH)])
    clear = rng.uniform(*STOREY)
    elements: list[tuple[int, list[Solid]]] = []
    for storey in range(storeys):
        drawn = np.random.default_rng([seed, 1 + (0 if repeated else storey)])
        elements += _storey(drawn, size, storey * (clear + SLAB), clear)
    roof = storeys * (clear + SLAB)
    elements.append((CEILING, [_box((0, 0, roof - SLAB), (*size, roof))]))
    building = building_of_room(_table(elements), 0)[0]
    levels = np.arange(storeys) * (clear + SLAB)
    return building._replace(storeys=Storeys(("",) * storeys, tuple(f"storey {n}" for n in range(storeys)), levels))


def _table(elements: list[tuple[int, list[Solid]]]) -> Primitives:
    """Boxes as the primitives of one room; those of one element share its number."""
    solids = [(number, kind, *box) for number, (kind, boxes) in enumerate(elements) for box in boxes]
    number, kind, low, high = (np.array(column) for column in zip(*solids, strict=True))
    return Primitives(
        np.full((1, len(solids)), BOX, np.uint8), ((low + high) / 2)[None].astype(np.float32),
        ((high - low) / 2)[None].astype(np.float32), np.zeros((1, len(solids)), np.float32),
        number[None].astype(np.int32), kind[None].astype(np.uint8),
    )  # fmt: skip


def _box(low: tuple[float, ...], high: tuple[float, ...]) -> Solid:
    return np.array(low, float), np.array(high, float)


def _storey(rng: np.random.Generator, size: np.ndarray, floor: float, clear: float) -> list[tuple[int, list[Solid]]]:
    top = floor + clear
    elements = [(FLOOR, [_box((0, 0, floor - SLAB), (*size, floor))])]
    for axis in (0, 1):
        for start in (0.0, size[1 - axis] - OUTER):
            elements.append(
                (WALL, _wall((axis, start, OUTER), (0.0, size[axis]), (floor, top), _windows(rng, size[axis])))
            )
    inside = np.array([OUTER, OUTER, size[0] - OUTER, size[1] - OUTER])
    rooms: list[np.ndarray] = []
    for wall in _divided(rng, inside, rooms, (floor, top)):
        elements.append((WALL, wall))
    for room in rooms:
        if min(room[2:] - room[:2]) > 4.0 and rng.random() < 0.6:
            half, middle = rng.uniform(0.12, 0.25), rng.uniform(room[:2] + 0.9, room[2:] - 0.9)
            elements.append((PILLAR, [_box((*(middle - half), floor), (*(middle + half), top))]))
    return elements


def _windows(rng: np.random.Generator, length: float) -> list[tuple[float, float, float, float]]:
    """From, to, lower and upper edge [m] of the openings along an outer wall."""
    found, at = [], rng.uniform(0.6, 2.0)
    while at + WINDOW[1] < length - 0.6:
        wide = rng.uniform(*WINDOW)
        found.append((at, at + wide, rng.uniform(*SILL), rng.uniform(2.0, 2.3)))
        at += wide + rng.uniform(0.8, 4.0)
    return found


def _wall(
    line: tuple[int, float, float],
    span: tuple[float, float],
    heights: tuple[float, float],
    openings: list[tuple[float, float, float, float]],
) -> list[Solid]:
    """A wall along an axis, from its low side and as thick as told, around its openings."""
    (axis, side, thick), (floor, top) = line, heights

    def piece(start: float, end: float, low: float, high: float) -> Solid:
        ends = [(start, side, low), (end, side + thick, high)]
        return _box(*((a, b, z) if axis == 0 else (b, a, z) for a, b, z in ends))

    found, at = [], span[0]
    for start, end, low, high in openings:
        found.append(piece(at, start, floor, top))
        found += [piece(start, end, floor, floor + low)] if low > 0.0 else []
        found.append(piece(start, end, floor + high, top))
        at = end
    return [*found, piece(at, span[1], floor, top)]


def _divided(
    rng: np.random.Generator, room: np.ndarray, rooms: list[np.ndarray], heights: tuple[float, float]
) -> list[list[Solid]]:
    """The walls, each with a door, that divide a rectangle into rooms, which are added to `rooms`."""
    size = room[2:] - room[:2]
    axis = int(np.argmax(size))  # the wall crosses it
    if size[axis] < 2 * LEAST_ROOM + INNER or (size[axis] < MOST_ROOM and rng.random() < 0.7):
        rooms.append(room)
        return []
    at = rng.uniform(room[axis] + LEAST_ROOM, room[2 + axis] - LEAST_ROOM - INNER)
    span = room[1 - axis], room[3 - axis]
    door = rng.uniform(span[0] + 0.2, span[1] - DOOR[0] - 0.2)
    walls = [_wall((1 - axis, at, INNER), span, heights, [(door, door + DOOR[0], 0.0, DOOR[1])])]
    low, high = room.copy(), room.copy()
    low[2 + axis], high[axis] = at, at + INNER
    return walls + _divided(rng, low, rooms, heights) + _divided(rng, high, rooms, heights)
