"""Pairs carry true labels, whatever the batch, the threads or the noise."""

import dataclasses

import numpy as np
import pytest

from warp_scanner.clouds.points import points_of
from warp_scanner.rooms.pairs import PairConfig, make_pairs
from warp_scanner.rooms.scenarios import CONDITIONS, SCENARIOS, make_scenes
from warp_scanner.scenes.scenes import CHAIR, TABLE
from warp_scanner.sensors.pinhole import cast_image
from warp_scanner.sensors.poses import rotation_of
from warp_scanner.sensors.scan import Rays, cast_rays, cast_slots
from warp_scanner.sensors.sensors import Pinhole

COUNT = 12
CASES = [(scenario, condition) for scenario in SCENARIOS for condition in CONDITIONS]


@pytest.fixture(scope="module", params=CASES, ids="-".join)
def case(request):
    config = PairConfig(seed=1, scenario=request.param[0], condition=request.param[1])
    return config, make_pairs(config, np.arange(COUNT)), make_scenes(config.scene, config.seed, np.arange(COUNT))


def leaves(pairs):
    """All arrays of a Pairs, however deep."""
    for field in pairs:
        yield from leaves(field) if isinstance(field, tuple) else [field]


def rays_of(pairs):
    return Rays(pairs.pose.position, pairs.directions, rotation_of(pairs.pose.yaw, pairs.pose.pitch))


def test_labels_are_what_casting_without_the_changed_object_shows(case):
    """A ray hits the changed object exactly when taking that object away changes what the ray meets."""
    config, pairs, scenes = case
    added = config.scenario.endswith("added")
    present, scan, label = (
        (scenes.in_real, pairs.robot, pairs.changed_robot) if added else (scenes.in_prior, pairs.dt, pairs.changed_dt)
    )
    without = cast_image(scenes.primitives, present & (scenes.change == 0), config.sensor, pairs.pose)
    np.testing.assert_array_equal(label, without.distance != scan.distance)
    assert not np.any(pairs.changed_dt if added else pairs.changed_robot)
    assert np.all(label.sum(axis=1) >= (60 if config.condition == "clean" or not added else 0))


def test_scans_show_prior_and_reality(case):
    config, pairs, scenes = case
    for scan, present in ((pairs.dt, scenes.in_prior), (pairs.robot, scenes.in_real)):
        expected = cast_rays(scenes.primitives, present, rays_of(pairs))  # another kernel: edges may differ
        same = (scan.element == expected.element) & (scan.semantic == expected.semantic)
        same &= np.isclose(scan.distance, expected.distance, rtol=0.0, atol=1e-4)
        assert same.mean() > 0.99999
    assert not np.any(np.isin(pairs.dt.semantic, (TABLE, CHAIR)))
    assert np.any(np.isin(pairs.robot.semantic, (TABLE, CHAIR))) == (config.condition == "occluded")


def test_testable_rays_tell_prior_and_reality_apart(case):
    config, pairs, _ = case
    difference = pairs.robot.distance.astype(float) - pairs.dt.distance
    clear = np.abs(np.abs(difference) - config.testable_margin) > 1e-5
    np.testing.assert_array_equal(pairs.testable_dt[clear], (difference > config.testable_margin)[clear])
    np.testing.assert_array_equal(pairs.testable_robot[clear], (-difference > config.testable_margin)[clear])
    # Nothing but a removed object lets the robot see farther than the prior.
    assert not np.any(pairs.testable_dt & ~pairs.changed_dt)
    if config.condition == "clean":
        assert not np.any(pairs.testable_robot & ~pairs.changed_robot)


def test_observable_fraction_counts_testable_rays_of_the_object_alone(case):
    config, pairs, scenes = case
    _, slot = cast_slots(scenes.primitives, scenes.change != 0, rays_of(pairs))
    alone = slot >= 0
    testable = np.where(config.scenario.endswith("added"), pairs.changed_robot & pairs.testable_robot,
                        pairs.changed_dt & pairs.testable_dt)  # fmt: skip
    assert not np.any(testable & ~alone)
    np.testing.assert_allclose(pairs.observable_fraction[:, 0], testable.sum(axis=1) / alone.sum(axis=1), rtol=1e-3)


def test_points_of_changed_rays_lie_on_the_true_box(case):
    _, pairs, _ = case
    for scan, label in ((pairs.dt, pairs.changed_dt), (pairs.robot, pairs.changed_robot)):
        points = points_of(pairs.pose, pairs.directions, scan.distance)
        room, _ = np.nonzero(label)
        offset = np.abs(points[label] - pairs.box.center[room, 0]) - pairs.box.size[room, 0] / 2
        assert np.all(offset < 1e-4)


