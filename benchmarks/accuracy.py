"""How well models rank changed points in rooms they never saw, under many conditions, beside the rule and raw distance.

    python -m benchmarks.accuracy --out runs/accuracy [--model RUN|FILE] [--rooms 200] [--only thesis varied ...]

Each condition is a run folder of its own below `--out`, with its settings, the table of its eight rows and the scores
of every room; what is there is not made again. Rooms are drawn from the test seed. Prints one line a row: mean ROC AUC
and precision at 95 % recall of each method, true labels, and the lower ends of the intervals of the models' own.
"""

import dataclasses
import hashlib
from pathlib import Path
from typing import Any

from benchmarks.command_line import CommandLine
from jaxmm import run_folder
from jaxmm.config import Config, Table
from jaxmm.files import load_json, write_json
from jaxmm.inputs import InputError
from jaxmm.learning import model_files, result_tables
from jaxmm.runs import main_job
from jaxmm.weights import DEFAULT

MARGIN = 0.1  # [m] ranges must differ by more to be testable; with noise, by three standard deviations more
IDEAL = {"sensor": "oak-d-pro-small", "position_error": 0.0, "angle_error": 0.0, "range_noise": 0.0,
         "range_noise_spread": 0.0, "erring_share": 1.0}  # fmt: skip
PLAIN = {"object_filter": "height", "evidence": "exact", "registration": "none", "viewpoint_estimated": 0.0}


def _noisy(sigma: float) -> dict[str, Any]:
    return {"range_noise": sigma, "testable_margin": round(MARGIN + 3 * sigma, 6)}


def _lost(metres: float, degrees: float) -> dict[str, Any]:
    # Of each of three coordinates and two angles, so that the whole is about as far off as asked for.
    return {"position_error": round(metres / 3**0.5, 6), "angle_error": round(degrees / 2**0.5, 6)}


# Condition -> (scan settings, preprocess settings), on top of IDEAL and PLAIN.
CONDITIONS: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "thesis": ({"preset": "thesis"}, {}),
    "varied": ({}, {}),
    "unfiltered": ({}, {"object_filter": "none"}),
    "clouds": ({}, {"evidence": "cloud"}),
    "clouds_without_elements": ({}, {"evidence": "points"}),
    "clouds_without_pose": ({}, {"evidence": "points", "viewpoint_estimated": 1.0}),
    "real_sensor": ({"sensor": "oak-d-pro-small-real"}, {}),
    "noise_0.02": (_noisy(0.02), {}),
    "noise_0.1": (_noisy(0.1), {}),
    "misaligned": (_lost(0.05, 1.0), {"registration": "refine"}),
    "misaligned_as_is": (_lost(0.05, 1.0), {}),
} | {
    f"sweep_{metres:g}m_{degrees:g}deg{'' if registration == 'refine' else '_as_is'}": (
        _lost(metres, degrees), {"registration": registration},
    )
    for metres, degrees in ((0.0, 0.0), (0.1, 0.0), (0.3, 0.0), (0.0, 2.0), (0.0, 5.0), (0.1, 2.0), (0.3, 5.0))
    for registration in ("refine", "none")
}  # fmt: skip
FULL, SMOKE = {"rooms": 200, "only": []}, {"rooms": 1, "only": ["thesis"]}
SWEEP_SHARE = 5  # a point of the sweep takes so much fewer rooms


def condition_config(trained: Config, name: str, rooms: int) -> Config:
    """The settings of a condition, for models that were trained with others."""
    scan, preprocess = CONDITIONS[name]
    rooms = max(1, rooms // SWEEP_SHARE) if name.startswith("sweep") else rooms
    return dataclasses.replace(
        trained,
        scan=Table.of({"preset": "varied"} | IDEAL | scan),
        preprocess=dataclasses.replace(trained.preprocess, **PLAIN | preprocess),
        data=dataclasses.replace(trained.data, test_rooms=rooms),
    )


def main(model: Path, out: Path, rooms: int, only: list[str]) -> None:
    models, trained = model_files.load_models(model)
    for name in only or CONDITIONS:
        config, folder = condition_config(trained, name, rooms), out / name
        with run_folder.open_run(folder, config):
            _check_model(model, folder)
            scores = main_job.evaluate_stage(config, folder, models, config.data.test_rooms, main_job.EVERY_ROW)
            main_job.write_results(config, folder, folder, scores)
        print(name)
        for line in _lines(result_tables.read_rows(folder)):
            print(f"  {line}", flush=True)


def _check_model(model: Path, folder: Path) -> None:
    """Refuse to go on with rooms that other models scored."""
    path = model / run_folder.MODELS if model.is_dir() else model
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    told = folder / "model.json"
    if told.exists() and load_json(told) != digest:
        raise InputError(f"{folder}: holds scores of another model; choose another --out or remove it")
    write_json(told, digest)


def _lines(rows: list[result_tables.Row]) -> list[str]:
    rows = [row for row in rows if row["label_kind"] == "true"]
    cases = dict.fromkeys((row["test_case"], row["condition"]) for row in rows)
    return [_line([row for row in rows if (row["test_case"], row["condition"]) == case]) for case in cases]


def _line(rows: list[result_tables.Row]) -> str:
    if rows[0]["roc_auc"] is None:
        return f"{rows[0]['test_case']:15s} {rows[0]['condition']:9s} no room with enough points of the change"
    scores = [f"{row['method']} {row['roc_auc']:.4f}/{row['precision_at_95']:.3f}" for row in rows]
    last = rows[-1]["ci95"]
    low = f"from {last['roc_auc'][0]:.4f}/{last['precision_at_95'][0]:.3f}" if last["roc_auc"] else "one room"
    first = rows[0]
    rooms = f"{first['scene_count']}/{first['room_count']} rooms, observable {first['observable_share']:.2f}"
    return f"{first['test_case']:15s} {first['condition']:9s} {'  '.join(scores)}  {low}  ({rooms})"


if __name__ == "__main__":
    parser = CommandLine(__doc__, FULL, SMOKE)
    parser.add_out(about="folder of the conditions' run folders")
    parser.add_argument("--model", type=Path, default=DEFAULT, help="run folder or .safetensors file")
    parser.add_argument("--rooms", type=int, help="test rooms a row")
    parser.add_argument("--only", nargs="+", choices=CONDITIONS, help="some conditions only")
    options = parser.parse_args()
    main(options.model, options.out, options.rooms, options.only)
