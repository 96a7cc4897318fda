"""Calibration: known distortions are undone, ranks stay, and errors are what their definitions say."""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxmm.learning import model_files
from jaxmm.learning.calibration import (
    KNOTS,
    Calibration,
    Reliability,
    apply,
    brier,
    calibrate,
    calibration_error,
    reliability,
)
from jaxmm.learning.model import Model
from jaxmm.learning.train_step import probabilities
from jaxmm.weights import DEFAULT


def drawn(count, distort, seed=0):
    """Logits that a distortion made of true log odds, labels drawn by those, and 40 clouds."""
    rng = np.random.default_rng(seed)
    true = rng.normal(-1.0, 2.0, count)
    label = rng.random(count) < 1 / (1 + np.exp(-true))
    return distort(true), label, np.arange(count) % 40, true


def test_a_temperature_is_found():
    logit, label, cloud, true = drawn(200_000, lambda x: 3.0 * x)
    found, report = calibrate(logit, label, cloud)
    assert report["log_loss"][report["kind"]] < 0.95 * report["log_loss"]["none"]
    inside = np.abs(true) < 4
    np.testing.assert_allclose(apply(found, logit)[inside], true[inside], atol=0.25)


def test_what_no_temperature_undoes_is_left_to_isotonic_regression():
    logit, label, cloud, true = drawn(200_000, lambda x: np.cbrt(x) + 2.0)
    found, report = calibrate(logit, label, cloud)
    assert report["kind"] == "isotonic"
    assert report["log_loss"]["isotonic"] < report["log_loss"]["temperature"] < report["log_loss"]["none"]
    inside = np.abs(true) < 4
    assert np.mean(np.abs(apply(found, logit)[inside] - true[inside])) < 0.15


@pytest.mark.parametrize("distort", [lambda x: 3.0 * x, lambda x: np.cbrt(x) + 2.0])
def test_ranks_stay(distort):
    logit, label, cloud, _ = drawn(20_000, distort)
    found, _ = calibrate(logit, label, cloud)
    assert np.shape(found.logit) == np.shape(found.calibrated) == (KNOTS,)
    assert np.all(np.diff(found.logit) > 0) and np.all(np.diff(found.calibrated) > 0)
    assert_order_kept(found)


def assert_order_kept(found):
    """Single-precision probabilities of ever larger logits never fall, and hardly any two of them are the same."""
    grid = np.linspace(-20, 20, 400, dtype=np.float32)
    probability = 1 / (1 + np.exp(-np.interp(grid, found.logit, found.calibrated).astype(np.float32)))
    assert np.all(np.diff(probability) >= 0) and len(np.unique(probability)) > 250


def test_the_default_models_keep_the_order_of_logits():
    calibration = model_files.load_models(DEFAULT)[0]["evidence"].calibration
    for logit, calibrated in zip(calibration.logit, calibration.calibrated, strict=True):
        assert_order_kept(Calibration(logit, calibrated))


@pytest.mark.parametrize("label", [np.zeros(50, bool), np.ones(50, bool), np.arange(50) == 3])
def test_few_positives_or_none_are_no_trouble(label):
    found, report = calibrate(np.linspace(-5, 5, 50), label, np.arange(50) % 2)
    assert np.all(np.isfinite(found.logit)) and np.all(np.isfinite(found.calibrated))
    assert report["positives"] == label.sum()


def test_networks_apply_the_map(monkeypatch):
    logit, label, cloud, _ = drawn(20_000, lambda x: 3.0 * x)
    found, _ = calibrate(logit, label, cloud)
    monkeypatch.setattr("jaxmm.learning.train_step.logits_of", lambda model, features, mask, config: features[:, 0])
    features = np.linspace(-50, 50, 333, dtype=np.float32)[:, None]
    with_map = probabilities.__wrapped__(Model({}, {}, found), jnp.asarray(features), None, None)
    np.testing.assert_allclose(with_map, 1 / (1 + np.exp(-apply(found, features[:, 0]))), atol=1e-6)
    without = probabilities.__wrapped__(Model({}, {}), jnp.asarray(features), None, None)
    np.testing.assert_allclose(without, 1 / (1 + np.exp(-features[:, 0])), atol=1e-6)


def test_errors_of_calibration_by_hand():
    probability, label = np.array([0.1, 0.1, 0.9, 1.0]), np.array([0, 1, 1, 1])
    sums = reliability(probability, label)
    assert calibration_error(sums) == pytest.approx((0.8 + 0.1) / 4)
    assert brier(sums) == pytest.approx((0.01 + 0.81 + 0.01) / 4)
    parts = reliability(probability[:2], label[:2]), reliability(probability[2:], label[2:])
    added = Reliability(*(first + second for first, second in zip(*parts, strict=True)))
    assert calibration_error(added) == pytest.approx(calibration_error(sums))
