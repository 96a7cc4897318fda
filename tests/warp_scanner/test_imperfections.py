"""Errors of ranges: each effect alone against what it should be, and all together against what must never happen."""

import dataclasses

import numpy as np
import pytest
from scipy import stats

from warp_scanner.rooms.rooms import RoomConfig, make_rooms
from warp_scanner.scenes.scenes import DOOR, WALL
from warp_scanner.sensors.imperfections import Imperfections, imperfect
from warp_scanner.sensors.scan import Rays, Scan, cast_rays, cast_slots
from warp_scanner.sensors.sensors import PRESETS, Pinhole, Spinning
from warp_scanner.sensors.surface import incidence_of, normals_of

ROOMS, RAYS = 20, 5_000
ALL = Imperfections(
    noise=0.01, noise_per_metre=0.002, noise_per_square=0.001, grazing_dropout=0.9, grazing_start=50.0,
    class_dropout=((WALL, 0.1), (DOOR, 0.6)), mixed_chance=0.5, mixed_step=0.2, quantum=0.004,
    noise_by_light=0.001, dark_bias=0.01, slant_bias=0.005, reflectivity_spread=0.4, gross_chance=0.002,
)  # fmt: skip


def flat_scan(distance, shape=(ROOMS, RAYS), semantic=WALL):
    distance = np.broadcast_to(np.float32(distance), shape).copy()
    hit = np.isfinite(distance)
    return Scan(distance, np.where(hit, 7, -1).astype(np.int32), np.where(hit, semantic, 0).astype(np.uint8))


def line_sensor(errors, rays=RAYS, limits=(0.0, np.inf)):
    return Spinning(rays, elevations=(0.0,), range_limits=limits, imperfections=errors)


def erring(scan, errors, incidence=None, limits=(0.0, np.inf), seed=1):
    index = np.arange(len(scan.distance))
    return imperfect(scan, incidence, line_sensor(errors, scan.distance.shape[1], limits), seed, index)


@pytest.fixture(scope="module")
def real_scan():
    """Scans of eight rooms with their incidence, as a camera sees them."""
    sensor = Pinhole(160, 100)
    rooms = make_rooms(RoomConfig(), 3, np.arange(8))
    rays = Rays(np.tile(np.float32([0.3, 0.1, 0.2]), (8, 1)), sensor.directions())
    distance, slot = cast_slots(rooms, None, rays)
    return sensor, cast_rays(rooms, None, rays), incidence_of(normals_of(rooms, slot, distance, rays), rays)


def test_the_ideal_sensor_returns_the_very_scan(real_scan):
    sensor, scan, incidence = real_scan
    for angles in (incidence, None):
        assert imperfect(scan, angles, sensor, 0, np.arange(8)) is scan


def test_each_effect_leaves_what_it_does_not_concern_bit_for_bit(real_scan):
    """Limits that contain every range, mixing without edges, dropout of an absent class: nothing may move."""
    sensor, scan, incidence = real_scan
    for errors in (
        Imperfections(),
        Imperfections(mixed_chance=1.0, mixed_step=50.0),
        Imperfections(mixed_chance=1.0, mixed_step=0.0, mixed_angle=0.01),
        Imperfections(class_dropout=((200, 1.0),)),
        Imperfections(grazing_dropout=1.0, grazing_start=89.99),
    ):
        other = dataclasses.replace(sensor, range_limits=(0.01, 90.0), imperfections=errors)
        found = imperfect(scan, incidence, other, 0, np.arange(8))
        for a, b in zip(found, scan, strict=True):
            np.testing.assert_array_equal(a, b)
            assert a.dtype == b.dtype


@pytest.mark.parametrize("distance", [0.5, 4.0, 20.0])
@pytest.mark.parametrize("parts", [(0.02, 0, 0), (0, 0.003, 0), (0, 0, 0.0004), (0.01, 0.002, 0.0003)])
def test_noise_is_gaussian_with_the_sigma_of_its_range(distance, parts):
    errors = Imperfections(*parts)
    sigma = parts[0] + parts[1] * distance + parts[2] * distance**2
    noise = erring(flat_scan(distance), errors).distance - distance
    count = ROOMS * RAYS
    assert abs(noise.mean()) < 4 * sigma / np.sqrt(count)
    assert abs(noise.std() / sigma - 1) < 4 / np.sqrt(2 * count) + 1e-3  # float32 ranges have steps of their own
    assert stats.kstest(noise.ravel() / sigma, "norm").pvalue > 1e-4
    assert abs(np.corrcoef(noise[:, 1:].ravel(), noise[:, :-1].ravel())[0, 1]) < 4 / np.sqrt(count)
    assert abs(np.corrcoef(noise[1:].ravel(), noise[:-1].ravel())[0, 1]) < 4 / np.sqrt(count)


