"""How many points of every example got which probability, by what is true: the thesis network above, ours below.

python -m paper.figures.histograms runs/paper --out histograms.png
"""

from pathlib import Path

from matplotlib.figure import Figure

from jaxmm.reports.figures import save, styled
from jaxmm.reports.room_figures import THRESHOLD, draw_histogram
from paper.figures.examples import example_of
from paper.figures.panels import BY_METHOD, METHODS, Place, command, grid, inside, titled


@styled
def draw(run: Path, path: Path) -> Figure:
    """Sixteen panels; numbers of points on a logarithmic scale."""

    def panel(figure: Figure, place: Place, scenario: str, row: tuple[str, str]) -> None:
        method, condition = row
        example = example_of(run, f"{scenario}_{condition}", scenario)
        axes = figure.add_axes(inside(place, left=0.17, bottom=0.17, right=0.04, top=0.17))
        draw_histogram(axes, example.scored(method), THRESHOLD)
        axes.set_title(f"{METHODS[method]}, test room {example.room}\n{titled(scenario, condition)}")

    return save(grid("Probabilities of changed and unchanged points", BY_METHOD, panel, legend=0.0), path)


if __name__ == "__main__":
    command(__doc__, draw)
