"""Where a sensor can stand in a building: inside it, above a floor, away from every surface.

E elements, N points. Positions are offsets from the building's origin, metres, z up.
"""

import numpy as np

from warp_scanner import draws
from warp_scanner.rooms.standing import Standing
from warp_scanner.scenes.building import Building, bounds, fixed
from warp_scanner.scenes.scenes import (
    CABINET,
    CARTON,
    CEILING,
    CHAIR,
    DOOR,
    FLOOR,
    FURNITURE,
    OTHER,
    PERSON,
    PILLAR,
    TABLE,
    WALL,
    WINDOW,
)
from warp_scanner.sensors.poses import Pose
from warp_scanner.sensors.scan import Rays
from warp_scanner.sensors.triangles import TriangleScene, cast_triangles, clearance

# What nobody can stand inside; other elements likewise, but for those that may be the shell of something hollow.
_SOLID = (WALL, PILLAR, FLOOR, CEILING, DOOR, TABLE, CHAIR, WINDOW, FURNITURE, CABINET, CARTON, PERSON)
_SHELLS = ("", "IfcRoof", "IfcCurtainWall", "IfcBuildingElementProxy")
_BESIDE = 2.0  # [m] around a file that holds neither floors nor ceilings, and so has no inside
_STOREY_HEIGHT = 2.5  # [m] of the highest storey, if nothing above tells
_STEP = 0.6  # [m] a floor may lie above or below its storey's elevation
_AROUND = 8.0  # [m] at most beside what a sensor is to stand near


def check_position(building: Building, scene: TriangleScene, position: np.ndarray, reach: float | None = None) -> None:
    """Refuse a place where no sensor can be.

    Args:
        building: the building.
        scene: its triangles, prepared.
        position: (3,) float64 [m] world.
        reach: [m] that it may be away from what the building spans; None: it has to be inside.

    Raises:
        ValueError: farther away, or not inside, or inside one of its elements.
    """
    point = np.asarray(position, np.float64) - building.origin
    is_near = inside(building, scene, point[None])[0] if reach is None else away_from(building, point) <= reach
    if not is_near:
        beyond = "" if reach is None else f", farther than the sensor's reach of {reach:.4g} m"
        raise ValueError(f"pose {_named(position)} is outside the building, which spans {span_of(building)} m{beyond}")
    around = element_around(building, point)
    if around >= 0:
        elements = building.elements
        kind, name = elements.ifc_class[around] or "element", elements.name[around]
        raise ValueError(f"pose {_named(position)} is inside {kind} {name!r} ({elements.guid[around]})")


def span_of(building: Building) -> str:
    """From where to where a building reaches in the world, along x, y and z [m], as errors say it."""
    low, high = (corner + building.origin for corner in bounds(building.triangles))
    return ", ".join(f"{a:.2f} to {b:.2f}" for a, b in zip(low, high, strict=True))


def _named(position: np.ndarray) -> str:
    return ", ".join(f"{value:.10g}" for value in position)


def away_from(building: Building, point: np.ndarray) -> float:
    """How far [m] a point (3,) is outside of what a building spans; 0 within."""
    low, high = bounds(building.triangles)
    return float(np.linalg.norm(np.maximum(np.maximum(low - point, point - high), 0.0)))


def inside(building: Building, scene: TriangleScene, points: np.ndarray) -> np.ndarray:
    """(N,) bool: within the bounding box and above or below something.

    A file with neither floors nor ceilings has no inside; there the bounding box and 2 m around it count.
    """
    points = np.asarray(points, np.float64)
    low, high = bounds(building.triangles)
    if not np.isin(building.elements.semantic, (FLOOR, CEILING)).any():
        margin = np.array([_BESIDE, _BESIDE, 0.0])
        return np.all((points >= low - margin) & (points <= high + margin), axis=1)
    vertical = np.array([[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]], np.float32)
    hit = np.isfinite(cast_triangles(scene, Rays(points, vertical)).distance)
    return np.all((points >= low) & (points <= high), axis=1) & hit.any(axis=1)


def element_around(building: Building, point: np.ndarray) -> int:
    """The solid element that the point (3,) is inside of; -1 if there is none.

    By the winding number (van Oosterom and Strackee 1983 give the solid angle of a triangle), which also holds for
    surfaces with small holes and does not care which side of a face is its front.
    """
    triangles, elements = building.triangles, building.elements
    corners = triangles.vertices[triangles.faces].astype(np.float64) - point
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    la, lb, lc = (np.linalg.norm(corner, axis=1) for corner in (a, b, c))
    volume = np.einsum("ti,ti->t", a, np.cross(b, c))
    rest = la * lb * lc + np.einsum("ti,ti->t", a, b) * lc + np.einsum("ti,ti->t", b, c) * la
    rest += np.einsum("ti,ti->t", c, a) * lb
    turns = np.bincount(triangles.element, np.arctan2(volume, rest), len(triangles.semantic)) / (2.0 * np.pi)
    solid = np.isin(triangles.semantic, _SOLID)
    solid |= (triangles.semantic == OTHER) & ~np.isin(np.asarray(elements.ifc_class, str), _SHELLS)
    within = (np.abs(turns) > 0.5) & solid
    return int(np.argmax(within)) if within.any() else -1


