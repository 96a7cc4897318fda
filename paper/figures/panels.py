"""What the figure scripts share: scenes out of a run folder of the paper, pages of panels, and a command line.

A script has one function `draw(run, path)` that reads a run folder, writes one image and returns the `Figure`. Scenes
come out of `stages/rooms/<set>/example.npz`; what is no longer in there (raw scans, before filter and voxels) is
scanned again from the settings and the seed of the run, which gives the same rays. Nothing is trained.

N points of one scan, world frame, metres, z up.
"""

import argparse
import dataclasses
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator
from mpl_toolkits.mplot3d import Axes3D

from jaxmm import runs
from jaxmm.config import CONDITIONS, SCENARIOS, Config
from jaxmm.evidence import FEATURES
from jaxmm.figures import BLUE, GREY, ORANGE, VERMILLION, Curves, curves_from_records
from jaxmm.files import load_arrays, load_json
from jaxmm.inputs import InputError
from jaxmm.paper_models import ENTRIES, MODELS
from jaxmm.pipeline import pairs_of
from jaxmm.room_figures import ScoredCloud, marker_area, room_axes
from jaxmm.simulator import CloudSource
from jaxmm.stages import STAGES, stage_folder
from warp_scanner.pairs import Pairs
from warp_scanner.points import points_of

EXAMPLE = "example.npz"
METHODS = {"xyz_nn": "thesis network", "evidence": "ours (evidence)"}  # those shown side by side, and their words
COLORS = {"nn-raw": GREY, "rule": VERMILLION, "network": ORANGE, "evidence": BLUE}  # of methods, in every figure
BY_METHOD = tuple((method, condition) for method in METHODS for condition in CONDITIONS)  # rows of a `grid`
MOST = 25_000  # points of one cloud in a panel
COLUMNS = tuple((scenario, condition) for scenario in SCENARIOS for condition in CONDITIONS)
Place = tuple[float, float, float, float]  # left, bottom, width, height as shares of a figure


class Example(NamedTuple):
    """One test scene as one model sees it, after filter and voxels."""

    points: np.ndarray  # (N, 3) float32 [m] of the judged scan: the DT scan for removed objects, else the robot scan
    distance: np.ndarray  # (N,) [m] to the other scan
    heuristic: np.ndarray  # (N,) bool, the thesis's labels
    true: np.ndarray  # (N,) bool, the simulator's
    testable: np.ndarray  # (N,) bool: some ray could tell; a changed point that is not is scored by nobody
    evidence: np.ndarray  # (N, F) columns as evidence.FEATURES
    score: dict[str, np.ndarray]  # (N,) by method; nn-raw is a distance [m], others are probabilities
    dt: np.ndarray  # (M, 3) both scans
    robot: np.ndarray  # (K, 3)
    room: int  # number of the room, or of the view
    place: str  # "" for rooms, else the building

    def fraction(self, name: str) -> np.ndarray:
        """(N,) share of the rays in a point's footprint that are `through`, `support`, `blocked` or `unseen`."""
        return self.evidence[:, FEATURES.index(name)]

    def scored(self, method: str) -> ScoredCloud:
        """The points that count on true labels, as the figures of a room want them."""
        counts = ~self.true | self.testable
        name = "distance [m]" if method == "nn-raw" else "probability"
        return ScoredCloud(self.points[counts], self.score[method][counts], self.true[counts], name)


def example_of(run: Path, scenes: str, scenario: str) -> Example:
    """The example of a set of scenes (paper_rows.TestScenes.name) as one scenario's model sees it.

    Raises:
        InputError: the run has none: not made yet, or no scene showed enough of the change.
    """
    path = run / STAGES / "rooms" / scenes / EXAMPLE
    if not path.is_file():
        raise InputError(
            f"{path}: expected the example of a run of the paper; jaxmm reproduce configs/paper.toml makes it"
        )
    arrays = load_arrays(path)
    own = {
        name.removeprefix(f"{scenario}/"): value for name, value in arrays.items() if name.startswith(f"{scenario}/")
    }
    score = {name.removeprefix("score "): value for name, value in own.items() if name.startswith("score ")}
    fields = {name: own[name] for name in ("points", "distance", "heuristic", "true", "testable", "evidence")}
    return Example(
        **fields, score=score, dt=arrays["dt"], robot=arrays["robot"], room=int(arrays["room"]),
        place=str(arrays["place"]),
    )  # fmt: skip


def training_curves(run: Path, training: str) -> Curves:
    """How the four thesis networks of one training (key of paper_rows.TRAININGS) learned, out of the joint training.

    Raises:
        InputError: the run holds no records of its training yet.
    """
    folder = stage_folder(run, MODELS)
    entries = load_json(folder / ENTRIES)
    curves = curves_from_records(runs.read_records(folder), "joint", entries)
    own = [entries.index(f"{training}/{scenario}") for scenario in SCENARIOS]
    values = {name: value[:, own] for name, value in curves._asdict().items() if np.ndim(value) == 2}
    return curves._replace(scenarios=SCENARIOS, **values)


class RawScan(NamedTuple):
    """All returns of one scan, nothing filtered or thinned."""

    points: np.ndarray  # (N, 3) float32 [m]
    element: np.ndarray  # (N,) int32, the object that a point was measured on
    semantic: np.ndarray  # (N,) uint8, see scenes
    changed: np.ndarray  # (N,) bool: of an object that was added, or will be found removed


class RawPair(NamedTuple):
    """Both scans of one generated room."""

    dt: RawScan
    robot: RawScan
    pairs: Pairs  # R = 1
    config: Config


def raw_pair(run: Path, scenario: str, condition: str, room: int) -> RawPair:
    """Scan a test room of a run again: the same rays, before anything was done to them."""
    config = runs.read_config(run)
    if config.preprocess.evidence != "none":
        config = dataclasses.replace(config, preprocess=dataclasses.replace(config.preprocess, evidence="none"))
    source = CloudSource(scenario, scenario, condition, config.data.test_seed)
    pairs = pairs_of(config, source, np.array([room]))
    scans = []
    for scan, changed in ((pairs.dt, pairs.changed_dt), (pairs.robot, pairs.changed_robot)):
        back = np.isfinite(scan.distance[0])
        points = points_of(pairs.pose, pairs.directions, scan.distance)[0, back]
        scans.append(RawScan(points, scan.element[0, back], scan.semantic[0, back], changed[0, back]))
    return RawPair(*scans, pairs, config)


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
    """Run a script: RUN --out FILE; what is missing is one line."""
    parser = argparse.ArgumentParser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("run", type=Path, metavar="RUN", help="run folder of jaxmm reproduce configs/paper.toml")
    parser.add_argument("--out", type=Path, required=True, metavar="FILE", help="image to write: .png, .pdf or .svg")
    asked = parser.parse_args()
    try:
        draw(asked.run, asked.out)
    except (InputError, ValueError) as error:
        parser.exit(2, f"error: {error}\n")
