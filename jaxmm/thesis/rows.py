"""`jaxmm thesis`: every test pair of the thesis's repository under one method, as rows of JSON."""

from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from jaxmm.config import SCENARIOS, Config, NetworkConfig
from jaxmm.files import check_writable, write_json
from jaxmm.inputs import InputError
from jaxmm.learning.batches import features_of
from jaxmm.learning.model import Model, pick_model
from jaxmm.learning.model_files import load_models
from jaxmm.learning.network import from_torch
from jaxmm.learning.room_scores import CONTROL, box_as_json, find_boxes, predict
from jaxmm.learning.torch_weights import read_state_dict
from jaxmm.rays.rule import RULE, rule_scores
from jaxmm.thesis.evidence import evidence_features, viewpoint_of
from jaxmm.thesis.repository import Scorer, find_pairs, find_weights, nn_raw, score_pair
from jaxmm.versions import versions
from jaxmm.weights import DEFAULT

RELEASED = "released"
EVIDENCE = "evidence"


def score_repository(root: Path, method: str, weights: Path | None, model: Path | None, out: Path) -> None:
    """Score all test pairs below `root` and write {"rows": [...], "meta": {...}} to `out`.

    Args:
        root: the thesis's repository.
        method: "released", "nn-raw", "rule", or a method that `model` was trained with.
        weights: where the released .pth files are, when not below `root`; only for "released".
        model: run folder or .safetensors file; only for our trained methods. Default with "evidence": our own models.
        out: JSON file to write.

    Raises:
        InputError: files are missing or damaged, or an option does not fit the method.
    """
    if weights is not None and method != RELEASED:
        raise InputError(f"--weights: only for --method {RELEASED}, got --method {method}")
    trained = method not in (RELEASED, CONTROL, RULE)
    if method == EVIDENCE and model is None:
        model = DEFAULT
    if trained != (model is not None):
        wish = "expected a run folder or .safetensors file" if trained else "only for our trained methods"
        raise InputError(f"--model: {wish}, with --method {method}")
    check_writable(out, "--out")
    pairs = find_pairs(root)
    scenarios = {pair.scenario for pair in pairs}
    scorers = scorers_of(method, weights or root, model, scenarios)
    gathers = method in (RULE, EVIDENCE)
    blind = scorers_of(method, weights or root, model, scenarios, elements=False) if gathers else {}
    rows = []
    for pair in pairs:
        try:
            rows.append(score_pair(pair, scorers[pair.scenario], box_finder(pair.scenario, method)))
            if gathers:
                rows[-1]["without_elements"] = score_pair(pair, blind[pair.scenario])["by_element"]
        except InputError as error:
            named = str(pair.scored.parent) in str(error)
            raise InputError(str(error) if named else f"{pair.scored}: {error}") from error
        print(_line(rows[-1]))
    write_json(out, {"rows": rows, "meta": {"method": method, "versions": versions()}})


def scorers_of(
    method: str, weights: Path, model: Path | None, scenarios: set[str], *, elements: bool = True
) -> dict[str, Scorer]:
    """Scenario -> scorer; `elements` says whether evidence may know those of the prior."""
    if method == RULE:
        judges = {name: partial(rule_scores, removed=name.endswith("removed")) for name in scenarios}
        return {name: _by_evidence(name, judge, elements=elements) for name, judge in judges.items()}
    if method == CONTROL:
        return dict.fromkeys(scenarios, nn_raw)
    if method == RELEASED:
        paths = find_weights(weights)
        if missing := sorted(scenarios - paths.keys()):
            raise InputError(f"{weights}: expected released networks of every scenario, found none of {missing}")
        return {scenario: _released(paths[scenario]) for scenario in sorted(scenarios)}
    models, config = load_models(model)
    if method not in models:
        raise InputError(f"{model}: expected models of method {method}, found {', '.join(models)}")
    if method == EVIDENCE:
        judges = {
            name: partial(predict, pick_model(models[method], name), network=config.network) for name in SCENARIOS
        }
        return {name: _by_evidence(name, judge, elements=elements) for name, judge in judges.items()}
    return {name: by_network(pick_model(models[method], name), method, config.network) for name in SCENARIOS}


def _released(path: Path) -> Scorer:
    try:
        params, batch_stats, network = from_torch(read_state_dict(path))
    except InputError as error:
        raise InputError(str(error) if str(path) in str(error) else f"{path}: {error}") from error
    inputs = params["conv1"]["kernel"].shape[0]
    methods = {1: "nn", 4: "xyz_nn"}
    if inputs not in methods:
        raise InputError(f"{path}: expected a network of 1 or 4 features, got {inputs}")
    return by_network(Model(params, batch_stats), methods[inputs], network)


def by_network(model: Model, method: str, network: NetworkConfig) -> Scorer:
    """Scores by one network that sees the features of `method`."""
    return lambda scan: predict(model, features_of(method, scan.points, scan.distance), network)


def _by_evidence(scenario: str, judge: Callable[[np.ndarray], np.ndarray], *, elements: bool) -> Scorer:
    """Gathers evidence (N, F) of a scan and has it judged."""
    return lambda scan: judge(evidence_features(scan, scenario, viewpoint_of(scan), elements=elements))


def box_finder(scenario: str, method: str) -> Callable[[np.ndarray, np.ndarray], list[dict]]:
    """Finds the boxes of one scenario's model under a method, as they go into a row."""

    def boxes(points: np.ndarray, score: np.ndarray) -> list[dict]:
        return [box_as_json(box, scenario) for box in find_boxes(points, score, scenario, method, Config())]

    return boxes


def _line(row: dict) -> str:
    name = f"{row['source']} {row['scenario']} {row['room']} {row['condition']}"
    if row["roc_auc"] is None:
        return f"{name}: all points of one label, largest score {row['max_probability']:.4f}, {len(row['boxes'])} boxes"
    told = _scores(row)
    if row["by_element"] and row["by_element"]["roc_auc"] is not None:
        told += f"; labels by element: {_scores(row['by_element'])}"
    return f"{name}: {told}; {len(row['boxes'])} boxes"


def _scores(row: dict) -> str:
    return f"AUC {row['roc_auc']:.4f}, FPR@95 {row['fpr_at_95']:.4f}, P@95 {row['precision_at_95']:.4f}"
