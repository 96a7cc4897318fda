"""Tolerances: the tables of the standards at their steps, and settings."""

import pytest

from jaxmm.config import ConfigError
from jaxmm.deviations.tolerances import BEYOND, OPEN, WITHIN, DeviationSettings, Slope, din_of, loa_of
from jaxmm.verdicts.settings import load_settings


@pytest.mark.parametrize(
    "off, name",
    [(0.0, "LOA50"), (-0.001, "LOA50"), (0.0011, "LOA40"), (0.005, "LOA40"), (0.006, "LOA30"), (-0.016, "LOA20"),
     (0.05, "LOA20"), (0.1, "LOA10"), (0.2, "LOA10")],
)  # fmt: skip
def test_levels_of_accuracy_are_those_of_the_document(off, name):
    assert loa_of(off) == name


@pytest.mark.parametrize(
    "off, half, size, slopes, name",
    [
        (0.011, 0.0, 1.0, [], BEYOND), (0.011, 0.0, 3.0, [], WITHIN),
        (0.011, 0.002, 3.0, [], OPEN), (0.015, 0.0, 6.0, [], WITHIN),
        (-0.019, 0.0, 10.0, [], WITHIN), (0.029, 0.0, 40.0, [], WITHIN),
        (0.0, 0.0, 6.0, [(0.006, 0.0, 3.0)], WITHIN), (0.0, 0.0, 6.0, [(0.009, 0.0, 3.0)], BEYOND),
        (0.0, 0.0, 6.0, [(0.009, 0.002, 3.0)], OPEN), (0.0, 0.0, 6.0, [(0.006, 0.0, 3.0), (0.1, 0.0, 6.0)], BEYOND),
    ],
)  # fmt: skip
def test_din_18202_holds_sizes_and_angles(off, half, size, slopes, name):
    assert din_of(off, half, size, [Slope(*one) for one in slopes]) == name


def test_a_class_may_have_its_own_tolerance(tmp_path):
    settings = DeviationSettings(column=0.01)
    assert (settings.of("column"), settings.of("wall"), settings.of("")) == (0.01, 0.03, 0.03)
    file = tmp_path / "strict.toml"
    file.write_text("[deviations]\ntolerance = 0.02\nslab = 0.015\n")
    assert load_settings(file).deviations.of("slab") == 0.015


@pytest.mark.parametrize("line, word", [
    ("wall = -0.01", "-0.01"), ("stair = 0.01", "stair"), ("most = 2.0", "2.0"),
    ("wall = 0.2\nmost = 0.1", "wall: expected a tolerance up to most, which is 0.1 m, got 0.2"),
    ("most = 0.02", "tolerance: expected a tolerance up to most, which is 0.02 m, got 0.03"),
])  # fmt: skip
def test_tolerances_that_are_none_are_refused_in_one_line(tmp_path, line, word):
    file = tmp_path / "wrong.toml"
    file.write_text(f"[deviations]\n{line}\n")
    with pytest.raises(ConfigError) as error:
        load_settings(file)
    assert word in str(error.value) and "\n" not in str(error.value)
