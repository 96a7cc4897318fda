"""Training on evidence: calibrated models, saved and read again, and what is told of their calibration."""

import dataclasses
import json

import jax
import numpy as np
import pytest

from jaxmm import run_folder
from jaxmm.config import SCENARIOS, load
from jaxmm.inputs import InputError
from jaxmm.learning import model_files
from jaxmm.learning.calibration import KNOTS
from jaxmm.learning.model import pick_model
from jaxmm.learning.room_scores import predict
from jaxmm.rays.evidence import FEATURES
from jaxmm.runs.training_stage import train_stage


@pytest.fixture(scope="module")
def trained(tiny_config, tmp_path_factory):
    """Settings, folder and models of a tiny training on evidence."""
    config = load(tiny_config)
    config = dataclasses.replace(
        config,
        train=dataclasses.replace(config.train, methods=("evidence",), augment=(), labels="true", schedule="cosine"),
        preprocess=dataclasses.replace(config.preprocess, evidence="mixed", object_filter="mixed"),
    )
    folder = tmp_path_factory.mktemp("runs") / "evidence"
    with run_folder.open_run(folder, config):
        models = train_stage(config, folder)
    return config, folder, models


@pytest.mark.long
def test_models_come_back_with_their_calibration(trained):
    config, folder, models = trained
    found, settings = model_files.load_models(folder)
    assert settings == config and list(found) == ["evidence"]
    assert found["evidence"].calibration.logit.shape == (len(SCENARIOS), KNOTS)
    jax.tree.map(np.testing.assert_array_equal, found["evidence"], models["evidence"])
    assert np.all(np.diff(found["evidence"].calibration.calibrated, axis=1) > 0)


def test_probabilities_are_the_calibrated_ones(trained):
    config, _, models = trained
    features = np.random.default_rng(0).normal(size=(50, len(FEATURES))).astype(np.float32)
    for scenario in SCENARIOS:
        model = pick_model(models["evidence"], scenario)
        raw = predict(model._replace(calibration=None), features, config.network).astype(np.float64)
        logit = np.log(raw / (1 - raw))
        expected = 1 / (1 + np.exp(-np.interp(logit, model.calibration.logit, model.calibration.calibrated)))
        np.testing.assert_allclose(predict(model, features, config.network), expected, atol=1e-4)


def test_the_calibration_is_told(trained):
    told = json.loads((trained[1] / "calibration.json").read_text())
    assert set(told["evidence"]) == set(SCENARIOS)
    assert told["clouds"] == {
        "own change, clean": 1, "own change, occluded": 1, "unchanged, clean": 0, "unchanged, occluded": 0,
        "multi, clean": 0, "multi, occluded": 0,
    }  # fmt: skip
    for report in told["evidence"].values():
        assert report["kind"] in ("temperature", "isotonic") and report["points"] >= report["positives"] >= 0


def test_models_of_other_features_are_refused(trained, tmp_path, monkeypatch):
    config, _, models = trained
    path = tmp_path / "old.safetensors"
    model_files.save_models(path, models, config)
    monkeypatch.setitem(model_files.TRAINED_METHODS, "evidence", len(FEATURES) + 1)
    with pytest.raises(InputError, match=f"expected {len(FEATURES) + 1} features for evidence, got {len(FEATURES)}"):
        model_files.load_models(path)
