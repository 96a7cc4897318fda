"""What more training rooms buy, which the thesis could not ask: compact networks, an equal number of updates each.

Harder scenes than Table I's, where there is something left to learn: rooms of the preset `varied`, nothing filtered
out of the robot's scan. A room here is one pair of scans, even numbers clean and odd ones occluded: the thesis's six
training rooms of each model, scanned in both conditions, are twelve. Smaller sets are the first rooms of larger ones.
Stages: `scaling_clouds` (chunks of thinned clouds, made by one process a core), `scaling_models`, `scaling_rooms`.

P points that are kept of a cloud, F kinds of evidence.
"""

import dataclasses
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from jaxmm import run_folder
from jaxmm.config import COMPACT, SCENARIOS, Config, Table
from jaxmm.data import labelled_rooms, local_engine
from jaxmm.data.simulator_settings import CloudSource
from jaxmm.files import load_arrays, load_json, write_arrays, write_json
from jaxmm.learning import model_files
from jaxmm.learning.batches import LabelledCloud, features_of
from jaxmm.learning.joint_training import Entry, Joint
from jaxmm.learning.model import Model
from jaxmm.learning.room_scores import CONTROL, predict, score_room
from jaxmm.progress import bar_of, progress
from jaxmm.rays.evidence import FEATURES
from jaxmm.rays.rule import RULE, rule_scores
from jaxmm.runs.paper.models import TRUTHS, WORDS, as_settings, load_networks
from jaxmm.runs.paper.rows import ROOMS, TestScenes
from jaxmm.runs.paper.scenes import room_scenes
from jaxmm.runs.stages import Stage, key_of, open_stage
from jaxmm.runs.training_stage import fitted

METHODS = ("nn", "evidence")
CHUNK = 250  # rooms of a file
FEW = 500  # rooms below which one process is quicker than one a core
KEPT = ("width", "height", "sensor")  # of the run's scan settings
CONDITION = ("clean", "occluded")
SCORES = "rooms.json"


