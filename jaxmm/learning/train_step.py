"""Training of the four scenario models: written for one model, stacked over scenarios, one jitted step for all.

Axes: S scenarios (leading axis of every leaf of a stacked state), B clouds, N points, F features.
"""

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import optax

from jaxmm.config import Config, NetworkConfig, TrainConfig
from jaxmm.learning.batches import Batch
from jaxmm.learning.fused_layers import CLOUDS, total
from jaxmm.learning.losses import LossSum, focal_loss
from jaxmm.learning.model import Model, Offset
from jaxmm.learning.network import PointNetwork, norm_of
from jaxmm.rays.rule import rule_logits

# Of XLA's CPU backend: with as many threads, among which it splits long sums, the same bits on every x86-64 processor
# with AVX2 (tests/learning/test_same_anywhere.py). No option has a promise to stay, so other versions than the measured
# one keep their defaults.
COMPILER_OPTIONS = {"xla_cpu_enable_platform_dependent_math": False} if jax.__version_info__[:2] == (0, 10) else None


class TrainState(NamedTuple):
    """One model in training, or all of them stacked on axis 0."""

    model: Model
    opt_state: optax.OptState
    average: Model | None = None  # running average of the weights and statistics so far; None: not kept

    @property
    def shown(self) -> Model:
        """What is validated, and kept in the end."""
        return self.model if self.average is None else self.average


class Validation(NamedTuple):
    """How a model does on validation clouds; (S,) when stacked."""

    loss: jax.Array  # mean focal loss over scored points [nat]
    precision: jax.Array  # at the evaluation threshold; nan when nothing is predicted
    recall: jax.Array  # nan when there are no positives


def optimizer(config: TrainConfig) -> optax.GradientTransformation:
    """Adam with L2 weight decay added to the gradient before the moments, as torch's Adam does it."""
    rate = config.learning_rate
    if config.schedule == "cosine":
        rate = optax.cosine_decay_schedule(rate, config.step_count)
    return optax.chain(optax.add_decayed_weights(config.weight_decay, mask=_decays), optax.adam(rate))


def _decays(params: Any) -> Any:
    """Which leaves decay: all but the biases that a normalisation cancels, for those have no gradient of their own.

    Adam would turn even the smallest decay into steps of full size, which the running means then lag behind.
    """
    return {
        layer: {leaf: leaf != "bias" or layer == norm_of(layer) or norm_of(layer) not in params for leaf in leaves}
        for layer, leaves in params.items()
    }


def init_model(key: jax.Array, feature_count: int, config: NetworkConfig) -> Model:
    """Fresh weights of one model."""
    features, mask = jnp.zeros((1, feature_count)), jnp.ones(1, bool)
    variables = PointNetwork(config).init(key, features, mask, train=False)
    return Model(variables["params"], variables["batch_stats"])


def init(key: jax.Array, feature_count: int, config: Config, rule: Offset | None = None) -> TrainState:
    """Fresh state of one model; with a rule its network does not yet correct it."""
    model = init_model(key, feature_count, config.network)
    if rule is not None:
        last = f"seg_conv{len(config.network.head) + 1}"
        silent = jax.tree.map(jnp.zeros_like, model.params[last])
        model = model._replace(params=model.params | {last: silent}, offset=rule)
    return started(model, config)


def started(model: Model, config: Config) -> TrainState:
    """The state in which the training of a model begins; an average starts from its first weights."""
    average = jax.tree.map(jnp.copy, model) if config.train.average else None
    return TrainState(model, optimizer(config.train).init(model.params), average)


def batch_loss(
    params: Any, batch_stats: Any, batch: Batch, config: Config, rule: Offset | None = None
) -> tuple[jax.Array, Any]:
    """Mean focal loss [nat] over the scored points of one model's clouds, and the updated running statistics."""
    network = PointNetwork(config.network)

    def one_cloud(features, mask, seed):
        variables = {"params": params, "batch_stats": batch_stats}
        return network.apply(variables, features, mask, train=True, seed=seed, mutable=["batch_stats"])

    # Statistics are sums over the named axis, hence the same for every cloud: out_axes None takes them once.
    over_clouds = jax.vmap(one_cloud, axis_name=CLOUDS, out_axes=(0, None))
    logits, updated = over_clouds(batch.features, batch.mask, batch.seeds)
    logits = _corrected(logits, batch.features, rule)
    losses = jax.vmap(partial(focal_loss, config=config.loss))(logits, batch.labels, batch.scored)
    return _mean(losses), updated["batch_stats"]