def test_dropout_rises_with_incidence_as_stated():
    degrees = np.broadcast_to(np.linspace(0, 90, RAYS, dtype=np.float32), (200, RAYS))
    errors = Imperfections(grazing_dropout=0.8, grazing_start=60.0)
    lost = np.isinf(erring(flat_scan(4.0, (200, RAYS)), errors, np.radians(degrees)).distance)
    bands = [(low, low + 5) for low in range(0, 90, 5)]
    rate = np.array([lost[(degrees >= low) & (degrees < high)].mean() for low, high in bands])
    count = lost.size / len(bands)
    expected = 0.8 * np.clip((np.mean(bands, axis=1) - 60) / 30, 0, 1)
    assert np.all(rate[:12] == 0)
    assert np.all(np.diff(rate[11:]) > 0)
    np.testing.assert_allclose(rate, expected, atol=4 * np.sqrt(0.25 / count))
    almost_along = erring(flat_scan(4.0), Imperfections(grazing_dropout=1.0), np.full((ROOMS, RAYS), np.pi / 2))
    assert np.all(np.isinf(almost_along.distance))


def test_dropout_by_class_has_its_rate_and_touches_no_other_class():
    scan = flat_scan(4.0)
    scan.semantic[:, ::2] = DOOR
    lost = np.isinf(erring(scan, Imperfections(class_dropout=((DOOR, 0.3),))).distance)
    assert not lost[:, 1::2].any()
    count = lost[:, ::2].size
    assert abs(lost[:, ::2].mean() - 0.3) < 4 * np.sqrt(0.3 * 0.7 / count)
    everything = erring(scan, Imperfections(class_dropout=((DOOR, 1.0),)))
    assert np.all(np.isinf(everything.distance[:, ::2]))


def test_the_two_dropouts_are_independent_chances():
    errors = Imperfections(class_dropout=((WALL, 0.4),), grazing_dropout=0.5)
    lost = np.isinf(erring(flat_scan(4.0), errors, np.full((ROOMS, RAYS), np.pi / 2)).distance)
    assert abs(lost.mean() - (1 - 0.6 * 0.5)) < 4 * np.sqrt(0.21 / lost.size)


def test_a_lost_ray_is_a_miss_and_no_miss_comes_back(real_scan):
    sensor, scan, incidence = real_scan
    scan = scan._replace(distance=scan.distance.copy(), element=scan.element.copy(), semantic=scan.semantic.copy())
    scan.distance[:, ::9], scan.element[:, ::9], scan.semantic[:, ::9] = np.inf, -1, 0
    found = imperfect(scan, incidence, dataclasses.replace(sensor, imperfections=ALL), 0, np.arange(8))
    gone = np.isinf(found.distance)
    assert np.all(gone[:, ::9]) and 0.05 < gone.mean() < 0.6
    assert np.all(found.element[gone] == -1) and np.all(found.semantic[gone] == 0)
    np.testing.assert_array_equal(found.element[~gone], scan.element[~gone])
    np.testing.assert_array_equal(found.semantic[~gone], scan.semantic[~gone])


@pytest.mark.parametrize("limits", [(1.0, 4.0), (3.0, 3.01), (0.0, 2.0), (2.0, np.inf)])
def test_every_range_lies_within_the_limits(real_scan, limits):
    sensor, scan, incidence = real_scan
    for errors in (Imperfections(), ALL):
        other = dataclasses.replace(sensor, range_limits=limits, imperfections=errors)
        found = imperfect(scan, incidence, other, 0, np.arange(8))
        there = np.isfinite(found.distance)
        assert np.all((found.distance[there] >= limits[0]) & (found.distance[there] <= limits[1]))
        # What truly lies beyond is not seen, even if an error would bring it back.
        assert not np.any(there & ((scan.distance < limits[0]) | (scan.distance > limits[1])))
        if errors is not ALL:
            np.testing.assert_array_equal(there, (scan.distance >= limits[0]) & (scan.distance <= limits[1]))


