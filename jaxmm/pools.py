"""Which points of a scan belong together when nobody says so: neighbours that face the same way.

N points. World frame: metres.
"""

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

JOINT = 0.25  # [m] points closer than this may be of one pool
ALIKE = 0.94  # cosine of the angle between the surfaces of neighbours in one pool: of 20 degrees
NEIGHBOURS = 12  # that tell the normal of a point


def normals_of(points: np.ndarray) -> np.ndarray:
    """Unit normals (N, 3) float64 of the plane through each point's neighbours; sign arbitrary."""
    points = np.asarray(points, np.float64)
    if not len(points):
        return np.zeros((0, 3))
    count = min(NEIGHBOURS, len(points))
    near = points[cKDTree(points).query(points, count)[1].reshape(len(points), count)]
    spread = near - near.mean(axis=1, keepdims=True)
    _, axes = np.linalg.eigh(np.einsum("nki,nkj->nij", spread, spread))
    return axes[:, :, 0]


def links_of(points: np.ndarray) -> np.ndarray:
    """Pairs (K, 2) of indices: neighbours within JOINT whose surfaces are alike."""
    if not len(points):
        return np.zeros((0, 2), np.int64)
    normal, pairs = normals_of(points), cKDTree(points).query_pairs(JOINT, output_type="ndarray")
    alike = np.abs(np.einsum("kc,kc->k", normal[pairs[:, 0]], normal[pairs[:, 1]])) > ALIKE
    return pairs[alike]


def pools_of(links: np.ndarray, chosen: np.ndarray) -> np.ndarray:
    """Number (N,) int of the pool of each chosen point, counted from 0; -1 for all other points.

    A pool is what hangs together by links between chosen points: of two walls that meet, each is its own.

    Args:
        links: (K, 2), from `links_of` all points.
        chosen: (N,) bool.
    """
    number = np.full(len(chosen), -1, np.int64)
    places = np.flatnonzero(chosen)
    if len(places):
        rank = np.cumsum(chosen) - 1
        pairs = rank[links[chosen[links].all(axis=1)]]
        graph = coo_matrix((np.ones(len(pairs), bool), tuple(pairs.T)), shape=(len(places),) * 2)
        number[places] = connected_components(graph, directed=False)[1]
    return number
