"""What a scan shows in a building that no model of it explains, and that is neither a new wall nor a new column.

A machine, a stair, a scaffold, furniture: points that hang together, with the box around them, and no guess what it is.
N points; metres, z up.
"""

import dataclasses
from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import ConvexHull, QhullError, cKDTree

from jaxmm.config import bounded
from jaxmm.learning.upright_shapes import rectangle_along, turn_of

PLACE = 0.1  # [m] edge of a place: to that, scans were thinned, and of each one point counts


@dataclasses.dataclass(frozen=True)
class UnexplainedSettings:
    """From when on points count as something that the model lacks."""

    apart: float = bounded(0.15, 0.0, 2.0)  # [m] from the model's surface, at least
    joint: float = bounded(0.16, 0.0, 2.0)  # [m] points no farther from each other are of one thing
    least_points: int = bounded(20, 1)  # of it, one for each place of 0.1 m
    least_size: float = bounded(0.3, 0.0)  # [m] its longest edge


class Unexplained(NamedTuple):
    """Something that is not in the model."""

    center: np.ndarray  # (3,) float64 [m] of the upright box around it
    dimensions: np.ndarray  # (3,) float64 [m] full edges along the box's own axes
    rotation: float  # yaw [deg] from world x to the box's first axis, in [-90, 90)
    points: int  # of the scans on it, one for each place of 0.1 m


def unexplained_things(points: np.ndarray, settings: UnexplainedSettings) -> tuple[Unexplained, ...]:
    """The things that points (N, 3) [m] apart from the model are of, those with most points first."""
    points = np.asarray(points, np.float64)
    if len(points):
        points = points[np.unique(np.floor(points / PLACE), axis=0, return_index=True)[1]]
    if len(points) < settings.least_points:
        return ()
    pairs = cKDTree(points).query_pairs(settings.joint, output_type="ndarray")
    links = coo_matrix((np.ones(len(pairs), bool), pairs.T), shape=(len(points),) * 2)
    count, thing = connected_components(links, directed=False)
    size = np.bincount(thing, minlength=count)
    found = [_boxed(points[thing == one]) for one in np.flatnonzero(size >= settings.least_points)]
    found = [one for one in found if one.dimensions.max() >= settings.least_size]
    return tuple(sorted(found, key=lambda one: (-one.points, *one.center)))


def _boxed(points: np.ndarray) -> Unexplained:
    """The upright box around points (n, 3) to whose sides they are nearest in the mean, of such the smallest.

    Of a cabinet two faces are seen: the smallest box around these stands askew on their ends (X. Zhang et al.,
    "Efficient L-shape fitting for vehicle detection using laser scanners", IV 2017: closeness instead of area).
    """
    plan = points[:, :2]
    try:
        hull = plan[ConvexHull(plan).vertices]
        along = np.roll(hull, -1, axis=0) - hull
    except QhullError:  # all in one upright plane
        hull, along = plan, (plan - plan.mean(axis=0))[[np.argmax(np.linalg.norm(plan - plan.mean(axis=0), axis=1))]]
    length = np.linalg.norm(along, axis=1, keepdims=True)
    along = along[length[:, 0] > 0] / length[length[:, 0] > 0]
    ways = along if len(along) else np.array([[1.0, 0.0]])
    boxes = [(*rectangle_along(hull, way), way) for way in ways]
    costs = [(round(_from_sides(plan, *box), 6), round(float(box[1].prod()), 9), turn_of(box[2])) for box in boxes]
    middle, edges, way = boxes[min(range(len(boxes)), key=costs.__getitem__)]
    low, high = points[:, 2].min(), points[:, 2].max()
    turn = (np.degrees(turn_of(way)) + 90.0) % 180.0 - 90.0
    return Unexplained(
        np.array([*middle, (low + high) / 2.0]), np.array([*edges, high - low]), float(turn), len(points)
    )


def _from_sides(plan: np.ndarray, middle: np.ndarray, edges: np.ndarray, way: np.ndarray) -> float:
    """Mean distance [m] of places (n, 2) in a rectangle from the nearest of its sides."""
    own = (plan - middle) @ np.stack([way, [-way[1], way[0]]], axis=1)
    return float(np.abs(edges / 2.0 - np.abs(own)).min(axis=1).mean())
