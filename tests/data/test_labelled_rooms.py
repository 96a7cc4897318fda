"""From rooms to labelled clouds: a pure function of settings, source and room number, with the truth point by point."""

import dataclasses

import numpy as np
import pytest

from jaxmm.config import CONDITIONS, SCENARIOS, UNCHANGED, Config, DataConfig, PreprocessConfig, Table, TrainConfig
from jaxmm.data import labelled_rooms
from jaxmm.data.simulator_settings import CloudSource, pair_config
from jaxmm.learning.batches import LabelledCloud
from jaxmm.learning.metrics import point_metrics
from jaxmm.learning.preprocess import nearest_distance, object_filter, voxel_downsample
from warp_scanner.clouds.points import points_of
from warp_scanner.rooms.pairs import make_pairs
from warp_scanner.scenes.scenes import PILLAR, WALL

CONFIG = Config(scan=Table.of({"width": 160, "height": 100}))
ROOMS = 16


def source(scenario="pillar_removed", condition="clean", scene=None, seed=3):
    return CloudSource(scenario, scene or scenario, condition, seed)


def made(config, where, index):
    return list(labelled_rooms.clouds(config, where, np.asarray(index)))


def assert_same(a, b):
    for name, x, y in zip(LabelledCloud._fields, a, b, strict=True):
        np.testing.assert_array_equal(x, y, err_msg=name)
        assert x.dtype == y.dtype


@pytest.fixture(scope="module")
def rows():
    """The test rooms of every row, noise-free."""
    return {
        (scenario, condition): made(CONFIG, source(scenario, condition), np.arange(ROOMS))
        for scenario in SCENARIOS
        for condition in CONDITIONS
    }


@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_a_cloud_depends_on_settings_source_and_room_and_on_nothing_else(noise):
    config = dataclasses.replace(CONFIG, scan=Table.of(CONFIG.scan.thawed() | {"range_noise": noise}))
    # Settings of other stages, and a neighbour that is another room, must not matter.
    elsewhere = dataclasses.replace(
        config, seed=5, data=DataConfig(test_rooms=3), train=TrainConfig(step_count=7, methods=("nn",))
    )
    where = source("wall_added", "occluded")
    together = made(config, where, [4, 0, 19, 7, 1] + [2] * 13)
    for place, index in enumerate([4, 0, 19, 7]):
        ((cloud, truth),) = made(elsewhere, where, [index])
        assert_same(cloud, together[place][0])
        assert truth.index == index and truth.observable_fraction == together[place][1].observable_fraction
        np.testing.assert_array_equal(truth.box.center, together[place][1].box.center)
    assert len({cloud.points.tobytes() for cloud, _ in together}) == 6
    ((other, _),) = made(config, where._replace(seed=4), [4])
    assert other.points.tobytes() != together[0][0].points.tobytes()


def test_every_point_is_a_return_with_consistent_labels(rows):
    for (scenario, condition), members in rows.items():
        for cloud, truth in members:
            count = len(cloud.points)
            assert [len(field) for field in cloud] == [count] * 7
            assert np.isfinite(cloud.points).all() and np.isfinite(cloud.distance).all() and (cloud.element >= 0).all()
            assert not (cloud.heuristic & (cloud.distance <= 0.09)).any()
            assert len(np.unique(np.floor(cloud.points / 0.1 + 0.5), axis=0)) == count  # one a voxel
            assert 0 <= truth.observable_fraction <= 1 and truth.box.object_type == scenario.split("_")[0]
            if condition == "clean":  # no furniture, no cluster filter: the label is the distance
                np.testing.assert_array_equal(cloud.heuristic, cloud.distance > np.float32(0.09))


def test_true_labels_lie_on_the_one_changed_element(rows):
    for key, members in rows.items():
        positives = 0
        for cloud, truth in members:
            changed = np.unique(cloud.element[cloud.true])
            assert len(changed) <= 1 and (cloud.true == np.isin(cloud.element, changed)).all(), key
            positives += cloud.true.sum()
            # In the frame of the true box, every positive lies on its surface.
            angle = np.radians(truth.box.rotation)
            x, y, z = (cloud.points[cloud.true] - truth.box.center).T
            turned = np.stack([x * np.cos(angle) + y * np.sin(angle), y * np.cos(angle) - x * np.sin(angle), z], axis=1)
            assert (np.abs(turned) <= truth.box.dimensions / 2 + 1e-3).all(), key
        assert positives > 20 * ROOMS


def test_the_changed_element_is_what_the_scenario_says():
    for scenario, kind in zip(SCENARIOS, (PILLAR, WALL) * 2, strict=True):
        pairs = make_pairs(pair_config(CONFIG, source(scenario)), np.arange(4))
        side, changed, other = (
            (pairs.robot, pairs.changed_robot, pairs.dt)
            if scenario.endswith("added")
            else (pairs.dt, pairs.changed_dt, pairs.robot)
        )
        assert (side.semantic[changed] == kind).all()
        for room, (cloud, _) in enumerate(made(CONFIG, source(scenario), range(4))):
            element = np.unique(cloud.element[cloud.true])  # none where the filter by height took the whole object
            assert not np.isin(other.element[room], element).any()  # the other scan never saw it


