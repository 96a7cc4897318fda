"""Where a face finishes, as every ray of a scan shows it."""

import numpy as np
import pytest

from jaxmm.learning.upright_shapes import Face
from jaxmm.objects.clues import CLUES
from jaxmm.objects.face_finish import FAR, NOTHING, STRIP, Finish, Rays, crossed_by, finish_of
from jaxmm.objects.finder import ObjectSettings, examine
from jaxmm.objects.pieces import Piece
from tests.cases.known_rooms import NO_RAYS, SENSOR, judged, pillar, slab, wall

HEIGHTS = np.array([-1.0, 1.0])
BEHIND = 5.0  # [m] where the wall behind everything is


def seen(*things, low=-1.2, high=1.2, behind=BEHIND):
    """Level rays from the origin, along x and up to 50 degrees aside, into a plan of segments and a wall behind them.

    A segment is two places (2,) [m]; what lies aside of the bearings `low` to `high` [rad] comes back from nowhere.
    """
    bearing = np.linspace(-0.9, 0.9, 8001)
    way = np.stack([np.cos(bearing), np.sin(bearing)], axis=1)
    reach = behind / way[:, 0]
    for start, end in things:
        start, along = np.array(start, float), np.subtract(end, start)
        det = way[:, 0] * -along[1] + way[:, 1] * along[0]
        with np.errstate(divide="ignore", invalid="ignore"):
            far = (start[0] * -along[1] + start[1] * along[0]) / det
            at = (way[:, 0] * start[1] - way[:, 1] * start[0]) / det
        reach = np.where((at >= 0.0) & (at <= 1.0) & (far > 0.0), np.minimum(reach, far), reach)
    reach = np.where((bearing >= low) & (bearing <= high), reach, np.inf)
    return Rays(np.zeros(3), np.column_stack([way, np.zeros(len(way))]), reach)


def both(rays, length, center=(2.0, 0.0)):
    """The finish of a face across x, at its lower y and at its higher."""
    face = Face(np.zeros(0, int), np.array(center), np.array([0.0, 1.0]), length)
    crossed = crossed_by(rays, Piece(np.zeros(0, int), face, None, 0, np.zeros(3)), HEIGHTS)
    return tuple(finish_of(crossed, length, way) for way in (-1.0, 1.0))


@pytest.mark.parametrize("length", [0.1, 0.3, 0.62, 1.5])
def test_a_lone_face_ends_where_all_rays_go_on(length):
    for one in both(seen(((2.0, -length / 2), (2.0, length / 2))), length):
        assert one.shift == pytest.approx(0.0, abs=STRIP)
        assert one == Finish(one.shift, 0.0, pytest.approx(3.0, abs=0.01), 0.0, 0.0)


@pytest.mark.parametrize("off", [-0.2, -0.1, 0.1, 0.3])
def test_a_face_ends_where_it_does_and_not_where_thinned_points_do(off):
    one, other = both(seen(((2.0, -0.5), (2.0, 0.5 + off))), 1.0)
    assert other.shift == pytest.approx(off, abs=STRIP) and one.shift == pytest.approx(0.0, abs=STRIP)


@pytest.mark.parametrize("depth", [0.12, 0.3, 0.6, 1.0])
def test_the_side_of_a_thing_is_as_deep_as_one_sees_it_go_on(depth):
    """It stands at y from 1.6 on: the origin sees its front and the side that is toward it."""
    front, side = ((2.0, 1.6), (2.0, 2.2)), ((2.0, 1.6), (2.0 + depth, 1.6))
    near, far = both(seen(front, side), 0.6, (2.0, 1.9))
    assert near.side == pytest.approx(depth, abs=0.1)
    assert near.side + near.jump == pytest.approx(min(BEHIND - 2.0, FAR), abs=0.1)
    assert far.side == 0.0 and far.shift == pytest.approx(0.0, abs=STRIP)


def test_what_is_far_behind_is_no_part_of_a_long_side():
    """Both are deeper than what matters, and so as deep as each other."""
    near, _ = both(seen(((4.0, 3.6), (4.0, 3.8)), ((4.0, 3.6), (9.0, 3.6)), behind=12.0), 0.2, (4.0, 3.7))
    assert 2.8 < near.side < FAR and near.jump == pytest.approx(FAR - near.side)


def test_what_stands_before_an_end_hides_it():
    screen = ((1.0, 0.15), (1.0, 0.6))  # hides y from 0.3 to 1.2 on the line of the face
    one, other = both(seen(((2.0, -0.5), (2.0, 0.8)), screen), 0.8, (2.0, -0.1))
    assert (one.before, other.before) == (0.0, 1.0)
    assert other.shift == pytest.approx(0.0, abs=STRIP)
    assert other.side == 0.0 and other.jump == NOTHING


def test_where_the_picture_ends_no_ray_tells():
    """Of a wall from y = -2 to 2 the thinned points reach from -0.4 to 0.4, where the picture ends."""
    rays = seen(((2.0, -2.0), (2.0, 2.0)))
    inside = rays.direction[:, 1] <= rays.direction[:, 0] * 0.2
    one, other = both(rays._replace(direction=rays.direction[inside], distance=rays.distance[inside]), 0.8)
    assert other == pytest.approx(Finish(0.0, 0.0, NOTHING, NOTHING, NOTHING), abs=STRIP)
    assert one.shift > 1.5


def test_what_nothing_came_back_from_is_missing():
    """Rays that went out beside the face and did not come back: black or too far."""
    one, other = both(seen(((2.0, -2.0), (2.0, 2.0)), high=np.arctan2(0.4, 2.0)), 0.8)
    assert (other.missing, other.before, other.jump) == (1.0, 0.0, NOTHING)
    assert one.missing == NOTHING and one.shift > 1.5


