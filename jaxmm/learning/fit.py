"""Trains one method's four models to the end: batches, validation, early stop, checkpoints that resume to the bit."""

import contextlib
import logging
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import orbax.checkpoint as ocp

from jaxmm.config import TRAINED_METHODS, Config
from jaxmm.learning.batches import Batch, Sampler
from jaxmm.learning.joint_training import Joint
from jaxmm.learning.loading import batches
from jaxmm.learning.model import Model, offset_of
from jaxmm.learning.train_step import TrainState, Validation, init_all, train_step_all, validate_all

Record = dict[str, Any]  # one validation, as a line of metrics.jsonl


class Progress(NamedTuple):
    """All that training carries from one step to the next; S models stacked."""

    states: TrainState
    best: Model  # of each model, the weights with the least validation loss so far
    best_loss: jax.Array  # (S,) [nat]
    stale: jax.Array  # (S,) int32 validations since then


def fit(
    sampler: Sampler | Joint,
    validation: Batch,
    config: Config,
    folder: Path,
    report: Callable[[int, list[Record]], None],
) -> tuple[Model, list[Record]]:
    """Train until every model has stopped or `step_count` is reached; resumes from the newest checkpoint in `folder`.

    Args:
        sampler: draws the batch of any step.
        validation: all validation clouds; they choose the weights and the end, and teach nothing.
        config: settings of the run.
        folder: where this method's checkpoints live.
        report: called after each step with the number of finished steps and the records so far.

    Returns:
        The best weights of each model, stacked, and one record per validation:
        {"method", "step", "train_loss", "validation_loss", "validation_precision", "validation_recall"}, lists over S.
    """
    # Orbax logs the traceback of an error before it raises that error, and whoever catches it tells of it again; so
    # do its writers that the error interrupted.
    for name in ("absl", "asyncio"):
        logging.getLogger(name).setLevel(logging.CRITICAL)
    states, size = _fresh(sampler, config), len(sampler.clouds)
    best = jax.tree.map(jnp.copy, states.shown)  # the step donates the states, and would take these along
    progress = Progress(states, best, jnp.full(size, jnp.inf), jnp.zeros(size, jnp.int32))
    options = ocp.CheckpointManagerOptions(
        max_to_keep=1, enable_async_checkpointing=False, create=True, cleanup_tmp_directories=True
    )
    with contextlib.ExitStack() as stack:
        manager = stack.enter_context(ocp.CheckpointManager(folder.resolve(), options=options))
        progress, records = _restore(manager, progress)
        step = records[-1]["step"] if records else 0
        report(step, records)
        drawn = stack.enter_context(contextlib.closing(batches(sampler, step, config.train.step_count)))
        losses: list[jax.Array] = []
        while step < config.train.step_count and not _all_stopped(progress, config):
            states, loss = train_step_all(progress.states, next(drawn), config)
            progress = progress._replace(states=states)
            losses.append(loss)
            step += 1
            if step % config.train.validate_every == 0 or step == config.train.step_count:
                result = validate_all(progress.states.shown, validation, config)
                progress = keep_best(progress, result.loss, config.train.patience)
                records.append(_record(sampler.method, step, np.mean(losses, axis=0), result))
                losses = []
                _save(manager, step, progress, records)
            report(step, records)
    return progress.best, records


def _fresh(sampler: Sampler | Joint, config: Config) -> TrainState:
    if isinstance(sampler, Joint):
        return sampler.states(config)
    key = jax.random.fold_in(jax.random.key(config.seed), list(TRAINED_METHODS).index(sampler.method))
    rule = offset_of(sampler.method, sampler.scenarios, config.train)
    return init_all(key, TRAINED_METHODS[sampler.method], config, len(sampler.clouds), rule)


@partial(jax.jit, static_argnames="patience")
def keep_best(progress: Progress, loss: jax.Array, patience: int) -> Progress:
    """Take over the weights of the models whose validation loss (S,) fell; a model that has stopped keeps its best."""
    stopped = (progress.stale >= patience) if patience else jnp.zeros_like(progress.stale, bool)
    better = (loss < progress.best_loss) & ~stopped

    def choose(new, old):
        return jnp.where(better.reshape(-1, *[1] * (new.ndim - 1)), new, old)

    best = jax.tree.map(choose, progress.states.shown, progress.best)
    stale = jnp.where(better, 0, progress.stale + ~stopped)
    return Progress(progress.states, best, choose(loss, progress.best_loss), stale)


def _all_stopped(progress: Progress, config: Config) -> bool:
    return bool(config.train.patience) and bool((progress.stale >= config.train.patience).all())


def _record(method: str, step: int, train_loss: np.ndarray, result: Validation) -> Record:
    def plain(values):
        return [float(value) if np.isfinite(value) else None for value in np.asarray(values)]

    return {
        "method": method,
        "step": step,
        "train_loss": plain(train_loss),
        "validation_loss": plain(result.loss),
        "validation_precision": plain(result.precision),
        "validation_recall": plain(result.recall),
    }


def _save(manager: ocp.CheckpointManager, step: int, progress: Progress, records: list[Record]) -> None:
    arguments = ocp.args.Composite(progress=ocp.args.StandardSave(progress), records=ocp.args.JsonSave(records))
    try:
        manager.save(step, args=arguments)
    except (OSError, ValueError) as error:  # a full disk may come as either
        raise OSError(f"{manager.directory}: cannot write a checkpoint: {error}") from error


def _restore(manager: ocp.CheckpointManager, fresh: Progress) -> tuple[Progress, list[Record]]:
    step = manager.latest_step()
    if step is None:
        return fresh, []
    arguments = ocp.args.Composite(progress=ocp.args.StandardRestore(fresh), records=ocp.args.JsonRestore())
    restored = manager.restore(step, args=arguments)
    return restored.progress, list(restored.records)
