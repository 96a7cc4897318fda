"""The next view: free, near, and its sensor does show the element from there."""

import dataclasses

import numpy as np
import pytest

from jaxmm.rays.scan_rays import PosedScan, rays_of_scan
from jaxmm.verdicts import next_view
from jaxmm.verdicts.next_view import GAP, REACH, Stage, Stand, next_views, stand_of
from tests.cases.box_building import building_of
from warp_scanner.buildings.positions import element_around
from warp_scanner.clouds.sightlines import cells_of
from warp_scanner.scenes.scenes import CEILING, FLOOR, PILLAR, WALL
from warp_scanner.sensors.poses import rotation_of
from warp_scanner.sensors.scan import Rays
from warp_scanner.sensors.sensors import OAK_D_PRO_SMALL, TLS, VELODYNE_16, Pinhole
from warp_scanner.sensors.triangles import cast_triangles, clearance, prepare

SENSOR = np.array([-3.0, 0.0, 1.2])
ANY = (0.05, 100.0)
FIRST = (Stand(SENSOR, 0.0, ANY),)
NOTHING = np.zeros((0, 3), np.float32)
HALL = (((0, 0, -0.05), (5, 3, 0.05), FLOOR), ((0, 0, 3.05), (5, 3, 0.05), CEILING))
HIDDEN = ((3, 0, 1.5), (0.3, 0.3, 1.5), PILLAR)
SCREEN = ((0, 0, 1.5), (0.1, 1.5, 1.5), WALL)


def stage(boxes=(*HALL, HIDDEN, SCREEN), stands=FIRST, obstacles=NOTHING):
    """A hall of 10 x 6 x 3 m; a pillar (element 2) stands behind a wall (element 3) as seen from the sensor."""
    building = building_of(boxes)
    return Stage(building, prepare(building.triangles), obstacles, stands)


def moved(boxes, offset):
    return [(tuple(np.add(center, offset)), half, semantic) for center, half, semantic in boxes]


def rays_on(one, element, view, sensor):
    """How many rays of a sensor in the proposed pose end on an element: what the next scan will show."""
    place, yaw, pitch = view
    direction = (sensor.directions() @ rotation_of([yaw], [pitch])[0].T).astype(np.float32)
    scan = cast_triangles(one.scene, Rays(place[None], direction))
    within = (scan.distance >= sensor.range_limits[0]) & (scan.distance <= sensor.range_limits[1])
    return int(((scan.element == element) & within).sum())


def shown(one, place, target):
    """Share of level rays towards the pillar that meet it."""
    toward = np.array(target) + np.linspace(-0.25, 0.25, 11)[:, None] * [0, 1, 0] - place
    direction = (toward / np.linalg.norm(toward, axis=1, keepdims=True)).astype(np.float32)
    return np.mean(cast_triangles(one.scene, Rays(place[None], direction)).element == 2)


def test_it_is_the_nearest_free_place_that_shows_the_element():
    one = stage()
    ((place, yaw, pitch),) = next_views(one, np.array([2]))
    assert clearance(one.scene, place[None], 5.0)[0] >= GAP and element_around(one.building, place) < 0
    assert place[2] == pytest.approx(1.2, abs=0.01) and shown(one, place, (3, 0, 1.2)) > 0.2
    toward = np.array([3.0, 0.0]) - place[:2]
    assert abs((yaw - np.degrees(np.arctan2(*toward[::-1])) + 180) % 360 - 180) < 15 and abs(pitch) < 30
    assert shown(one, SENSOR, (3, 0, 1.2)) == 0.0
    assert 0.5 < np.linalg.norm(place - SENSOR) < 5.0


def test_where_nothing_hides_it_it_is_the_sensors_own_place():
    ((place, yaw, _),) = next_views(stage((*HALL, HIDDEN)), np.array([2]))
    np.testing.assert_allclose(place, SENSOR, atol=0.02)
    assert abs(yaw) < 5


def test_what_the_robot_saw_standing_around_hides_as_well():
    y, z = np.meshgrid(np.arange(-1.5, 1.5, 0.08), np.arange(0.0, 3.0, 0.08))
    screen = np.column_stack([np.zeros(y.size), y.ravel(), z.ravel()]).astype(np.float32)
    ((place, _, _),) = next_views(stage((*HALL, HIDDEN), obstacles=screen), np.array([2]))
    assert np.linalg.norm(place - SENSOR) > 0.5


def test_an_element_that_can_be_seen_from_nowhere_gets_none():
    angle = np.linspace(0, 2 * np.pi, 120)
    ring = [
        np.column_stack([3 + 0.7 * np.cos(angle), 0.7 * np.sin(angle), np.full(120, z)]) for z in np.arange(0, 3, 0.08)
    ]
    closed = np.concatenate(ring).astype(np.float32)
    assert next_views(stage(obstacles=closed), np.array([2])) == [None]
    assert next_views(stage(), np.array([], int)) == []