@pytest.mark.parametrize("length", [0.3, 0.8])
def test_without_a_ray_the_thinned_points_are_all_that_is_known(length):
    behind = seen()._replace(origin=np.array([4.0, 0.0, 0.0]))
    expected = pytest.approx(Finish(0.0, 0.0, NOTHING, NOTHING, NOTHING))
    assert both(NO_RAYS, length) == both(behind, length) == (expected, expected)


def test_a_screen_before_a_face_does_not_end_it():
    """Nor do the few rays of its strips that end far behind, as they do at the edges of things."""
    face, screen = ((2.0, -1.0), (2.0, 1.0)), ((1.0, 0.2), (1.0, 0.3))
    rays = seen(face, screen)
    stray = np.flatnonzero(rays.distance < 1.2)[::4]
    rays.distance[stray] *= 3.0
    assert both(rays, 1.6)[1].shift == pytest.approx(0.2, abs=STRIP)


def test_another_thing_beside_the_side_does_not_come_before_it():
    """Next to a side that goes back 0.6 m something stands at 0.3 m: jump is 0, and no gap value."""
    thing, other = (((2.0, 1.6), (2.0, 2.2)), ((2.0, 1.6), (2.6, 1.6))), ((2.3, 1.0), (2.3, 1.35))
    near, _ = both(seen(*thing, other), 0.6, (2.0, 1.9))
    assert near.side > 0.2 and near.jump == 0.0


def test_neither_the_order_of_rays_nor_the_length_of_their_directions_matters():
    rng, rays = np.random.default_rng(0), seen(((2.0, -0.4), (2.0, 0.5)), ((2.0, 0.5), (2.5, 0.5)))
    order, scale = rng.permutation(len(rays.distance)), 2.0 ** rng.integers(-2, 3, len(rays.distance))
    other = Rays(
        np.tile(rays.origin, (len(order), 1)), (rays.direction * scale[:, None])[order], (rays.distance / scale)[order]
    )
    for one, same in zip(both(rays, 0.8), both(other, 0.8), strict=True):
        assert one == pytest.approx(same, abs=1e-9)


def clues(thing, *others, rays=True):
    room = judged(thing, others=others)
    examined = examine(room if rays else room._replace(rays=None), ObjectSettings())
    return dict(zip(CLUES, examined.clues[0], strict=True))


def test_all_rays_of_a_scan_tell_an_end_better_than_its_thinned_points():
    """A camera of 320 x 200, a pillar whose width ends anywhere between two voxels, seen from right before it."""
    off: dict[bool, list[float]] = {True: [], False: []}
    for width in np.linspace(0.5, 0.9, 9):
        told = clues(pillar(2.5, 0.0, width))
        for rays in off:
            off[rays] += [told["length"] / 2 + rays * told[f"{end}_shift"] - width / 2 for end in ("near", "far")]
    assert np.abs(off[True]).max() <= 1.5 * STRIP
    assert np.abs(off[True]).mean() < 0.6 * np.abs(off[False]).mean()


def test_a_thin_wall_and_a_pillar_show_how_deep_their_sides_are():
    thin, deep = (clues(one)["near_side"] for one in (wall(2.05, 1.2, 0.8, 0.1, 90), pillar(2.4, 1.2, 0.8)))
    assert thin <= 0.2 and deep >= 0.5


@pytest.mark.parametrize("thickness", [0.25, 0.06])
@pytest.mark.parametrize("second", [(4.5, 0.6, 1.4, 0.0), (4.6, 1.2, 1.4, 200.0)])
def test_a_scan_from_behind_tells_nothing_of_the_front(second, thickness):
    """One that looks away, and one that has more points of the wall, on the same face where that is thin."""
    thing, poses = wall(2.5, 0.0, 2.0, thickness, 90), ((*SENSOR, 0.0), second)
    one, two = (
        [dict(zip(CLUES, told, strict=True)) for told in examine(judged(thing, poses=some), ObjectSettings()).clues]
        for some in (poses[:1], poses)
    )
    front = min(two, key=lambda told: abs(told["length"] - one[0]["length"]))
    for end in ("near", "far"):
        assert front[f"{end}_shift"] == pytest.approx(one[0][f"{end}_shift"], abs=2 * STRIP)
        assert front[f"{end}_jump"] > 1.0 and front[f"{end}_before"] == 0.0


@pytest.mark.parametrize("apart", [0.0, 0.005])
def test_scans_turned_on_the_spot_show_an_end_each(apart):
    """As registration leaves them, a few millimetres apart: of either end the one tells that looked there."""
    poses = ((0.0, 0.0, 1.4, -35.0), (0.0, apart, 1.4, 35.0))
    told = examine(judged(wall(2.05, 0.0, 3.0, 0.1, 90), poses=poses), ObjectSettings()).clues[0]
    told = dict(zip(CLUES, told, strict=True))
    for end in ("near", "far"):
        assert told[f"{end}_shift"] == pytest.approx(0.0, abs=2 * STRIP)
        assert told[f"{end}_jump"] > 1.0


def test_a_cabinet_before_an_end_shows_as_such():
    cabinet = slab((1.2, 0.3), (0.4, 0.5), 0.0, 3.0)
    free, hidden = (clues(wall(2.5, 0.0, 1.6, 0.1, 90), *others) for others in ((), (cabinet,)))
    assert max(free["near_before"], free["far_before"]) == 0.0
    assert max(hidden["near_before"], hidden["far_before"]) > 0.8