def test_a_pair_is_the_same_alone_in_any_batch_and_with_any_threads(case):
    config, _, _ = case
    config = dataclasses.replace(config, range_noise=0.01)
    whole = list(leaves(make_pairs(config, np.arange(COUNT), threads=2)))
    again = list(leaves(make_pairs(config, np.array([9, 2, 5, 7, 1]), threads=1)))
    alone = list(leaves(make_pairs(config, np.array([9]), threads=2)))
    for a, b, c in zip(whole, again, alone, strict=True):
        if a is whole[3]:
            np.testing.assert_array_equal(a, b)  # the directions, which all rooms share
        else:
            np.testing.assert_array_equal(a[[9, 2, 5, 7, 1]], b)
            np.testing.assert_array_equal(a[[9]], c)


def test_occluded_scenes_hide_what_clean_ones_show():
    for scenario in SCENARIOS:
        clean, occluded = (
            make_pairs(PairConfig(seed=1, scenario=scenario, condition=condition), np.arange(COUNT)).observable_fraction
            for condition in CONDITIONS
        )
        assert np.all(occluded <= clean) and np.mean(occluded) < np.mean(clean) - 0.02


def test_noise_changes_the_robots_ranges_and_nothing_else():
    quiet = make_pairs(PairConfig(seed=2), np.arange(4))
    noisy = make_pairs(PairConfig(seed=2, range_noise=0.02), np.arange(4))
    error = noisy.robot.distance - quiet.robot.distance
    assert abs(error.std() - 0.02) < 2e-4 and abs(error.mean()) < 2e-4
    restored = noisy._replace(robot=noisy.robot._replace(distance=quiet.robot.distance))
    for a, b in zip(leaves(restored), leaves(quiet), strict=True):
        np.testing.assert_array_equal(a, b)


def test_unchanged_pairs_have_nothing_to_find():
    pairs = make_pairs(PairConfig(scenario="unchanged"), np.arange(6))
    np.testing.assert_array_equal(pairs.dt.distance, pairs.robot.distance)
    assert not np.any(pairs.changed_dt | pairs.changed_robot | pairs.testable_dt | pairs.testable_robot)
    assert pairs.observable_fraction.shape == (6, 0) and pairs.box.center.shape == (6, 0, 3)


def test_points_agree_with_ranges_and_mark_misses():
    pairs = make_pairs(PairConfig(sensor=Pinhole(40, 25)), np.arange(3))
    distance = pairs.dt.distance.copy()
    distance[0, 0] = np.inf
    points = points_of(pairs.pose, pairs.directions, distance)
    assert points.dtype == np.float32 and np.all(np.isnan(points[0, 0])) and np.isnan(points).sum() == 3
    reach = np.linalg.norm(points - pairs.pose.position[:, None], axis=-1)
    np.testing.assert_allclose(reach.ravel()[1:], distance.ravel()[1:], atol=1e-5)


def test_any_sensor_scans_the_same_scene():
    """Resolution does not choose the scene, so a finer sensor sees the same change."""
    coarse, fine = (
        make_pairs(PairConfig(sensor=sensor), np.arange(3)) for sensor in (Pinhole(64, 40), Pinhole(320, 200))
    )
    np.testing.assert_array_equal(coarse.box.center, fine.box.center)
    assert coarse.dt.distance.shape == (3, 64 * 40)


def test_no_rooms_give_no_pairs():
    pairs = make_pairs(PairConfig(), np.zeros(0, int))
    assert pairs.dt.distance.shape == (0, 320 * 200) and pairs.observable_fraction.shape == (0, 1)


@pytest.mark.parametrize("index", [np.array([-1]), np.array([[1]]), np.array([0.5])])
def test_rejects_what_is_not_an_index(index):
    with pytest.raises(ValueError, match="index must be"):
        make_pairs(PairConfig(), index)


@pytest.mark.parametrize(
    "settings",
    [{"seed": -1}, {"scenario": "x"}, {"condition": "x"}, {"range_noise": -1.0}, {"testable_margin": np.nan},
     {"sensor_height": 3.5}],
)  # fmt: skip
def test_rejects_impossible_settings(settings):
    with pytest.raises(ValueError, match=next(iter(settings))):
        PairConfig(**settings)


@pytest.mark.parametrize("seed", [-1, 1.5, 2**63, True, "3"])
def test_seeds_are_whole_numbers_of_63_bits(seed):
    with pytest.raises(ValueError, match="seed must be a whole number"):
        PairConfig(seed=seed)
