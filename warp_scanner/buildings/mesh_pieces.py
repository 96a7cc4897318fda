"""What a mesh is made of when nothing names its parts: connected pieces, and by their shape walls, pillars and floors.

V vertices, T triangles. World frame: metres, z up.
"""

from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from warp_scanner.scenes.scenes import FLOOR, OTHER, PILLAR, WALL

STOREY = 2.1  # [m] what is at least so high may be a wall or a pillar; what is lower, furniture
MOST_THICKNESS = 0.8  # [m] of a wall
MOST_WIDTH = 1.4  # [m] of a pillar, either way
SLENDER = 2.5  # length over thickness from which what is no wider than a pillar is a wall
FLAT = 0.8  # [m] height of a floor, at most
LEAST_SPAN = 2.0  # [m] of a floor, both ways


class MeshPiece(NamedTuple):
    """One connected piece."""

    faces: np.ndarray  # (n, 3) int of the mesh's vertices
    semantic: int  # WALL, PILLAR, FLOOR or OTHER


def pieces_of(vertices: np.ndarray, faces: np.ndarray) -> list[MeshPiece]:
    """The connected pieces of a mesh, in the order of their first triangles.

    Args:
        vertices: (V, 3) finite [m]; equal ones are one corner, as files often repeat them.
        faces: (T, 3) int; two triangles with a common corner are of one piece.
    """
    _, corner = np.unique(vertices + 0.0, axis=0, return_inverse=True)  # 0.0 and -0.0 are one
    corners = corner.reshape(-1)[faces]
    count, ends = int(corners.max()) + 1, (corners[:, [0, 1]].ravel(), corners[:, [1, 2]].ravel())
    _, label = connected_components(
        coo_array((np.ones(len(ends[0]), bool), ends), shape=(count, count)), directed=False
    )
    of_face = label[corners[:, 0]]
    _, first, of_face = np.unique(of_face, return_index=True, return_inverse=True)
    order = np.argsort(first)
    groups = np.split(np.argsort(of_face, kind="stable"), np.cumsum(np.bincount(of_face))[:-1])
    return [MeshPiece(faces[groups[one]], class_of(vertices[np.unique(faces[groups[one]])])) for one in order]


def class_of(vertices: np.ndarray) -> int:
    """What a solid with these corners (n, 3) [m] is, by its height and the smallest rectangle around its plan."""
    height = float(np.ptp(vertices[:, 2]))
    short, long = _plan_edges(vertices[:, :2])
    if height >= STOREY and short <= MOST_THICKNESS and (long > MOST_WIDTH or long > SLENDER * short):
        return WALL
    if height >= STOREY and long <= MOST_WIDTH:
        return PILLAR
    return FLOOR if height <= FLAT and short >= LEAST_SPAN else OTHER


def _plan_edges(places: np.ndarray) -> tuple[float, float]:
    """Shorter and longer edge [m] of the smallest rectangle, turned by any angle, around places (n, 2)."""
    from scipy.spatial import ConvexHull, QhullError  # slow to import, and generated rooms do not need it

    try:
        hull = places[ConvexHull(places).vertices]
    except (QhullError, ValueError):  # all in one line, or too few
        return 0.0, float(np.linalg.norm(np.ptp(places, axis=0)))
    edges = np.roll(hull, -1, axis=0) - hull
    along = edges / np.linalg.norm(edges, axis=1, keepdims=True)
    across = np.stack([-along[:, 1], along[:, 0]], axis=1)
    spans = np.stack([np.ptp(hull @ along.T, axis=0), np.ptp(hull @ across.T, axis=0)], axis=1)
    short, long = np.sort(spans[np.argmin(spans.prod(axis=1))])
    return float(short), float(long)
