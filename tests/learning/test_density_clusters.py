"""Clusters are those of scikit-learn's DBSCAN, number by number."""

import numpy as np
import pytest
from sklearn.cluster import DBSCAN

from jaxmm.learning.density_clusters import density_clusters


@pytest.mark.parametrize("seed", range(60))
def test_clusters_are_those_of_scikit_learn(seed):
    rng = np.random.default_rng(seed)
    points = rng.uniform(0.0, rng.uniform(0.5, 6.0), (rng.integers(1, 1500), rng.integers(1, 4)))
    points = points.astype(np.float32) if seed % 2 else np.round(points, 1) if seed % 3 else points  # many ties
    radius, least = rng.uniform(0.05, 0.4), int(rng.integers(1, 12))
    expected = DBSCAN(eps=radius, min_samples=least).fit_predict(points)
    np.testing.assert_array_equal(density_clusters(points, radius, least), expected)


def test_a_point_between_two_clusters_is_of_the_first():
    line = np.array([0.0, 0.1, 0.2, 0.6, 0.4, 0.8, 0.9, 1.0])[:, None]
    label = density_clusters(line, 0.21, 4)
    np.testing.assert_array_equal(label, DBSCAN(eps=0.21, min_samples=4).fit_predict(line))
    assert len(density_clusters(np.zeros((0, 3)), 1.0, 1)) == 0
