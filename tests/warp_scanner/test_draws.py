"""Draws are uniform, independent of one another and of the batch they are made in."""

import numpy as np
import pytest
from scipy import stats

from warp_scanner import draws


@pytest.mark.parametrize("seed", range(5))
def test_draws_are_uniform(seed):
    numbers = draws.uniform(draws.keys(seed, np.arange(500)), "places", 100).ravel()
    assert numbers.min() >= 0.0 and numbers.max() < 1.0
    assert stats.kstest(numbers, "uniform").pvalue > 1e-3


@pytest.mark.parametrize("slot", [0, 1, 37])
def test_one_slot_is_uniform_over_neighbouring_rooms(slot):
    numbers = draws.uniform(draws.keys(7, np.arange(20_000)), "places", 40)[:, slot]
    assert stats.kstest(numbers, "uniform").pvalue > 1e-3


def uncorrelated(a: np.ndarray, b: np.ndarray) -> bool:
    """The correlation is within four standard errors of none."""
    return abs(np.corrcoef(a.ravel(), b.ravel())[0, 1]) < 4.0 / np.sqrt(a.size)


def test_neighbours_of_every_kind_are_uncorrelated():
    index = np.arange(2_000)
    numbers = draws.uniform(draws.keys(3, index), "places", 50)
    assert uncorrelated(numbers[:-1], numbers[1:])  # rooms
    assert uncorrelated(numbers[:, :-1], numbers[:, 1:])  # slots
    assert uncorrelated(numbers[:-1, :-1], numbers[1:, 1:])  # index and slot may not stand for each other
    assert uncorrelated(numbers, draws.uniform(draws.keys(3, index), "place s", 50))  # streams
    assert uncorrelated(numbers, draws.uniform(draws.keys(4, index), "places", 50))  # seeds
    assert uncorrelated(numbers, draws.uniform(draws.keys(3, index, 1), "places", 50))  # attempts
    assert uncorrelated(numbers[1:], draws.uniform(draws.keys(4, index[:-1]), "places", 50))  # seed + 1, index - 1


def test_no_number_repeats():
    numbers = [draws.uniform(draws.keys(seed, np.arange(100), attempt), name, 100)
               for seed in range(3) for attempt in range(3) for name in ("a", "b")]  # fmt: skip
    assert len(np.unique(numbers)) == np.size(numbers)


def test_a_room_draws_the_same_in_any_batch():
    whole = draws.uniform(draws.keys(1, np.arange(100), 5), "x", 17)
    np.testing.assert_array_equal(draws.uniform(draws.keys(1, np.array([42, 7]), 5), "x", 17), whole[[42, 7]])
    np.testing.assert_array_equal(draws.uniform(draws.keys(1, np.arange(100), 5), "x", 9), whole[:, :9])


def test_normal_draws_are_standard_normal():
    numbers = draws.normal(draws.keys(0, np.arange(50)), "noise", 2_001)
    assert numbers.shape == (50, 2_001) and np.all(np.isfinite(numbers))
    assert stats.kstest(numbers.ravel(), "norm").pvalue > 1e-3
    assert uncorrelated(numbers[:, :1_000], numbers[:, 1_000:2_000])


@pytest.mark.parametrize(
    "seed, index, message",
    [
        (-1, np.arange(2), "seed"),
        (0, np.array([-1]), "index"),
        (0, np.array([0.5]), "index"),
        (0, np.array(3), "index"),
    ],
)
def test_rejects_what_is_not_a_counter(seed, index, message):
    with pytest.raises(ValueError, match=message):
        draws.keys(seed, index)
