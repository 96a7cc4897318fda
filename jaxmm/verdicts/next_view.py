"""Where to stand next: the nearest free place from which an element that was hidden would be seen.

E elements, C places, S points on an element. Positions are offsets from the building's origin: metres, z up.
"""

from typing import NamedTuple

import numpy as np

from jaxmm.rays.evidence import LEAST_COSINE
from jaxmm.rays.scan_rays import NEAREST, PosedScan, ScanRays
from jaxmm.vectors import lengths
from warp_scanner.buildings.positions import element_around, inside
from warp_scanner.clouds.sightlines import cells_of
from warp_scanner.scenes.building import Building, element_bounds, faces_by_element
from warp_scanner.sensors.poses import rotation_of
from warp_scanner.sensors.scan import Rays
from warp_scanner.sensors.sensors import Sensor, Spinning
from warp_scanner.sensors.triangles import TriangleScene, cast_triangles, clearance

STEP = 0.75  # [m] between places
REACH = 9.0  # [m] from the element to the farthest place
GAP = 0.35  # [m] to everything
LEVEL = 0.6  # [m] between floors that count as one
SAMPLES = 32  # points on an element that a place is judged by
LEAST_SHOWN = 0.3  # of them, from which the place would do
LEAST_IN_VIEW = 0.1  # of them, in one look of the sensor: a long wall seldom fits into it
CELL = 0.15  # [m] of the cells that obstacles fill
ENDS = 0.3  # [m] next to an element within which nothing counts as an obstacle: points on it lie there
MOST_PLACES = 400  # of one element
AT_ONCE = 50  # places looked from together: the nearest ones mostly do
CLOSER = 1.5  # times as near, from where on what a scan has looked at without telling of it is worth another look
VIEW = np.radians(2.0)  # of the cells of directions that a scan looked along, at least

View = tuple[np.ndarray, float, float]  # place (3,) [m], yaw and pitch [deg]


class Stand(NamedTuple):
    """Where one scan was taken from, and what its sensor would see from another place."""

    position: np.ndarray  # (3,) float64 [m]
    floor: float  # [m] of the floor beneath, as the scan has it
    reach: tuple[float, float]  # [m] least and greatest range
    sensor: Sensor | None = None  # None: any; it then looks wherever it is turned to
    looked: np.ndarray | None = None  # (n,) int cells of directions that its rays went along; None: nobody knows
    cell: float = VIEW  # [rad] of those

    def has_looked(self, toward: np.ndarray) -> np.ndarray:
        """(S,) bool: its rays went along directions (S, 3) of any length."""
        if self.looked is None:
            return np.zeros(len(toward), bool)
        unit = toward / np.maximum(lengths(toward), 1e-9)[:, None]
        return np.isin(cells_of(unit, self.cell)[0], self.looked)


class Stage(NamedTuple):
    """What is known of a building before the next scan."""

    building: Building
    scene: TriangleScene  # what of it is not gone
    obstacles: np.ndarray  # (N, 3) float32 [m] what stands there and the building does not know
    stands: tuple[Stand, ...]  # of all scans, at least one


def stand_of(scan: PosedScan, rays: ScanRays, floor: float) -> Stand:
    """Of one scan; a sensor of which no range is known reaches as far as it did there."""
    near = scan.sensor.range_limits[0] if scan.sensor is not None else NEAREST
    far = rays.limit if np.isfinite(rays.limit) else float(rays.distance[: rays.measured].max())
    cell = max(VIEW, 2.0 * rays.spacing)
    return Stand(rays.position, floor, (near, far), scan.sensor, np.unique(cells_of(rays.pattern, cell)[0]), cell)


def next_views(stage: Stage, elements: np.ndarray) -> list[View | None]:
    """For each element (E,) the free place that would show it and is nearest to where any scan was taken from.

    From there the sensor of that scan faces the element; a spinning one stands level. A place would do when straight
    lines from it reach at least 0.3 of the element's points within the sensor's range and not at a grazing angle,
    hindered neither by the building nor by what a robot saw standing around, and 0.1 of them lie in its view. Points
    that a scan has looked at in the same way told nothing, and count only from much nearer by. Where no place would do,
    there is None. Nearest is as the crow flies: what lies between is not looked at.
    """
    if not len(elements):
        return []
    low, high = (corners[elements].astype(np.float64) for corners in element_bounds(stage.building.triangles))
    places, stand = _free_places(stage, low.min(axis=0) - REACH, high.max(axis=0) + REACH)
    blocked, found = _cells(stage.obstacles), []
    for element, least, most in zip(elements, low, high, strict=True):
        beside = np.maximum(np.maximum(least - places, places - most), 0.0)
        near = np.flatnonzero(lengths(beside) <= REACH)[:MOST_PLACES]
        found.append(_view_of(stage, int(element), (places[near], stand[near]), blocked))
    return found


