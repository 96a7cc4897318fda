"""Rotations, and poses at free places."""

import numpy as np
import pytest
from scipy import stats

from warp_scanner import draws
from warp_scanner.rooms.rooms import RoomConfig, make_rooms
from warp_scanner.rooms.standing import Standing, draw_poses
from warp_scanner.scenes.scenes import BOX, CEILING, CYLINDER, FLOOR, GAP
from warp_scanner.sensors.poses import rotation_of

VARIED = Standing(height=(0.4, 2.2), pitch=(-15.0, 15.0))  # a small robot's mast to a hand held up


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


def poses(standing, count=400, size=None, seed=6):
    config, index = RoomConfig(), np.arange(count)
    rooms = make_rooms(config, seed, index)
    return draw_poses(rooms, config.size if size is None else size, standing, draws.keys(seed, index))


def test_a_range_without_width_is_its_one_value_to_the_bit():
    """Heights and pitches are drawn apart from all else, so poses of settings without ranges are what they were."""
    plain, found = poses(Standing(height=1.2))
    ranged, _ = poses(Standing(height=(1.2, 1.2), pitch=(0.0, 0.0)))
    varied, _ = poses(VARIED)
    for a, b in zip(plain, ranged, strict=True):
        np.testing.assert_array_equal(a, b)
    np.testing.assert_array_equal(plain.position[:, 2], np.full(400, np.float32(1.2 - 3.0 / 2)))
    np.testing.assert_array_equal(plain.pitch, np.zeros(400, np.float32))
    np.testing.assert_array_equal(varied.position[:, :2], plain.position[:, :2])
    np.testing.assert_array_equal(varied.yaw, plain.yaw)
    # Places by the formula: the first of the drawn ones that is free.
    key = draws.keys(6, np.arange(400))
    place = np.stack([draws.between(key, f"sensor {axis}", (0.3 - 5, 5 - 0.3), 32) for axis in (0, 1)], axis=-1)
    drawn = np.any(np.all(place.astype(np.float32) == plain.position[:, None, :2], axis=2), axis=1)
    assert found.mean() > 0.9 and np.all(drawn)


def test_varied_poses_fill_their_ranges_evenly():
    drawn, _ = poses(VARIED)
    height = drawn.position[:, 2].astype(float) + 1.5
    assert stats.kstest((height - 0.4) / 1.8, "uniform").pvalue > 1e-3
    assert stats.kstest((drawn.pitch + 15.0) / 30.0, "uniform").pvalue > 1e-3
    assert abs(np.corrcoef(height, drawn.pitch)[0, 1]) < 4 / np.sqrt(400)
    assert abs(np.corrcoef(drawn.yaw, drawn.pitch)[0, 1]) < 4 / np.sqrt(400)


def test_a_range_of_heights_gives_way_to_a_low_ceiling():
    size = np.tile([10.0, 10.0, 3.0], (400, 1))
    size[::2, 2] = 2.3
    drawn, _ = poses(VARIED, size=size)
    height = drawn.position[:, 2] + size[:, 2] / 2
    assert 1.95 < height[::2].max() <= 2.0 + 1e-6 < height[1::2].max()
    fixed, _ = poses(Standing(height=2.2), size=size)
    np.testing.assert_allclose(fixed.position[:, 2] + size[:, 2] / 2, 2.2, atol=1e-6)


def test_rooms_may_have_sizes_of_their_own():
    size = np.random.default_rng(0).uniform([4, 4, 2.4], [10, 10, 6], (400, 3))
    drawn, _ = poses(Standing(gap=0.5), size=size)
    assert np.all(np.abs(drawn.position[:, :2]) <= size[:, :2] / 2 - 0.5 + 1e-6)
    same, _ = poses(Standing(), size=np.tile([10.0, 10.0, 3.0], (400, 1)))
    for a, b in zip(same, poses(Standing())[0], strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize(
    "settings",
    [
        {"height": -1.0}, {"height": (2.0, 1.0)}, {"height": np.nan}, {"pitch": (10.0, -10.0)}, {"pitch": (0.0, 91.0)},
        {"gap": -0.1}, {"tries": 0},
    ],
)  # fmt: skip
def test_rejects_impossible_standing(settings):
    with pytest.raises(ValueError, match=f"standing.*{next(iter(settings))[:3]}"):
        Standing(**settings)
