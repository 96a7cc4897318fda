"""How well scores rank changed points before the others: standard definitions, and the thesis's beside them.

N points of one room. Rooms are scored one by one; a table shows their mean and how far it may be off.
"""

from typing import NamedTuple

import numpy as np

METRICS = ("roc_auc", "fpr_at_95", "precision_at_95", "iou_at_95", "thesis_fpr_at_95", "thesis_iou_at_95")


class PointMetrics(NamedTuple):
    """Scores of one room; None where it has no positives, or no negatives.

    `at_95`: a point is predicted as changed when its score is at least the highest threshold with recall >= 0.95.
    """

    roc_auc: float | None  # probability that a positive outranks a negative; ties count half
    fpr_at_95: float | None  # FP / (FP + TN)
    precision_at_95: float | None  # TP / (TP + FP)
    iou_at_95: float | None  # TP / (TP + FP + FN)
    # The thesis's code takes predictions with a strict `>`, so recall falls one point short of the threshold it chose,
    # and divides false positives by FP + (FP + TN), which keeps its "FPR" below one half.
    thesis_fpr_at_95: float | None
    thesis_iou_at_95: float | None


def point_metrics(score: np.ndarray, label: np.ndarray, void: np.ndarray | None = None) -> PointMetrics:
    """Score one room.

    Args:
        score: (N,) finite; higher means rather changed. Any monotone scale.
        label: (N,) bool or 0/1.
        void: (N,) bool, points that count for nothing; None: every point counts.

    Raises:
        ValueError: shapes differ, a score is not finite, or a label is neither 0 nor 1.
    """
    positive, negative = _split(score, label, void)
    if not len(positive) or not len(negative):
        return PointMetrics(*[None] * len(METRICS))
    # 19/20 in whole numbers: 0.95 * N in floating point can ask for one point too many.
    needed = -(-19 * len(positive) // 20)
    threshold = positive[-needed]
    true, false = _above(positive, threshold, "left"), _above(negative, threshold, "left")
    strict_true, strict_false = _above(positive, threshold, "right"), _above(negative, threshold, "right")
    return PointMetrics(
        roc_auc=_roc_auc(positive, negative),
        fpr_at_95=false / len(negative),
        precision_at_95=true / (true + false),
        iou_at_95=true / (len(positive) + false),
        thesis_fpr_at_95=strict_false / (strict_false + len(negative)),
        thesis_iou_at_95=strict_true / (len(positive) + strict_false),
    )


def bootstrap_interval(counts: np.ndarray, resamples: int, seed: int = 0) -> tuple[float, float]:
    """95 % percentile interval of sum(column 0) / sum(column 1), rooms drawn with replacement.

    Args:
        counts: (R, 2) numerator and denominator of each room; a denominator of 1 makes the ratio a mean.
        resamples: how many draws.
        seed: another seed, other draws; the same seed, the same interval.

    Raises:
        ValueError: wrong shape, no rooms, values that are not finite, or no positive denominator.
    """
    counts = np.asarray(counts, np.float64)
    if counts.ndim != 2 or counts.shape[1] != 2 or not len(counts):
        raise ValueError(f"counts must be (R >= 1, 2), got {counts.shape}")
    if not np.isfinite(counts).all() or counts[:, 1].min() < 0 or counts[:, 1].max() == 0:
        raise ValueError("counts must be finite, with denominators >= 0 and at least one above 0")
    # How often each room is drawn: a table of (resamples, R) small numbers instead of as many indices.
    times = np.random.default_rng(seed).multinomial(len(counts), np.full(len(counts), 1 / len(counts)), resamples)
    # The common ratio is taken off first, so that equal rooms give an interval of width exactly zero.
    ratio = counts[:, 0].sum() / counts[:, 1].sum()
    numerator, denominator = times @ (counts[:, 0] - ratio * counts[:, 1]), times @ counts[:, 1]
    counted = denominator > 0  # a draw of rooms with nothing to count says nothing
    low, high = ratio + np.percentile(numerator[counted] / denominator[counted], [2.5, 97.5])
    return float(low), float(high)


def _split(score, label, void) -> tuple[np.ndarray, np.ndarray]:
    """Sorted scores of positives and of negatives, checked."""
    score, label = np.asarray(score), np.asarray(label)
    void = np.zeros(score.shape, bool) if void is None else np.asarray(void)
    if score.ndim != 1 or label.shape != score.shape or void.shape != score.shape:
        raise ValueError(f"score, label and void must be (N,) alike, got {score.shape}, {label.shape}, {void.shape}")
    if not np.isfinite(score).all():
        raise ValueError(f"score must be finite, got {np.count_nonzero(~np.isfinite(score))} values that are not")
    if np.any((label != 0) & (label != 1)):
        raise ValueError("label must hold 0 and 1 only")
    counts = ~void.astype(bool)
    label = label.astype(bool)
    return np.sort(score[label & counts]), np.sort(score[~label & counts])


def _above(values: np.ndarray, threshold: float, side: str) -> int:
    """How many sorted values are >= threshold (left) or > threshold (right)."""
    return len(values) - int(np.searchsorted(values, threshold, side))


def _roc_auc(positive: np.ndarray, negative: np.ndarray) -> float:
    """Mann-Whitney statistic in whole numbers, so that a perfect ranking gives exactly 1."""
    outranked = np.searchsorted(negative, positive, "left").sum() + np.searchsorted(negative, positive, "right").sum()
    return int(outranked) / (2 * len(positive) * len(negative))
