"""A building model drawn from a scan: its walls, floor and ceiling as elements of an IFC file.

For real scans of which nobody has a model. What is drawn stands where the scan's points are, so that what is put in
besides stands in nothing (a *phantom*), and what is left out is new. N points. The scan's frame; metres, z up.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from warp_scanner.buildings.room_ifc import write_room
from warp_scanner.scenes.scenes import BOX, CEILING, FLOOR, FURNITURE, PILLAR, WALL, Primitives

CELL, LEVEL = 0.05, 0.15  # [m] of the plan in which upright faces are looked for, and of its levels
THIN, SPREAD = 0.02, 0.1  # [m] of the levels among which floor and ceiling are looked for, and of places on them
LEAST_FULL, WITHIN = 0.2, 0.1  # share of the places of the fullest level, and [m] in which one that errs is spread
LEAST_LEVELS = 0.3  # share of the levels that a cell of a wall fills
FLAT = 0.03  # [m] from a wall's face up to which points are its own
GAP, SHORTEST = 0.4, 0.6  # [m] without points, at which a wall ends; and of a wall
THICKNESS, MARGIN = 0.1, 0.3  # [m] of walls and slabs; around the points
TRIES, LEAST_CELLS = 2000, 12  # lines that are tried for each wall; cells that make one
HOLE, BEYOND, LEAST_THROUGH = 0.2, 0.15, 3  # [m] cells of a wall's face that rays pass, so far beyond, and so many
PHANTOMS = (((0.3, 0.3), PILLAR), ((0.8, 0.1), WALL))  # [m]
LEAST_PASSING = 300  # rays through a phantom, and on a wall that is left out
THING, LEAST_POINTS = 0.2, 10  # [m] grid of what is no wall, and points that make a thing of it
BLUR = 0.1  # [m] around a wall, within which points may still be its own
LEAST_FILLED = 0.8  # share of the levels that a wall fills, if it is left out
MOST_HELD = 0.5  # share of a wall's points that something else stands as near to, if it is left out
FREE = 0.15  # [m] around a phantom, without a point


class Block(NamedTuple):
    """An upright box that is an element."""

    center: np.ndarray  # (3,) [m]
    size: np.ndarray  # (3,) [m] along its own axes
    yaw: float  # [rad]
    semantic: int  # of warp_scanner.scenes.scenes
    points: int = 0  # of the scan, on its face


def drawn(points: np.ndarray, position: np.ndarray, levels: tuple[float, float] | None = None) -> list[Block]:
    """Floor, ceiling, walls and all else that one scan shows, the last as furniture.

    Args:
        points: (N, 3) [m].
        position: (3,) [m] of the sensor; walls are thick away from it.
        levels: [m] of floor and ceiling, where they are known: not every scan shows both.
    """
    position = np.asarray(position, float)
    floor, ceiling = levels or levels_of(points)
    low, high = (np.percentile(points[:, :2], which, axis=0) + way * MARGIN for which, way in ((1, -1), (99, 1)))
    slabs = [
        Block(np.array([*(low + high) / 2, z]), np.array([*(high - low), THICKNESS]), 0.0, kind)
        for z, kind in ((floor - THICKNESS / 2, FLOOR), (ceiling + THICKNESS / 2, CEILING))
    ]
    walls = _walls(points, position, floor, ceiling)
    return [*slabs, *walls, *_things(points, position, walls, floor, ceiling)]


def levels_of(points: np.ndarray) -> tuple[float, float]:
    """Heights [m] of floor and ceiling: the outermost levels that spread over as much as the fullest do, or a part.

    Levels count by the places in plan that they fill, not by points, most of which are on what is near the sensor.
    """
    level = np.floor((points[:, 2] - points[:, 2].min()) / THIN).astype(int)
    places = np.unique(np.column_stack([np.floor(points[:, :2] / SPREAD).astype(int), level]), axis=0)
    count = np.bincount(places[:, 2])
    middle, half = points[:, 2].min() + (np.arange(len(count)) + 0.5) * THIN, len(count) // 2
    return float(middle[_outermost(count[:half])]), float(middle[len(count) - 1 - _outermost(count[half:][::-1])])


def _outermost(count: np.ndarray) -> int:
    """The fullest of the first levels that are full, of levels (n,) from the outside in."""
    first = int(np.argmax(count >= LEAST_FULL * count.max()))
    return first + int(np.argmax(count[first : first + round(WITHIN / THIN) + 1]))


def phantoms(points: np.ndarray, position: np.ndarray) -> list[Block]:
    """A column and a wall where there is nothing: each where most rays pass a free place, and not the same one."""
    floor, ceiling = levels_of(points)
    found: list[Block] = []
    for footprint, semantic in PHANTOMS:
        best, most = None, LEAST_PASSING
        for block in _places(position, footprint, semantic, (floor, ceiling)):
            passing = int(_passes(block, points, position).sum())
            apart = [np.linalg.norm(block.center[:2] - one.center[:2]) for one in found]
            # One in front of the other would hide it.
            beside = all(_azimuth_apart(block, one, position) > np.radians(40.0) for one in found)
            if passing > most and beside and min(apart, default=9.0) > 1.0 and not _inside(block, points, FREE).any():
                best, most = block, passing
        if best is not None:
            found.append(best)
    return found


def left_out(blocks: list[Block], points: np.ndarray, count: int = 2) -> list[Block]:
    """The shortest walls that a scan (N, 3) [m] saw well, from floor to ceiling, and in whose place nothing else is."""
    seen = [one for one in blocks if one.semantic == WALL and one.points >= LEAST_PASSING]
    upright = [one for one in blocks if one.semantic not in (FLOOR, CEILING)]
    found: list[Block] = []
    for wall in sorted(seen, key=lambda one: one.size[0]):
        own = points[_inside(wall, points, FLAT)]
        others = [one for one in upright if not any(one is each for each in (wall, *found))]
        held = np.any([_inside(one, own, BLUR) for one in others], axis=0) if others else np.zeros(len(own), bool)
        is_held = held.sum() >= MOST_HELD * max(len(own), 1)
        if len(found) < count and not is_held and _filled(wall, own) >= LEAST_FILLED:
            found.append(wall)
    return found


def _filled(wall: Block, own: np.ndarray) -> float:
    """Share of a wall's levels that some of its points (n, 3) are on: the front of a cupboard lacks the highest."""
    return len(np.unique(np.floor(own[:, 2] / LEVEL))) * LEVEL / wall.size[2]


