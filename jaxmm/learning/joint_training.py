"""Trainings that share shapes as more entries of the model axis: other features, other labels, other rooms, one step.

An entry is one model: a Sampler of one scenario. What it draws, starts from and learns is its own, so that an entry of
a joint training equals its training alone (tests/learning/test_joint_training.py). Entries with fewer features than the
widest see zeros in the channels that they lack, and the rows of the first kernel that would weigh those are zero and
stay zero: their gradient is zero, and so is their decay.

Axes: S entries, B clouds, N points, F features of the widest entry.
"""

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxmm.config import SCENARIOS, TRAINED_METHODS, Config
from jaxmm.learning.batches import Batch, LabelledCloud, Sampler, validation_batch
from jaxmm.learning.model import Model, Offset, offset_of
from jaxmm.learning.train_step import TrainState, init_all, started

FIRST = "conv1"  # the only layer whose kernel knows the number of features


class Entry(NamedTuple):
    """One model among those that are trained together."""

    name: str  # of its training; with the scenario it is unique
    scenario: str
    method: str  # key of config.TRAINED_METHODS: its features
    labels: str  # see batches.labels_of
    copies: int  # 4 with the augmented copies of each cloud, else 1
    training: Sequence[LabelledCloud]
    validation: Sequence[LabelledCloud]

    @property
    def number(self) -> int:
        """Of its scenario."""
        return SCENARIOS.index(self.scenario)


class Joint(NamedTuple):
    """Draws the batches of all entries; to `fit` and `loading.batches` what a Sampler of one method is."""

    entries: tuple[Entry, ...]
    method: str  # what its records are called
    batch_size: int  # clouds a step and entry
    point_count: int
    seed: int

    @property
    def clouds(self) -> list[Sequence[LabelledCloud]]:
        """Training clouds by entry."""
        return [entry.training for entry in self.entries]

    def batch(self, step: int) -> Batch:
        """The batch of training step `step`, counted from 0."""
        return self.part(step, range(self.batch_size))

    def part(self, step: int, slots: range) -> Batch:
        """Some neighbouring slots of that batch."""
        return stacked([self._sampler(entry).part(step, slots) for entry in self.entries])

    def _sampler(self, entry: Entry) -> Sampler:
        shape = (self.batch_size, self.point_count)
        return Sampler([entry.training], entry.method, entry.labels, *shape, entry.copies, self.seed, (entry.number,))

    def validation(self) -> Batch:
        """All validation clouds of all entries."""
        return stacked(
            [
                validation_batch([entry.validation], entry.method, entry.labels, self.point_count, (entry.number,))
                for entry in self.entries
            ]
        )

    def states(self, config: Config) -> TrainState:
        """Fresh states (S, ...): each entry's weights are drawn for its own features, then widened."""
        width = max(TRAINED_METHODS[entry.method] for entry in self.entries)
        models = [_fresh(entry, config, width) for entry in self.entries]
        if any(model.offset for model in models):  # where one corrects the rule, the others correct nothing
            nothing = Offset(jnp.zeros(()), jnp.zeros(()))
            models = [model._replace(offset=model.offset or nothing) for model in models]
        model = jax.tree.map(lambda *leaves: jnp.stack(leaves), *models)
        return jax.vmap(partial(started, config=config))(model)

    def models(self, joint: Model) -> dict[str, Model]:
        """Trained models by `<name>/<scenario>`, each with its own number of features again."""
        found = {}
        for row, entry in enumerate(self.entries):
            own = jax.tree.map(lambda leaf, row=row: np.asarray(leaf[row]), joint)
            if own.offset is not None and not own.offset.scale:
                own = own._replace(offset=None)
            found[f"{entry.name}/{entry.scenario}"] = _resized(own, TRAINED_METHODS[entry.method])
        return found


def stacked(batches: Sequence[Batch]) -> Batch:
    """Batches behind each other on axis 0: padded with masked clouds to the most, with zero features to the widest."""
    clouds = max(batch.mask.shape[1] for batch in batches)
    width = max(batch.features.shape[3] for batch in batches)

    def padded(array: np.ndarray) -> np.ndarray:
        more = [(0, 0)] * array.ndim
        more[1] = (0, clouds - array.shape[1])
        if array.ndim == 4:
            more[3] = (0, width - array.shape[3])
        return np.pad(array, more)

    return Batch(*(np.concatenate([padded(field) for field in fields]) for fields in zip(*batches, strict=True)))


def _fresh(entry: Entry, config: Config, width: int) -> Model:
    """First weights; they depend on seed, features and scenario alone, so that ablations start from the same."""
    key = jax.random.fold_in(jax.random.key(config.seed), list(TRAINED_METHODS).index(entry.method))
    key = jax.random.fold_in(key, entry.number)
    rule = offset_of(entry.method, (entry.number,), config.train)
    states = init_all(key, TRAINED_METHODS[entry.method], config, 1, rule)
    return _resized(jax.tree.map(lambda leaf: leaf[0], states.model), width)


def _resized(model: Model, features: int) -> Model:
    """The model with so many features: rows of the first kernel cut off, or added as zeros."""
    kernel = model.params[FIRST]["kernel"][:features]
    kernel = jnp.pad(kernel, [(0, features - len(kernel)), (0, 0)])
    return model._replace(params=model.params | {FIRST: model.params[FIRST] | {"kernel": kernel}})