def scaling_config(config: Config) -> Config:
    """The settings of the study: those of the default models where they matter to learning (configs/weights.toml)."""
    paper = config.paper
    scan = {name: value for name, value in config.scan.thawed().items() if name in KEPT} | {"preset": "varied"}
    train = dataclasses.replace(
        config.train, labels="true", step_count=paper.scaling_steps, batch_size=paper.scaling_batch,
        points_per_cloud=paper.scaling_points, learning_rate=3e-3, schedule="cosine",
        validate_every=max(1, paper.scaling_steps // 10), patience=0,
    )  # fmt: skip
    return dataclasses.replace(
        config, scan=Table.of(scan), room=Table(), train=train,
        network=dataclasses.replace(COMPACT, dropout=0.15), loss=dataclasses.replace(config.loss, gamma=1.0),
        preprocess=dataclasses.replace(config.preprocess, object_filter="none", evidence="exact"),
    )  # fmt: skip


def scaling_scores(config: Config, run: Path) -> dict[str, list[dict[str, Any]]]:
    """Scores of test rooms by scenario; methods are nn-raw, rule, and `<method>_<rooms>` for every size."""
    config = scaling_config(config)
    networks, key = _networks(config, run)
    settings = _scenes(config) | as_settings(config, "evaluate") | {"rooms": config.paper.scaling_test_rooms}
    settings |= {"test_seed": config.data.test_seed, "sizes": config.paper.scaling_rooms}
    del settings["evaluate"]["resamples"]
    code = ("jaxmm.runs.paper.scenes", "jaxmm.learning.room_scores")
    folder = open_stage(run, Stage("scaling_rooms", settings, code, (*WORDS, "jaxmm.learning.result_tables"), (key,)))
    return {name: _scored(config, folder / name / SCORES, name, networks) for name in SCENARIOS}


def _scored(config: Config, path: Path, scenario: str, networks: dict[str, Model]) -> list[dict[str, Any]]:
    if not path.exists():
        count, scenes = config.paper.scaling_test_rooms, TestScenes(ROOMS, scenario, "occluded")
        made = progress(room_scenes(config, scenes, (scenario,), count), f"score scaling: {scenario}", count)
        rooms = []
        for scene in made:
            cloud, truth, _ = scene.views[scenario]
            scores = {CONTROL: cloud.distance, RULE: rule_scores(cloud.evidence, removed=scenario.endswith("removed"))}
            for name in _names(config):
                features = features_of(name.split("_")[0], cloud.points, cloud.distance, cloud.evidence)
                scores[name] = predict(networks[f"{name}/{scenario}"], features, config.network)
            rooms.append(
                {"room": scene.number, "sides": {scenario: score_room(cloud, truth, scenario, scores, config)}}
            )
        write_json(path, rooms)
    return load_json(path)


def _names(config: Config) -> list[str]:
    return [f"{method}_{size}" for method in METHODS for size in config.paper.scaling_rooms]


def _networks(config: Config, run: Path) -> tuple[dict[str, Model], str]:
    """All networks of the study by `<method>_<rooms>/<scenario>`, trained together; and the key of their stage."""
    clouds = _clouds_stage(config)
    settings = as_settings(config, "seed", "network", "loss", "train")
    for name in ("methods", "labels", "augment", "calibrate"):
        del settings["train"][name]
    sizes = list(config.paper.scaling_rooms)
    stage = Stage("scaling_models", settings | {"sizes": sizes}, ("jaxmm.learning.fit",), WORDS, (key_of(clouds),))
    folder = open_stage(run, stage)
    if not (folder / run_folder.MODELS).exists():
        training, held_out = _clouds(config, open_stage(run, clouds))
        entries = tuple(
            Entry(f"{method}_{size}", scenario, method, "true", 1, training[scenario].first(size), held_out[scenario])
            for method in METHODS
            for size in sizes
            for scenario in SCENARIOS
        )
        joint = Joint(entries, "joint", config.train.batch_size, config.train.points_per_cloud, config.seed)
        write_json(folder / "entries.json", [f"{entry.name}/{entry.scenario}" for entry in entries])
        label = f"train {len(entries)} compact networks, one step"
        best, records = fitted(joint, joint.validation(), config, folder, (label, []))
        run_folder.write_records(folder, records)
        model_files.save_models(folder / run_folder.MODELS, joint.models(best), config)
    return load_networks(run, "scaling_models"), key_of(stage)


def _scenes(config: Config) -> dict[str, Any]:
    return as_settings(config, "scan", "room", "preprocess")


def _clouds_stage(config: Config) -> Stage:
    counts = {"train": max(config.paper.scaling_rooms), "validation": 2 * config.data.validation_rooms}
    seeds = {"train": config.data.train_seed, "validation": config.data.validation_seed}
    settings = _scenes(config) | {"counts": counts, "seeds": seeds, "points": config.paper.scaling_points}
    return Stage(
        "scaling_clouds", settings, ("jaxmm.data.labelled_rooms", "jaxmm.runs.paper.scaling"), (*WORDS, *TRUTHS)
    )


class ThinClouds(Sequence[LabelledCloud]):
    """Thinned clouds of one scenario, held as they are stored; evidence in half precision."""

    def __init__(self, arrays: dict[str, np.ndarray], count: int):
        """`arrays` as `_chunk` makes them, of all rooms; the first `count` of them count."""
        self._arrays, self._count = arrays, count

    def first(self, count: int) -> "ThinClouds":
        """A smaller set."""
        return ThinClouds(self._arrays, count)

    def __len__(self) -> int:
        return self._count

    def __getitem__(self, item: int) -> LabelledCloud:
        there = slice(0, int(self._arrays["count"][item]))
        distance, true, testable, evidence = (
            self._arrays[name][item, there] for name in ("distance", "true", "testable", "evidence")
        )
        unknown = np.zeros((len(distance), 3), np.float32)  # no network of the study sees coordinates
        return LabelledCloud(unknown, distance, np.zeros(len(distance), np.int32), true, true, testable, evidence)


def _clouds(config: Config, folder: Path) -> tuple[dict[str, ThinClouds], dict[str, ThinClouds]]:
    """Training and validation clouds by scenario, chunks that are missing made first."""
    counts = (max(config.paper.scaling_rooms), 2 * config.data.validation_rooms)
    tasks = [
        (split, number, first, min(first + CHUNK, count))
        for split, count in enumerate(counts)
        for number in range(len(SCENARIOS))
        for first in range(0, count, CHUNK)
        if not _path(folder, split, number, first).exists()
    ]
    rooms = sum(stop - first for *_, first, stop in tasks)
    workers = 1 if rooms < FEW else None
    with bar_of("scan rooms of the scaling study", rooms, "room") as bar:
        for task, arrays in local_engine.results(partial(_chunk, config), tasks, workers) if tasks else ():
            write_arrays(_path(folder, *task[:3]), arrays)
            bar.update(task[3] - task[2])
    found = [
        {name: ThinClouds(_joined(folder, split, number, count), count) for number, name in enumerate(SCENARIOS)}
        for split, count in enumerate(counts)
    ]
    return found[0], found[1]


def _path(folder: Path, split: int, number: int, first: int) -> Path:
    return folder / f"{('train', 'validation')[split]}_{SCENARIOS[number]}_{first:06d}.npz"


def _joined(folder: Path, split: int, number: int, count: int) -> dict[str, np.ndarray]:
    parts = [load_arrays(_path(folder, split, number, first)) for first in range(0, count, CHUNK)]
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def _chunk(config: Config, split: int, number: int, first: int, stop: int) -> dict[str, np.ndarray]:
    """Thinned clouds of the rooms [first, stop): arrays (rooms, P) and evidence (rooms, P, F), zero behind `count`."""
    points = config.paper.scaling_points
    seed = (config.data.train_seed, config.data.validation_seed)[split]
    shape = (stop - first, points)
    arrays = {
        "distance": np.zeros(shape, np.float32), "true": np.zeros(shape, bool), "testable": np.zeros(shape, bool),
        "evidence": np.zeros((*shape, len(FEATURES)), np.float16), "count": np.zeros(shape[0], np.int32),
    }  # fmt: skip
    for room, cloud in _made(config, SCENARIOS[number], seed, np.arange(first, stop)):
        row, size = room - first, min(points, len(cloud.points))
        chosen = np.random.default_rng([seed, number, room]).permutation(len(cloud.points))[:size]
        for name in ("distance", "true", "testable", "evidence"):
            arrays[name][row, :size] = getattr(cloud, name)[chosen]
        arrays["count"][row] = size
    return arrays


def _made(config: Config, scenario: str, seed: int, rooms: np.ndarray) -> Iterator[tuple[int, LabelledCloud]]:
    for parity, condition in enumerate(CONDITION):
        own = rooms[rooms % 2 == parity]
        for cloud, truth in labelled_rooms.clouds(config, CloudSource(scenario, scenario, condition, seed), own):
            yield truth.index, cloud
