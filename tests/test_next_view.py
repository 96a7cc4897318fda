"""The next view: free, near, and it does show the element."""

import numpy as np
import pytest

from jaxmm.next_view import GAP, Stage, next_views
from warp_scanner.building_poses import element_around
from warp_scanner.room_buildings import building_of_room
from warp_scanner.scan import Rays
from warp_scanner.scenes import BOX, CEILING, FLOOR, PILLAR, WALL, Primitives
from warp_scanner.triangles import cast_triangles, clearance, prepare

SENSOR = np.array([-3.0, 0.0, 1.2])


def stage(obstacles=None, screen=True):
    """A hall of 10 x 6 x 3 m; a pillar (element 2) stands behind a wall (element 3) as seen from the sensor."""
    boxes = [
        ((0, 0, -0.05), (5, 3, 0.05), FLOOR),
        ((0, 0, 3.05), (5, 3, 0.05), CEILING),
        ((3, 0, 1.5), (0.3, 0.3, 1.5), PILLAR),
    ]
    boxes += [((0, 0, 1.5), (0.1, 1.5, 1.5), WALL)] if screen else []
    center, half, semantic = (np.array(values) for values in zip(*boxes, strict=True))
    count = len(boxes)
    table = Primitives(
        np.full((1, count), BOX, np.uint8), center[None].astype(np.float32), half[None].astype(np.float32),
        np.zeros((1, count), np.float32), np.arange(count, dtype=np.int32)[None], semantic[None].astype(np.uint8),
    )  # fmt: skip
    building, _ = building_of_room(table, 0)
    nothing = np.zeros((0, 3), np.float32)
    return Stage(building, prepare(building.triangles), nothing if obstacles is None else obstacles, SENSOR, 1.2)


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
    ((place, yaw, _),) = next_views(stage(screen=False), np.array([2]))
    np.testing.assert_allclose(place, SENSOR, atol=0.02)
    assert abs(yaw) < 5


def test_what_the_robot_saw_standing_around_hides_as_well():
    y, z = np.meshgrid(np.arange(-1.5, 1.5, 0.08), np.arange(0.0, 3.0, 0.08))
    screen = np.column_stack([np.zeros(y.size), y.ravel(), z.ravel()]).astype(np.float32)
    ((place, _, _),) = next_views(stage(screen, screen=False), np.array([2]))
    assert np.linalg.norm(place - SENSOR) > 0.5


def test_an_element_that_can_be_seen_from_nowhere_gets_none():
    angle = np.linspace(0, 2 * np.pi, 120)
    ring = [
        np.column_stack([3 + 0.7 * np.cos(angle), 0.7 * np.sin(angle), np.full(120, z)]) for z in np.arange(0, 3, 0.08)
    ]
    closed = np.concatenate(ring).astype(np.float32)
    assert next_views(stage(closed), np.array([2])) == [None]
