"""Units are told by where a scan comes to lie."""

import numpy as np
import pytest

from jaxmm.inputs import InputError
from jaxmm.priors import distance_to, prior_of_cloud
from jaxmm.scan_units import UNITS, unit_of


def hall(seed=0, corner=(0.0, 0.0, 0.0)):
    """Points on the six sides of a hall of 12 x 7 x 3 m, and the distance to them."""
    rng = np.random.default_rng(seed)
    points = rng.random((20000, 3)) * [12, 7, 3]
    side = rng.integers(0, 3, 20000)
    points[np.arange(20000), side] = np.array([12, 7, 3])[side] * rng.integers(0, 2, 20000)
    points += corner
    prior = prior_of_cloud(points)
    return points, lambda some, reach: distance_to(prior, (some - prior.origin).astype(np.float32), reach)


@pytest.mark.parametrize("corner", [(0, 0, 0), (-6, -3.5, -1.5), (150_000, 470_000, 12)])
def test_metres_are_metres(corner):
    points, distance = hall(corner=corner)
    part = points[points[:, 0] < corner[0] + 8]
    assert unit_of(part, distance) == (1.0, None)


@pytest.mark.parametrize("factor, name", UNITS.items())
def test_other_units_are_named(factor, name):
    points, distance = hall(corner=(20, 30, 0))
    assert unit_of(points / factor, distance) == (factor, name)


def test_metres_near_the_origin_are_not_taken_for_millimetres():
    """Drawn together a thousandfold, any scan comes to lie on what is at the origin."""
    points, _ = hall(corner=(-6, -3.5, -1.5))
    pillar = prior_of_cloud(np.random.default_rng(0).random((500, 3)) * 0.3 + [0, 0, -0.1])
    with pytest.raises(InputError, match=r"expected a scan of the prior's place, got \d\.\d%"):
        unit_of(points, lambda some, reach: distance_to(pillar, some.astype(np.float32), reach))


def test_another_place_is_refused_in_one_line():
    points, distance = hall()
    with pytest.raises(InputError, match="place") as told:
        unit_of(points + np.array([500, 0, 0]), distance)
    assert "\n" not in str(told.value) and "--unit" in str(told.value)


@pytest.mark.parametrize("place", [(1.5, 1.5, 1.4), (6, 3.5, 1.4)])
def test_points_in_the_sensors_frame_are_not_taken_for_feet(place):
    """Drawn together to a third about the origin, they all come near the prior, but do not lie on it."""
    points, distance = hall()
    with pytest.raises(InputError, match="place"):
        assert unit_of((points - place)[points[:, 0] > 9] * 0.9 + [0, 0, 30], distance)
    assert unit_of(points - place, distance)[0] == 1.0
