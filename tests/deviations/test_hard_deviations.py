"""Deviations where it is easy to be sure of what is wrong: ends, turns, round shafts, scans that disagree."""

import numpy as np
import pytest
import trimesh

from jaxmm.deviations import fits
from jaxmm.deviations.deviation import deviations_by, deviations_of, faces_of
from jaxmm.deviations.meetings import Meetings
from jaxmm.deviations.moved_faces import faces_of_moved
from jaxmm.deviations.pose_errors import EXACT, HELD, KEPT, REGISTERED
from jaxmm.rays.own_ranges import own_ranges
from jaxmm.rays.range_noise import settled
from jaxmm.rays.scan_rays import rays_of_scan
from tests.cases.box_building import building_of
from tests.deviations.test_deviation import COLUMN, FREE, HALL, PLACE, hall, moved, scan_with_errors, seen, told
from warp_scanner.scenes.building import Triangles
from warp_scanner.scenes.building_edits import join
from warp_scanner.scenes.scenes import PILLAR, WALL
from warp_scanner.sensors.triangles import prepare

BESIDE = np.array([2.0, 4.3, 1.4])  # from where the end of the free wall shows, too


def shaft(x, y, radius=0.25, sections=48) -> Triangles:
    """A round column that stands from floor to ceiling."""
    mesh = trimesh.creation.cylinder(radius, 3.0, sections=sections)
    vertices = (mesh.vertices + np.array([x, y, 1.5])).astype(np.float32)
    return Triangles(vertices, mesh.faces.astype(np.int32), np.zeros(len(mesh.faces), np.int32), np.uint8([PILLAR]))


@pytest.mark.parametrize("step", [(0.0, 0.06, 0.0), (0.05, 0.04, 0.0)])
def test_the_end_of_a_wall_tells_as_its_side_does(step):
    one = told(hall(), seen(moved(hall(), FREE, step), BESIDE, 0.002))[FREE]
    assert one.offset[1] == pytest.approx(step[1], abs=2e-3) and abs(one.distance) >= max(np.abs(step)) - 2e-3
    assert one.surely > 0.03 and one.classes == {"loa": "LOA10", "din18202": "beyond"}


@pytest.mark.parametrize("angle", [-7.0, -2.0, 1.5, 3.0, 7.0])
def test_what_is_turned_or_leans_is_off_by_its_ends(angle):
    """Of a wall of 4 x 3 m that turns about its middle, the ends are off by up to a quarter of a metre."""
    for turn, high in (((0.0, 0.0, angle), 2.0), ((0.0, angle, 0.0), 1.5)):
        one = told(hall(), seen(moved(hall(), FREE, turn=turn)))[FREE]
        assert one.surely > 0.03 and abs(one.distance) < 2e-3
        assert 0.7 * high < one.worst / np.tan(np.radians(abs(angle))) <= high
        assert one.classes["loa"] != "LOA50"
    assert one.classes["din18202"] == "beyond"  # as it leans


@pytest.mark.parametrize("place", [(-1.0, 0.3, 1.4), (1.0, -2.0, 1.4), (-3.5, 2.0, 1.4)])
@pytest.mark.parametrize("step", [(0.0, 0.0, 0.0), (0.05, 0.0, 0.0), (0.0, 0.05, 0.0), (-0.03, 0.04, 0.0)])
def test_a_round_column_is_off_by_what_it_moved(place, step):
    room, number = building_of(HALL[:COLUMN]).triangles, COLUMN
    model, real = (join(room, shaft(-2.0 + x, -1.0 + y)) for x, y in ((0.0, 0.0), step[:2]))
    rays = seen(real, np.array(place), 0.003)
    one = deviations_of(prepare(model), [rays], [EXACT], np.full(COLUMN + 1, 0.03))[number]
    assert one.offset == pytest.approx(step, abs=4e-3)
    for axis in (0, 1):
        assert one.interval[axis][0] - 5e-4 <= step[axis] <= one.interval[axis][1] + 5e-4
    assert (one.surely > 0.03) == any(step) and one.distance == pytest.approx(one.direction @ np.array(step), abs=4e-3)
    near = np.linalg.norm(rays.position[:2] + rays.direction[:, :2] * rays.distance[:, None] - [-2, -1], axis=1) < 0.4
    assert one.rays <= near.sum()  # each of them counts once


