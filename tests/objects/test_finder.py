"""Walls and pillars of scanned rooms whose every object is known: found where they stand, and nothing else."""

import numpy as np
import pytest

from jaxmm.learning.box_match import match_boxes
from jaxmm.learning.boxes import Box
from jaxmm.objects.clues import CLUES
from jaxmm.objects.face_ends import as_all_rays_show
from jaxmm.objects.face_finish import Rays
from jaxmm.objects.finder import Judged, ObjectSettings, examine, find_objects
from jaxmm.objects.walls import KnownBuilding
from tests.cases.known_rooms import CEILING, FLOOR, SENSOR, i_section, judged, pillar, says, slab, wall
from warp_scanner.scenes.scenes import BOX, CYLINDER
from warp_scanner.sensors.sensors import OAK_D_PRO_SMALL


def only(found, object_type):
    assert [one.box.object_type for one in found] == [object_type]
    return found[0].box


def plane_distance(box, truth):
    """How far [m] the middle plane of a wall is off, and the angle [deg] between both."""
    turn = np.radians(truth.rotation + (0.0 if truth.dimensions[0] > truth.dimensions[1] else 90.0))
    off = abs((box.center - truth.center)[:2] @ [-np.sin(turn), np.cos(turn)])
    long = box.rotation + (0.0 if box.dimensions[0] > box.dimensions[1] else 90.0)
    between = (long - np.degrees(turn)) % 180.0
    return off, min(between, 180.0 - between)


@pytest.mark.parametrize("seed", range(12))
def test_a_pillar_has_its_centre_and_size_from_the_faces_that_show(seed):
    rng = np.random.default_rng(seed)
    x, y, width, yaw = rng.uniform(2.0, 4.0), rng.uniform(-1.0, 1.0), rng.uniform(0.35, 1.2), rng.uniform(20, 70)
    kind = CYLINDER if seed % 2 else BOX
    box = only(find_objects(judged(pillar(x, y, width, yaw, kind))), "pillar")
    assert box.shape == ("round" if seed % 2 else "rectangular")
    np.testing.assert_allclose(box.center, [x, y, 1.5], atol=0.08)
    np.testing.assert_allclose(box.dimensions, [width, width, 3.0], atol=0.12)
    if not seed % 2:
        turn = (box.rotation - yaw) % 90.0
        assert min(turn, 90.0 - turn) < 6.0
    assert box.probability > 0.9


@pytest.mark.parametrize("seed", range(12))
def test_a_slender_pillar_is_turned_as_its_two_short_faces_are(seed):
    rng = np.random.default_rng(seed)
    x, y, width, yaw = rng.uniform(1.5, 2.5), rng.uniform(-0.6, 0.6), rng.uniform(0.3, 0.4), rng.uniform(30, 60)
    box = only(find_objects(judged(pillar(x, y, width, yaw))), "pillar")
    turn = (box.rotation - yaw) % 90.0
    assert min(turn, 90.0 - turn) < 4.0
    np.testing.assert_allclose(box.center[:2], [x, y], atol=0.03)


@pytest.mark.parametrize("seed", range(24))
def test_a_column_of_flanges_and_a_web_stands_where_its_outline_does(seed):
    rng = np.random.default_rng(seed)
    x, y, yaw = rng.uniform(1.5, 3.5), rng.uniform(-0.8, 0.8), rng.uniform(0, 180)
    box = only(find_objects(judged(*i_section(x, y, 0.3, yaw)), judge=says(0.02, 0.96, 0.02)), "pillar")
    assert np.linalg.norm(box.center[:2] - [x, y]) < 0.1
    np.testing.assert_allclose(box.dimensions[:2], 0.3, atol=0.12)


def test_a_pillar_that_shows_one_face_is_taken_for_a_square_one_or_for_a_known_one():
    seen = judged(pillar(3.0, 0.0, 0.8))
    box = only(find_objects(seen), "pillar")
    np.testing.assert_allclose(box.center[:2], [3.0, 0.0], atol=0.06)
    flat = only(find_objects(seen, known=KnownBuilding(columns=((0.8, 0.5, False),))), "pillar")
    assert sorted(flat.dimensions[:2]) == pytest.approx([0.5, 0.8], abs=0.1)
    assert flat.center[0] == pytest.approx(3.0 - 0.4 + 0.25, abs=0.06)  # its face stays where it is