def _free_places(stage: Stage, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Places (C, 3) between two corners and whose stand (C,) each is of, those nearest to their stand first."""
    found = []
    for number, stand in enumerate(stage.stands):
        places = _grid(stand, low, high)
        places = _on_floor(stage, stand, places[_nearest(stage.stands, stand, places) == number])
        places = places[clearance(stage.scene, places, GAP) >= GAP]
        if len(stage.obstacles) and len(places):
            from scipy.spatial import cKDTree

            places = places[cKDTree(stage.obstacles).query(places)[0] > GAP]
        found.append(places[_outside_all(stage.building, places)])
    stand = np.repeat(np.arange(len(found)), [len(places) for places in found])
    places = np.concatenate(found)
    apart = lengths(places - np.array([one.position for one in stage.stands])[stand])
    order = np.argsort(apart, kind="stable")
    return places[order], stand[order]


def _grid(stand: Stand, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Places (C, 3) at the sensor's own height, itself one of them, no farther than something near could be seen."""
    here, far = stand.position, stand.reach[1] + REACH
    first, last = np.maximum(low - here, -far), np.minimum(high - here, far)
    x, y = (
        here[axis] + STEP * np.arange(np.ceil(first[axis] / STEP), np.floor(last[axis] / STEP) + 1) for axis in (0, 1)
    )
    x, y = np.meshgrid(x, y)
    return np.column_stack([x.ravel(), y.ravel(), np.full(x.size, here[2])])


def _nearest(stands: tuple[Stand, ...], own: Stand, places: np.ndarray) -> np.ndarray:
    """(C,) which of the stands on one's own floor is nearest to each place, so that no place is looked from twice."""
    apart = [
        lengths(places[:, :2] - one.position[:2])
        if abs(one.floor - own.floor) < LEVEL
        else np.full(len(places), np.inf)
        for one in stands
    ]
    return np.argmin(apart, axis=0)


def _on_floor(stage: Stage, stand: Stand, places: np.ndarray) -> np.ndarray:
    """Of places (C, 3) inside the building those that have the sensor's floor beneath, at its height above that.

    A building without anything beneath the sensor, or around it, is asked neither for floors nor for its inside: it is
    then the scan's own floor that all places stand on. So do they on a storey without a slab: the sensor and most of
    the places have the ground far below.
    """
    here = stand.position[None]
    if inside(stage.building, stage.scene, here)[0]:
        places = places[inside(stage.building, stage.scene, places)]
    down, height = np.array([[0.0, 0.0, -1.0]], np.float32), stand.position[2] - stand.floor
    origin = np.concatenate([here, places])
    drop = cast_triangles(stage.scene, Rays(origin, down)).distance[:, 0].astype(np.float64)
    if np.isinf(drop[0]):
        drop[np.isinf(drop)] = height
    elif min(drop[0], np.median(drop)) > height + LEVEL:
        drop[drop > height] = height
    drop = drop[1:]
    level = np.abs(drop - height) < LEVEL
    return places[level] + np.column_stack([np.zeros((level.sum(), 2)), height - drop[level]])


def _outside_all(building: Building, places: np.ndarray) -> np.ndarray:
    """(C,) bool: inside no solid element. Only those whose bounds hold a place are asked, for they may be many."""
    triangles = building.triangles
    low, high = element_bounds(triangles)
    order, start = faces_by_element(triangles)
    free = np.ones(len(places), bool)
    for number, place in enumerate(places):
        around = np.flatnonzero(((low <= place) & (place <= high)).all(axis=1))
        if len(around):
            rows = np.concatenate([order[start[element] : start[element + 1]] for element in around])
            few = triangles._replace(faces=triangles.faces[rows], element=triangles.element[rows])
            free[number] = element_around(building._replace(triangles=few), place) < 0
    return free


def _view_of(stage: Stage, element: int, near: tuple[np.ndarray, np.ndarray], blocked: np.ndarray) -> View | None:
    (points, normals), limits = _samples(stage, element), np.array([stand.reach for stand in stage.stands])
    known = _looked_at(stage, element, (points, normals), blocked) / CLOSER
    for start in range(0, len(near[0]), AT_ONCE):
        places, stand = (values[start : start + AT_ONCE] for values in near)
        toward, reach, shown = _shown_from(stage, element, (points, normals), places, limits[stand])
        shown &= reach < known
        good = np.flatnonzero(shown.mean(axis=1) >= LEAST_SHOWN)
        shown[good] &= ~_hindered(places[good], toward[good], reach[good], blocked)
        for place in good[shown[good].mean(axis=1) >= LEAST_SHOWN]:
            view = _facing(stage.stands[stand[place]].sensor, places[place], points[shown[place]])
            if view is not None:
                return view
    return None


def _shown_from(
    stage: Stage, element: int, samples: tuple[np.ndarray, np.ndarray], places: np.ndarray, limits: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of each place (C, 3) the way (C, S, 3) and distance (C, S) [m] to samples, and whether the building shows them.

    `limits` (C, 2) [m] are the least and the greatest range of the sensor there.
    """
    points, normals = samples
    toward = points[None] - places[:, None]
    reach = np.linalg.norm(toward, axis=2)
    rays = Rays(places, (toward / reach[..., None]).astype(np.float32))
    least, most = limits.T[..., None]
    shown = (cast_triangles(stage.scene, rays).element == element) & (reach >= least) & (reach <= most)
    return toward, reach, shown & (np.abs((toward * normals).sum(axis=2)) >= LEAST_COSINE * reach)


def _looked_at(stage: Stage, element: int, samples: tuple[np.ndarray, np.ndarray], blocked: np.ndarray) -> np.ndarray:
    """(S,) [m] from how near some scan has looked at samples, hindered by nothing that is known; inf: none has."""
    places, limits = (np.array([getattr(one, name) for one in stage.stands]) for name in ("position", "reach"))
    toward, reach, shown = _shown_from(stage, element, samples, places, limits)
    shown &= np.array([one.has_looked(way) for one, way in zip(stage.stands, toward, strict=True)])
    shown &= ~_hindered(places, toward, reach, blocked)
    return np.where(shown, reach, np.inf).min(axis=0)


def _facing(sensor: Sensor | None, place: np.ndarray, points: np.ndarray) -> View | None:
    """The sensor at a place, turned to the middle of points (n, 3); None where it has too few of them in view."""
    toward = points - place
    x, y, z = toward.mean(axis=0)
    yaw = float(np.degrees(np.arctan2(y, x)))
    pitch = 0.0 if isinstance(sensor, Spinning) else float(np.degrees(np.arctan2(z, np.hypot(x, y))))
    if sensor is not None:
        seen = sensor.sees(toward @ rotation_of([yaw], [pitch])[0])
        if seen.sum() < LEAST_IN_VIEW * SAMPLES:
            return None
    return place, yaw, pitch


def _samples(stage: Stage, element: int) -> tuple[np.ndarray, np.ndarray]:
    """Points (S, 3) spread over an element's surface by area, the same at every call; unit normals (S, 3) there."""
    triangles = stage.scene.triangles
    corners = triangles.vertices[triangles.faces[triangles.element == element]].astype(np.float64)
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    normal = np.cross(b - a, c - a)
    area = lengths(normal)
    rng = np.random.default_rng(element)
    which = rng.choice(len(area), SAMPLES, p=area / area.sum())
    u, v = rng.random((2, SAMPLES, 1))
    u, v = np.where(u + v > 1.0, 1.0 - u, u), np.where(u + v > 1.0, 1.0 - v, v)
    return a[which] + u * (b - a)[which] + v * (c - a)[which], normal[which] / area[which, None]


def _hindered(places: np.ndarray, toward: np.ndarray, reach: np.ndarray, blocked: np.ndarray) -> np.ndarray:
    """(C, S) bool: an obstacle's cell lies on the line from place to point."""
    if not len(blocked) or not len(places):
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
