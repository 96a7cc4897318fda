"""Found boxes of many scenes against the true ones. S scenes, D boxes found in all of them."""

from typing import NamedTuple

import numpy as np

from jaxmm.exchange.scenes import LABELS
from jaxmm.learning.box_match import MAX_DISTANCE, MIN_OVERLAP, box_overlap
from jaxmm.learning.boxes import MISMATCH_TYPES, Box
from jaxmm.learning.object_scores import LEAST_SHOWN, score, standing_at

CALLED = 0.5  # probability from which a box counts as found
RIGHT, WRONG, NEITHER = 1, 0, -1


class Found(NamedTuple):
    """What was found, ready to be counted."""

    counts: np.ndarray  # (S, 5) of boxes from CALLED on: right, all, where hardly anything shows; true: wanted, found
    wanted: np.ndarray  # (S,) true objects that show enough
    probability: np.ndarray  # (D,) of all boxes, falling
    scene: np.ndarray  # (D,) int
    kind: np.ndarray  # (D,) int: RIGHT, WRONG, or NEITHER where an object stands that shows too little


def objects_found(scenes: list[tuple[np.ndarray, list[tuple[str, Box]]]]) -> Found:
    """Match the boxes of every scene, one change at a time, with the true objects (J, 9) of scenes.Truth."""
    counts, rows = np.zeros((len(scenes), 5)), []
    for number, (objects, said) in enumerate(scenes):
        for change in MISMATCH_TYPES:
            true, shown = _true(objects, change)
            boxes = sorted((box for way, box in said if way == change), key=lambda box: -box.probability)
            called = [box for box in boxes if box.probability >= CALLED]
            scored = score(called, true, shown)
            right = scored.right - scored.hidden
            counts[number] += (
                len(right), len(called), len(scored.hidden), len(scored.wanted), len(scored.reached & scored.wanted),
            )  # fmt: skip
            kinds = _kinds(boxes, true, shown)
            rows += [(-box.probability, number, kind) for box, kind in zip(boxes, kinds, strict=True)]
    rows.sort()
    table = np.array(rows, np.float64).reshape(-1, 3)
    return Found(counts, counts[:, 3], -table[:, 0], table[:, 1].astype(int), table[:, 2].astype(int))


def _true(objects: np.ndarray, change: str) -> tuple[list[Box], list[float]]:
    chosen = [row for row in objects if LABELS[int(row[0])].endswith(change)]
    boxes = [Box(LABELS[int(row[0])].split("_")[0], row[1:4], row[4:7], float(row[7])) for row in chosen]
    return boxes, [float(row[8]) for row in chosen]


def _kinds(boxes: list[Box], true: list[Box], shown: list[float]) -> list[int]:
    """Of boxes by falling probability: each takes the best true object that is left, as in object detection."""
    free, kinds = set(range(len(true))), []
    for box in boxes:
        fits = [(_fit(box, true[one]), one) for one in free]
        fit, one = max(fits, default=(-1.0, -1))
        if fit >= 0.0:
            free.discard(one)
            kinds.append(RIGHT if shown[one] >= LEAST_SHOWN else NEITHER)
        else:
            hardly = [true[one] for one in free if shown[one] < LEAST_SHOWN]
            kinds.append(NEITHER if standing_at([box], hardly) else WRONG)
    return kinds


def _fit(box: Box, true: Box) -> float:
    """How well a box stands for a true one: its overlap where they may be matched at all, else -1."""
    if box.object_type != true.object_type:
        return -1.0
    overlap = box_overlap(box, true)
    near = np.linalg.norm(np.subtract(box.center, true.center)) <= MAX_DISTANCE
    return overlap if overlap >= MIN_OVERLAP or near else -1.0


def average_precision(found: Found, weight: np.ndarray) -> float:
    """Area under the precision-recall curve, with precision made falling (Everingham et al. 2010, VOC 2010)."""
    total = float(weight @ found.wanted)
    if not total:
        return np.nan
    own = weight[found.scene]
    right, wrong = np.cumsum(own * (found.kind == RIGHT)), np.cumsum(own * (found.kind == WRONG))
    with np.errstate(invalid="ignore"):
        precision = np.nan_to_num(right / (right + wrong))
    precision = np.maximum.accumulate(precision[::-1])[::-1]
    return float(np.diff(right / total, prepend=0.0) @ precision)


def precision_recall(found: Found) -> list[dict[str, float]]:
    """Precision and recall of the boxes from a probability on, for every probability that a box has."""
    right, wrong = np.cumsum(found.kind == RIGHT), np.cumsum(found.kind == WRONG)
    last = np.flatnonzero(np.diff(found.probability, append=-1.0))  # of those of one probability
    total = float(found.wanted.sum())
    return [
        {"probability": float(found.probability[at]), "precision": float(right[at] / (right[at] + wrong[at])),
         "recall": float(right[at] / total)} for at in last if total and right[at] + wrong[at]
    ]  # fmt: skip
