"""The main job in stages, each of which picks up where a killed run left off: data, training, evaluation, tables."""

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from jaxmm import run_folder
from jaxmm.config import CONDITIONS, MOST_ROOMS, SCENARIOS, Config
from jaxmm.data import labelled_rooms
from jaxmm.data.simulator_settings import CloudSource
from jaxmm.files import REMEDY, load_arrays, load_json, write_arrays, write_json
from jaxmm.inputs import InputError
from jaxmm.learning import result_tables, room_scores
from jaxmm.learning.batches import labels_of
from jaxmm.learning.boxes import Box, sentence
from jaxmm.learning.calibration import Reliability, brier, calibration_error
from jaxmm.learning.model import Model
from jaxmm.progress import progress
from jaxmm.reports import figures, room_figures
from jaxmm.runs.paper.whole_run import reproduce_paper
from jaxmm.runs.training_stage import train_stage

SENTENCES, RELIABILITY = "sentences.json", "reliability.json"
TOLD = ("labels", "step_count", "batch_size", "points_per_cloud", "learning_rate")  # of the training, in the table
EVERY_ROW = tuple((scenario, condition) for scenario in SCENARIOS for condition in CONDITIONS)
Scores = dict[tuple[str, str], list[dict[str, Any]]]  # (scenario, condition) -> room_scores.score_room of each room


def reproduce(config: Config, folder: Path | str) -> None:
    """Generate, train, evaluate; write tables and figures into the run folder and the table to the terminal."""
    folder = Path(folder)
    if config.paper.rows == "all":
        reproduce_paper(config, folder)
        return
    with run_folder.open_run(folder, config):
        models = train_stage(config, folder)
        rooms = evaluate_stage(config, folder, models, config.data.test_rooms, EVERY_ROW)
        write_results(config, folder, folder, rooms)
        figure_stage(config, folder)
    _print_results(folder)


def evaluate(
    run: Path | str, rows: Iterable[tuple[str, str]] = EVERY_ROW, room_count: int | None = None
) -> tuple[list[dict[str, Any]], Path]:
    """Score held-out rooms with the models of a run, as `jaxmm evaluate` does.

    Args:
        run: run folder with trained models.
        rows: which (scenario, condition).
        room_count: test rooms a row; None: as configured. Of another number the scores have a folder of their own.

    Returns:
        The rows of the table that were asked for, and the file of the table of all rows scored so far.

    Raises:
        InputError: no run folder, one without models, a row that there is not, or a number of rooms that there is not.
    """
    run, rows = Path(run), tuple(rows)
    settings = run_folder.read_config(run)
    if unknown := [row for row in rows if row not in EVERY_ROW]:
        raise InputError(f"rows: expected some of {EVERY_ROW}, got {unknown}")
    if not (run / run_folder.MODELS).exists():
        raise InputError(f"{run}: expected trained models in {run_folder.MODELS}, found none")
    count = settings.data.test_rooms if room_count is None else room_count
    if not 1 <= count <= MOST_ROOMS:
        raise InputError(f"--rooms: expected at least 1 and at most {MOST_ROOMS}, got {count}")
    folder = run if count == settings.data.test_rooms else run / "evaluations" / f"{count}_rooms"
    with run_folder.open_run(run, settings):
        models = train_stage(settings, run)
        write_results(settings, run, folder, evaluate_stage(settings, folder, models, count, rows))
    asked = {(scenario.replace("_", " "), condition) for scenario, condition in rows}
    found = [row for row in result_tables.read_rows(folder) if (row["test_case"].lower(), row["condition"]) in asked]
    return found, folder / "table_1.json"


def evaluate_stage(
    config: Config, folder: Path, models: dict[str, Model], room_count: int, rows: Iterable[tuple[str, str]]
) -> Scores:
    """Score the test rooms of some rows, and return those of all rows in the folder; none is made twice."""
    for scenario, condition in rows:
        path = folder / "rooms" / f"{scenario}_{condition}.json"
        if not path.exists() or _lacks_example(config, path):
            source = CloudSource(scenario, scenario, condition, config.data.test_seed)
            write_json(path, list(_score_rooms(config, folder, models, source, room_count)))
    return _all_scores(folder, room_count)


def _lacks_example(config: Config, path: Path) -> bool:
    """Whether a row is scored, but the room that figures show of it is gone."""
    shown = any(room["positives"]["true"] >= config.evaluate.least_positives for room in _load_rooms(path))
    return shown and not path.with_suffix(".npz").exists()


def _load_rooms(path: Path) -> list[dict[str, Any]]:
    rooms = load_json(path)
    if not isinstance(rooms, list) or not all(isinstance(room, dict) and "positives" in room for room in rooms):
        raise InputError(f"{path}: expected the scores of rooms; {REMEDY}")
    return rooms


def _all_scores(folder: Path, room_count: int) -> Scores:
    """The scores of every row that a folder holds."""
    scored = {}
    for scenario, condition in EVERY_ROW:
        path = folder / "rooms" / f"{scenario}_{condition}.json"
        if path.exists():
            scored[scenario, condition] = rooms = _load_rooms(path)
            if len(rooms) != room_count:
                raise InputError(f"{path}: expected {room_count} rooms, found {len(rooms)}; {REMEDY}")
    return scored


