"""Which points of a scan belong together when nobody says so: neighbours on one surface.

N points, K pairs of neighbours. World frame: metres.
"""

from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

JOINT = 0.25  # [m] points closer than this may be of one pool
ALIKE = 0.94  # cosine of the angle between the surfaces of flat neighbours in one pool: of 20 degrees
NEIGHBOURS = 12  # that tell the normal of a point
BENT = 0.04  # share of a neighbourhood's variance across its plane, beyond which a point is at an edge
ON_PLANE = 0.05  # [m] from the plane of a neighbour, within which a point at an edge may lie on it


Surfaces = tuple[np.ndarray, np.ndarray]  # what `normals_of` gives


class Neighbourhood(NamedTuple):
    """How the points of a scan lie to each other."""

    pairs: np.ndarray  # (K, 2) int: neighbours within JOINT
    bent: np.ndarray  # (N,) bool: at an edge, or on something too thin to have faces
    alike: np.ndarray  # (K,) bool: the surfaces of both face the same way
    off: np.ndarray  # (K, 2) float [m] of each of the pair from the plane through the other


def normals_of(points: np.ndarray, tree: cKDTree | None = None) -> Surfaces:
    """Unit normals (N, 3) float64 of the plane through each point's neighbours, sign arbitrary; and how bent it is.

    The latter (N,) is the share of the neighbours' variance that is across their plane: 0 on a wall, 0.07 at its edge.
    `tree` is of the points, where there is one already.
    """
    points = np.asarray(points, np.float64)
    if not len(points):
        return np.zeros((0, 3)), np.zeros(0)
    count = min(NEIGHBOURS, len(points))
    near = points[(tree or cKDTree(points)).query(points, count)[1].reshape(len(points), count)]
    spread = near - near.mean(axis=1, keepdims=True)
    variance, axes = np.linalg.eigh(np.einsum("nki,nkj->nij", spread, spread))
    return axes[:, :, 0], variance[:, 0] / np.maximum(variance.sum(axis=1), 1e-12)


def neighbourhood_of(points: np.ndarray, surfaces: Surfaces | None = None) -> Neighbourhood:
    """The neighbours of all points (N, 3), and how their surfaces lie to each other; `surfaces` if they are known."""
    if not len(points):
        return Neighbourhood(np.zeros((0, 2), np.int64), np.zeros(0, bool), np.zeros(0, bool), np.zeros((0, 2)))
    tree = cKDTree(points)
    normal, bent = surfaces or normals_of(points, tree)
    pairs = tree.query_pairs(JOINT, output_type="ndarray")
    first, second = normal[pairs[:, 0]], normal[pairs[:, 1]]
    between = points[pairs[:, 1]] - points[pairs[:, 0]]
    off = np.abs(np.column_stack([np.einsum("kc,kc->k", between, other) for other in (second, first)]))
    return Neighbourhood(pairs, bent > BENT, np.abs(np.einsum("kc,kc->k", first, second)) > ALIKE, off)


def pools_of(near: Neighbourhood, chosen: np.ndarray) -> np.ndarray:
    """Number (N,) int of the pool of each chosen point, counted from 0; -1 for all other points.

    Flat neighbours that face the same way are of one pool, so of two walls that meet each is its own. A point at an
    edge joins the neighbour on whose plane it lies best; where no neighbour is flat, as on a thin pillar, all join.

    Args:
        near: of all points.
        chosen: (N,) bool.
    """
    number = np.full(len(chosen), -1, np.int64)
    places = np.flatnonzero(chosen)
    if len(places):
        rank = np.cumsum(chosen) - 1
        kept = chosen[near.pairs].all(axis=1)
        links = rank[_links(Neighbourhood(near.pairs[kept], near.bent, near.alike[kept], near.off[kept]))]
        graph = coo_matrix((np.ones(len(links), bool), tuple(links.T)), shape=(len(places),) * 2)
        number[places] = connected_components(graph, directed=False)[1]
    return number


def _links(near: Neighbourhood) -> np.ndarray:
    """Pairs (L, 2) of points that are of one pool."""
    bent = near.bent[near.pairs]
    flat = near.pairs[~bent.any(axis=1) & near.alike]
    side = bent.argmax(axis=1)  # which of a mixed pair is at an edge
    mixed = np.flatnonzero((bent[:, 0] != bent[:, 1]) & (near.off[np.arange(len(bent)), side] < ON_PLANE))
    edge, off = near.pairs[mixed, side[mixed]], near.off[mixed, side[mixed]]
    order = np.lexsort((off, edge))
    best = mixed[order[np.unique(edge[order], return_index=True)[1]]]
    joined = np.zeros(len(near.bent), bool)
    joined[near.pairs[best, side[best]]] = True
    alone = near.pairs[bent.all(axis=1) & ~joined[near.pairs].any(axis=1)]
    return np.concatenate([flat, near.pairs[best], alone])
