"""Directions, rotations, poses and noise of the sensors."""

import numpy as np
import pytest
from scipy import stats

from warp_scanner import draws
from warp_scanner.rooms import RoomConfig, make_rooms
from warp_scanner.scenes import BOX, CEILING, CYLINDER, FLOOR, GAP
from warp_scanner.sensors import OAK_D_PRO, OAK_D_PRO_SMALL, Pinhole, Standing, add_range_noise, draw_poses, rotation_of


@pytest.mark.parametrize("sensor", [OAK_D_PRO, OAK_D_PRO_SMALL, Pinhole(1, 1), Pinhole(3, 2, 120.0, 30.0)])
def test_directions_are_unit_vectors_inside_the_field_of_view(sensor):
    directions = sensor.directions()
    assert directions.shape == (sensor.width * sensor.height, 3) and directions.dtype == np.float32
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1.0, atol=1e-6)
    image = (directions / directions[:, :1]).reshape(sensor.height, sensor.width, 3)
    # Pixel centres lie half a pixel inside the edges of the field of view.
    edge = np.tan(np.radians(sensor.horizontal_fov) / 2) * (1 - 1 / sensor.width)
    np.testing.assert_allclose(image[:, [0, -1], 1], np.tile([edge, -edge], (sensor.height, 1)), atol=1e-5)
    edge = np.tan(np.radians(sensor.vertical_fov) / 2) * (1 - 1 / sensor.height)
    np.testing.assert_allclose(image[[0, -1], :, 2], np.tile([[edge], [-edge]], (1, sensor.width)), atol=1e-5)


@pytest.mark.parametrize(
    "yaw, pitch, vector, expected",
    [
        pytest.param(0, 0, [1, 2, 3], [1, 2, 3], id="level and straight ahead changes nothing"),
        pytest.param(90, 0, [1, 0, 0], [0, 1, 0], id="yaw turns counter-clockwise"),
        pytest.param(0, 90, [1, 0, 0], [0, 0, 1], id="pitch looks up"),
        pytest.param(90, 90, [0, 0, 1], [0, -1, 0], id="looking up, the top of the sensor leans back"),
        pytest.param(37, 20, [0, 1, 0], [-np.sin(np.radians(37)), np.cos(np.radians(37)), 0], id="left stays level"),
    ],
)
def test_rotation(yaw, pitch, vector, expected):
    rotation = rotation_of(np.array([yaw]), np.array([pitch]))[0]
    np.testing.assert_allclose(rotation @ vector, expected, atol=1e-6)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-6)
    assert np.linalg.det(rotation) > 0


def distance_to_solids(primitives, room, point):
    """Independent witness, float64, one room at a time: least distance to what is neither floor nor ceiling."""
    best = np.inf
    for slot in np.flatnonzero(primitives.kind[room] != GAP):
        if primitives.semantic[room, slot] in (FLOOR, CEILING):
            continue
        half = primitives.half_size[room, slot].astype(float)
        turn = -float(primitives.yaw[room, slot])
        x, y, z = (point - primitives.center[room, slot]).astype(float)
        x, y = np.cos(turn) * x - np.sin(turn) * y, np.sin(turn) * x + np.cos(turn) * y
        if primitives.kind[room, slot] == CYLINDER:
            outside = np.array([np.hypot(x, y) - half[0], abs(z) - half[2]])
        else:
            assert primitives.kind[room, slot] == BOX
            outside = np.abs([x, y, z]) - half
        best = min(best, np.linalg.norm(np.maximum(outside, 0.0)))
    return best


def test_poses_keep_their_distance_from_everything():
    config = RoomConfig()
    index = np.arange(150)
    rooms = make_rooms(config, 5, index)
    poses, found = draw_poses(rooms, config.size, Standing(height=1.2, gap=0.35), draws.keys(5, index))
    assert found.mean() > 0.9
    np.testing.assert_allclose(poses.position[:, 2], -0.3, atol=1e-6)
    assert min(distance_to_solids(rooms, room, poses.position[room]) for room in np.flatnonzero(found)) >= 0.35
    assert stats.kstest(poses.yaw / 360 + 0.5, "uniform").pvalue > 1e-3


def test_range_noise_has_the_sigma_asked_for_and_nothing_else():
    distance = np.full((20, 5_000), 4.0, np.float32)
    distance[:, ::10] = np.inf
    noisy = add_range_noise(distance, 0.02, seed=1, index=np.arange(20))
    assert np.array_equal(np.isinf(noisy), np.isinf(distance)) and noisy.dtype == np.float32
    error = noisy[np.isfinite(distance)] - distance[np.isfinite(distance)]
    assert stats.kstest(error / 0.02, "norm").pvalue > 1e-3
    assert abs(np.corrcoef(noisy[:-1, 1:10].ravel(), noisy[1:, 1:10].ravel())[0, 1]) < 4 / np.sqrt(19 * 9)


def test_range_noise_is_a_function_of_the_room_alone():
    distance = np.ones((4, 100), np.float32)
    index = np.array([3, 1, 4, 5])
    whole = add_range_noise(distance, 0.1, seed=2, index=index)
    np.testing.assert_array_equal(add_range_noise(distance[2:3], 0.1, seed=2, index=index[2:3]), whole[2:3])
    assert not np.array_equal(add_range_noise(distance, 0.1, seed=3, index=index), whole)
    np.testing.assert_array_equal(add_range_noise(distance, 0.0, seed=2, index=index), distance)


def test_noise_never_turns_a_range_negative():
    assert np.all(add_range_noise(np.zeros((1, 1_000), np.float32), 0.1, seed=0, index=np.arange(1)) >= 0)


@pytest.mark.parametrize("settings", [{"width": 0}, {"horizontal_fov": 180.0}, {"vertical_fov": 0.0}])
def test_rejects_impossible_sensors(settings):
    with pytest.raises(ValueError, match=next(iter(settings)).split("_")[0]):
        Pinhole(**{"width": 4, "height": 3, **settings})


@pytest.mark.parametrize("sigma", [-0.1, np.inf, np.nan])
def test_rejects_impossible_noise(sigma):
    with pytest.raises(ValueError, match="sigma"):
        add_range_noise(np.ones((1, 1), np.float32), sigma, seed=0, index=np.arange(1))
