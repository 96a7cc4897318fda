"""Scans from outdoors: of what is new out there nobody knows since when, of what is in the building one does.

Trees, cars and other houses are in no building model. N points. Positions are offsets from the prior's origin, world
axes: metres, z up.
"""

import numpy as np

from jaxmm.mismatches import Looked
from jaxmm.priors import Prior
from warp_scanner.buildings import bounds
from warp_scanner.scan import Rays
from warp_scanner.scenes import CEILING, FLOOR
from warp_scanner.triangles import cast_triangles

BESIDE, ABOVE = 2.0, 3.0  # [m] of what a model spans: beside one without floors; above any, where it may grow
OUTDOORS = "it was taken outdoors: of what is new, only what is in the building is told"


def is_outdoors(prior: Prior, position: np.ndarray) -> bool:
    """Whether a place (3,) is outside of a building; a cloud has no inside."""
    return prior.scene is not None and not indoors(prior, np.asarray(position)[None])[0]


def indoors(prior: Prior, points: np.ndarray) -> np.ndarray:
    """(N,) bool: points (N, 3) in a building, on one of its floors or under something; its terrain is no floor.

    What stands on its highest floor, too, of which the model has no walls yet. Of a building without floors, what is in
    its bounding box, beside it or above it.
    """
    points = np.asarray(points, np.float64)
    level = np.isin(prior.scene.triangles.semantic, (FLOOR, CEILING))
    low, high = (corner.astype(np.float64) for corner in bounds(prior.building.triangles))
    aside = np.array([1.0, 1.0, 0.0]) * (0.0 if level.any() else BESIDE)
    within = np.all((points >= low - aside) & (points <= high + aside + np.array([0.0, 0.0, ABOVE])), axis=1)
    if not level.any():
        return within
    near = points[within]
    down, up = np.array([[[0.0, 0.0, -1.0]], [[0.0, 0.0, 1.0]]], np.float32)
    on_floor = np.isfinite(cast_triangles(prior.scene, Rays(near, down), level).distance[:, 0])
    covered = np.isfinite(cast_triangles(prior.scene, Rays(near, up)).distance[:, 0])
    within[within] = on_floor | covered
    return within


def of_building_only(prior: Prior, looked: Looked) -> Looked:
    """A scan from outdoors in which nothing outside of the building is held for new."""
    side = looked.added
    there = indoors(prior, side.view.points)
    return looked._replace(added=side._replace(pillar=side.pillar * there, wall=side.wall * there))
