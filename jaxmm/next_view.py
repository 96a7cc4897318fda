"""Where to stand next: the nearest free place from which an element that was hidden would be seen.

E elements, C places, S points on an element. Positions are offsets from the building's origin: metres, z up.
"""

from typing import NamedTuple

import numpy as np

from warp_scanner.building_poses import element_around, inside
from warp_scanner.buildings import Building
from warp_scanner.scan import Rays
from warp_scanner.triangles import TriangleScene, cast_triangles, clearance

STEP = 0.75  # [m] between places
REACH = 9.0  # [m] from the element or the sensor to the farthest place
GAP = 0.35  # [m] to everything
SAMPLES = 32  # points on an element that a place is judged by
LEAST_SHOWN = 0.3  # of them, from which the place would do
CELL = 0.15  # [m] of the cells that obstacles fill
ENDS = 0.3  # [m] next to an element within which nothing counts as an obstacle: points on it lie there
MOST_PLACES = 400


class Stage(NamedTuple):
    """What is known of a place."""

    building: Building
    scene: TriangleScene
    obstacles: np.ndarray  # (N, 3) float32 [m] what stands there and the building does not know
    sensor: np.ndarray  # (3,) float64 [m] where it was scanned from
    height: float  # [m] of the sensor above the floor


def next_views(stage: Stage, elements: np.ndarray) -> list[tuple[np.ndarray, float, float] | None]:
    """For each element (E,) the free place nearest to the sensor that would show it, with yaw and pitch [deg] to it.

    A place would do when straight lines from it reach at least 0.3 of the element's points unhindered by the building
    or by what the robot saw standing around; where none does, there is None.
    """
    places = _free_places(stage)
    order = np.argsort(np.linalg.norm(places - stage.sensor, axis=1), kind="stable")[:MOST_PLACES]
    places, blocked = places[order], _cells(stage.obstacles)
    return [_view_of(stage, int(element), places, blocked) for element in elements]


def _free_places(stage: Stage) -> np.ndarray:
    """Places (C, 3) of a grid around the sensor, at its height above the floor below each."""
    count = int(REACH / STEP)
    x, y = np.meshgrid(np.arange(-count, count + 1) * STEP, np.arange(-count, count + 1) * STEP)
    places = stage.sensor + np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    places = places[inside(stage.building, stage.scene, places)]
    down = np.array([[0.0, 0.0, -1.0]], np.float32)
    drop = cast_triangles(stage.scene, Rays(places, down)).distance[:, 0].astype(np.float64)
    level = np.isfinite(drop) & (np.abs(drop - stage.height) < 0.6)
    places = places[level] + np.column_stack([np.zeros((level.sum(), 2)), stage.height - drop[level]])
    places = places[clearance(stage.scene, places, GAP) >= GAP]
    if len(stage.obstacles) and len(places):
        from scipy.spatial import cKDTree

        places = places[cKDTree(stage.obstacles).query(places)[0] > GAP]
    free = [element_around(stage.building, place) < 0 for place in places]
    return places[np.array(free, bool)]


def _view_of(
    stage: Stage, element: int, places: np.ndarray, blocked: np.ndarray
) -> tuple[np.ndarray, float, float] | None:
    points = _samples(stage, element)
    for start in range(0, len(places), 50):  # the nearest ones mostly do
        some = places[start : start + 50]
        toward = points[None] - some[:, None]
        reach = np.linalg.norm(toward, axis=2)
        rays = Rays(some, (toward / reach[..., None]).astype(np.float32))
        first = cast_triangles(stage.scene, rays).element
        shown = (first == element) & ~_hindered(some, toward, reach, blocked)
        good = np.flatnonzero(shown.mean(axis=1) >= LEAST_SHOWN)
        if len(good):
            place = some[good[0]]
            offset = points[shown[good[0]]].mean(axis=0) - place
            yaw = np.degrees(np.arctan2(offset[1], offset[0]))
            return place, float(yaw), float(np.degrees(np.arctan2(offset[2], np.hypot(*offset[:2]))))
    return None


def _samples(stage: Stage, element: int) -> np.ndarray:
    """Points (S, 3) spread over an element's surface by area, the same at every call."""
    triangles = stage.scene.triangles
    corners = triangles.vertices[triangles.faces[triangles.element == element]].astype(np.float64)
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    rng = np.random.default_rng(element)
    which = rng.choice(len(area), SAMPLES, p=area / area.sum())
    u, v = rng.random((2, SAMPLES, 1))
    u, v = np.where(u + v > 1.0, 1.0 - u, u), np.where(u + v > 1.0, 1.0 - v, v)
    return a[which] + u * (b - a)[which] + v * (c - a)[which]


def _hindered(places: np.ndarray, toward: np.ndarray, reach: np.ndarray, blocked: np.ndarray) -> np.ndarray:
    """(C, S) bool: an obstacle's cell lies on the line from place to point."""
    if not len(blocked):
        return np.zeros(reach.shape, bool)
    steps = np.arange(GAP, reach.max(), CELL)
    along = steps / reach[..., None]
    at = places[:, None, None] + toward[:, :, None] * along[..., None]
    met = np.isin(_keys(at), blocked)
    return (met & (steps < reach[..., None] - ENDS)).any(axis=2)


def _cells(points: np.ndarray) -> np.ndarray:
    return np.unique(_keys(points)) if len(points) else np.zeros(0, np.int64)


def _keys(points: np.ndarray) -> np.ndarray:
    cell = np.floor(points / CELL).astype(np.int64) + 2**19
    return (cell[..., 0] << 40) | (cell[..., 1] << 20) | cell[..., 2]
