"""What the rays say: every point by what most rays of its footprint did, through, support, blocked or unseen.

python -m paper.figures.evidence_maps runs/paper --out evidence_maps.png
"""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from jaxmm.rays.evidence import FRACTIONS
from jaxmm.reports.figures import BLACK, BLUE, GREY, PALE, VERMILLION, save, styled
from jaxmm.reports.room_figures import marker_area, room_axes
from paper.figures.examples import example_of
from paper.figures.panels import Place, command, inside, judged, page, titled

COLORS = {"through": VERMILLION, "support": PALE, "blocked": BLUE, "unseen": GREY}
WORDS = {
    "through": "through: the robot sees beyond it\n(robot scan: it lies behind what the model expects)",
    "support": "support: both see the same",
    "blocked": "blocked: the robot sees something in front\n(robot scan: it stands in front of what the model expects)",
    "unseen": "unseen: no return",
}
RING = BLACK  # around what really changed


@styled
def draw(run: Path, path: Path) -> Figure:
    """Eight examples; what really changed is circled."""

    def panel(figure: Figure, place: Place, scenario: str, condition: str) -> None:
        example = example_of(run, f"{scenario}_{condition}", scenario)
        shares = np.column_stack([example.fraction(name) for name in FRACTIONS])
        most = shares.argmax(axis=1)
        axes, shown = room_axes(figure, inside(place), example.points, example.true)
        area = marker_area(shown)
        ringed = shown & example.true
        axes.scatter(*example.points[ringed].T, s=4 * area, c=RING, linewidths=0, depthshade=False, clip_on=False)
        for index, name in enumerate(FRACTIONS):
            own = example.points[shown & (most == index)]
            axes.scatter(*own.T, s=area, c=COLORS[name], linewidths=0, depthshade=False, clip_on=False)
        axes.set_title(f"{titled(scenario, condition)}\n{judged(scenario)}, test room {example.room}")

    figure = page("What the robot's rays say of every point", panel, legend=0.06)
    handles = [
        Line2D([], [], marker="o", linestyle="", color=COLORS[name], markersize=8, label=WORDS[name])
        for name in FRACTIONS
    ]
    handles.append(Line2D([], [], marker="o", linestyle="", color=RING, markersize=10, label="around: really changed"))
    figure.legend(handles=handles, loc="lower center", ncols=len(handles), frameon=False)
    return save(figure, path)


if __name__ == "__main__":
    command(__doc__, draw)
