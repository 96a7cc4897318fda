"""Vectors as arrays."""

import numpy as np
import pytest

from jaxmm.vectors import BLOCK, by_blocks, directions, lengths


@pytest.mark.parametrize("columns", [2, 3])
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_lengths_are_those_of_numpy_to_the_last_bit(dtype, columns):
    vectors = (np.random.default_rng(0).normal(size=(100_000, columns)) * [1e-3, 1.0, 1e3][:columns]).astype(dtype)
    found = lengths(vectors)
    assert found.dtype == dtype
    np.testing.assert_array_equal(found, np.linalg.norm(vectors, axis=1))


def test_no_vectors_have_no_lengths_and_what_is_not_known_stays_so():
    assert lengths(np.zeros((0, 3))).shape == (0,)
    assert np.isnan(lengths(np.array([[np.nan, 0.0, 0.0]]))[0]) and np.isinf(lengths(np.array([[np.inf, 0, 0]]))[0])


def test_directions_are_of_unit_length_and_none_is_made_up():
    vectors = np.array([[3.0, 0.0, 4.0], [0.0, 0.0, 0.0], [0.0, -2.0, 0.0]])
    np.testing.assert_allclose(directions(vectors), [[0.6, 0.0, 0.8], [0.0, -1.0, 0.0]], atol=1e-15)
    assert directions(np.zeros((0, 3), np.float32)).dtype == np.float32


@pytest.mark.parametrize("count", [0, 5, BLOCK, BLOCK + 1, 3 * BLOCK - 7])
def test_by_blocks_is_the_function_of_all_rows(count):
    rows, asked = np.random.default_rng(count).normal(size=(count, 3)).astype(np.float32), []

    def products(some):
        asked.append(len(some))
        return some.astype(np.float64) * some[:, :1]

    found = by_blocks(products, rows)
    assert max(asked) <= BLOCK and sum(asked) == count
    np.testing.assert_array_equal(found, products(rows))
    assert found.dtype == np.float64
