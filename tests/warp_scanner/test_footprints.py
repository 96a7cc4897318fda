"""Rectangles on the floor: what stays is what the definition says, computed another way."""

import numpy as np

from warp_scanner.rooms import footprints
from warp_scanner.rooms.footprints import Footprints


def rectangles(rng, rooms, count):
    return Footprints(
        rng.uniform(-4, 4, (rooms, count, 2)),
        rng.uniform(0.05, 0.8, (rooms, count, 2)),
        rng.uniform(0, 7, (rooms, count)),
        rng.random((rooms, count)) < 0.8,
    )


def corners_of(marks):
    signs = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    local = signs * marks.half_size[..., None, :]
    c, s = np.cos(marks.yaw)[..., None], np.sin(marks.yaw)[..., None]
    turned = np.stack([c * local[..., 0] - s * local[..., 1], s * local[..., 0] + c * local[..., 1]], -1)
    return turned + marks.center[..., None, :]


def separations(a, b):
    """(R, N, M) largest gap over the four face normals, from projected corners; inf beside a gap slot."""
    first, second = corners_of(a)[:, :, None], corners_of(b)[:, None]
    best = np.full((*a.valid.shape, b.valid.shape[1]), -np.inf)
    for yaw in (a.yaw[:, :, None], b.yaw[:, None]):
        for turn in (0.0, np.pi / 2):
            axis = np.stack([np.cos(yaw + turn), np.sin(yaw + turn)], -1)[..., None, :]
            u, v = np.sum(first * axis, axis=-1), np.sum(second * axis, axis=-1)
            gap = np.maximum(u.min(axis=-1) - v.max(axis=-1), v.min(axis=-1) - u.max(axis=-1))
            best = np.maximum(best, gap)
    return np.where(a.valid[:, :, None] & b.valid[:, None], best, np.inf)


def test_what_settles_is_what_two_rounds_of_the_definition_leave():
    rng = np.random.default_rng(0)
    marks, others = rectangles(rng, 400, 24), rectangles(rng, 400, 5)
    valid = marks.valid & np.all(separations(marks, others) > 0.1, axis=2)
    crowded = separations(marks._replace(valid=valid), marks._replace(valid=valid)) < 0.2
    stays = np.zeros_like(valid)
    for room in range(len(stays)):
        for _ in range(2):
            waiting = [n for n in range(24) if valid[room, n] and not stays[room, n]
                       and not crowded[room, n, stays[room]].any()]  # fmt: skip
            free = [n for n in waiting if not any(crowded[room, n, m] for m in waiting if m < n)]
            stays[room, free] = True
    before = marks.valid.copy()
    np.testing.assert_array_equal(footprints.settle(marks, others, 0.1, 0.2), stays)
    assert 2 < stays.sum() / len(stays) < 20
    np.testing.assert_array_equal(marks.valid, before)  # the caller's array is left alone


def test_the_first_clear_rectangle_is_the_first():
    rng = np.random.default_rng(1)
    marks, others = rectangles(rng, 2_000, 6), rectangles(rng, 2_000, 12)
    clear = marks.valid & np.all(separations(marks, others) > 0.1, axis=2)
    expected = np.where(clear.any(axis=1), clear.argmax(axis=1), -1)
    np.testing.assert_array_equal(footprints.first_clear(marks, others, 0.1), expected)
    assert set(expected) == set(range(-1, 6))


def test_the_first_clear_point_is_the_first():
    rng = np.random.default_rng(2)
    points, others = rng.uniform(-4, 4, (2_000, 5, 2)), rectangles(rng, 2_000, 20)
    offset = points[:, :, None] - others.center[:, None]
    c, s = np.cos(others.yaw)[:, None], np.sin(others.yaw)[:, None]
    local = np.stack([c * offset[..., 0] + s * offset[..., 1], c * offset[..., 1] - s * offset[..., 0]], -1)
    distance = np.linalg.norm(np.maximum(np.abs(local) - others.half_size[:, None], 0), axis=-1)
    clear = np.all((distance > 0.3) | ~others.valid[:, None], axis=2)
    expected = np.where(clear.any(axis=1), clear.argmax(axis=1), -1)
    np.testing.assert_array_equal(footprints.first_clear_point(points, others, 0.3), expected)
    assert set(expected) == set(range(-1, 5))


def test_nothing_in_no_rooms_settles():
    nothing = Footprints(np.zeros((0, 3, 2)), np.zeros((0, 3, 2)), np.zeros((0, 3)), np.zeros((0, 3), bool))
    assert footprints.settle(nothing, nothing, 0.1, 0.1).shape == (0, 3)
    assert footprints.first_clear(nothing, nothing, 0.1).shape == (0,)


def test_a_rectangle_without_neighbours_stays():
    one = Footprints(np.zeros((1, 1, 2)), np.full((1, 1, 2), 0.5), np.zeros((1, 1)), np.ones((1, 1), bool))
    none = Footprints(np.zeros((1, 0, 2)), np.zeros((1, 0, 2)), np.zeros((1, 0)), np.zeros((1, 0), bool))
    assert footprints.settle(one, none, 0.1, 0.1).all() and footprints.first_clear(one, none, 0.1)[0] == 0
