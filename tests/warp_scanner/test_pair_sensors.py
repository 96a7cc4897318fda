"""Pairs by any sensor: what it cannot reach or loses is a miss, and the truth stays that of the geometry."""

import dataclasses

import numpy as np
import pytest

from warp_scanner.rooms.pairs import PRESETS, PairConfig, make_pairs
from warp_scanner.rooms.scenarios import make_scenes
from warp_scanner.scenes import scenes
from warp_scanner.sensors.imperfections import Imperfections
from warp_scanner.sensors.scan import cast_rays
from warp_scanner.sensors.sense import cast, rays_of
from warp_scanner.sensors.sensors import OAK_D_PRO_SMALL, OUSTER_64, TLS, VELODYNE_16, Spinning, sensor_named

SPINNING = {
    "velodyne": VELODYNE_16.resampled(180, 16),
    "ouster": OUSTER_64.resampled(128, 64),
    "tls": TLS.resampled(180, 75),
    "one channel": Spinning(360, 1, (-2.0, -2.0)),
    "half a turn": Spinning(180, 8, (-10.0, 10.0), azimuth_range=(-20.0, 160.0)),
}
SMALL = OAK_D_PRO_SMALL.resampled(40, 25)
COUNT = 6


@pytest.mark.parametrize("name", SPINNING)
@pytest.mark.parametrize("scenario", ["pillar_removed", "all_four"])
def test_spinning_sensors_see_what_their_rays_meet(name, scenario):
    config = PairConfig(seed=3, scenario=scenario, condition="occluded", sensor=SPINNING[name])
    pairs, made = make_pairs(config, np.arange(COUNT)), make_scenes(config.scene, config.seed, np.arange(COUNT))
    assert pairs.dt.distance.shape == (COUNT, len(config.sensor.directions()))
    low, high = config.sensor.range_limits
    for scan, present in ((pairs.dt, made.in_prior), (pairs.robot, made.in_real)):
        expected = cast_rays(made.primitives, present, rays_of(config.sensor, pairs.pose))
        reached = (expected.distance >= low) & (expected.distance <= high)
        np.testing.assert_array_equal(scan.distance, np.where(reached, expected.distance, np.inf))
        np.testing.assert_array_equal(scan.element, np.where(reached, expected.element, -1))
    # Whatever the sensor, a change is in its view: seen densely, each changed object meets the promised rays.
    grid = cast_rays(made.primitives, scenes.is_structure(made.primitives), rays_of(config.scene.grid, pairs.pose))
    for part in range(made.box.element.shape[1]):
        hits = (grid.element == made.box.element[:, part, None]).sum(axis=1)
        assert np.all((hits >= config.scene.least_rays) | (made.box.change[:, part] == 0))


@pytest.mark.parametrize("scenario", ["pillar_removed", "pillar_added"])
def test_out_of_reach_is_a_miss_and_tests_nothing(scenario):
    config = PairConfig(seed=2, scenario=scenario, sensor=short_of(5.0))
    index = np.arange(40)
    pairs, made = make_pairs(config, index), make_scenes(config.scene, config.seed, index)
    dt, robot = (cast(made.primitives, here, config.sensor, made.pose) for here in (made.in_prior, made.in_real))
    for found, endless in ((pairs.dt, dt), (pairs.robot, robot)):
        reached = endless.distance <= 5.0
        np.testing.assert_array_equal(found.distance, np.where(reached, endless.distance, np.inf))
        np.testing.assert_array_equal(found.element, np.where(reached, endless.element, -1))
        np.testing.assert_array_equal(found.semantic, np.where(reached, endless.semantic, 0))
    near = (dt.distance <= 5.0) & (robot.distance <= 5.0)
    np.testing.assert_array_equal(pairs.testable_dt, near & (dt.distance + np.float32(0.1) < robot.distance))
    # What is added within reach is told apart from a prior however far away.
    before = robot.distance + np.float32(0.1) < dt.distance
    np.testing.assert_array_equal(pairs.testable_robot, before & (robot.distance <= 5.0))
    if scenario == "pillar_removed":
        assert np.any(pairs.testable_dt) and np.any((dt.distance <= 5.0) & (robot.distance > 5.1))
    else:
        assert np.any(pairs.testable_robot & (dt.distance > 5.0))
    # And every change is within reach of enough rays.
    changed = pairs.changed_dt | pairs.changed_robot
    assert np.all(changed.sum(axis=1) >= 50)


