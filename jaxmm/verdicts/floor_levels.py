"""Which floor and which ceiling the parts of a scan have in a building: rooms differ, a hall has steps and galleries.

N points, P rays, S storeys. Positions are offsets from the building's origin, world axes: metres, z up.
"""

import numpy as np

from jaxmm.rays.cloud_evidence import LEVELS
from jaxmm.rays.evidence import Frame
from jaxmm.rays.scan_rays import ScanRays
from warp_scanner.scenes.building import element_bounds
from warp_scanner.scenes.scenes import CEILING, FLOOR, PILLAR, WALL
from warp_scanner.sensors.scan import Rays
from warp_scanner.sensors.triangles import TriangleScene, cast_triangles

AROUND = np.linspace(-1.0, 1.0, 5)  # [m] about the sensor, where floor and ceiling are looked for
STANDING = (0.3, 2.5)  # [m] least and most height of a sensor above its floor
LEAST_ROOM = 0.5  # [m] from floor to ceiling
SAME_LEVEL = 0.05  # [m] by which heights of one ceiling, or of one floor, may differ
EDGE = 0.3  # [m] from a point under the edge of a ceiling to that ceiling: a column carries it
LEVEL = (FLOOR, CEILING)
OFF = 0.1  # [m] from a point on a ceiling or floor, from where one sees it
UP, ASIDE = np.array([0.0, 0.0, 1.0]), np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]], np.float64)


def levels_of(scene: TriangleScene, rays: ScanRays, points: np.ndarray, storeys: np.ndarray) -> tuple[float, float]:
    """Heights of the floor under the sensor and of the ceiling above it.

    They are the middle ones of some around it: it may stand in a doorway, by a stair, or at a table. Where the building
    has none, whatever is under and above it tells; else walls and columns around its height; else what was measured.
    Where the floor lies farther below than a sensor stands, a storey tells that begins where it may stand: it has no
    slab. `storeys` (S,) [m] are the heights that they begin at; of ceilings they tell nothing.
    """
    floor, ceiling = (rays.position[2] + way * _clearance(scene, rays.position, way) for way in (-1.0, 1.0))
    if not (np.isfinite(floor) and np.isfinite(ceiling)):
        low, high = (corner[:, 2] for corner in element_bounds(scene.triangles))
        around = (
            np.isin(scene.triangles.semantic, (WALL, PILLAR)) & (low < rays.position[2]) & (high > rays.position[2])
        )
        ends = (
            (np.median(low[around]), np.median(high[around])) if around.any() else np.percentile(points[:, 2], LEVELS)
        )
        floor = floor if np.isfinite(floor) else min(ends[0], rays.position[2])
        ceiling = ceiling if np.isfinite(ceiling) else max(ends[1], rays.position[2])
    height = rays.position[2] - storeys
    without_slab = storeys[(height >= STANDING[0]) & (height <= STANDING[1])]
    if rays.position[2] - floor > STANDING[1] and len(without_slab):
        floor = without_slab.max()
    return float(floor), float(max(ceiling, floor + LEAST_ROOM))


def levels_at(scene: TriangleScene, points: np.ndarray, frame: Frame) -> np.ndarray:
    """Heights (N, 2) [m] of the floor under each point (N, 3) and of the ceiling above it."""
    ceiling = ceilings_over(scene, points, frame)
    floor = floors_under(scene, points, ceiling, frame)
    return np.column_stack([np.where(ceiling - floor > LEAST_ROOM, floor, frame.floor), ceiling])


def ceilings_over(scene: TriangleScene, points: np.ndarray, frame: Frame) -> np.ndarray:
    """Heights (N,) [m] of the ceiling above each point (N, 3): the next room may be lower, a roof slopes.

    That of the frame where the building has none there. What is above the sensor's height is what a room ends at; a
    point that is higher lies, at most, on the lower side of it.
    """
    start = np.array(points, np.float64)
    start[:, 2] = np.maximum(frame.sensor[2], start[:, 2] - OFF)
    found = start[:, 2] + _free(scene, start, UP, LEVEL)
    for way in ASIDE:
        beside = start[:, 2] + _free(scene, start + EDGE * way, UP, LEVEL)
        lower = np.flatnonzero(beside < found - SAME_LEVEL)
        lower = lower[_free(scene, start[lower], way, (WALL,)) > EDGE]  # else it is in the next room
        found[lower] = beside[lower]
    other = np.isfinite(found) & (np.abs(found - frame.ceiling) > SAME_LEVEL) & (found - frame.floor > LEAST_ROOM)
    return np.where(other, found, frame.ceiling)


def floors_under(scene: TriangleScene, points: np.ndarray, ceiling: np.ndarray, frame: Frame) -> np.ndarray:
    """Heights (N,) [m] of the floor under each point (N, 3): on a landing, a gallery, or down some steps.

    That of the frame where the building has none there, or where it is right beside: slabs end at the faces of walls.
    A point that is lower than that one has it, too, where it is above the point. `ceiling` (N,) is above the points.
    """
    start = np.array(points, np.float64)
    start[:, 2] = np.minimum(np.maximum(start[:, 2], frame.floor) + OFF, ceiling - OFF)
    found = start[:, 2] - _free(scene, start, -UP, LEVEL)
    height = np.asarray(points, np.float64)[:, 2]
    beneath = np.flatnonzero((found > height + SAME_LEVEL) & (height > frame.floor))  # that slab is above the point
    start[beneath, 2] = height[beneath]
    found[beneath] = height[beneath] - _free(scene, start[beneath], -UP, LEVEL)
    lower = np.flatnonzero((found < frame.floor - SAME_LEVEL) & (height > frame.floor - SAME_LEVEL))
    for way in ASIDE:
        beside = start[lower, 2] - _free(scene, start[lower] + EDGE * way, -UP, LEVEL)
        found[lower[np.abs(beside - frame.floor) <= SAME_LEVEL]] = frame.floor
    other = np.isfinite(found) & (np.abs(found - frame.floor) > SAME_LEVEL)
    return np.where(other, found, frame.floor)


def _free(scene: TriangleScene, origin: np.ndarray, way: np.ndarray, semantics: tuple[int, ...]) -> np.ndarray:
    """(N,) [m] from places (N, 3) one way (3,) to what is of some classes; inf: to nothing."""
    along = np.tile(way.astype(np.float32), (len(origin), 1))
    return cast_triangles(scene, Rays(origin[None], along), np.isin(scene.triangles.semantic, semantics)).distance[0]


def _clearance(scene: TriangleScene, position: np.ndarray, way: float) -> float:
    """Height [m] that is free under (`way` -1) or above (1) a place, inf where all is."""
    level = np.isin(scene.triangles.semantic, LEVEL)
    x, y = np.meshgrid(AROUND, AROUND)
    places = position + np.stack([x, y, np.zeros_like(x)], -1).reshape(-1, 1, 3)
    beside = Rays(places.reshape(-1, 3), np.array([[0.0, 0.0, way]], np.float32))
    right_there = Rays(position[None], beside.direction)
    for rays, present in ((beside, level), (right_there, None)):
        free = cast_triangles(scene, rays, present).distance
        if np.isfinite(free).any():
            return float(np.median(free[np.isfinite(free)]))
    return np.inf
