"""Distances to surfaces: closed forms, and trimesh as an independent witness."""

import dataclasses

import numpy as np
import pytest
import trimesh

from warp_scanner.clouds.points import points_of
from warp_scanner.rooms.pairs import PRESETS, make_pairs
from warp_scanner.scenes.scenes import BOX, CYLINDER, GAP, Primitives, scene_mesh
from warp_scanner.sensors.surface_distance import surface_distance


def solid(kind, center, half_size, yaw=0.0):
    return Primitives(
        np.array([[kind]], np.uint8), np.array([[center]], np.float32), np.array([[half_size]], np.float32),
        np.array([[yaw]], np.float32), np.zeros((1, 1), np.int32), np.ones((1, 1), np.uint8),
    )  # fmt: skip


def test_boxes_and_cylinders_by_hand():
    box = solid(BOX, (1, 2, 3), (1.0, 0.5, 0.25), np.pi / 2)  # turned: 0.5 along x, 1 along y
    points = [[1, 2, 3], [1.5, 2, 3], [2.5, 2, 3], [1, 3, 3.5], [1.5, 4, 3], [2.5, 4, 4.25]]
    expected = [0.25, 0.0, 1.0, 0.25, 1.0, np.sqrt(3.0)]
    np.testing.assert_allclose(surface_distance(box, None, [np.array(points)])[0], expected, atol=1e-6)
    round_one = solid(CYLINDER, (0, 0, 0), (0.5, 0.5, 2.0))
    points = [[0, 0, 0], [0.4, 0, 0], [0.5, 0, 1], [0, 2, 0], [0, 0, 1.9], [0, 0.5, 3], [1.5, 0, 3]]
    expected = [0.5, 0.1, 0.0, 1.5, 0.1, 1.0, np.sqrt(2.0)]
    np.testing.assert_allclose(surface_distance(round_one, None, [np.array(points)])[0], expected, atol=1e-6)
    gone = round_one._replace(kind=np.full((1, 1), GAP, np.uint8))
    for nothing in (
        surface_distance(gone, None, [points]),
        surface_distance(round_one, np.zeros((1, 1), bool), [points]),
    ):
        assert np.isinf(nothing[0]).all()


def test_distances_to_boxes_are_those_of_trimesh():
    config = dataclasses.replace(PRESETS["varied"], scenario="all_four", condition="occluded")
    pairs = make_pairs(config, np.arange(3))
    primitives = pairs.prior._replace(kind=np.where(pairs.prior.kind == BOX, BOX, GAP))
    rng = np.random.default_rng(2)
    clouds = [rng.uniform(-0.5, 0.5, (300 + room, 3)) * pairs.size[room] for room in range(3)]
    found = surface_distance(primitives, None, clouds, 2)
    for room, cloud in enumerate(clouds):
        vertices, faces, _ = scene_mesh(primitives, room)
        _, expected, _ = trimesh.proximity.closest_point(trimesh.Trimesh(vertices, faces, process=False), cloud)
        np.testing.assert_allclose(found[room], expected, atol=1e-4)
        np.testing.assert_array_equal(surface_distance(primitives, None, clouds, 1)[room], found[room])


def test_what_a_scan_of_the_prior_hits_is_on_its_surface():
    pairs = make_pairs(dataclasses.replace(PRESETS["varied"], scenario="wall_removed"), np.arange(8))
    points = points_of(pairs.pose, pairs.directions, pairs.dt.distance)[:, ::50]
    assert max(apart.max() for apart in surface_distance(pairs.prior, None, list(points))) < 1e-4


def test_each_room_needs_its_cloud():
    with pytest.raises(ValueError, match="points must be 1 clouds"):
        surface_distance(solid(BOX, (0, 0, 0), (1, 1, 1)), None, [])
    assert surface_distance(solid(BOX, (0, 0, 0), (1, 1, 1)), None, [np.zeros((0, 3))])[0].shape == (0,)