def test_range_limits_include_their_ends():
    found = erring(flat_scan([0.999, 1.0, 4.0, 4.001], (3, 4)), Imperfections(), limits=(1.0, 4.0))
    np.testing.assert_array_equal(found.distance, np.float32([[np.inf, 1, 4, np.inf]] * 3))


def neighbours_of(distance, shape):
    """Independent witness: ranges of the four neighbours of every pixel, NaN beyond the image, one loop per pixel."""
    image = distance.reshape(shape)
    around = np.full((*shape, 4), np.nan)
    for row in range(shape[0]):
        for column in range(shape[1]):
            for number, (y, x) in enumerate(
                ((row - 1, column), (row + 1, column), (row, column - 1), (row, column + 1))
            ):
                if 0 <= y < shape[0] and 0 <= x < shape[1]:
                    around[row, column, number] = image[y, x]
    return around.reshape(-1, 4)


def test_mixed_pixels_lie_between_their_neighbours(real_scan):
    sensor, scan, _ = real_scan
    errors = Imperfections(mixed_chance=0.4, mixed_step=0.3)
    found = imperfect(scan, None, dataclasses.replace(sensor, imperfections=errors), 2, np.arange(8))
    edges, moved_edges = 0, 0
    for room in (0, 5):
        own, measured = scan.distance[room].astype(float), found.distance[room].astype(float)
        around = neighbours_of(own, sensor.shape)
        step = np.nanmax(np.abs(around - own[:, None]), axis=1)
        other = around[np.arange(len(own)), np.nanargmax(np.abs(around - own[:, None]), axis=1)]
        moved = measured != own
        assert not np.any(moved & (step <= 0.3 - 1e-5))
        low, high = np.minimum(own, other), np.maximum(own, other)
        assert np.all((measured >= low - 1e-6) & (measured <= high + 1e-6))
        # The centre of the beam is on its own surface, so the range stays nearer to it.
        assert np.all(np.abs(measured - own)[moved] <= np.abs(other - own)[moved] / 2 + 1e-6)
        edges, moved_edges = edges + np.sum(step > 0.3), moved_edges + moved.sum()
    assert edges > 500
    assert abs(moved_edges / edges - 0.4) < 4 * np.sqrt(0.24 / edges)


def test_only_a_full_turn_mixes_across_the_seam():
    scan = flat_scan(2.0, (300, 40))
    scan.distance[:, 20:] = 6.0
    errors = Imperfections(mixed_chance=1.0, mixed_angle=10.0)
    for turn, ends_mix in ((360.0, True), (359.0, False)):
        sensor = Spinning(40, elevations=(0.0,), azimuth_range=(0.0, turn), imperfections=errors)
        moved = imperfect(scan, None, sensor, 0, np.arange(300)).distance != scan.distance
        assert moved[:, 19:21].mean() > 0.99 and not moved[:, 1:19].any() and not moved[:, 21:-1].any()
        assert (moved[:, [0, -1]].mean() > 0.99) if ends_mix else not moved[:, [0, -1]].any()


def test_rays_too_far_apart_and_misses_mix_with_nothing():
    scan = flat_scan(2.0, (1, 200))  # ten rows of twenty columns; range jumps between rows, a miss in the middle
    scan.distance.reshape(10, 20)[5:] = 6.0
    scan.distance.reshape(10, 20)[2, 10] = np.inf
    errors = Imperfections(mixed_chance=1.0, mixed_angle=1.0)
    for spread, mixes in ((18.0, False), (4.5, True)):
        sensor = Spinning(20, 10, (-spread / 2, spread / 2), azimuth_range=(0.0, 10.0), imperfections=errors)
        found = imperfect(scan, None, sensor, 0, np.arange(1)).distance
        moved = (found != scan.distance).reshape(10, 20)
        assert moved[4:6].any() == mixes and not moved[:4].any() and not moved[6:].any()


@pytest.mark.parametrize("quantum", [0.002, 0.01, 0.25])
def test_quantised_ranges_are_multiples(quantum):
    scan = flat_scan(np.linspace(0.3, 30, RAYS))
    found = erring(scan, Imperfections(noise=0.01, quantum=quantum)).distance
    multiple = np.round(found.astype(float) / quantum)
    np.testing.assert_array_equal(found, (multiple * quantum).astype(np.float32))
    rounded = erring(scan, Imperfections(quantum=quantum)).distance
    assert np.abs(rounded - scan.distance).max() <= quantum / 2 + 1e-6


