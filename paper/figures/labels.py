"""How the thesis labels points, by distance and by a filter of clusters, and what is true; rooms with furniture.

python -m paper.figures.labels runs/paper --out labels.png
"""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from jaxmm.learning.labels import heuristic_labels
from jaxmm.reports.figures import BLACK, BLUE, GREY, VERMILLION, save, styled
from jaxmm.run_folder import read_config
from paper.figures.examples import Example, example_of
from paper.figures.panels import Place, command, dots, grid, inside, judged, key, room_panel, titled

FAR, FILTERED, TRUE = "farther than {:g} m", "after the cluster filter", "true labels"
COLORS = {  # by 2 * labelled + truly changed
    "neither labelled nor changed": GREY,
    "changed, not labelled (or, in truth, not testable)": BLACK,
    "labelled, not changed: a shadow, or what stands near one": BLUE,
    "labelled and changed": VERMILLION,
}


@styled
def draw(run: Path, path: Path) -> Figure:
    """One column a scenario, occluded. The filter drops what was removed too where a shadow touches it."""
    distance = read_config(run).preprocess.label_distance

    def panel(figure: Figure, place: Place, scenario: str, row: str) -> None:
        example = example_of(run, f"{scenario}_occluded", scenario)
        label = label_of(example, row, distance)
        axes, shown = room_panel(
            figure, inside(place, top=0.16), example.points, example.true | (example.distance > distance)
        )
        for number, color in enumerate(COLORS.values()):
            dots(axes, example.points[shown & (2 * label + example.true == number)], color, shown)
        name = row.format(distance)
        if row == FILTERED and not scenario.endswith("removed"):
            name = "no filter for what was added"
        told = f"{label.sum():,} labelled, {(label & ~example.true).sum():,} of them wrong"
        axes.set_title(f"{titled(scenario, 'occluded')}, test room {example.room}\n{judged(scenario)}, {name}\n{told}")

    figure = grid("Labels in the thesis's manner, and true ones", (FAR, FILTERED, TRUE), panel, size=(15.4, 12.4))
    key(figure, COLORS)
    return save(figure, path)


def label_of(example: Example, row: str, distance: float) -> np.ndarray:
    """(N,) bool, the labels that a row shows."""
    if row == FAR:
        return heuristic_labels(example.distance, distance)
    return example.heuristic if row == FILTERED else example.true & example.testable


if __name__ == "__main__":
    command(__doc__, draw)