@pytest.mark.parametrize(
    "boxes",
    [
        pytest.param((HIDDEN, SCREEN), id="no floor and no ceiling"),
        pytest.param((HIDDEN, SCREEN, HALL[1]), id="no floor"),
        pytest.param((HIDDEN, SCREEN, ((0, 40, -0.05), (5, 3, 0.05), FLOOR)), id="a floor somewhere else"),
    ],
)
def test_where_the_building_has_no_floor_places_stand_on_the_scans_own(boxes):
    """The same place as in the hall, which differs by nothing but its floor and ceiling."""
    ((place, yaw, pitch),) = next_views(stage(boxes), np.array([0]))
    assert place[2] == pytest.approx(SENSOR[2]) and shown(stage(), place, (3, 0, 1.2)) > 0.2
    ((same, *turned),) = next_views(stage(), np.array([2]))
    np.testing.assert_allclose(place, same, atol=1e-6)
    np.testing.assert_allclose((yaw, pitch), turned, atol=8.0)  # points are drawn by the element's number


def test_a_hole_in_the_floor_is_no_place():
    """A building with a floor is asked for one: in half the hall there is none, so nobody stands there."""
    half = ((-2.5, 0, -0.05), (2.5, 3, 0.05), FLOOR)
    long = ((0, 0, 1.5), (0.1, 2.9, 1.5), WALL)  # from wall to wall: it can only be seen from beyond
    assert next_views(stage((half, HALL[1], HIDDEN, long)), np.array([2])) == [None]
    ((place, _, _),) = next_views(stage((*HALL, HIDDEN, long)), np.array([2]))
    assert place[0] > 0.0


def test_on_a_storey_without_a_slab_places_stand_at_the_sensors_height():
    """The same place as in the hall, 3.4 m above the only floor."""
    up = np.array([0.0, 0.0, 3.4])
    open_storey = (HALL[0], *moved((HALL[1], HIDDEN, SCREEN), up))
    ((place, _, _),) = next_views(stage(open_storey, (Stand(SENSOR + up, 3.4, ANY),)), np.array([2]))
    ((same, _, _),) = next_views(stage(), np.array([2]))
    np.testing.assert_allclose(place, same + up, atol=1e-5)


def test_nobody_stands_on_a_platform_whether_there_is_a_floor_or_not():
    long, platform = ((0, 0, 1.5), (0.1, 20.0, 1.5), WALL), ((10.5, 0, 0.375), (10.0, 20.0, 0.375), FLOOR)
    ((place, _, _),) = next_views(stage((HIDDEN, long)), np.array([0]))
    assert place[0] > 0.0
    assert next_views(stage((HIDDEN, long, platform)), np.array([0])) == [None]
    assert next_views(stage((HIDDEN, long, platform, HALL[0])), np.array([0])) == [None]


def test_a_floor_that_rises_lifts_the_place_with_it():
    step = ((2.5, 0, 0.1), (2.5, 3, 0.1), FLOOR)
    long = ((0, 0, 1.5), (0.1, 2.9, 1.5), WALL)
    ((place, _, _),) = next_views(stage((*HALL, HIDDEN, long, step)), np.array([2]))
    assert place[0] > 0.0 and place[2] == pytest.approx(1.4, abs=0.01)


def test_two_storeys_with_a_scan_each_have_places_on_both():
    """Each storey's pillar is shown from that storey, at its sensor's height, in whatever order the scans come."""
    hall, up = (*HALL, HIDDEN, SCREEN), np.array([0.0, 0.0, 3.3])
    boxes = (*hall, *moved(hall, up))
    ((alone, _, _),) = next_views(stage(boxes, FIRST), np.array([2]))
    stands = (*FIRST, Stand(alone + up + [0.0, 0.0, 0.4], 3.3, ANY))  # right above what is to be found below
    below, above = next_views(stage(boxes, stands), np.array([2, 6]))
    assert below[0][2] == pytest.approx(1.2, abs=0.01) and above[0][2] == pytest.approx(4.9, abs=0.01)
    np.testing.assert_array_equal(below[0], alone)
    assert next_views(stage(boxes, FIRST), np.array([6])) == [None]
    for one, again in zip((below, above), next_views(stage(boxes, stands[::-1]), np.array([2, 6])), strict=True):
        np.testing.assert_array_equal(one[0], again[0])


