"""Directions that nothing holds: by cases that anyone can tell, and of walls at any angle."""

import numpy as np
import pytest

from jaxmm.rays.open_directions import LEAST_HOLDING, in_words, open_directions

UP = np.array([0.0, 0.0, 1.0])


def wall(angle, count=200, noise=0.0, rng=None):
    """Normals of a wall whose normal has this angle [deg] to x, either sign, with some noise [rad]."""
    rng = rng or np.random.default_rng(0)
    turn = np.radians(angle) + noise * rng.normal(size=count)
    flat = np.column_stack([np.cos(turn), np.sin(turn), np.zeros(count)])
    return flat * rng.choice([-1.0, 1.0], (count, 1))


def floor(count=200):
    return np.tile(UP, (count, 1))


def test_a_room_is_held_and_parts_of_it_are_not():
    room = np.concatenate([wall(0), wall(90), floor()])
    assert open_directions(room) == ()
    (along,) = open_directions(np.concatenate([wall(90), floor()]))
    np.testing.assert_allclose(np.abs(along), [1, 0, 0], atol=1e-9)  # a corridor along x
    assert open_directions(floor()) == ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    assert (0.0, 0.0, 1.0) in open_directions(np.concatenate([wall(0), wall(90)]))
    assert len(open_directions(np.zeros((0, 3)))) == 3


@pytest.mark.parametrize("noise", [0.0, 0.05])
@pytest.mark.parametrize("angle", range(0, 180, 7))
def test_one_wall_at_any_angle_leaves_open_what_runs_along_it(angle, noise):
    (along,) = open_directions(np.concatenate([wall(angle, noise=noise), floor()]))
    normal = np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle)), 0.0])
    assert abs(normal @ along) < np.sin(np.radians(6.0)) and np.isclose(np.linalg.norm(along), 1.0)


@pytest.mark.parametrize("between", range(35, 146, 10))
def test_a_second_wall_that_is_turned_enough_holds_the_rest(between):
    two = np.concatenate([wall(20), wall(20 + between, count=LEAST_HOLDING), floor()])
    assert open_directions(two) == ()


def test_fewer_points_than_hold_leave_it_open():
    few = np.concatenate([wall(0), wall(90, count=LEAST_HOLDING - 1), floor()])
    (along,) = open_directions(few)
    np.testing.assert_allclose(np.abs(along), [0, 1, 0], atol=0.05)


def test_words():
    assert in_words((0.0, 0.0, 1.0)) == "up and down"
    assert in_words((1.0, 0.0, 0.0)) == in_words((-1.0, 0.0, 0.0)) == "along x"
    assert in_words((0.0, 1.0, 0.0)) == in_words((0.0, -1.0, 0.0)) == "along 90° from x"
