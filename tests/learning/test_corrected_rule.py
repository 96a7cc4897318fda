"""Networks that correct the rule: untrained they say what it says, trained they say better, and files keep them."""

import dataclasses

import jax
import numpy as np
import pytest

from jaxmm.config import SCENARIOS, Config, NetworkConfig, TrainConfig
from jaxmm.learning import inference, room_scores, train_step
from jaxmm.learning.batches import Batch, LabelledCloud
from jaxmm.learning.joint_training import Entry, Joint
from jaxmm.learning.model import offset_of, pick_model
from jaxmm.learning.model_files import load_models, save_models
from jaxmm.rays.evidence import FEATURES
from jaxmm.rays.rule import SOFT, rule_logits, rule_scores
from jaxmm.weights import DEFAULT

CONFIG = Config(
    network=NetworkConfig((8, 16), (8,), 0.1),
    train=TrainConfig(methods=("evidence",), rule_scale=1.0, learning_rate=0.01, step_count=60, calibrate=()),
    preprocess=dataclasses.replace(Config().preprocess, evidence="exact"),
)


def evidence(count, seed=0):
    """Features (N, F) as they may come: fractions of rays that sum to 1, of points and of pools; the rest in [0, 1]."""
    rng = np.random.default_rng(seed)
    found = rng.random((count, len(FEATURES)))
    for first in ("through", "pool through", "surface through"):
        at = FEATURES.index(first)
        found[:, at : at + 4] = rng.dirichlet(np.full(4, 0.3), count)
    found[:, FEATURES.index("pooled")] = rng.random(count) < 0.7
    return found.astype(np.float32)


def fresh(config=CONFIG):
    rule = offset_of("evidence", range(4), config.train)
    return train_step.init_all(jax.random.key(0), len(FEATURES), config, 4, rule)


@pytest.mark.parametrize("scenario", SCENARIOS)
def test_untrained_it_gives_the_probabilities_of_the_rule(scenario):
    features = evidence(3000)
    score = rule_scores(features, removed=scenario.endswith("removed"))
    assert np.ptp(score) > 0.9
    model = pick_model(jax.tree.map(np.asarray, fresh().model), scenario)
    for predict in (room_scores.predict, inference.predict):
        found = predict(model, features, CONFIG.network)
        np.testing.assert_allclose(found, (score + SOFT) / (1 + 2 * SOFT), atol=2e-7)
    order = np.argsort(score, kind="stable")  # whoever ranks by one ranks by the other
    assert (np.diff(rule_logits(features, scenario.endswith("removed"))[order]) >= 0).all()


def batch_of(wrong, seed=0, clouds=4):
    """Clouds of which the rule says the contrary of the truth, or the truth."""
    features = np.stack([evidence(200, seed * 100 + n) for n in range(4 * clouds)]).reshape(4, clouds, 200, -1)
    said = [rule_logits(features[n], SCENARIOS[n].endswith("removed")) > 0 for n in range(4)]
    labels, mask = np.stack(said) ^ wrong, np.ones((4, clouds, 200), bool)
    return Batch(features, labels, mask, mask, np.full((4, clouds), seed, np.uint32))


def test_training_corrects_a_rule_that_is_wrong():
    states, held_out = fresh(), batch_of(True, seed=99)
    before = np.asarray(train_step.validate_all(states.model, held_out, CONFIG).loss)
    for step in range(60):
        states, _ = train_step.train_step_all(states, batch_of(True, seed=step), CONFIG)
    after = np.asarray(train_step.validate_all(states.model, held_out, CONFIG).loss)
    assert (after < 0.5 * before).all()
    # What is added of the rule is fixed.
    np.testing.assert_array_equal(states.model.offset.scale, 1.0)
    np.testing.assert_array_equal(states.model.offset.removed, [0, 0, 1, 1])


def test_files_keep_what_is_added_and_older_ones_add_nothing(tmp_path):
    models = {"evidence": jax.tree.map(np.asarray, fresh().model)}
    save_models(tmp_path / "models.safetensors", models, CONFIG)
    found, config = load_models(tmp_path / "models.safetensors")
    assert config == CONFIG
    jax.tree.map(np.testing.assert_array_equal, found["evidence"], models["evidence"])
    shipped, trained = load_models(DEFAULT)
    assert shipped["evidence"].offset is None and trained.train.rule_scale == 0.0


@pytest.mark.long
def test_only_the_method_that_sees_evidence_corrects_the_rule():
    assert offset_of("nn", range(4), CONFIG.train) is None
    cloud = LabelledCloud(
        np.zeros((30, 3), np.float32), np.full(30, 7.0, np.float32), np.zeros(30, np.int32), *np.zeros((3, 30), bool),
        evidence(30),
    )  # fmt: skip
    entries = tuple(Entry(name, "wall_removed", name, "true", 1, [cloud], [cloud]) for name in ("nn", "evidence"))
    together = Joint(entries, "joint", 1, 30, 0)
    states = together.states(CONFIG)
    np.testing.assert_array_equal(states.model.offset.scale, [0, 1])
    states, losses = train_step.train_step_all(states, together.batch(0), CONFIG)
    assert np.isfinite(losses).all()  # zeros and a distance are no evidence, and do no harm
    models = together.models(states.model)
    assert models["nn/wall_removed"].offset is None and models["evidence/wall_removed"].offset.removed == 1
    alone = Joint(entries[:1], "joint", 1, 30, 0)
    (own,) = alone.models(train_step.train_step_all(alone.states(CONFIG), alone.batch(0), CONFIG)[0].model).values()
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, atol=1e-5), models["nn/wall_removed"], own)
