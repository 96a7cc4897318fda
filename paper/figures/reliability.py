"""Whether a probability means what it says: predicted against found, the thesis's network and ours.

    python -m paper.figures.reliability runs/paper --out reliability.png

Bins of few points say little, so they are joined with their neighbours; ECE and Brier score are of all points and bins.
"""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from jaxmm.config import CONDITIONS, SCENARIOS
from jaxmm.files import load_json
from jaxmm.learning.calibration import brier, calibration_error
from jaxmm.learning.room_scores import reliability_of
from jaxmm.reports.figures import GREY, save, styled
from jaxmm.runs.stages import STAGES
from paper.figures.origin import made
from paper.figures.panels import COLORS, command

METHODS = {"xyz_nn": ("thesis's network", COLORS["network"]), "evidence": ("evidence", COLORS["evidence"])}
LOOKS = {"clean": {"marker": "o", "linestyle": "-"}, "occluded": {"marker": "s", "linestyle": "--", "mfc": "white"}}
LEAST = 300  # points of a bin that stands alone
SAMPLES = 1000  # of the bootstrap


class Curve(NamedTuple):
    """K joined bins of one method, from improbable to probable."""

    predicted: np.ndarray  # (K,) mean probability
    found: np.ndarray  # (K,) share of points that changed
    interval: np.ndarray  # (2, K) ends of its 95 % interval: percentile bootstrap over rooms
    count: np.ndarray  # (K,) points


@styled
def draw(run: Path, path: Path) -> Figure:
    """All points of all test rooms of the individual rows, true labels."""
    figure = Figure((12.0, 6.0), layout="constrained")
    shares, counts = figure.subplots(1, 2)
    shares.plot([0, 1], [0, 1], color=GREY, linestyle=":", label="perfect")
    for method, (name, color) in METHODS.items():
        for condition in CONDITIONS:
            sides = [
                room["sides"][scenario]
                for scenario in SCENARIOS
                for room in load_json(made(run / STAGES / "rooms" / f"{scenario}_{condition}" / "rooms.json"))
            ]
            curve, sums = curve_of(sides, method), reliability_of(sides, method)
            told = f"{name}, {condition}: ECE {calibration_error(sums):.4f}, Brier {brier(sums):.4f}"
            look = {"color": color, "markersize": 5} | LOOKS[condition]
            shares.plot(curve.predicted, curve.found, label=told, **look)
            shares.vlines(curve.predicted, *curve.interval, color=color, linewidth=1.0)
            counts.plot(curve.predicted, curve.count, **look)
    counts.axhline(LEAST, color=GREY, linestyle=":")
    counts.annotate(f"{LEAST} points", (0.02, LEAST), (0, 3), textcoords="offset points", color=GREY)
    shares.set(ylabel="share of points that changed", ylim=(-0.02, 1.02))
    counts.set(ylabel="points of a bin", yscale="log")
    for axes in (shares, counts):
        axes.set(xlabel="predicted probability, mean of a bin", xlim=(-0.01, 1.01))
    shares.set_title("whiskers: 95 % interval over test rooms")
    counts.set_title(f"bins of fewer than {LEAST} points are joined with the next")
    figure.legend(*shares.get_legend_handles_labels(), loc="outside lower center", ncols=2)
    figure.suptitle("Probabilities on test rooms, true labels")
    return save(figure, path)


def curve_of(sides: list[dict[str, Any]], method: str) -> Curve:
    """Out of the scores of rooms, see room_scores.score_room."""
    sums = [side["methods"][method]["reliability"] for side in sides]
    count, expected, found = (np.array([one[name] for one in sums]) for name in ("count", "expected", "found"))
    first = joined(count.sum(axis=0), LEAST)
    count, expected, found = (np.add.reduceat(rooms, first, axis=1) for rooms in (count, expected, found))
    times = np.random.default_rng(0).multinomial(len(sides), np.full(len(sides), 1 / len(sides)), SAMPLES)
    with np.errstate(invalid="ignore"):
        drawn = (times @ found) / (times @ count)
    total = count.sum(axis=0)
    interval = np.nanpercentile(drawn, (2.5, 97.5), axis=0)
    return Curve(expected.sum(axis=0) / total, found.sum(axis=0) / total, interval, total)


def joined(count: np.ndarray, least: float) -> list[int]:
    """First bins of runs of neighbours that hold at least so many points each; the last takes what is left over."""
    first, held = [0], 0.0
    for index, own in enumerate(count):
        if held >= least:
            first.append(index)
            held = 0.0
        held += own
    return first[:-1] if held < least and len(first) > 1 else first


if __name__ == "__main__":
    command(__doc__, draw)
