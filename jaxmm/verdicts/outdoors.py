"""What is in a building and what is outside of it: only new objects inside of it are reported.

Trees, cars and other houses are in no building model. N points. Positions are offsets from the prior's origin, world
axes: metres, z up.
"""

from collections.abc import Sequence

import numpy as np

from jaxmm.classes.unexplained import Unexplained, UnexplainedSettings, unexplained_things
from jaxmm.rays.evidence import BLOCKED
from jaxmm.verdicts.mismatch_points import inside
from jaxmm.verdicts.priors import Prior
from jaxmm.verdicts.results import Mismatch
from jaxmm.verdicts.scan_fusion import Looked
from warp_scanner.scenes.building import Triangles, bounds, element_bounds
from warp_scanner.scenes.scenes import CEILING, DOOR, FLOOR, PILLAR, WALL, WINDOW
from warp_scanner.sensors.scan import Rays
from warp_scanner.sensors.triangles import cast_triangles

BESIDE, ABOVE = 0.5, 3.0  # [m] of what a model spans: where a new wall may be outside of it, and where it may grow
WITHOUT_FLOORS = 2.0  # [m] beside a building that has neither floors nor rooms, of which only parts are modelled
DEEP = 6.0  # [m] below a place, at most, of what it stands on
BURIED = 1.0  # [m] below terrain, a floor is that of a cellar: what stands above does not stand on it
RAISED = 1.5  # [m] of air beneath what is no ground
COVERED = 1.5  # [m] across: what covers no more between a facade and the open is eaves
STEP = 0.1  # [m] of the places at which one looks up
NEAR_WALLS = 8.0  # [m] to the walls around a place that is a room without floor and ceiling, and no wide courtyard
ENCLOSED = 0.8  # share of the directions around a place in which such walls stand: doors and windows are gaps
IN_A_WALL = 0.6  # [m] to most of what is around a place: less is the wall that the place is in
ROOMY = 0.2  # share of the places in a building that are enclosed, if its model has rooms
GRID = 10  # of those places, along x and y
AROUND = np.radians(np.arange(0.0, 360.0, 11.25))  # of the directions around a place
TILT = np.radians([-10.0, 0.0, 10.0])  # any of which may meet a wall with windows
ACROSS = 8  # of the directions around, as many look for the end of a cover; each has its opposite
UP, DOWN = (np.array([[0.0, 0.0, way]], np.float32) for way in (1.0, -1.0))
TERRAIN = ("IfcSite", "IfcGeographicElement")
OUTDOORS = "it was taken outdoors: of what is new, only what is in the building is told"


def is_outdoors(prior: Prior, position: np.ndarray) -> bool:
    """Whether a sensor at a place (3,) is outside of a building; a cloud has no inside.

    It is inside where it stands on a floor, or under more than eaves, or on anything that is no ground (a deck of
    planks), or among walls on anything but terrain, or where walls stand near it on all sides: none needs facades. A
    courtyard is inside only if its ground is a floor of the model, or where its walls are within 8 m all around. Of a
    building without floors, what it spans is its inside; 2 m more where its model has no rooms, but parts of them.
    """
    return prior.scene is not None and not _is_inside(prior, np.asarray(position, np.float64))


def _is_inside(prior: Prior, place: np.ndarray) -> bool:
    triangles, building = prior.building.triangles, _of_building(prior)
    level, upright = np.isin(triangles.semantic, (FLOOR, CEILING)), np.isin(triangles.semantic, (WALL, PILLAR))
    if not level.any():
        return bool(_within(place[None], triangles, _beside_rooms(prior))[0])
    if not _within(place[None], triangles, 0.0)[0]:
        return False
    drop = _free(prior, place[None], DOWN, building)[0, 0]
    if _stands_on_floor(prior, place[None], level, building)[0] or _is_raised(prior, place, building):
        return True
    among = _among(prior, place[None], upright)[0]
    return bool(drop <= DEEP and among) or _is_covered(prior, place, building) or _enclosed(prior, place[None])[0]


