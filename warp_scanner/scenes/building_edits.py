"""Buildings made of others: without some elements, with one moved, or with more triangles."""

import itertools

import numpy as np

from warp_scanner.scenes.building import Building, Elements, Triangles


def without(building: Building, rows: np.ndarray) -> Building:
    """A building as a model that misses some elements (n,): those behind them move up in the table."""
    stays = np.ones(len(building.elements.guid), bool)
    stays[rows] = False
    table = Elements(*(
        tuple(itertools.compress(column, stays)) if isinstance(column, tuple) else column[stays]
        for column in building.elements
    ))  # fmt: skip
    vertices, faces, element, semantic = building.triangles
    left = stays[element]
    element = (np.cumsum(stays) - 1)[element[left]].astype(np.int32)
    triangles, clear = Triangles(vertices, faces[left], element, semantic[stays]), building.clear
    return building._replace(elements=table, triangles=triangles, clear=None if clear is None else clear[left])


def move_element(
    triangles: Triangles, row: int, step: np.ndarray, turn: np.ndarray, about: np.ndarray | None = None
) -> Triangles:
    """The triangles with one element moved; corners that others share with it stay theirs.

    Args:
        triangles: of all elements.
        row: of the element.
        step: (3,) [m].
        turn: (3,) [rad] rotation vector.
        about: (3,) [m] what it turns about; None: the middle of what it fills.
    """
    from scipy.spatial.transform import Rotation  # slow to import

    own = triangles.element == row
    used, place = np.unique(triangles.faces[own], return_inverse=True)
    corners = triangles.vertices[used].astype(np.float64)
    middle = (corners.min(axis=0) + corners.max(axis=0)) / 2.0 if about is None else about
    corners = Rotation.from_rotvec(turn).apply(corners - middle) + middle + step
    faces = triangles.faces.copy()
    faces[own] = len(triangles.vertices) + place.reshape(-1, 3)
    return triangles._replace(vertices=np.concatenate([triangles.vertices, corners.astype(np.float32)]), faces=faces)


def join(first: Triangles, second: Triangles) -> Triangles:
    """Two sets of triangles in one; the elements of the second come after those of the first."""
    return Triangles(
        np.concatenate([first.vertices, second.vertices]),
        np.concatenate([first.faces, second.faces + np.int32(len(first.vertices))]),
        np.concatenate([first.element, second.element + np.int32(len(first.semantic))]),
        np.concatenate([first.semantic, second.semantic]),
    )
