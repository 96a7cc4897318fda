"""Clusters of dense points (DBSCAN, Ester et al. 1996), on SciPy alone: scikit-learn takes half a second to import.

N points of D coordinates.
"""

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

NOISE = -1


def density_clusters(points: np.ndarray, radius: float, least: int) -> np.ndarray:
    """Number (N,) of the cluster that each point is of, from 0 in the order of their first dense points; -1 of none.

    Dense is a point with `least` points, itself among them, within `radius`. Dense points within the radius of each
    other are of one cluster; any other point is of the first cluster that has a dense point within its radius.
    """
    first, second = cKDTree(points).query_pairs(radius, output_type="ndarray").T
    count = len(points)
    dense = 1 + np.bincount(first, minlength=count) + np.bincount(second, minlength=count) >= least
    inner = dense[first] & dense[second]
    links = coo_matrix((np.ones(int(inner.sum()), bool), (first[inner], second[inner])), shape=(count, count))
    group = connected_components(links, directed=False)[1]
    _, found, number = np.unique(group[dense], return_index=True, return_inverse=True)
    label = np.full(count, len(found))  # of no cluster yet
    label[dense] = np.argsort(np.argsort(found))[number]
    for near, far in ((first, second), (second, first)):
        edge = dense[near] & ~dense[far]
        np.minimum.at(label, far[edge], label[near[edge]])
    return np.where(label < len(found), label, NOISE)
