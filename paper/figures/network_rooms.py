"""What the thesis's way finds in test rooms: its network as a run trained it, its boxes, its settings."""

import dataclasses
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from jaxmm.config import Config
from jaxmm.learning.batches import features_of
from jaxmm.learning.boxes import Box, BoxSettings, fit_boxes
from jaxmm.learning.model import Model
from jaxmm.learning.room_scores import predict
from jaxmm.runs.paper.rows import TRAININGS, TestScenes
from jaxmm.runs.paper.scenes import room_scenes

TRIED = 100  # test rooms before something counts as not found


class Found(NamedTuple):
    """What was found in one room."""

    points: np.ndarray  # (N, 3) [m] of the scan that the model looks at
    probability: np.ndarray  # (N,)
    changed: np.ndarray  # (N,) bool
    boxes: list[Box]
    true: list[Box]


class Asked(NamedTuple):
    """Which rooms, and whose model looks at them."""

    scenes: TestScenes
    scenario: str
    training: str  # of its network, key of paper_rows.TRAININGS


def first_room(
    config: Config, networks: dict[str, Model], asked: Asked, shows: Callable[[Found], bool]
) -> tuple[int, Found] | None:
    """Number of the first test room that shows something, and what was found there; None where none does."""
    return next(((room, found) for room, found in _rooms(config, networks, asked) if shows(found)), None)


def _rooms(config: Config, networks: dict[str, Model], asked: Asked) -> Iterator[tuple[int, Found]]:
    plain = dataclasses.replace(config, preprocess=dataclasses.replace(config.preprocess, evidence="none"))
    network, settings = networks[f"{asked.training}/{asked.scenario}"], BoxSettings()
    for scene in room_scenes(plain, asked.scenes, (asked.scenario,), TRIED):
        cloud, truth, _ = scene.views[asked.scenario]
        features = features_of(TRAININGS[asked.training].features, cloud.points, cloud.distance)
        probability = predict(network, features, config.network)
        boxes = fit_boxes(cloud.points, probability, asked.scenario.split("_")[0], settings)
        yield scene.number, Found(cloud.points, probability, probability >= settings.threshold, boxes, truth.boxes)
