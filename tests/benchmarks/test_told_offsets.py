"""The table of what offsets are told: medians of the elements of each bin, and a dash where few tell."""

import numpy as np
import pytest

from benchmarks.views.told_offsets import LEAST, share_with_interval, told_table


def test_each_bin_has_the_median_of_its_elements_and_few_have_a_dash():
    near = [{"half": half, "range": 2.5, "coverage": 0.3} for half in (0.001, 0.002, 0.004, 0.008, 0.1)]
    few = [{"half": 0.5, "range": 10.0, "coverage": 0.015}] * (LEAST - 1)
    open_ = [{"half": np.inf, "range": 2.5, "coverage": 0.3}, {"hidden": True}]  # neither tells
    by_range, by_coverage = (line for line in told_table({"tls": [*near, *few, *open_]}) if line.startswith("| `tls`"))
    assert by_range == "| `tls` | - | 4.0 | - | - | - | - |"
    assert by_coverage == "| `tls` | - | - | - | - | 4.0 | - |"


def test_shares_come_with_the_interval_of_wilson():
    """As R's binom.confint(method="wilson") has them."""
    assert share_with_interval(19, 20) == "0.950 (0.76 to 0.99)"
    assert share_with_interval(0, 10) == "0.000 (0.00 to 0.28)" and share_with_interval(0, 0) == "-"


def test_the_figure_is_drawn(tmp_path):
    pytest.importorskip("matplotlib")
    from benchmarks.views.told_offsets import draw_told

    draw_told({"tls": [{"half": 0.01, "range": 3.5, "coverage": 0.2}] * LEAST}, tmp_path / "told.png")
    assert (tmp_path / "told.png").stat().st_size > 1000