def write_blocks(path: Path, elements: list[list[Block]]) -> dict[int, str]:
    """Elements of one or more blocks as an IFC file; returns the GlobalId of each by its number."""
    blocks = [block for parts in elements for block in parts]
    number = np.repeat(np.arange(len(elements), dtype=np.int32), [len(parts) for parts in elements])
    return write_room(path, table_of(blocks, number), 0)


def table_of(blocks: list[Block], number: np.ndarray) -> Primitives:
    """Blocks as the primitives of one room, each of the element (n,) int32 that it is of."""
    count = len(blocks)
    return Primitives(
        np.full((1, count), BOX, np.uint8),
        np.array([[one.center for one in blocks]], np.float32),
        np.array([[one.size / 2 for one in blocks]], np.float32),
        np.array([[one.yaw for one in blocks]], np.float32),
        number[None],
        np.array([[one.semantic for one in blocks]], np.uint8),
    )  # fmt: skip


def with_openings(wall: Block, points: np.ndarray, position: np.ndarray) -> list[Block]:
    """A wall as the blocks that remain of it where no rays pass: its doors, and what ends below the ceiling."""
    start, end = _local(wall, position[None])[0], _local(wall, points)
    ray = end - start
    with np.errstate(divide="ignore", invalid="ignore"):
        part = -start[1] / ray[:, 1]  # of the ray, at the wall's middle
        at = start + part[:, None] * ray
    past = (part > 0.0) & ((1.0 - part) * np.linalg.norm(ray, axis=1) > BEYOND)
    past &= np.all(np.abs(at[:, [0, 2]]) < wall.size[[0, 2]] / 2, axis=1)
    shape = np.maximum(np.ceil(wall.size[[0, 2]] / HOLE).astype(int), 1)
    bounds = [(-x / 2, x / 2) for x in wall.size[[0, 2]]]
    through, _, _ = np.histogram2d(*at[past][:, [0, 2]].T, bins=shape, range=bounds)
    on = np.abs(end[:, 1]) < wall.size[1] / 2 + FLAT
    ends, _, _ = np.histogram2d(*end[on][:, [0, 2]].T, bins=shape, range=bounds)
    is_open = (through >= LEAST_THROUGH) & (through > ends)
    step, blocks = wall.size[[0, 2]] / shape, []
    for column in range(shape[0]):
        edges = np.flatnonzero(np.diff(np.concatenate([[True], is_open[column], [True]]).astype(int)))
        for low, high in edges.reshape(-1, 2):
            local = np.array([(column + 0.5) * step[0], 0.0, (low + high) / 2 * step[1]])
            local -= [wall.size[0] / 2, 0.0, wall.size[2] / 2]
            size = np.array([step[0], wall.size[1], (high - low) * step[1]])
            blocks.append(Block(wall.center + _turned(wall.yaw, local), size, wall.yaw, wall.semantic))
    return blocks


