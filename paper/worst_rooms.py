"""The worst test rooms of a condition, drawn: where points are, how sure the model is, and how right.

    python paper/worst_rooms.py runs/accuracy/varied --out figures [--model RUN|FILE] [--count 5]

Reads the scores of every room, makes the worst rooms again and draws one page each. Rooms are ranked by precision at
95 % recall, then by ROC AUC, true labels, over all eight rows.
"""

import argparse
import json
from pathlib import Path

import numpy as np

from jaxmm import run_folder
from jaxmm.config import CONDITIONS, SCENARIOS
from jaxmm.data import labelled_rooms
from jaxmm.data.simulator_settings import CloudSource
from jaxmm.learning import model_files, room_scores
from jaxmm.learning.batches import labels_of
from jaxmm.reports.room_figures import ScoredCloud, room_report
from jaxmm.weights import DEFAULT

METHOD = "evidence"


def main(folder: Path, model: Path, out: Path, count: int) -> None:
    config = run_folder.read_config(folder)
    models, _ = model_files.load_models(model)
    out.mkdir(parents=True, exist_ok=True)
    for place, (precision, auc, scenario, condition, room) in enumerate(_ranked(folder)[:count], start=1):
        source = CloudSource(scenario, scenario, condition, config.data.test_seed)
        ((cloud, _),) = labelled_rooms.clouds(config, source, np.array([room]))
        score = room_scores.scores_of(cloud, scenario, models, config.network)[METHOD]
        label, void = labels_of(cloud, "true")
        scored = ScoredCloud(cloud.points[~void], score[~void], label[~void])
        told = (
            f"{scenario.replace('_', ' ')}, {condition}, room {room}: AUC {auc:.4f}, precision at 95 % {precision:.3f}"
        )
        target = out / f"worst_{place}_{scenario}_{condition}_{room}.png"
        room_report(scored, target, told, config.evaluate.threshold)
        print(f"{target}: {told}")


def _ranked(folder: Path) -> list[tuple[float, float, str, str, int]]:
    """(precision at 95 % recall, AUC, scenario, condition, room) of every room with positives, the worst first."""
    found = []
    for scenario in SCENARIOS:
        for condition in CONDITIONS:
            for room in json.loads((folder / "rooms" / f"{scenario}_{condition}.json").read_text()):
                metrics = room["methods"][METHOD]["metrics"]["true"]
                if metrics["roc_auc"] is not None and room["positives"]["true"] >= 20:
                    row = metrics["precision_at_95"], metrics["roc_auc"], scenario, condition, room["room"]
                    found.append(row)
    return sorted(found)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="run folder of one condition, as benchmarks.accuracy writes it")
    parser.add_argument("--model", type=Path, default=DEFAULT, help="run folder or .safetensors file")
    parser.add_argument("--out", type=Path, required=True, help="folder of the figures")
    parser.add_argument("--count", type=int, default=5)
    options = parser.parse_args()
    main(options.folder, options.model, options.out, options.count)
