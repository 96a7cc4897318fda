"""Rooms scanned with all that the simulator lets go wrong but one thing, to train without it, and how models do then.

The sensors err as built (noise that grows with the range, returns that are lost, mixed pixels, biases, gross errors),
and the robot is not quite where it is believed to be.
"""

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from jaxmm.config import CONDITIONS, SCENARIOS, Config, Table
from jaxmm.data import labelled_rooms
from jaxmm.data.simulator_settings import CloudSource
from jaxmm.learning.batches import LabelledCloud, features_of, labels_of
from jaxmm.learning.metrics import point_metrics
from jaxmm.learning.model import Model, pick_model
from jaxmm.learning.room_scores import predict
from jaxmm.runs.training_stage import training_clouds
from warp_scanner.sensors.imperfections import Imperfections
from warp_scanner.sensors.sensors import KINDS, Sensor, sensor_named

METHOD = "evidence"
TAUGHT = ("oak-d-pro-small-real", "ouster-64-real", "velodyne-16-real")
SCORED = (*TAUGHT, "tls-real")  # the last is of a kind that no training sees
POSE_ERROR = {"position_error": 0.02, "angle_error": 0.3}  # [m], [deg]
USUAL_RANGE = 3.0  # [m] at which noise that does not grow is as large as noise that does
LEAST_POSITIVES = 20  # testable ones of a room that counts
CHANGED = 0.5  # probability from which a point is called so
NOISE = ("noise", "noise_per_metre", "noise_per_square", "noise_by_light")


def _without_growth(errors: Imperfections) -> Imperfections:
    usual = float(errors.sigma(np.float64(USUAL_RANGE)))
    return dataclasses.replace(errors, noise=usual, noise_per_metre=0.0, noise_per_square=0.0)


def _without(*names: str) -> Callable[[Imperfections], Imperfections]:
    ideal = Imperfections()
    return lambda errors: dataclasses.replace(errors, **{name: getattr(ideal, name) for name in names})


def _as_built(errors: Imperfections) -> Imperfections:
    return errors


# What is left out -> what becomes of the sensors' errors, of the pose error, and which rooms teach.
VARIANTS: dict[str, tuple[Callable[[Imperfections], Imperfections], dict[str, float], tuple[str, ...]]] = {
    "nothing": (_as_built, POSE_ERROR, CONDITIONS),
    "noise growth": (_without_growth, POSE_ERROR, CONDITIONS),
    "noise": (_without(*NOISE), POSE_ERROR, CONDITIONS),
    "gross errors": (_without("gross_chance"), POSE_ERROR, CONDITIONS),
    "mixed pixels": (_without("mixed_chance"), POSE_ERROR, CONDITIONS),
    "bias": (_without("dark_bias", "slant_bias"), POSE_ERROR, CONDITIONS),
    "lost returns": (_without("grazing_dropout", "class_dropout"), POSE_ERROR, CONDITIONS),
    "pose error": (_as_built, {}, CONDITIONS),
    "all of these": (lambda errors: Imperfections(), {}, CONDITIONS),
    "furniture": (_as_built, POSE_ERROR, ("clean", "clean of other rooms")),
}


def with_sensor(base: Config, sensor: Sensor, pose_error: dict[str, float]) -> Config:
    """Varied rooms scanned by such a sensor."""
    kind = next(name for name, own in KINDS.items() if isinstance(sensor, own))
    table = dataclasses.asdict(sensor)
    errors = table["imperfections"]
    errors["class_dropout"] = {str(number): chance for number, chance in errors["class_dropout"]}
    scan = {"preset": "varied", "sensor": {"kind": kind} | table} | pose_error
    return dataclasses.replace(base, scan=Table.of(scan))


def taught_clouds(base: Config, variant: str, folder: Path, split: str) -> list[list[LabelledCloud]]:
    """Clouds of each scenario, of all sensors that teach: kept in the folder, as many whatever is left out."""
    erring, pose_error, conditions = VARIANTS[variant]
    found: list[list[LabelledCloud]] = [[] for _ in SCENARIOS]
    for name in TAUGHT:
        sensor = sensor_named(name)
        sensor = dataclasses.replace(sensor, imperfections=erring(sensor.imperfections))
        config = with_sensor(base, sensor, pose_error)
        for condition in conditions:
            if condition not in CONDITIONS:  # twice the rooms instead of the same ones with furniture
                seeds = {f"{kind}_seed": 1000 + getattr(base.data, f"{kind}_seed") for kind in ("train", "validation")}
                config = dataclasses.replace(config, data=dataclasses.replace(base.data, **seeds))
            place = folder / name / condition.replace(" ", "_")
            for clouds, scenario in zip(found, SCENARIOS, strict=True):
                clouds += training_clouds(config, place, scenario, split, (condition.split()[0],))
    return found


