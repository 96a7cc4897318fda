"""What is one wall: parts in one plane, around openings and before panes; what only meets it, or stands before it."""

import numpy as np
import pytest

from jaxmm.learning.upright_shapes import face_through
from jaxmm.objects.candidates import candidates_of
from jaxmm.objects.finder import ObjectSettings, examine, find_objects
from jaxmm.objects.patches import Sight
from jaxmm.objects.pieces import Piece
from jaxmm.objects.solids import SolidSettings, solid_of
from jaxmm.objects.walls import KnownBuilding
from tests.cases.known_rooms import CEILING, FLOOR, SENSOR, judged, says, slab, wall


def test_two_walls_that_meet_make_none_as_thick_as_they_are_long():
    seen = judged(wall(3.2, 0.45, 1.3, 0.2, 50), wall(3.2, -0.45, 1.3, 0.2, -50))
    examined = examine(seen, ObjectSettings())
    solids = [solid_of(examined.sight, one, True, ObjectSettings(), KnownBuilding()) for one in examined.candidates]
    assert solids and all(min(solid.edges) <= ObjectSettings().most_thickness + 1e-6 for solid in solids)


def test_a_wall_lies_where_it_is_in_front_of_its_panes():
    """Panes from floor to ceiling, set back by 0.12 m, show more than the wall between them does."""
    parts = [wall(4.0, y, 0.4, 0.3, 90) for y in (-1.7, 0.0, 1.7)]
    panes = [wall(3.995, y, 1.3, 0.05, 90) for y in (-0.85, 0.85)]
    (found,) = find_objects(judged(*parts, *panes))
    assert found.box.object_type == "wall"
    front = found.box.center[0] - found.box.dimensions[1] / 2
    assert front == pytest.approx(3.85, abs=0.01) and abs(abs(found.box.rotation) - 90.0) < 0.5
    assert found.box.dimensions[0] == pytest.approx(3.8, abs=0.06)


def test_what_is_lower_before_a_wall_or_little_of_it_is_not_its_face():
    """A board that hides most of a wall, but for its top and both ends; and a pilaster."""
    whole, board = wall(4.0, 0.0, 3.6, 0.2, 90), slab((3.8, 0.04), (0.0, 2.8), FLOOR, 2.4)
    pilaster = slab((3.84, 0.12), (0.3, 0.25), FLOOR, CEILING)
    for before, off in ((board, 0.03), (pilaster, 0.04)):
        (found,) = find_objects(judged(whole, before))
        assert found.box.object_type == "wall"
        assert found.box.center[0] - found.box.dimensions[1] / 2 == pytest.approx(3.9, abs=off)


@pytest.mark.parametrize("yaw", [80.0, 85.0, 90.0])
def test_a_wall_whose_middle_is_hidden_is_turned_as_both_its_parts(yaw):
    """With errors of 3 cm the ends of a short face are off the line of the other, and neither is set back."""
    crate = slab((2.6, 0.2), (0.0, 0.5), FLOOR, CEILING)
    for found in find_objects(judged(wall(4.0, 0.0, 3.6, 0.2, yaw), others=[crate], noise=0.03))[:1]:
        assert abs((found.box.rotation - yaw + 90.0) % 180.0 - 90.0) < 0.6


def test_a_wall_is_one_around_its_window_and_what_stands_below_a_window_alone_is_furniture():
    below, above = slab((3.0, 0.2), (0.0, 2.0), FLOOR, 0.8), slab((3.0, 0.2), (0.0, 2.0), 2.1, CEILING)
    sure = says(0.05, 0.05, 0.9)
    (whole,) = find_objects(judged(below, above), judge=sure)
    assert whole.box.object_type == "wall" and whole.box.dimensions[2] == pytest.approx(3.0, abs=0.1)
    assert find_objects(judged(below), judge=sure) == [] and find_objects(judged(above), judge=sure) == []
    apart = slab((3.6, 0.2), (0.0, 2.0), 2.1, CEILING)  # of another plane
    assert find_objects(judged(below, apart), judge=sure) == []
    beside = slab((3.0, 0.2), (2.2, 2.0), 2.1, CEILING)  # not above it
    assert find_objects(judged(below, beside), judge=sure) == []


def test_an_end_of_a_wall_that_has_more_points_than_the_wall_belongs_to_it():
    rng = np.random.default_rng(0)

    def piece(start, end, count, first):
        members = np.arange(first, first + count)
        points[members, :2] = np.linspace(start, end, count)
        points[members, 2] = rng.uniform(0.2, 2.8, count)
        return Piece(members, face_through(points[:, :2], members), None, 0, SENSOR)

    points = np.zeros((100, 3))
    pillar_face = piece([3.0, -2.0], [3.0, -1.6], 40, 0)
    end, face = piece([2.0, 1.0], [2.2, 1.0], 35, 40), piece([2.0, 1.0], [2.0, 3.0], 25, 75)
    sight = Sight(points, np.tile(SENSOR, (100, 1)), FLOOR, CEILING)
    settings = SolidSettings()
    (one,) = [one for one in candidates_of(sight, [pillar_face, end, face], settings) if 45 in one.members]
    solid = solid_of(sight, one, True, settings, KnownBuilding())
    assert set(solid.members) == set(range(40, 100)) and solid.edges[1] == pytest.approx(0.2, abs=0.02)