@pytest.mark.parametrize("scenario", SCENARIOS)
def test_rooms_where_nothing_changed_have_no_positives(scenario):
    for condition in CONDITIONS:
        for cloud, truth in made(CONFIG, source(scenario, condition, UNCHANGED), range(4)):
            assert not cloud.true.any() and not cloud.testable[cloud.true].any() and len(cloud.points) > 100
            assert np.isnan(truth.observable_fraction)
            if condition == "clean":  # both scans are the same scan
                assert not cloud.distance.any() and not cloud.heuristic.any() and not cloud.testable.any()


def test_raw_distance_is_perfect_on_clean_rooms_and_honest_labels_of_distance(rows):
    """Both labels and score are the distance, so on clean rooms the control cannot miss; furniture breaks it."""

    def auc(scenario, condition, label):
        scored = [point_metrics(cloud.distance, getattr(cloud, label)) for cloud, _ in rows[scenario, condition]]
        found = [metrics.roc_auc for metrics in scored if metrics.roc_auc is not None]
        assert len(found) > ROOMS // 2
        return np.mean(found)

    for scenario in SCENARIOS:
        assert round(auc(scenario, "clean", "heuristic"), 4) == 1.0 and auc(scenario, "clean", "true") > 0.999
    for scenario in SCENARIOS[2:]:
        assert auc(scenario, "occluded", "true") < 0.99


@pytest.mark.parametrize("label_filter", ["always", "never"])
def test_the_cluster_filter_only_takes_labels_away(label_filter):
    config = dataclasses.replace(CONFIG, preprocess=PreprocessConfig(label_filter=label_filter))
    for condition in CONDITIONS:
        for cloud, _ in made(config, source("pillar_removed", condition), range(6)):
            far = cloud.distance > np.float32(0.09)
            assert not (cloud.heuristic & ~far).any()
            if label_filter == "never":
                np.testing.assert_array_equal(cloud.heuristic, far)


@pytest.mark.parametrize(
    "settings",
    [
        {"object_filter": "none", "outlier_removal": True},
        {"object_filter": "semantic", "voxel_size": 0.3},
        {"object_filter": "height", "filter_height": 1.5},
    ],
)
def test_preprocessing_does_what_the_settings_say(settings):
    config = dataclasses.replace(CONFIG, preprocess=PreprocessConfig(**settings))
    where = source("pillar_added", "occluded")
    pairs = make_pairs(pair_config(config, where), np.arange(3))
    for room, (cloud, _) in enumerate(made(config, where, range(3))):
        size = config.preprocess.voxel_size
        assert len(np.unique(np.floor(cloud.points / size + 0.5), axis=0)) == len(cloud.points)
        seen = np.unique(pairs.robot.element[room])
        kept = np.unique(cloud.element)
        if settings["object_filter"] == "none":
            assert len(kept) > 0.8 * (len(seen) - (-1 in seen))
        elif settings["object_filter"] == "semantic":
            structure = pairs.robot.element[room][np.isin(pairs.robot.semantic[room], (1, 2, 3, 4, 5))]
            assert set(kept) <= set(structure) and len(kept) < len(seen)


def test_many_rooms_at_once_are_preprocessed_as_one_by_one_by_the_reference():
    where = source("pillar_removed", "occluded")
    pairs = make_pairs(pair_config(CONFIG, where), np.arange(5))
    for room, (cloud, _) in enumerate(made(CONFIG, where, range(5))):
        sides = []
        for scan in (pairs.dt, pairs.robot):
            points = points_of(pairs.pose, pairs.directions, scan.distance)[room]
            pixel = np.flatnonzero(np.isfinite(scan.distance[room]))
            pixel = pixel[object_filter(points[pixel], scan.element[room, pixel], -1.5, 1.5)]
            sides.append(points[pixel[voxel_downsample(points[pixel])]])
        np.testing.assert_array_equal(cloud.points, sides[0])
        np.testing.assert_array_equal(cloud.distance, nearest_distance(*sides))


def test_stored_clouds_equal_fresh_ones(tmp_path):
    path, where = tmp_path / "sub" / "clouds.npz", source("wall_removed", "occluded")
    fresh = list(labelled_rooms.cached_clouds(CONFIG, where, 5, path))
    content = path.read_bytes()
    stored = list(labelled_rooms.cached_clouds(CONFIG, where, 5, path))
    assert len(stored) == len(fresh) == 5
    for a, b in zip(fresh, stored, strict=True):
        assert_same(a, b)
    path.unlink()
    list(labelled_rooms.cached_clouds(CONFIG, where, 5, path))
    assert path.read_bytes() == content


def test_clouds_that_were_not_all_made_are_not_stored(tmp_path):
    path = tmp_path / "clouds.npz"
    made_so_far = labelled_rooms.cached_clouds(CONFIG, source(), 20, path)
    next(made_so_far)
    made_so_far.close()
    assert not list(tmp_path.iterdir())
