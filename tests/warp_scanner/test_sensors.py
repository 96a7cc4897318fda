"""Directions of the sensors, and what their presets promise."""

import dataclasses

import numpy as np
import pytest

from warp_scanner.scenes import scenes
from warp_scanner.sensors.imperfections import Imperfections
from warp_scanner.sensors.sensors import (
    OAK_D_PRO,
    OAK_D_PRO_SMALL,
    OUSTER_64,
    PRESETS,
    TLS,
    VELODYNE_16,
    Pinhole,
    Spinning,
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


@pytest.mark.parametrize("name, lowest", [("tls", -90.0), ("tls-real", -60.0)])
def test_the_terrestrial_scanner_sees_all_round_but_for_the_cone_of_a_real_tripod(name, lowest):
    """Whatever lies above the lowest elevation has a ray within the distance that the grid allows."""
    sensor = sensor_named(name)
    directions = sensor.directions().reshape(*sensor.shape, 3)
    rng = np.random.default_rng(0)
    azimuth, elevation = rng.uniform(-180, 180, 20_000), rng.uniform(lowest, 90, 20_000)
    flat = np.cos(np.radians(elevation))
    aim = np.stack(
        [flat * np.cos(np.radians(azimuth)), flat * np.sin(np.radians(azimuth)), np.sin(np.radians(elevation))], axis=-1
    )
    row = np.clip(np.round((89.9 - elevation) / 0.2), 0, sensor.shape[0] - 1).astype(int)
    column = np.floor((180 - azimuth) / 0.2).astype(int)
    apart = 2 * np.arcsin(np.linalg.norm(directions[row, column] - aim, axis=1) / 2)
    assert np.degrees(apart.max()) < 0.1 * np.sqrt(2) + 1e-3
    assert np.degrees(np.arcsin(directions[..., 2].min())) > lowest


@pytest.mark.parametrize("name", ["oak-d-pro", "oak-d-pro-small", "velodyne-16", "ouster-64", "tls"])
def test_presets_are_ideal_unless_real(name):
    ideal, real = sensor_named(name), sensor_named(f"{name}-real")
    assert ideal.imperfections == Imperfections() and real.imperfections.noisy
    assert real.imperfections.class_dropout == ((scenes.WINDOW, 0.6),)  # glass
    if name != "tls":  # which has a tripod
        assert dataclasses.replace(real, imperfections=Imperfections()) == ideal
    assert 0 < ideal.range_limits[0] < 1 and 30 < ideal.range_limits[1] < 200
    assert len(PRESETS) == 10


@pytest.mark.parametrize("distance, limit", [(4.0, 0.02), (7.0, 0.04), (10.0, 0.06)])
def test_depth_noise_of_the_camera_keeps_to_what_its_maker_states(distance, limit):
    sigma = sensor_named("oak-d-pro-real").imperfections.sigma(np.array([distance]))
    assert 0.5 * limit * distance < sigma[0] < limit * distance


@pytest.mark.parametrize(("share", "stated"), [(0.9, 0.0003), (0.1, 0.0005)])
def test_noise_of_the_terrestrial_scanner_is_what_its_maker_states_at_ten_metres(share, stated):
    errors = sensor_named("tls-real").imperfections
    sigma = np.hypot(errors.sigma(np.array([10.0]))[0], errors.noise_by_light * 10.0 / np.sqrt(share))
    assert abs(sigma / stated - 1) < 0.1


@pytest.mark.parametrize("settings", [{"width": 0}, {"horizontal_fov": 180.0}, {"vertical_fov": 0.0}])
def test_rejects_impossible_sensors(settings):
    with pytest.raises(ValueError, match=next(iter(settings)).split("_")[0]):
        Pinhole(**{"width": 4, "height": 3, **settings})


@pytest.mark.parametrize("name", ["oak-d-pro-small", "velodyne-16", "ouster-64", "tls"])
def test_a_sensor_sees_its_own_rays_and_nothing_behind_or_beside_its_view(name):
    sensor = sensor_named(name)
    assert sensor.sees(3.0 * sensor.directions()).all()
    right, left = sensor.azimuths
    rng = np.random.default_rng(0)
    toward = rng.standard_normal((20_000, 3))
    azimuth = np.degrees(np.arctan2(toward[:, 1], toward[:, 0]))
    seen = sensor.sees(toward)
    outside = (azimuth < right) | (azimuth > left)
    assert not seen[outside].any() and outside.any() == (left - right < 360.0)
    # The share of the sphere that is seen: a pyramid, or a belt between two elevations.
    if isinstance(sensor, Pinhole):
        a, b = (np.tan(np.radians(fov) / 2) for fov in (sensor.horizontal_fov, sensor.vertical_fov))
        share = np.arctan(a * b / np.sqrt(1 + a * a + b * b)) / np.pi
    else:
        half = sensor.spacing[0] / 2
        top, bottom = min(sensor.rows[0] + half, 90.0), sensor.rows[-1] - half
        share = (np.sin(np.radians(top)) - np.sin(np.radians(bottom))) / 2
    assert seen.mean() == pytest.approx(share, abs=0.012)


def test_resampling_keeps_the_view():
    for name in ("oak-d-pro", "velodyne-16", "tls"):
        sensor = sensor_named(name)
        small = sensor.resampled(32, 20)
        assert small.shape == (20, 32) and small.azimuths == sensor.azimuths
        assert small.range_limits == sensor.range_limits
    assert TLS.resampled(9, 20).rows[[0, -1]].tolist() == TLS.rows[[0, -1]].tolist()
    assert Spinning(90, elevations=(3.0,)).resampled(9, 20).rows.tolist() == [3.0]
