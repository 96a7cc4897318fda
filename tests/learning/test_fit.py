"""Training to the end: it resumes to the bit, and each model stops and keeps its best weights on its own."""

import dataclasses
import itertools
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxmm.config import Config, NetworkConfig, TrainConfig
from jaxmm.learning.batches import LabelledCloud, Sampler, validation_batch
from jaxmm.learning.fit import Progress, fit, keep_best
from jaxmm.learning.model import Model
from jaxmm.learning.train_step import TrainState, Validation, validate_all

CONFIG = Config(
    network=NetworkConfig((4, 8), (4,), 0.1),
    train=TrainConfig(
        methods=("nn",), step_count=13, batch_size=2, points_per_cloud=24, learning_rate=0.01, validate_every=3,
        patience=5,
    ),
)  # fmt: skip


def clouds(seed):
    """Two scenarios of three clouds whose positives have larger distances."""
    rng = np.random.default_rng(seed)
    made = []
    for _ in range(6):
        label = rng.random(30) < 0.3
        distance = (rng.exponential(0.1, 30) + 0.2 * label).astype(np.float32)
        points = rng.normal(size=(30, 3)).astype(np.float32)
        made.append(LabelledCloud(points, distance, np.zeros(30, np.int32), label, label, label, np.zeros((30, 0))))
    return [made[:3], made[3:]]


def run(folder, report=lambda step, records: None, config=None):
    config = config or CONFIG
    train = config.train
    sampler = Sampler(clouds(0), "nn", train.labels, train.batch_size, train.points_per_cloud, 1, config.seed)
    held_out = validation_batch(clouds(1), "nn", train.labels, train.points_per_cloud)
    return (*fit(sampler, held_out, config, folder, report), held_out)


def assert_same(a, b):
    jax.tree.map(np.testing.assert_array_equal, a, b)


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    folder = tmp_path_factory.mktemp("fit")
    return (*run(folder), folder)


@pytest.mark.long
def test_records_tell_each_validation_of_each_model(undisturbed):
    _, records, _, _ = undisturbed
    assert [record["step"] for record in records] == [3, 6, 9, 12, 13]  # the end has its own
    for record in records:
        assert set(record) == {
            "method", "step", "train_loss", "validation_loss", "validation_precision", "validation_recall"
        }  # fmt: skip
        assert record["method"] == "nn" and [len(record[name]) for name in list(record)[2:]] == [2] * 4
        assert record["train_loss"][0] != record["train_loss"][1]


def test_the_best_weights_are_those_of_least_validation_loss(undisturbed):
    best, records, held_out, _ = undisturbed
    least = np.min([record["validation_loss"] for record in records], axis=0)
    np.testing.assert_allclose(validate_all(best, held_out, CONFIG).loss, least, rtol=1e-6)
    assert least.tolist() != records[-1]["validation_loss"]  # not simply the last weights


class Killed(Exception):
    """Stands for the end of a process."""


