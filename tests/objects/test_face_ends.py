"""Both ends of a face: what one sees there of how long and how deep a thing is."""

import numpy as np
import pytest

from jaxmm.learning.upright_shapes import face_through
from jaxmm.objects.clues import CLUES
from jaxmm.objects.face_ends import FAR, Look, back_of, ends_of
from jaxmm.objects.finder import ObjectSettings, examine
from jaxmm.objects.patches import Sight
from jaxmm.objects.pieces import Piece
from jaxmm.objects.solids import SolidSettings
from jaxmm.objects.view_window import view_of
from tests.cases.known_rooms import CEILING, FLOOR, NO_RAYS, SENSOR, judged, pillar, slab, wall

SETTINGS = SolidSettings()


def looked_at(seen, side):
    """The face of a room's new points that lies at a value of x, as a piece, and the sight of all."""
    new = np.flatnonzero((seen.apart > 0.2) & (np.abs(seen.points[:, 0] - side) < 0.03))
    piece = Piece(new, face_through(seen.points[:, :2], new), None, 0, np.array(SENSOR))
    return piece, Sight(seen.points, np.tile(SENSOR, (len(seen.points), 1)), FLOOR, CEILING)


def ends(seen, side):
    piece, sight = looked_at(seen, side)
    looks = [Look(sight, view_of(seen.points, np.array(SENSOR)), lambda: seen.rays[0])]
    return ends_of(sight, looks, piece, piece.members, seen.apart, SETTINGS)


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
    """A thin wall: before what is behind its nearer end stands something, and nobody sees behind the other."""
    thin, screen = wall(2.55, 1.2, 0.8, 0.1, 90), slab((1.5, 0.1), (0.32, 0.28), 0.0, 3.0)
    free, hidden = ends(judged(thin), 2.5), ends(judged(thin, others=(screen,)), 2.5)
    assert free[0].deep <= 0.3 and hidden[0].deep > 0.5
    assert free[1].deep == hidden[1].deep == FAR


def told_of(seen, least=0.3):
    """The clues of the one candidate whose first face is that long [m]."""
    examined = examine(seen, ObjectSettings())
    faces = [(one.first.face.length if one.first.face is not None else 0.0) for one in examined.candidates]
    (number,) = [number for number, length in enumerate(faces) if length > least]
    return dict(zip(CLUES, examined.clues[number], strict=True))


def test_another_scan_of_the_front_takes_nothing_from_what_one_saw_of_the_back():
    """All its rays end on the face: that is no reason to think that something is behind it."""
    thing, aside, before = wall(2.05, 1.6, 2.0, 0.1, 90), (*SENSOR, 0.0), (-2.5, 1.6, 1.4, 0.0)
    one, both = told_of(judged(thing, poses=(aside,))), told_of(judged(thing, poses=(aside, before)))
    assert both["back"] <= one["back"] < 1.0
    assert min(both["near_deep"], both["far_deep"]) <= min(one["near_deep"], one["far_deep"]) + 0.1


def test_where_nobody_knows_which_scan_saw_what_no_view_has_an_edge():
    poses = ((0.0, -0.5, 1.4, 0.0), (0.0, 0.5, 1.4, 0.0))
    told = told_of(judged(wall(2.05, 0.0, 9.0, 0.1, 90), poses=poses)._replace(scan=None, rays=None), 2.0)
    assert told["near_in_view"] == told["far_in_view"] == FAR


def test_rays_along_the_back_of_a_thin_wall_tell_that_it_is_no_deeper():
    """The sensor looks past its end, behind it."""
    (piece, sight), (pillar_piece, pillar_sight) = (
        looked_at(judged(one), 1.5) for one in (wall(1.55, 1.6, 1.4, 0.1, 90), pillar(2.2, 1.6, 1.4))
    )
    assert back_of([Look(sight, None, lambda: NO_RAYS)], piece, SETTINGS) <= 0.4
    assert back_of([Look(pillar_sight, None, lambda: NO_RAYS)], pillar_piece, SETTINGS) >= 1.3


def test_how_deep_a_thing_may_be_is_among_its_clues():
    told = [
        dict(zip(CLUES, examine(judged(one), ObjectSettings()).clues[0], strict=True))
        for one in (wall(2.05, 1.2, 0.8, 0.1, 90), pillar(2.4, 1.2, 0.8))
    ]
    assert told[0]["near_deep"] <= 0.3 and told[0]["back"] <= 0.4
    assert told[1]["near_deep"] >= 0.7 and told[1]["back"] >= 0.8
    assert told[0]["longest"] == pytest.approx(0.8, abs=0.25)


@pytest.mark.parametrize("second", [(0.1, 0.0, 1.4, 180.0), (*SENSOR, 180.0)])
def test_the_edge_of_the_view_is_that_of_the_scan_that_saw_the_thing(second):
    """A scan that looks the other way, from the same place even, shows nothing of where the picture ends."""
    things = (wall(2.05, 0.0, 9.0, 0.1, 90), pillar(-3.0, 0.5, 0.6))
    for poses in (((*SENSOR, 0.0),), ((*SENSOR, 0.0), second)):
        told = told_of(judged(*things, poses=poses), 2.0)
        assert told["near_in_view"] <= 0.1 and told["far_in_view"] <= 0.1


def test_what_two_scans_saw_is_in_view_as_far_as_one_of_them_saw():
    poses = ((0.0, -1.5, 1.4, 0.0), (0.0, 1.5, 1.4, 0.0))
    thing = wall(3.05, 0.0, 0.8, 0.1, 90)
    alone = [told_of(judged(thing, poses=(pose,))) for pose in poses]
    both = told_of(judged(thing, poses=poses))
    widest = max(one[name] for one in alone for name in ("near_in_view", "far_in_view"))
    assert both["near_in_view"] == pytest.approx(widest, abs=0.11) == both["far_in_view"]