@pytest.mark.parametrize("by", [0.04, 0.08])
def test_a_round_column_that_is_gone_before_another_one_is_not_told(by):
    """Rays end on the other one, as far off aside as it is drawn: that is no way by which the first stands."""
    room, other = building_of(HALL[:COLUMN]).triangles, shaft(-2.0 - by, -1.0)
    model, real = prepare(join(join(room, shaft(-2.0, -1.0)), other)), join(room, other)
    found = deviations_of(model, [seen(real, np.array([1.0, -1.0, 1.4]))], [EXACT], np.full(COLUMN + 2, 0.03))
    assert COLUMN not in found


def test_scans_that_disagree_leave_open_what_is_true():
    """A wardrobe before the wall, or another day: the mean of both is no place where anything stands."""
    scans = seen(moved(hall(), FREE, (0.2, 0.0, 0.0))), seen(hall(), np.array([-2.0, 1.0, 1.5]))
    for trust in (EXACT, REGISTERED):
        low, high = told(hall(), *scans, trust=trust)[FREE].interval[0]
        assert low <= 1e-3 and high >= 0.199


@pytest.mark.parametrize("count", [1, 3, 6])
def test_more_scans_do_not_settle_which_of_two_walls_moved(count):
    box = [one for number, one in enumerate(HALL) if number not in (FREE, COLUMN)]
    model = building_of(box).triangles
    places = [PLACE + np.array([0.4, 0.3, 0.0]) * number for number in range(count)]
    scans = [seen(moved(model, 3, (0.08, 0.0, 0.0)), place, 0.003, number) for number, place in enumerate(places)]
    found = deviations_of(prepare(model), scans, [REGISTERED] * count, np.full(len(box), 0.03))
    for row, sides in ((2, (-0.08, 0.0)), (3, (0.0, 0.08))):
        if found[row].interval[0] is not None:
            assert found[row].interval[0][0] <= sides[0] + 3e-3 and found[row].interval[0][1] >= sides[1] - 3e-3


@pytest.mark.long
@pytest.mark.parametrize("trust", [EXACT, KEPT, REGISTERED])
@pytest.mark.parametrize("count", [1, 4, 12])
def test_a_bias_of_the_sensor_does_not_average_out(trust, count):
    """Ranges that are 6 mm too long: what stands in its place is still held to do so, by most faces."""
    scans = []
    for number in range(count):
        rays = seen(hall(), PLACE + np.array([0.2, 0.15, 0.0]) * number, 0.003, number)
        distance = rays.distance + np.float32(0.006) * np.isfinite(rays.distance)
        scans.append(rays._replace(distance=distance.astype(np.float32)))
    found = told(hall(), *scans, trust=trust)
    held = [both[0] <= 0.0 <= both[1] for one in found.values() for both in one.interval if both is not None]
    assert np.mean(held) >= 0.9


def test_a_scan_of_which_no_ray_meets_a_face_tells_nothing():
    rays = seen(hall())
    assert told(hall(), rays._replace(position=rays.position + np.array([500.0, 0.0, 0.0]))) == {}
    assert told(hall(), rays._replace(measured=0)) == {}


def test_a_ceiling_that_hangs_below_a_slab_does_not_displace_it():
    real = building_of((*HALL, ((0, 0, 2.85), (6, 5, 0.02), WALL))).triangles
    found = deviations_of(prepare(hall()), [seen(real)], [EXACT], np.full(len(HALL), 0.03))
    assert 1 not in found and abs(found[0].distance) < 1e-3