def _walls(points: np.ndarray, position: np.ndarray, floor: float, ceiling: float) -> list[Block]:
    """Upright faces, the longest first: lines through the cells that are filled over most of the height."""
    inner = points[(points[:, 2] > floor + 0.2) & (points[:, 2] < ceiling - 0.2)]
    cells = np.floor(inner[:, :2] / CELL).astype(int)
    levels = np.floor((inner[:, 2] - floor) / LEVEL).astype(int)
    places, which = np.unique(cells, axis=0, return_inverse=True)
    filled = np.zeros((len(places), levels.max() + 1), bool)
    filled[which.ravel(), levels] = True
    upright = filled.sum(1) >= LEAST_LEVELS * (ceiling - floor - 0.4) / LEVEL
    own = inner[upright[which.ravel()], :2]
    rng, found = np.random.default_rng(0), []
    while len(own) > LEAST_CELLS:
        picked = own[rng.integers(len(own), size=(TRIES, 2))]
        along = picked[:, 1] - picked[:, 0]
        length = np.linalg.norm(along, axis=1)
        good = length > SHORTEST / 2
        along = along[good] / length[good, None]
        normal = np.column_stack([-along[:, 1], along[:, 0]])
        offset = np.sum(picked[good, 0] * normal, axis=1)
        near = np.abs(own @ normal.T - offset) < FLAT
        cells_of = np.floor(own / CELL).astype(int)
        best = int(np.argmax(near.sum(0)))
        on = own[near[:, best]]
        if len(np.unique(cells_of[near[:, best]], axis=0)) < LEAST_CELLS:
            break
        centre = on.mean(0)
        way = np.linalg.svd(on - centre, full_matrices=False)[2][0]
        found += _segments(own, (centre, way), position[:2], (floor, ceiling))
        own = own[np.abs((own - centre) @ np.array([-way[1], way[0]])) >= 2 * FLAT]
    return found


def _things(points: np.ndarray, position: np.ndarray, walls: list[Block], floor: float, ceiling: float) -> list[Block]:
    """What is neither wall nor slab, as upright boxes on a grid, without what more rays pass than end in."""
    rest = points[(points[:, 2] > floor + THING) & (points[:, 2] < ceiling - THING)]
    for wall in walls:
        rest = rest[~_inside(wall, rest, BLUR)]
    cells = np.floor(rest[:, :2] / THING).astype(int)
    _, which, count = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
    blocks = []
    for cell in np.flatnonzero(count >= LEAST_POINTS):
        own = rest[which.ravel() == cell]
        own = own[np.argsort(own[:, 2])]
        for part in np.split(own, np.flatnonzero(np.diff(own[:, 2]) > THING) + 1):
            low, high = part.min(0), part.max(0)
            block = Block((low + high) / 2, np.maximum(high - low, 0.02), 0.0, FURNITURE, len(part))
            if _passes(block, points, position).sum() <= len(part):
                blocks.append(block)
    return blocks


