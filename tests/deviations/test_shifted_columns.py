"""What is found about columns by rough cells is what comparing every number finds."""

import numpy as np
import pytest

from jaxmm.deviations.shifted_columns import _Cells


@pytest.mark.parametrize("spread", [1e-9, 0.3, 20.0, 1e6])
def test_between_leaves_none_out(spread):
    rng = np.random.default_rng(0)
    for count in (0, 1, 5, 3000):
        values = (spread * rng.normal(size=count)).astype(np.float32)
        cells = _Cells(values)
        for first, last in np.sort(1.5 * spread * rng.normal(size=(200, 2)), axis=1):
            found = np.sort(cells.between(first, last))
            inside = (values[found] > first) & (values[found] < last)
            assert np.array_equal(found[inside], np.flatnonzero((values > first) & (values < last)))
            if spread == 20.0 and count == 3000:  # and few that are not
                assert np.sum(~inside) <= 10


def test_ends_of_intervals_that_are_values():
    values = np.array([1.0, 2.0, 3.0], np.float32)
    assert {0, 1, 2} >= set(_Cells(values).between(1.0, 3.0)) >= {1}
