"""Each variant takes away what it is called after and nothing else; differences are what rooms and trainings say."""

import dataclasses

import numpy as np
import pytest

from benchmarks.views.imperfect_training import (
    POSE_ERROR,
    SCORED,
    TAUGHT,
    USUAL_RANGE,
    VARIANTS,
    as_table,
    difference,
    with_sensor,
)
from jaxmm.config import CONDITIONS, Config
from jaxmm.data.simulator_settings import CloudSource, pair_config
from warp_scanner.sensors.imperfections import Imperfections
from warp_scanner.sensors.sensors import sensor_named

TAKEN = {  # fields of Imperfections that a variant may change
    "nothing": (), "noise growth": ("noise", "noise_per_metre", "noise_per_square"),
    "noise": ("noise", "noise_per_metre", "noise_per_square", "noise_by_light"), "gross errors": ("gross_chance",),
    "mixed pixels": ("mixed_chance",), "bias": ("dark_bias", "slant_bias"),
    "lost returns": ("grazing_dropout", "class_dropout"), "pose error": (), "furniture": (),
    "all of these": tuple(field.name for field in dataclasses.fields(Imperfections)),
}  # fmt: skip


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("name", SCORED)
def test_a_variant_takes_what_it_is_called_after_and_nothing_else(variant, name):
    erring, pose_error, conditions = VARIANTS[variant]
    before = sensor_named(name).imperfections
    after = erring(before)
    for field in dataclasses.fields(Imperfections):
        if field.name not in TAKEN[variant]:
            assert getattr(after, field.name) == getattr(before, field.name)
    assert (pose_error == POSE_ERROR) == (variant not in ("pose error", "all of these"))
    assert (conditions == CONDITIONS) == (variant != "furniture") and len(conditions) == len(CONDITIONS)
    if variant == "noise":
        assert before.noisy and not after.noisy
    if variant == "noise growth":
        assert after.sigma(np.array([1.0, 9.0])) == pytest.approx(before.sigma(np.full(2, USUAL_RANGE)))
    if variant == "all of these":
        assert after == Imperfections()


@pytest.mark.parametrize("variant", ["gross errors", "mixed pixels", "lost returns", "noise growth", "bias"])
def test_a_variant_changes_a_sensor_that_teaches(variant):
    erring = VARIANTS[variant][0]
    errors = [sensor_named(name).imperfections for name in TAUGHT]
    assert any(erring(one) != one for one in errors)


@pytest.mark.parametrize("name", SCORED)
def test_the_simulator_gets_the_sensor_as_it_is(name):
    config = with_sensor(Config(), sensor_named(name), POSE_ERROR)
    pair = pair_config(config, CloudSource("wall_added", "wall_added", "occluded", 1))
    assert pair.sensor == sensor_named(name)
    assert (pair.position_error, pair.angle_error) == tuple(POSE_ERROR.values())


def test_a_difference_is_told_with_an_interval_over_rooms_and_trainings():
    rng = np.random.default_rng(5)
    rooms = np.repeat(np.arange(30), 2)
    nothing = rng.uniform(0.5, 1.0, (3, 1)) + np.zeros((1, 60))
    mean, low, high = difference(nothing - 0.25, nothing, rooms)
    assert mean == pytest.approx(-0.25) and low < -0.25 < high  # trainings differ, so one side's luck counts
    one = rng.uniform(0.5, 1.0, (1, 60))
    assert difference(one - 0.25, one, rooms) == pytest.approx((-0.25, -0.25, -0.25))  # of one room as of another


def test_clouds_of_one_room_are_no_further_evidence():
    rng = np.random.default_rng(6)
    effect = rng.normal(size=20)
    once = difference(effect[None], np.zeros((1, 20)), np.arange(20))
    often = difference(np.repeat(effect, 9)[None], np.zeros((1, 180)), np.repeat(np.arange(20), 9))
    assert often == pytest.approx(once)


def test_the_table_has_a_row_for_each_variant():
    scores = {name: [{"a": [[1.0, 0.5, 0.25]], "b": [[1.0, 1.0, 1.0]]}] for name in ("nothing", "bias")}
    lines = as_table(scores, {"a": [0], "b": [0]}).splitlines()
    assert len(lines) == 4 and "1.0000/0.500/0.250" in lines[2] and lines[2].count("| -") == 2
    assert "+0.000 (+0.000 to +0.000)" in lines[3]
