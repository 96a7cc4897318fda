"""Ranges on planes: exact on planes, quieter under noise, true to their side of an edge."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from warp_scanner.clouds.planes import FEW, on_planes

K = 25


def grid(wide=0.4, count=60):
    """(count^2, 3) unit vectors around x, and the K nearest of each."""
    y, z = (axis.ravel() for axis in np.meshgrid(np.linspace(-wide, wide, count), np.linspace(-wide, wide, count)))
    direction = np.column_stack([np.ones_like(y), y, z])
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    return direction, cKDTree(direction).query(direction, K)[1]


def range_to(direction, normal, height):
    """Where rays from the origin meet normal . x = height."""
    return height / (direction @ (np.asarray(normal) / np.linalg.norm(normal)))


@pytest.mark.parametrize("normal", [(1, 0, 0), (1, 0.8, 0), (0.4, 1, 0.2), (1, -0.5, 2.0)])
@pytest.mark.parametrize("turn", [0.0, 1.0, np.pi / 2])
def test_what_is_on_a_plane_stays_there_at_any_slant(normal, turn):
    """In any direction of the sensor: at the poles the axes are others."""
    direction, near = grid(0.25, 61)
    rotation = np.array([[np.cos(turn), 0, -np.sin(turn)], [0, 1, 0], [np.sin(turn), 0, np.cos(turn)]])
    rotation = np.round(rotation, 9)  # one ray looks straight up
    reach = range_to(direction, normal, 3.0)
    there = (reach > 0.5) & (reach < 30.0)
    there &= there[near].all(axis=1)
    chosen = np.flatnonzero(there)
    reach = np.where((reach > 0.0) & (reach < 1e3), reach, 1e3)
    found = on_planes(direction @ rotation.T, reach, np.full(len(reach), 0.02), near[chosen], chosen)
    assert len(chosen) > 200
    np.testing.assert_allclose(found.distance, reach[chosen], rtol=2e-6)
    assert np.all(found.support == K)


def test_neighbours_may_be_far_apart():
    """As those of a sensor with few rings: 25 rays about 6 degrees apart."""
    direction, near = grid(0.8, 17)
    reach = range_to(direction, (1, 0.4, 0.2), 3.0)
    found = on_planes(direction, reach, np.full(len(reach), 0.002), near)
    np.testing.assert_allclose(found.distance, reach, rtol=2e-5)
    assert np.all(found.support >= 20)


def by_definition(direction, reach, margin, near, rounds=3):
    """Ranges (P,) and supports (P,) after so many fits, and how many of them (P,) changed what lies on the plane."""
    first = np.cross(direction, [0.0, 0.0, 1.0])
    second = np.cross(direction, first)
    toward = direction[near]
    cosine = np.einsum("pkc,pc->pk", toward, direction)
    chord = np.linalg.norm(toward - direction[:, None], axis=2)
    across = [np.einsum("pkc,pc->pk", toward, axis) / cosine / chord.max(axis=1)[:, None] for axis in (first, second)]
    axes = np.stack([np.ones_like(cosine), *across], axis=2)
    lies = (
        np.abs(reach[near] - reach[:, None])
        <= (margin[near] + margin[:, None]) / np.sqrt(2) + 3.7 * reach[:, None] * chord
    )
    changes = np.zeros(len(reach), int)
    for _ in range(rounds):
        moments = np.einsum("pk,pki,pkj->pij", lies, axes, axes) + 1e-9 * np.eye(3)
        right = np.einsum("pk,pki->pi", lies / (reach[near] * cosine), axes)
        plane = np.linalg.solve(moments, right[:, :, None])[:, :, 0]
        before, lies = lies, np.abs(reach[near] - 1.0 / (np.einsum("pki,pi->pk", axes, plane) * cosine)) <= margin[near]
        changes += (lies != before).any(axis=1)
    return 1.0 / plane[:, 0], lies.sum(axis=1) * (lies & (near == np.arange(len(reach))[:, None])).any(axis=1), changes


@pytest.mark.parametrize("count", [9, 33, 64])
def test_fits_may_end_early_and_give_what_three_do(count):
    """Of a noisy step, where what lies on a plane changes with every fit; up to as many neighbours as are allowed."""
    rng = np.random.default_rng(6)
    direction = rng.normal([1.0, 0.0, 0.0], [0.0, 0.2, 0.2], (20_000, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    near = cKDTree(direction).query(direction, count)[1]
    reach = np.where(
        direction[:, 1] > 0.05, range_to(direction, (1, 0.4, -0.2), 3.0), range_to(direction, (1, 0, 0), 3.1)
    )
    reach += rng.normal(0.0, 0.02, len(reach))
    margin = np.full(len(reach), 0.03)
    found = on_planes(direction, reach, margin, near)
    distance, support, changes = by_definition(direction, reach, margin, near)
    shared = support >= FEW  # else others are tried
    alike = (found.support == support) & np.isclose(found.distance, distance, rtol=1e-5)
    assert shared.mean() > 0.2 and alike[shared].mean() > 0.999  # a range may lie at the margin to seven digits
    assert all((changes[shared] == number).sum() > 40 for number in (1, 2, 3))


def test_a_ray_beside_a_plane_is_none_of_its_rays():
    direction, near = grid(0.1, 21)
    reach = range_to(direction, (1, 0.3, 0.1), 4.0)
    middle = len(reach) // 2
    reach[middle] += 0.3
    found = on_planes(direction, reach, np.full(len(reach), 0.02), near)
    assert found.support[middle] == 0
    assert np.all(np.delete(found.support, middle) >= K - 1)


@pytest.mark.parametrize("sigma", [0.002, 0.01, 0.03])
@pytest.mark.parametrize("gap, width, round_", [(0.3, 0.3, False), (0.5, 0.4, True), (0.5, 0.15, True)])
def test_a_column_before_a_wall_is_kept_by_a_sensor_with_few_rings(sigma, gap, width, round_):
    """16 rings 2 degrees apart, the wall 8 m away: most of the rays next to a column's are the wall's."""
    turn, rise = np.meshgrid(np.radians(np.arange(-15, 15, 0.2)), np.radians(np.arange(-15, 16, 2)))
    turn, rise = turn.ravel(), rise.ravel()
    direction = np.column_stack([np.cos(rise) * np.cos(turn), np.cos(rise) * np.sin(turn), np.sin(rise)])
    front, level = 8.0 - gap - width, np.cos(rise)
    if round_:
        middle = front + width / 2
        rest = (width / 2) ** 2 - (middle * np.sin(turn)) ** 2
        near = middle * np.cos(turn) - np.sqrt(np.maximum(rest, 0.0))
        on = rest > 0.0
    else:
        near = front / np.cos(turn)
        on = np.abs(near * np.sin(turn)) < width / 2
    true = np.where(on, near, 8.0 / np.cos(turn)) / level
    reach = true + sigma * np.random.default_rng(0).standard_normal(len(true))
    found = on_planes(
        direction, reach, np.full(len(reach), 0.01 + 3 * sigma), cKDTree(direction).query(direction, K)[1]
    )
    assert on.sum() >= 16 * 5
    assert np.mean(found.support[on] >= 6) > 0.97 and np.mean(found.support >= 6) > 0.99
    # A shaft bends away from the plane by what the margin allows.
    assert np.median(np.abs(found.distance - true)[on]) < (0.01 + 0.5 * sigma if round_ else 0.4 * sigma)


def test_each_range_has_a_margin_of_its_own():
    direction, near = grid(0.1, 21)
    reach = range_to(direction, (1, 0, 0), 4.0)
    strict = np.random.default_rng(0).random(len(reach)) < 0.4
    found = on_planes(direction, reach + 0.005 * strict, np.where(strict, 0.001, 0.02), near)
    clear = ~strict & ((~strict)[near].sum(axis=1) >= 12)
    assert clear.sum() > 100
    np.testing.assert_array_equal(found.support[clear], (~strict)[near].sum(axis=1)[clear])


def test_noise_shrinks_as_a_fit_of_three_unknowns_says():
    """Of K ranges with one variance, the fit at their middle has a K-th of it."""
    direction, near = grid()
    reach = range_to(direction, (1, 0.3, 0.1), 4.0)
    inside = np.flatnonzero(np.abs(direction[:, 1:]).max(axis=1) < 0.3)
    noisy = reach + 0.05 * np.random.default_rng(0).standard_normal(len(reach))
    found = on_planes(direction, noisy, np.full(len(reach), 10.0), near[inside], inside)
    error = found.distance - reach[inside]
    assert np.std(error) == pytest.approx(0.05 / np.sqrt(K), rel=0.1)
    assert abs(np.mean(error)) < 0.002
    assert np.all(found.support == K)


def test_a_fit_agrees_with_least_squares():
    direction, near = grid(count=20)
    rng = np.random.default_rng(1)
    reach = 3.0 + 0.1 * rng.standard_normal(len(direction))
    found = on_planes(direction, reach, np.full(len(reach), 10.0), near)
    for ray in range(0, len(reach), 7):
        own = direction[ray]
        axes = np.linalg.svd(own[None])[2]
        offset = direction[near[ray]] @ axes[1:].T / (direction[near[ray]] @ own)[:, None]
        inverse = 1.0 / (reach[near[ray]] * (direction[near[ray]] @ own))
        fit = np.linalg.lstsq(np.column_stack([np.ones(K), offset]), inverse, rcond=None)[0]
        assert found.distance[ray] == pytest.approx(1.0 / fit[0], rel=1e-4)


def test_each_side_of_an_edge_keeps_its_range_and_what_hangs_between_has_no_support():
    direction, near = grid()
    reach = np.where(direction[:, 1] > 0.0, range_to(direction, (1, 0, 0), 2.0), range_to(direction, (1, 0, 0), 5.0))
    rng = np.random.default_rng(2)
    hanging = (np.abs(direction[:, 1]) < 0.012) & (rng.random(len(reach)) < 0.5)
    mixed = np.where(hanging, rng.uniform(2.3, 4.7, len(reach)), reach)
    found = on_planes(direction, mixed, np.full(len(reach), 0.02), near)
    np.testing.assert_allclose(found.distance[~hanging], reach[~hanging], rtol=1e-3)
    assert found.support[~hanging].min() >= 6
    assert hanging.sum() > 20 and np.mean(found.support[hanging] < 6) > 0.9


def test_rays_that_did_not_come_back_are_on_no_plane():
    direction, near = grid(count=30)
    reach, gone = range_to(direction, (1, 0.4, 0), 3.0), np.random.default_rng(5).random(900) < 0.3
    found = on_planes(direction, np.where(gone, np.inf, reach), np.full(900, 0.02), near)
    assert np.all(np.isinf(found.distance[gone])) and not found.support[gone].any()
    np.testing.assert_allclose(found.distance[~gone], reach[~gone], rtol=1e-5)
    np.testing.assert_array_equal(found.support[~gone], (~gone)[near].sum(axis=1)[~gone])


def test_a_thing_of_a_few_rays_is_kept():
    """A post four rays wide before a wall."""
    direction, near = grid()
    post = np.abs(direction[:, 1]) < 1.6 * 0.8 / 59
    reach = np.where(post, range_to(direction, (1, 0, 0), 2.0), range_to(direction, (1, 0, 0), 5.0))
    found = on_planes(direction, reach, np.full(len(reach), 0.02), near)
    assert post.sum() == 4 * 60
    np.testing.assert_allclose(found.distance, reach, rtol=1e-3)
    assert found.support[post].min() >= 6


def test_rays_in_one_line_have_a_range_too():
    """As of a sensor of one ring, which tells of the slant one way only."""
    turn = np.linspace(-0.3, 0.3, 101)
    direction = np.column_stack([np.cos(turn), np.sin(turn), np.zeros(101)])
    near = cKDTree(direction).query(direction, 9)[1]
    reach = range_to(direction, (1, 0.5, 0), 3.0)
    found = on_planes(direction, reach, np.full(101, 0.02), near)
    np.testing.assert_allclose(found.distance, reach, rtol=1e-4)


def test_the_answer_depends_neither_on_threads_nor_on_the_other_rays():
    direction, near = grid(count=40)
    reach = 3.0 + 0.2 * np.random.default_rng(3).random(len(direction))
    margin = np.full(len(reach), 0.1)
    all_of_them = on_planes(direction, reach, margin, near, threads=1)
    some = np.random.default_rng(4).permutation(len(reach))[:500]
    few = on_planes(direction, reach, margin, near[some], some, threads=3)
    np.testing.assert_array_equal(few.distance, all_of_them.distance[some])
    np.testing.assert_array_equal(few.support, all_of_them.support[some])


@pytest.mark.parametrize(
    "change, message",
    [
        ({"distance": np.ones(3)}, "direction must be"),
        ({"margin": np.ones(3)}, "margin"),
        ({"neighbour": np.zeros((3, 2), int)}, r"neighbour must be \(4, K\)"),
        ({"neighbour": np.full((4, 2), 4)}, "neighbour must be within 0 to 3, got 4 to 4"),
        ({"neighbour": np.zeros((4, 65), int)}, "neighbour must hold at most 64 rays a row, got 65"),
        ({"chosen": np.array([0, 1, 2, -1])}, "chosen must be within 0 to 3, got -1 to 2"),
        ({"distance": np.array([1.0, 1.0, 1.0, np.nan])}, "distance must be positive, got nan"),
        ({"distance": np.array([1.0, 1.0, 1.0, 0.0])}, "distance must be positive, got 0.0"),
    ],
)
def test_bad_input_is_named(change, message):
    good = {
        "direction": np.tile([1.0, 0.0, 0.0], (4, 1)), "distance": np.ones(4), "margin": np.ones(4),
        "neighbour": np.zeros((4, 2), int),
    }  # fmt: skip
    with pytest.raises(ValueError, match=message):
        on_planes(**(good | change))


def test_no_rays_settle_nowhere():
    found = on_planes(np.zeros((0, 3)), np.zeros(0), np.zeros(0), np.zeros((0, K), int))
    assert found.distance.shape == found.support.shape == (0,)
