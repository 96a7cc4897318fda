"""What the figure scripts share: scenes out of a run folder of the paper, pages of panels, and a command line.

A script has one function `draw(run, path)` that reads a run folder, writes one image and returns the `Figure`. Scenes
come out of `stages/rooms/<set>/example.npz`; what is no longer in there (raw scans, before filter and voxels) is
scanned again from the settings and the seed of the run, which gives the same rays. Nothing is trained.

N points of one scan, world frame, metres, z up.
"""

import argparse
import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from jaxmm import runs
from jaxmm.config import CONDITIONS, SCENARIOS, Config
from jaxmm.evidence import FEATURES
from jaxmm.files import load_arrays
from jaxmm.inputs import InputError
from jaxmm.pipeline import pairs_of
from jaxmm.room_figures import ScoredCloud
from jaxmm.simulator import CloudSource
from jaxmm.stages import STAGES
from warp_scanner.pairs import Pairs
from warp_scanner.points import points_of

EXAMPLE = "example.npz"
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
    """A page of eight panels: a column a scenario, clean above occluded.

    Args:
        title: above all.
        draw: called with the figure, the place of a panel, scenario and condition; it draws its own title.
        legend: share of the height that is left free below, for a legend of all panels.
    """
    figure = Figure((17.0, 8.6))
    width, height = 1.0 / len(SCENARIOS), (0.93 - legend) / len(CONDITIONS)
    for column, scenario in enumerate(SCENARIOS):
        for row, condition in enumerate(CONDITIONS):
            place = (column * width, legend + (len(CONDITIONS) - 1 - row) * height, width, height)
            draw(figure, place, scenario, condition)
    figure.suptitle(title)
    return figure


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
