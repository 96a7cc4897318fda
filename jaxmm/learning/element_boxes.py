"""Upright boxes around the elements of a building: where each has its place, in six numbers and an angle.

V vertices, T triangles. Any frame with z up, lengths in metres.
"""

from typing import NamedTuple

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from jaxmm.learning.upright_shapes import rectangle_along

SHORT = 1e-6  # [m] edges of a hull below this have no direction


class UprightBox(NamedTuple):
    """A box that stands upright, turned about the vertical."""

    center: tuple[float, float, float]  # [m]
    dimensions: tuple[float, float, float]  # [m] full edges along its own axes; the first of the two level ones longer
    rotation: float  # [deg] from x to its first axis, counter-clockwise, in [-90, 90)

    def shifted(self, by: np.ndarray) -> "UprightBox":
        """The same box, moved by (3,) [m]."""
        return self._replace(center=tuple(float(value) for value in np.asarray(self.center) + by))

    @property
    def corners(self) -> np.ndarray:
        """(4, 2) [m] of its footprint, counter-clockwise."""
        angle = np.radians(self.rotation)
        along, across = np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])
        length, width = self.dimensions[0] / 2, self.dimensions[1] / 2
        signs = ((1, 1), (-1, 1), (-1, -1), (1, -1))
        return np.array([self.center[:2] + a * length * along + b * width * across for a, b in signs])


def boxes_of(
    vertices: np.ndarray, faces: np.ndarray, element: np.ndarray, wanted: np.ndarray
) -> list[UprightBox | None]:
    """The box of least footprint around each wanted element; None for one without triangles.

    Args:
        vertices: (V, 3) float [m].
        faces: (T, 3) int.
        element: (T,) int.
        wanted: (n,) int numbers of elements.
    """
    order = np.argsort(element, kind="stable")
    first, end = (np.searchsorted(element[order], wanted, side) for side in ("left", "right"))
    return [
        box_around(vertices[np.unique(faces[order[a:b]])].astype(np.float64)) if a < b else None
        for a, b in zip(first, end, strict=True)
    ]


def box_around(points: np.ndarray) -> UprightBox:
    """The upright box of least footprint around points (n >= 1, 3) [m].

    One side of the least rectangle around a convex polygon lies on an edge of that: H. Freeman and R. Shapira,
    "Determining the minimum-area encasing rectangle for an arbitrary closed curve", 1975.
    """
    places, low, high = points[:, :2], float(points[:, 2].min()), float(points[:, 2].max())
    corners = _hull(places)
    edges = np.roll(corners, -1, axis=0) - corners
    length = np.linalg.norm(edges, axis=1)
    directions = edges[length > SHORT] / length[length > SHORT, None]
    if not len(directions):
        directions = np.array([[1.0, 0.0]])
    # Edges of a hull that are nearly one line differ in the last digits; what is as small to a micrometre is the same.
    sizes = [(round(float(np.prod(rectangle_along(corners, way)[1])), 6), *_key(way)) for way in directions]
    along = directions[min(range(len(sizes)), key=lambda row: sizes[row])]
    (x, y), (a, b) = rectangle_along(corners, along)
    angle = float(np.degrees(np.arctan2(along[1], along[0])))
    if a < b:
        a, b, angle = b, a, angle + 90.0
    angle = (angle + 90.0) % 180.0 - 90.0
    return UprightBox((float(x), float(y), (low + high) / 2), (float(a), float(b), high - low), angle)


def _key(way: np.ndarray) -> tuple[float]:
    """Of directions that do as well, the one that is turned least: a square is not turned by rounding."""
    return (round(float(abs((np.degrees(np.arctan2(way[1], way[0])) + 45.0) % 90.0 - 45.0)), 6),)


def _hull(places: np.ndarray) -> np.ndarray:
    """Corners (n, 2) of the convex hull, in order; the ends of places on one line."""
    if len(places) > 2:
        try:
            return places[ConvexHull(places).vertices]
        except QhullError:
            pass
    spread = places - places.mean(axis=0)
    way = np.linalg.svd(spread, full_matrices=False)[2][0]
    along = spread @ way
    return places[[int(along.argmin()), int(along.argmax())]]
