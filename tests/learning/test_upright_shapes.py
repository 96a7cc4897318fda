"""Lines and circles through points: known shapes are given back, and what a sensor does not see is not missed."""

import numpy as np
import pytest

from jaxmm.learning.upright_shapes import (
    circle_through,
    face_through,
    faces_of,
    is_round,
    line_through,
    rectangle_along,
    upright_along,
)


def turned(places, angle, shift=(0.0, 0.0)):
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    return places @ turn + shift


def run(length, count=40):
    """Points along x from 0."""
    return np.column_stack([np.linspace(0.0, length, count), np.zeros(count)])


def arc(radius, angle, count=60):
    turn = np.linspace(-angle / 2, angle / 2, count)
    return radius * np.column_stack([np.cos(turn), np.sin(turn)])


@pytest.mark.parametrize("seed", range(20))
def test_a_line_is_given_back_wherever_it_lies(seed):
    rng = np.random.default_rng(seed)
    angle, length, shift = rng.uniform(-3, 3), rng.uniform(0.5, 5), rng.uniform(-1e3, 1e3, 2)
    face = face_through(turned(run(length), angle, shift), np.arange(40))
    assert face.length == pytest.approx(length)
    np.testing.assert_allclose(np.abs(face.along @ [np.cos(angle), np.sin(angle)]), 1.0)
    ends = np.sort(turned(np.array([[0.0, 0.0], [length, 0.0]]), angle, shift), axis=0)
    np.testing.assert_allclose(np.sort(face.ends, axis=0), ends, atol=1e-9)
    np.testing.assert_allclose(face.across @ face.along, 0.0, atol=1e-12)


@pytest.mark.parametrize("seed", range(20))
def test_the_two_sides_of_a_corner_are_two_faces_at_any_angle(seed):
    rng = np.random.default_rng(seed)
    angle, lengths = rng.uniform(-3, 3), rng.uniform(0.6, 4.0, 2)
    sides = run(lengths[0], 80), turned(run(lengths[1], 81)[1:], np.pi / 2)
    places = turned(np.concatenate(sides), angle, rng.uniform(-9, 9, 2)) + rng.normal(0.0, 0.005, (160, 2))
    first, second = faces_of(places, 0.05, 0.5, 10)
    assert abs(first.along @ second.along) < 0.1
    np.testing.assert_allclose(sorted([first.length, second.length]), sorted(lengths), atol=0.15)
    assert not set(first.members) & set(second.members)


def test_a_gap_ends_a_run_and_few_points_are_none():
    places = np.concatenate([run(1.0), turned(run(1.0), 0.0, (1.6, 0.0)), turned(run(0.1, 5), 0.0, (4.0, 0.0))])
    assert sorted(len(face.members) for face in faces_of(places, 0.05, 0.5, 10)) == [40, 40]
    assert [len(face.members) for face in faces_of(places[:80], 0.05, 0.7, 10)] == [80]
    assert faces_of(places[:9], 0.05, 0.5, 10) == []
    assert faces_of(np.zeros((0, 2)), 0.05, 0.5, 10) == []


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("angle", [1.3, np.pi, 2 * np.pi - 0.2])
def test_a_circle_is_given_back_from_an_arc_of_it_with_noise_and_strays(seed, angle):
    rng = np.random.default_rng(seed)
    radius, center = rng.uniform(0.15, 0.65), rng.uniform(-1e3, 1e3, 2)
    places = turned(arc(radius, angle), rng.uniform(-3, 3), center)
    exact = circle_through(places, 0.02)
    np.testing.assert_allclose(exact.center, center, atol=1e-6)
    assert exact.radius == pytest.approx(radius, abs=1e-6)
    assert exact.arc == pytest.approx(angle, abs=0.02)
    assert exact.on.all()
    stray = center + rng.uniform(-0.3, 0.3, (3, 2)) * radius
    strayed = circle_through(np.concatenate([places, stray]), 0.02)
    if angle > 3:  # of a small arc with strays one cannot tell
        np.testing.assert_allclose(strayed.center, center, atol=0.03)
        assert strayed.on[:60].mean() > 0.9