@pytest.mark.parametrize("seed", range(12))
def test_a_wall_lies_behind_its_visible_face(seed):
    rng = np.random.default_rng(seed)
    yaw, length = rng.uniform(60, 120), rng.uniform(1.6, 3.0)
    truth = Box("wall", np.array([rng.uniform(2.8, 3.5), rng.uniform(-0.3, 0.3), 1.5]), np.array([length, 0.2, 3]), yaw)
    seen = judged(wall(*truth.center[:2], length, 0.2, yaw))
    found = find_objects(seen, known=KnownBuilding(walls=(0.1, 0.2), usual_wall=0.2))
    box = only(found, "wall")
    assert len(match_boxes([box], [truth])) == 1
    off, turn = plane_distance(box, truth)
    assert off < 0.02 and turn < 2.0
    assert min(box.dimensions[:2]) == pytest.approx(0.2, abs=0.03)
    assert max(box.dimensions[:2]) == pytest.approx(length, abs=0.15)


@pytest.mark.parametrize("seed", range(12))
def test_a_wall_seen_from_both_sides_is_one_from_end_to_end(seed):
    """One camera sees one end of it, the other, from behind, the other end: both faces of a thin wall are near."""
    rng = np.random.default_rng(seed)
    length, thickness = rng.uniform(2.8, 3.8), rng.uniform(0.1, 0.3)
    before, after = (
        (-2.0, -length / 3, SENSOR[2], rng.uniform(-5, 5)),
        (2.0, length / 3, SENSOR[2], rng.uniform(175, 185)),
    )
    seen = judged(wall(0.0, 0.0, length, thickness, 90.0), poses=(before, after))
    (found,) = find_objects(seen)
    assert found.box.object_type == "wall" and found.measured[:2] == (True, True)
    np.testing.assert_allclose(found.box.center[:2], [0.0, 0.0], atol=0.06)
    np.testing.assert_allclose(sorted(found.box.dimensions[:2]), [thickness, length], atol=0.1)


@pytest.mark.parametrize("thickness", [0.1, 0.2, 0.3, 0.4])
def test_a_short_wall_seen_from_both_sides_is_as_thick_as_it_is(thickness):
    poses = ((-2.5, 0.1, SENSOR[2], 0.0), (2.5, -0.1, SENSOR[2], 180.0))
    (found,) = find_objects(judged(wall(0.0, 0.0, 1.1, thickness, 90.0), poses=poses), judge=says(0.02, 0.02, 0.96))
    np.testing.assert_allclose(sorted(found.box.dimensions[:2]), [thickness, 1.1], atol=0.1)
    assert found.measured[:2] == (True, True)


@pytest.mark.parametrize("stray", [[(3.19, 0.8, 1.4)], [(3.19, 0.8, 1.4), (3.21, 0.8, 1.2)]], ids=["one", "two"])
def test_points_that_hang_behind_the_end_of_a_wall_make_it_no_thicker(stray):
    seen = judged(wall(3.0, 1.6, 1.6, 0.12, 90.0))
    more = [np.append(one, np.full(len(stray), 0.9)) for one in (seen.pillar, seen.wall, seen.apart)]
    for one in (seen, Judged(np.append(seen.points, stray, axis=0), *more, *seen[4:7])):
        box = only(find_objects(one, judge=says(0.02, 0.02, 0.96)), "wall")
        assert min(box.dimensions[:2]) == pytest.approx(0.12, abs=0.03)


def test_walls_that_meet_are_two_and_a_wall_behind_a_pillar_is_one():
    corner = wall(3.5, 0.0, 3.0, 0.2, 90), wall(2.4, -1.0, 2.0, 0.2, 0)
    found = find_objects(judged(*corner))
    assert [one.box.object_type for one in found] == ["wall", "wall"]
    assert not set(found[0].members) & set(found[1].members)
    split = judged(wall(4.0, 0.0, 4.0, 0.2, 90), others=[pillar(2.0, 0.1, 0.5)])
    box = only(find_objects(split), "wall")
    assert max(box.dimensions[:2]) == pytest.approx(4.0, abs=0.2)


def test_two_walls_in_line_with_a_door_between_them_stay_two():
    found = find_objects(judged(wall(3.0, 1.3, 1.6, 0.2, 90), wall(3.0, -1.3, 1.6, 0.2, 90)))
    assert [one.box.object_type for one in found] == ["wall", "wall"]


def test_the_end_of_a_wall_is_not_a_pillar():
    """Of a face of 0.2 m alone, which might be a slender pillar's, the networks must say that it is rather a wall's."""
    truth = Box("wall", np.array([3.0, 0.0, 1.5]), np.array([2.5, 0.2, 3.0]), 0.0)
    seen = judged(wall(3.0, 0.0, 2.5, 0.2, 0))
    box = only(find_objects(seen._replace(pillar=np.minimum(seen.pillar, 0.5))), "wall")
    assert len(match_boxes([box], [truth])) == 1