def train_step(state: TrainState, batch: Batch, config: Config) -> tuple[TrainState, jax.Array]:
    """One gradient step of one model (batch without the S axis). Pure: same inputs, same outputs."""
    model, opt_state, average = state
    of_loss = jax.value_and_grad(batch_loss, has_aux=True)
    (loss, batch_stats), gradient = of_loss(model.params, model.batch_stats, batch, config, model.offset)
    updates, opt_state = optimizer(config.train).update(gradient, opt_state, model.params)
    model = model._replace(params=optax.apply_updates(model.params, updates), batch_stats=batch_stats)
    if average is not None:
        average = _averaged(average, model, config.train.average)
    return TrainState(model, opt_state, average), loss


def _averaged(average: Model, model: Model, kept: float) -> Model:
    """One step of the running average of all that changes."""

    def mixed(old: Any, new: Any) -> Any:
        return jax.tree.map(lambda a, b: kept * a + (1 - kept) * b, old, new)

    return model._replace(
        params=mixed(average.params, model.params), batch_stats=mixed(average.batch_stats, model.batch_stats)
    )


def validate(model: Model, batch: Batch, config: Config) -> Validation:
    """Loss, precision and recall of one model on its validation clouds, one cloud after the other to save memory."""

    def one_cloud(cloud: Batch):
        logits = logits_of(model, cloud.features, cloud.mask, config.network)
        found = (jax.nn.sigmoid(logits) >= config.evaluate.threshold) & cloud.scored
        positive = cloud.labels & cloud.scored
        hits = jnp.sum(found & positive)
        return focal_loss(logits, cloud.labels, cloud.scored, config.loss), hits, found.sum(), positive.sum()

    losses, hits, found, positives = jax.lax.map(one_cloud, batch)
    return Validation(_mean(losses), hits.sum() / found.sum(), hits.sum() / positives.sum())


def logits_of(model: Model, features: jax.Array, mask: jax.Array, config: NetworkConfig) -> jax.Array:
    """Logits (N,) of one cloud, by running statistics and without dropout."""
    variables = {"params": model.params, "batch_stats": model.batch_stats}
    logits = PointNetwork(config).apply(variables, features, mask, train=False)
    return _corrected(logits, features, model.offset)


def _corrected(logits: jax.Array, features: jax.Array, rule: Offset | None) -> jax.Array:
    """The network's logits (..., N), as a correction of the rule's where there are such."""
    return logits if rule is None else logits + rule.scale * rule_logits(features, rule.removed, jnp)


@partial(jax.jit, static_argnames=("feature_count", "config", "count"))
def init_all(
    key: jax.Array, feature_count: int, config: Config, count: int = 4, rule: Offset | None = None
) -> TrainState:
    """States of all S models, stacked, as is the rule (S,)."""
    one = partial(init, feature_count=feature_count, config=config)
    return jax.vmap(lambda own, offset: one(own, rule=offset))(jax.random.split(key, count), rule)


@partial(jax.jit, static_argnames="config", donate_argnames="states", compiler_options=COMPILER_OPTIONS)
def train_step_all(states: TrainState, batch: Batch, config: Config) -> tuple[TrainState, jax.Array]:
    """One step of all S models; losses (S,). Equal to S separate train_step calls."""
    step = partial(train_step, config=config)
    if config.train.map_models == "vmap":
        return jax.vmap(step)(states, batch)
    # One model after the other inside the step needs the memory of one model's activations, not of S.
    return jax.lax.map(lambda one: step(*one), (states, batch))


@partial(jax.jit, static_argnames="config", compiler_options=COMPILER_OPTIONS)
def validate_all(models: Model, batch: Batch, config: Config) -> Validation:
    """Validation of all S models."""
    return jax.lax.map(lambda one: validate(*one, config), (models, batch))


@partial(jax.jit, static_argnames="config", compiler_options=COMPILER_OPTIONS)
def probabilities(model: Model, features: jax.Array, mask: jax.Array, config: NetworkConfig) -> jax.Array:
    """Probability (N,) that each point of one cloud belongs to the model's mismatch."""
    logits = logits_of(model, features, mask, config)
    if model.calibration is not None:
        logits = jnp.interp(logits, model.calibration.logit, model.calibration.calibrated)
    return jax.nn.sigmoid(logits)


@partial(jax.jit, static_argnames="config", compiler_options=COMPILER_OPTIONS)
def all_logits(models: Model, batch: Batch, config: NetworkConfig) -> jax.Array:
    """Logits (S, B, N) of all models on their clouds, one cloud after the other to save memory."""

    def one_model(model: Model, clouds: Batch):
        return jax.lax.map(lambda cloud: logits_of(model, cloud.features, cloud.mask, config), clouds)

    return jax.lax.map(lambda one: one_model(*one), (models, batch))


def _mean(losses: LossSum) -> jax.Array:
    return total(losses.total) / jnp.maximum(jnp.sum(losses.count), 1)
