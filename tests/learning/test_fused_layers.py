"""The hand-written gradients of the step beside plain formulas that autodiff takes apart."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxmm.config import Config, LossConfig, NetworkConfig
from jaxmm.learning import train_step
from jaxmm.learning.batches import Batch
from jaxmm.learning.fused_layers import CLOUDS, EPSILON, activate, dense, drop, summarise, total
from jaxmm.learning.losses import focal_loss

CONFIG = Config(network=NetworkConfig(encoder=(8, 16, 32), head=(16, 16, 8), dropout=0.3), loss=LossConfig(alpha=2.0))


def plain_loss(params, batch, config):
    """The loss of one model's clouds (B, N, F), and (mean, unbiased variance) of every normalisation.

    As the formulas stand in the papers: one array for the batch, padding left out by weights, the summary repeated.
    """
    moments, real = {}, batch.mask[..., None]
    depth = len(config.network.encoder)

    def layer(x, name, number, rate):
        x = x @ params[name]["kernel"] + jax.lax.stop_gradient(params[name]["bias"])
        norm, count = params[name.replace("conv", "bn")], jnp.sum(real)
        mean = jnp.sum(jnp.where(real, x, 0), (0, 1)) / count
        var = jnp.sum(jnp.where(real, jnp.square(x - mean), 0), (0, 1)) / count
        moments[name.replace("conv", "bn")] = mean, var * count / (count - 1)
        x = jax.nn.relu((x - mean) / jnp.sqrt(var + EPSILON) * norm["scale"] + norm["bias"])
        return jax.vmap(lambda cloud, seed: drop(cloud, rate, seed, number))(x, batch.seeds)

    x = batch.features
    for index in range(1, depth + 1):
        x = layer(x, f"conv{index}", index, config.network.dropout if index == depth else 0.0)
    x = jnp.where(real, x, 0)
    summary = jnp.take_along_axis(x, jnp.argmax(x, axis=1, keepdims=True), axis=1)
    x = jnp.concatenate([x, jnp.broadcast_to(summary, x.shape)], axis=-1)
    for index in range(1, len(config.network.head) + 1):
        x = layer(x, f"seg_conv{index}", depth + index, config.network.dropout)
    last = params[f"seg_conv{len(config.network.head) + 1}"]
    logits = (x @ last["kernel"] + last["bias"])[..., 0]
    losses = jax.vmap(lambda *cloud: focal_loss(*cloud, config.loss))(logits, batch.labels, batch.scored)
    return jnp.sum(losses.total) / jnp.sum(losses.count), moments


def random_clouds(features, dtype, far=0.0):
    """Clouds of unequal length; padding is filled with large numbers that must not matter."""
    rng = np.random.default_rng(4)
    mask = np.arange(300) < np.array([300, 180, 251])[:, None]
    values = far + rng.normal(size=(*mask.shape, features))
    values[:, 100:140] = values[:, 60:100]  # points at one place, of which one gets the maximum's gradient
    values[~mask] = 1e3
    labels, scored = rng.random(mask.shape) < 0.3, mask & (rng.random(mask.shape) < 0.9)
    return Batch(values.astype(dtype), labels, mask, scored, rng.integers(0, 2**32, 3, np.uint32))


def random_model(features, config, dtype):
    """Weights of which none is a neutral 0 or 1."""
    model = jax.jit(train_step.init_model, static_argnums=(1, 2))(jax.random.key(5), features, config.network)
    rng = np.random.default_rng(6)
    return jax.tree.map(lambda leaf: np.asarray(leaf + 0.1 * rng.normal(size=leaf.shape), dtype), jax.device_get(model))


def norm(tree):
    """Euclidean norm of all leaves."""
    return np.sqrt(sum(np.sum(np.square(leaf, dtype=np.float64)) for leaf in jax.tree.leaves(tree)))


@pytest.mark.parametrize("rate", [pytest.param(0.0, marks=pytest.mark.long), 0.3])
@pytest.mark.parametrize("dtype, tolerance", [(np.float32, 1e-5), (np.float64, 1e-9)])
def test_gradients_and_statistics_are_those_of_the_plain_formulas(dtype, tolerance, rate):
    config = dataclasses.replace(CONFIG, network=dataclasses.replace(CONFIG.network, dropout=rate))
    with jax.enable_x64(dtype == np.float64):
        batch, model = random_clouds(4, dtype), random_model(4, config, dtype)
        ours = jax.jit(
            jax.value_and_grad(lambda p: train_step.batch_loss(p, model.batch_stats, batch, config), has_aux=True)
        )
        plain = jax.jit(jax.value_and_grad(lambda p: plain_loss(p, batch, config), has_aux=True))
        (loss, stats), gradient = jax.device_get(ours(model.params))
        (expected_loss, moments), expected = jax.device_get(plain(model.params))
        total = norm(expected)
        np.testing.assert_allclose(loss, expected_loss, rtol=tolerance)
        for layer, leaves in expected.items():
            for leaf, value in leaves.items():
                assert gradient[layer][leaf].dtype == dtype
                scale = max(norm(value), 1e-3 * total)
                assert np.linalg.norm(gradient[layer][leaf] - value) <= tolerance * scale, (layer, leaf)
        for name, (mean, var) in moments.items():
            old = model.batch_stats[name]
            np.testing.assert_allclose(stats[name]["mean"], 0.9 * old["mean"] + 0.1 * mean, tolerance, tolerance)
            np.testing.assert_allclose(stats[name]["var"], 0.9 * old["var"] + 0.1 * var, tolerance, tolerance)


def test_large_means_cost_few_digits():
    """Of values with mean 1000 and deviation 1, float32 leaves four digits; E[x^2] - E[x]^2 would leave none."""
    rng = np.random.default_rng(1)
    x, slope = 1000 + rng.normal(size=(2, 500, 6)), rng.normal(size=(2, 500, 6))
    x = x.astype(np.float32).astype(np.float64)  # what float32 cannot hold of the input is no part of the difference

    def both(dtype):
        vectors = jnp.full(6, 1.2, dtype), jnp.full(6, 0.1, dtype)

        def one(x, *vectors):
            return activate(0.0, 1, x, jnp.ones(500, bool), *vectors, jnp.uint32(0))[0]

        over_clouds = jax.vmap(one, (0, None, None), axis_name=CLOUDS)

        @jax.jit
        def with_slopes(x, slope):
            y, pull = jax.vjp(over_clouds, x, *vectors)
            return y, *pull(slope)

        return jax.device_get(with_slopes(np.asarray(x, dtype), np.asarray(slope, dtype)))

    with jax.enable_x64(True):
        expected = both(np.float64)
    for found, value in zip(both(np.float32), expected, strict=True):
        assert np.linalg.norm(found - value) < 2e-3 * np.linalg.norm(value)


@pytest.mark.parametrize("count", [1, 2, 7, 60, 64])
def test_gradient_of_a_maximum_goes_to_its_first_point(count):
    y = np.random.default_rng(count).integers(0, 9, (count, 5)).astype(np.float32)  # many points share a value
    summary, pull = jax.vjp(summarise, jnp.asarray(y))
    np.testing.assert_array_equal(summary, y.max(0))
    slope = np.arange(1, 6, dtype=np.float32)
    expected = np.zeros_like(y)
    expected[y.argmax(0), np.arange(5)] = slope
    np.testing.assert_array_equal(pull(jnp.asarray(slope))[0], expected)


@pytest.mark.parametrize("axes", [(0, None), (None, 0), (0, 0)])
def test_dense_is_a_product_under_every_vmap(axes):
    rng = np.random.default_rng(0)
    points = jnp.asarray(rng.normal(size=(3, 20, 5)[axes[0] is None :]))
    kernel = jnp.asarray(rng.normal(size=(3, 5, 7)[axes[1] is None :]))
    found = jax.vmap(dense, axes)(points, kernel)
    np.testing.assert_allclose(found, jax.vmap(jnp.matmul, axes)(points, kernel), rtol=1e-5)


def test_step_repeats_to_the_bit():
    state = jax.jit(train_step.init, static_argnums=(1, 2))(jax.random.key(0), 4, CONFIG)
    batch = random_clouds(4, np.float32)
    step = jax.jit(train_step.train_step, static_argnames="config")
    first, second = step(state, batch, CONFIG), step(state, batch, CONFIG)
    jax.tree.map(np.testing.assert_array_equal, first, second)


def test_activations_need_the_axis_of_clouds():
    network = train_step.PointNetwork(CONFIG.network)
    model = random_model(4, CONFIG, np.float32)
    arguments = jnp.zeros((5, 4)), jnp.ones(5, bool)
    with pytest.raises(NameError, match=CLOUDS):
        network.apply(
            {"params": model.params, "batch_stats": model.batch_stats},
            *arguments,
            train=True,
            seed=jnp.uint32(0),
            mutable=["batch_stats"],
        )


@pytest.mark.parametrize("count", [1, 2, 3, 7, 333, 4096])
def test_total_is_the_sum_in_an_order_of_its_own(count):
    x = np.random.default_rng(count).normal(size=count).astype(np.float32)
    halves = x
    while len(halves) > 1:  # the order by hand: what has no partner meets a zero
        half = -(-len(halves) // 2)
        halves = halves[:half] + np.pad(halves[half:], (0, 2 * half - len(halves)))
    found, slope = jax.value_and_grad(total)(x)
    assert found == halves[0]
    np.testing.assert_allclose(found, np.sum(x, dtype=np.float64), atol=1e-6 * count)
    assert (slope == 1).all()
