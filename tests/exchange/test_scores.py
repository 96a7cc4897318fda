"""Scores: cases worked out by hand, other software's values, and what holds of all predictions."""

import numpy as np
import pytest
from sklearn.metrics import roc_auc_score

from jaxmm.exchange import scores
from jaxmm.exchange.object_scores import average_precision, objects_found, precision_recall
from jaxmm.exchange.predictions import Prediction
from jaxmm.exchange.scenes import Truth
from jaxmm.exchange.score_table import markdown
from jaxmm.exchange.scores import Elements, Scored, _auc, _aurc, estimate, risk_coverage
from jaxmm.inputs import InputError
from jaxmm.learning.boxes import Box

PILLAR = np.array([1.0, 2.0, 3.0, 0.0, 0.4, 0.4, 3.0, 0.0, 0.9])  # label, centre, edges, yaw, observable fraction
WALL = np.array([4.0, -4.0, 0.0, 0.0, 6.0, 0.2, 3.0, 30.0, 0.9])


def truth_of(scan=(), reference=(), elements=(), objects=(), hurdles=0):
    labels = (np.array(values, np.uint8) for values in (scan, reference, elements))
    return Truth(*labels, np.array(objects).reshape(-1, 9), np.array("unchanged"), np.array(hurdles))


def box_of(row, probability=1.0, along=0.0):
    kind, change = {1: ("pillar", "added"), 4: ("wall", "removed")}[int(row[0])]
    return change, Box(kind, row[1:4] + np.array([along, 0.0, 0.0]), row[4:7], row[7], probability=probability)


def drawn(seed, scenes=6):
    """Scenes with labels of all kinds, and predictions at random."""
    rng, made = np.random.default_rng(seed), {}
    for number in range(scenes):
        truth = truth_of(
            rng.choice([0, 1, 2, 5], 300, p=[0.7, 0.1, 0.1, 0.1]), rng.choice([0, 3, 4, 5], 200),
            rng.choice([0, 3, 5], 9), [PILLAR, WALL], hurdles=number % 3,
        )  # fmt: skip
        objects = [box_of(PILLAR, rng.random(), rng.normal() / 2), box_of(WALL, rng.random())]
        made[f"{number:06d}"] = Scored(truth, Prediction(rng.random(300), rng.random(200), rng.random(9), objects))
    return made


def score_scenes(scenes, split="test", where="here"):
    """With few draws, which is quicker."""
    return scores.score_scenes(scenes, split, where, resamples=100)


def rows_of(told, part, difficulty="all"):
    return {row["metric"]: row for row in told["rows"] if (row["part"], row["difficulty"]) == (part, difficulty)}


def test_the_truth_as_a_prediction_is_right_in_every_way():
    scenes = {}
    for name, (truth, _) in drawn(0).items():
        changed = [((label > 0) & (label < 5)).astype(float) for label in truth[:3]]
        scenes[name] = Scored(truth, Prediction(*changed, [box_of(PILLAR), box_of(WALL)]))
    told = score_scenes(scenes, "test", "here")
    best = {"roc_auc": 1, "fpr_at_95": 0, "iou_at_95": 0.95, "ece": 0, "brier": 0, "precision": 1, "recall": 1,
            "iou_positive": 1, "iou_negative": 1, "iou_static": 1, "miou": 1,
            "coverage": 1, "risk": 0, "aurc": 0, "unobservable_called_removed": 0, "ap": 1}  # fmt: skip
    assert {row["difficulty"] for row in told["rows"]} == {"all", "easy", "medium", "hard"}
    for row in told["rows"]:
        if row["metric"] == "iou_at_95":
            assert row["value"] == 1.0  # ties: a threshold that takes 95 % takes all
        else:
            assert row["value"] == pytest.approx(best[row["metric"]]) and row["interval"][0] <= row["interval"][1]
        assert row["interval"] == pytest.approx([row["value"]] * 2)
    assert "nan" not in markdown(told) and told["risk_coverage"][-1] == {"coverage": 1.0, "risk": 0.0}


@pytest.mark.parametrize("seed", range(3))
def test_values_lie_in_their_intervals_and_what_is_unobservable_changes_no_ranking(seed):
    scenes = drawn(seed)
    told = score_scenes(scenes, "test", "here")
    for row in told["rows"]:
        if row["value"] is not None:
            low, high = row["interval"]
            assert low <= high and 0.0 <= row["value"] <= 1.0
            assert row["difficulty"] != "all" or low - 0.02 <= row["value"] <= high + 0.02, row
    moved = {
        name: one._replace(said=one.said._replace(scan=np.where(one.truth.scan == 5, 1.0, one.said.scan)))
        for name, one in scenes.items()
    }
    assert rows_of(score_scenes(moved, "test", "here"), "points added") == rows_of(told, "points added")
    cubed = {
        name: one._replace(said=one.said._replace(reference=one.said.reference**3 * 7.0))
        for name, one in scenes.items()
    }
    one = scenes["000000"]  # probabilities in some scenes only are none: every difficulty has the same columns
    mixed = score_scenes(scenes | {"000000": one._replace(said=one.said._replace(scan=one.said.scan * 2))}, "test", "")
    assert all("ece" not in rows_of(mixed, "points added", level) for level in ("all", "easy", "medium", "hard"))
    assert "| points added |" in markdown(mixed)
    ranks = rows_of(score_scenes(cubed, "test", "here"), "points removed")
    assert "ece" not in ranks  # no probabilities any more, and the ranks are as they were
    assert all(rows_of(told, "points removed")[metric] == row for metric, row in ranks.items())