def short_of(reach):
    return dataclasses.replace(OAK_D_PRO_SMALL, range_limits=(0.2, reach))


def test_reach_is_kept_with_a_pose_error_too():
    config = PairConfig(seed=2, scenario="pillar_removed", position_error=0.05, angle_error=0.5, sensor=short_of(4.0))
    pairs = make_pairs(config, np.arange(20))
    assert np.nanmax(np.where(np.isfinite(pairs.robot.distance), pairs.robot.distance, np.nan)) <= 4.0
    # A robot within 4 m of everything it returns cannot test what is 4.1 m away and more.
    offset = pairs.true_pose.position - pairs.pose.position
    far = pairs.dt.distance > 4.0 - 0.1 + np.linalg.norm(offset, axis=1, keepdims=True)
    assert not np.any(pairs.testable_dt & far) and np.any(pairs.testable_dt)


@pytest.mark.parametrize("name", ["oak-d-pro-small-real", "velodyne-16-real"])
def test_only_the_robot_scan_errs(name):
    sensor = sensor_named(name)
    ideal = dataclasses.replace(sensor, imperfections=Imperfections())
    config = PairConfig(seed=5, scenario="wall_removed", condition="occluded", sensor=sensor)
    index = np.arange(4)
    real, clean = make_pairs(config, index), make_pairs(dataclasses.replace(config, sensor=ideal), index)
    for field in ("dt", "changed_dt", "changed_robot", "testable_dt", "testable_robot", "observable_fraction"):
        for a, b in zip(np.atleast_1d(getattr(real, field)), np.atleast_1d(getattr(clean, field)), strict=True):
            np.testing.assert_array_equal(a, b)
    lost = np.isinf(real.robot.distance) & np.isfinite(clean.robot.distance)
    kept = np.isfinite(real.robot.distance)
    assert 0.0 < lost.mean() < 0.2
    np.testing.assert_array_equal(real.robot.element[kept], clean.robot.element[kept])
    error = real.robot.distance[kept] - clean.robot.distance[kept]
    sigma = sensor.imperfections.sigma(clean.robot.distance[kept])
    # Mixed pixels apart, errors are as large as the sensor says.
    assert 0.9 < np.median(np.abs(error / sigma)) / 0.6745 < 1.1


def test_noise_of_the_pair_comes_on_top_of_the_sensors_own():
    sensor = dataclasses.replace(OAK_D_PRO_SMALL, imperfections=Imperfections(noise=0.03))
    config = PairConfig(sensor=sensor, range_noise=0.04)
    noisy, clean = make_pairs(config, np.arange(2)), make_pairs(PairConfig(), np.arange(2))
    error = (noisy.robot.distance - clean.robot.distance)[np.isfinite(clean.robot.distance)]
    assert np.std(error) == pytest.approx(0.05, rel=0.02)


def test_the_presets_make_pairs_of_every_kind():
    for name, preset in PRESETS.items():
        for scenario in ("walls_removed", "pillar_moved", "unchanged"):
            config = dataclasses.replace(preset, scenario=scenario, condition="occluded", position_error=0.01)
            pairs = make_pairs(config, np.arange(3))
            assert np.isfinite(pairs.dt.distance).all(), name


def test_rooms_draw_their_own_noise_and_whether_they_err_at_all():
    index = np.arange(60)
    clean = make_pairs(PairConfig(sensor=SMALL), index)
    config = PairConfig(sensor=SMALL, range_noise=0.05, range_noise_spread=0.05)
    noisy = make_pairs(config, index)
    returned = np.isfinite(noisy.robot.distance)
    error = np.where(returned, noisy.robot.distance, np.nan) - np.where(returned, clean.robot.distance, np.nan)
    sigma = np.nanstd(error, axis=1)
    assert sigma.min() < 0.015 and sigma.max() > 0.08 and 0.04 < sigma.mean() < 0.06
    some = make_pairs(dataclasses.replace(config, erring_share=0.3, position_error=0.05, range_noise_spread=0.0), index)
    moved = np.any(some.true_pose.position != some.pose.position, axis=1)
    assert 0.15 < moved.mean() < 0.45
    # A room is the same whatever the others of its call.
    alone = make_pairs(config, index[7:8])
    np.testing.assert_array_equal(alone.robot.distance[0], noisy.robot.distance[7])
    for name, value in (("erring_share", 1.5), ("range_noise_spread", -0.1)):
        with pytest.raises(ValueError, match=name):
            PairConfig(**{name: value})
