"""The fast path for pinhole images says what the general ray kernel says, wherever the sensor stands and looks."""

import numpy as np
import pytest

from warp_scanner import draws
from warp_scanner.rooms.rooms import RoomConfig, make_rooms
from warp_scanner.rooms.standing import Standing, draw_poses
from warp_scanner.scenes.scenes import BOX, CYLINDER, GAP, Primitives, join, take
from warp_scanner.sensors.pinhole import cast_image, cast_image_slots
from warp_scanner.sensors.poses import Pose, rotation_of
from warp_scanner.sensors.scan import Rays, cast_rays, cast_slots
from warp_scanner.sensors.sensors import Pinhole

EDGE = 1e-4  # [rad] from an edge, rounding may decide either way


def rays_of(sensor, pose):
    return Rays(pose.position, sensor.directions(), rotation_of(pose.yaw, pose.pitch))


def soup(seed, rooms=64, slots=24):
    """Boxes and cylinders of any size, place and turn, and sensors among them, looking anywhere."""
    rng = np.random.default_rng(seed)
    kind = rng.choice([GAP, BOX, CYLINDER], (rooms, slots), p=[0.1, 0.5, 0.4]).astype(np.uint8)
    half_size = np.exp(rng.uniform(np.log(0.02), np.log(2.0), (rooms, slots, 3))).astype(np.float32)
    half_size[kind == CYLINDER, 1] = half_size[kind == CYLINDER, 0]
    primitives = Primitives(
        kind,
        rng.uniform(-5, 5, (rooms, slots, 3)).astype(np.float32),
        half_size,
        rng.uniform(-np.pi, np.pi, (rooms, slots)).astype(np.float32),
        rng.integers(0, 1000, (rooms, slots), dtype=np.int32),
        rng.integers(1, 8, (rooms, slots)).astype(np.uint8),
    )
    pose = Pose(
        rng.uniform(-5, 5, (rooms, 3)).astype(np.float32),
        rng.uniform(-180, 180, rooms).astype(np.float32),
        rng.uniform(-60, 60, rooms).astype(np.float32),
    )
    return primitives, pose


def furnished(count, seed=3):
    config, index = RoomConfig(), np.arange(count)
    primitives = make_rooms(config, seed, index)
    pose, found = draw_poses(primitives, config.size, Standing(), draws.keys(seed, index))
    rng = np.random.default_rng(seed)
    pose = pose._replace(pitch=rng.uniform(-15, 15, count).astype(np.float32))
    return take(primitives, found), Pose(*(field[found] for field in pose))


def assert_agrees(primitives, pose, sensor):
    """Same primitive and range in every pixel but those that see another surface within EDGE; returns their share."""
    distance, slot = cast_image_slots(primitives, None, sensor, pose)
    rays = rays_of(sensor, pose)
    expected, expected_slot = cast_slots(primitives, None, rays)
    same = (slot == expected_slot) & (np.isfinite(distance) == np.isfinite(expected))
    # A surface seen at a grazing angle moves far along the ray when the ray turns by its rounding.
    difference = np.abs(np.where(slot < 0, 0.0, distance) - np.where(expected_slot < 0, 0.0, expected))
    near_edge = ~same | (difference > 1e-4)
    explained = np.zeros_like(near_edge)
    room, pixel = np.nonzero(near_edge)
    forward = rays.direction[pixel].astype(np.float64)
    side = np.cross(forward, [0.3, 0.5, 0.8])
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    for angle in np.arange(0, 2 * np.pi, np.pi / 8):
        turned = forward + EDGE * (np.cos(angle) * side + np.sin(angle) * np.cross(forward, side))
        turned /= np.linalg.norm(turned, axis=1, keepdims=True)
        world = np.einsum("nij,nj->ni", rays.rotation[room], turned).astype(np.float32)
        beside, beside_slot = cast_slots(take(primitives, room), None, Rays(rays.origin[room], world[:, None]))
        explained[room, pixel] |= (beside_slot[:, 0] == slot[room, pixel]) & (
            (slot[room, pixel] != expected_slot[room, pixel])
            | (np.abs(beside[:, 0] - expected[room, pixel]) >= difference[room, pixel])
        )
    assert np.array_equal(explained, near_edge), f"{np.sum(near_edge & ~explained)} pixels differ away from any edge"
    return near_edge.mean()


@pytest.mark.parametrize("seed", range(6))
def test_any_solids_from_anywhere(seed):
    assert assert_agrees(*soup(seed), Pinhole(90, 61, 100.0, 70.0)) < 2e-3


def test_furnished_rooms():
    assert assert_agrees(*furnished(150), Pinhole(320, 200)) < 1e-5


def test_the_full_grid():
    assert assert_agrees(*furnished(4), Pinhole(1280, 800)) < 1e-5


@pytest.mark.parametrize("size", [(1, 1), (7, 3), (64, 16), (65, 17), (63, 15), (130, 2)])
def test_images_of_any_size(size):
    primitives, pose = soup(11, rooms=40)
    assert_agrees(primitives, pose, Pinhole(*size, 120.0, 110.0))


def one(kind, center=(0, 0, 0), half_size=(1, 1, 1), yaw=0.0):
    fields = (kind, center, half_size, yaw, 7, 3)
    dtypes = (np.uint8, np.float32, np.float32, np.float32, np.int32, np.uint8)
    return Primitives(*(np.array([[field]], dtype) for field, dtype in zip(fields, dtypes, strict=True)))


