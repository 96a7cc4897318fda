"""Scans from outside a building: only new objects inside of it are reported.

Trees, cars and other houses are in no building model. N points. Positions are offsets from the prior's origin, world
axes: metres, z up.
"""

import numpy as np

from jaxmm.verdicts.mismatches import Looked
from jaxmm.verdicts.priors import Prior
from warp_scanner.scenes.building import Triangles, bounds
from warp_scanner.scenes.scenes import CEILING, FLOOR, PILLAR, WALL
from warp_scanner.sensors.scan import Rays
from warp_scanner.sensors.triangles import cast_triangles

BESIDE, ABOVE = 0.5, 3.0  # [m] of what a model spans: where a new wall may be outside of it, and where it may grow
WITHOUT_FLOORS = 2.0  # [m] beside a building that has none
DEEP = 6.0  # [m] below a place, at most, of what it stands on
TERRAIN = ("IfcSite", "IfcGeographicElement")
OUTDOORS = "it was taken outdoors: of what is new, only what is in the building is told"


def is_outdoors(prior: Prior, position: np.ndarray) -> bool:
    """Whether a place (3,) is outside of a building; a cloud has no inside."""
    return prior.scene is not None and not indoors(prior, np.asarray(position)[None])[0]


def indoors(prior: Prior, points: np.ndarray) -> np.ndarray:
    """(N,) bool: points (N, 3) in a building: under something, on a floor, or among walls and on anything else.

    Right beside such a place, too, and on the highest floor, of which the model has no walls yet. Terrain is no floor.
    Of a building without floors, whatever is in its bounding box or within 2 m of it counts.
    """
    points, semantic = np.asarray(points, np.float64), prior.building.triangles.semantic
    level = np.isin(semantic, (FLOOR, CEILING))
    if not level.any():
        return _within(points, prior.building.triangles, WITHOUT_FLOORS)
    found = _within(points, prior.building.triangles, BESIDE)
    steps = BESIDE * np.array([[0, 0, 0], [1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]], float)
    places = (points[found][:, None] + steps).reshape(-1, 3)
    of_building = ~np.isin(np.asarray(prior.building.elements.ifc_class, str), TERRAIN)

    def away(way: float, there: np.ndarray) -> np.ndarray:
        return cast_triangles(prior.scene, Rays(places, np.array([[0.0, 0.0, way]], np.float32)), there).distance[:, 0]

    covered, on_floor = np.isfinite(away(1.0, of_building)), away(-1.0, level) <= DEEP
    on_anything = away(-1.0, of_building) <= DEEP
    upright = np.isin(semantic, (WALL, PILLAR))[prior.building.triangles.element]
    among_walls = np.zeros(len(places), bool)
    if upright.any():
        walls = prior.building.triangles
        among_walls = _within(places, walls._replace(faces=walls.faces[upright], element=walls.element[upright]), 0.0)
    found[found] = (covered | on_floor | (on_anything & among_walls)).reshape(-1, len(steps)).any(axis=1)
    return found


def _within(points: np.ndarray, triangles: Triangles, beside: float) -> np.ndarray:
    """(N,) bool: in the box around triangles, no farther than that [m] beside it, or where it may grow above."""
    low, high = (corner.astype(np.float64) for corner in bounds(triangles))
    aside = np.array([beside, beside, 0.0])
    return np.all((points >= low - aside) & (points <= high + aside + np.array([0.0, 0.0, ABOVE])), axis=1)


def of_building_only(prior: Prior, looked: Looked) -> Looked:
    """A scan from outdoors in which nothing outside of the building is held for new."""
    side = looked.added
    there = indoors(prior, side.view.points)
    return looked._replace(added=side._replace(pillar=side.pillar * there, wall=side.wall * there))
