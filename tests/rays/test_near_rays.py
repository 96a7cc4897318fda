"""The closest rays are those that scipy's tree of all rays finds, however few are asked for and wherever they lie."""

import numpy as np
import pytest
import small_gicp
from scipy.spatial import cKDTree

from jaxmm.rays import near_rays
from jaxmm.rays.near_rays import nearest_rays, rays_around


def unit(vectors):
    return (vectors / np.linalg.norm(vectors, axis=1, keepdims=True)).astype(np.float32)


@pytest.mark.parametrize("count", [1, 13, 25])
def test_the_closest_rays_are_those_that_scipy_finds(count):
    direction = np.random.default_rng(8).normal(size=(4000, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    chosen = np.arange(0, 4000, 3)
    found = nearest_rays(small_gicp.KdTree(direction), direction[chosen], count)
    assert found.dtype == np.int32 and found.shape == (len(chosen), count)
    expected = cKDTree(direction).query(direction[chosen], count)[1].reshape(len(chosen), count)
    np.testing.assert_array_equal(found, expected)
    np.testing.assert_array_equal(found[:, 0], chosen)


@pytest.mark.parametrize("spread", [0.02, 0.3, 10.0])
@pytest.mark.parametrize("count", [1, 20])
def test_of_few_directions_a_part_of_the_rays_tells_as_much(spread, count):
    """Amid a camera's view, at its edge and beyond it, so that cubes grow; and across the sphere, so that all do."""
    rng = np.random.default_rng(count)
    known = unit(np.array([2.0, 0.0, 0.0]) + rng.uniform(-1.0, 1.0, (30_000, 3)))
    asked = unit(known[rng.choice(len(known))] + spread * rng.normal(size=(200, 3)))
    near, square = rays_around(known, asked, count)
    apart, expected = cKDTree(known.astype(np.float64)).query(asked.astype(np.float64), count)
    np.testing.assert_array_equal(near, expected.reshape(near.shape))
    np.testing.assert_allclose(np.sqrt(square), apart.reshape(near.shape)[:, -1], rtol=1e-6)


def test_only_what_lies_around_is_looked_at():
    known = unit(np.random.default_rng(3).normal(size=(50_000, 3)))
    around = near_rays._beside(known, known[:4].astype(np.float64), 0.02)
    assert 4 <= len(around) < 0.01 * len(known)
    apart = np.linalg.norm(known[:4, None] - known, axis=2).min(axis=0)
    assert np.isin(np.flatnonzero(apart < 0.02), around).all()