def test_the_nearest_scan_counts_and_the_place_is_near_the_element():
    """A second hall 30 m away: its pillar is shown from beside the scan there, and by the first scan alone from near
    the pillar, not from near the sensor."""
    hall, away = (*HALL, HIDDEN, SCREEN), np.array([30.0, 0.0, 0.0])
    boxes, both = (*hall, *moved(hall, away)), (Stand(SENSOR, 0.0, ANY), Stand(SENSOR + away, 0.0, ANY))
    here, there = next_views(stage(boxes, both), np.array([2, 6]))
    np.testing.assert_allclose(there[0], here[0] + away, atol=1e-5)
    ((alone, _, _),) = next_views(stage(boxes, both[:1]), np.array([6]))
    assert np.linalg.norm((alone - away)[:2] - [3.0, 0.0]) <= REACH + 0.5
    twice = next_views(stage(boxes, (both[0], both[0], both[1])), np.array([2, 6]))
    np.testing.assert_array_equal([one[0] for one in twice], [here[0], there[0]])


def test_scans_of_one_room_share_its_places():
    """Two of one floor have no more places than one, for each belongs to the nearest; one of another floor its own."""
    second, corners = Stand(np.add(SENSOR, (1.0, 2.0, 0.0)), 0.0, ANY), (np.full(3, -20.0), np.full(3, 20.0))
    _, alone = next_view._free_places(stage(), *corners)
    places, stand = next_view._free_places(stage(stands=(*FIRST, second, *FIRST)), *corners)
    assert len(alone) > 50 and len(stand) < 1.2 * len(alone) and set(stand) == {0, 1}
    apart = np.linalg.norm(places[:, None] - [SENSOR, second.position], axis=2)
    np.testing.assert_array_equal(apart.argmin(axis=1), stand)
    assert (np.diff(apart.min(axis=1)) >= -1e-9).all()


@pytest.mark.parametrize("far", [2.0, 3.0, 4.5])
def test_the_element_lies_within_the_sensors_range(far):
    ((place, _, _),) = next_views(stage(stands=(Stand(SENSOR, 0.0, (0.05, far)),)), np.array([2]))
    ((unlimited, _, _),) = next_views(stage(), np.array([2]))
    surface = clearance(prepare(building_of((HIDDEN,)).triangles), place[None], 20.0)[0]
    assert surface <= far and np.linalg.norm(place - SENSOR) >= np.linalg.norm(unlimited - SENSOR)


def test_what_no_place_has_within_range_gets_none():
    for reach in ((0.05, 0.3), (12.0, 100.0)):
        assert next_views(stage(stands=(Stand(SENSOR, 0.0, reach),)), np.array([2])) == [None]


WIDE_WALL = ((4.0, 0.0, 1.5), (0.1, 2.9, 1.5), WALL)


def test_a_camera_has_the_element_in_its_view():
    """The narrower it is, the farther it goes to have a wide wall in view; and its own rays, cast, meet that wall."""
    here, gone = np.array([2.5, 0.0, 1.2]), []
    boxes = (*HALL, WIDE_WALL, ((-0.5, 0, 1.5), (0.1, 1.5, 1.5), WALL))
    for field in (60.0, 40.0, 25.0):
        sensor = Pinhole(160, 160, field, field, (0.2, 20.0))
        one = stage(boxes, (Stand(here, 0.0, sensor.range_limits, sensor),))
        (view,) = next_views(one, np.array([2]))
        assert rays_on(one, 2, view, sensor) >= 0.5 * 160 * 160
        gone.append(np.linalg.norm(view[0] - here))
        swapped = [(np.take(center, (1, 0, 2)), np.take(half, (1, 0, 2)), kind) for center, half, kind in boxes]
        one = stage(swapped, (Stand(here[[1, 0, 2]], 0.0, sensor.range_limits, sensor),))
        (view,) = next_views(one, np.array([2]))
        assert rays_on(one, 2, view, sensor) >= 0.5 * 160 * 160 and view[1] > 45.0
    assert gone[0] < gone[1] < gone[2]
    ((place, _, _),) = next_views(stage(boxes, (Stand(here, 0.0, ANY),)), np.array([2]))
    np.testing.assert_allclose(place, here, atol=0.02)  # any sensor sees as much as stands before it


def test_nobody_looks_along_a_wall():
    """From 1 m before a lane of 8.5 m, its walls 0.4 m aside, one sees a fifth of them at more than 9 degrees."""
    lane = [((0.75, y, 1.5), (4.25, 0.05, 1.5), WALL) for y in (-0.45, 0.45)]
    one = stage((*HALL, *lane), (Stand(np.array([-4.5, 0.0, 1.2]), 0.0, ANY),))
    ((place, _, _),) = next_views(one, np.array([2]))
    assert place[0] >= -4.0 or abs(place[1]) > 0.85  # where the lane begins, or well beside it


