"""What the figure scripts share: pages of panels, and a command line.

A script has one function `draw(run, path)` that reads a run folder, writes one image and returns the `Figure`.

N points of one scan, world frame, metres, z up.
"""

import argparse
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator
from mpl_toolkits.mplot3d import Axes3D

from jaxmm.config import CONDITIONS, SCENARIOS
from jaxmm.inputs import InputError
from jaxmm.reports.figures import BLUE, GREY, ORANGE, VERMILLION
from jaxmm.reports.room_figures import marker_area, room_axes
from paper.figures.examples import training_curves
from paper.figures.origin import mark, origin_of

METHODS = {"xyz_nn": "thesis network", "evidence": "ours (evidence)"}  # those shown side by side, and their words
COLORS = {"nn-raw": GREY, "rule": VERMILLION, "network": ORANGE, "evidence": BLUE}  # of methods, in every figure
BY_METHOD = tuple((method, condition) for method in METHODS for condition in CONDITIONS)  # rows of a `grid`
MOST = 25_000  # points of one cloud in a panel
COLUMNS = tuple((scenario, condition) for scenario in SCENARIOS for condition in CONDITIONS)
SCANS = {"DT scan": BLUE, "robot scan (where colours mix, both see the same)": ORANGE}
Place = tuple[float, float, float, float]  # left, bottom, width, height as shares of a figure


def titled(scenario: str, condition: str) -> str:
    """What stands above a panel."""
    return f"{scenario.replace('_', ' ')}, {condition}"


def judged(scenario: str) -> str:
    """Which scan holds the change."""
    return "DT scan" if scenario.endswith("removed") else "robot scan"


def page(title: str, draw: Callable[[Figure, Place, str, str], None], legend: float = 0.05) -> Figure:
    """A page of eight panels: a column a scenario, clean above occluded; see `grid`."""
    return grid(title, CONDITIONS, draw, legend, (17.0, 8.6))


def grid(
    title: str,
    rows: Sequence,
    draw: Callable[[Figure, Place, str, Any], None],
    legend: float = 0.04,
    size: tuple[float, float] = (14.4, 15.2),
) -> Figure:
    """A page of panels: a column a scenario, rows of any kind.

    Args:
        title: above all.
        rows: what the rows are of, from above.
        draw: called with the figure, the place of a panel, its scenario and its row; it draws its own title.
        legend: share of the height that is left free below, for a legend of all panels.
        size: of the page [inch].
    """
    figure = Figure(size)
    width, height = 1.0 / len(SCENARIOS), (1.0 - 0.6 / size[1] - legend) / len(rows)
    for column, scenario in enumerate(SCENARIOS):
        for number, row in enumerate(rows):
            draw(figure, (column * width, legend + (len(rows) - 1 - number) * height, width, height), scenario, row)
    figure.suptitle(title)
    return figure


def room_panel(figure: Figure, place: Place, points: np.ndarray, notable: np.ndarray) -> tuple[Axes3D, np.ndarray]:
    """`room_axes` with few numbers on the axes, as many small panels want them."""
    axes, shown = room_axes(figure, place, points, notable)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MaxNLocator(3))
    return axes, shown


def dots(axes: Axes3D, points: np.ndarray, color: str | np.ndarray, shown: np.ndarray, **style: Any) -> None:
    """Draw some points (M, 3) as finely as suits all that are `shown` (N,) in these axes."""
    look = {"s": marker_area(shown), "linewidths": 0, "depthshade": False, "clip_on": False, "rasterized": True}
    axes.scatter(*points.T, **({"c": color} | look | style))


def draw_both(figure: Figure, place: Place, dt: np.ndarray, robot: np.ndarray, **style: Any) -> Axes3D:
    """Two scans on each other, in the colours of SCANS.

    Args:
        figure: to draw on.
        place: of the panel.
        dt: (N, 3) points [m], or (N, 4) with a last column that is not 0 where a point must be seen well.
        robot: (M, 3) or (M, 4), as many columns.
        style: of the dots.
    """
    rows, color = mixed(dict(zip(SCANS.values(), (dt, robot), strict=True)))
    axes, shown = room_panel(figure, place, rows[:, :3], rows[:, 3:].any(axis=1))
    dots(axes, rows[shown, :3], color[shown], shown, **style)
    return axes


def draw_training(run: Path, path: Path, curves: Callable[..., Figure], what: str) -> Figure:
    """How the networks behind the individual models of Table I learned, one panel a scenario.

    Args:
        run: run folder.
        path: image to write.
        curves: `loss_curves` or `validation_curves` of jaxmm.reports.figures.
        what: they show.
    """
    title = f"{what} of the thesis networks (coordinates and distance, augmented)"
    return curves(training_curves(run, "xyz_nn"), path, title)


def key(figure: Figure, colors: Mapping[str, str], **style: Any) -> None:
    """A legend below all panels: a dot of each colour by what it means."""
    look = {"marker": "o", "linestyle": "", "markersize": 8}
    handles = [Line2D([], [], **(look | {"color": color}), label=name) for name, color in colors.items()]
    figure.legend(handles=handles, loc="lower center", **({"ncols": len(handles), "frameon": False} | style))


def few(count: int, most: int = MOST, seed: int = 0) -> np.ndarray:
    """Indices of at most so many of `count` points, in an order in which none hides the others of its kind."""
    return np.random.default_rng(seed).permutation(count)[:most]


def mixed(clouds: Mapping[str, np.ndarray], most: int = MOST) -> tuple[np.ndarray, np.ndarray]:
    """Rows (M, C) out of several clouds by their colour, in one random order, and the colour (M,) of each.

    Where clouds lie on each other all of their colours show, whichever was drawn last.
    """
    chosen = {
        color: points[few(len(points), most // len(clouds), seed)]
        for seed, (color, points) in enumerate(clouds.items())
    }
    points = np.concatenate(list(chosen.values()))
    color = np.repeat(list(chosen), [len(part) for part in chosen.values()])
    order = few(len(points), len(points))
    return points[order], color[order]


def inside(place: Place, left: float = 0.02, bottom: float = 0.02, right: float = 0.02, top: float = 0.1) -> Place:
    """A place less margins, given as shares of it."""
    x, y, width, height = place
    return x + left * width, y + bottom * height, width * (1 - left - right), height * (1 - bottom - top)


def command(doc: str, draw: Callable[[Path, Path], Figure]) -> None:
    """Run a script: RUN --out FILE; what is missing is one line. The image says which run it shows."""
    parser = argparse.ArgumentParser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("run", type=Path, metavar="RUN", help="run folder of jaxmm reproduce configs/paper.toml")
    parser.add_argument("--out", type=Path, required=True, metavar="FILE", help="image to write: .png, .pdf or .svg")
    asked = parser.parse_args()
    try:
        origin = origin_of(asked.run)
        draw(asked.run, asked.out)
        mark(asked.out, origin)
    except (InputError, ValueError) as error:
        parser.exit(2, f"error: {error}\n")
