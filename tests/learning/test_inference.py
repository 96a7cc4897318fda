"""The networks' answers in NumPy are those of JAX, with fresh weights and with those that come along."""

import jax
import numpy as np
import pytest

from jaxmm.config import COMPACT, SCENARIOS, THESIS, TRAINED_METHODS, Config, NetworkConfig
from jaxmm.learning import inference, room_scores
from jaxmm.learning.calibration import KNOTS, Calibration
from jaxmm.learning.model import Model, pick_model, shapes_of
from jaxmm.learning.model_files import load_models
from jaxmm.learning.train_step import init_all
from jaxmm.weights import DEFAULT

SMALL = NetworkConfig((8, 16), (8,), 0.1)


def trained(network, features, seed, calibrated):
    """A model as training could leave it: statistics and scales of any size, calibrated by any rising map."""
    rng = np.random.default_rng(seed)
    model = init_all(jax.random.key(seed), features, Config(network=network), 1).model
    shaken = jax.tree.map(lambda leaf: np.asarray(leaf)[0] + rng.normal(0.0, 0.1, leaf.shape[1:]).astype("f"), model)
    stats = {
        name: {"mean": value["mean"], "var": rng.uniform(0.1, 3.0, value["var"].shape).astype("f")}
        for name, value in shaken.batch_stats.items()
    }
    knots = (np.cumsum(rng.uniform(0.1, 0.5, (2, KNOTS)), axis=1) - 5.0).astype("f")
    return Model(shaken.params, stats, Calibration(*knots) if calibrated else None)


@pytest.mark.parametrize("network", [SMALL, COMPACT, THESIS], ids=["small", "compact", "thesis"])
@pytest.mark.parametrize("count", [1, inference.BLOCK, inference.BLOCK + 1])
@pytest.mark.parametrize("calibrated", [False, True])
def test_probabilities_are_those_of_jax(network, count, calibrated):
    model = trained(network, 4, count, calibrated)
    features = np.random.default_rng(count).normal(0.0, 2.0, (count, 4)).astype(np.float32)
    found = inference.predict(model, features, network)
    assert found.dtype == np.float32 and found.shape == (count,)
    np.testing.assert_allclose(found, room_scores.predict(model, features, network), atol=5e-6)


def test_the_models_that_come_along_say_the_same():
    models, config = load_models(DEFAULT)
    rng, size = np.random.default_rng(0), TRAINED_METHODS["evidence"]
    features = rng.uniform(-1.0, 1.0, (5000, size)).astype(np.float32)
    for scenario in SCENARIOS:
        model = pick_model(models["evidence"], scenario)
        found = inference.predict(model, features, config.network)
        assert np.ptp(found) > 0.5
        np.testing.assert_allclose(found, room_scores.predict(model, features, config.network), atol=1e-5)


def test_no_points_get_no_probabilities_and_certain_ones_stay_finite():
    model = trained(SMALL, 4, 0, False)
    assert inference.predict(model, np.zeros((0, 4)), SMALL).shape == (0,)
    far = inference.predict(model, np.array([[1e6] * 4, [-1e6] * 4], np.float32), SMALL)
    assert np.isfinite(far).all() and (far >= 0.0).all() and (far <= 1.0).all()


@pytest.mark.parametrize("network", [SMALL, COMPACT, THESIS, NetworkConfig((3,), (2, 5, 7))])
@pytest.mark.parametrize("features", [1, 29])
def test_shapes_are_those_that_training_makes(network, features):
    model = jax.eval_shape(lambda: init_all(jax.random.key(0), features, Config(network=network), 1).model)
    expected = {
        (part, layer, name): leaf.shape[1:]
        for part in ("params", "batch_stats")
        for layer, leaves in getattr(model, part).items()
        for name, leaf in leaves.items()
    }
    assert shapes_of(features, network) == expected
