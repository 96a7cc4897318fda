import dataclasses
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxmm.config import Config, NetworkConfig, TrainConfig
from jaxmm.learning import train_step
from jaxmm.learning.batches import Batch

CONFIG = Config(
    network=NetworkConfig(encoder=(8, 16, 32), head=(16, 8), dropout=0.3),
    train=TrainConfig(learning_rate=3e-3, batch_size=3),
)
MODES = ("map", "vmap")
# Compiled once for all tests; how several models are joined is no setting of a single one.
init_all = partial(train_step.init_all, config=CONFIG)
step_of_one = jax.jit(train_step.train_step, static_argnames="config")
loss_of_one = jax.jit(train_step.batch_loss, static_argnames="config")
gradient_of_one = jax.jit(
    jax.grad(lambda params, stats, clouds: train_step.batch_loss(params, stats, clouds, CONFIG)[0])
)


def in_mode(mode, config=CONFIG):
    return dataclasses.replace(config, train=dataclasses.replace(config.train, map_models=mode))


def pick(tree, index):
    return jax.tree.map(lambda leaf: np.asarray(leaf)[index], tree)


def random_batch(step, features=1, scenarios=4, clouds=3, points=70):
    """Clouds of unequal length whose positives have larger features."""
    rng = np.random.default_rng([9, step])
    labels = rng.random((scenarios, clouds, points)) < 0.2
    values = rng.exponential(0.05, (*labels.shape, features)) + 0.3 * labels[..., None]
    mask = np.arange(points) < rng.integers(points // 2, points + 1, (scenarios, clouds))[..., None]
    seeds = rng.integers(0, 2**32, (scenarios, clouds), np.uint32)
    return Batch(values.astype(np.float32), labels & mask, mask, mask, seeds)


def largest_difference(a, b):
    return max(jax.tree.leaves(jax.tree.map(lambda x, y: float(np.max(np.abs(np.asarray(x) - y))), a, b)))


@pytest.mark.parametrize("mode", MODES)
def test_joint_training_is_four_separate_trainings(mode):
    """In float64, to 1e-9 after 20 steps: nothing of one model may leak into another."""
    config = in_mode(mode)
    with jax.enable_x64(True):
        states = jax.tree.map(
            lambda leaf: jnp.asarray(np.asarray(leaf, np.float64 if leaf.dtype == np.float32 else leaf.dtype)),
            init_all(jax.random.key(0), 1),
        )
        separate = [pick(states, index) for index in range(4)]
        for step in range(20):
            batch = random_batch(step)
            batch = batch._replace(features=batch.features.astype(np.float64))
            states, losses = train_step.train_step_all(states, batch, config)
            for index in range(4):
                separate[index], loss = step_of_one(separate[index], pick(batch, index), CONFIG)
                np.testing.assert_allclose(losses[index], loss, rtol=1e-9)
        assert jax.tree.leaves(states.model.params)[0].dtype == jnp.float64
        for index in range(4):
            assert largest_difference(pick(states, index), separate[index]) < 1e-9


@pytest.mark.long
@pytest.mark.parametrize("mode", MODES)
def test_joint_gradients_in_float32(mode):
    # Four features: with one, normalisation cancels the scale of the first kernel and its gradient is mostly rounding.
    batch = random_batch(0, features=4)
    states = init_all(jax.random.key(1), 4)
    if mode == "vmap":
        joint = jax.vmap(gradient_of_one)(*states.model[:2], batch)
    else:
        joint = jax.lax.map(lambda one: gradient_of_one(*one), (*states.model[:2], batch))
    for index in range(4):
        alone = gradient_of_one(*pick(states.model, index)[:2], pick(batch, index))
        assert norm(jax.tree.map(np.subtract, pick(joint, index), alone)) / norm(alone) < 1e-5


def norm(tree):
    """Euclidean norm of all leaves."""
    return np.sqrt(sum(np.sum(np.square(leaf, dtype=np.float64)) for leaf in jax.tree.leaves(tree)))


def test_training_finds_the_changed_points_and_compiles_once():
    network = dataclasses.replace(CONFIG.network, dropout=0.0)  # which a network this narrow would need long to bear
    config = in_mode("map", dataclasses.replace(CONFIG, network=network))
    states = init_all(jax.random.key(0), 4)
    before = train_step.validate_all(states.model, random_batch(1000, features=4), config)
    compiled = train_step.train_step_all._cache_size()
    for step in range(200):
        states, _ = train_step.train_step_all(states, random_batch(step, features=4), config)
    assert train_step.train_step_all._cache_size() == compiled + 1  # once for one shape
    after = train_step.validate_all(states.model, random_batch(1000, features=4), config)
    assert (after.loss < 0.3 * before.loss).all()
    assert (after.precision > 0.9).all() and (after.recall > 0.9).all()


def test_validation_counts_as_numpy_does():
    config, batch = CONFIG, random_batch(5)
    models = init_all(jax.random.key(3), 1).model
    result = train_step.validate_all(models, batch, config)
    for index in range(4):
        model = pick(models, index)
        found, label = [], []
        for cloud in range(3):
            real = batch.mask[index, cloud]
            p = train_step.probabilities(model, batch.features[index, cloud], real, config.network)
            found.append(np.asarray(p)[real] >= config.evaluate.threshold)
            label.append(batch.labels[index, cloud][real])
        found, label = np.concatenate(found), np.concatenate(label)
        hits = (found & label).sum()
        np.testing.assert_allclose(result.recall[index], hits / label.sum())
        np.testing.assert_allclose(result.precision[index], hits / found.sum() if found.sum() else np.nan)


def test_steps_agree_with_torch():
    """Network, loss and Adam with weight decay against torch autograd: losses of ten steps, no dropout, no padding."""
    torch = pytest.importorskip("torch", reason="torch is an extra (peers)")
    config = dataclasses.replace(CONFIG, network=NetworkConfig((8, 16), (12,), dropout=0.0))
    state = jax.jit(train_step.init, static_argnums=(1, 2))(jax.random.key(0), 4, config)
    model = torch_model(torch, state.model.params)
    adam = torch.optim.Adam(model.parameters(), config.train.learning_rate, weight_decay=config.train.weight_decay)
    for step in range(10):
        batch = pick(random_batch(step, features=4), 0)
        batch = batch._replace(mask=np.ones_like(batch.mask), scored=np.ones_like(batch.mask))
        state, ours = step_of_one(state, batch, config)
        logits = model(torch.from_numpy(batch.features.transpose(0, 2, 1)))
        labels = torch.from_numpy(batch.labels.astype(np.float32))
        entropy = torch.nn.functional.binary_cross_entropy_with_logits(logits, labels, reduction="none")
        theirs = (config.loss.alpha * (1 - torch.exp(-entropy)) ** config.loss.gamma * entropy).mean()
        adam.zero_grad()
        theirs.backward()
        adam.step()
        np.testing.assert_allclose(ours, theirs.item(), rtol=1e-4)
    # Running variances only: means carry the biases before normalisation, which torch moves at random (see Dense).
    for name, moments in state.model.batch_stats.items():
        expected = model.state_dict()[f"{name}.running_var"].numpy()
        np.testing.assert_allclose(moments["var"], expected, rtol=1e-3)


def torch_model(torch, params):
    """The small network of the test above in torch, with the same initial weights."""
    nn = torch.nn

    class Witness(nn.Module):
        def __init__(self):
            super().__init__()
            self.conv1, self.conv2 = nn.Conv1d(4, 8, 1), nn.Conv1d(8, 16, 1)
            self.bn1, self.bn2, self.seg_bn1 = nn.BatchNorm1d(8), nn.BatchNorm1d(16), nn.BatchNorm1d(12)
            self.seg_conv1, self.seg_conv2 = nn.Conv1d(32, 12, 1), nn.Conv1d(12, 1, 1)

        def forward(self, x):
            x = torch.relu(self.bn2(self.conv2(torch.relu(self.bn1(self.conv1(x))))))
            x = torch.cat([x, x.max(2, keepdim=True)[0].expand_as(x)], 1)
            return self.seg_conv2(torch.relu(self.seg_bn1(self.seg_conv1(x))))[:, 0]

    model = Witness()
    with torch.no_grad():
        for name in ("conv1", "conv2", "seg_conv1", "seg_conv2"):
            kernel = np.array(params[name]["kernel"]).T[:, :, None]
            getattr(model, name).weight.copy_(torch.from_numpy(kernel))
            getattr(model, name).bias.copy_(torch.from_numpy(np.array(params[name]["bias"])))
    return model


def test_void_points_reach_the_statistics_but_not_the_loss():
    batch = random_batch(4, features=4)
    model = pick(init_all(jax.random.key(2), 4).model, 0)
    validate = jax.jit(train_step.validate, static_argnames="config")
    void = batch.mask & (np.random.default_rng(0).random(batch.mask.shape) < 0.3)
    flipped = batch._replace(labels=batch.labels ^ void)
    for scored, alike in ((batch.mask & ~void, True), (batch.mask, False)):
        clouds = [pick(b._replace(scored=scored), 0) for b in (batch, flipped)]
        pair = [loss_of_one(*model[:2], b, config=CONFIG) for b in clouds]
        assert np.allclose(pair[0][0], pair[1][0], rtol=1e-6) == alike
        validations = [validate(model, b, config=CONFIG) for b in clouds]
        assert np.allclose(validations[0].loss, validations[1].loss, rtol=1e-6) == alike


def test_biases_that_a_normalisation_cancels_keep_still():
    state = pick(init_all(jax.random.key(0), 1), 0)
    after, _ = step_of_one(state, pick(random_batch(0), 0), CONFIG)
    for layer, before in state.model.params.items():
        moved = {leaf: largest_difference(before[leaf], after.model.params[layer][leaf]) > 0 for leaf in before}
        cancelled = "conv" in layer and layer != "seg_conv3"
        assert moved == {leaf: not (leaf == "bias" and cancelled) for leaf in before}, layer


def test_the_running_average_is_the_sum_that_its_formula_says():
    """After n steps: kept^n times the first weights, and (1 - kept) kept^(n - k) times those after step k."""
    kept, count = 0.8, 6
    config = dataclasses.replace(CONFIG, train=dataclasses.replace(CONFIG.train, average=kept))
    states = init_all(jax.random.key(0), 1, config=config)
    plain = init_all(jax.random.key(0), 1)
    expected = jax.tree.map(lambda leaf: kept**count * np.asarray(leaf, np.float64), states.model)
    for step in range(1, count + 1):
        batch = random_batch(step)
        states, _ = train_step.train_step_all(states, batch, config)
        plain, _ = train_step.train_step_all(plain, batch, CONFIG)
        share = (1 - kept) * kept ** (count - step)
        expected = jax.tree.map(lambda sum_, leaf, w=share: sum_ + w * np.asarray(leaf), expected, states.model)
    assert largest_difference(states.model, plain.model) < 1e-6  # it only looks on
    assert largest_difference(states.average, expected) < 1e-6
    assert largest_difference(states.average, states.model) > 1e-3
    assert states.shown is states.average and plain.shown is plain.model