def indoors(prior: Prior, points: np.ndarray) -> np.ndarray:
    """(N,) bool: points (N, 3) in a building: under something, on a floor, or among walls and on anything else.

    Right beside such a place, too, and on the highest floor, of which the model has no walls yet. Terrain is no floor.
    Of a building without floors, whatever is in its bounding box or beside it counts, see `is_outdoors`.
    """
    points, semantic = np.asarray(points, np.float64), prior.building.triangles.semantic
    level = np.isin(semantic, (FLOOR, CEILING))
    if not level.any():
        return _within(points, prior.building.triangles, max(BESIDE, _beside_rooms(prior)))
    found, building = _within(points, prior.building.triangles, BESIDE), _of_building(prior)
    steps = BESIDE * np.array([[0, 0, 0], [1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]], float)
    places = (points[found][:, None] + steps).reshape(-1, 3)
    covered = np.isfinite(_free(prior, places, UP, building)[:, 0])
    on_anything = _free(prior, places, DOWN, building)[:, 0] <= DEEP
    among_walls = _among(prior, places, np.isin(semantic, (WALL, PILLAR)))
    there = covered | _stands_on_floor(prior, places, level, building) | (on_anything & among_walls)
    found[found] = there.reshape(-1, len(steps)).any(axis=1)
    return found


def _of_building(prior: Prior) -> np.ndarray:
    """(E,) bool: elements that are no terrain."""
    return ~np.isin(np.asarray(prior.building.elements.ifc_class, str), TERRAIN)


def _free(prior: Prior, places: np.ndarray, directions: np.ndarray, present: np.ndarray) -> np.ndarray:
    """(N, D) [m] from places (N, 3) along unit vectors (D, 3) to what is present (E,); inf: to nothing."""
    return cast_triangles(prior.scene, Rays(places, directions), present).distance


def _stands_on_floor(prior: Prior, places: np.ndarray, level: np.ndarray, building: np.ndarray) -> np.ndarray:
    """(N,) bool: above a floor, and not on the terrain above it."""
    drop = _free(prior, places, DOWN, level)[:, 0]
    on = drop <= DEEP
    if on.any() and not building.all():
        on[on] &= drop[on] <= _free(prior, places[on], DOWN, ~building)[:, 0] + BURIED
    return on


def _is_raised(prior: Prior, place: np.ndarray, building: np.ndarray) -> bool:
    """Whether what is below a place (3,) has air beneath it, and then something else of the building."""
    below = cast_triangles(prior.scene, Rays(place[None], DOWN), building)
    if not below.distance[0, 0] <= DEEP:
        return False
    element = int(below.element[0, 0])
    corners = prior.building.triangles.vertices[
        prior.building.triangles.faces[prior.building.triangles.element == element]
    ]
    rest = building & (np.arange(len(building)) != element)
    drop = _free(prior, np.array([[*place[:2], float(corners[..., 2].min())]]), DOWN, rest)[0, 0]
    return bool(np.isfinite(drop) and drop >= RAISED)


