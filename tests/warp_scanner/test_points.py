"""Points are pose plus range times direction; the kernel's filter by height is that of jaxmm/learning/preprocess.py."""

import dataclasses

import numpy as np
import pytest

from jaxmm.learning.preprocess import object_filter
from warp_scanner.clouds.points import points_of, tall_points
from warp_scanner.rooms.pairs import PRESETS, make_pairs
from warp_scanner.sensors.poses import Pose
from warp_scanner.sensors.scan import Scan
from warp_scanner.sensors.sensors import Pinhole

LEVEL = Pose(np.zeros((1, 3), np.float32), np.zeros(1, np.float32), np.zeros(1, np.float32))


def test_points_lie_along_the_turned_directions():
    rng = np.random.default_rng(3)
    yaw, pitch = rng.uniform(-180, 180, 50), rng.uniform(-60, 60, 50)
    position = rng.uniform(-50, 50, (50, 3))
    pose = Pose(*(np.asarray(field, np.float32) for field in (position, yaw, pitch)))
    directions = Pinhole(16, 10).directions()
    distance = rng.uniform(0.1, 30, (50, 160)).astype(np.float32)
    distance[rng.random(distance.shape) < 0.1] = np.inf
    for threads in (1, 3):
        points = points_of(pose, directions, distance, threads)
        assert points.dtype == np.float32
        np.testing.assert_array_equal(np.isnan(points), np.repeat(np.isinf(distance)[..., None], 3, axis=2))
    # First up by the pitch in the sensor's vertical plane, then about z by the yaw, as angles of a spherical frame.
    x, y, z = directions.astype(float).T
    for room in range(50):
        p, a = np.radians(pitch[room]), np.radians(yaw[room])
        level, up = np.cos(p) * x - np.sin(p) * z, np.sin(p) * x + np.cos(p) * z
        ray = np.stack([np.cos(a) * level - np.sin(a) * y, np.sin(a) * level + np.cos(a) * y, up], axis=1)
        hit = np.isfinite(distance[room])
        expected = position[room] + distance[room, hit, None] * ray[hit]
        np.testing.assert_allclose(points[room, hit], expected, atol=2e-5)


def test_rooms_keep_what_the_filter_of_a_single_cloud_keeps():
    index = np.arange(40)
    config = dataclasses.replace(PRESETS["varied"], scenario="all_four", condition="occluded", sensor=Pinhole(80, 50))
    pairs = make_pairs(config, index)
    half = pairs.size[:, 2] / 2
    for scan in (pairs.dt, pairs.robot):
        points = points_of(pairs.pose, pairs.directions, scan.distance)
        kept = tall_points(pairs.pose, pairs.directions, scan, (-half, half, 2.0, 0.1), 2)
        assert sum(one is not None for one in kept) > 35
        for row, one in enumerate(kept):
            if one is None:
                continue
            limits = (-float(half[row]), float(half[row]), 2.0, 0.1)
            mask = object_filter(points[row], scan.element[row], *limits)
            np.testing.assert_array_equal(one.pixel, np.flatnonzero(mask))
            np.testing.assert_array_equal(one.points, points[row, mask])


def columns(heights):
    """Rays that end at the given heights, seen from the origin along the horizon's direction and upwards."""
    x = np.ones(len(heights))
    toward = np.stack([x, 0 * x, heights], axis=1)
    distance = np.linalg.norm(toward, axis=1)
    return (toward / distance[:, None]).astype(np.float32), distance[None].astype(np.float32)


def test_thousands_of_random_objects_are_judged_as_by_their_medians():
    """Few returns each, near the limits: where the counts cannot tell, the kernel says so, and nowhere else."""
    rng = np.random.default_rng(8)
    unsure, kept_count = 0, 0
    for _ in range(400):
        element = np.repeat(np.arange(8), rng.integers(1, 7, 8)).astype(np.int32)
        rng.shuffle(element)
        base = rng.choice([-1.5, -1.4, -1.35, 0.4, 1.4, 1.5], 8)
        directions, distance = columns(base[element] + rng.choice([0.0, 0.05, 0.12, -0.2], len(element)))
        lost = rng.random(len(element)) < 0.1
        distance[0, lost] = np.inf
        scan = Scan(distance, np.where(lost, -1, element)[None], np.zeros(distance.shape, np.uint8))
        (kept,) = tall_points(LEVEL, directions, scan, (np.array([-1.5]), np.array([1.5]), 2.0, 0.1))
        points, there = points_of(LEVEL, directions, distance)[0], np.flatnonzero(~lost)
        expected = there[object_filter(points[there], element[there], -1.5, 1.5, 2.0, 0.1)]
        if kept is None:
            unsure += 1
            assert any(straddles(points[there, 2][element[there] == e]) for e in range(8))
        else:
            np.testing.assert_array_equal(kept.pixel, expected)
            kept_count += len(expected)
    assert 0 < unsure < 380 and kept_count > 500


def straddles(heights):
    """Whether the two returns in the middle lie on different sides of a limit."""
    if not len(heights):
        return False
    low, high = np.sort(heights)[[(len(heights) - 1) // 2, len(heights) // 2]]
    limits = (np.float32(sign * 1.5) + np.float32(side * 0.1) for sign in (-1, 1) for side in (-1, 1))
    return any(low - 1e-6 <= limit <= high + 1e-6 for limit in limits)


def test_nothing_is_kept_of_nothing_and_ids_must_be_there():
    empty = Scan(*(np.zeros((2, 0), dtype) for dtype in (np.float32, np.int32, np.uint8)))
    pose = Pose(np.zeros((2, 3), np.float32), np.zeros(2, np.float32), np.zeros(2, np.float32))
    limits = (np.zeros(2), np.ones(2), 2.0, 0.1)
    assert [len(kept.pixel) for kept in tall_points(pose, np.zeros((0, 3)), empty, limits)] == [0, 0]
    directions, distance = columns(np.array([0.0, 1.0]))
    nobody = Scan(distance, np.full(distance.shape, -1, np.int32), np.zeros(distance.shape, np.uint8))
    with pytest.raises(ValueError, match="element"):
        tall_points(LEVEL, directions, nobody, (np.zeros(1), np.ones(1), 2.0, 0.1))
    lost = nobody._replace(distance=np.full_like(distance, np.inf))
    (kept,) = tall_points(LEVEL, directions, lost, (np.zeros(1), np.ones(1), 2.0, 0.1))
    assert kept.points.shape == (0, 3)