def at(x, y=0.0, z=0.0, yaw=0.0, pitch=0.0):
    return Pose(np.array([[x, y, z]], np.float32), np.array([yaw], np.float32), np.array([pitch], np.float32))


@pytest.mark.parametrize(
    "primitives, pose, expected",
    [
        pytest.param(one(BOX, (4, 0, 0)), at(0), 3.0, id="box ahead"),
        pytest.param(one(BOX, (-4, 0, 0)), at(0), np.inf, id="box behind"),
        pytest.param(
            one(BOX, (4, 0, 0)), at(0, z=1.0), 3.0, id="in the plane of the top: grazing, the face still counts"
        ),
        pytest.param(one(BOX, (4, 0, 0), yaw=np.pi / 4), at(0), 4 - np.sqrt(2), id="corner ahead"),
        pytest.param(one(BOX, (0.5, 0, 0)), at(0), 1.5, id="inside a box: the wall it leaves through"),
        pytest.param(one(CYLINDER, (4, 0, 0)), at(0), 3.0, id="cylinder ahead"),
        pytest.param(one(CYLINDER, (0.5, 0, 0)), at(0), 1.5, id="inside a cylinder"),
        pytest.param(one(CYLINDER, (0, 0, 0), (1, 1, 1)), at(0, 0, 3, pitch=-90), 2.0, id="above a cylinder"),
        pytest.param(one(BOX, (0, 0, 0)), at(0, 0, 3, pitch=-90), 2.0, id="above a box"),
        pytest.param(one(GAP), at(0), np.inf, id="nothing"),
    ],
)
def test_the_middle_pixel(primitives, pose, expected):
    scan = cast_image(primitives, None, Pinhole(31, 21), pose)
    middle = 10 * 31 + 15
    distance, element, semantic = (field[0, middle] for field in scan)
    if np.isinf(expected):
        assert np.isinf(scan.distance).all() and (scan.element == -1).all() and (scan.semantic == 0).all()
    else:
        assert distance == pytest.approx(expected, abs=1e-5) and element == 7 and semantic == 3


@pytest.mark.parametrize("kind", [BOX, CYLINDER])
def test_of_two_equal_surfaces_the_lower_slot_is_seen(kind):
    both = join(one(kind, (4, 0, 0)), one(kind, (4, 0, 0)))
    _, slot = cast_image_slots(both, None, Pinhole(64, 40), at(0))
    assert set(np.unique(slot)) == {-1, 0}


def test_a_sensor_in_a_face_sees_what_the_general_kernel_sees():
    """At the surface, a hair off it, and in line with it from afar, where rounding could put it on either side."""
    for x in (-1.0, -1.0 - 1e-7, -1.0 - 5e-7, -1.0 - 2e-6, -1.0 - 1e-4):
        for kind in (BOX, CYLINDER):
            sensor, primitives, pose = Pinhole(40, 30), one(kind), at(x)
            expected = cast_rays(primitives, None, rays_of(sensor, pose))
            found = cast_image(primitives, None, sensor, pose)
            assert np.array_equal(found.element, expected.element)
            np.testing.assert_allclose(found.distance, expected.distance, atol=1e-5)


def test_elements_and_classes_are_those_of_the_slot():
    primitives, pose = soup(5)
    sensor = Pinhole(80, 50)
    distance, slot = cast_image_slots(primitives, None, sensor, pose)
    scan = cast_image(primitives, None, sensor, pose)
    rows = np.arange(len(slot))[:, None]
    assert np.array_equal(scan.distance, distance)
    assert np.array_equal(scan.element, np.where(slot < 0, -1, primitives.element[rows, slot]))
    assert np.array_equal(scan.semantic, np.where(slot < 0, 0, primitives.semantic[rows, slot]))


def test_neither_threads_nor_other_rooms_nor_absent_primitives_matter():
    primitives, pose = soup(6)
    sensor = Pinhole(100, 60)
    present = np.random.default_rng(0).random(primitives.kind.shape) < 0.7
    whole = cast_image(primitives, present, sensor, pose, threads=1)
    for again in (cast_image(primitives, present, sensor, pose, threads=3),):
        assert all(np.array_equal(a, b) for a, b in zip(whole, again, strict=True))
    some = np.array([40, 3, 17])
    part = cast_image(take(primitives, some), present[some], sensor, Pose(*(field[some] for field in pose)))
    assert all(np.array_equal(a[some], b) for a, b in zip(whole, part, strict=True))
    without = primitives._replace(kind=np.where(present, primitives.kind, GAP))
    absent = cast_image(without, None, sensor, pose)
    assert all(np.array_equal(a, b) for a, b in zip(whole, absent, strict=True))


def test_no_rooms_give_no_images():
    primitives, pose = soup(0, rooms=2)
    none = np.zeros(0, int)
    scan = cast_image(take(primitives, none), None, Pinhole(8, 4), Pose(*(field[none] for field in pose)))
    assert scan.distance.shape == scan.element.shape == (0, 32)


def test_bad_input_is_named():
    primitives, pose = soup(0, rooms=2)
    sensor = Pinhole(8, 4)
    with pytest.raises(ValueError, match="present must be"):
        cast_image(primitives, np.ones((2, 3), bool), sensor, pose)
    with pytest.raises(ValueError, match=r"pose\.position must be"):
        cast_image(primitives, None, sensor, pose._replace(position=np.full((2, 3), np.nan)))
    with pytest.raises(ValueError, match=r"pose\.position must be"):
        cast_image(primitives, None, sensor, pose._replace(position=np.zeros((3, 3))))
