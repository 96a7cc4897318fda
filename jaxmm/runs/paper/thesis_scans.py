"""The second table: the thesis's own released scans, where JAXMM_DATA holds its repository below `thesis/`.

Released weights, its method trained anew on its rooms by our code, and ours that never saw a scan of it; each on the
released labels and, where the changed element is known, on labels by element, with the count of points in which the
two differ. Stages: `thesis_models` and `thesis_rows`, which holds `<method>.json`, a list of rows of thesis.score_pair.
"""

import dataclasses
import hashlib
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from jaxmm import run_folder
from jaxmm.config import SCENARIOS, Config
from jaxmm.files import load_json, write_json
from jaxmm.learning import model_files
from jaxmm.learning.joint_training import Entry, Joint
from jaxmm.learning.labels import labels_by_element
from jaxmm.learning.metrics import METRICS
from jaxmm.learning.model import Model
from jaxmm.learning.room_scores import CONTROL
from jaxmm.progress import progress
from jaxmm.rays.rule import RULE
from jaxmm.runs.paper.models import WORDS, as_settings, load_networks
from jaxmm.runs.paper.rows import titled
from jaxmm.runs.paper.scenes import data_root
from jaxmm.runs.paper.scores import EVIDENCE, weights_digest
from jaxmm.runs.stages import Stage, key_of, open_stage
from jaxmm.runs.training_stage import fitted
from jaxmm.thesis.repository import Scorer, ThesisPair, find_pairs, read_pair, score_pair
from jaxmm.thesis.rows import RELEASED, box_finder, by_network, scorers_of
from jaxmm.thesis.training_clouds import thesis_clouds
from jaxmm.weights import DEFAULT

RETRAINED = "nn"  # the features of the released networks, which the thesis ended with
METHODS = (RELEASED, RETRAINED, CONTROL, RULE, EVIDENCE)


def thesis_table(config: Config, run: Path) -> list[dict[str, Any]]:
    """One row for each test pair, method and kind of labels; none without the repository."""
    folder = data_root()
    if folder is None or not (folder / "thesis" / "datasets").is_dir():
        return []
    root = folder / "thesis"
    content = _content(root)
    models, key = _retrained(config, run, (root, content))
    pairs = find_pairs(root)
    settings = {"content": content, "weights": weights_digest(), "evaluate": as_settings(config, "evaluate")}
    stage = Stage("thesis_rows", settings, ("jaxmm.thesis.rows",), (*WORDS, "jaxmm.learning.result_tables"), (key,))
    scored = open_stage(run, stage)
    rows = []
    for method in METHODS:
        path = scored / f"{method}.json"
        if not path.exists():
            scorers = _scorers(config, method, root, models)
            found = [_scored(pair, scorers, method) for pair in progress(pairs, f"thesis scans: {method}", len(pairs))]
            write_json(path, found)
        rows += [row for one in load_json(path) for row in _rows(one, method)]
    return rows


def _retrained(config: Config, run: Path, data: tuple[Path, str]) -> tuple[dict[str, Model], str]:
    """The thesis's method trained on its rooms by our code, and the key of that stage."""
    root, content = data
    plain = dataclasses.replace(config, train=dataclasses.replace(config.train, labels="heuristic"))
    settings = as_settings(plain, "seed", "network", "loss", "train") | {"content": content}
    for name in ("methods", "augment", "calibrate"):
        del settings["train"][name]
    stage = Stage(
        "thesis_models",
        settings,
        ("jaxmm.learning.fit", "jaxmm.thesis.training_clouds"),
        (*WORDS, "jaxmm.learning.room_scores"),
    )
    folder = open_stage(run, stage)
    if not (folder / run_folder.MODELS).exists():
        clouds = zip(SCENARIOS, *thesis_clouds(root), strict=True)
        entries = tuple(Entry("nn_thesis", name, RETRAINED, "heuristic", 1, *both) for name, *both in clouds)
        joint = Joint(entries, "joint", config.train.batch_size, config.train.points_per_cloud, config.seed)
        label = "train thesis networks on the thesis's rooms"
        best, records = fitted(joint, joint.validation(), plain, folder, (label, []))
        run_folder.write_records(folder, records)
        model_files.save_models(folder / run_folder.MODELS, joint.models(best), plain)
    return load_networks(run, "thesis_models"), key_of(stage)


def _scorers(config: Config, method: str, root: Path, models: dict[str, Model]) -> dict[str, Scorer]:
    if method == RETRAINED:
        make: Callable[[Model], Scorer] = partial(by_network, method=method, network=config.network)
        return {name: make(models[f"nn_thesis/{name}"]) for name in SCENARIOS}
    return scorers_of(method, root, DEFAULT if method == EVIDENCE else None, set(SCENARIOS))


def _scored(pair: ThesisPair, scorers: dict[str, Scorer], method: str) -> dict[str, Any]:
    row = score_pair(pair, scorers[pair.scenario], box_finder(pair.scenario, method))
    return row | {"wrong_labels": _wrong(pair)}


def _wrong(pair: ThesisPair) -> int | None:
    """Points whose released label is not that of the changed element; None where that is not known."""
    scan = read_pair(pair)
    if scan.element is None or not scan.label.any():
        return None
    label, void = labels_by_element(scan.label, scan.element, scan.distance)
    return int(np.sum((label != scan.label) & ~void))


def _rows(scored: dict[str, Any], method: str) -> list[dict[str, Any]]:
    names = {
        "source": scored["source"],
        "test_case": titled(scored["scenario"]),
        "condition": scored["condition"],
        "room": scored["room"],
        "method": method,
    }
    counts = {name: scored[name] for name in ("points", "positives", "wrong_labels")}
    rows = [names | {"label_kind": "released"} | {name: scored[name] for name in METRICS} | counts]
    if scored["by_element"] is not None:
        metrics = dict.fromkeys(METRICS) | scored["by_element"]
        rows.append(names | {"label_kind": "by element"} | metrics | counts)
    return rows


def _content(root: Path) -> str:
    """sha256 over all files of the repository that are read here."""
    digest = hashlib.sha256()
    for path in sorted(path for kind in ("npy", "csv", "pth") for path in root.rglob(f"*.{kind}")):
        digest.update(path.relative_to(root).as_posix().encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()


def as_markdown(rows: list[dict[str, Any]]) -> str:
    """ROC AUC and precision at 95 % recall: a line a pair and kind of labels, a column a method."""
    lines = ["ROC AUC / precision at 95 % recall; wrong: points whose released label is not the changed element's", ""]
    lines += [f"| test pair | labels | points | positives | wrong | {' | '.join(METHODS)} |"]
    lines += ["|" + " --- |" * (5 + len(METHODS))]
    keys = ("source", "test_case", "condition", "room", "label_kind")
    for key in dict.fromkeys(tuple(row[name] for name in keys) for row in rows):
        at = {row["method"]: row for row in rows if tuple(row[name] for name in keys) == key}
        one = next(iter(at.values()))
        wrong = "-" if one["wrong_labels"] is None else one["wrong_labels"]
        cells = [f"{key[0]} {key[1].lower()}, {key[2]}", key[4], one["points"], one["positives"], wrong]
        cells += [_cell(at.get(name)) for name in METHODS]
        lines.append(f"| {' | '.join(map(str, cells))} |")
    return "\n".join(lines) + "\n"


def _cell(row: dict[str, Any] | None) -> str:
    if row is None or row["roc_auc"] is None:
        return "-"
    return f"{row['roc_auc']:.4f} / {row['precision_at_95']:.3f}"
