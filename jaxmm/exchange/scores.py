"""How right predictions are, with intervals: every number is a function of how often each scene counts.

S scenes, D detections or elements of all scenes, one after the other. An interval is of 95 %, of scenes drawn with
replacement (percentile bootstrap).
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from jaxmm.exchange.object_scores import Found, average_precision, objects_found, precision_recall
from jaxmm.exchange.predictions import ELEMENTS, OBJECTS, POINTS, Prediction, read_prediction
from jaxmm.exchange.scene_files import read_about, read_truth, scene_names, split_of
from jaxmm.exchange.scenes import SAME, UNOBSERVABLE, Truth
from jaxmm.exchange.tasks import TEST
from jaxmm.inputs import InputError
from jaxmm.learning.calibration import Reliability, brier, calibration_error, reliability
from jaxmm.learning.metrics import point_metrics

RESAMPLES = 1000
LEAST_POSITIVES = 20  # points of a scene that show a change, for it to be ranked
CALLED = 0.5  # probability from which an element counts as called removed, and a box as found
DIFFICULTIES = {"all": (0, 1, 2, 3), "easy": (0,), "medium": (1,), "hard": (2, 3)}  # numbers of hurdles
SIDES = {"scan": "points added", "reference": "points removed"}
CLASSES = "points by class"
COVERAGES = (0.5, 0.8, 0.9, 0.95, 1.0)
RANKS = ("roc_auc", "fpr_at_95", "iou_at_95")

Statistic = Callable[[np.ndarray], float]  # of how often each scene counts (S,) float64; NaN: nothing to tell


class Scored(NamedTuple):
    """One scene: its truth, and what a method says."""

    truth: Truth
    said: Prediction


def score(folder: Path, predictions: Path, split: str = TEST, truth: Path | None = None) -> dict[str, Any]:
    """Score the predictions for all scenes of a split.

    Args:
        folder: of jaxmm benchmark export.
        predictions: folder of one file a scene.
        split: one of tasks.SPLITS.
        truth: file with the truth of the test split.

    Returns:
        {"split", "scenes", "rows": [{"part", "difficulty", "metric", "value", "interval", "count"}], "calibration",
        "risk_coverage", "precision_recall"}, as JSON has it.

    Raises:
        InputError: scenes or truth are missing or damaged; a prediction is missing or ill-formed.
    """
    names = scene_names(folder, split)
    if not predictions.is_dir():
        raise InputError(f"{predictions}: expected a folder of predictions, one file a scene, found none")
    if other := split_of(folder, predictions, split):
        raise InputError(
            f"{predictions}: expected predictions for the split {split}, found those for {other}: say --split {other}"
        )
    known = read_truth(folder, split, names, truth or Path())
    scenes = []
    for name in names:
        about = read_about(folder, split, name)
        counts = {what: about["points"][what] for what in POINTS} | {ELEMENTS: len(about["elements"])}
        told = known[name]
        if any(getattr(told, what).shape != (counts[what],) for what in counts):
            raise InputError(f"scene {name}: its truth is of other scenes than those in {folder}")
        scenes.append(Scored(told, read_prediction(predictions, name, counts)))
    return score_scenes(dict(zip(names, scenes, strict=True)), split, predictions)


def score_scenes(
    scenes: dict[str, Scored], split: str, where: Path | str, resamples: int = RESAMPLES
) -> dict[str, Any]:
    """The same of scenes that are at hand, by name; `where` they are from is told in errors."""
    told: dict[str, Any] = {"split": split, "scenes": len(scenes), "rows": [], "calibration": {}, "risk_coverage": [],
                            "precision_recall": []}  # fmt: skip
    whole = _evened(scenes, where)
    sums = _reliability_by_scene(whole)
    for difficulty, hurdles in DIFFICULTIES.items():
        own = [number for number, one in enumerate(whole) if int(one.truth.hurdles) in hurdles]
        if not own:
            continue
        part = [whole[number] for number in own]
        own_sums = {title: Reliability(*(field[own] for field in one)) for title, one in sums.items()}
        for title, metrics in _parts(part, own_sums).items():
            for metric, (statistic, count) in metrics.items():
                value, interval = estimate(statistic, len(part), resamples)
                told["rows"].append(
                    {"part": title, "difficulty": difficulty, "metric": metric, "value": value, "interval": interval,
                     "count": count, "scenes": len(part)}
                )  # fmt: skip
    if whole[0].said.objects is not None:
        found = objects_found([(one.truth.objects, one.said.objects) for one in whole])
        told["precision_recall"] = precision_recall(found)
    for title, one in sums.items():
        told["calibration"][title] = [
            {"probability": float(expected / count), "frequency": float(found / count), "count": int(count)}
            for count, expected, found in zip(*_weighted(one, np.ones(len(whole)))[:3], strict=True) if count
        ]  # fmt: skip
    if whole[0].said.elements is not None:
        told["risk_coverage"] = risk_coverage(_elements(whole), np.ones(len(whole)))
    return told


def estimate(statistic: Statistic, scenes: int, resamples: int = RESAMPLES) -> tuple[float | None, list[float] | None]:
    """A statistic of all scenes, and its 95 % interval; None where there is nothing to tell."""
    value = statistic(np.ones(scenes))
    if not np.isfinite(value):
        return None, None
    draws = np.random.default_rng(0).multinomial(scenes, np.full(scenes, 1.0 / scenes), resamples).astype(np.float64)
    drawn = np.array([statistic(weight) for weight in draws])
    low, high = np.percentile(drawn[np.isfinite(drawn)], [2.5, 97.5])
    return float(value), [float(low), float(high)]


def _evened(scenes: dict[str, Scored], where: Path | str) -> list[Scored]:
    """Every scene with the same columns.

    Raises:
        InputError: a column is there in some scenes only.
    """
    columns = {column for one in scenes.values() for column in Prediction._fields
               if getattr(one.said, column) is not None}  # fmt: skip
    even = []
    for name, one in scenes.items():
        empty = {OBJECTS: []} | {
            column: np.zeros(0) for column in (*POINTS, ELEMENTS) if not len(getattr(one.truth, column))
        }
        for column in columns:
            if getattr(one.said, column) is None:
                if column not in empty:
                    raise InputError(f"{where}: scene {name}: column {column}: expected as in other scenes, found none")
                one = one._replace(said=one.said._replace(**{column: empty[column]}))
        even.append(one)
    return even


def _parts(scenes: list[Scored], sums: dict[str, Reliability]) -> dict[str, dict[str, tuple[Statistic, int]]]:
    """By part and name of the metric: the statistic, and of how many things it is; `sums` are of every scene."""
    parts = {}
    for side, title in SIDES.items():
        if getattr(scenes[0].said, side) is not None:
            parts[title] = _ranking(scenes, side)
    if scenes[0].said.elements is not None:
        parts["elements"] = _of_elements(_elements(scenes))
    if all(title in sums for title in SIDES.values()):
        parts[CLASSES] = _of_classes(scenes)
    if scenes[0].said.objects is not None:
        parts["objects"] = _of_objects(objects_found([(one.truth.objects, one.said.objects) for one in scenes]))
    for title, one in sums.items():
        parts[title] |= {
            "ece": (lambda weight, one=one: calibration_error(_weighted(one, weight)), int(one.count.sum())),
            "brier": (lambda weight, one=one: brier(_weighted(one, weight)), int(one.count.sum())),
        }
    return parts


def _ranking(scenes: list[Scored], side: str) -> dict[str, tuple[Statistic, int]]:
    """Means over the scenes that show enough of a change."""
    rows = []
    for one in scenes:
        label = getattr(one.truth, side)
        changed, void = (label != SAME) & (label != UNOBSERVABLE), label == UNOBSERVABLE
        found = point_metrics(getattr(one.said, side), changed, void) if changed.sum() >= LEAST_POSITIVES else None
        values = [None] * len(RANKS) if found is None else [getattr(found, metric) for metric in RANKS]
        rows.append([np.nan if value is None else value for value in values])
    table = np.array(rows, np.float64)
    return {metric: (_mean_of(table[:, column]), int(np.isfinite(table[:, column]).sum()))
            for column, metric in enumerate(RANKS)}  # fmt: skip


def _of_classes(scenes: list[Scored]) -> dict[str, tuple[Statistic, int]]:
    """Intersection over union of what is new (positive), gone (negative) and neither (static), of probabilities from
    CALLED on, of both scans together, and the mean of the three, as maps are compared that change."""
    counts = np.zeros((len(scenes), 3, 2))  # class, and points in both or in either
    for row, one in enumerate(scenes):
        static = np.zeros(2)
        for at, column in ((0, "scan"), (1, "reference")):
            label = getattr(one.truth, column)
            known = label != UNOBSERVABLE
            true, said = label[known] != SAME, getattr(one.said, column)[known] >= CALLED
            counts[row, at] = np.sum(true & said), np.sum(true | said)
            static += np.sum(~true & ~said), np.sum(~true | ~said)
        counts[row, 2] = static

    def iou(weight: np.ndarray, which: int) -> float:
        both, either = np.tensordot(weight, counts[:, which], 1)
        return _ratio(both, either)

    held = counts[..., 1].sum(axis=0).astype(int)
    names = ("iou_positive", "iou_negative", "iou_static")
    told = {
        name: (lambda weight, which=which: iou(weight, which), int(held[which])) for which, name in enumerate(names)
    }
    return told | {"miou": (lambda weight: float(np.mean([iou(weight, which) for which in range(3)])), int(held.sum()))}


def _mean_of(values: np.ndarray) -> Statistic:
    known = np.isfinite(values)
    return lambda weight: float(weight[known] @ values[known] / total) if (total := weight[known].sum()) else np.nan


class Elements(NamedTuple):
    """All elements of some scenes."""

    scene: np.ndarray  # (D,) int
    gone: np.ndarray  # (D,) bool
    known: np.ndarray  # (D,) bool: observable
    probability: np.ndarray  # (D,) of having been removed; NaN: the method does not tell


def _elements(scenes: list[Scored]) -> Elements:
    label = np.concatenate([one.truth.elements for one in scenes])
    scene = np.repeat(np.arange(len(scenes)), [len(one.truth.elements) for one in scenes])
    said = np.concatenate([one.said.elements for one in scenes])
    return Elements(scene, (label != SAME) & (label != UNOBSERVABLE), label != UNOBSERVABLE, said)


def _of_elements(all_of_them: Elements) -> dict[str, tuple[Statistic, int]]:
    known = Elements(*(field[all_of_them.known] for field in all_of_them))
    unseen = Elements(*(field[~all_of_them.known] for field in all_of_them))
    answers, called = ~np.isnan(known.probability), np.nan_to_num(known.probability, nan=0.0) >= CALLED
    count, order = len(known.gone), np.argsort(np.nan_to_num(known.probability, nan=CALLED), kind="stable")
    ranked = Elements(*(field[order] for field in known))
    wrong = np.nan_to_num(unseen.probability, nan=0.0) >= CALLED

    def ratio(part: np.ndarray, whole: np.ndarray, of: Elements) -> Statistic:
        return lambda weight: _ratio(weight[of.scene] @ part, weight[of.scene] @ whole)

    return {
        "roc_auc": (lambda weight: _auc(ranked, weight), count),
        "precision": (ratio(called & known.gone, called, known), int(called.sum())),
        "recall": (ratio(called & known.gone, known.gone, known), int(known.gone.sum())),
        "coverage": (ratio(answers, np.ones(count), known), count),
        "risk": (ratio(answers & (called != known.gone), answers, known), int(answers.sum())),
        "aurc": (lambda weight: _aurc(known, weight), int(answers.sum())),
        "unobservable_called_removed": (ratio(wrong, np.ones(len(wrong)), unseen), len(wrong)),
    }


def _ratio(part: float, whole: float) -> float:
    return float(part / whole) if whole else np.nan


def _auc(ranked: Elements, weight: np.ndarray) -> float:
    """Mann-Whitney statistic of elements by rising probability; one that the method does not tell of counts as 0.5."""
    own = weight[ranked.scene]
    level = np.nan_to_num(ranked.probability, nan=CALLED)
    _, step = np.unique(level, return_inverse=True)
    gone, there = np.bincount(step, own * ranked.gone), np.bincount(step, own * ~ranked.gone)
    below = np.cumsum(there) - there
    return _ratio(float(gone @ (below + there / 2.0)), float(gone.sum() * there.sum()))


def _risks(known: Elements, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Coverage and risk (D,) of the surest answers, one more at a time; all elements, answered or not, are 1."""
    own = weight[known.scene]
    sure = np.abs(known.probability - CALLED)
    order = np.argsort(-np.nan_to_num(sure, nan=-1.0), kind="stable")
    order = order[~np.isnan(sure[order])]
    wrong = (known.probability[order] >= CALLED) != known.gone[order]
    covered = np.cumsum(own[order])
    with np.errstate(invalid="ignore", divide="ignore"):
        return covered / own.sum(), np.cumsum(own[order] * wrong) / covered