def _is_covered(prior: Prior, place: np.ndarray, building: np.ndarray) -> bool:
    """Whether a place (3,) is under something of the building that is no eaves: wide, or with walls on both sides.

    Eaves end in the open, and do so within 1.5 m from the wall that they are on.
    """
    if not np.isfinite(_free(prior, place[None], UP, building)[0, 0]):
        return False
    ways = _directions(AROUND[:: len(AROUND) // ACROSS], 0.0)
    steps = np.arange(STEP, COVERED + STEP, STEP)
    above = place + ways[:, None] * steps[:, None]
    open_above = ~np.isfinite(_free(prior, above.reshape(-1, 3), UP, building)).reshape(len(ways), -1)
    no_column = building & (prior.building.triangles.semantic != PILLAR)
    to_wall = _free(prior, place[None], ways.astype(np.float32), no_column)[0]
    to_open = np.where(open_above.any(axis=1), steps[np.argmax(open_above, axis=1)], np.inf)
    ends = np.minimum(to_wall, to_open)
    across, is_open = ends + np.roll(ends, ACROSS // 2), to_open < to_wall
    return not np.any((across < COVERED) & (is_open | np.roll(is_open, ACROSS // 2)))


def _enclosed(prior: Prior, places: np.ndarray, most: float = NEAR_WALLS) -> np.ndarray:
    """(N,) bool: walls or whatever else stands upright in most directions from places (N, 3), no farther [m]."""
    present = np.isin(prior.building.triangles.semantic, (WALL, DOOR, WINDOW))
    if not present.any():
        return np.zeros(len(places), bool)
    directions = np.concatenate([_directions(AROUND, tilt) for tilt in TILT]).astype(np.float32)
    free = _free(prior, places, directions, present).reshape(len(places), len(TILT), -1).min(axis=1)
    return ((free < most).mean(axis=1) >= ENCLOSED) & (np.median(free, axis=1) >= IN_A_WALL)


def _directions(around: np.ndarray, tilt: float) -> np.ndarray:
    """Unit vectors (D, 3) at angles (D,) about z, tilted upwards [rad]."""
    return np.column_stack(
        [np.cos(around) * np.cos(tilt), np.sin(around) * np.cos(tilt), np.full(len(around), np.sin(tilt))]
    )


def _beside_rooms(prior: Prior) -> float:
    """How far [m] beside a building without floors one is still inside: next to a mere wall, but not to a room."""
    low, high = (corner.astype(np.float64) for corner in bounds(prior.building.triangles))
    share = (np.arange(GRID) + 0.5) / GRID
    x, y = np.meshgrid(low[0] + share * (high - low)[0], low[1] + share * (high - low)[1])
    walls = np.isin(prior.building.triangles.semantic, (WALL, DOOR, WINDOW))
    foot, top = (corner[walls, 2] for corner in element_bounds(prior.building.triangles))
    if not walls.any():
        return WITHOUT_FLOORS
    height = np.median((foot + top) / 2)
    places = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, height)])
    return 0.0 if _enclosed(prior, places, np.inf).mean() >= ROOMY else WITHOUT_FLOORS


def _among(prior: Prior, places: np.ndarray, upright: np.ndarray) -> np.ndarray:
    """(N,) bool: places (N, 3) in the box around what stands upright (E,)."""
    triangles = prior.building.triangles
    chosen = upright[triangles.element]
    if not chosen.any():
        return np.zeros(len(places), bool)
    return _within(places, triangles._replace(faces=triangles.faces[chosen], element=triangles.element[chosen]), 0.0)


def _within(points: np.ndarray, triangles: Triangles, beside: float) -> np.ndarray:
    """(N,) bool: in the box around triangles, no farther than that [m] beside it, or where it may grow above."""
    low, high = (corner.astype(np.float64) for corner in bounds(triangles))
    aside = np.array([beside, beside, 0.0])
    return np.all((points >= low - aside) & (points <= high + aside + np.array([0.0, 0.0, ABOVE])), axis=1)


def things_not_in_model(
    prior: Prior, looked: list[Looked], found: Sequence[Mismatch], settings: UnexplainedSettings
) -> tuple[Unexplained, ...]:
    """What all scans show before the prior's surface and far from it, in the building, and of no mismatch; world frame.

    Args:
        prior: what should be there; of a cloud counts what it had seen empty.
        looked: each scan.
        found: all mismatches.
        settings: what counts.
    """
    own = [np.zeros((0, 3))]
    for one in looked:
        view = one.added.view
        own.append(view.points[view.candidate & (view.count[:, BLOCKED] > 0) & (view.apart >= settings.apart)])
    points = np.concatenate(own)
    for one in found:
        points = points[~inside(one, points, prior.origin)]
    if prior.has_elements and len(points):
        points = points[indoors(prior, points)]
    things = unexplained_things(points, settings)
    return tuple(one._replace(center=one.center + prior.origin) for one in things)


def of_building_only(prior: Prior, looked: Looked) -> Looked:
    """A scan from outdoors in which nothing outside of the building is held for new."""
    side = looked.added
    there = indoors(prior, side.view.points)
    return looked._replace(added=side._replace(pillar=side.pillar * there, wall=side.wall * there))
