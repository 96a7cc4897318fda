"""Joint training of models with other features, labels and clouds is what each of their trainings is alone."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxmm.config import SCENARIOS, TRAINED_METHODS, Config, NetworkConfig, TrainConfig
from jaxmm.learning import train_step
from jaxmm.learning.batches import LabelledCloud, Sampler, validation_batch
from jaxmm.learning.fit import fit
from jaxmm.learning.joint_training import Entry, Joint, stacked
from jaxmm.learning.room_scores import predict

CONFIG = Config(
    network=NetworkConfig((4,), (4,), 0.2),
    train=TrainConfig(
        step_count=6, batch_size=2, points_per_cloud=40, learning_rate=3e-3, validate_every=3, patience=0
    ),
)


def clouds(seed, count):
    """Clouds of unequal length whose positives have larger distances, and whose two kinds of labels differ."""
    rng = np.random.default_rng(seed)
    made = []
    for _ in range(count):
        size = int(rng.integers(20, 90))
        label, wrong = rng.random(size) < 0.3, rng.random(size) < 0.1
        distance = (rng.exponential(0.1, size) + 0.2 * label).astype(np.float32)
        points = rng.normal(size=(size, 3)).astype(np.float32)
        nothing = np.zeros((size, 0), np.float32)
        made.append(LabelledCloud(points, distance, np.zeros(size, np.int32), label ^ wrong, label, label, nothing))
    return made


def entry(name, scenario, method, labels="true", copies=1, count=5):
    held_out = clouds(100 + count, count - 2)
    return Entry(name, scenario, method, labels, copies, clouds(SCENARIOS.index(scenario), count), held_out)


ENTRIES = (
    entry("xyz_nn", "pillar_added", "xyz_nn", copies=4),
    entry("nn", "pillar_removed", "nn"),
    entry("xyz", "pillar_removed", "xyz", copies=4, count=3),
    entry("nn_heuristic", "wall_removed", "nn", labels="heuristic", count=4),
)


def joint(entries=ENTRIES):
    shape = CONFIG.train.batch_size, CONFIG.train.points_per_cloud
    return Joint(entries, "joint", *shape, CONFIG.seed)


def pick(tree, row):
    return jax.tree.map(lambda leaf: leaf[row], tree)


def doubled(tree):
    return jax.tree.map(lambda leaf: leaf.astype(jnp.float64) if leaf.dtype == jnp.float32 else leaf, tree)


@pytest.mark.long
def test_steps_of_widened_models_are_those_of_the_models_alone():
    """In float64, to 1e-9 after 20 steps, with each model's own number of features."""
    entries = ENTRIES[:2]
    with jax.enable_x64(True):
        states = doubled(joint(entries).states(CONFIG))
        alone = [doubled(joint((one,)).states(CONFIG)) for one in entries]
        for step in range(20):
            batch = joint(entries).batch(step)
            batch = batch._replace(features=batch.features.astype(np.float64))
            states, losses = train_step.train_step_all(states, batch, CONFIG)
            for row, one in enumerate(entries):
                own = joint((one,)).batch(step)
                assert own.features.shape[-1] == TRAINED_METHODS[one.method]
                own = own._replace(features=own.features.astype(np.float64))
                alone[row], loss = train_step.train_step_all(alone[row], own, CONFIG)
                np.testing.assert_allclose(losses[row], loss[0], rtol=1e-9)
        found = joint(entries).models(states.model)
        for row, one in enumerate(entries):
            expected = joint((one,)).models(alone[row].model)[f"{one.name}/{one.scenario}"]
            both = found[f"{one.name}/{one.scenario}"], expected
            jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=0, atol=1e-9), *both)
            absent = states.model.params["conv1"]["kernel"][row, TRAINED_METHODS[one.method] :]
            assert not np.any(absent)


@pytest.mark.long
def test_whole_trainings_are_the_same_together_and_alone(tmp_path):
    """Batches, validation, choice of the best weights: the model that comes out predicts the same."""
    both = joint(ENTRIES[1:3])
    best, records = fit(both, both.validation(), CONFIG, tmp_path / "joint", lambda *_: None)
    together = both.models(best)
    assert set(together) == {"nn/pillar_removed", "xyz/pillar_removed"}
    for row, one in enumerate(both.entries):
        name, own = f"{one.name}/{one.scenario}", joint((one,))
        best, told = fit(own, own.validation(), CONFIG, tmp_path / name, lambda *_: None)
        for a, b in zip(records, told, strict=True):
            np.testing.assert_allclose(a["validation_loss"][row], b["validation_loss"][0], rtol=1e-4)
        features = np.random.default_rng(0).normal(size=(50, TRAINED_METHODS[one.method])).astype(np.float32)
        found = [predict(model, features, CONFIG.network) for model in (together[name], own.models(best)[name])]
        np.testing.assert_allclose(*found, atol=1e-4)


def test_entries_draw_what_the_four_models_of_a_method_draw():
    """With the same seed, an entry of the joint training sees the batches of `jaxmm train`, in the same order."""
    four = [clouds(number, 4) for number in range(4)]
    shape = CONFIG.train.batch_size, CONFIG.train.points_per_cloud
    sampler = Sampler(four, "xyz_nn", "true", *shape, 4, 0)
    entries = tuple(Entry("a", name, "xyz_nn", "true", 4, four[i], four[i]) for i, name in enumerate(SCENARIOS))
    for step in (0, 7):
        expected, found = sampler.batch(step), joint(entries).batch(step)
        for a, b in zip(expected, found, strict=True):
            np.testing.assert_array_equal(a, b)
    for a, b in zip(validation_batch(four, "xyz_nn", "true", shape[1]), joint(entries).validation(), strict=True):
        np.testing.assert_array_equal(a, b)


def test_parts_are_what_hosts_share_out():
    whole = joint().batch(3)
    parts = [joint().part(3, range(slot, slot + 1)) for slot in range(2)]
    for field, *shares in zip(whole, *parts, strict=True):
        np.testing.assert_array_equal(np.concatenate(shares, axis=1), field)


def test_padding_is_masked():
    batch = joint().validation()
    counts = [len(one.validation) for one in ENTRIES]
    assert batch.mask.shape[:2] == (4, max(counts))
    for row, count in enumerate(counts):
        assert batch.mask[row, :count].any(axis=1).all() and not batch.mask[row, count:].any()
        assert not batch.features[row, ..., TRAINED_METHODS[ENTRIES[row].method] :].any()
        assert not batch.scored[row, count:].any()
    with pytest.raises(ValueError):
        stacked([])


def test_ablations_start_from_the_same_weights():
    states = joint((ENTRIES[1], ENTRIES[1]._replace(name="nn_augmented", copies=4))).states(CONFIG)
    jax.tree.map(np.testing.assert_array_equal, pick(states, 0), pick(states, 1))
    other = joint((ENTRIES[1],)).states(dataclasses.replace(CONFIG, seed=1))
    assert np.any(other.model.params["conv1"]["kernel"][0] != states.model.params["conv1"]["kernel"][0])