def _aurc(known: Elements, weight: np.ndarray) -> float:
    """Area under the risk-coverage curve (Geifman and El-Yaniv 2017): the mean risk over the coverages reached."""
    coverage, risk = _risks(known, weight)
    step = np.diff(coverage, prepend=0.0)
    held = step > 0
    return _ratio(float(step[held] @ risk[held]), float(step[held].sum()))


def risk_coverage(elements: Elements, weight: np.ndarray) -> list[dict[str, float]]:
    """Share of wrong answers among the surest ones, at some shares of the observable elements."""
    known = Elements(*(field[elements.known] for field in elements))
    coverage, risk = _risks(known, weight)
    told = []
    for asked in COVERAGES:
        at = int(np.searchsorted(coverage, asked - 1e-9))
        if at < len(coverage):
            told.append({"coverage": float(coverage[at]), "risk": float(risk[at])})
    return told


def _of_objects(found: Found) -> dict[str, tuple[Statistic, int]]:
    def ratio(part: np.ndarray, whole: np.ndarray) -> Statistic:
        return lambda weight: _ratio(weight @ part, weight @ whole)

    counts = found.counts
    told, wanted = counts[:, 1] - counts[:, 2], counts[:, 3]
    return {
        "precision": (ratio(counts[:, 0], told), int(told.sum())),
        "recall": (ratio(counts[:, 4], wanted), int(wanted.sum())),
        "ap": (lambda weight: average_precision(found, weight), int(wanted.sum())),
    }


def _reliability_by_scene(scenes: list[Scored]) -> dict[str, Reliability]:
    """By part, sums of every scene: fields (S, BINS), and (S,); only of what is a probability throughout."""
    parts = {}
    for column, title in (*SIDES.items(), (ELEMENTS, ELEMENTS)):
        said = [getattr(one.said, column) for one in scenes]
        if said[0] is None or not all(map(_are_probabilities, said)):
            continue
        sums = []
        for one, probability in zip(scenes, said, strict=True):
            label = getattr(one.truth, column)
            counts = (label != UNOBSERVABLE) & ~np.isnan(probability)
            sums.append(reliability(probability[counts], label[counts] != SAME))
        parts[title] = Reliability(*(np.stack(field) for field in zip(*sums, strict=True)))
    return parts


def _weighted(sums: Reliability, weight: np.ndarray) -> Reliability:
    return Reliability(*(weight @ field for field in sums))


def _are_probabilities(values: np.ndarray) -> bool:
    told = values[~np.isnan(values)]
    return bool(np.all((told >= 0.0) & (told <= 1.0)))
