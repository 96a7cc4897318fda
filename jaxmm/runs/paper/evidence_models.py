"""Further trainings of `evidence` behind Table I: settings of the models that ship, on fewer rooms, each its own seed.

Rows show the models that ship; these tell how far another training would have been from them. Stages of the run
folder: `evidence_clouds`, and `evidence_1` and so on with `models.safetensors`, `calibration.json`, `metrics.jsonl`.
"""

import dataclasses
from pathlib import Path

from jaxmm import run_folder
from jaxmm.config import Config
from jaxmm.learning import model_files
from jaxmm.learning.model import Model
from jaxmm.runs.paper.models import TRUTHS, WORDS, as_settings
from jaxmm.runs.stages import Stage, key_of, open_stage
from jaxmm.runs.training_stage import train_stage
from jaxmm.weights import DEFAULT

EVIDENCE = "evidence"


def evidence_config(config: Config, number: int) -> Config:
    """Settings of training `number`, counted from 1: of the models that ship, but for seed, rooms and steps."""
    _, shipped = model_files.load_models(DEFAULT)
    share, steps = config.paper.evidence_rooms / shipped.data.train_rooms, config.paper.evidence_steps
    rooms = {
        name: round(share * getattr(shipped.data, name))
        for name in ("train_rooms", "validation_rooms", "unchanged_rooms", "multi_rooms")
    }
    data = dataclasses.replace(shipped.data, **rooms | {"validation_rooms": max(1, rooms["validation_rooms"])})
    train = dataclasses.replace(shipped.train, step_count=steps, validate_every=max(1, steps // 10))
    return dataclasses.replace(shipped, seed=shipped.seed + number, data=data, train=train)


def evidence_key(config: Config) -> str:
    """Key of all these trainings together."""
    return " ".join(key_of(_stage(config, number)) for number in _numbers(config))


def trained_evidence(config: Config, run: Path) -> tuple[Model, ...]:
    """Train them, or take them from the run folder: the four models of each, stacked."""
    found = []
    for number in _numbers(config):
        own = evidence_config(config, number)
        clouds, folder = open_stage(run, _clouds_stage(own)), open_stage(run, _stage(config, number))
        path = folder / run_folder.MODELS
        models = model_files.load_models(path)[0] if path.exists() else train_stage(own, folder, clouds)
        found.append(models[EVIDENCE])
    return tuple(found)


def _numbers(config: Config) -> range:
    return range(1, config.paper.evidence_seeds + 1)


def _clouds_stage(own: Config) -> Stage:
    settings = as_settings(own, "scan", "room", "preprocess", "data")
    return Stage("evidence_clouds", settings, ("jaxmm.data.labelled_rooms",), (*WORDS, *TRUTHS))


def _stage(config: Config, number: int) -> Stage:
    own = evidence_config(config, number)
    settings = as_settings(own, "seed", "network", "loss", "train")
    code = ("jaxmm.learning.fit", "jaxmm.learning.calibration")
    return Stage(f"evidence_{number}", settings, code, WORDS, (key_of(_clouds_stage(own)),))
