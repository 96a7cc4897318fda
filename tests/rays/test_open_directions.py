"""Directions that nothing holds: by cases that anyone can tell, and of walls at any angle."""

import numpy as np
import pytest

from jaxmm.rays.open_directions import MOST_SIGMA, WORTH, in_words, open_directions

UP = np.array([0.0, 0.0, 1.0])


def wall(angle, count=300, noise=0.0):
    """Points about the eye on a wall 2 m away whose normal has this angle [deg] to x, and their normals."""
    rng = np.random.default_rng(0)
    turn = np.radians(angle)
    normal, along = np.array([np.cos(turn), np.sin(turn), 0.0]), np.array([-np.sin(turn), np.cos(turn), 0.0])
    points = 2.0 * normal + rng.uniform(-1.5, 1.5, (count, 1)) * along + rng.uniform(-1.2, 1.2, (count, 1)) * UP
    turn = turn + noise * rng.normal(size=count)
    normals = np.column_stack([np.cos(turn), np.sin(turn), np.zeros(count)])
    return points, normals * rng.choice([-1.0, 1.0], (count, 1))


def floor(count=400):
    places = np.random.default_rng(1).uniform(-2, 2, (count, 2))
    return np.column_stack([places, np.full(count, -1.4)]), np.tile(UP, (count, 1))


def opened(*surfaces, residual=0.01):
    return open_directions(*(np.concatenate(part) for part in zip(*surfaces, strict=True)), residual)


def test_a_room_is_held_and_parts_of_it_are_not():
    assert opened(wall(0), wall(90), floor()) == ()
    (along,) = opened(wall(90), floor())
    np.testing.assert_allclose(np.abs(along), [1, 0, 0], atol=0.02)  # a corridor along x
    assert opened(floor()) == ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    assert (0.0, 0.0, 1.0) in opened(wall(0), wall(90))
    assert len(open_directions(np.zeros((0, 3)), np.zeros((0, 3)), np.nan)) == 3


@pytest.mark.parametrize("noise", [0.0, 0.03])
@pytest.mark.parametrize("angle", range(0, 180, 7))
def test_one_wall_at_any_angle_leaves_open_what_runs_along_it(angle, noise):
    (along,) = opened(wall(angle, noise=noise), floor())
    normal = np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle)), 0.0])
    assert abs(normal @ along) < np.sin(np.radians(6.0)) and np.isclose(np.linalg.norm(along), 1.0)


@pytest.mark.parametrize("between", range(35, 146, 10))
def test_a_second_wall_that_is_turned_enough_holds_the_rest(between):
    assert opened(wall(20), wall(20 + between), floor()) == ()


def test_few_points_or_such_that_err_hold_less():
    few = int(0.3 / (WORTH * (MOST_SIGMA / 0.01) ** 2))
    (along,) = opened(wall(0), wall(90, count=few), floor())
    np.testing.assert_allclose(np.abs(along), [0, 1, 0], atol=0.05)
    assert opened(wall(0), wall(90), floor(), residual=0.01) == ()
    assert len(opened(wall(0), wall(90), floor(), residual=0.2)) == 3


def test_words():
    assert in_words((0.0, 0.0, 1.0)) == "up and down"
    assert in_words((1.0, 0.0, 0.0)) == in_words((-1.0, 0.0, 0.0)) == "along x"
    assert in_words((0.0, 1.0, 0.0)) == in_words((0.0, -1.0, 0.0)) == "along 90° from x"