def _score_rooms(
    config: Config, folder: Path, models: dict[str, Model], source: CloudSource, count: int
) -> Iterator[dict[str, Any]]:
    """Score room after room; the first with enough positives is kept whole, for the figures."""
    example = folder / "rooms" / f"{source.scenario}_{source.condition}.npz"
    kept = False
    made = labelled_rooms.clouds(config, source, np.arange(count))
    label = f"score test rooms: {source.scenario.replace('_', ' ')}, {source.condition}"
    for cloud, truth in progress(made, label, count):
        scores = room_scores.scores_of(cloud, source.scenario, models, config.network)
        if not kept and (cloud.true & cloud.testable).sum() >= config.evaluate.least_positives:
            kept = True
            label, void = labels_of(cloud, "true")
            arrays = {"points": cloud.points, "label": label, "void": void, "room": np.array(truth.index)}
            write_arrays(example, arrays | {f"score {method}": score for method, score in scores.items()})
        yield room_scores.score_room(cloud, truth, source.scenario, scores, config)


def write_results(config: Config, run: Path, folder: Path, rooms: Scores) -> None:
    """Write the table in its three forms, and what the models say in words; `run` holds the versions behind them."""
    flat = [room for key, members in rooms.items() for room in room_scores.flat_rooms(members, *key)]
    rows = result_tables.table_rows(flat, config.evaluate, result_tables.reported_values())
    meta = {
        "seed": config.seed,
        "test_seed": config.data.test_seed,
        "test_rooms_per_row": max(map(len, rooms.values())),
        "least_positives": config.evaluate.least_positives,
        "interval": "95 % percentile bootstrap over rooms",
        "scan": config.scan.thawed(),
        "train": {name: getattr(config.train, name) for name in TOLD},
        "versions": load_json(run / run_folder.VERSIONS),
    }
    result_tables.write_table(folder, rows, meta)
    write_json(folder / SENTENCES, _sentences(rooms, config.train.methods[0]))
    write_json(folder / RELIABILITY, _reliability(config, rooms))


def _reliability(config: Config, rooms: Scores) -> dict[str, dict[str, dict[str, Any]]]:
    """By method and row, and over the rows of each condition: ECE, Brier score, and what they are made of."""
    groups = {f"{scenario} {condition}": members for (scenario, condition), members in rooms.items()}
    for condition in CONDITIONS:
        groups[f"all {condition}"] = [room for key, members in rooms.items() if key[1] == condition for room in members]
    return {
        method: {
            name: {"ece": calibration_error(sums), "brier": brier(sums)}
            | {key: np.asarray(value).tolist() for key, value in sums._asdict().items()}
            for name, members in groups.items()
            if members
            for sums in [room_scores.reliability_of(members, method)]
        }
        for method in config.train.methods
    }


def _sentences(rooms: Scores, method: str) -> list[dict[str, Any]]:
    """Every box that one method found, in words, with where it was found and whether it is right."""
    said = []
    for (scenario, condition), members in rooms.items():
        for room in members:
            for box in room["methods"][method]["boxes"]:
                arrays = np.array(box["center"]), np.array(box["dimensions"])
                text = sentence(Box(box["object_type"], *arrays), box["mismatch_type"])
                place = {"scenario": scenario, "condition": condition, "room": room["room"], "method": method}
                said.append(place | {"right": box["right"], "sentence": text})
    return said


def figure_stage(config: Config, folder: Path) -> None:
    """Draw training curves of each method, and for each row one test room as each method sees it."""
    records = run_folder.read_records(folder)
    for method in config.train.methods:
        curves = figures.curves_from_records(records, method, SCENARIOS)
        figures.loss_curves(curves, folder / "figures" / f"loss_{method}.png", f"{method}: focal loss")
        figures.validation_curves(curves, folder / "figures" / f"validation_{method}.png", f"{method}: validation")
        told = load_json(folder / RELIABILITY)[method]
        sums = {name: Reliability(*(np.array(told[name][key]) for key in Reliability._fields)) for name in told}
        shown = {condition: sums[f"all {condition}"] for condition in CONDITIONS if f"all {condition}" in sums}
        target = folder / "figures" / f"reliability_{method}.png"
        figures.reliability_curves(shown, target, f"{method}: probabilities on test rooms, true labels")
    examples = sorted((folder / "rooms").glob("*.npz"))
    for path in progress(examples, "draw figures", len(examples)):
        arrays = load_arrays(path)
        scored = ~arrays["void"]  # as in the table: what no method could know is not counted
        for method in config.train.methods:
            columns = (arrays["points"], arrays[f"score {method}"], arrays["label"])
            cloud = room_figures.ScoredCloud(*(column[scored] for column in columns))
            side = "DT scan" if "removed" in path.stem else "robot scan"
            title = f"{method} · {path.stem.replace('_', ' ')} · {side} of test room {int(arrays['room'])}, true labels"
            target = folder / "figures" / f"{path.stem}_{method}.png"
            room_figures.room_report(cloud, target, title, config.evaluate.threshold)


def _print_results(folder: Path) -> None:
    print(result_tables.as_terminal(result_tables.read_rows(folder)))
    print(f"run folder: {folder}")
    examples = _examples(load_json(folder / SENTENCES))
    for said in examples:
        where = f"{said['scenario']}, {said['condition']}, test room {said['room']}, {said['method']}"
        print(f"{where}: {said['sentence']} ({'right' if said['right'] else 'wrong'})")
    if not examples:
        print("no model found a box in any test room, so there is no sentence to show")


def _examples(said: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Three of them: the first of each scenario, then whatever comes first."""
    places = [item["scenario"] for item in said]
    order = sorted(range(len(said)), key=lambda i: (places.index(places[i]) != i, i))
    return [said[i] for i in order[:3]]
