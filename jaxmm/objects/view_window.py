"""The window that a scan looks through, as far as its own points show it.

Beyond its edge nothing came back: nobody looked there, or what was there is out of reach. N points of one scan. World
frame: metres, z up. Plan: x and y.
"""

from typing import NamedTuple

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from jaxmm.vectors import lengths

NARROW = 0.17  # least cosine between the middle of the view and what is seen: beyond 80 degrees no plane shows it
AIMED = 0.3  # least length of the mean of all directions in plan; less of it, and a scan looks around, up or down
LEAST_POINTS = 10  # that show a window
STRAY = 0.002  # most of the points that may lie beyond NARROW and be errors of the sensor
AT_SENSOR = 0.3  # [m] nearer points tell no direction
LONELY, TRIES = 0.35, 8  # a corner of the window with no other point this near (20 degrees) is an error, too
VIEW_STEP = 0.05  # [m] in which a line is followed to the edge


class View(NamedTuple):
    """A convex window on the upright plane one metre ahead of the sensor."""

    sensor: np.ndarray  # (3,) [m]
    ahead: np.ndarray  # (3,) unit vector, level
    right: np.ndarray  # (3,) unit vector, level
    edges: np.ndarray  # (E, 3) a x + b y + c <= 0 inside, x to the right and y up on that plane


def view_of(points: np.ndarray, sensor: np.ndarray) -> View | None:
    """The window around the points (N, 3) [m] that a sensor (3,) saw, single errors left out.

    None where there is none to tell: a scan of all around, or of more than 160 degrees; one that looks steeply up or
    down; fewer than LEAST_POINTS points, or all in one line.
    """
    offset = points - sensor
    reach = lengths(offset)
    away = offset[reach > AT_SENSOR] / reach[reach > AT_SENSOR, None]
    ahead = away.mean(axis=0) * [1.0, 1.0, 0.0] if len(away) >= LEAST_POINTS else np.zeros(3)
    aimed = float(np.linalg.norm(ahead))
    if aimed < AIMED:
        return None
    ahead = ahead / aimed
    right = np.array([ahead[1], -ahead[0], 0.0])
    depth = away @ ahead
    before = depth > NARROW
    if before.mean() < 1.0 - STRAY:
        return None
    edges = _around(np.stack([away @ right, away[:, 2]], axis=1)[before] / depth[before, None])
    return View(sensor, ahead, right, edges) if edges is not None else None


def _around(places: np.ndarray) -> np.ndarray | None:
    """Edges (E, 3) of the convex hull of places (N, 2); what stands alone at its corners is none of it."""
    for _ in range(TRIES):
        if len(places) < LEAST_POINTS:
            return None
        try:
            hull = ConvexHull(places)
        except QhullError:  # all in one line
            return None
        near = [np.sum(lengths(places - places[corner]) < LONELY) for corner in hull.vertices]
        lonely = hull.vertices[np.array(near) == 1]  # itself
        if not len(lonely):
            break
        places = np.delete(places, lonely, axis=0)
    return hull.equations


def edge_beyond(view: View | None, start: np.ndarray, toward: np.ndarray, heights: np.ndarray, most: float) -> float:
    """How far [m] one may go in plan before fewer than half of the heights are in view.

    Args:
        view: of a scan; None where nobody knows its edges.
        start: (2,) [m] in plan.
        toward: (2,) unit vector.
        heights: (Z,) [m].
        most: [m] that is told, also where all is in view, or no edge is known.
    """
    if view is None:
        return most
    steps = np.arange(0.0, most, VIEW_STEP)
    offset = np.empty((len(steps), len(heights), 3))
    offset[..., :2] = (start - view.sensor[:2] + steps[:, None] * toward)[:, None]
    offset[..., 2] = heights - view.sensor[2]
    depth = offset @ view.ahead
    before = depth > 1e-6
    place = np.stack([offset @ view.right, offset[..., 2]], axis=-1) / np.where(before, depth, 1.0)[..., None]
    inside = before & np.all(place @ view.edges[:, :2].T + view.edges[:, 2] <= 1e-6, axis=-1)
    outside = np.flatnonzero(inside.mean(axis=1) < 0.5)
    return float(steps[outside[0]]) if len(outside) else most
