"""Probability of every point that it changed: the thesis network above, ours below.

python -m paper.figures.heatmaps runs/paper --out heatmaps.png
"""

from pathlib import Path

from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from jaxmm.reports.figures import save, styled
from paper.figures.examples import example_of
from paper.figures.panels import BY_METHOD, METHODS, Place, command, dots, grid, inside, judged, room_panel, titled


@styled
def draw(run: Path, path: Path) -> Figure:
    """Sixteen panels, one scale of colour."""

    def panel(figure: Figure, place: Place, scenario: str, row: tuple[str, str]) -> None:
        method, condition = row
        example = example_of(run, f"{scenario}_{condition}", scenario)
        axes, shown = room_panel(figure, inside(place, top=0.16), example.points, example.true)
        probability = example.score[method][shown]
        rising = probability.argsort(kind="stable")  # no likely point is hidden by an unlikely one
        dots(axes, example.points[shown][rising], probability[rising], shown, cmap="viridis", vmin=0, vmax=1)
        told = f"{judged(scenario)}, test room {example.room}"
        axes.set_title(f"{METHODS[method]}\n{titled(scenario, condition)}\n{told}")

    figure = grid("Probability that a point changed", BY_METHOD, panel, legend=0.06)
    bar = figure.add_axes((0.3, 0.034, 0.4, 0.012))
    scale = ScalarMappable(Normalize(0.0, 1.0), "viridis")
    figure.colorbar(scale, cax=bar, orientation="horizontal", label="probability that a point changed")
    return save(figure, path)


if __name__ == "__main__":
    command(__doc__, draw)
