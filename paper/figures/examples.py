"""What the figures show of a run of the paper: its examples, its records, and raw scans.

Scenes come out of `stages/rooms/<set>/example.npz`; what is no longer in there (raw scans, before filter and voxels)
is scanned again from the settings and the seed of the run, which gives the same rays. Nothing is trained.

N points of one scan, world frame, metres, z up.
"""

import dataclasses
from pathlib import Path
from typing import NamedTuple

import numpy as np

from jaxmm import run_folder
from jaxmm.config import SCENARIOS, Config
from jaxmm.data.labelled_rooms import pairs_of
from jaxmm.data.simulator_settings import CloudSource
from jaxmm.files import load_arrays, load_json
from jaxmm.rays.evidence import FEATURES
from jaxmm.reports.figures import Curves, curves_from_records
from jaxmm.reports.room_figures import ScoredCloud
from jaxmm.runs.paper.models import ENTRIES, MODELS
from jaxmm.runs.stages import STAGES, stage_folder
from paper.figures.origin import made
from warp_scanner.clouds.points import points_of
from warp_scanner.rooms.pairs import Pairs

EXAMPLE = "example.npz"


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
    arrays = load_arrays(made(run / STAGES / "rooms" / scenes / EXAMPLE))
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
    curves = curves_from_records(run_folder.read_records(folder), "joint", entries)
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
    config = run_folder.read_config(run)
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
