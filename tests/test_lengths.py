"""Lengths in words: in a unit that people read, and never a longer word for a shorter length."""

import numpy as np
import pytest

from warp_scanner.lengths import length_in_words

UNITS = {"mm": 1e-3, "m": 1.0, "km": 1e3}


@pytest.mark.parametrize(
    "length, words",
    [
        (0.0, "0 mm"), (0.0042, "4 mm"), (0.0097, "0.01 m"), (0.35, "0.35 m"), (0.999, "1.0 m"), (4.23, "4.2 m"),
        (42.4, "42 m"), (999.4, "999 m"), (999.7, "1.0 km"), (1000.0, "1.0 km"), (4630.0, "4.6 km"),
        (462999.0, "463 km"), (5678901.0, "5,679 km"),
    ],
)  # fmt: skip
def test_lengths_are_told_in_a_unit_that_people_read(length, words):
    assert length_in_words(length) == words


def test_what_is_told_is_the_length_to_a_twentieth_and_the_order_stays():
    lengths = np.sort(10.0 ** np.random.default_rng(3).uniform(-2.0, 7.0, 3000))
    words = [length_in_words(one) for one in lengths]
    told = np.array([float(number.replace(",", "")) * UNITS[unit] for number, unit in map(str.split, words)])
    assert np.all(np.diff(told) >= -1e-9)
    assert np.all(np.abs(told - lengths) <= np.maximum(0.055 * lengths, 0.0051))
    assert all(len(one.split()[0].replace(",", "")) <= 5 for one in words)
