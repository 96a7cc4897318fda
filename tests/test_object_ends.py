"""Both ends of a face: what one sees there of how long and how deep a thing is."""

import numpy as np
import pytest
from known_rooms import CEILING, FLOOR, SENSOR, judged, pillar, wall

from jaxmm.object_clues import CLUES
from jaxmm.object_ends import FAR, back_of, ends_of
from jaxmm.object_pieces import Piece
from jaxmm.object_shapes import face_through
from jaxmm.object_sight import Sight
from jaxmm.object_solids import SolidSettings
from jaxmm.object_view import view_of
from jaxmm.objects import ObjectSettings, examine

SETTINGS = SolidSettings()


def looked_at(seen, side):
    """The face of a room's new points that lies at a value of x, as a piece, and the sight of all."""
    new = np.flatnonzero((seen.apart > 0.2) & (np.abs(seen.points[:, 0] - side) < 0.03))
    piece = Piece(new, face_through(seen.points[:, :2], new), None, 0, np.array(SENSOR))
    return piece, Sight(seen.points, np.tile(SENSOR, (len(seen.points), 1)), FLOOR, CEILING)


def ends(seen, side):
    piece, sight = looked_at(seen, side)
    view = view_of(seen.points, np.array(SENSOR))
    return ends_of(sight, piece, piece.members, seen.apart, view, SETTINGS)


@pytest.mark.parametrize("y", [1.2, -1.2])
def test_the_depth_of_a_thing_is_where_one_looks_through_beside_its_nearer_end(y):
    """A thin wall and a pillar of the same width: one looks past the back of the wall sooner."""
    thin, thick = (ends(judged(one), 2.0)[0] for one in (wall(2.05, y, 0.8, 0.1, 90), pillar(2.4, y, 0.8)))
    assert thin.deep <= 0.3 and thin.goes_on <= 0.2
    assert thick.deep >= 0.7 and thick.deep <= 1.1


def test_the_nearer_end_comes_first():
    """The sensor stands at y = 0, so that of a thing at y > 0 the lower end is nearer; turned over, the other."""
    for y in (1.2, -1.2):
        seen = judged(wall(2.05, y, 0.8, 0.1, 90))
        seen.apart[(np.abs(seen.points[:, 1]) < 0.9) & (seen.apart > 0.5)] = 0.3
        near, far = ends(seen, 2.0)
        assert (near.apart, far.apart) == (0.3, 1.0)


def test_a_face_that_the_picture_cuts_has_the_edge_of_the_view_there():
    """The camera sees 40 degrees or so to either side: a wall across the view goes out of it at both ends."""
    cut, whole = (ends(judged(one), 2.0) for one in (wall(2.05, 0.0, 9.0, 0.1, 90), wall(2.05, 0.0, 0.8, 0.1, 90)))
    assert all(end.in_view <= 0.1 and end.goes_on == FAR for end in cut)
    assert all(0.8 <= end.in_view < FAR and end.goes_on <= 0.2 for end in whole)


def test_what_nobody_looks_past_may_be_deep():
    assert all(end.deep == FAR for end in ends(judged(wall(2.05, 0.0, 9.0, 0.1, 90)), 2.0))


def test_rays_along_the_back_of_a_thin_wall_tell_that_it_is_no_deeper():
    """The sensor looks past its end, behind it."""
    (piece, sight), (pillar_piece, pillar_sight) = (
        looked_at(judged(one), 1.5) for one in (wall(1.55, 1.6, 1.4, 0.1, 90), pillar(2.2, 1.6, 1.4))
    )
    assert back_of(sight, piece, SETTINGS) <= 0.4
    assert back_of(pillar_sight, pillar_piece, SETTINGS) >= 1.3


def test_how_deep_a_thing_may_be_is_among_its_clues():
    told = [
        dict(zip(CLUES, examine(judged(one), ObjectSettings()).clues[0], strict=True))
        for one in (wall(2.05, 1.2, 0.8, 0.1, 90), pillar(2.4, 1.2, 0.8))
    ]
    assert told[0]["near_deep"] <= 0.3 and told[0]["back"] <= 0.4
    assert told[1]["near_deep"] >= 0.7 and told[1]["back"] >= 0.8
    assert told[0]["longest"] == pytest.approx(0.8, abs=0.25)


def test_the_edge_of_the_view_is_that_of_the_scan_that_saw_the_thing():
    """A second scan, that looks the other way, shows nothing of where the first one's picture ends."""
    things = (wall(2.05, 0.0, 9.0, 0.1, 90), pillar(-3.0, 0.5, 0.6))
    told = []
    for poses in (((*SENSOR, 0.0),), ((*SENSOR, 0.0), (0.1, 0.0, 1.4, 180.0))):
        examined = examine(judged(*things, poses=poses), ObjectSettings())
        (number,) = [number for number, one in enumerate(examined.candidates) if one.first.face.length > 2.0]
        told.append(dict(zip(CLUES, examined.clues[number], strict=True)))
    for name in ("near_in_view", "far_in_view"):
        assert max(one[name] for one in told) <= 0.1
