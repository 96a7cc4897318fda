import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxmm.config import ConfigError, LossConfig
from jaxmm.learning.losses import focal_loss

LOG2 = np.log(2)


@pytest.mark.parametrize(
    "logit, label, config, expected",
    [
        pytest.param(0.0, 1, LossConfig("released", 10, 2), 10 * 0.25 * LOG2, id="undecided, positive"),
        pytest.param(0.0, 0, LossConfig("released", 10, 2), 10 * 0.25 * LOG2, id="released weighs negatives the same"),
        pytest.param(0.0, 1, LossConfig("balanced", 0.25, 2), 0.25 * 0.25 * LOG2, id="balanced, positive"),
        pytest.param(0.0, 0, LossConfig("balanced", 0.25, 2), 0.75 * 0.25 * LOG2, id="balanced, negative"),
        pytest.param(3.0, 0, LossConfig("released", 1, 0), np.log1p(np.exp(3)), id="gamma 0 is cross-entropy"),
        pytest.param(200.0, 1, LossConfig(), 0.0, id="certain and right"),
        pytest.param(-200.0, 1, LossConfig(), 2000.0, id="certain and wrong stays finite"),
    ],
)
def test_one_point(logit, label, config, expected):
    loss = focal_loss(jnp.array([logit]), jnp.array([label]), jnp.array([True]), config)
    np.testing.assert_allclose(loss.total, expected, rtol=1e-5, atol=1e-7)
    gradient = jax.grad(lambda x: focal_loss(x, jnp.array([label]), jnp.array([True]), config).total)(
        jnp.array([logit])
    )
    assert np.isfinite(gradient).all()


@pytest.mark.parametrize("config", [LossConfig(), LossConfig("balanced", 0.3, 1.5)], ids=["released", "balanced"])
def test_agrees_with_the_written_formula_in_float64(config):
    rng = np.random.default_rng(0)
    logits, labels = rng.normal(0, 4, 5000), rng.random(5000) < 0.1
    p = 1 / (1 + np.exp(-logits))
    p_t = np.where(labels, p, 1 - p)
    alpha = config.alpha if config.form == "released" else np.where(labels, config.alpha, 1 - config.alpha)
    expected = np.sum(-alpha * (1 - p_t) ** config.gamma * np.log(p_t))
    loss = focal_loss(jnp.array(logits, jnp.float32), jnp.array(labels), jnp.ones(5000, bool), config)
    np.testing.assert_allclose(loss.total, expected, rtol=1e-5)


def test_padding_neither_costs_nor_counts():
    rng = np.random.default_rng(1)
    logits, labels = jnp.array(rng.normal(size=100), jnp.float32), jnp.array(rng.random(100) < 0.5)
    whole = focal_loss(logits[:60], labels[:60], jnp.ones(60, bool), LossConfig())
    padded = focal_loss(logits.at[60:].set(jnp.inf), labels, jnp.arange(100) < 60, LossConfig())
    np.testing.assert_allclose(padded.total, whole.total, rtol=1e-6)
    assert padded.count == whole.count == 60


def test_balanced_form_refuses_the_thesis_alpha():
    with pytest.raises(ConfigError, match=r"alpha must lie in \[0, 1\]"):
        LossConfig("balanced", 10.0)
