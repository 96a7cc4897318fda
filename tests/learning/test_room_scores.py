"""Scores of one room: predictions do not feel the padding, and an analytic room gets the analytic scores."""

import json

import jax
import numpy as np
import pytest

from jaxmm.config import SCENARIOS, Config, NetworkConfig
from jaxmm.learning import room_scores
from jaxmm.learning.batches import LabelledCloud
from jaxmm.learning.boxes import Box
from jaxmm.learning.metrics import METRICS
from jaxmm.learning.model import pick_model
from jaxmm.learning.room_scores import RoomTruth
from jaxmm.learning.train_step import init_all

NETWORK = NetworkConfig((8, 16), (8,), 0.1)
CONFIG = Config(network=NETWORK)


@pytest.fixture(scope="module")
def models():
    return {"nn": init_all(jax.random.key(0), 1, CONFIG).model, "xyz_nn": init_all(jax.random.key(1), 4, CONFIG).model}


def test_predictions_depend_on_neither_padding_nor_order(models, monkeypatch):
    rng = np.random.default_rng(0)
    model = pick_model(models["xyz_nn"], "wall_added")
    features = rng.uniform(2, 3, (700, 4)).astype(np.float32)  # padding is zero, and would stand out
    order = rng.permutation(700)
    expected = room_scores.predict(model, features, NETWORK)
    assert expected.shape == (700,) and expected.dtype == np.float32 and np.ptp(expected) > 0.01
    for bucket in (700, 701, 1000):
        monkeypatch.setattr(room_scores, "BUCKET", bucket)
        np.testing.assert_allclose(room_scores.predict(model, features, NETWORK), expected, atol=1e-6)
        np.testing.assert_allclose(room_scores.predict(model, features[order], NETWORK), expected[order], atol=1e-6)


@pytest.mark.parametrize("count", [0, 1, 4096, 4097])
def test_every_point_of_a_cloud_of_any_length_gets_a_probability(models, count):
    model = pick_model(models["nn"], "wall_added")
    found = room_scores.predict(model, np.ones((count, 1), np.float32), NETWORK)
    assert found.shape == (count,) and (found == found[:1]).all() and ((found > 0) & (found < 1)).all()


def test_each_scenario_has_its_own_model(models):
    stacked = models["nn"]
    features = np.linspace(0, 1, 50, dtype=np.float32)[:, None]
    found = [room_scores.predict(pick_model(stacked, name), features, NETWORK) for name in SCENARIOS]
    assert len({values.tobytes() for values in found}) == 4
    for index, name in enumerate(SCENARIOS):
        picked = pick_model(stacked, name)
        jax.tree.map(lambda a, b, i=index: np.testing.assert_array_equal(a, b[i]), picked, stacked)


def pillar_room():
    """A 0.4 m pillar in the middle of a 6 x 6 m floor and ceiling; its lower half has not been seen through."""
    grid = np.arange(-3, 3.01, 0.1)
    plane = np.stack(np.meshgrid(grid, grid), axis=-1).reshape(-1, 2)
    plane = plane[np.abs(plane).max(axis=1) > 0.25]
    floor, ceiling = (np.column_stack([plane, np.full(len(plane), z)]) for z in (-1.5, 1.5))
    side = np.arange(-0.2, 0.21, 0.1)
    around = [(x, y) for x in side for y in side if max(abs(x), abs(y)) > 0.19]
    pillar = np.array([(x, y, z) for x, y in around for z in np.arange(-1.4, 1.41, 0.1)])
    points = np.concatenate([floor, ceiling, pillar]).astype(np.float32)
    element = np.repeat([0, 1, 2], [len(floor), len(ceiling), len(pillar)]).astype(np.int32)
    changed = element == 2
    distance = np.where(changed, 0.5, 0.0).astype(np.float32)
    testable = changed & (points[:, 2] > 0)
    return LabelledCloud(points, distance, element, changed, changed, testable, np.zeros((len(points), 0)))


TRUTH = RoomTruth(5, Box("pillar", np.zeros(3), np.array([0.4, 0.4, 3.0])), 0.5)


def scored(cloud, truth=TRUTH, **scores):
    return room_scores.score_room(cloud, truth, "pillar_removed", scores, CONFIG)


