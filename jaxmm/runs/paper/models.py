"""The thesis networks behind Table I: every training that its rows need, as one joint training.

Stages of the run folder: `clouds` (training and validation rooms, scanned and labelled) and `models`, which holds
`models.safetensors` (`<training>/<scenario>/...`, keys of paper_rows.TRAININGS), `entries.json` (their order) and
`metrics.jsonl` (one line a validation, lists in that order). `models_1` and so on are the same with further seeds.
"""

import dataclasses
from pathlib import Path
from typing import Any

import safetensors
from flax.traverse_util import unflatten_dict

from jaxmm import run_folder
from jaxmm.config import SCENARIOS, Config
from jaxmm.files import REMEDY, write_json
from jaxmm.inputs import InputError
from jaxmm.learning import model_files
from jaxmm.learning.joint_training import Entry, Joint
from jaxmm.learning.model import Model
from jaxmm.runs.paper.rows import TRAININGS, Training, again, needed_models
from jaxmm.runs.stages import Stage, key_of, open_stage, stage_folder
from jaxmm.runs.training_stage import fitted, training_clouds

CLOUDS, MODELS, ENTRIES = "clouds", "models", "entries.json"
# What they say is in the settings of a stage, or reaches no number.
WORDS = ("jaxmm.config", "jaxmm.files", "jaxmm.inputs", "jaxmm.progress")
# Of a cloud's truth only the figures and the tables see boxes.
TRUTHS = ("jaxmm.learning.room_scores", "jaxmm.learning.boxes")


def as_settings(config: Config, *sections: str) -> dict[str, Any]:
    """Some sections of the settings, as a stage's key wants them."""
    table = run_folder.as_table(config)
    return {name: table[name] for name in sections}


def clouds_stage(config: Config) -> Stage:
    """Training and validation rooms."""
    settings = as_settings(_without_evidence(config), "scan", "room", "preprocess", "data")
    for name in ("test_rooms", "test_seed"):
        del settings["data"][name]
    return Stage(CLOUDS, settings, ("jaxmm.data.labelled_rooms",), (*WORDS, *TRUTHS))


def models_stage(config: Config) -> Stage:
    """The joint training with the first seed."""
    return _models_stage(config, 0)


def models_key(config: Config) -> str:
    """Key of all trainings together."""
    return " ".join(key_of(_models_stage(config, number)) for number in range(config.paper.seeds))


def _models_stage(config: Config, number: int) -> Stage:
    config = dataclasses.replace(config, seed=config.seed + number)
    needed = [[*one, *TRAININGS[one[0]]] for one in needed_models()]
    settings = as_settings(config, "seed", "network", "loss", "train") | {"entries": needed}
    for name in ("methods", "labels", "augment", "calibrate"):  # the rows say that
        del settings["train"][name]
    name = f"{MODELS}_{number}" if number else MODELS
    return Stage(name, settings, ("jaxmm.learning.fit",), WORDS, (key_of(clouds_stage(config)),))


def trained_networks(config: Config, run: Path) -> dict[str, Model]:
    """Train all of them with each seed, or take them from the run folder: models by `<training>/<scenario>`.

    Of further seeds the name of the training is that of `rows.again`.
    """
    found = {}
    for number in range(config.paper.seeds):
        stage = _models_stage(config, number)
        _train(dataclasses.replace(config, seed=config.seed + number), run, open_stage(run, stage), number)
        for name, model in load_networks(run, stage.name).items():
            training, scenario = name.split("/")
            found[f"{again(training, number)}/{scenario}"] = model
    return found


def _train(config: Config, run: Path, folder: Path, number: int) -> None:
    """Train the networks of one seed, unless they are there."""
    path = folder / run_folder.MODELS
    if path.exists():
        return
    joint = Joint(_entries(config, run), "joint", config.train.batch_size, config.train.points_per_cloud, config.seed)
    write_json(folder / ENTRIES, [f"{entry.name}/{entry.scenario}" for entry in joint.entries])
    label = f"train {len(joint.entries)} thesis networks, one step" + f", seed {config.seed}" * bool(number)
    best, records = fitted(joint, joint.validation(), config, folder, (label, []))
    run_folder.write_records(folder, records)
    model_files.save_models(path, joint.models(best), config)


def load_networks(run: Path, stage: str = MODELS) -> dict[str, Model]:
    """The trained networks of a stage by `<training>/<scenario>`, for those who only read them.

    Raises:
        InputError: there are none, or the file is damaged.
    """
    path = stage_folder(run, stage) / run_folder.MODELS
    try:
        with safetensors.safe_open(path, framework="numpy") as file:
            tensors = {tuple(name.split("/")): file.get_tensor(name) for name in file.keys()}
    except (safetensors.SafetensorError, OSError) as error:
        raise InputError(f"{path}: expected whole models of the run, found none; {REMEDY}") from error
    return {
        f"{training}/{scenario}": model_files.model_of(parts)
        for training, scenarios in unflatten_dict(tensors).items()
        for scenario, parts in scenarios.items()
    }


def _entries(config: Config, run: Path) -> tuple[Entry, ...]:
    folder = open_stage(run, clouds_stage(config))
    plain = _without_evidence(config)
    clouds = {
        (scenario, split, condition): training_clouds(plain, folder, scenario, split, (condition,))
        for scenario in SCENARIOS
        for split in ("train", "validation")
        for condition in ("clean", "occluded")
    }

    def of(scenario: str, split: str, training: Training) -> list:
        return [cloud for condition in training.conditions for cloud in clouds[scenario, split, condition]]

    entries = []
    for name, scenario in needed_models():
        training = TRAININGS[name]
        sets = (of(scenario, split, training) for split in ("train", "validation"))
        copies = 4 if training.augmented else 1
        entries.append(Entry(name, scenario, training.features, training.labels, copies, *sets))
    return tuple(entries)


def _without_evidence(config: Config) -> Config:
    """Thesis networks see none, and gathering it takes most of the time."""
    train = dataclasses.replace(config.train, methods=("nn",))
    return dataclasses.replace(config, train=train, preprocess=dataclasses.replace(config.preprocess, evidence="none"))