class SeenRoom(NamedTuple):
    """A furnished test room that counts, as one sensor sees it."""

    number: int  # of the room, the same for every sensor
    scenario: str
    cloud: LabelledCloud


def rooms_to_score(base: Config, rooms: int) -> dict[str, list[SeenRoom]]:
    """By sensor as built; rooms with too little of the change in view are left out."""
    found: dict[str, list[SeenRoom]] = {}
    for name in SCORED:
        config, found[name] = with_sensor(base, sensor_named(name), POSE_ERROR), []
        for kind, scenario in enumerate(SCENARIOS):
            source = CloudSource(scenario, scenario, "occluded", base.data.test_seed)
            for room, (cloud, _) in enumerate(labelled_rooms.clouds(config, source, np.arange(rooms))):
                if np.sum(cloud.true & cloud.testable) >= LEAST_POSITIVES:
                    found[name].append(SeenRoom(kind * rooms + room, scenario, cloud))
    return found


def scores_of(models: Model, config: Config, rooms: dict[str, list[SeenRoom]]) -> dict[str, list[list[float]]]:
    """By sensor, of every test room: ROC AUC, precision at 95 % recall, and F1 of the points called changed."""
    found = {}
    for sensor, seen in rooms.items():
        found[sensor] = [_scores(pick_model(models, room.scenario), config, room.cloud) for room in seen]
    return found


def _scores(model: Model, config: Config, cloud: LabelledCloud) -> list[float]:
    score = predict(model, features_of(METHOD, cloud.points, cloud.distance, cloud.evidence), config.network)
    label, void = labels_of(cloud, "true")
    metrics, called, changed = point_metrics(score, label, void), score[~void] >= CHANGED, label[~void]
    f1 = 2.0 * np.sum(called & changed) / max(called.sum() + changed.sum(), 1)
    return [float(metrics.roc_auc), float(metrics.precision_at_95), float(f1)]


def difference(
    without: np.ndarray, nothing: np.ndarray, number: np.ndarray, resamples: int = 2000
) -> tuple[float, float, float]:
    """Mean of without - nothing, and its 95 % interval over trainings and rooms.

    Args:
        without: (T, C) scores by training and cloud.
        nothing: (T, C) the same of trainings from which nothing was left out.
        number: (C,) of the room that a cloud shows: the clouds of one are drawn together, and for both sides alike.
        resamples: draws of rooms, and of each side's trainings.
    """
    rng, trainings = np.random.default_rng(0), len(without)
    rooms, row = np.unique(number, return_inverse=True)
    means = np.empty(resamples)
    for draw in range(resamples):
        weight = np.bincount(rng.integers(len(rooms), size=len(rooms)), minlength=len(rooms))[row]
        one, other = rng.integers(trainings, size=(2, trainings))
        means[draw] = (without[one].mean(0) - nothing[other].mean(0)) @ weight / max(weight.sum(), 1)
    return float(without.mean() - nothing.mean()), *map(float, np.percentile(means, [2.5, 97.5]))


def as_table(scores: dict[str, list[dict[str, list]]], number: dict[str, list[int]]) -> str:
    """Markdown: what is left out -> by sensor the means over trainings and rooms, and how far these are from `nothing`.

    Args:
        scores: what is left out -> of each training `scores_of`; the first is `nothing`.
        number: sensor -> numbers of its test rooms.
    """
    lines = [f"| trained without | {' | '.join(number)} | precision, difference | F1, difference |"]
    lines.append("| --- |" + " --- |" * (len(number) + 2))
    rooms = np.concatenate([number[sensor] for sensor in number])
    pooled = {}
    for name, trainings in scores.items():
        own = {sensor: np.array([one[sensor] for one in trainings]) for sensor in number}  # (T, C, 3)
        pooled[name] = np.concatenate(list(own.values()), axis=1)
        cells = ["{:.4f}/{:.3f}/{:.3f}".format(*own[sensor].mean((0, 1))) for sensor in number]
        for column in (1, 2):
            parts = difference(pooled[name][..., column], pooled["nothing"][..., column], rooms)
            cells.append("-" if name == "nothing" else "{:+.3f} ({:+.3f} to {:+.3f})".format(*parts))
        lines.append(f"| {name} | {' | '.join(cells)} |")
    return "\n".join(lines)
