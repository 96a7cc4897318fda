"""Directions, presets, files, rotations, poses and noise of the sensors."""

import dataclasses

import numpy as np
import pytest
from scipy import stats

from warp_scanner import draws
from warp_scanner.imperfections import Imperfections
from warp_scanner.poses import VARIED_STANDING
from warp_scanner.rooms import RoomConfig, make_rooms
from warp_scanner.scenes import BOX, CEILING, CYLINDER, FLOOR, GAP
from warp_scanner.sensors import (
    OAK_D_PRO,
    OAK_D_PRO_SMALL,
    OUSTER_64,
    PRESETS,
    TLS,
    VELODYNE_16,
    Pinhole,
    Spinning,
    Standing,
    add_range_noise,
    draw_poses,
    rotation_of,
    sensor_named,
)


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


def angles_of(sensor):
    """Azimuth and elevation [deg] of every ray, (rows, columns)."""
    x, y, z = sensor.directions().astype(float).T
    return np.degrees(np.arctan2(y, x)).reshape(sensor.shape), np.degrees(np.arcsin(z)).reshape(sensor.shape)


@pytest.mark.parametrize("sensor", [VELODYNE_16, OUSTER_64, Spinning(7, elevations=(30.0, 2.0, -5.0))])
def test_spinning_directions_are_a_grid_of_angles(sensor):
    directions = sensor.directions()
    assert directions.shape == (np.prod(sensor.shape), 3) and directions.dtype == np.float32
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1.0, atol=1e-6)
    azimuth, elevation = angles_of(sensor)
    np.testing.assert_allclose(elevation, np.broadcast_to(sensor.rows[:, None], sensor.shape), atol=1e-4)
    columns = 180 - 360 * (np.arange(sensor.shape[1]) + 0.5) / sensor.shape[1]
    np.testing.assert_allclose(azimuth, np.broadcast_to(columns, sensor.shape), atol=1e-4)
    # No gap and no double ray where the turn closes.
    assert sensor.full_turn
    np.testing.assert_allclose((azimuth[:, -1] - azimuth[:, 0]) % 360, 360 / sensor.shape[1], atol=1e-4)


def test_a_part_of_a_turn_stays_between_its_edges():
    sensor = Spinning(90, 4, (-10.0, 10.0), azimuth_range=(-20.0, 70.0))
    azimuth, _ = angles_of(sensor)
    np.testing.assert_allclose(azimuth[:, [0, -1]], np.tile([69.5, -19.5], (4, 1)), atol=1e-4)
    assert not sensor.full_turn and sensor.spacing == (pytest.approx(20 / 3), 1.0)


@pytest.mark.parametrize("sensor", [Pinhole(80, 50), Pinhole(7, 31, 120.0, 20.0), VELODYNE_16, TLS])
def test_no_neighbours_are_farther_apart_than_the_spacing(sensor):
    image = sensor.directions().astype(float).reshape(*sensor.shape, 3)
    for axis in (0, 1):
        a, b = np.delete(image, 0, axis), np.delete(image, -1, axis)
        apart = np.degrees(2 * np.arcsin(np.linalg.norm(a - b, axis=-1) / 2))
        assert apart.max() <= sensor.spacing[axis] + 1e-4
        assert apart.max() >= sensor.spacing[axis] * 0.9


def test_presets_are_what_their_makers_say():
    azimuth, elevation = angles_of(sensor_named("velodyne-16"))
    np.testing.assert_allclose(np.unique(elevation.round(3)), np.arange(-15, 16, 2))
    np.testing.assert_allclose(np.diff(azimuth[0]), -0.2, atol=1e-3)
    assert OUSTER_64.shape == (64, 1024) and np.ptp(OUSTER_64.rows) == 45.0
    assert OAK_D_PRO.shape == (800, 1280) and OAK_D_PRO_SMALL.shape == (200, 320)
    assert (OAK_D_PRO.horizontal_fov, OAK_D_PRO.vertical_fov) == (80.0, 55.0)


