"""Precision and recall at every threshold as a curve in space, coloured by F1: the thesis network above, ours below.

python -m paper.figures.threshold_curves runs/paper --out threshold_curves.png
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from jaxmm.reports.figures import BLACK, PALE, save, styled
from jaxmm.reports.room_figures import ScoredCloud
from paper.figures.examples import example_of
from paper.figures.panels import BY_METHOD, METHODS, Place, command, grid, inside, titled

THRESHOLDS = np.linspace(0.0, 1.0, 201)[1:]  # at 0 every point would be called changed


class Curve(NamedTuple):
    """What T thresholds lead to; nan where nothing is called changed."""

    precision: np.ndarray  # (T,)
    recall: np.ndarray  # (T,)

    @property
    def f1(self) -> np.ndarray:
        """(T,) their harmonic mean."""
        return 2 * self.precision * self.recall / np.maximum(self.precision + self.recall, 1e-12)


@styled
def draw(run: Path, path: Path) -> Figure:
    """Sixteen panels; a dot where F1 is best, and the curve's shadow on the floor."""

    def panel(figure: Figure, place: Place, scenario: str, row: tuple[str, str]) -> None:
        method, condition = row
        example = example_of(run, f"{scenario}_{condition}", scenario)
        axes = figure.add_axes(inside(place, left=0.05, bottom=0.08, right=0.05, top=0.17), projection="3d")
        curve = curve_of(example.scored(method))
        axes.plot(curve.recall, curve.precision, np.zeros(len(THRESHOLDS)), color=PALE)
        axes.scatter(
            curve.recall,
            curve.precision,
            THRESHOLDS,
            c=curve.f1,
            cmap="viridis",
            vmin=0,
            vmax=1,
            s=10,
            depthshade=False,
        )
        best = int(np.nanargmax(curve.f1))
        spot = curve.recall[best], curve.precision[best], THRESHOLDS[best]
        axes.plot(*([value] for value in spot), marker="o", color=BLACK, markersize=6, fillstyle="none")
        axes.view_init(elev=24, azim=-128)
        axes.set(xlim=(0, 1), ylim=(0, 1), zlim=(0, 1), xlabel="recall", ylabel="precision", zlabel="threshold")
        axes.set(xticks=(0.5, 1.0), yticks=(0.5, 1.0), zticks=(0.0, 0.5, 1.0))
        axes.tick_params(labelsize=9, pad=0)
        told = f"best F1 {curve.f1[best]:.3f} at {THRESHOLDS[best]:.3g}"
        axes.set_title(f"{METHODS[method]}, test room {example.room}\n{titled(scenario, condition)}\n{told}")

    figure = grid("Precision and recall at every threshold", BY_METHOD, panel, legend=0.06)
    bar = figure.add_axes((0.3, 0.034, 0.4, 0.012))
    label = "F1; a ring where it is best"
    figure.colorbar(ScalarMappable(Normalize(0.0, 1.0), "viridis"), cax=bar, orientation="horizontal", label=label)
    return save(figure, path)


def curve_of(cloud: ScoredCloud) -> Curve:
    """Precision and recall at THRESHOLDS, a point counting as changed from there on."""
    rising = np.sort(cloud.probability), np.sort(cloud.probability[cloud.label.astype(bool)])
    called, right = (len(scores) - np.searchsorted(scores, THRESHOLDS, "left") for scores in rising)
    with np.errstate(invalid="ignore"):
        precision = np.where(called > 0, right / called, np.nan)
    return Curve(precision, right / len(rising[1]))


if __name__ == "__main__":
    command(__doc__, draw)