@pytest.mark.parametrize("seed", range(12))
def test_a_slender_face_that_shows_alone_is_as_wide_as_all_rays_show(seed):
    """Its thinned points, one a voxel of 0.1 m, span as little as half of it."""
    rng = np.random.default_rng(seed)
    x, y, width = rng.uniform(0.7, 3.0), rng.uniform(-0.4, 0.4), rng.uniform(0.2, 0.28)
    seen = judged(pillar(x, y, width, np.degrees(np.arctan2(y, x))))  # squarely before the sensor
    as_pillar = only(find_objects(seen, judge=says(0.05, 0.9, 0.05)), "pillar")
    np.testing.assert_allclose(as_pillar.dimensions[:2], width, atol=0.05)
    np.testing.assert_allclose(as_pillar.center[:2], [x, y], atol=0.05)
    as_end = only(find_objects(seen, judge=says(0.05, 0.05, 0.9)), "wall")
    assert min(as_end.dimensions[:2]) == pytest.approx(width, abs=0.05)


@pytest.mark.parametrize("thickness", [0.28, 0.3])
def test_the_end_of_a_wall_stays_one_where_the_picture_ends_beside_it(thickness):
    """All rays show as much of it as a pillar has, its thinned points no more than a wall is thick."""
    beside = 1.02 * thickness / 2  # where the left edge of the picture is, 2 m away: next to the end
    yaw = float(np.degrees(np.arctan2(beside, 2.0))) - OAK_D_PRO_SMALL.horizontal_fov / 2
    scene = judged(wall(3.45, 0.0, 2.9, thickness, 0), poses=((*SENSOR, yaw),))
    box = only(find_objects(scene, judge=says(0.05, 0.05, 0.9)), "wall")
    np.testing.assert_allclose(box.center[:2], [3.0, 0.0], atol=0.1)  # 2 m of it, as walls usually have
    assert max(box.dimensions[:2]) == pytest.approx(2.0) and abs(box.rotation) < 6.0


def test_a_few_stray_rays_make_no_slender_face_wider():
    seen = judged(pillar(3.0, 0.0, 0.2))
    (rays,), sideways = seen.rays, np.array([[2.9, 0.12, 0.0], [2.9, -0.13, 0.0]])
    rows = [np.argmin(np.linalg.norm(rays.direction / rays.direction[:, :1] - one / 2.9, axis=1)) for one in sideways]
    distance = rays.distance.copy()
    distance[rows] = 2.9 / rays.direction[rows, 0]  # on the line of the face, beside it
    assert (distance[rows] < rays.distance[rows]).all()
    clean, strayed = (
        only(find_objects(seen._replace(rays=(one,)), judge=says(0.05, 0.9, 0.05)), "pillar")
        for one in (rays, rays._replace(distance=distance))
    )
    np.testing.assert_allclose(strayed.dimensions, clean.dimensions, atol=0.01)


def test_thinning_takes_no_more_than_a_voxel_off_either_end_of_a_lone_slender_face():
    """Cut to 0.1 m in the middle it grows by 0.1 m to either side, at one end of its 0.4 m by what is left there."""
    sight, looks, (seen,), _ = examine(judged(pillar(2.0, 0.0, 0.4)), ObjectSettings())
    face = seen.first.face
    np.testing.assert_allclose(face.length, 0.4, atol=0.11)

    def grown(at, length):
        cut = face._replace(center=np.array([1.8, at]), along=np.array([0.0, 1.0]), length=length)
        lone = seen._replace(pieces=(seen.first._replace(face=cut),))
        return lone, as_all_rays_show(sight, looks, lone, 0.05)

    np.testing.assert_allclose(grown(0.0, 0.1)[1].first.face.ends, [[1.8, -0.15], [1.8, 0.15]], atol=0.02)
    np.testing.assert_allclose(grown(0.12, 0.1)[1].first.face.ends, [[1.8, -0.03], [1.8, 0.2]], atol=0.02)
    wide, same = grown(0.0, 0.3)
    assert same is wide
    lone, _ = grown(0.0, 0.1)
    two = lone._replace(pieces=lone.pieces * 2)
    assert as_all_rays_show(sight, looks, two, 0.05) is two


