"""All four models on the rooms of all four scenarios: do pillar and wall models act alike, as the thesis remarks?

    python -m benchmarks.matrix [--model RUN|FILE] [--rooms 50] [--json matrix.json]

Rooms are varied ones of the test seed, occluded, with an ideal sensor. A model that looks at the side where the change
shows is asked to rank the changed points (ROC AUC, true labels); one that looks at the other side should find nothing,
and of it is told how many of the unchanged points it takes for changed.
"""

from pathlib import Path

import numpy as np

from benchmarks.accuracy import condition_config
from benchmarks.command_line import CommandLine
from jaxmm.config import SCENARIOS, Config
from jaxmm.data import labelled_rooms
from jaxmm.data.simulator_settings import CloudSource
from jaxmm.files import write_json
from jaxmm.learning import model_files, room_scores
from jaxmm.learning.batches import features_of, labels_of
from jaxmm.learning.metrics import point_metrics
from jaxmm.learning.model import Model, pick_model
from jaxmm.weights import DEFAULT

METHOD = "evidence"
FULL, SMOKE = {"rooms": 50}, {"rooms": 1}


def main(model: Path, rooms: int, path: Path | None) -> None:
    models, trained = model_files.load_models(model)
    config = condition_config(trained, "varied", rooms)
    cells = [_cell(config, models[METHOD], scene, scenario) for scene in SCENARIOS for scenario in SCENARIOS]
    if path:
        write_json(path, {"rooms": rooms, "cells": cells})
    print("rooms \\ model".ljust(16), *(name.ljust(22) for name in SCENARIOS))
    for start in range(0, len(cells), len(SCENARIOS)):
        row = cells[start : start + len(SCENARIOS)]
        print(row[0]["scene"].ljust(16), *(_told(cell).ljust(22) for cell in row))


def _cell(config: Config, models: Model, scene: str, scenario: str) -> dict:
    """Mean over rooms of one model's AUC, where it sees the change, and of its alarms."""
    same = scene.split("_")[1] == scenario.split("_")[1]
    source = CloudSource(scene if same else scenario, scene, "occluded", config.data.test_seed)
    model, found, alarms = pick_model(models, scenario), [], []
    for cloud, _ in labelled_rooms.clouds(config, source, np.arange(config.data.test_rooms)):
        features = features_of(METHOD, cloud.points, cloud.distance, cloud.evidence)
        score = room_scores.predict(model, features, config.network)
        label, void = labels_of(cloud, "true")
        alarms += [float(np.mean(score[~label] >= 0.5))] if np.any(~label) else []
        if same and np.sum(label & ~void) >= config.evaluate.least_positives:
            found.append(point_metrics(score, label, void).roc_auc)
    auc = float(np.mean(found)) if found else None
    return {"scene": scene, "model": scenario, "roc_auc": auc, "alarms": float(np.mean(alarms)), "rooms": len(alarms)}


def _told(cell: dict) -> str:
    alarms = f"{100 * cell['alarms']:.2f} % false"
    return alarms if cell["roc_auc"] is None else f"{cell['roc_auc']:.4f}, {alarms}"


if __name__ == "__main__":
    parser = CommandLine(__doc__, FULL, SMOKE)
    parser.add_argument("--model", type=Path, default=DEFAULT, help="run folder or .safetensors file")
    parser.add_argument("--rooms", type=int, help="test rooms a scenario")
    parser.add_argument("--json", type=Path, help="also write the cells to this file")
    options = parser.parse_args()
    main(options.model, options.rooms, options.json)
