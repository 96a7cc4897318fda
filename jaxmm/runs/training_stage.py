"""The training stage of a run: clouds made or read, methods trained one after the other, probabilities calibrated."""

from pathlib import Path
from typing import Any

import numpy as np

from jaxmm import run_folder
from jaxmm.config import CONDITIONS, SCENARIOS, UNCHANGED, Config
from jaxmm.data import labelled_rooms
from jaxmm.data.simulator_settings import MULTI, CloudSource
from jaxmm.files import REMEDY, write_json
from jaxmm.inputs import InputError
from jaxmm.learning import loading, model_files
from jaxmm.learning.batches import Batch, LabelledCloud, Sampler, validation_batch
from jaxmm.learning.calibration import Calibration, calibrate
from jaxmm.learning.fit import Record, fit
from jaxmm.learning.joint_training import Joint
from jaxmm.learning.model import Model
from jaxmm.learning.train_step import all_logits
from jaxmm.progress import bar_of, progress
from jaxmm.thesis.training_clouds import thesis_clouds

CALIBRATION = "calibration.json"


def train(config: Config, folder: Path | str, resume: bool = False) -> Path:
    """Train all methods in a run folder of their own, as `jaxmm train` does; returns the file of the models.

    Raises:
        InputError: the folder holds a run already, and `resume` is False, or the run is of other settings.
    """
    folder = Path(folder)
    if (folder / run_folder.CONFIG).exists() and not resume:
        raise InputError(f"{folder}: already holds a run; --resume goes on with it, --out chooses another folder")
    with run_folder.open_run(folder, config):
        train_stage(config, folder)
    return folder / run_folder.MODELS


def train_stage(config: Config, folder: Path, clouds: Path | None = None) -> dict[str, Model]:
    """Train all methods, or take them from the run folder when they are there.

    Clouds of rooms are kept in a folder of their own where one is named, for several trainings on the same.
    """
    if (folder / run_folder.MODELS).exists():
        models, trained = model_files.load_models(folder)
        if trained != config:
            raise InputError(
                f"{folder / run_folder.MODELS}: trained with other settings than {run_folder.CONFIG} says; {REMEDY}"
            )
        return models
    training, validation = _clouds(config, clouds or folder)
    models, records, calibrations = {}, [], {}
    for method in config.train.methods:
        held_out = validation_batch(validation, method, config.train.labels, config.train.points_per_cloud)
        models[method], own = _train(config, folder, (method, training, held_out, records))
        records = records + own
        if method in config.train.calibrate:
            models[method], calibrations[method] = _calibrated(config, models[method], held_out)
    run_folder.write_records(folder, records)
    if calibrations:
        write_json(folder / CALIBRATION, calibrations | {"clouds": _validation_mix(config)})
    model_files.save_models(folder / run_folder.MODELS, models, config)
    return models


def _clouds(config: Config, folder: Path) -> tuple[list, list]:
    """Clouds of each scenario that teach, and that validate; made where the folder does not hold them."""
    if config.data.source == "thesis":
        return thesis_clouds(config.data.thesis)
    if config.data.source == "shards":
        training = loading.shard_clouds(config, Path(config.data.shards), folder / "data" / "shards.json")
    else:
        training = [training_clouds(config, folder, scenario, "train") for scenario in SCENARIOS]
    return training, [training_clouds(config, folder, scenario, "validation") for scenario in SCENARIOS]


def _train(config: Config, folder: Path, what: tuple) -> tuple[Model, list[Record]]:
    method, training, held_out, earlier = what
    settings = config.train
    copies = 4 if method in settings.augment else 1
    shape = (settings.batch_size, settings.points_per_cloud)
    sampler = Sampler(training, method, settings.labels, *shape, copies, config.seed)
    return fitted(sampler, held_out, config, folder, (f"train {method}: four models, one step", earlier))


def fitted(
    sampler: Sampler | Joint, held_out: Batch, config: Config, folder: Path, told: tuple[str, list[Record]]
) -> tuple[Model, list[Record]]:
    """Train with a progress bar; what the training says goes to the folder's records as it comes.

    Args:
        sampler: draws the batches.
        held_out: validation clouds.
        config: settings.
        folder: for records and checkpoints.
        told: what the bar is called, and records that are there already.
    """
    label, earlier = told
    with bar_of(label, config.train.step_count, "step") as bar:
        written = None

        def report(step: int, records: list[Record]) -> None:
            nonlocal written
            if written is None:  # steps of an earlier process took none of this one's time
                bar.initial, written = step, len(records)
                bar.reset()
            bar.update(step - bar.n)
            if len(records) > written:
                written = len(records)
                run_folder.write_records(folder, earlier + records)

        return fit(sampler, held_out, config, folder / "checkpoints" / sampler.method, report)


def _calibrated(config: Config, models: Model, held_out: Batch) -> tuple[Model, dict[str, Any]]:
    """The four models with calibrated probabilities, and by scenario what was found out on the way."""
    logits = np.asarray(all_logits(models, held_out, config.network))
    found, told = [], {}
    for number, scenario in enumerate(SCENARIOS):
        scored = held_out.scored[number]
        cloud = np.broadcast_to(np.arange(len(scored))[:, None], scored.shape)
        columns = (logits[number], held_out.labels[number], cloud)
        calibration, told[scenario] = calibrate(*(column[scored] for column in columns))
        found.append(calibration)
    return models._replace(calibration=Calibration(*map(np.stack, zip(*found, strict=True)))), told


def _validation_mix(config: Config) -> dict[str, int]:
    """How many clouds of each kind of scene validate, and calibrate, each model."""
    data = config.data
    kinds = {"own change": data.validation_rooms, UNCHANGED: data.unchanged_rooms // 4, MULTI: data.multi_rooms // 4}
    return {f"{kind}, {condition}": rooms for kind, rooms in kinds.items() for condition in CONDITIONS}


def training_clouds(
    config: Config, folder: Path, scenario: str, split: str, conditions: tuple[str, ...] = CONDITIONS
) -> list[LabelledCloud]:
    """One model's clouds: its scenario's rooms, and those with no change and with several, clean and occluded."""
    data = config.data
    seed, count = (
        (data.train_seed, data.train_rooms) if split == "train" else (data.validation_seed, data.validation_rooms)
    )
    share = 1 if split == "train" else 4
    others = ((UNCHANGED, data.unchanged_rooms // share), (MULTI, data.multi_rooms // share))
    clouds = []
    for scene, rooms in ((scenario, count), *others):
        for condition in conditions if rooms else ():
            source = CloudSource(scenario, scene, condition, seed)
            kind = scenario if scene == scenario else f"{scenario}_{scene}"
            path = folder / "data" / f"{split}_{kind}_{condition}.npz"
            label = f"scan {split} rooms: {kind.replace('_', ' ')}, {condition}"
            clouds += progress(labelled_rooms.cached_clouds(config, source, rooms, path), label, rooms)
    return clouds