@pytest.mark.parametrize("at", [1, 3, 5, 13])
def test_an_interrupted_run_goes_on_to_the_same_bits(tmp_path, undisturbed, at):
    best, records, _, _ = undisturbed

    def stop(step, records):
        if step == at:
            raise Killed

    with pytest.raises(Killed):
        run(tmp_path, report=stop)
    steps = []
    again, again_records, _ = run(tmp_path, report=lambda step, records: steps.append(step))
    assert steps[0] == (at if at == 13 else at // 3 * 3) and steps[-1] == 13  # nothing is trained twice
    assert_same(again, best)
    assert again_records == records


@pytest.mark.long
def test_an_average_is_what_is_validated_and_kept_and_goes_on_to_the_same_bits(tmp_path, undisturbed):
    config = dataclasses.replace(CONFIG, train=dataclasses.replace(CONFIG.train, average=0.7))
    best, records, held_out = run(tmp_path / "whole", config=config)
    least = np.min([record["validation_loss"] for record in records], axis=0)
    np.testing.assert_allclose(validate_all(best, held_out, config).loss, least, rtol=1e-6)
    assert records[-1]["train_loss"] == undisturbed[1][-1]["train_loss"]  # the training itself is the same
    assert records[-1]["validation_loss"] != undisturbed[1][-1]["validation_loss"]

    def stop(step, records):
        if step == 8:
            raise Killed

    with pytest.raises(Killed):
        run(tmp_path / "killed", stop, config)
    again, again_records, _ = run(tmp_path / "killed", config=config)
    assert_same(again, best)
    assert again_records == records


def test_every_step_draws_a_batch_of_its_own(tmp_path, monkeypatch):
    drawn, draw = [], Sampler.batch
    monkeypatch.setattr(Sampler, "batch", lambda self, step: drawn.append(step) or draw(self, step))
    run(tmp_path)
    assert drawn == list(range(13))


def test_a_finished_run_is_not_trained_again(undisturbed):
    best, records, _, folder = undisturbed
    steps = []
    again, again_records, _ = run(folder, report=lambda step, records: steps.append(step))
    assert steps == [13] and again_records == records
    assert_same(again, best)


KILLED_RUN = "import pathlib, sys\nfrom tests.learning import test_fit\ntest_fit.run(pathlib.Path(sys.argv[1]))"


@pytest.mark.long
def test_a_killed_process_goes_on_to_the_same_bits(tmp_path, undisturbed):
    best, records, _, _ = undisturbed
    environment = os.environ | {"PYTHONPATH": str(Path(__file__).parents[2])}
    process = subprocess.Popen([sys.executable, "-c", KILLED_RUN, tmp_path], env=environment)
    end = time.monotonic() + 60
    while not list(tmp_path.glob("[0-9]*")) and process.poll() is None and time.monotonic() < end:
        time.sleep(0.002)
    process.send_signal(signal.SIGKILL)
    process.wait()
    # And what a kill in the middle of writing leaves: a folder that was never given its name.
    torn = tmp_path / "11.orbax-checkpoint-tmp" / "progress"
    torn.mkdir(parents=True)
    (torn / "manifest.ocdbt").write_bytes(b"half")
    again, again_records, _ = run(tmp_path)
    assert_same(again, best)
    assert again_records == records and [path.name for path in tmp_path.iterdir()] == ["13"]


def scripted(losses, patience):
    """Progress through the validation losses (T, S), whose weights at validation t are t + 1."""
    count = len(losses[0])

    def model(value):
        return Model({"kernel": jnp.full((count, 2, 3), value)}, {"mean": jnp.full((count,), value)})

    progress = Progress(TrainState(model(0.0), ()), model(0.0), jnp.full(count, jnp.inf), jnp.zeros(count, jnp.int32))
    for time_, loss in enumerate(losses):
        progress = progress._replace(states=TrainState(model(time_ + 1.0), ()))
        progress = keep_best(progress, jnp.array(loss), patience)
    return progress


def expected_best(losses, patience):
    """The rule in words: take the least so far; after `patience` validations without a new least, look no more."""
    best, at, stale = np.inf, 0, 0
    for time_, loss in enumerate(losses):
        if patience and stale >= patience:
            break
        best, at, stale = (loss, time_ + 1, 0) if loss < best else (best, at, stale + 1)
    return best, at


@pytest.mark.parametrize("patience", [0, 1, 2, 3])
def test_each_model_stops_by_itself_and_keeps_its_best(patience):
    """All orders of five losses: the S models of one stack are 120 models that stop at different times."""
    losses = np.array(list(itertools.permutations([1.0, 2.0, 3.0, 4.0, 5.0])), np.float32).T
    progress = scripted(losses, patience)
    for model, series in enumerate(losses.T):
        best, at = expected_best(series, patience)
        assert progress.best_loss[model] == best
        assert (progress.best.params["kernel"][model] == at).all() and progress.best.batch_stats["mean"][model] == at


def test_a_loss_that_is_no_number_is_never_the_best():
    progress = scripted([[2.0, np.nan], [np.nan, 3.0], [1.0, np.nan]], 0)
    assert progress.best_loss.tolist() == [1, 3] and progress.best.batch_stats["mean"].tolist() == [3, 2]


def test_training_ends_when_the_last_model_stops(tmp_path, monkeypatch):
    """Losses that only rise: the first validation is the best, and three more are waited for."""
    losses = iter(np.arange(1.0, 6.0))

    def worse(models, batch, config):
        return Validation(*[jnp.full(2, next(losses))] * 3)

    monkeypatch.setattr("jaxmm.learning.fit.validate_all", worse)
    three = dataclasses.replace(CONFIG, train=dataclasses.replace(CONFIG.train, patience=3))
    monkeypatch.setitem(globals(), "CONFIG", three)
    _, records, _ = run(tmp_path)
    assert [record["step"] for record in records] == [3, 6, 9, 12]
    assert run(tmp_path)[1] == records  # and stays stopped