def test_the_terrestrial_scanner_sees_all_but_the_cone_of_its_tripod():
    """Whatever lies 60 degrees below the horizon or higher has a ray within the distance that the grid allows."""
    directions = TLS.directions().reshape(*TLS.shape, 3)
    rng = np.random.default_rng(0)
    azimuth, elevation = rng.uniform(-180, 180, 20_000), rng.uniform(-60, 90, 20_000)
    flat = np.cos(np.radians(elevation))
    aim = np.stack(
        [flat * np.cos(np.radians(azimuth)), flat * np.sin(np.radians(azimuth)), np.sin(np.radians(elevation))], axis=-1
    )
    row = np.clip(np.round((89.9 - elevation) / 0.2), 0, 749).astype(int)
    column = np.floor((180 - azimuth) / 0.2).astype(int)
    apart = 2 * np.arcsin(np.linalg.norm(directions[row, column] - aim, axis=1) / 2)
    assert np.degrees(apart.max()) < 0.1 * np.sqrt(2) + 1e-3
    assert np.degrees(np.arcsin(directions[..., 2].min())) > -60


@pytest.mark.parametrize("name", ["oak-d-pro", "oak-d-pro-small", "velodyne-16", "ouster-64", "tls"])
def test_presets_are_ideal_unless_real(name):
    ideal, real = sensor_named(name), sensor_named(f"{name}-real")
    assert ideal.imperfections == Imperfections() and real.imperfections.noisy
    assert dataclasses.replace(real, imperfections=Imperfections()) == ideal
    assert 0 < ideal.range_limits[0] < 1 and 30 < ideal.range_limits[1] < 200
    assert len(PRESETS) == 10


@pytest.mark.parametrize("distance, limit", [(4.0, 0.02), (7.0, 0.04), (10.0, 0.06)])
def test_depth_noise_of_the_camera_keeps_to_what_its_maker_states(distance, limit):
    sigma = sensor_named("oak-d-pro-real").imperfections.sigma(np.array([distance]))
    assert 0.5 * limit * distance < sigma[0] < limit * distance


def sensor_file(folder, text):
    path = folder / "mine.toml"
    path.write_text(text)
    return path


def test_sensors_from_files(tmp_path):
    spinning = """
        kind = "spinning"
        azimuth_steps = 720
        elevations = [10, 0.5, -3]
        azimuth_range = [-90, 90]
        range_limits = [0.5, inf]
        [imperfections]
        noise = 0.01
        mixed_chance = 1
        [imperfections.class_dropout]
        wall = 0.25
        12 = 1
    """
    expected = Spinning(
        720, elevations=(10.0, 0.5, -3.0), azimuth_range=(-90.0, 90.0), range_limits=(0.5, np.inf),
        imperfections=Imperfections(noise=0.01, mixed_chance=1.0, class_dropout=((3, 0.25), (12, 1.0))),
    )  # fmt: skip
    assert sensor_named(sensor_file(tmp_path, spinning)) == expected
    pinhole = 'kind = "pinhole"\nwidth = 64\nheight = 48\nhorizontal_fov = 60'
    assert sensor_named(str(sensor_file(tmp_path, pinhole))) == Pinhole(64, 48, 60.0)
    hash(sensor_named(tmp_path / "mine.toml"))


PINHOLE = 'kind = "pinhole"\nwidth = 4\nheight = 3\n'
SPINNING = 'kind = "spinning"\nazimuth_steps = 4\nchannels = 3\nelevation_range = [-1, 1]\n'


