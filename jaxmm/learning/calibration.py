"""Calibration: a rising map of logits, learnt from validation rooms, after which a probability is a frequency.

N points, K knots, C clouds. Two kinds compete: a temperature, by which all logits are divided (Guo et al. 2017), and
isotonic regression of the labels on the logits (Zadrozny and Elkan 2002). Each is fitted to one half of the clouds and
judged by the log loss of the other half; the winner is then fitted to all. Both come as straight lines between knots,
so ranks stay as they were.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

KNOTS = 32
BINS = 400  # of equally many points, whose rates isotonic regression smooths
END = 40.0  # logits beyond are as good as certain
SURE, SUREST = 12.0, 15.0  # calibrated logits beyond the first are drawn together, to end at the second
LEAST_RISE = 1e-3  # of the map from knot to knot, which keeps the order of points
TEMPERATURES = (0.05, 20.0)


class Calibration(NamedTuple):
    """A rising map of logits as straight lines between knots; (S, K) when stacked."""

    logit: Any  # (K,) float32, rising
    calibrated: Any  # (K,) float32, rising


class Reliability(NamedTuple):
    """How far probabilities are from frequencies, in bins of equal width; sums, so that those of rooms add up."""

    count: np.ndarray  # (BINS,) points
    expected: np.ndarray  # (BINS,) sum of their probabilities
    found: np.ndarray  # (BINS,) positives
    square: np.ndarray  # () sum of the squares of probability less label


RELIABILITY_BINS = 15


def calibrate(logit: np.ndarray, label: np.ndarray, cloud: np.ndarray) -> tuple[Calibration, dict[str, Any]]:
    """The better of the two maps, and what was found out on the way.

    Args:
        logit: (N,) of validation points.
        label: (N,) bool.
        cloud: (N,) int, which cloud each point is of; the halves share none.

    Returns:
        The map, and {"kind", "points", "positives", "log_loss": {"none", "temperature", "isotonic"}}, losses [nat] of
        points that the maps were not fitted to.
    """
    logit, label = np.asarray(logit, np.float64), np.asarray(label, bool)
    half = np.unique(cloud, return_inverse=True)[1].ravel() % 2 == 0
    kinds: dict[str, Callable] = {"temperature": _temperature, "isotonic": _isotonic}
    loss = {"none": _log_loss(logit, label)}
    for name, fitted in kinds.items():
        parts = [(half, ~half), (~half, half)]
        held_out = [(apply(fitted(logit[a], label[a]), logit[b]), label[b]) for a, b in parts if a.any() and b.any()]
        loss[name] = _log_loss(*map(np.concatenate, zip(*held_out, strict=True))) if held_out else np.inf
    kind = min(kinds, key=loss.__getitem__)
    told = {name: float(value) if np.isfinite(value) else None for name, value in loss.items()}
    report = {"kind": kind, "points": len(logit), "positives": int(label.sum()), "log_loss": told}
    return kinds[kind](logit, label), report


def apply(calibration: Calibration, logit: np.ndarray) -> np.ndarray:
    """Calibrated logits of any shape; beyond the outermost knots as at those."""
    return np.interp(logit, calibration.logit, calibration.calibrated)


def reliability(probability: np.ndarray, label: np.ndarray) -> Reliability:
    """Sums over points (N,), by probability."""
    probability, label = np.asarray(probability, np.float64), np.asarray(label, np.float64)
    place = np.minimum((probability * RELIABILITY_BINS).astype(np.int64), RELIABILITY_BINS - 1)
    sums = [np.bincount(place, weight, RELIABILITY_BINS) for weight in (np.ones_like(probability), probability, label)]
    return Reliability(*sums, np.sum(np.square(probability - label)))


def calibration_error(sums: Reliability) -> float:
    """Expected calibration error (ECE): mean gap between probability and frequency of the bins, by their points."""
    return float(np.abs(sums.expected - sums.found).sum() / max(sums.count.sum(), 1.0))


def brier(sums: Reliability) -> float:
    """Brier score: mean square of probability less label."""
    return float(sums.square / max(sums.count.sum(), 1.0))


def _temperature(logit: np.ndarray, label: np.ndarray) -> Calibration:
    from scipy.optimize import minimize_scalar  # slow to import, and whoever only applies a map does without

    def loss(exponent: float) -> float:
        return _log_loss(logit / np.exp(exponent), label)

    best = np.exp(minimize_scalar(loss, bounds=np.log(TEMPERATURES), method="bounded").x)
    knots = np.linspace(-END, END, KNOTS)
    return _as_knots(knots, knots / best)


def _isotonic(logit: np.ndarray, label: np.ndarray) -> Calibration:
    from sklearn.isotonic import IsotonicRegression  # likewise

    order = np.argsort(logit, kind="stable")
    parts = [part for part in np.array_split(order, BINS) if len(part)]
    count = np.array([len(part) for part in parts], float)
    found = np.array([label[part].sum() for part in parts], float)
    middle = np.array([logit[part].mean() for part in parts])
    rate = IsotonicRegression().fit(np.arange(len(parts)), found / count, count).predict(np.arange(len(parts)))
    # Points of one rate are one step. Its middle stands for it, so the lines between steps rise as the rates do.
    step = np.unique(rate, return_inverse=True)[1].ravel()
    total = np.bincount(step, count)
    share = (np.bincount(step, found) + 0.5) / (total + 1.0)  # no frequency of finitely many points is 0 or 1
    x, y = np.bincount(step, middle * count) / total, np.log(share / (1.0 - share))
    knots = np.interp(np.linspace(0.0, 1.0, KNOTS - 2), np.linspace(0.0, 1.0, len(x)), x)
    values = np.interp(knots, x, y)
    # Beyond its outermost steps nothing is known but the order, which logits keep: they rise as they would alone.
    ends = min(-END, knots[0] - 1.0), max(END, knots[-1] + 1.0)
    outside = values[0] + ends[0] - knots[0], values[-1] + ends[1] - knots[-1]
    return _as_knots(np.array([ends[0], *knots, ends[1]]), np.array([outside[0], *values, outside[1]]))


def _as_knots(logit: np.ndarray, calibrated: np.ndarray) -> Calibration:
    rise = LEAST_RISE * np.arange(KNOTS)
    calibrated = np.maximum.accumulate(calibrated) + rise
    # Single precision tells probabilities apart up to about 1 - 1e-7, so what lies beyond is drawn together below that.
    beyond = np.maximum(calibrated - SURE, 0.0)
    calibrated = np.minimum(calibrated, SURE) + beyond * (SUREST - SURE) / max(SUREST - SURE, beyond.max())
    return Calibration((logit + rise).astype(np.float32), calibrated.astype(np.float32))


def _log_loss(logit: np.ndarray, label: np.ndarray) -> float:
    return float(np.mean(np.logaddexp(0.0, np.where(label, -logit, logit)))) if len(logit) else np.inf
