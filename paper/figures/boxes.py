"""Boxes around the points that the thesis's networks call changed, as its post-processing makes them.

    python -m paper.figures.boxes runs/paper --out boxes.png

One panel for each kind of case that the thesis shows: clear, partial, stretched or not, merged or not, several changes,
and a building. Scenes are the examples of the run.
"""

import dataclasses
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from jaxmm import run_folder
from jaxmm.files import load_json
from jaxmm.inputs import InputError
from jaxmm.learning.boxes import Box, BoxSettings, fit_boxes
from jaxmm.reports.figures import save, styled
from jaxmm.runs.paper.models import load_networks
from jaxmm.runs.paper.rows import ROOMS, TestScenes
from jaxmm.runs.stages import STAGES
from paper.figures.examples import example_of
from paper.figures.network_rooms import Asked, Found, first_room
from paper.figures.origin import made
from paper.figures.panels import command, judged
from paper.figures.plan import OUTLINE, TRUE, TRUE_EDGE, draw_found, draw_room, draw_true, entries

WHOLE = BoxSettings()
PIECES = "pillar_and_wall_added_occluded"  # not its example: the first room in which merging makes a difference


class Case(NamedTuple):
    """One panel."""

    title: str
    scenes: str  # name of a set of test scenes
    scenario: str
    method: str
    settings: BoxSettings = WHOLE
    side: bool = False  # seen from the side rather than from above


CASES = (
    Case("a pillar in full view", "pillar_added_clean", "pillar_added", "xyz_nn"),
    Case("a wall in full view", "wall_removed_clean", "wall_removed", "xyz_nn"),
    Case("a pillar behind furniture", "pillar_removed_occluded", "pillar_removed", "xyz_nn"),
    Case("a wall behind furniture", "wall_removed_occluded", "wall_removed", "xyz_nn"),
    Case("as high as it is seen", "wall_added_occluded", "wall_added", "xyz_nn",
         dataclasses.replace(WHOLE, stretch=False), side=True),
    Case("stretched to the room", "wall_added_occluded", "wall_added", "xyz_nn", side=True),
    Case("pieces apart", PIECES, "wall_added", "nn", dataclasses.replace(WHOLE, merge_walls=False)),
    Case("pieces merged", PIECES, "wall_added", "nn"),
    Case("several pillars", "pillars_added_clean", "pillar_added", "nn"),
    Case("of all four changes: removed walls", "all_four_occluded", "wall_removed", "nn"),
    Case("a building, clean", "building_pillar_removed_clean", "pillar_removed", "nn"),
    Case("a building, occluded", "building_wall_removed_occluded", "wall_removed", "nn"),
)  # fmt: skip


ASKED = Asked(TestScenes(ROOMS, "pillar_and_wall_added", "occluded"), "wall_added", "nn")


@styled
def draw(run: Path, path: Path) -> Figure:
    """Twelve panels."""
    config = run_folder.read_config(run)
    figure = Figure((17.0, 12.5), layout="constrained")
    pieces = first_room(config, load_networks(run), ASKED, _merged)
    for axes, case in zip(figure.subplots(3, 4).ravel(), CASES, strict=True):
        if case.scenes == PIECES and pieces is not None:
            shown = pieces[1].points, pieces[1].probability, pieces[1].true
        else:
            example = example_of(run, case.scenes, case.scenario)
            shown = example.points, example.score[case.method], true_boxes(run, case, example.room, example.place)
        _panel(axes, case, shown)
    figure.legend(handles=entries()[:-1], loc="outside lower center", ncols=4)
    figure.suptitle("Boxes of the thesis's post-processing, around what its networks call changed")
    return save(figure, path)


def true_boxes(run: Path, case: Case, room: int, place: str) -> list[Box]:
    """What really changed in a scene, out of its scores."""
    for scene in load_json(made(run / STAGES / "rooms" / case.scenes / "rooms.json")):
        if (scene["room"], scene["place"]) == (room, place):
            side = scene["sides"][case.scenario]
            told = [box for box in (side["true_box"], *side.get("other_boxes", ())) if box is not None]
            return [
                Box(one["object_type"], np.array(one["center"]), np.array(one["dimensions"]), one["rotation"])
                for one in told
            ]
    return []


def _merged(found: Found) -> bool:
    """Whether pieces of walls were merged."""
    return len(fit_boxes(found.points, found.probability, "wall", CASES[6].settings)) > len(found.boxes)


def _panel(axes: Axes, case: Case, shown: tuple[np.ndarray, np.ndarray, list[Box]]) -> None:
    points, probability, true = shown
    found = fit_boxes(points, probability, case.scenario.split("_")[0], case.settings)
    changed = probability >= case.settings.threshold
    told = (
        f"{case.title}\n{case.scenario.replace('_', ' ')}, {judged(case.scenario)}, {_counted(len(found), len(true))}"
    )
    change = case.scenario.split("_")[1]
    if not case.side:
        draw_room(axes, points, changed, told)
        draw_true(axes, true)
        draw_found(axes, found, change)
        return
    if not true:
        raise InputError(f"{case.scenes}: expected an example with what really changed, found none")
    along = np.argmax(true[0].dimensions[:2] if abs(true[0].rotation) % 180 < 45 else true[0].dimensions[1::-1])
    draw_room(axes, points[:, [along, 2, 1 - along]], changed, told)
    axes.set(xlabel=f"{'xy'[along]} [m]", ylabel="z [m]")
    looks = [(box, {"facecolor": TRUE, "edgecolor": TRUE_EDGE, "zorder": 1}) for box in true]
    looks += [(box, {"fill": False, "edgecolor": OUTLINE[change], "linewidth": 2, "zorder": 4}) for box in found]
    for box, look in looks:
        size = np.array([box.dimensions[along], box.dimensions[2]])
        axes.add_patch(Rectangle(np.array([box.center[along], box.center[2]]) - size / 2, *size, **look))


def _counted(found: int, true: int) -> str:
    return f"{found} box{'es' * (found != 1)}, {true} true"


if __name__ == "__main__":
    command(__doc__, draw)