def _segments(own: np.ndarray, line: tuple, position: np.ndarray, levels: tuple[float, float]) -> list[Block]:
    """The walls along one line: where its points leave no gap."""
    (centre, way), (floor, ceiling) = line, levels
    on = own[np.abs((own - centre) @ np.array([-way[1], way[0]])) < FLAT]
    on = on[np.argsort((on - centre) @ way)]
    found = []
    for part in np.split(on, np.flatnonzero(np.diff((on - centre) @ way) > GAP) + 1):
        if len(part) < 2 or (part[-1] - part[0]) @ way < SHORTEST:
            continue
        middle = part.mean(0)  # each part of a line lies as its own points do
        along = np.linalg.svd(part - middle, full_matrices=False)[2][0]
        normal = np.array([-along[1], along[0]])
        middle = middle + normal * np.median((part - middle) @ normal)
        if (position - middle) @ normal > 0.0:
            normal = -normal  # away from the sensor
        reach = (part - middle) @ along
        middle = middle + along * (reach.min() + reach.max()) / 2 + normal * THICKNESS / 2
        size = np.array([np.ptp(reach), THICKNESS, ceiling - floor])
        center = np.array([*middle, (floor + ceiling) / 2])
        found.append(Block(center, size, float(np.arctan2(along[1], along[0])), WALL, len(part)))
    return found


def _places(position: np.ndarray, footprint: tuple[float, float], semantic: int, levels: tuple[float, float]):
    """Blocks of a footprint, from floor to ceiling, around a sensor; broadside to it."""
    floor, ceiling = levels
    for distance in np.arange(0.8, 4.1, 0.2):
        for azimuth in np.radians(np.arange(0.0, 360.0, 10.0)):
            spot = position[:2] + distance * np.array([np.cos(azimuth), np.sin(azimuth)])
            center = np.array([*spot, (floor + ceiling) / 2])
            size = np.array([*footprint, ceiling - floor])
            yield Block(center, size, float(azimuth + np.pi / 2), semantic)


def _turned(yaw: float, vectors: np.ndarray) -> np.ndarray:
    """Vectors (..., 3) turned about z."""
    cosine, sine = np.cos(yaw), np.sin(yaw)
    return vectors @ np.array([[cosine, sine, 0.0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]])


def _local(block: Block, points: np.ndarray) -> np.ndarray:
    """Points (N, 3) in a block's own frame."""
    return _turned(-block.yaw, points - block.center)


def _inside(block: Block, points: np.ndarray, margin: float) -> np.ndarray:
    """(N,) bool: points within a block and so much around its sides, but for its floor and ceiling."""
    return np.all(np.abs(_local(block, points)) <= block.size / 2 + [margin, margin, -0.1], axis=1)


def _passes(block: Block, points: np.ndarray, position: np.ndarray) -> np.ndarray:
    """(N,) bool: rays that pass all through a block, by the slabs of its faces."""
    start = _local(block, position[None])[0]
    ray = _local(block, points) - start
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = np.stack([(side * block.size / 2 - start) / ray for side in (-1.0, 1.0)])
    enter, leave = ends.min(0).max(1), ends.max(0).min(1)
    return (enter > 0.0) & (enter < leave) & (leave < 1.0)


def _azimuth_apart(a: Block, b: Block, position: np.ndarray) -> float:
    """Angle [rad] between two blocks, as the sensor sees them."""
    angles = [np.arctan2(*(one.center[:2] - position[:2])[::-1]) for one in (a, b)]
    return float(abs((angles[0] - angles[1] + np.pi) % (2 * np.pi) - np.pi))
