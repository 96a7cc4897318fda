"""Which other things would look the same: cases that anyone can tell, and cases that nobody can."""

import numpy as np
import pytest

from benchmarks.lookalikes import CABINET, Section, View, lookalikes
from jaxmm.learning.boxes import Box
from jaxmm.verdicts.standing_alone import ranges_to

POSITION = np.array([0.0, 0.0, 1.0])
BEHIND = 8.0  # [m] to a wall that ends the view


def box(kind, x, y, edges, height=2.6, turn=0.0):
    return Box(kind, np.array([x, y, height / 2]), np.array([*edges, height]), turn)


def seen(true, azimuths=35.0, elevations=25.0, hidden=None):
    """What a camera sees along x, before a wall; rays between two azimuths [deg] end on something nearer."""
    azimuth, elevation = np.meshgrid(
        *(np.radians(np.arange(-most, most + 0.1, 0.5)) for most in (azimuths, elevations))
    )
    azimuth, elevation = azimuth.ravel(), elevation.ravel()
    direction = np.stack(
        [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)], axis=-1
    ).astype(np.float32)
    distance = np.minimum(ranges_to([true], POSITION, direction)[0], BEHIND / direction[:, 0])
    if hidden is not None:
        low, high = np.radians(hidden)
        distance[(azimuth >= low) & (azimuth <= high)] = 0.6
    shows = np.abs(distance - ranges_to([true], POSITION, direction)[0]) < 1e-6
    return View(POSITION, direction, distance, shows)


@pytest.mark.parametrize(
    "true, view, kinds",
    [
        # 0.5 x 0.5 m, both sides and the ceiling in view.
        (box("pillar", 4.0, 0.0, (0.5, 0.5), turn=30.0), {}, set()),
        # A face of 0.5 m, whose depth is hidden, and both of whose ends are seen: nothing drawn is a wall like that.
        (box("pillar", 4.0, 0.0, (0.5, 0.5)), {}, set()),
        (box("wall", 4.0, 0.0, (0.15, 3.0)), {}, set()),  # the whole side of a wall
        (box("wall", 1.2, 0.0, (0.15, 3.0)), {"azimuths": 15.0}, {"pillar", CABINET}),  # 0.6 m of it, and no end
        (box("wall", 1.2, 0.0, (0.15, 3.0)), {"azimuths": 15.0, "elevations": 50.0}, {"pillar"}),  # up to the ceiling
        (box("pillar", 1.2, 0.0, (0.8, 0.8)), {"azimuths": 12.0}, {"wall", CABINET}),
        # One end is hidden by something near: a wall may go on there.
        (box("pillar", 4.0, 0.0, (0.8, 0.8)), {"hidden": (2.0, 12.0)}, {"wall"}),
        (box("pillar", 4.0, 0.0, (0.25, 0.25)), {}, {"wall"}),  # or the end of one, of which only the end shows
        (box("wall", 4.0, 0.0, (0.3, 1.2), height=1.2), {}, {CABINET}),
    ],
)
def test_what_looks_the_same(true, view, kinds):
    assert lookalikes(seen(true, **view), true, ()) == kinds


def test_sizes_of_the_building_are_tried_too():
    """A short wall of the building has the face of the column, and nobody sees how deep either is."""
    true = box("pillar", 4.0, 0.0, (0.5, 0.5))
    assert lookalikes(seen(true), true, [Section("wall", 0.5, 0.2)]) == {"wall"}
    assert lookalikes(seen(true), true, [Section("wall", 0.6, 0.2)]) == set()
    turned = box("pillar", 4.0, 0.0, (0.5, 0.5), turn=30.0)  # its side shows that it is deeper
    assert lookalikes(seen(turned), turned, [Section("wall", 0.5, 0.2)]) == set()


def test_boxes_look_the_same_wherever_the_whole_scene_is_turned_and_moved():
    true, draw = box("wall", 1.2, 0.0, (0.15, 3.0)), np.random.default_rng(3)
    view = seen(true, azimuths=15.0)
    for _ in range(5):
        turn, shift = draw.uniform(-180.0, 180.0), draw.uniform(-30.0, 30.0, 3)
        cosine, sine = np.cos(np.radians(turn)), np.sin(np.radians(turn))
        rotation = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
        there = view._replace(
            position=rotation @ view.position + shift, direction=(view.direction @ rotation.T).astype(np.float32)
        )
        moved = true._replace(center=rotation @ true.center + shift, rotation=turn)
        assert lookalikes(there, moved, ()) == {"pillar", CABINET}