def draw_positions(
    building: Building,
    scene: TriangleScene,
    standing: Standing,
    key: np.ndarray,
    storey: int | None = None,
    near: tuple[np.ndarray, np.ndarray] | None = None,
) -> tuple[Pose, np.ndarray]:
    """Level poses at random free places of the building, looking anywhere.

    A place is free when it lies inside, `standing.height` above the surface below it (furniture apart; of a file
    without floors: above the storey's elevation), and no triangle is within `standing.gap`.

    Args:
        building: the building.
        scene: its triangles, prepared; all of them count.
        standing: heights, pitches, gap and number of tries.
        key: (R,) uint64 from draws.keys.
        storey: row of the storey table; None draws from all.
        near: least and greatest coordinates (3,) of a box that all places are near: at most 8 m beside it, and on a
            storey that it reaches into if there is one; None draws from the whole building.

    Returns:
        The poses of R views, and (R,) bool: False where no free place was found and the pose means nothing.
    """
    count, tries = len(key), standing.tries
    low, high = (corner.astype(np.float64) for corner in bounds(building.triangles))
    floored = bool(np.isin(building.elements.semantic, (FLOOR, CEILING)).any())
    margin = 0.0 if floored else _BESIDE
    low, high = low - margin, high + margin
    rows = np.arange(len(building.storeys.name))
    if near is not None:
        low, high = np.maximum(low, near[0] - _AROUND), np.minimum(high, near[1] + _AROUND)
        reached = storeys_between(building, float(near[0][2]), float(near[1][2]))
        rows = reached if len(reached) else rows
    rows = rows if storey is None else np.array([storey])
    x, y = (draws.between(key, f"sensor {axis}", (low[axis], high[axis]), tries) for axis in (0, 1))
    chosen = rows[np.floor(draws.uniform(key, "sensor storey", tries) * len(rows)).astype(int)]
    elevation = building.storeys.elevation[chosen]
    top = _tops(building)[chosen]
    height = draws.between(key, "sensor height", standing.height_range, tries).ravel()
    points = np.stack([x, y, np.minimum(elevation + 1.0, (elevation + top) / 2)], axis=-1).reshape(-1, 3)
    good = np.ones(len(points), bool)
    if floored:
        down = np.array([[0.0, 0.0, -1.0]], np.float32)
        drop = cast_triangles(scene, Rays(points, down), fixed(scene.triangles)).distance[:, 0].astype(np.float64)
        floor = points[:, 2] - drop
        good = np.abs(floor - elevation.ravel()) <= _STEP
        points[:, 2] = np.where(good, floor + height, points[:, 2])
    else:
        points[:, 2] = elevation.ravel() + height
    points = points.astype(np.float32)
    # A hair more than the gap, so that it still holds whoever measures.
    good &= (clearance(scene, points, standing.gap + 1.0) > standing.gap + 1e-4) & inside(building, scene, points)
    up = np.array([[0.0, 0.0, 1.0]], np.float32)
    covered = np.isfinite(cast_triangles(scene, Rays(points, up)).distance[:, 0])
    points, good, covered = points.reshape(count, tries, 3), good.reshape(count, tries), covered.reshape(count, tries)
    # A roof terrace is a floor as well, but only where nothing under a roof is free.
    first = _first_free(building, points, good & covered)
    first = np.where(first < 0, _first_free(building, points, good & (first < 0)[:, None]), first)
    found = first >= 0
    yaw = draws.between(key, "sensor yaw", (-180.0, 180.0), 1)[:, 0].astype(np.float32)
    pitch = draws.between(key, "sensor pitch", standing.pitch, 1)[:, 0].astype(np.float32)
    return Pose(points[np.arange(count), first], yaw, pitch), found


def _first_free(building: Building, points: np.ndarray, good: np.ndarray) -> np.ndarray:
    """(R,) the first good try that is inside no element; -1 if none is."""
    first = np.full(len(points), -1)
    for view in range(len(points)):
        for place in np.flatnonzero(good[view]):
            if element_around(building, points[view, place]) < 0:
                first[view] = place
                break
    return first


def storeys_between(building: Building, low: float, high: float) -> np.ndarray:
    """Rows of the storeys that heights from `low` to `high` [m] reach into by more than a floor's thickness."""
    return np.flatnonzero((building.storeys.elevation + _STEP < high) & (_tops(building) - _STEP > low))


def _tops(building: Building) -> np.ndarray:
    """(S,) where each storey ends: where the next begins, or at the usual height."""
    elevation = building.storeys.elevation
    return np.append(elevation[1:], elevation[-1] + _STOREY_HEIGHT)
