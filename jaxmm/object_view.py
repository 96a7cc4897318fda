"""The window that a scan looks through, as its own points show it: what lies beyond its edge was never looked at.

N points of one scan. World frame: metres, z up. Plan: x and y.
"""

from typing import NamedTuple

import numpy as np
from scipy.spatial import ConvexHull, QhullError

NARROW = (
    0.17  # least cosine between a line of sight and the middle of the view; what sees more has no edges to speak of
)
AIMED = 0.3  # least length of the mean of all directions in plan, below which a scan looks around, not ahead
STEP = 0.05  # [m] in which a line is followed to the edge
LEAST_POINTS = 10  # that show a window


class View(NamedTuple):
    """A convex window on the upright plane one metre ahead of the sensor."""

    sensor: np.ndarray  # (3,) [m]
    ahead: np.ndarray  # (3,) unit vector, level
    right: np.ndarray  # (3,) unit vector, level
    edges: np.ndarray  # (E, 3) a x + b y + c <= 0 inside, x to the right and y up on that plane


def view_of(points: np.ndarray, sensor: np.ndarray) -> View | None:
    """The window around all points (N, 3) [m] that a sensor (3,) saw; None where it looks all around."""
    offset = points - sensor
    away = offset / np.maximum(np.linalg.norm(offset, axis=1), 1e-9)[:, None]
    ahead = away.mean(axis=0) * [1.0, 1.0, 0.0] if len(away) >= LEAST_POINTS else np.zeros(3)
    aimed = float(np.linalg.norm(ahead))
    if aimed < AIMED:
        return None
    ahead = ahead / aimed
    right = np.array([ahead[1], -ahead[0], 0.0])
    depth = away @ ahead
    if np.any(depth <= NARROW):
        return None
    try:
        hull = ConvexHull(np.stack([away @ right, away[:, 2]], axis=1) / depth[:, None])
    except QhullError:  # all in one line
        return None
    return View(sensor, ahead, right, hull.equations)


def edge_beyond(view: View | None, start: np.ndarray, toward: np.ndarray, heights: np.ndarray, most: float) -> float:
    """How far [m] one may go in plan before half of the heights are out of view.

    Args:
        view: of a scan; None where it looks all around.
        start: (2,) [m] in plan.
        toward: (2,) unit vector.
        heights: (Z,) [m].
        most: [m] that is told, also where all is in view.
    """
    if view is None:
        return most
    steps = np.arange(0.0, most, STEP)
    offset = np.empty((len(steps), len(heights), 3))
    offset[..., :2] = (start - view.sensor[:2] + steps[:, None] * toward)[:, None]
    offset[..., 2] = heights - view.sensor[2]
    depth = offset @ view.ahead
    before = depth > 1e-6
    place = np.stack([offset @ view.right, offset[..., 2]], axis=-1) / np.where(before, depth, 1.0)[..., None]
    inside = before & np.all(place @ view.edges[:, :2].T + view.edges[:, 2] <= 1e-6, axis=-1)
    outside = np.flatnonzero(inside.mean(axis=1) < 0.5)
    return float(steps[outside[0]]) if len(outside) else most
