"""Where a scan was taken, told by what it sees: found where one place fits, refused with a list where several do."""

import re
from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from benchmarks.views.floor_plans import building_of_plans
from jaxmm.formats.poses import OPTICAL
from jaxmm.formats.readers import PointScan
from jaxmm.inputs import Misfit
from jaxmm.verdicts.panoramas import AZIMUTHS, fits_of, panorama_of, span_of_azimuth, upright_of
from jaxmm.verdicts.pose_search import search
from jaxmm.verdicts.priors import prior_of_building
from jaxmm.verdicts.searched_scans import searched_scan, to_own_frame
from tests.cases.box_building import building_of, shell_of
from warp_scanner.buildings.free_places import free_places
from warp_scanner.scenes.scenes import PILLAR, TABLE, WALL
from warp_scanner.sensors.scan import Rays
from warp_scanner.sensors.sensors import OAK_D_PRO_SMALL, OUSTER_64, TLS
from warp_scanner.sensors.triangles import cast_triangles

SPINNING, AROUND = OUSTER_64.resampled(512, 32), TLS.resampled(360, 120)
ROOM = shell_of(4.0, 3.0, 2.8)
INNER = (((1.2, 1.9, 1.4), (0.06, 1.1, 1.4), WALL), ((-2.4, -1.4, 1.4), (1.6, 0.06, 1.4), WALL))
COLUMN = (((-1.5, 1.7, 1.4), (0.2, 0.2, 1.4), PILLAR),)


@cache
def prior_of(seed, storeys=2, repeated=False):
    return prior_of_building(building_of_plans(seed, storeys, repeated))


def turned(*degrees):
    return Rotation.from_euler("ZYX", degrees, degrees=True).as_matrix()


def seen(prior, place, rotation, sensor=SPINNING, present=None):
    """Points (N, 3) in the sensor's frame."""
    direction = sensor.directions()
    world = (direction @ rotation.T).astype(np.float32)
    distance = cast_triangles(prior.scene, Rays(np.asarray(place)[None], world), present).distance[0]
    hit = np.isfinite(distance)
    return direction[hit].astype(float) * distance[hit, None]


def assert_there(place, position, rotation):
    np.testing.assert_allclose(place.position, position, atol=0.03)
    np.testing.assert_allclose(place.rotation, rotation, atol=0.01)


def assert_turned(degrees, expected):
    assert (degrees - expected + 180.0) % 360.0 - 180.0 == pytest.approx(0.0, abs=0.5)


def indoors(prior, storey, height):
    """Free places on one storey."""
    places = free_places(prior.building, prior.scene, (height,))
    return places[np.abs(places[:, 2] - prior.building.storeys.elevation[storey] - height) < 0.1]


