"""The heights of floor and ceiling around a sensor in a building, wherever in it the sensor stands."""

import numpy as np
import pytest

from jaxmm.rays.scan_rays import ScanRays
from jaxmm.verdicts.floor_levels import levels_of
from tests.cases.box_building import building_of
from warp_scanner.scenes.scenes import CEILING, FLOOR, TABLE, WALL
from warp_scanner.sensors.triangles import prepare

FLOOR_AND_CEILING = (((0, 0, -0.1), (5, 4, 0.1), FLOOR), ((0, 0, 3.1), (5, 4, 0.1), CEILING))
OUTSIDE = (((0, 3.9, 1.5), (5, 0.1, 1.5), WALL), ((0, -3.9, 1.5), (5, 0.1, 1.5), WALL))
DOORWAY = (
    ((2, 0, 2.55), (0.1, 0.5, 0.45), WALL),  # over the door
    ((2, 2.2, 1.5), (0.1, 1.7, 1.5), WALL),
    ((2, -2.2, 1.5), (0.1, 1.7, 1.5), WALL),
)
TABLE_TOP = ((0, 0, 0.7), (0.6, 0.4, 0.02), TABLE)
STAIR_HOLE = (((-2.7, 0, -0.1), (2.3, 4, 0.1), FLOOR), ((2.7, 0, -0.1), (2.3, 4, 0.1), FLOOR))  # 0.8 m wide


def levels_at(place, *boxes, storeys=(0.0,)) -> tuple[float, float]:
    """Of a building of boxes, each with its middle [m], half its edges and its class."""
    nothing = np.zeros((0, 3), np.float32)
    rays = ScanRays(np.array(place, np.float64), nothing, np.zeros(0, np.float32), 0, nothing, 0.01, 100.0)
    measured = np.column_stack([np.zeros(101), np.zeros(101), np.linspace(0.3, 2.6, 101)])
    return levels_of(prepare(building_of(boxes).triangles), rays, measured, np.array(storeys))


@pytest.mark.parametrize(
    "place, boxes",
    [
        pytest.param((-3, 1, 1.5), (), id="in the room"),
        pytest.param((2, 0, 1.5), (*OUTSIDE, *DOORWAY), id="in a doorway"),
        pytest.param((0, 0, 1.2), (TABLE_TOP,), id="over a table"),
        pytest.param((-4.8, 3.6, 1.5), OUTSIDE, id="in a corner"),
    ],
)
def test_floor_and_ceiling_are_those_of_the_room(place, boxes):
    assert levels_at(place, *FLOOR_AND_CEILING, *boxes) == pytest.approx((0.0, 3.0), abs=1e-3)


def test_over_a_hole_the_floor_around_it_counts():
    assert levels_at((0, 0, 1.5), *STAIR_HOLE, FLOOR_AND_CEILING[1]) == pytest.approx((0.0, 3.0), abs=1e-3)


def test_the_storey_that_the_sensor_is_on_counts():
    upper = (((0, 0, 3.3), (5, 4, 0.1), FLOOR), ((0, 0, 6.3), (5, 4, 0.1), CEILING))
    lower = (FLOOR_AND_CEILING[0],)
    assert levels_at((1, 1, 4.6), *lower, *upper) == pytest.approx((3.4, 6.2), abs=1e-3)
    assert levels_at((1, 1, 1.5), *lower, *upper) == pytest.approx((0.0, 3.2), abs=1e-3)


def test_without_floors_walls_tell_and_without_walls_what_was_measured():
    assert levels_at((0, 0, 1.5), *OUTSIDE) == pytest.approx((0.0, 3.0), abs=1e-3)
    low, high = levels_at((0, 0, 1.5), ((4, 3, 0.2), (0.1, 0.1, 0.2), TABLE))
    assert 0.3 <= low < 0.6 and 2.3 < high <= 2.6


def test_a_storey_without_a_slab_has_its_floor_where_it_begins():
    """And a storey that begins beside the sensor, not far above its floor, is another's."""
    below = (FLOOR_AND_CEILING[0],)
    assert levels_at((0, 0, 4.6), *below, *OUTSIDE, storeys=(0.0, 3.4, 6.8))[0] == pytest.approx(3.4)
    assert levels_at((0, 0, 2.2), *below, *OUTSIDE, storeys=(0.0, 1.5, 3.4))[0] == pytest.approx(0.0, abs=1e-3)
    assert levels_at((0, 0, 4.6), *below, *OUTSIDE, storeys=(0.0, 6.8))[0] == pytest.approx(0.0, abs=1e-3)
    landing = levels_at((0, 0, 3.2), *below, *OUTSIDE, storeys=(0.0, 3.0))  # below a storey's floor, on a stair
    assert landing[0] == pytest.approx(0.0, abs=1e-3)