def test_a_camera_faces_what_is_above_it_and_a_spinning_scanner_stands_level():
    beam = ((3.0, 0.0, 2.6), (0.3, 0.3, 0.4), PILLAR)
    boxes = (*HALL, beam, SCREEN)
    camera, spinner = OAK_D_PRO_SMALL, VELODYNE_16
    stands = [Stand(SENSOR, 0.0, sensor.range_limits, sensor) for sensor in (camera, spinner)]
    looked, level = (next_views(stage(boxes, (stand,)), np.array([2]))[0] for stand in stands)
    assert looked[2] > 10.0 and level[2] == 0.0
    # One row of 16 looks up to 15 degrees: it stands where the beam is no higher than that.
    away = np.linalg.norm(level[0][:2] - [3.0, 0.0])
    assert np.arctan2(2.2 - 1.2, away + 0.45) < np.radians(16.0)
    for view, sensor in ((looked, camera), (level, spinner)):
        assert rays_on(stage(boxes), 2, view, sensor) >= 20


def test_a_sensor_of_unknown_range_reaches_as_far_as_it_did():
    points = np.array([[1.0, 0.0, 1.0], [0.0, 4.0, 1.0]], np.float32)
    scan = PosedScan(points, np.array([0.0, 0.0, 1.0]), np.eye(3))
    own = stand_of(scan, rays_of_scan(scan), 0.1)
    assert own.reach[1] == pytest.approx(4.0) and own.floor == 0.1 and own.sensor is None
    camera = dataclasses.replace(OAK_D_PRO_SMALL, range_limits=(0.2, 34.4))
    known = stand_of(scan._replace(sensor=camera), rays_of_scan(scan._replace(sensor=camera)), 0.1)
    assert known.reach == (0.2, 34.4) and known.sensor == camera


def test_a_large_building_is_not_asked_triangle_by_triangle_for_every_place(monkeypatch):
    """Of 3000 boxes only those around a place are asked whether it is inside, and the answer is that of all."""
    rng = np.random.default_rng(4)
    centers = np.column_stack([rng.uniform(-4.8, 4.8, 3000), rng.uniform(-2.8, 2.8, 3000), np.full(3000, 1.2)])
    boxes = [*HALL, HIDDEN, *((tuple(center), (0.02, 0.02, 0.6), PILLAR) for center in centers[:2990])]
    boxes += [((-3.0, y, 1.2), (0.5, 0.5, 0.5), PILLAR) for y in (-1.5, 1.5)]
    building, asked = building_of(boxes), []
    places = np.column_stack([rng.uniform(-5, 5, 60), rng.uniform(-3, 3, 60), np.full(60, 1.2)])
    places[:8] = places[:8] * [0.0, 0.1, 1.0] + [-3.0, 1.5, 0.0]
    expected = [element_around(building, place) < 0 for place in places]

    def counted(few, place):
        asked.append(len(few.triangles.faces))
        return element_around(few, place)

    monkeypatch.setattr(next_view, "element_around", counted)
    np.testing.assert_array_equal(next_view._outside_all(building, places), expected)
    assert 8 <= expected.count(False) < len(places)
    assert sum(asked) < 0.01 * len(building.triangles.faces) * len(places)


def test_a_place_that_a_scan_has_looked_from_in_vain_shows_nothing_new():
    """What looks around saw all of the wall's face: only one much nearer by, or one behind it, tells more. A camera
    that looked the other way did not see it, and may turn."""
    everywhere = TLS.directions()[::7]
    boxes = (*HALL, ((3, 0, 1.5), (0.05, 1.2, 1.5), WALL))
    around, ahead = (
        Stand(SENSOR, 0.0, ANY, None, np.unique(cells_of(way.astype(np.float32), 0.05)[0]), 0.05)
        for way in (everywhere, everywhere[everywhere[:, 0] < -0.5])
    )
    ((place, _, _),) = next_views(stage(boxes, (around,)), np.array([2]))
    assert place[0] > 3.05 or np.linalg.norm(place[:2] - [3, 0]) < 6.0 / next_view.CLOSER + 0.3
    ((same, _, _),) = next_views(stage(boxes, (ahead,)), np.array([2]))
    np.testing.assert_allclose(same, SENSOR, atol=0.02)
    every = tuple(around._replace(position=np.array([x, y, 1.2])) for x in (2.4, 3.6) for y in (-1.0, 0.0, 1.0))
    assert next_views(stage(boxes, every), np.array([2])) == [None]


def test_what_a_scan_looked_along_is_told_by_its_pattern():
    sensor = OAK_D_PRO_SMALL
    points = (SENSOR + sensor.directions() * 2.0).astype(np.float32)
    scan = PosedScan(points, SENSOR, np.eye(3), sensor)
    own = stand_of(scan, rays_of_scan(scan), 0.0)
    ways = np.array([[5.0, 0.0, 0.0], [5.0, 1.0, 0.5], [-5.0, 0.0, 0.0], [0.0, 3.0, 0.0]])
    assert own.has_looked(ways).tolist() == [True, True, False, False]
