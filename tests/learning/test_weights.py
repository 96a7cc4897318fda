"""The default models: they are what their config makes, and rank what changed before all shadows."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

from jaxmm.config import SCENARIOS, Table
from jaxmm.data.labelled_rooms import clouds
from jaxmm.data.simulator_settings import CloudSource, load_config
from jaxmm.learning import model_files
from jaxmm.learning.batches import labels_of
from jaxmm.learning.metrics import point_metrics
from jaxmm.learning.room_scores import scores_of
from jaxmm.weights import DEFAULT

ROOT = Path(__file__).resolve().parents[2]
UNSEEN = 77  # a seed that no training, validation or test of ours uses


@pytest.fixture(scope="module")
def default():
    return model_files.load_models(DEFAULT)


def test_the_models_are_those_of_the_config_that_makes_them(default):
    models, config = default
    assert config == load_config(ROOT / "configs" / "weights.toml")
    assert list(models) == ["evidence"] and models["evidence"].calibration is not None
    assert DEFAULT.stat().st_size < 1_000_000


def test_their_calibration_is_told_with_its_mix_of_scenes():
    told = json.loads(DEFAULT.with_name("calibration.json").read_text())
    assert set(told["evidence"]) == set(SCENARIOS) and sum(told["clouds"].values()) > 50


@pytest.mark.long
@pytest.mark.parametrize("kind", ["exact", "points"])
@pytest.mark.parametrize("scenario", SCENARIOS)
def test_occluded_rooms_are_ranked_better_than_by_distance(default, scenario, kind):
    models, config = default
    config = dataclasses.replace(
        config,
        scan=Table.of({"preset": "varied", "sensor": "oak-d-pro-small"}),
        preprocess=dataclasses.replace(config.preprocess, evidence=kind, object_filter="none"),
    )
    found = {"evidence": [], "nn-raw": []}
    for cloud, _ in clouds(config, CloudSource(scenario, scenario, "occluded", UNSEEN), np.arange(6)):
        label, void = labels_of(cloud, "true")
        if np.sum(label & ~void) >= 20:
            scores = scores_of(cloud, scenario, models, config.network)
            for method, values in found.items():
                values.append(point_metrics(scores[method], label, void).roc_auc)
    assert len(found["evidence"]) >= 3
    assert np.mean(found["evidence"]) > 0.97 and np.mean(found["evidence"]) > np.mean(found["nn-raw"])
