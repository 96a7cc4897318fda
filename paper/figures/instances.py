"""A test room of every scenario as the robot scans it, a colour for every object.

python -m paper.figures.instances runs/paper --out instances.png
"""

from pathlib import Path

import numpy as np
from matplotlib.colors import hsv_to_rgb
from matplotlib.figure import Figure

from jaxmm.reports.figures import save, styled
from jaxmm.reports.room_figures import room_axes
from paper.figures.examples import example_of, raw_pair
from paper.figures.panels import Place, command, dots, few, inside, judged, page, titled


@styled
def draw(run: Path, path: Path) -> Figure:
    """Eight scans before filter and voxels; of removed objects that of the building model, which shows them."""

    def panel(figure: Figure, place: Place, scenario: str, condition: str) -> None:
        room = example_of(run, f"{scenario}_{condition}", scenario).room
        pair = raw_pair(run, scenario, condition, room)
        scan = pair.dt if judged(scenario) == "DT scan" else pair.robot
        chosen = few(len(scan.points))
        points, element = scan.points[chosen], scan.element[chosen]
        axes, shown = room_axes(figure, inside(place), points, scan.changed[chosen])
        dots(axes, points[shown], colors_of(element[shown]), shown)
        axes.set_title(f"{titled(scenario, condition)}\n{judged(scenario)}, room {room}")

    return save(page("One colour for every object that was scanned", panel, legend=0.01), path)


def colors_of(element: np.ndarray) -> np.ndarray:
    """(N, 3) a colour for each object; neighbours in number get hues far apart."""
    number = np.unique(element, return_inverse=True)[1].reshape(-1)
    hue = number * 0.618034 % 1.0  # the golden ratio never comes back near where it was
    return hsv_to_rgb(np.column_stack([hue, 0.45 + 0.3 * (number % 3) / 2, 0.9 - 0.25 * (number % 2)]))


if __name__ == "__main__":
    command(__doc__, draw)
