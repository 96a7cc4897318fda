"""True and false positives and negatives of every example at the thesis's threshold: its network above, ours below.

python -m paper.figures.outcomes runs/paper --out outcomes.png
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from jaxmm.reports.figures import BLACK, GREEN, PALE, VERMILLION, save, styled
from jaxmm.reports.room_figures import THRESHOLD, ScoredCloud, marker_area
from paper.figures.examples import example_of
from paper.figures.panels import BY_METHOD, METHODS, Place, command, dots, grid, inside, room_panel, titled


class Look(NamedTuple):
    """How one outcome is drawn."""

    name: str
    color: str
    marker: str
    scale: float  # of the marker's area


LOOKS = {
    "TN": Look("true negative (TN)", PALE, "o", 0.8),
    "TP": Look("true positive (TP)", GREEN, "o", 1.5),
    "FP": Look("false positive (FP)", VERMILLION, "^", 2.5),
    "FN": Look("false negative (FN)", BLACK, "x", 2.5),
}


@styled
def draw(run: Path, path: Path) -> Figure:
    """Sixteen panels; points that are scored by nobody are left out."""

    def panel(figure: Figure, place: Place, scenario: str, row: tuple[str, str]) -> None:
        method, condition = row
        example = example_of(run, f"{scenario}_{condition}", scenario)
        cloud = example.scored(method)
        # The same view for both methods.
        called = np.any([example.scored(name).probability >= THRESHOLD for name in METHODS], axis=0)
        axes, shown = room_panel(figure, inside(place, top=0.16), cloud.points, cloud.label | called)
        area, told = marker_area(shown), []
        for short, members in outcomes(cloud).items():
            _, color, marker, scale = LOOKS[short]
            width = 1.0 if marker == "x" else 0
            dots(axes, cloud.points[members & shown], color, shown, s=area * scale, marker=marker, linewidths=width)
            told.append(f"{short} {members.sum():,}")
        axes.set_title(f"{METHODS[method]}, test room {example.room}\n{titled(scenario, condition)}\n{'  '.join(told)}")

    figure = grid(f"Changed where the probability is at least {THRESHOLD:g}", BY_METHOD, panel, legend=0.03)
    handles = [
        Line2D([], [], color=look.color, marker=look.marker, linestyle="", markersize=8, label=look.name)
        for look in LOOKS.values()
    ]
    figure.legend(handles=handles, loc="lower center", ncols=len(handles), frameon=False)
    return save(figure, path)


def outcomes(cloud: ScoredCloud) -> dict[str, np.ndarray]:
    """(N,) bool by outcome; every point has one."""
    called, true = cloud.probability >= THRESHOLD, cloud.label.astype(bool)
    return {"TN": ~called & ~true, "TP": called & true, "FP": called & ~true, "FN": ~called & true}


if __name__ == "__main__":
    command(__doc__, draw)