def test_the_radius_is_right_on_average_where_a_third_of_the_circle_shows_with_noise():
    rng = np.random.default_rng(0)
    noisy = [circle_through(arc(0.4, 2.1, 80) + rng.normal(0.0, 0.02, (80, 2)), 0.06).radius for _ in range(200)]
    assert np.mean(noisy) == pytest.approx(0.4, rel=0.02)  # the algebraic circle alone is too small


def test_a_straight_line_is_no_circle():
    circle = circle_through(run(1.0), 0.05)
    assert circle is None or circle.on.mean() < 0.6  # it crosses one at best
    assert circle_through(run(1.0)[:4], 0.05) is None


@pytest.mark.parametrize("seed", range(10))
def test_a_rectangle_is_given_back_by_its_corners(seed):
    rng = np.random.default_rng(seed)
    angle, edges, center = rng.uniform(-3, 3), rng.uniform(0.2, 3.0, 2), rng.uniform(-1e3, 1e3, 2)
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) / 2 * edges
    found, size = rectangle_along(turned(corners, angle, center), np.array([np.cos(angle), np.sin(angle)]))
    np.testing.assert_allclose(found, center, atol=1e-9)
    np.testing.assert_allclose(size, edges, atol=1e-9)


def test_a_line_through_one_place_has_a_direction_all_the_same():
    center, along = line_through(np.ones((5, 2)))
    np.testing.assert_allclose(center, 1.0)
    assert np.linalg.norm(along) == pytest.approx(1.0)


@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_two_short_faces_say_how_their_rectangle_is_turned(noise):
    off = []
    for seed in range(300):
        rng = np.random.default_rng(seed)
        angle, a, b = rng.uniform(-3, 3), rng.uniform(0.2, 0.5), rng.uniform(0.2, 0.5)
        corner = np.concatenate([run(a, 1 + int(a / 0.08)), run(b, 1 + int(b / 0.08))[:, ::-1]])
        places = turned(np.repeat(corner, 10, axis=0), angle, rng.uniform(-9, 9, 2))
        along = upright_along(places + noise * rng.standard_normal(places.shape))
        turn = np.degrees(np.arctan2(along[1], along[0]) - angle) % 90.0
        off.append(min(turn, 90.0 - turn))
    assert np.max(off) <= (0.11 if not noise else 12.0) and np.mean(off) < (0.06 if not noise else 2.5)


@pytest.mark.parametrize("angle", np.linspace(-1.5, 1.5, 13))
def test_flanges_and_a_web_between_them_are_turned_as_the_flanges(angle):
    """Seen along its flanges: the whole of one, the edge of the other, and the web, which is inside of both."""
    rng = np.random.default_rng(3)
    flange, edge, web = run(0.3, 30), np.tile([0.0, 0.3], (4, 1)), run(0.28, 28)[:, ::-1] + [0.15, 0.01]
    places = turned(np.concatenate([np.repeat(one, 6, axis=0) for one in (flange, edge, web)]), angle, (4.0, -7.0))
    along = upright_along(places + 0.004 * rng.standard_normal(places.shape))
    off = np.degrees(np.arctan2(along[1], along[0]) - angle) % 90.0
    assert min(off, 90.0 - off) < 2.0


@pytest.mark.parametrize("corners", [3, 4, 6, 8, 9, 11, 13, 15, 16, 64])
def test_a_polygon_of_eight_corners_or_more_is_round(corners):
    for angle in np.linspace(0.0, 1.0, 7):
        ring = 0.3 * np.column_stack([np.cos(turn := 2 * np.pi * np.arange(corners) / corners), np.sin(turn)])
        solid = np.concatenate(
            [np.column_stack([turned(ring, angle, (1e4, -3.0)), np.full(corners, z)]) for z in (0, 3)]
        )
        assert is_round(solid) == (corners >= 8)
        assert not is_round(solid * [1.2, 1.0, 1.0])


def test_what_has_no_footprint_is_not_round():
    line = np.column_stack([np.arange(20.0), np.zeros(20), np.arange(20.0)])
    assert not is_round(line) and not is_round(np.zeros((20, 3))) and not is_round(np.zeros((0, 3)))
