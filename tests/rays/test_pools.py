"""Normals of clouds, and which points hang together."""

import numpy as np
import pytest

from jaxmm.rays.pools import JOINT, neighbourhood_of, normals_of, pools_of


def test_normals_are_those_of_planes():
    rng = np.random.default_rng(1)
    for _ in range(50):
        normal = rng.standard_normal(3)
        normal /= np.linalg.norm(normal)
        flat = rng.uniform(-3, 3, (200, 3))
        flat -= np.outer(flat @ normal, normal)
        np.testing.assert_allclose(np.abs(normals_of(flat + rng.standard_normal(3))[0] @ normal), 1.0, atol=1e-6)
    assert normals_of(np.ones((1, 3)))[0].shape == (1, 3)


def sheet(count=20, spacing=0.1):
    """A wall in the plane x = 0, from the origin along y."""
    y, z = np.meshgrid(np.arange(count) * spacing, np.arange(count) * spacing)
    return np.column_stack([np.zeros(y.size), y.ravel(), z.ravel()])


def test_walls_apart_are_pools_of_their_own():
    points = np.concatenate([sheet(), sheet() + np.array([JOINT + 0.2, 0, 0])])
    number = pools_of(neighbourhood_of(points), np.ones(len(points), bool))
    assert set(number[:400]) == {number[0]} and set(number[400:]) == {number[400]} and number[0] != number[400]


def test_walls_that_meet_are_pools_of_their_own():
    other = sheet()[:, [1, 0, 2]] + np.array([0.1, 0, 0])
    points = np.concatenate([sheet(), other])
    number = pools_of(neighbourhood_of(points), np.ones(len(points), bool))
    first, second = np.bincount(number[:400]).argmax(), np.bincount(number[400:]).argmax()
    assert first != second
    far = points[:, :2].max(axis=1) > 0.15  # at the corner itself a point is of either
    assert np.all(number[:400][far[:400]] == first) and np.all(number[400:][far[400:]] == second)


def test_a_round_pillar_is_one_pool():
    angle, z = np.meshgrid(np.linspace(-1.4, 1.4, 18), np.arange(30) * 0.1)
    points = np.column_stack([0.4 * np.cos(angle.ravel()), 0.4 * np.sin(angle.ravel()), z.ravel()])
    assert len(set(pools_of(neighbourhood_of(points), np.ones(len(points), bool)))) == 1


def test_what_is_not_chosen_is_in_no_pool_and_joins_none():
    points = sheet()
    chosen = np.abs(points[:, 1] - 1.0) > 0.15
    number = pools_of(neighbourhood_of(points), chosen)
    assert np.all(number[~chosen] == -1) and len(set(number[chosen])) == 2
    assert np.all(pools_of(neighbourhood_of(points), np.zeros(len(points), bool)) == -1)


def test_a_wall_on_a_floor_is_a_pool_of_its_own():
    floor = sheet()[:, [1, 2, 0]] + np.array([0.05, 0.0, -0.1])
    points = np.concatenate([sheet(), floor])
    number = pools_of(neighbourhood_of(points), np.ones(len(points), bool))
    first, second = np.bincount(number[:400]).argmax(), np.bincount(number[400:]).argmax()
    assert first != second
    assert np.mean(number[:400] == first) > 0.9 and np.mean(number[400:] == second) > 0.9


@pytest.mark.parametrize("radius", [0.12, 0.2, 0.3, 0.6])
def test_pillars_of_any_size_are_in_one_pool_or_two_halves(radius):
    angle, z = np.meshgrid(np.arange(-1.4, 1.4, 0.1 / radius), np.arange(30) * 0.1)
    points = np.column_stack([radius * np.cos(angle.ravel()), radius * np.sin(angle.ravel()), z.ravel()])
    number = pools_of(neighbourhood_of(points), np.ones(len(points), bool))
    assert np.bincount(number).max() >= 0.45 * len(points)
