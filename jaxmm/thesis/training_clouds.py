"""The training rooms of the thesis's repository as labelled clouds, to train its method on what it was trained on."""

from pathlib import Path

import numpy as np

from jaxmm.config import SCENARIOS
from jaxmm.inputs import InputError
from jaxmm.learning.batches import LabelledCloud
from jaxmm.thesis.repository import ThesisScan, find_pairs, read_pair

Clouds = list[list[LabelledCloud]]  # by scenario


def thesis_clouds(root: Path | str) -> tuple[Clouds, Clouds]:
    """Training and validation clouds of each scenario, in the order of config.SCENARIOS.

    The last room of a scenario validates: a fifth or a sixth of them, like the thesis's share. It drew scans at random,
    so that a room's clean scan could train and its occluded one validate; rooms here are on one side of the split.

    Raises:
        InputError: see `repository.find_pairs` and `repository.read_pair`; or a scenario has fewer than two rooms.
    """
    pairs = [pair for pair in find_pairs(root, "train") if pair.source == "synthetic"]
    training, validation = [], []
    for scenario in SCENARIOS:
        own = [pair for pair in pairs if pair.scenario == scenario]
        rooms = sorted({pair.room for pair in own})
        if len(rooms) < 2:
            raise InputError(f"{root}: expected at least two training rooms of {scenario}, found {len(rooms)}")
        training.append([_cloud(read_pair(pair)) for pair in own if pair.room != rooms[-1]])
        validation.append([_cloud(read_pair(pair)) for pair in own if pair.room == rooms[-1]])
    return training, validation


def _cloud(scan: ThesisScan) -> LabelledCloud:
    """Nothing but the released labels is known: they stand for the truth too, and no evidence is."""
    element = np.zeros(len(scan.points), np.int32) if scan.element is None else scan.element
    unknown = np.zeros((len(scan.points), 0), np.float32)
    return LabelledCloud(scan.points, scan.distance, element, scan.label, scan.label, scan.label, unknown)
