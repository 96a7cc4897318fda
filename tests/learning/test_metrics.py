"""Metrics: hand-made tables, scikit-learn as witness, and the properties that any ranking metric has."""

import numpy as np
import pytest
from sklearn.metrics import roc_auc_score

from jaxmm.learning.metrics import METRICS, bootstrap_interval, point_metrics


def room(seed, count=400):
    """Scores with many ties, labels that follow them roughly."""
    rng = np.random.default_rng(seed)
    score = np.round(rng.normal(size=count), rng.integers(0, 4))
    return score, score + rng.normal(scale=rng.uniform(0.1, 3), size=count) > rng.uniform(-1, 1)


def slow(score, label):
    """The definitions, threshold by threshold."""
    threshold = max(t for t in set(score) if 20 * np.sum(label & (score >= t)) >= 19 * label.sum())

    def counts(predicted):
        return np.sum(predicted & label), np.sum(predicted & ~label)

    (tp, fp), (strict_tp, strict_fp) = counts(score >= threshold), counts(score > threshold)
    negatives = np.sum(~label)
    thesis = strict_fp / (strict_fp + negatives), strict_tp / (label.sum() + strict_fp)
    return fp / negatives, tp / (tp + fp), tp / (label.sum() + fp), *thesis


@pytest.mark.parametrize("seed", range(40))
def test_agrees_with_scikit_learn_and_the_definitions(seed):
    score, label = room(seed)
    result = point_metrics(score, label)
    assert result.roc_auc == pytest.approx(roc_auc_score(label, score), abs=1e-12)
    np.testing.assert_allclose(result[1:], slow(score, label), atol=1e-15)


@pytest.mark.parametrize(
    "score, label, expected",
    [
        pytest.param([1, 2, 3, 4], [0, 0, 1, 1], (1, 0, 1, 1, 0, 1 / 2), id="perfect"),
        pytest.param([4, 3, 2, 1], [0, 0, 1, 1], (0, 1, 1 / 2, 1 / 2, 1 / 2, 1 / 4), id="upside down"),
        pytest.param([5, 5, 5, 5], [0, 0, 1, 1], (1 / 2, 1, 1 / 2, 1 / 2, 0, 0), id="all the same"),
    ],
)
def test_small_tables(score, label, expected):
    assert point_metrics(np.array(score), np.array(label)) == pytest.approx(expected)


def test_the_thesis_falls_one_point_short_of_its_recall():
    """435 positives above all negatives: 414 are needed for a recall of 0.95, the strict comparison finds 413."""
    result = point_metrics(np.arange(9000), np.arange(9000) >= 9000 - 435)
    assert result.thesis_iou_at_95 == 413 / 435
    assert result.iou_at_95 == 414 / 435
    assert round(result.iou_at_95, 4) == 0.9517


@pytest.mark.parametrize("standard, printed", [(0.1434, 0.1254), (0.2566, 0.2042), (0.9257, 0.4807)])
def test_the_thesis_prints_a_smaller_false_positive_rate(standard, printed):
    """The lowest positive lies under a given share of 10,000 negatives."""
    false = round(standard * 10_000)
    score = np.concatenate([np.full(10_000 - false, 0.0), np.full(false, 2.0), [1.0, 1.5]])
    result = point_metrics(score, np.arange(len(score)) >= 10_000)
    assert result.fpr_at_95 == pytest.approx(standard)
    assert round(result.thesis_fpr_at_95, 4) == printed


@pytest.mark.parametrize("positives", [20, 40, 100, 1000, 19_980])
def test_recall_of_19_in_20_needs_no_point_more(positives):
    """Where 0.95 N is whole, floating point must not ask for one more."""
    label = np.arange(positives + 1) > 0
    assert point_metrics(np.arange(positives + 1), label).iou_at_95 == 0.95


@pytest.mark.parametrize("seed", range(20))
def test_ranking_is_all_that_counts(seed):
    score, label = room(seed)
    order = np.random.default_rng(seed).permutation(len(score))
    assert point_metrics(np.exp(score / 9)[order], label[order].astype(int)) == point_metrics(score, label)
    turned = point_metrics(-score, label).roc_auc
    assert turned + point_metrics(score, label).roc_auc == pytest.approx(1)


@pytest.mark.parametrize("seed", range(10))
def test_void_points_count_for_nothing(seed):
    score, label = room(seed)
    void = np.random.default_rng(seed).random(len(score)) < 0.3
    assert point_metrics(score, label, void) == point_metrics(score[~void], label[~void])


@pytest.mark.parametrize("label", [np.zeros(5, bool), np.ones(5, bool), np.zeros(0, bool)])
def test_without_positives_or_negatives_there_is_nothing_to_say(label):
    assert point_metrics(np.zeros(len(label)), label) == (None,) * len(METRICS)


def test_wrong_arrays_are_refused():
    with pytest.raises(ValueError, match="alike"):
        point_metrics(np.zeros(5), np.zeros(4))
    with pytest.raises(ValueError, match="finite, got 1"):
        point_metrics(np.array([1, np.nan]), np.array([0, 1]))
    with pytest.raises(ValueError, match="0 and 1"):
        point_metrics(np.zeros(2), np.array([1, 2]))
    with pytest.raises(ValueError, match="counts"):
        bootstrap_interval(np.zeros((0, 2)), 100)


def test_interval_of_a_mean_covers_the_truth_19_times_in_20():
    rng = np.random.default_rng(0)
    samples = rng.normal(3.0, 1.0, (400, 60))
    ones = np.ones(60)
    intervals = np.array([bootstrap_interval(np.stack([sample, ones], 1), 400, seed=1) for sample in samples])
    covered = np.mean((intervals[:, 0] <= 3.0) & (intervals[:, 1] >= 3.0))
    assert 0.90 < covered < 0.98  # the percentile interval of 60 values is slightly narrow
    width = np.mean(intervals[:, 1] - intervals[:, 0])
    assert width == pytest.approx(2 * 1.96 / np.sqrt(60), rel=0.05)


def test_interval_of_a_ratio_weighs_rooms_by_their_counts():
    rng = np.random.default_rng(2)
    counts = np.stack([rng.integers(0, 5, 50), np.full(50, 5)], axis=1)
    low, high = bootstrap_interval(counts, 2000, seed=3)
    shares = np.stack([counts[:, 0] / 5, np.ones(50)], axis=1)
    assert (low, high) == pytest.approx(bootstrap_interval(shares, 2000, seed=3))
    sparse = np.array([[1, 2], [0, 0]])  # half of the draws of one room hold nothing to count
    assert bootstrap_interval(sparse, 100) == (0.5, 0.5)


def test_equal_rooms_have_no_spread_and_a_seed_repeats_itself():
    assert bootstrap_interval(np.array([[0.3, 1], [0.3, 1]]), 200) == (0.3, 0.3)
    rooms = np.array([[0.1, 1], [0.4, 1], [0.7, 1]])
    assert bootstrap_interval(rooms, 200, seed=5) == bootstrap_interval(rooms, 200, seed=5)