@pytest.mark.parametrize("radius", [0.2, 0.4])
def test_ranges_that_settle_move_no_round_column(radius):
    """They settle on planes, which cut what is round; the column is measured by ranges as they were."""
    scene, number = prepare(join(building_of(HALL[:COLUMN]).triangles, shaft(-2.5, -1.5, radius))), COLUMN
    whole = scan_with_errors(join(building_of(HALL[:COLUMN]).triangles, shaft(-2.5, -1.5, radius)), 0.012)
    scan = settled(whole).scan
    rays = rays_of_scan(scan)
    offs = []
    for own in (own_ranges(rays, scan.rotation, whole), None):
        one = deviations_by(scene, [faces_of(scene, rays, EXACT, own)], np.full(COLUMN + 1, 0.03))[number]
        offs.append(abs(one.distance))
    assert offs[0] < 0.003 and offs[1] > 2.0 * offs[0]


def test_mixed_ranges_along_one_edge_turn_no_wall():
    """A twelfth of what is seen of it, at one edge, lies four standard deviations before it."""
    rays = seen(hall(), noise=0.004)
    ends = rays.position + rays.direction[: rays.measured] * rays.distance[: rays.measured, None]
    edge = (np.abs(ends[:, 0] - 2.9) < 0.03) & (ends[:, 1] > 1.67)
    distance = rays.distance.copy()
    distance[: rays.measured][edge] -= np.float32(0.015)
    one = told(hall(), rays._replace(distance=distance))[FREE]
    assert edge.sum() > 100 and abs(one.turn) < 0.03 and abs(one.distance) < 5e-4


@pytest.mark.parametrize("by", [-0.25, -0.06, 0.0, 0.05, 0.15])
@pytest.mark.parametrize("beside", [0.1, 0.4])
def test_a_wardrobe_before_a_wall_is_not_taken_for_it(by, beside):
    """Its front hides all of the wall but what is above, and a little beside it."""
    front = ((2.55 + by, beside / 2.0, 1.1), (0.02, 2.0 - beside / 2.0, 1.1), WALL)
    real = moved(building_of((*HALL, front)).triangles, FREE, (by, 0.0, 0.0))
    one = deviations_of(prepare(hall()), [seen(real, noise=0.002)], [EXACT], np.full(len(HALL), 0.03))[FREE]
    assert one.distance == pytest.approx(-by, abs=1e-3) and one.half < 0.01


NEAR_BY = np.array([1.2, 0.0, 1.4])  # from where the head of the free wall is out of view


def test_a_front_that_hides_all_that_is_seen_of_a_wall_leaves_open_where_it_stands():
    front = ((2.6, 0.0, 1.1), (0.02, 2.0, 1.1), WALL)
    one = deviations_of(
        prepare(hall()), [seen(building_of((*HALL, front)).triangles, NEAR_BY)], [EXACT], np.full(len(HALL), 0.03)
    )[FREE]
    low, high = one.interval[0]
    assert low <= -0.32 and high >= 0.0 and one.surely == 0.0
    # A scan that sees above it, or the other side, knows.
    for other in (PLACE, np.array([4.5, 0.2, 1.4])):
        scans = seen(building_of((*HALL, front)).triangles, NEAR_BY), seen(building_of((*HALL, front)).triangles, other)
        known = deviations_of(prepare(hall()), list(scans), [EXACT] * 2, np.full(len(HALL), 0.03))[FREE]
        assert abs(known.distance) < 1e-3 and known.half < 0.02


def test_a_wall_that_moved_toward_the_scanner_is_so_where_its_head_shows():
    one = told(hall(), seen(moved(hall(), FREE, (-0.25, 0.0, 0.0))))[FREE]
    assert one.distance == pytest.approx(0.25, abs=1e-4) and one.half < 0.01


@pytest.mark.parametrize("noise", [0.0, 0.03])
def test_noise_displaces_no_wall(noise):
    """Places of 0.1 m err by centimetres each, but the face that is fitted to all of them does not."""
    found = told(hall(), seen(hall(), noise=noise), trust=EXACT)
    assert max(one.surely for one in found.values()) < 0.004


