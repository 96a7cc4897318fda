"""Four failures that the thesis tells of, and what the default preset makes of the same scans.

    python -m paper.figures.failures runs/paper --out failures.png

For each failure the first test room is taken in which the thesis's way shows it: its network as this run trained
it, its boxes, its settings.
"""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jaxmm import run_folder
from jaxmm.config import Config
from jaxmm.data.simulator_settings import CloudSource, pair_config
from jaxmm.learning.box_match import box_overlap, footprint, match_boxes
from jaxmm.learning.boxes import Box
from jaxmm.learning.prediction import Judges, read_judges
from jaxmm.reports.figures import save, styled
from jaxmm.runs.paper.models import load_networks
from jaxmm.runs.paper.rows import ROOMS, TestScenes
from jaxmm.runs.paper.scenes import with_scan
from jaxmm.runs.room_scans import RoomCase, cases_of, true_boxes
from jaxmm.verdicts.detection import detect_scans
from jaxmm.verdicts.named_scans import NamedScan
from jaxmm.verdicts.results import box_of
from jaxmm.verdicts.settings import DetectSettings
from jaxmm.weights import DEFAULT
from paper.figures.network_rooms import TRIED, Asked, Found, first_room
from paper.figures.panels import command
from paper.figures.plan import draw_found, draw_room, draw_sensor, draw_true, entries

OFF = 0.2  # [m] of a centre, in plan
SURE = 0.5  # probability from which our points are drawn as changed; no box depends on it
NEAR = 0.35  # [m] between walls that hang together


class Failure(NamedTuple):
    """One kind of failure."""

    name: str
    scene: str
    condition: str
    scenario: str  # whose model fails
    training: str  # of its network: `nn` is what the thesis ended with
    shows: Callable[[Found], bool]
    scan: tuple[tuple[str, float], ...] = ()  # settings that differ from the run's


def split_wall(found: Found) -> bool:
    """Two boxes on one wall."""
    return any(sum(box_overlap(box, wall) > 0 for box in found.boxes) > 1 for wall in found.true)


def one_face(found: Found) -> bool:
    """A pillar whose box stands where its seen faces are."""
    matches = match_boxes(found.boxes, found.true)
    return any(_off(found.boxes[match.found], found.true[match.truth]) > OFF for match in matches)


def connected_walls(found: Found) -> bool:
    """Two walls that hang together, and no box on either."""
    touching = len(found.true) > 1 and _gap(found.true[0], found.true[1]) < NEAR
    return touching and found.changed.sum() > 100 and not match_boxes(found.boxes, found.true)


def shadow_box(found: Found) -> bool:
    """A box where nothing changed."""
    return any(all(box_overlap(box, one) == 0 for one in found.true) for box in found.boxes)


FAILURES = (
    Failure("a wall split by a pillar", "pillar_and_wall_added", "occluded", "wall_added", "nn", split_wall),
    Failure("a pillar where its seen faces are", "pillar_added", "clean", "pillar_added", "nn", one_face),
    Failure("connected walls, no box (they may touch here)", "walls_added", "occluded", "wall_added", "nn",
            connected_walls, (("mismatch_gap", 0.0),)),
    Failure("a box around a shadow", "wall_removed", "occluded", "wall_removed", "xyz_nn", shadow_box),
)  # fmt: skip


@styled
def draw(run: Path, path: Path) -> Figure:
    """Above the thesis's way, below ours, seen from above."""
    config, networks, judges = run_folder.read_config(run), load_networks(run), read_judges(DEFAULT)
    figure = Figure((4.0 * len(FAILURES), 9.5), layout="constrained")
    grid = figure.subplots(2, len(FAILURES), squeeze=False)
    for column, failure in enumerate(FAILURES):
        own = with_scan(config, dict(failure.scan))
        scenes = TestScenes(ROOMS, failure.scene, failure.condition)
        shown = first_room(own, networks, Asked(scenes, failure.scenario, failure.training), failure.shows)
        if shown is None:
            for axes in grid[:, column]:
                axes.text(0.5, 0.5, f"{failure.name}:\nin none of {TRIED} rooms", ha="center", va="center")
                axes.set_axis_off()
            continue
        room, found = shown
        change = failure.scenario.split("_")[1]
        draw_room(grid[0, column], found.points, found.changed, f"thesis: {failure.name}\ntest room {room}")
        draw_true(grid[0, column], found.true)
        draw_found(grid[0, column], found.boxes, change)
        case = next(cases_of(pair_config(own, _source(own, failure)), range(room, room + 1)))
        _ours(grid[1, column], judges, case, change)
        for axes in grid[:, column]:
            draw_sensor(axes, case.scan.position)
            _around(axes, [*found.true, *found.boxes], case.scan.position)
    figure.suptitle("Failures of boxes around points, and objects out of evidence")
    figure.legend(handles=entries(), loc="outside lower center", ncols=5)
    return save(figure, path)


def _ours(axes: Axes, judges: Judges, case: RoomCase, change: str) -> None:
    """The default preset on the same scan."""
    scan = NamedScan(case.scan, "scan", len(case.scan.points), "given")
    found = detect_scans(case.prior, [scan], judges, DetectSettings(refine=False, propose_views=False))
    drawn = found.drawing
    side = "robot" if change == "added" else "prior"
    points, probability = getattr(drawn, side) + drawn.origin, getattr(drawn, f"{side}_probability")
    draw_room(axes, points, probability >= SURE, "ours: default preset")
    for own, sign in (("added", 1), ("removed", -1)):
        draw_true(axes, true_boxes(case.pairs, case.row, sign)[0])
        draw_found(axes, [box_of(one) for one in found.mismatches if one.mismatch_type == own], own)


def _source(config: Config, failure: Failure) -> CloudSource:
    return CloudSource(failure.scenario, failure.scene, failure.condition, config.data.test_seed)


def _around(axes: Axes, boxes: list[Box], sensor: np.ndarray) -> None:
    """A square that holds boxes and sensor, with some room around."""
    places = np.concatenate([*(footprint(box, np.zeros(2)) for box in boxes), sensor[None, :2]])
    middle, half = (places.min(axis=0) + places.max(axis=0)) / 2, np.ptp(places, axis=0).max() / 2 + 0.5
    axes.set(xlim=(middle[0] - half, middle[0] + half), ylim=(middle[1] - half, middle[1] + half))


def _off(box: Box, true: Box) -> float:
    return float(np.linalg.norm((np.asarray(box.center) - true.center)[:2]))


def _gap(a: Box, b: Box) -> float:
    """Least distance [m] of two footprints, by points on their outlines."""

    def outline(box: Box) -> np.ndarray:
        corners = footprint(box, np.zeros(2))
        parts = np.linspace(0, 1, 40)[:, None, None]
        return (corners * (1 - parts) + np.roll(corners, -1, axis=0) * parts).reshape(-1, 2)

    return float(np.min(np.linalg.norm(outline(a)[:, None] - outline(b)[None], axis=-1)))


if __name__ == "__main__":
    command(__doc__, draw)
