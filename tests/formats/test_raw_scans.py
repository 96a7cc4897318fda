"""What all readers share: which points count, and blocks that are made ahead."""

import threading

import numpy as np
import pytest

from jaxmm.formats.raw_scans import BLOCK, ahead, nearer, returned


@pytest.mark.parametrize("odd", [np.nan, np.inf, -np.inf, 2e3, -2e3])
def test_points_count_where_all_their_coordinates_are_near(odd):
    points = np.random.default_rng(0).uniform(-999.0, 999.0, (BLOCK + 1000, 3))
    assert nearer(points, 1e3).all()
    points[[3, BLOCK + 7], [0, 2]] = odd
    np.testing.assert_array_equal(np.flatnonzero(~nearer(points, 1e3)), [3, BLOCK + 7])


def test_only_what_is_at_zero_on_every_axis_came_back_from_nowhere():
    points = np.array([[0, 0, 0], [0, 0, 1], [0, 1, 0], [1, 0, 0], [-0.0, 0, 0], [np.nan, 0, 0], [0, np.nan, 0]], float)
    kept, told = returned(points.copy())
    np.testing.assert_array_equal(kept, points[[1, 2, 3, 5, 6]])
    assert told[0].startswith("2 of 7 points are at 0, 0, 0")
    assert returned(points[:4])[1] == ()  # one may be measured there


def test_blocks_that_are_made_ahead_are_the_same_and_the_next_is_made_meanwhile():
    made = [threading.Event() for _ in range(4)]

    def blocks():
        for number, one in enumerate(made):
            one.set()
            yield number

    found = []
    for number in ahead(blocks()):
        assert number == len(made) - 1 or made[number + 1].wait(10.0)
        found.append(number)
    assert found == [0, 1, 2, 3]


def test_an_error_comes_where_the_block_would_have():
    def blocks():
        yield 1
        raise ValueError("cut off")

    found = ahead(blocks())
    assert next(found) == 1
    with pytest.raises(ValueError, match="cut off"):
        next(found)
