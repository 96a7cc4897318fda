"""Nearest neighbours: scipy as witness on clouds of every shape, ties, gaps, and nothing but the pair matters."""

import os

import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist

from warp_scanner.clouds.neighbours import nearest, nearest_both_ways
from warp_scanner.clouds.points import points_of
from warp_scanner.launches import thread_count
from warp_scanner.rooms.pairs import PairConfig, make_pairs


def room_like(rng, count):
    """Points on the walls and the floor of a room and on a pillar, as a scan has them; float32."""
    points = rng.uniform((-5, -5, -1.5), (5, 5, 1.5), (count, 3))
    side = rng.integers(0, 4, count)
    points[side == 0, 2] = -1.5
    points[side == 1, 0] = 5.0
    points[side == 2, 1] = -5.0
    points[side == 3] = points[side == 3] * (0.05, 0.05, 1) + (1, 2, 0)
    return points.astype(np.float32)


def along_a_line(rng, count):
    return rng.uniform(-3, 3, (count, 1)) * (1.0, 2.0, -0.5)


def with_outliers(rng, count):
    """A room with points 1e6 m away."""
    points = room_like(rng, count).astype(np.float64)
    points[:: max(count // 3, 1)] += rng.normal(scale=1e6, size=3)
    return points


def far_away(rng, count):
    """At national-grid coordinates."""
    return room_like(rng, count) + np.array([1e5 * rng.uniform(1, 10), 5e6, 100.0])


def copies(rng, count):
    """Few places, many points in each."""
    return rng.integers(0, 3, (count, 3)) * 0.5


def two_rooms(rng, count):
    return room_like(rng, count) + np.where(rng.random((count, 1)) < 0.5, 0.0, 1e5)


def one_place(rng, count):
    return np.full((count, 3), 2.5)


SHAPES = [room_like, along_a_line, with_outliers, far_away, copies, two_rooms, one_place]


def distances_to(points, other):
    """scipy's, in float64."""
    return cKDTree(np.asarray(other, np.float64)).query(np.asarray(points, np.float64))[0]


@pytest.mark.parametrize("shape", SHAPES)
def test_distances_are_those_of_scipy(shape):
    rng = np.random.default_rng(0)
    sizes = rng.integers(1, 700, (150, 2))
    clouds, others = ([shape(rng, size) for size in column] for column in sizes.T)
    found = nearest_both_ways(clouds, others)
    for cloud, other, sides in zip(clouds, others, found, strict=True):
        for points, reference, neighbours in ((cloud, other, sides[0]), (other, cloud, sides[1])):
            np.testing.assert_allclose(neighbours.distance, distances_to(points, reference), rtol=1e-14)
            to = np.asarray(reference, np.float64)[neighbours.index]
            np.testing.assert_allclose(np.linalg.norm(points - to, axis=1), neighbours.distance, rtol=1e-14)
            assert neighbours.distance.dtype == np.float64 and neighbours.index.dtype == np.int32


@pytest.mark.parametrize("shape", [copies, one_place, along_a_line, room_like])
def test_of_equally_near_points_the_lowest_index_is_named(shape):
    rng = np.random.default_rng(1)
    clouds, others = ([shape(rng, size) for size in rng.integers(1, 400, 60)] for _ in range(2))
    others = [np.concatenate([other, other[::-1]]) for other in others]
    for cloud, other, neighbours in zip(clouds, others, nearest(clouds, others), strict=True):
        # argmin names the first of equals.
        expected = cdist(cloud.astype(np.float64), other.astype(np.float64), "sqeuclidean").argmin(axis=1)
        np.testing.assert_array_equal(neighbours.index, expected)


def test_scans_of_changed_rooms():
    pairs = make_pairs(PairConfig(scenario="wall_removed", condition="occluded", range_noise=0.01), np.arange(6))
    sides = [points_of(pairs.pose, pairs.directions, scan.distance)[:, ::7] for scan in (pairs.dt, pairs.robot)]
    clouds, others = ([points[np.isfinite(points[:, 0])] for points in side] for side in sides)
    found = nearest_both_ways(clouds, others)
    for cloud, other, (there, back) in zip(clouds, others, found, strict=True):
        np.testing.assert_allclose(there.distance, distances_to(cloud, other), rtol=1e-14)
        np.testing.assert_allclose(back.distance, distances_to(other, cloud), rtol=1e-14)
    distances = np.concatenate([there.distance for there, _ in found])
    assert distances.max() > 1.0 and np.quantile(distances, 0.1) < 0.02  # behind the removed wall, and elsewhere


def test_a_pair_depends_on_nothing_but_itself():
    rng = np.random.default_rng(2)
    clouds, others = ([room_like(rng, size) for size in rng.integers(0, 9000, 25)] for _ in range(2))
    together = nearest_both_ways(clouds, others, threads=2)
    for number in range(25):
        for threads in (1, 3):
            ((there, back),) = nearest_both_ways([clouds[number]], [others[number]], threads=threads)
            (one_way,) = nearest([clouds[number]], [others[number]], threads=threads)
            for found, expected in ((there, 0), (one_way, 0), (back, 1)):
                np.testing.assert_array_equal(found.distance, together[number][expected].distance)
                np.testing.assert_array_equal(found.index, together[number][expected].index)


@pytest.mark.parametrize("count", [1, 15, 16, 17, 255, 256, 257, 4096, 4097])
def test_every_size_around_the_edges_of_chunks(count):
    rng = np.random.default_rng(count)
    points, other = rng.normal(size=(count, 3)), rng.normal(size=(300, 3))
    ((there, back),) = nearest_both_ways([points], [other])
    np.testing.assert_array_equal(there.distance, distances_to(points, other))
    np.testing.assert_array_equal(back.distance, distances_to(other, points))


def test_one_large_pair_is_shared_out_and_bounded():
    rng = np.random.default_rng(3)
    points, other = (room_like(rng, 200_000) for _ in range(2))
    (found,) = nearest([points], [other])
    some = rng.choice(len(points), 2000, replace=False)
    np.testing.assert_allclose(found.distance[some], distances_to(points[some], other), rtol=1e-14)


def test_empty_clouds_mark_gaps():
    points = np.ones((5, 3))
    none = np.zeros((0, 3))
    sides = nearest_both_ways([points, none, none, points], [none, points, none, points + 1])
    for neighbours, count in ((sides[0][0], 5), (sides[1][1], 5)):
        assert neighbours.distance.shape == neighbours.index.shape == (count,)
        assert np.isposinf(neighbours.distance).all() and (neighbours.index == -1).all()
    for neighbours in (sides[0][1], sides[1][0], *sides[2]):
        assert neighbours.distance.shape == neighbours.index.shape == (0,)
    np.testing.assert_allclose(sides[3][0].distance, np.sqrt(3))
    assert nearest([], []) == []


@pytest.mark.parametrize(
    "clouds, others, message",
    [
        ([np.zeros((2, 2))], [np.zeros((2, 3))], r"clouds\[0\] must be \(N, 3\), got \(2, 2\)"),
        ([np.zeros((2, 3))], [np.full((2, 3), np.nan)], r"others\[0\] must be finite"),
        ([np.zeros((2, 3))] * 2, [np.ones((2, 3)), np.full((2, 3), 1e16)], r"others\[1\] must be finite"),
        ([np.zeros((2, 3))], [], "others must be as many as clouds, 1, got 0"),
    ],
)
def test_bad_clouds_are_named(clouds, others, message):
    with pytest.raises(ValueError, match=message):
        nearest(clouds, others)
    with pytest.raises(ValueError, match="threads must be at least 1"):
        nearest([], [], threads=0)


def test_threads_are_as_many_as_the_cores_that_the_process_may_run_on(monkeypatch):
    monkeypatch.setattr(os, "sched_getaffinity", lambda process: {5, 9, 11}, raising=False)
    monkeypatch.setattr(os, "cpu_count", lambda: 96)
    assert (thread_count(None), thread_count(7)) == (3, 7)
    monkeypatch.delattr(os, "sched_getaffinity")
    assert thread_count(None) == 96