@pytest.mark.parametrize(
    "text, words",
    [
        ("", ["kind", "None"]),
        ('kind = "radar"', ["kind", "pinhole, spinning", "radar"]),
        ("kind = [1]", ["kind", "[1]"]),
        ("width = ", ["not valid TOML"]),
        ("width = " + "1" * 5000, ["not valid TOML"]),
        ("width = " + "[" * 5000, ["not valid TOML"]),
        ('kind = "pinhole"\nwidth = 4', ["missing height"]),
        (PINHOLE + "depth = 3", ["unknown depth", "horizontal_fov"]),
        (PINHOLE.replace("4", "0"), ["width", "at least 1", "got 0"]),
        (PINHOLE.replace("4", "-4"), ["width", "at least 1", "got -4"]),
        (PINHOLE.replace("4", "4.0"), ["width", "whole number", "4.0"]),
        (PINHOLE.replace("4", "true"), ["width", "whole number", "True"]),
        (PINHOLE.replace("4", "1" + "0" * 400), ["width", "whole number"]),
        (PINHOLE.replace("4", "1000000000000"), ["rays", "1000000000000"]),
        (PINHOLE + "vertical_fov = 180", ["vertical_fov", "180"]),
        (PINHOLE + "vertical_fov = nan", ["vertical_fov", "nan"]),
        (PINHOLE + "vertical_fov = 1" + "0" * 400, ["vertical_fov", "a number"]),
        (PINHOLE + "range_limits = [-1, 4]", ["range_limits", "-1.0"]),
        (PINHOLE + "range_limits = [4, 4]", ["range_limits", "low < high"]),
        (PINHOLE + "range_limits = [nan, 4]", ["range_limits", "nan"]),
        (PINHOLE + "range_limits = 4", ["range_limits", "list of 2 numbers"]),
        (PINHOLE + "range_limits = [1, 2, 3]", ["range_limits", "list of 2 numbers"]),
        (PINHOLE + 'range_limits = [1, "x"]', ["range_limits", "a number", "'x'"]),
        (PINHOLE + "imperfections = 4", ["imperfections", "a table"]),
        (PINHOLE + "[imperfections]\nnoize = 1", ["unknown imperfections.noize", "noise_per_metre"]),
        (PINHOLE + "[imperfections]\nnoise = -1", ["imperfections.noise", "-1.0"]),
        (PINHOLE + "[imperfections]\nclass_dropout = [1]", ["imperfections.class_dropout", "a table"]),
        (PINHOLE + "[imperfections.class_dropout]\nglas = 1", ["imperfections.class_dropout", "glas", "wall"]),
        (PINHOLE + "[imperfections.class_dropout]\n300 = 1", ["imperfections.class_dropout", "0 to 255", "300"]),
        (PINHOLE + "[imperfections.class_dropout]\nwall = 2", ["imperfections.class_dropout", "got 2.0"]),
        (SPINNING.replace("steps = 4", "steps = 0"), ["azimuth_steps", "at least 1"]),
        (SPINNING + "elevations = [1]", ["either elevations", "3 channels and 1 elevations"]),
        (SPINNING.replace("channels = 3", "channels = 0"), ["either elevations", "0 channels"]),
        (SPINNING.replace("channels = 3", "channels = -3"), ["channels", "-3"]),
        (SPINNING.replace("[-1, 1]", "[1, -1]"), ["elevation_range", "1.0, -1.0"]),
        (SPINNING.replace("[-1, 1]", "[0, 0]"), ["elevation_range"]),
        (SPINNING + "azimuth_range = [0, 361]", ["azimuth_range", "361"]),
        ('kind = "spinning"\nazimuth_steps = 4\nelevations = [1, 1]', ["elevations", "fall"]),
        ('kind = "spinning"\nazimuth_steps = 4\nelevations = [1, 2]', ["elevations", "fall"]),
        ('kind = "spinning"\nazimuth_steps = 4\nelevations = [91]', ["elevations", "91"]),
        ('kind = "spinning"\nazimuth_steps = 4\nelevations = [nan]', ["elevations", "nan"]),
    ],
)
def test_bad_sensor_files_end_in_one_line_that_names_file_and_key(tmp_path, text, words):
    path = sensor_file(tmp_path, text)
    with pytest.raises(ValueError) as caught:
        sensor_named(path)
    message = str(caught.value)
    assert message.startswith(f"{path}: ") and "\n" not in message
    for word in words:
        assert word in message, message


def test_unreadable_sensor_files_are_named(tmp_path):
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    for name, word in (("oak-d-por", "velodyne-16"), (tmp_path, "expected a sensor file"), ("a\0b", "expected a")):
        with pytest.raises(ValueError, match=word):
            sensor_named(name)
    with pytest.raises(ValueError, match=r"binary\.toml: cannot read the sensor: not UTF-8"):
        sensor_named(tmp_path / "binary.toml")


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
    varied, _ = poses(VARIED_STANDING)
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
    drawn, _ = poses(VARIED_STANDING)
    height = drawn.position[:, 2].astype(float) + 1.5
    assert stats.kstest((height - 0.4) / 1.8, "uniform").pvalue > 1e-3
    assert stats.kstest((drawn.pitch + 15.0) / 30.0, "uniform").pvalue > 1e-3
    assert abs(np.corrcoef(height, drawn.pitch)[0, 1]) < 4 / np.sqrt(400)
    assert abs(np.corrcoef(drawn.yaw, drawn.pitch)[0, 1]) < 4 / np.sqrt(400)


def test_a_range_of_heights_gives_way_to_a_low_ceiling():
    size = np.tile([10.0, 10.0, 3.0], (400, 1))
    size[::2, 2] = 2.3
    drawn, _ = poses(VARIED_STANDING, size=size)
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
