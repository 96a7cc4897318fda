"""Scores of one held-out room: how each method ranks its points, and which boxes it finds."""

from typing import Any, NamedTuple

import numpy as np

from jaxmm.config import TRAINED_METHODS, Config, NetworkConfig
from jaxmm.learning.batches import LabelledCloud, features_of, labels_of
from jaxmm.learning.box_match import match_boxes
from jaxmm.learning.boxes import Box, BoxSettings, fit_boxes
from jaxmm.learning.calibration import Reliability, reliability
from jaxmm.learning.metrics import point_metrics
from jaxmm.learning.model import Model, pick_model
from jaxmm.learning.result_tables import LABEL_KINDS
from jaxmm.learning.train_step import probabilities
from jaxmm.rays.rule import RULE, rule_scores

CONTROL = "nn-raw"  # the distance itself, without a network
BUCKET = 4096  # clouds are padded to a multiple of this many points, so that few shapes are compiled


class RoomTruth(NamedTuple):
    """What the simulator knows of one room."""

    index: int
    box: Box  # of the changed object
    observable_fraction: float  # testable rays of an object over the rays that would hit it alone; the mean over all
    others: tuple[Box, ...] = ()  # further changed objects of the same kind

    @property
    def boxes(self) -> list[Box]:
        """All changed objects of the kind that is looked for; none where nothing of it changed."""
        return [box for box in (self.box, *self.others) if np.isfinite(box.center).all()]


def predict(model: Model, features: np.ndarray, network: NetworkConfig) -> np.ndarray:
    """Probabilities (N,) float32 of one cloud's features (N, F) under one model."""
    count = len(features)
    padded = np.zeros((max(-(-count // BUCKET), 1) * BUCKET, features.shape[1]), np.float32)
    padded[:count] = features
    return np.asarray(probabilities(model, padded, np.arange(len(padded)) < count, network))[:count]


def scores_of(cloud: LabelledCloud, scenario: str, models: dict[str, Model], network: NetworkConfig) -> dict[str, Any]:
    """Score (N,) of every point by method: the control's is a distance [m], the others' are probabilities."""
    scores = {CONTROL: cloud.distance}
    if cloud.evidence.shape[1]:
        scores[RULE] = rule_scores(cloud.evidence, removed=scenario.endswith("removed"))
    for method, stacked in models.items():
        model = pick_model(stacked, scenario)
        scores[method] = predict(model, features_of(method, cloud.points, cloud.distance, cloud.evidence), network)
    return scores


def find_boxes(points: np.ndarray, score: np.ndarray, scenario: str, method: str, config: Config) -> list[Box]:
    """Boxes of one scenario's model. For the control a point is changed where the labels' own threshold says so."""
    probability = (score > config.preprocess.label_distance).astype(np.float32) if method == CONTROL else score
    settings = BoxSettings(threshold=config.evaluate.threshold)
    return fit_boxes(points, probability, scenario.split("_")[0], settings)


def score_room(
    cloud: LabelledCloud, truth: RoomTruth, scenario: str, scores: dict[str, np.ndarray], config: Config,
    boxed: dict[str, np.ndarray] | None = None,
):  # fmt: skip
    """Everything a table needs of one room, as JSON; `boxed` are scores by which a method's boxes are found instead."""
    labels = {kind: labels_of(cloud, kind) for kind in LABEL_KINDS}
    methods = {}
    for method, score in scores.items():
        boxes = find_boxes(cloud.points, (boxed or {}).get(method, score), scenario, method, config)
        right = {match.found for match in match_boxes(boxes, truth.boxes)}
        methods[method] = {
            "boxes": [box_as_json(box, scenario) | {"right": i in right} for i, box in enumerate(boxes)],
            "boxes_matched": len(right),
            "boxes_found": len(boxes),
            "boxes_true": len(truth.boxes),
            "metrics": {kind: point_metrics(score, *labels[kind])._asdict() for kind in LABEL_KINDS},
        }
        if method in TRAINED_METHODS:
            label, void = labels["true"]
            sums = reliability(score[~void], label[~void])._asdict()
            methods[method]["reliability"] = {name: np.round(value, 6).tolist() for name, value in sums.items()}
    return {
        "room": truth.index,
        "points": len(cloud.points),
        "positives": {"heuristic": int(cloud.heuristic.sum()), "true": int((cloud.true & cloud.testable).sum())},
        "observable_fraction": truth.observable_fraction if truth.boxes else None,
        "true_box": box_as_json(truth.boxes[0], scenario) if truth.boxes else None,
        **({"other_boxes": [box_as_json(box, scenario) for box in truth.others]} if truth.others else {}),
        "methods": methods,
    }


def flat_rooms(rooms: list[dict[str, Any]], scenario: str, condition: str) -> list[dict[str, Any]]:
    """One flat dict per room, label kind and method, in that order of meaning: what result_tables.table_rows takes."""
    return [
        {
            "scenario": scenario,
            "condition": condition,
            "label_kind": kind,
            "method": method,
            "positives": room["positives"][kind],
            "observable_fraction": room["observable_fraction"],
            **{name: scored[name] for name in ("boxes_matched", "boxes_found", "boxes_true")},
            **scored["metrics"][kind],
        }
        for room in rooms
        for kind in LABEL_KINDS
        for method, scored in room["methods"].items()
    ]


def reliability_of(rooms: list[dict[str, Any]], method: str) -> Reliability:
    """How well a method's probabilities are calibrated over all points of some rooms, true labels."""
    sums = [room["methods"][method]["reliability"] for room in rooms]
    return Reliability(*(np.sum([one[name] for one in sums], axis=0) for name in Reliability._fields))


def box_as_json(box: Box, scenario: str) -> dict[str, Any]:
    """A box under the names of the report contract: metres, world frame, rotation a yaw in degrees."""
    return {
        "object_type": box.object_type,
        "shape": box.shape,
        "mismatch_type": scenario.split("_")[1],
        "center": [round(float(value), 6) for value in box.center],
        "dimensions": [round(float(value), 6) for value in box.dimensions],
        "rotation": float(box.rotation),
        "probability": float(box.probability),
    }