def test_the_scores_of_an_analytic_room():
    cloud = pillar_room()
    room = scored(cloud, **{"nn-raw": cloud.distance})
    method = room["methods"]["nn-raw"]
    positives = int(cloud.true.sum())
    assert room["room"] == 5 and room["points"] == len(cloud.points) and room["observable_fraction"] == 0.5
    assert room["positives"] == {"heuristic": positives, "true": int(cloud.testable.sum())}
    for kind in ("heuristic", "true"):
        metrics = method["metrics"][kind]
        assert list(metrics) == list(METRICS)
        assert (metrics["roc_auc"], metrics["fpr_at_95"], metrics["precision_at_95"]) == (1, 0, 1)
    (box,) = method["boxes"]
    assert (method["boxes_matched"], method["boxes_found"], method["boxes_true"]) == (1, 1, 1)
    assert (box["object_type"], box["mismatch_type"]) == ("pillar", "removed")
    np.testing.assert_allclose(box["center"], 0, atol=0.02)
    np.testing.assert_allclose(box["dimensions"], [0.4, 0.4, 3.0], atol=0.05)
    assert room["true_box"]["dimensions"] == [0.4, 0.4, 3.0]
    json.dumps(room, allow_nan=False)


def test_what_nobody_could_see_counts_for_nothing_on_true_labels_only():
    """A method that misses just the untestable half is perfect on true labels, and is not on heuristic ones."""
    cloud = pillar_room()
    metrics = scored(cloud, nn=cloud.testable.astype(np.float32))["methods"]["nn"]["metrics"]
    assert metrics["true"]["roc_auc"] == 1 and metrics["heuristic"]["roc_auc"] < 1
    # And one that finds only that half is worthless there: its hits are void, not rewarded.
    hidden = (cloud.true & ~cloud.testable).astype(np.float32)
    metrics = scored(cloud, nn=hidden)["methods"]["nn"]["metrics"]
    assert metrics["true"]["roc_auc"] == 0.5 and metrics["heuristic"]["roc_auc"] > 0.5


def test_a_heuristic_label_off_the_object_is_a_negative_on_true_labels():
    cloud = pillar_room()
    shadow = np.abs(cloud.points[:, 0] - 2) < 0.3
    cloud = cloud._replace(heuristic=cloud.heuristic | shadow, distance=np.where(shadow, 0.6, cloud.distance))
    metrics = scored(cloud, **{"nn-raw": cloud.distance})["methods"]["nn-raw"]["metrics"]
    assert metrics["heuristic"]["roc_auc"] == 1
    count = shadow.sum() / (len(shadow) - cloud.true.sum())  # the share of negatives that outranks every positive
    assert metrics["true"]["roc_auc"] == pytest.approx(1 - count)


def test_a_box_elsewhere_is_not_a_match():
    cloud = pillar_room()
    away = TRUTH._replace(box=TRUTH.box._replace(center=np.array([1.0, 0, 0])))
    method = scored(cloud, away, **{"nn-raw": cloud.distance})["methods"]["nn-raw"]
    assert (method["boxes_matched"], method["boxes_found"], method["boxes_true"]) == (0, 1, 1)


def test_an_empty_cloud_has_gaps():
    empty = LabelledCloud(*(field[:0] for field in pillar_room()))
    room = scored(empty, **{"nn-raw": empty.distance})
    assert room["points"] == 0 and room["methods"]["nn-raw"]["metrics"]["true"]["roc_auc"] is None
    assert room["methods"]["nn-raw"]["boxes"] == []


def test_flat_rooms_hold_every_method_and_label_kind(models):
    cloud = pillar_room()
    scores = room_scores.scores_of(cloud, "pillar_removed", models, NETWORK)
    assert list(scores) == ["nn-raw", "nn", "xyz_nn"] and scores["nn-raw"] is cloud.distance
    flat = room_scores.flat_rooms([scored(cloud, **scores)] * 2, "pillar_removed", "clean")
    assert len(flat) == 2 * 2 * 3
    raw = [room for room in flat if room["method"] == "nn-raw" and room["label_kind"] == "true"]
    assert raw[0]["positives"] == cloud.testable.sum() and raw[0]["roc_auc"] == 1 and raw[0]["boxes_matched"] == 1
