"""A run folder of the paper as its figures read it: real test rooms, made-up scores and records; nothing is trained."""

import dataclasses
from pathlib import Path

import jax
import numpy as np

from jaxmm import run_folder
from jaxmm.config import TRAINED_METHODS, Config, load
from jaxmm.files import write_arrays, write_json
from jaxmm.learning import model_files
from jaxmm.learning.room_scores import score_room
from jaxmm.learning.train_step import init_model
from jaxmm.rays.rule import rule_scores
from jaxmm.runs.paper.models import ENTRIES, MODELS
from jaxmm.runs.paper.rows import ROOMS, TRAININGS, TestScenes, needed_models
from jaxmm.runs.paper.scenes import room_scenes
from jaxmm.runs.stages import STAGE, STAGES

ROOT = Path(__file__).resolve().parents[2]
SEED = 21  # neither trained, validated nor tested on


def small_config() -> Config:
    """Settings of the smallest run, on rooms of SEED."""
    config = load(ROOT / "configs" / "paper_smoke.toml")
    return dataclasses.replace(config, data=dataclasses.replace(config.data, test_seed=SEED))


def write_scenes(path: Path, config: Config, scenes: TestScenes, scenario: str) -> None:
    """A set of one scene: the first of four rooms that shows enough of the change; rooms stand in for buildings too."""
    rooms = room_scenes(config, scenes._replace(kind=ROOMS), (scenario,), 4)
    scene = next(one for one in rooms if one.views[scenario].cloud.true.sum() >= 5)
    cloud, truth, ((dt,), (robot,)) = scene.views[scenario]
    rule = rule_scores(cloud.evidence, removed=scenario.endswith("removed"))
    scores = {"nn-raw": cloud.distance, "rule": rule, "xyz_nn": far(cloud.distance), "nn": far(cloud.distance)}
    scores["evidence"] = 0.02 + 0.9 * rule
    arrays = cloud._asdict() | {f"score {name}": value for name, value in scores.items()}
    arrays = {f"{scenario}/{name}": value for name, value in arrays.items()}
    arrays |= {"dt": dt.points, "robot": robot.points, "room": np.array(scene.number), "place": np.array("")}
    target = path / STAGES / "rooms" / scenes.name
    target.mkdir(parents=True)
    write_arrays(target / "example.npz", arrays)
    side = score_room(cloud, truth, scenario, scores, config)
    write_json(target / "rooms.json", [{"room": scene.number, "place": "", "sides": {scenario: side}}])


def far(distance: np.ndarray) -> np.ndarray:
    """What a network may have learned of distances [m]: the probability of a change."""
    return distance / (distance + 0.2)


def write_training(path: Path) -> None:
    """Records in which the value of an entry says which entry it is of."""
    target, entries = path / STAGES / MODELS, [f"{name}/{scenario}" for name, scenario in needed_models()]
    target.mkdir(parents=True)
    write_json(target / STAGE, {"date": "2024-02-28"})
    write_json(target / ENTRIES, entries)
    numbers = np.arange(1.0, len(entries) + 1)
    names = ("train_loss", "validation_loss", "validation_precision", "validation_recall")
    records = [
        {"method": "joint", "step": step}
        | {name: (numbers / (step * (index + 1))).tolist() for index, name in enumerate(names)}
        for step in (2, 4)
    ]
    run_folder.write_records(target, records)


def write_networks(path: Path, config: Config) -> None:
    """Fresh networks in the places of the trained ones."""
    fresh = {name: init_model(jax.random.key(0), TRAINED_METHODS[name], config.network) for name in ("nn", "xyz_nn")}
    models = {
        f"{training}/{scenario}": fresh[TRAININGS[training].features]
        for training, scenario in needed_models()
        if TRAININGS[training].features in fresh
    }
    model_files.save_models(path / STAGES / MODELS / run_folder.MODELS, models, config)
