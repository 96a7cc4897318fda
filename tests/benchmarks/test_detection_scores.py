"""What counts as found: right, wrong, or where nothing need be found."""

import numpy as np
import pytest

from benchmarks.views.detection_scores import objects_of
from jaxmm.learning.boxes import Box
from jaxmm.learning.object_scores import LEAST_SHOWN, score, standing_at
from jaxmm.runs.room_scans import room_cases, true_boxes
from jaxmm.verdicts.results import Mismatch

PILLAR = Box("pillar", np.array([1.0, 2.0, 0.0]), np.array([0.4, 0.4, 3.0]), 0.0)
WALL = Box("wall", np.array([-4.0, 0.0, 0.0]), np.array([6.0, 0.2, 3.0]), 30.0)


def beside(box: Box, along: float, across: float = 0.0) -> Box:
    """The box, moved in its own axes."""
    turn = np.radians(box.rotation)
    shift = along * np.array([np.cos(turn), np.sin(turn)]) + across * np.array([-np.sin(turn), np.cos(turn)])
    return box._replace(center=box.center + np.array([*shift, 0.0]))


def piece(box: Box, length: float, along: float) -> Box:
    """A short piece of a wall."""
    return beside(box, along)._replace(dimensions=np.array([length, *box.dimensions[1:]]))


def test_what_is_found_at_an_object_that_hardly_shows_counts_neither_way():
    as_wall = PILLAR._replace(object_type="wall", dimensions=np.array([0.4, 0.15, 3.0]))
    end = piece(WALL, 0.5, -2.75)  # far from the middle, small beside the whole
    far = beside(PILLAR, 3.0)
    scored = score([as_wall, end, far], [PILLAR, WALL], [0.1, 0.0])
    assert scored.hidden == {0, 1}
    assert not scored.right and not scored.wanted and not scored.reached
    assert score([PILLAR], [PILLAR], [0.1]).hidden == {0}  # right ones no less


def test_what_is_found_at_an_object_that_shows_enough_is_right_or_wrong():
    as_wall = PILLAR._replace(object_type="wall")
    for found, right in ((PILLAR, {0}), (as_wall, set())):
        scored = score([found], [PILLAR], [LEAST_SHOWN])
        assert scored.right == right and scored.wanted == {0} and not scored.hidden


def test_one_hidden_object_excuses_one_box():
    twice = [piece(WALL, 0.5, -2.75), piece(WALL, 0.5, 2.75)]
    assert len(score(twice, [WALL], [0.0]).hidden) == 1
    assert len(score([WALL, twice[0]], [WALL], [0.0]).hidden) == 1  # it was found already


def test_a_box_that_is_mostly_outside_stands_elsewhere():
    assert standing_at([piece(WALL, 0.5, 2.95)], [WALL]) == [0]  # 0.3 of 0.5 m inside
    assert standing_at([piece(WALL, 0.5, 3.05)], [WALL]) == []  # 0.2
    assert standing_at([beside(WALL, 2.0, 1.0)], [WALL]) == []
    assert standing_at([], [WALL]) == standing_at([WALL], []) == []


def test_as_many_boxes_as_can_be_are_given_an_object_each():
    """The first fits both, the second one only: a greedy choice could leave the second without."""
    other = beside(PILLAR, 0.6)
    between = beside(PILLAR, 0.3)
    for order in ([PILLAR, other], [other, PILLAR]):
        assert standing_at([between, beside(PILLAR, -0.3)], order) == [0, 1]


@pytest.mark.parametrize("scene", ["pillars_added", "pillar_moved", "all_four"])
def test_a_room_whose_truth_is_found_is_told_so(scene):
    """An oracle's detection: everything right, nothing wrong, and what hardly shows counted apart."""
    for case in room_cases(scene, "occluded", 2, range(12)):
        found = []
        for change, sign in (("added", 1), ("removed", -1)):
            for box in true_boxes(case.pairs, case.row, sign)[0]:
                found.append(Mismatch(box.object_type, change, box.center, box.dimensions, box.rotation, 1.0))
        told = objects_of(found, case)
        shown = [one["shown"] >= LEAST_SHOWN for one in told["objects"]]
        assert told["found"] == told["right"] == len(found) == len(told["boxes"])
        assert told["wanted"] == told["reached"] == sum(shown)
        assert told["hidden"] == len(found) - sum(shown)
        assert all(one["right"] for one in told["boxes"]) and max(one[2] for one in told["off"]) < 1e-6
