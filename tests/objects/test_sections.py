"""Sections as all rays show them: what is seen is measured, what is not lies between bounds, and heights vote."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from jaxmm.objects.face_finish import Rays
from jaxmm.objects.familiar_sizes import by_section
from jaxmm.objects.finder import ObjectSettings, find_objects
from jaxmm.objects.sections import NEAR, Section, _are_near, _Ways, sections_of
from jaxmm.objects.walls import KnownBuilding
from jaxmm.rays.scan_rays import PosedScan
from jaxmm.verdicts.detection import detect_scans
from jaxmm.verdicts.priors import prior_of_building
from tests.cases.box_building import building_of, shell_of
from tests.cases.exact_poses import AS_IS, named
from tests.cases.known_rooms import CEILING, FLOOR, i_section, judged, pillar, says, slab, wall
from warp_scanner.scenes.scenes import CYLINDER, PILLAR
from warp_scanner.sensors.poses import rotation_of
from warp_scanner.sensors.scan import Rays as Casts
from warp_scanner.sensors.sensors import OUSTER_64
from warp_scanner.sensors.triangles import cast_triangles, prepare


def shown(*things, noise=0.0):
    """The section of all that is new, and its points."""
    seen = judged(*things, noise=noise)
    points = seen.points[seen.apart > 0.5]
    (found,) = sections_of(seen.rays, [points])
    return found


def along_edges(section, yaw):
    """The section with its first edge at an angle [deg], and how far [deg] it is turned from that."""
    turn = np.degrees(np.arctan2(*section.along[::-1])) - yaw
    if abs((turn + 90.0) % 180.0 - 90.0) > 45.0:
        section, turn = section.turned, turn + 90.0
    return section, (turn + 45.0) % 90.0 - 45.0


@pytest.mark.parametrize("seed", range(20))
def test_the_true_edges_lie_between_what_is_seen_and_what_rays_allow(seed):
    """And the section is where, and turned as, what is seen of it says."""
    rng = np.random.default_rng(seed)
    x, y, yaw = rng.uniform(1.5, 4.2), rng.uniform(-0.8, 0.8), rng.uniform(-90.0, 90.0)
    size = rng.uniform(0.2, 0.6, 2)
    section, turn = along_edges(shown(slab((x, size[0]), (y, size[1]), FLOOR, CEILING, yaw)), yaw)
    assert abs(turn) < 0.3
    assert np.all(section.edges <= size + 0.003) and np.all(section.most >= size - 0.003)
    assert section.known.any()
    np.testing.assert_allclose(
        (section.edges + section.room.sum(axis=1) / 2)[section.known], size[section.known], atol=0.035
    )
    if section.known.all():
        np.testing.assert_allclose(section.center, [x, y], atol=0.035)


@pytest.mark.parametrize("seed", range(6))
def test_all_rays_that_pass_near_a_place_are_looked_at(seed):
    rng = np.random.default_rng(seed)
    direction = rng.normal(size=(5000, 3)).astype(np.float32)
    rays = Rays(rng.uniform(-3.0, 3.0, 3), direction, np.ones(5000, np.float32))
    middle, around = rng.uniform(-5.0, 5.0, 2), rng.uniform(0.2, 1.0)
    offset, level = middle - rays.origin[:2], direction[:, :2].astype(np.float64)
    beside = np.abs(offset[0] * level[:, 1] - offset[1] * level[:, 0])
    passes = (level @ offset > 0.0) & (beside <= around * np.linalg.norm(level, axis=1))
    found = _Ways(rays).toward(middle, around)
    assert np.all(np.diff(found) > 0) and np.isin(np.flatnonzero(passes), found).all()
    assert len(found) < 1.2 * passes.sum() + 50 or np.hypot(*offset) < around


@pytest.mark.parametrize("seed", range(5))
def test_what_is_near_a_thing_is_told_as_by_asking_for_the_nearest_of_its_points(seed):
    rng = np.random.default_rng(seed)
    points = rng.uniform(-0.8, 0.8, (rng.integers(1, 60), 2)) + rng.uniform(-50.0, 50.0, 2)
    places = points[rng.integers(0, len(points), 20_000)] + rng.normal(size=(20_000, 2)) * rng.choice([0.1, 5.0])
    near = cKDTree(points).query(places, distance_upper_bound=NEAR)[0] <= NEAR
    assert near.any() and not near.all()
    np.testing.assert_array_equal(_are_near(places, points), near)


def test_of_a_face_seen_straight_on_no_depth_is_known():
    section, _ = along_edges(shown(pillar(3.0, 0.0, 0.5)), 0.0)
    assert section.known.tolist() == [False, True]
    assert section.edges[0] < 0.01 and section.room[0, 0] < 0.01 and np.isinf(section.room[0, 1])


def test_rays_that_pass_behind_a_face_bound_the_depth():
    section, _ = along_edges(shown(pillar(3.0, 0.6, 0.3)), 0.0)
    assert section.most[0] < 0.45
    beside, _ = along_edges(shown(wall(3.6, 0.6, 1.5, 0.3, 0.0)), 0.0)  # its end is where the pillar's face is
    assert beside is None or beside.most[0] > 1.4


@pytest.mark.parametrize("noise", [0.005, 0.01])
def test_noise_does_not_make_it_larger(noise):
    section, turn = along_edges(shown(pillar(2.0, 0.2, 0.4, 30.0), noise=noise), 30.0)
    assert abs(turn) < 2.0
    np.testing.assert_allclose(section.edges, 0.4, atol=0.04)


@pytest.mark.parametrize("wider", [(2.5, CEILING), (FLOOR, 0.5), (1.8, 2.1)])
def test_what_is_flush_with_it_is_at_too_few_heights_to_count(wider):
    plain, _ = along_edges(shown(pillar(3.0, 0.3, 0.4, 20.0)), 20.0)
    with_more, _ = along_edges(shown(pillar(3.0, 0.3, 0.4, 20.0), slab((3.0, 0.4), (0.3, 0.55), *wider, 20.0)), 20.0)
    np.testing.assert_allclose(with_more.edges, plain.edges, atol=0.02)


def test_a_round_shaft_and_what_is_too_wide_for_a_column_have_none():
    assert shown(pillar(3.0, 0.3, 0.5, kind=CYLINDER)) is None
    assert shown(wall(3.0, 0.0, 2.5, 0.2, 90.0)) is None


def test_one_flange_is_no_section_of_a_column():
    """Rays pass right behind the flange, between it and the other one."""
    (found,) = find_objects(judged(*i_section(3.2, -0.5, 0.3, 100.0)), judge=says(0.02, 0.96, 0.02))
    assert found.box.dimensions[:2].min() > 0.25


@pytest.mark.parametrize("yaw", [10.0, 45.0, 70.0])
def test_what_is_seen_to_be_shorter_than_walls_is_a_pillar_whatever_the_judge_says(yaw):
    seen, unsure = judged(pillar(2.5, 0.2, 0.35, yaw)), says(0.02, 0.03, 0.95)
    (found,) = find_objects(seen, judge=unsure)
    assert found.box.object_type == "pillar"
    np.testing.assert_allclose(found.box.dimensions[:2], 0.35, atol=0.03)
    short = KnownBuilding(short_walls=((0.35, 0.35),))
    assert [one.box.object_type for one in find_objects(seen, judge=unsure, known=short)] == ["wall"]


def test_only_what_cannot_be_a_wall_moves_the_odds():
    share, settings, edges = np.array([0.1, 0.2, 0.7]), ObjectSettings(), np.array([0.3, 0.3])

    def odds(room, known=None):
        section = Section(np.zeros(2), np.array([1.0, 0.0]), edges, np.array([[0.0, room], [0.0, 0.0]]))
        return by_section(share, section, known or KnownBuilding(), settings)

    assert odds(0.2)[1] > 0.8 and odds(0.2)[0] == share[0]
    assert np.array_equal(odds(np.inf), share) and np.array_equal(odds(1.0), share)
    assert np.array_equal(odds(0.2, KnownBuilding(short_walls=((0.3, 0.45),))), share)
    assert np.array_equal(by_section(share, None, KnownBuilding(), settings), share)


HALF = 0.15
HEADINGS = (
    1,
    3,
    6,
    13,
    20,
)  # 28ths of a turn: few rays end on the side that is seen at 1.4 degrees, and none elsewhere


@pytest.mark.long
@pytest.mark.parametrize("heading", HEADINGS)
def test_a_pillar_of_which_one_side_is_seen_at_a_slant_is_found_at_every_heading(judges, heading):
    room = (*shell_of(4.0, 3.0, 3.0), ((-2.0, 1.2, 1.5), (HALF, HALF, 1.5), PILLAR))
    new, place = ((-1.0, -1.8, 1.5), (HALF, HALF, 1.5), PILLAR), np.array([-3.0, -2.0, 1.5])
    rotation = rotation_of(np.array([360.0 / 28 * heading]), np.zeros(1))[0]
    direction = (OUSTER_64.directions() @ rotation.T).astype(np.float32)
    distance = cast_triangles(prepare(building_of((*room, new)).triangles), Casts(place[None], direction)).distance[0]
    scan = PosedScan((place + direction * distance[:, None]).astype(np.float32), place, rotation, OUSTER_64)
    (found,) = detect_scans(prior_of_building(building_of(room)), [named(scan)], judges, AS_IS).mismatches
    assert (found.object_type, found.mismatch_type) == ("pillar", "added")
    np.testing.assert_allclose(found.center[:2], [-1.0, -1.8], atol=0.02)
    np.testing.assert_allclose(found.dimensions, [0.3, 0.3, 3.0], atol=0.02)
