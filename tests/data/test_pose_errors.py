"""The robot is not quite where it is believed to be: what was seen is true of where it stood."""

import dataclasses

import numpy as np
import pytest

from jaxmm.data.pose_errors import localised
from warp_scanner.rooms.pairs import PRESETS, PairConfig, make_pairs
from warp_scanner.rooms.scenarios import make_scenes
from warp_scanner.sensors.pinhole import cast_image
from warp_scanner.sensors.sense import cast
from warp_scanner.sensors.sensors import Pinhole

INDEX = np.arange(8)
CONFIG = PairConfig(seed=3, scenario="all_four", condition="occluded", sensor=Pinhole(160, 100))
ERRING = dataclasses.replace(CONFIG, position_error=0.05, angle_error=1.0)
LOST = dataclasses.replace(PRESETS["varied"], sensor=Pinhole(160, 100), position_error=0.05, angle_error=1.0, seed=6)


@pytest.fixture(scope="module")
def erring():
    return make_pairs(ERRING, INDEX), make_scenes(ERRING.scene, ERRING.seed, INDEX)


def test_the_robot_scans_from_its_true_pose_and_the_dt_from_the_assumed(erring):
    pairs, scenes = erring
    for pose, present, scan in (
        (pairs.pose, scenes.in_prior, pairs.dt),
        (pairs.true_pose, scenes.in_real, pairs.robot),
    ):
        expected = cast_image(scenes.primitives, present, ERRING.sensor, pose)
        np.testing.assert_array_equal(scan.distance, expected.distance)
    np.testing.assert_array_equal(pairs.pose.position, scenes.pose.position)
    shift = np.linalg.norm(pairs.true_pose.position - pairs.pose.position, axis=1)
    assert shift.min() > 0.005 and shift.max() < 0.27
    assert np.abs(pairs.true_pose.yaw - pairs.pose.yaw).max() > 0.5


def test_testable_points_differ_from_reality_and_prior_as_seen_from_the_true_place(erring):
    """A DT point of an unchanged element is never testable: from wherever seen, it stands there still."""
    pairs, scenes = erring
    assert not np.any(pairs.testable_dt & ~pairs.changed_dt)
    prior = cast_image(scenes.primitives, scenes.in_prior, ERRING.sensor, pairs.true_pose).distance
    np.testing.assert_array_equal(pairs.testable_robot, pairs.robot.distance + np.float32(0.1) < prior)
    assert pairs.testable_dt.sum() > 1_000 and pairs.testable_robot.sum() > 1_000


def test_a_tiny_error_changes_hardly_anything():
    exact = make_pairs(CONFIG, INDEX)
    tiny = make_pairs(dataclasses.replace(CONFIG, position_error=1e-6), INDEX)
    for name in ("changed_robot", "testable_dt", "testable_robot"):
        assert np.mean(getattr(exact, name) != getattr(tiny, name)) < 1e-3
    np.testing.assert_array_equal(exact.dt.distance, tiny.dt.distance)
    np.testing.assert_allclose(exact.observable_fraction, tiny.observable_fraction, atol=0.02)


def test_each_object_has_its_own_observable_fraction(erring):
    pairs, _ = erring
    assert pairs.observable_fraction.shape == (8, 4) and np.ptp(pairs.observable_fraction) > 0.1
    assert np.all((pairs.observable_fraction >= 0) & (pairs.observable_fraction <= 1.01))
    exact = make_pairs(CONFIG, INDEX)
    assert np.array_equal(exact.true_pose.position, exact.pose.position)
    for part in range(4):
        ours = exact.box.element[:, part, None]
        seen = np.sum((exact.dt.element == ours) & exact.testable_dt, axis=1)
        seen += np.sum((exact.robot.element == ours) & exact.testable_robot, axis=1)
        assert np.array_equal(seen > 0, exact.observable_fraction[:, part] > 0)


def test_an_erring_pair_is_the_same_alone(erring):
    pairs, _ = erring
    alone = make_pairs(ERRING, np.array([5]), threads=1)
    np.testing.assert_array_equal(alone.true_pose.position, pairs.true_pose.position[[5]])
    np.testing.assert_array_equal(alone.testable_dt, pairs.testable_dt[[5]])
    np.testing.assert_array_equal(alone.observable_fraction, pairs.observable_fraction[[5]])


def test_the_varied_preset_makes_pairs_of_any_size():
    pairs = make_pairs(dataclasses.replace(PRESETS["varied"], scenario="wall_removed", condition="occluded"), INDEX)
    assert np.ptp(pairs.size[:, 0]) > 5 and np.ptp(pairs.pose.pitch) > 5
    assert np.all(pairs.observable_fraction > 0) and np.all(pairs.changed_dt.sum(axis=1) >= 60)


@pytest.mark.parametrize("settings", [{"position_error": -1.0}, {"angle_error": np.nan}, {"sensor_pitch_spread": 80.0},
                                      {"sensor_height_spread": 1.5, "sensor_height": 1.0}])  # fmt: skip
def test_rejects_impossible_errors(settings):
    with pytest.raises(ValueError, match=next(iter(settings)).removesuffix("_spread")):
        PairConfig(**settings)


def test_registration_takes_the_robot_to_where_it_stands():
    """What fits is where the robot believes to be, and the truth about every ray is told from there."""
    config = dataclasses.replace(
        PRESETS["varied"],
        scenario="wall_removed",
        sensor=Pinhole(160, 100),
        position_error=0.05,
        angle_error=1.0,
        seed=6,
    )
    before, after = make_pairs(config, np.arange(12)), make_pairs(config, np.arange(12), localise=localised)
    apart = [np.linalg.norm(pairs.pose.position - pairs.true_pose.position, axis=1) for pairs in (before, after)]
    turned = [np.abs(pairs.pose.yaw - pairs.true_pose.yaw) for pairs in (before, after)]
    assert np.median(apart[1]) < 0.2 * np.median(apart[0]) and np.median(turned[1]) < 0.2 * np.median(turned[0])
    np.testing.assert_array_equal(before.robot.distance, after.robot.distance)
    np.testing.assert_array_equal(before.true_pose.position, after.true_pose.position)
    again = cast(after.prior, None, config.sensor, after.pose)
    there = np.isfinite(after.dt.distance)
    np.testing.assert_array_equal(again.distance[there], after.dt.distance[there])
    # Judged from the true place, what is testable hardly depends on where the robot believes to be.
    share = [pairs.testable_dt.mean() for pairs in (before, after)]
    assert abs(share[0] - share[1]) < 0.02


def test_registration_is_a_function_of_each_room():
    config = dataclasses.replace(
        PRESETS["varied"],
        scenario="pillar_added",
        sensor=Pinhole(160, 100),
        position_error=0.05,
        angle_error=1.0,
        seed=6,
    )
    alone, among = (make_pairs(config, np.arange(*span), localise=localised) for span in ((3, 4), (0, 8)))
    np.testing.assert_array_equal(alone.pose.position[0], among.pose.position[3])
    np.testing.assert_array_equal(alone.testable_robot[0], among.testable_robot[3])
