"""Small flats: what stands in them, and that what sensors see of it is there."""

import numpy as np
import pytest

from warp_scanner.rooms.flats import HEIGHT, NARROWEST, make_flat, seen_by, seen_by_tilting
from warp_scanner.scenes.scenes import CEILING, DOOR, FLOOR, FURNITURE, PILLAR, WALL
from warp_scanner.sensors.sensors import sensor_named


def flat_of(number):
    return make_flat(np.random.default_rng(number))


def off_surface(flat, points, slot):
    """(n,) [m] from points (n, 3) to the surface of the primitive that each is said to be on."""
    table, yaw = flat.primitives, flat.primitives.yaw[0, slot]
    offset = points - table.center[0, slot]
    x = np.cos(yaw) * offset[:, 0] + np.sin(yaw) * offset[:, 1]
    y = -np.sin(yaw) * offset[:, 0] + np.cos(yaw) * offset[:, 1]
    half = table.half_size[0, slot]
    beyond = np.stack([np.abs(x), np.abs(y), np.abs(offset[:, 2])], axis=1) - half
    box = np.abs(beyond.max(axis=1))
    side = np.maximum(np.hypot(x, y) - half[:, 0], beyond[:, 2])
    return np.where(table.kind[0, slot] == 2, np.abs(side), box)


def test_flats_are_low_and_crowded_and_each_is_the_same_each_time():
    flats = [flat_of(number) for number in range(30)]
    for flat in flats:
        low, high = HEIGHT
        assert low <= flat.height <= high
        semantic = flat.primitives.semantic[0]
        assert semantic[:2].tolist() == [FLOOR, CEILING] and np.sum(semantic == WALL) >= 6
        assert flat.primitives.element[0].tolist() == list(range(len(semantic)))
        top = flat.primitives.center[0, :, 2] + flat.primitives.half_size[0, :, 2]
        walls = semantic == WALL
        np.testing.assert_allclose(top[walls], flat.height, atol=1e-5)
        assert np.all(top[semantic == FURNITURE] < flat.height) and np.all(top[semantic == DOOR] < flat.height)
    kinds = np.concatenate([flat.primitives.semantic[0] for flat in flats])
    assert {WALL, DOOR, FURNITURE, PILLAR} <= set(kinds.tolist())
    assert np.mean([np.sum(flat.primitives.semantic[0] == FURNITURE) for flat in flats]) > 10
    for field, again in zip(flats[3].primitives, flat_of(3).primitives, strict=True):
        np.testing.assert_array_equal(field, again)


def test_a_sensor_stands_free_in_a_room():
    for number in range(30):
        flat = flat_of(number)
        off = off_surface(flat, np.repeat(flat.place[None], flat.primitives.kind.shape[1], axis=0), slice(None))
        assert off.min() > 0.2 and NARROWEST > 2 * 0.45


@pytest.mark.parametrize("sensor", ["tilting", "oak-d-pro-small", "ouster-64"])
def test_points_lie_on_what_they_are_said_to_be_on_but_for_noise(sensor):
    for number in range(4):
        rng, flat = np.random.default_rng(number), flat_of(number)
        seen = seen_by_tilting(rng, flat) if sensor == "tilting" else seen_by(rng, flat, sensor_named(sensor))
        off = off_surface(flat, seen.points, seen.element)
        assert len(seen.points) > 1000 and np.median(off) < 0.025 and np.quantile(off, 0.999) < 0.15
        assert np.all(seen.element >= 0) and len(np.unique(seen.points, axis=0)) == len(seen.points)
        np.testing.assert_allclose(seen.rotation @ seen.rotation.T, np.eye(3), atol=1e-12)


def test_cupboards_reach_up_to_the_ceiling_where_they_are_built_in():
    for number in range(8):
        table, height = (flat := make_flat(np.random.default_rng(number), built_in=True)).primitives, flat.height
        things = table.semantic[0] == FURNITURE
        top = (table.center[0, :, 2] + table.half_size[0, :, 2])[things]
        assert np.any(top > height - 0.07) and np.all(top <= height + 1e-6)
        plain = flat_of(number).primitives
        top = (plain.center[0, :, 2] + plain.half_size[0, :, 2])[plain.semantic[0] == FURNITURE]
        assert np.all(top < height - 0.09)
