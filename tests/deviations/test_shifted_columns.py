"""Points about columns, found by squares; and how far off a column is that was found beside its place."""

import numpy as np
import pytest

from jaxmm.deviations.deviation import Deviation, deviations_by, faces_of, shifted
from jaxmm.deviations.pose_errors import EXACT
from jaxmm.deviations.shifted_columns import Beside, Shift, _Squares, beside_columns, shifts_of
from tests.cases.box_building import building_of
from tests.deviations.test_deviation import COLUMN, HALL, hall, moved, seen
from warp_scanner.scenes.scenes import PILLAR
from warp_scanner.sensors.triangles import prepare


@pytest.mark.parametrize("seed", range(3))
def test_all_places_within_corners_are_found_and_none_twice(seed):
    rng = np.random.default_rng(seed)
    places = (rng.uniform(-7.0, 9.0, (4000, 2)) + rng.choice((0.0, 5000.0))).astype(np.float32)
    squares = _Squares(places)
    for _ in range(100):
        first = places[rng.integers(len(places))] - rng.uniform(0.0, 3.0, 2)
        last = first + rng.uniform(0.2, 6.0, 2)
        found = squares.between(first, last)
        inside = np.flatnonzero(np.all((places > first) & (places < last), axis=1))
        assert np.isin(inside, found).all() and len(np.unique(found)) == len(found)
        first, last = np.maximum([first, last], places.min(axis=0))  # beyond all places the outermost squares are taken
        away = np.maximum(first - places[found], places[found] - last)
        assert not len(found) or away.max() < 0.51


def test_without_a_place_none_is_found():
    assert not len(_Squares(np.zeros((0, 2), np.float32)).between(np.zeros(2), np.ones(2)))
    beside = _Squares(np.ones((5, 2), np.float32)).between(np.full(2, -9.0), np.full(2, -8.0))
    assert len(beside) == 5  # of the outermost square


@pytest.mark.parametrize("leans", [0.0, 0.015])
def test_a_rough_shaft_is_no_farther_off_than_a_smooth_one(leans):
    """What its ends are surely off where it was found adds to that; ranges that err do not."""
    shift, none = Shift(np.array([0.05, 0.0, 0.0]), np.array([0.02, 0.01])), (0.0, 0.0, 0.0)
    smooth, rough = (
        shifted(
            Deviation(none, (None, None, None), 0.0, (1.0, 0.0, 0.0), None, None, flatness, 1.0, 900, {}, half=0.004,
                      worst=leans and leans + 0.004),
            shift,
        )
        for flatness in (0.0, 0.03)
    )  # fmt: skip
    assert smooth.surely == rough.surely == pytest.approx(0.05 + leans - 0.02)


def test_what_a_pose_alone_shifted_is_in_its_place():
    """A column that shows beside its place for the pose is off by as much the other way there: neither end is off."""
    shift = Shift(np.array([0.16, 0.0, 0.0]), np.array([0.02, 0.02]))
    there = Deviation(
        (-0.16, 0.0, 0.0), ((-0.161, -0.159), None, None), -0.16, (1.0, 0.0, 0.0), None, None, 0.0, 0.0, 900, {},
        half=0.001, worst=0.161,
    )  # fmt: skip
    assert shifted(there, shift).surely == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("left, found", [(30, True), (24, True), (15, False)])
def test_few_points_find_a_column_where_they_all_lie_on_it(left, found):
    """Far away, or behind furniture, little of it shows; of what lies elsewhere as well it is not told."""
    scene, rng, step = prepare(hall()), np.random.default_rng(left), (0.1, -0.1, 0.0)
    points = beside_columns(scene, seen(moved(hall(), COLUMN, step)), 0.3).of(COLUMN)
    few = rng.permutation(points)[:left]
    mixed = np.concatenate([few, few[: left // 4] + np.float32([0.3, 0.25, 0.0])])
    for own, is_told in ((few, found), (mixed, False)):
        beside = Beside(np.array([COLUMN]), own, np.array([0, len(own)]))
        shift = shifts_of(scene, [beside], np.array([COLUMN]), 0.3).get(COLUMN)
        assert (shift is not None) == is_told
        assert shift is None or np.all(np.abs(shift.step[:2] - step[:2]) <= shift.half + 0.02)


def test_a_narrow_face_is_told_though_settled_ranges_turn_it():
    """They cut corners: the face of a column 0.2 m wide looks turned by 14 degrees, but as measured it is not."""
    model = building_of((*HALL[:COLUMN], ((-3.5, -2.0, 1.5), (0.1, 0.1, 1.5), PILLAR))).triangles
    scene, rays = prepare(model), seen(moved(model, COLUMN, (0.004, 0.0, 0.0)))
    end = rays.position + rays.direction * rays.distance[:, None]
    face = (np.abs(end[:, 0] + 3.396) < 0.005) & (np.abs(end[:, 1] + 2.0) < 0.1)
    bent = np.where(face, 0.25 * (end[:, 1] + 2.0) / np.abs(rays.direction[:, 0]), 0.0).astype(np.float32)
    shown = faces_of(scene, rays._replace(distance=rays.distance - bent), EXACT, rays.distance[: rays.measured])
    one = deviations_by(scene, [shown], np.full(len(HALL), 0.03))[COLUMN]
    assert one.offset[0] == pytest.approx(0.004, abs=1e-3) and abs(one.turn or 0.0) < 1.0
