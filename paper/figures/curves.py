"""Precision over recall, and the receiver operating characteristic (ROC), of every example and method.

python -m paper.figures.curves runs/paper --out curves.png
"""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from sklearn import metrics

from jaxmm.config import CONDITIONS
from jaxmm.reports.figures import save, styled
from jaxmm.reports.room_figures import ScoredCloud
from paper.figures.examples import example_of
from paper.figures.panels import COLORS, METHODS, Place, command, grid, inside, titled


class Look(NamedTuple):
    """How one method is drawn: the first ones wide, so that they show below others that lie on them."""

    name: str
    color: str
    style: str
    width: float


LOOKS = {
    "nn-raw": Look("raw distance", COLORS["nn-raw"], "-", 8.0),
    "rule": Look("rule on evidence", COLORS["rule"], "-", 4.5),
    "xyz_nn": Look(METHODS["xyz_nn"], COLORS["network"], "-", 2.2),
    "evidence": Look(METHODS["evidence"], COLORS["evidence"], (0, (2, 1.5)), 1.6),
}
LEAST = 1e-4  # false positive rate at which its logarithmic axis begins


@styled
def draw(run: Path, path: Path) -> Figure:
    """Above precision and recall, below the other curve; the number behind a method is the area under its curve."""
    kinds = {"precision and recall": draw_precision, "ROC": draw_roc}
    rows = [(kind, condition) for kind in kinds for condition in CONDITIONS]

    def panel(figure: Figure, place: Place, scenario: str, row: tuple[str, str]) -> None:
        kind, condition = row
        example = example_of(run, f"{scenario}_{condition}", scenario)
        axes = figure.add_axes(inside(place, left=0.17, bottom=0.17, right=0.04, top=0.17))
        compare(axes, {method: example.scored(method) for method in LOOKS}, kinds[kind])
        axes.set_title(f"{titled(scenario, condition)}\n{kind}, test room {example.room}")

    return save(grid("Every threshold at once, on true labels", rows, panel, legend=0.0), path)


def compare(axes: Axes, clouds: dict[str, ScoredCloud], draw_one: Callable) -> None:
    """One curve a method."""
    for method, cloud in clouds.items():
        name, color, style, width = LOOKS[method]
        area = draw_one(axes, cloud, {"color": color, "linestyle": style, "linewidth": width, "clip_on": False})
        axes.lines[-1].set_label(f"{name} {area:.4f}")
    axes.set(xlim=(axes.get_xlim()[0], 1.0), ylim=(0.0, 1.02))
    axes.legend(loc=free_place(axes), fontsize=8.5)


def free_place(axes: Axes) -> str:
    """Where a legend covers least of the curves; their ends at the edges of the axes do not count."""
    data = np.concatenate([line.get_xydata() for line in axes.lines])
    x, y = axes.transAxes.inverted().transform(axes.transData.transform(data)).T
    left, right, low = (x > 0.03) & (x < 0.65), (x > 0.35) & (x < 0.97), y < 0.37
    covered = {
        "lower right": right & low, "lower left": left & low, "center left": left & (y > 0.33) & (y < 0.67),
    }  # fmt: skip
    return min(covered, key=lambda name: covered[name].sum())


def draw_precision(axes: Axes, cloud: ScoredCloud, look: dict) -> float:
    """Precision over recall; returns the average precision."""
    precision, recall, _ = metrics.precision_recall_curve(cloud.label, cloud.probability)
    axes.plot(recall, precision, drawstyle="steps-post", **look)
    axes.set(xlabel="recall", ylabel="precision", xlim=(0.0, 1.0))
    return metrics.average_precision_score(cloud.label, cloud.probability)


def draw_roc(axes: Axes, cloud: ScoredCloud, look: dict) -> float:
    """True over false positive rate, the latter on a logarithmic scale; returns the area under the linear curve."""
    false, true, _ = metrics.roc_curve(cloud.label, cloud.probability, drop_intermediate=False)
    axes.plot(np.maximum(false, LEAST), true, **look)
    axes.set(xscale="log", xlabel="false positive rate", ylabel="true positive rate", xlim=(LEAST, 1.0))
    return metrics.auc(false, true)


if __name__ == "__main__":
    command(__doc__, draw)
