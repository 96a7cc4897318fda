"""Where in a building a sensor may stand, evenly: on every floor, at the heights that it may have above it.

N places. Positions are offsets from the building's origin: metres, z up.
"""

import numpy as np

from warp_scanner.scenes.building import Building, bounds, fixed
from warp_scanner.sensors.scan import Rays
from warp_scanner.sensors.triangles import TriangleScene, cast_faces, clearance, face_normals

SPACING = 0.5  # [m] between places in plan
MOST_PLACES = 60_000  # a large building gets a wider grid, so that a search ends
WIDER = 1.25  # times as far apart, until they are no more
LEVELS = 200  # surfaces below each other that are looked for at most
BEYOND = 0.005  # [m] below a surface, from where the next is looked for
LEVEL = 0.8  # a surface whose normal rises by less is no floor
HEADROOM = 0.2  # [m] above the sensor, at least
GAP = 0.15  # [m] around it


def free_places(building: Building, scene: TriangleScene, heights: tuple[float, ...]) -> np.ndarray:
    """Places (N, 3) float64 on a grid, `heights` [m] above whatever level surface has room for a sensor above it.

    Floors are told by their triangles, not by storeys: landings, terraces and roofs count. Furniture is no floor. Where
    the file has no level surface at all, as one of walls alone, the elevations of its storeys count. Places within a
    thick solid may be among them.

    Args:
        building: the building.
        scene: its triangles, prepared.
        heights: [m] that the sensor may have above its floor.
    """
    spacing = SPACING
    while len(found := _places(building, scene, heights, spacing)) > MOST_PLACES:
        spacing *= WIDER
    return found


def _places(building: Building, scene: TriangleScene, heights: tuple[float, ...], spacing: float) -> np.ndarray:
    low, high = (corner.astype(np.float64) for corner in bounds(scene.triangles))
    x, y = (np.arange(low[axis] + spacing / 2, high[axis], spacing) for axis in (0, 1))
    plan = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    floors = _floors_under(scene, plan, float(high[2]) + 1.0)
    bare = plan[~np.isin(plan @ (1.0, 1j), floors[:, :2] @ (1.0, 1j))]
    floors = np.concatenate([floors, *(_level(bare, elevation) for elevation in building.storeys.elevation)])
    found = []
    for height in heights:
        roomy = floors[:, 3] >= height + HEADROOM
        found.append(floors[roomy, :3] + (0.0, 0.0, height))
    places = np.concatenate(found)
    return places[clearance(scene, places, GAP + 1.0) > GAP]


def _level(plan: np.ndarray, elevation: float) -> np.ndarray:
    """(n, 4) as of floors, of a plan (n, 2) with all the room there is above."""
    return np.column_stack([plan, np.full(len(plan), elevation), np.full(len(plan), np.inf)])


def _floors_under(scene: TriangleScene, plan: np.ndarray, top: float) -> np.ndarray:
    """(K, 4) float64 [m]: places on level surfaces under a plan (n, 2), and how much is free above each."""
    own, down = fixed(scene.triangles), np.array([[0.0, 0.0, -1.0]], np.float32)
    # What only the sky is above has all the room there is.
    above, start, found = np.full(len(plan), np.inf), np.full(len(plan), top), []
    for _ in range(LEVELS):
        if not len(plan):
            break
        scan, face = cast_faces(scene, Rays(np.column_stack([plan, start]), down), own)
        hit = np.isfinite(scan.distance[:, 0])
        plan, start, above = plan[hit], start[hit] - scan.distance[hit, 0], above[hit]
        normal = face_normals(scene.triangles, face[hit])[:, 0].astype(np.float64)
        level = np.abs(normal[:, 2]) > LEVEL * np.linalg.norm(normal, axis=1)
        found.append(np.column_stack([plan, start, above - start])[level])
        above, start = start, start - BEYOND
    return np.concatenate(found) if found else np.zeros((0, 4))