@pytest.mark.parametrize("seed", range(5))
def test_auc_by_weights_is_that_of_scenes_repeated(seed):
    rng = np.random.default_rng(seed)
    scene, gone, said = rng.integers(0, 4, 60), rng.random(60) < 0.4, np.round(rng.random(60), 1)
    order, weight = np.argsort(said, kind="stable"), np.array([2.0, 0.0, 1.0, 3.0])
    own = Elements(scene[order], gone[order], np.ones(60, bool), said[order])
    often = np.repeat(np.arange(60), weight[scene].astype(int))
    assert _auc(own, weight) == pytest.approx(roc_auc_score(gone[often], said[often]))


def test_risk_and_coverage_of_a_case_by_hand():
    # Sure and right, sure and wrong, unsure and right, no answer: risks 0, 1/2, 1/3 at coverages 1/4, 1/2, 3/4.
    own = Elements(np.zeros(4, int), np.array([1, 0, 0, 1], bool), np.ones(4, bool), np.array([1.0, 0.9, 0.4, np.nan]))
    assert _aurc(own, np.ones(1)) == pytest.approx((0 + 1 / 2 + 1 / 3) / 3)
    assert risk_coverage(own, np.ones(1)) == [{"coverage": 0.5, "risk": 0.5}]
    scene = Scored(
        truth_of(elements=[3, 0, 0, 3, 5]), Prediction(None, None, np.array([1.0, 0.9, 0.4, np.nan, 0.7]), None)
    )
    rows = rows_of(score_scenes({"0": scene}, "test", "here"), "elements")
    found = {metric: row["value"] for metric, row in rows.items()}
    assert found["precision"] == 0.5 and found["recall"] == 0.5 and found["coverage"] == 0.75
    assert found["risk"] == pytest.approx(1 / 3) and found["unobservable_called_removed"] == 1.0
    assert rows["recall"]["count"] == 2 and rows["unobservable_called_removed"]["count"] == 1


def test_average_precision_of_a_case_by_hand():
    # By falling probability: right, wrong, right, and one of three is never found: 1/3 * 1 + 1/3 * 2/3.
    far = box_of(PILLAR, 0.8, along=5.0)
    scenes = [([PILLAR], [box_of(PILLAR, 0.9), far]), ([WALL, PILLAR], [box_of(WALL, 0.3)])]
    found = objects_found([(np.array(true), said) for true, said in scenes])
    assert average_precision(found, np.ones(2)) == pytest.approx(1 / 3 + 2 / 9)
    assert found.counts.tolist() == [[1, 2, 0, 1, 1], [0, 0, 0, 2, 0]]  # the last is below one half
    curve = [(one["probability"], one["precision"], one["recall"]) for one in precision_recall(found)]
    assert curve == [(0.9, 1.0, 1 / 3), (0.8, 0.5, 1 / 3), (0.3, 2 / 3, 2 / 3)]


def test_classes_of_points_of_a_case_by_hand():
    truth = truth_of(scan=[1, 1, 0, 0, 5], reference=[4, 0, 0, 5])
    said = Prediction(np.array([0.9, 0.1, 0.7, 0.0, 0.9]), np.array([0.8, 0.2, 0.6, 0.9]), None, None)
    rows = rows_of(score_scenes({"0": Scored(truth, said)}), "points by class")
    found = {metric: row["value"] for metric, row in rows.items()}
    # New: one in both, three in either. Gone: one, two. Neither: two, five.
    assert found["iou_positive"] == pytest.approx(1 / 3) and found["iou_negative"] == 0.5
    assert found["iou_static"] == pytest.approx(2 / 5) and found["miou"] == pytest.approx((1 / 3 + 1 / 2 + 2 / 5) / 3)


def test_what_hardly_shows_need_not_be_found_and_is_not_wrong():
    hidden = PILLAR.copy()
    hidden[-1] = 0.1
    found = objects_found([(np.array([hidden, WALL]), [box_of(PILLAR, 0.9), box_of(WALL, 0.8)])])
    assert found.counts.tolist() == [[1, 2, 1, 1, 1]] and average_precision(found, np.ones(1)) == 1.0
    twice = objects_found([(np.array([WALL]), [box_of(WALL, 0.9), box_of(WALL, 0.8)])])
    assert twice.counts.tolist() == [[1, 2, 0, 1, 1]] and twice.kind.tolist() == [1, 0]  # the surer one is right


def test_equal_scenes_have_an_interval_without_width_and_others_one_of_known_width():
    assert estimate(lambda weight: float(weight @ np.ones(9) / weight.sum()), 9) == (1.0, [1.0, 1.0])
    values = np.random.default_rng(0).normal(size=400)
    value, (low, high) = estimate(lambda weight: float(weight @ values / weight.sum()), 400)
    assert value == pytest.approx(values.mean()) and high - low == pytest.approx(2 * 1.96 / 20, rel=0.15)
    assert estimate(lambda weight: np.nan, 3) == (None, None)


def test_a_column_that_some_scenes_lack_is_named_with_the_scene():
    scenes = drawn(0)
    lacking = scenes["000003"]
    scenes["000003"] = lacking._replace(said=lacking.said._replace(elements=None))
    with pytest.raises(InputError, match="scene 000003: column elements"):
        score_scenes(scenes, "test", "here")
    scenes["000003"] = lacking._replace(said=lacking.said._replace(objects=None))  # nothing found there
    assert rows_of(score_scenes(scenes, "test", "here"), "objects")["recall"]["count"] == 12