@pytest.mark.parametrize("wide, high", [(0.2, 0.4), (0.3, 0.4), (0.5, 0.5)])
def test_few_cells_tell_an_interval_that_holds_the_truth(wide, high):
    """Cells of 0.1 m err by 3 mm each, and rays by as much within them; so few lie near any plane through them."""
    rng, held, count = np.random.default_rng(0), [], round(2000 * wide * high)
    for _ in range(300):
        place = rng.uniform(0.0, [wide, high], (count, 2))
        number = np.unique(fits.cells_of(place), return_inverse=True)[1]
        off = rng.normal(0.0, 0.003, number.max() + 1)[number] + rng.normal(0.0, 0.003, count)
        _, found, left, sigma = fits._least_squares(off, (place, np.zeros((count, 2))), np.ones(count, bool))
        held.append(abs(found[0]) < 1.96 * np.sqrt(fits._variance(place, left, sigma)[0, 0]))
    assert np.mean(held) > 0.88


def test_what_others_hold_sees_that_all_walls_moved():
    """Of its own walls alone it would be taken for the pose that is off."""
    real = hall()
    for row in range(2, len(HALL)):
        real = moved(real, row, (0.1, 0.0, 0.0))
    rays = seen(real, noise=0.003)
    held, registered = (told(hall(), rays, trust=trust) for trust in (HELD, REGISTERED))
    for row, sign in ((2, 1.0), (3, -1.0)):
        one = held[row]
        assert one.surely > 0.03 and abs(one.distance - 0.1 * sign) < one.half
        assert registered[row].surely == 0.0


@pytest.mark.parametrize("turn", [-8.0, 5.0])
def test_a_face_that_is_turned_otherwise_than_the_rest_of_its_element_is_none_of_it(turn):
    """A few rays on an edge, or on what stands beside it: the other face alone tells."""
    model = prepare(hall())
    shown = faces_of(model, seen(moved(hall(), COLUMN, (0.02, 0.01, 0.0)), noise=0.001), EXACT)
    less, more = sorted((one for one in shown.seen if one.element == COLUMN), key=lambda one: one.rays)
    slope = np.add(less.fit.slope, (np.radians(turn), 0.0))
    edge = less._replace(rays=25, fit=less.fit._replace(slope=slope, level=0.08))
    tolerance = np.full(len(HALL), 0.03)
    alone, with_edge = (
        deviations_by(model, [shown._replace(seen=faces)], tolerance)[COLUMN] for faces in ([more], [more, edge])
    )
    assert with_edge == alone and alone.rays == more.rays
    both = deviations_by(model, [shown], tolerance)[COLUMN]
    assert both.rays == more.rays + less.rays and None not in both.interval[:2]


def test_of_what_had_no_vote_the_same_is_shown_as_of_all():
    model = prepare(hall())
    rays = seen(moved(hall(), FREE, (0.04, 0.0, 0.0)), noise=0.003)
    every = faces_of(model, rays, REGISTERED)
    some = faces_of_moved(model, rays, np.array([FREE]), every.poses)
    tolerance = np.full(len(HALL), 0.03)
    found, whole = (deviations_by(model, [one], tolerance) for one in (some, every))
    assert found == {FREE: whole[FREE]}
    np.testing.assert_array_equal(some.heights.rays, every.heights.rays)


@pytest.mark.parametrize("by, told_at", [(-0.14, -0.14), (0.14, -0.02)])
def test_what_lies_behind_the_place_of_a_wall_is_no_cupboard_before_it(by, told_at):
    """Of a high wall the foot shows, at one level, and beside that a little farther behind."""
    rng, count = np.random.default_rng(0), 2000
    end = np.column_stack([np.zeros(count), rng.uniform(-1.0, 1.0, count), rng.uniform(0.2, 1.2, count)])
    off = np.where(end[:, 1] > 0.9, -0.02 if by > 0.0 else -0.3, by) + rng.normal(0.0, 0.002, count)
    sensor, normal = np.array([3.0, 0.0, 1.0]), np.tile([1.0, 0.0, 0.0], (count, 1))
    hit = end + (end - sensor) * (-off / 3.0)[:, None]
    reach = np.linalg.norm(hit - sensor, axis=1)
    group = Meetings(np.zeros(count, int), np.zeros(count, int), normal, hit, off, reach, reach, sensor)
    assert fits.fit_of(group, 0.0, 7.0).level == pytest.approx(told_at, abs=2e-3)