@pytest.mark.long
@pytest.mark.parametrize(("seed", "sensor"), [(42, SPINNING), (43, AROUND), (46, SPINNING)])
def test_in_an_asymmetric_building_the_place_is_found(seed, sensor):
    """At any heading, tilted by a few degrees, on the upper of two storeys, with an inner wall gone."""
    prior = prior_of(seed)
    rng = np.random.default_rng(seed)
    there = indoors(prior, 1, 1.3)
    position = there[len(there) // 3] + rng.uniform(-0.1, 0.1, 3)
    rotation = turned(rng.uniform(-180.0, 180.0), *rng.uniform(-2.0, 2.0, 2))
    met = cast_triangles(prior.scene, Rays(position[None], sensor.directions())).element[0]
    count = np.bincount(met[met >= 0], minlength=len(prior.scene.triangles.semantic))
    count[prior.scene.triangles.semantic != WALL] = 0
    present = np.arange(len(count)) != np.argsort(count)[-3]
    found = search(prior, seen(prior, position, rotation, sensor, present))
    assert_there(found.place, position, rotation)
    assert found.tried > 2 * len(there) and found.elsewhere < found.place.fit


def places_named(message):
    return np.array(
        [[float(value) for value in one.split(",")] for one in re.findall(r"[-\d.]+(?:,[-\d.]+){3}", message)]
    )


def test_in_a_rectangular_room_both_headings_are_named():
    prior = prior_of_building(building_of(ROOM))._replace(origin=np.array([100.0, 0.0, 0.0]))
    position = np.array([1.3, -0.9, 1.2])
    with pytest.raises(Misfit, match="places look alike") as told:
        search(prior, seen(prior, position, turned(30.0, 0.0, 0.0)))
    assert "\n" not in str(told.value)
    named = places_named(str(told.value))
    for place in ((101.3, -0.9, 1.2, 30.0), (98.7, 0.9, 1.2, -150.0)):
        assert np.abs(named - place).max(axis=1).min() < 0.1


def test_storeys_that_repeat_are_named():
    prior = prior_of(44, 2, True)
    places = indoors(prior, 0, 1.3)
    position = places[len(places) // 5]
    with pytest.raises(Misfit, match="places look alike") as told:
        search(prior, seen(prior, position, np.eye(3)))
    heights = places_named(str(told.value))[:, 2]
    rise = prior.building.storeys.elevation[1]
    assert np.abs(heights - position[2]).min() < 0.05 and np.abs(np.abs(heights - position[2]) - rise).min() < 0.05


@pytest.mark.parametrize("taken", [(), (INNER[0],)], ids=["as it was", "the wall taken out"])
def test_what_one_wall_alone_tells_is_not_believed(taken):
    """In a room with one inner wall: a wall like it may have been put up where the turned room has none, and this one
    taken out."""
    prior = prior_of_building(building_of((*ROOM, INNER[0])))
    real = prior_of_building(building_of(ROOM if taken else (*ROOM, INNER[0])))
    with pytest.raises(Misfit, match="places look alike"):
        search(prior, seen(real, (-2.3, 0.6, 1.2), np.eye(3)))


@pytest.mark.parametrize("yaw", [-170.0, 95.0])
def test_inner_walls_tell_the_heading_whatever_stands_before_them(yaw):
    prior = prior_of_building(building_of((*ROOM, *INNER)))
    tables = (((2.6, -1.0, 0.4), (0.5, 0.8, 0.4), TABLE), ((-0.4, 1.2, 0.9), (0.3, 0.3, 0.9), TABLE))
    real = prior_of_building(building_of((*ROOM, *INNER, *COLUMN, *tables)))
    position, rotation = np.array([0.3, -0.4, 1.1]), turned(yaw, 1.0, -1.5)
    assert_there(search(prior, seen(real, position, rotation)).place, position, rotation)


@pytest.mark.long
def test_a_scan_of_another_building_is_refused():
    other = prior_of(43)
    places = indoors(other, 0, 1.2)
    with pytest.raises(Misfit, match="its pose was searched"):
        search(prior_of(42), seen(other, places[len(places) // 2], np.eye(3)))


def test_a_camera_is_too_narrow_and_points_of_many_places_are_none():
    prior = prior_of(42)
    place = indoors(prior, 0, 1.3)[40]
    with pytest.raises(Misfit, match=r"too narrow.*spans \d+ degrees of azimuth.*at least 150"):
        search(prior, seen(prior, place, np.eye(3), OAK_D_PRO_SMALL))
    apart = [seen(prior, place, np.eye(3)) + shift for shift in ((0.0, 0.0, 0.0), (9.0, 4.0, 0.0), (-6.0, 2.0, 0.0))]
    with pytest.raises(Misfit, match="lie behind others"):
        search(prior, np.concatenate(apart))


def test_free_places_stand_on_floors_and_away_from_walls():
    prior = prior_of_building(building_of((*ROOM, *INNER)))
    places = free_places(prior.building, prior.scene, (1.0, 1.5))
    indoors = places[places[:, 2] < 2.8]
    assert set(np.round(indoors[:, 2], 4)) == {1.0, 1.5}
    assert np.all(np.abs(indoors[:, :2]) <= (4.0 - 0.15, 3.0 - 0.15))
    assert len(indoors) == pytest.approx(2 * (7.7 * 5.7 - 2.3) / 0.25, rel=0.1)  # less what is beside the inner walls


def test_where_a_file_has_no_floors_the_elevations_of_its_storeys_count():
    walls = tuple(box for box in (*ROOM, *INNER) if box[2] == WALL)
    prior = prior_of_building(building_of(walls))
    places = free_places(prior.building, prior.scene, (1.1,))
    assert prior.building.storeys.elevation == pytest.approx([0.0]) and np.any(np.isclose(places[:, 2], 1.1))
    position, rotation = np.array([0.3, -0.4, 1.1]), turned(95.0, 0.0, 0.0)
    points = seen(prior_of_building(building_of((*ROOM, *INNER))), position, rotation)
    assert_there(search(prior, points).place, position, rotation)


def test_what_is_level_tells_what_is_up_and_how_high_the_sensor_stands():
    prior = prior_of_building(building_of((*ROOM, *INNER)))
    for height, pitch, roll in ((0.7, 3.0, -2.0), (1.1, -4.0, 4.0), (1.6, 0.0, 0.0)):
        rotation = turned(77.0, pitch, roll)
        found = upright_of(seen(prior, (0.0, 0.0, height), rotation, AROUND))
        assert found.floor_seen and found.heights == pytest.approx((height,), abs=0.02)
        np.testing.assert_allclose(found.rotation[2], rotation[2], atol=0.005)  # what is up, in the sensor's frame


def test_headings_are_those_of_one_turned_panorama():
    prior = prior_of_building(building_of((*ROOM, *INNER)))
    position = np.array([0.3, -0.4, 1.1])
    for turn in (0, 7, 50):
        yaw = 360.0 * turn / AZIMUTHS
        fits = fits_of(prior.scene, position[None], panorama_of(seen(prior, position, turned(yaw, 0.0, 0.0), AROUND)))
        assert fits.argmax() == turn and fits.max() > 0.95


def test_azimuths_span_all_but_their_widest_gap():
    for low, high in ((-40.0, 40.0), (100.0, 260.0), (-179.0, 180.0)):
        angle = np.radians(np.arange(low, high + 0.5, 1.0))
        points = np.column_stack([np.cos(angle), np.sin(angle), angle])
        assert span_of_azimuth(points) == pytest.approx(high - low)


def test_a_pose_in_the_file_says_only_where_its_zero_is():
    prior = prior_of_building(building_of((*ROOM, *INNER, *COLUMN)))
    position, rotation = np.array([0.3, -0.4, 1.1]), turned(50.0, 0.0, 0.0)
    own = seen(prior, position, rotation)
    believed, turn = np.array([500.0, 20.0, 3.0]), turned(-20.0, 0.0, 0.0)
    in_world = PointScan(own @ turn.T + believed, believed, turn, (), True)
    np.testing.assert_allclose(to_own_frame(in_world, "world").of(in_world.points), own, atol=1e-9)
    np.testing.assert_allclose(to_own_frame(PointScan(own, None, None, ()), "world").of(own), own)
    optical = np.column_stack([-own[:, 1], -own[:, 2], own[:, 0]])
    np.testing.assert_allclose(to_own_frame(PointScan(optical, None, None, ()), "optical").of(optical), own, atol=1e-9)
    ahead, lies = np.array([[1.0, 0.0, 0.0]], np.float32), PointScan(optical, None, None, ())
    nowhere = searched_scan(prior, lies._replace(unseen=ahead @ OPTICAL), "optical", None).unseen
    np.testing.assert_allclose(nowhere, ahead, atol=1e-6)
    found = searched_scan(prior, PointScan(own * 1000.0, None, None, ()), "world", None)
    assert found.source == "searched" and "millimetres" in found.notes[0]
    assert re.fullmatch(r"its pose was searched: \d+ places tried, it matches \d+% there and at most \d+% elsewhere",
                        found.notes[1])  # fmt: skip
    np.testing.assert_allclose(found.position, position, atol=0.03)