@pytest.mark.parametrize("high", [1.0, 1.8, 2.2])
def test_what_ends_below_the_ceiling_is_furniture(high):
    for thing in (pillar(3.0, 0.3, 0.6, 30, high=high), wall(3.0, 0.0, 2.0, 0.4, 90, high=high)):
        assert find_objects(judged(thing)) == []
    assert len(find_objects(judged(pillar(3.0, 0.3, 0.6, 30), pillar(3.0, -1.2, 0.6, 30, high=high)))) == 1


def test_a_wall_scanned_from_both_sides_is_one_of_its_true_thickness():
    poses = ((*SENSOR, 0.0), (4.6, 0.0, 1.4, 180.0))
    truth = Box("wall", np.array([2.5, 0.0, 1.5]), np.array([2.0, 0.25, 3.0]), 90.0)
    box = only(find_objects(judged(wall(2.5, 0.0, 2.0, 0.25, 90), poses=poses)), "wall")
    assert plane_distance(box, truth)[0] < 0.03
    assert min(box.dimensions[:2]) == pytest.approx(0.25, abs=0.04)


def test_noise_of_two_centimetres_changes_little():
    box = only(find_objects(judged(pillar(3.0, 0.3, 0.7, 40), noise=0.02)), "pillar")
    np.testing.assert_allclose(box.center[:2], [3.0, 0.3], atol=0.1)


def test_unchanged_rooms_and_empty_clouds_have_no_objects():
    seen = judged(others=[pillar(3.0, 0.3, 0.7)])
    assert find_objects(seen) == []
    nothing = np.zeros(0)
    assert find_objects(Judged(np.zeros((0, 3)), nothing, nothing, nothing, np.zeros((1, 3)), 0.0, 3.0)) == []