@pytest.mark.parametrize("name", [name for name in PRESETS if name.endswith("-real")])
def test_a_room_has_the_same_errors_whatever_the_batch(name):
    sensor = dataclasses.replace(Pinhole(160, 100), imperfections=PRESETS[name].imperfections)
    rng = np.random.default_rng(0)
    scan = flat_scan(rng.uniform(0.5, 9, (7, 16_000)), (7, 16_000))
    incidence = rng.uniform(0, np.pi / 2, (7, 16_000)).astype(np.float32)
    index = np.array([3, 1, 4, 15, 9, 2, 6])
    whole = imperfect(scan, incidence, sensor, 2, index)
    order = np.array([5, 0, 3])
    part = imperfect(Scan(*(f[order] for f in scan)), incidence[order], sensor, 2, index[order])
    for a, b in zip(part, whole, strict=True):
        np.testing.assert_array_equal(a, b[order])
    assert not np.array_equal(imperfect(scan, incidence, sensor, 3, index).distance, whole.distance)


def test_large_batches_are_cut_without_a_trace(monkeypatch):
    scan = flat_scan(4.0)
    whole = erring(scan, Imperfections(noise=0.1, class_dropout=((WALL, 0.2),)))
    monkeypatch.setattr("warp_scanner.sensors.imperfections._RAYS_AT_ONCE", 3 * RAYS)
    cut = erring(scan, Imperfections(noise=0.1, class_dropout=((WALL, 0.2),)))
    for a, b in zip(cut, whole, strict=True):
        np.testing.assert_array_equal(a, b)


def test_switching_on_one_effect_leaves_the_draws_of_the_others():
    alone = erring(flat_scan(4.0), Imperfections(noise=0.1)).distance
    both = erring(flat_scan(4.0), Imperfections(noise=0.1, class_dropout=((WALL, 0.3),))).distance
    np.testing.assert_array_equal(both[np.isfinite(both)], alone[np.isfinite(both)])


@pytest.mark.parametrize("rooms, rays", [(0, 5), (2, 1)])
def test_empty_and_tiny_scans(rooms, rays):
    found = erring(flat_scan(4.0, (rooms, rays)), ALL, np.zeros((rooms, rays), np.float32))
    assert all(field.shape == (rooms, rays) for field in found)


@pytest.mark.parametrize(
    "settings, word",
    [
        ({"noise": -0.1}, "noise"),
        ({"noise_per_metre": np.nan}, "noise_per_metre"),
        ({"noise_per_square": np.inf}, "noise_per_square"),
        ({"grazing_dropout": 1.1}, "grazing_dropout"),
        ({"grazing_start": 90.0}, "grazing_start"),
        ({"mixed_chance": -0.1}, "mixed_chance"),
        ({"mixed_step": -1.0}, "mixed_step"),
        ({"quantum": -0.01}, "quantum"),
        ({"class_dropout": ((3, 2.0),)}, "class_dropout of class 3"),
        ({"class_dropout": ((3, 0.1), (3, 0.2))}, "once each"),
        ({"class_dropout": ((256, 0.1),)}, "0 to 255"),
    ],
)
def test_rejects_impossible_imperfections(settings, word):
    with pytest.raises(ValueError, match=word):
        Imperfections(**settings)


def test_rejects_scans_that_do_not_fit():
    scan = flat_scan(1.0, (2, 12))
    with pytest.raises(ValueError, match="4 x 4 rays, got 12"):
        imperfect(scan, None, Pinhole(4, 4), 0, np.arange(2))
    with pytest.raises(ValueError, match="index must be"):
        imperfect(scan, None, Pinhole(4, 3), 0, np.arange(3))
    with pytest.raises(ValueError, match="incidence must be"):
        imperfect(scan, None, Pinhole(4, 3, imperfections=ALL), 0, np.arange(2))


def test_a_range_that_noise_turns_negative_is_no_measurement():
    found = erring(flat_scan(0.05), Imperfections(noise=0.1)).distance
    assert np.isinf(found).any() and np.all(found >= 0)