@pytest.mark.parametrize("degrees", [33, 124, 215, 301])
def test_the_answer_is_the_same_in_any_order_of_points_and_moves_and_turns_with_the_room(degrees):
    seen = judged(pillar(3.0, 1.0, 0.6, 25), wall(3.6, -0.8, 2.0, 0.2, 80))
    plain = find_objects(seen)
    order = np.random.default_rng(1).permutation(len(seen.points))
    parts = {name: getattr(seen, name)[order] for name in ("points", "pillar", "wall", "apart", "scan")}
    shuffled = find_objects(seen._replace(**parts))
    assert [one.box.object_type for one in plain] == [one.box.object_type for one in shuffled]
    assert sorted(one.box.object_type for one in plain) == ["pillar", "wall"]
    for a, b in zip(plain, shuffled, strict=True):
        np.testing.assert_allclose(a.box.center, b.box.center, atol=1e-6)
        assert set(order[b.members]) == set(a.members)
    angle, shift = np.radians(degrees), np.array([120.0, -70.0, 4.0])
    turn = np.array([[np.cos(angle), np.sin(angle), 0], [-np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    rays = tuple(Rays(one.origin @ turn + shift, one.direction @ turn, one.distance) for one in seen.rays)
    moved = seen._replace(
        points=seen.points @ turn + shift, sensor=seen.sensor @ turn + shift, floor=FLOOR + 4.0, ceiling=CEILING + 4.0,
        rays=rays,
    )  # fmt: skip
    told, same = (examine(one, ObjectSettings()).clues for one in (seen, moved))
    ends = [number for number, name in enumerate(CLUES) if name.endswith(("_shift", "_before", "_missing"))]
    np.testing.assert_allclose(told[:, ends], same[:, ends], atol=0.1)
    for a, b in zip(plain, find_objects(moved), strict=True):
        np.testing.assert_allclose(a.box.center @ turn + shift, b.box.center, atol=0.06)
        np.testing.assert_allclose(a.box.dimensions, b.box.dimensions, atol=0.1)


def test_what_is_seen_to_a_small_height_only_is_less_sure():
    """Of a pillar from floor to ceiling, and of it below 1.2 m, near a wall, where it may be a cabinet."""
    seen = judged(pillar(3.0, 0.3, 0.7, 40))
    low = seen.points[:, 2] < 1.2
    parts = {name: getattr(seen, name)[low] for name in ("points", "pillar", "wall", "apart", "scan")}
    parts["apart"] = np.minimum(parts["apart"], 0.2)
    whole, cut = (only(find_objects(one), "pillar") for one in (seen, seen._replace(**parts)))
    assert cut.probability < whole.probability


def test_odds_go_down_as_changes_are_rarer():
    seen = judged(pillar(3.0, 0.3, 0.7, 40))
    seen = seen._replace(pillar=np.minimum(seen.pillar, 0.6), wall=np.minimum(seen.wall, 0.6))
    odds = []
    for rarer in (1.0, 4.0, 16.0):
        probability = only(find_objects(seen, ObjectSettings(rarer=rarer)), "pillar").probability
        odds.append(probability / (1.0 - probability))
    assert odds[0] == pytest.approx(4.0 * odds[1]) and odds[1] == pytest.approx(4.0 * odds[2])


def test_hardly_probable_points_that_continue_a_face_are_of_it():
    """Of a wall, the half that the networks doubt is found with the half that they do not."""
    truth = Box("wall", np.array([3.5, 0.0, 1.5]), np.array([3.0, 0.2, 3.0]), 90.0)
    seen = judged(wall(3.5, 0.0, 3.0, 0.2, 90))
    doubted = (seen.apart > 0.5) & (seen.points[:, 1] > 0.0)
    seen = seen._replace(**{name: np.where(doubted, 0.1, getattr(seen, name)) for name in ("pillar", "wall")})
    found = find_objects(seen)
    box = only(found, "wall")
    assert max(box.dimensions[:2]) == pytest.approx(3.0, abs=0.15) and plane_distance(box, truth)[0] < 0.1
    assert np.isin(np.flatnonzero(doubted), found[0].members).mean() > 0.9
    # What lies on the prior's surface is the prior's.
    onto = seen._replace(apart=np.where(doubted, 0.02, seen.apart))
    assert not np.isin(np.flatnonzero(doubted), find_objects(onto)[0].members).any()


def test_a_wall_is_one_of_which_one_sees_an_end_and_beyond_a_pillar_a_part_of_its_side():
    truth = Box("wall", np.array([3.1, 1.0, 1.5]), np.array([3.0, 0.2, 3.0]), 0.0)
    box = only(find_objects(judged(wall(3.1, 1.0, 3.0, 0.2, 0), others=[pillar(1.25, 0.48, 0.26)])), "wall")
    assert len(match_boxes([box], [truth])) == 1 and plane_distance(box, truth)[0] < 0.02
    assert sorted(box.dimensions[:2]) == pytest.approx([0.2, 3.0], abs=0.1)


@pytest.mark.parametrize("second", [pillar(3.5, -0.7, 0.4, 0, CYLINDER), pillar(3.5, -0.7, 0.26, 30)])
def test_two_pillars_in_line_behind_a_third_are_no_wall(second):
    found = find_objects(judged(pillar(3.5, 0.7, 0.4), second, others=[pillar(2.0, 0.0, 0.5)]))
    assert [one.box.object_type for one in found] == ["pillar", "pillar"]


def test_what_stands_half_a_metre_from_a_wall_in_its_line_is_not_of_it_if_one_looks_between_them():
    seen = judged(wall(3.0, -0.9, 2.0, 0.2, 90), pillar(3.05, 0.75, 0.4))
    assert sorted(one.box.object_type for one in find_objects(seen)) == ["pillar", "wall"]


def test_a_wall_whose_thickness_does_not_show_is_no_thicker_than_one_looks_past_it():
    """Its end is a single column of points, which tells no thickness, but rays pass close behind it."""
    known = KnownBuilding(walls=(0.1, 0.3), usual_wall=0.3)
    for real, least, most in ((0.09, 0.0, 0.12), (0.3, 0.2, 0.35)):
        box = only(find_objects(judged(wall(3.0, 0.5, 2.0, real, 40)), known=known), "wall")
        assert least <= min(box.dimensions[:2]) <= most


@pytest.mark.parametrize("low, high", [(0.0, 2.5), (0.0, 3.0), (0.45, 3.0)])
def test_what_is_higher_than_furniture_goes_as_far_up_and_down_as_one_sees(low, high):
    """A pillar that ends below the ceiling, one that does not, and one that hangs from it."""
    box = only(find_objects(judged(slab((3.0, 0.5), (0.2, 0.5), low, high, 20))), "pillar")
    assert box.center[2] - box.dimensions[2] / 2 == pytest.approx(low, abs=0.12)
    assert box.center[2] + box.dimensions[2] / 2 == pytest.approx(high, abs=0.12)
    assert box.center[:2] == pytest.approx([3.0, 0.2], abs=0.06)


def test_what_fills_a_wall_up_to_a_beam_ends_at_the_beam():
    """Below: new. Above, in the same plane: what was there before."""
    beam = slab((3.5, 0.2), (0.0, 3.0), 2.4, 3.0)
    box = only(find_objects(judged(slab((3.5, 0.2), (0.0, 3.0), 0.0, 2.4), others=(beam,))), "wall")
    assert box.center[2] + box.dimensions[2] / 2 == pytest.approx(2.4, abs=0.1)
