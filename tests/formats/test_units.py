"""Units are told by where a scan comes to lie."""

import numpy as np
import pytest

from jaxmm.formats.units import LEAST_OVERLAP, UNITS, fit_of, scale_in_words
from jaxmm.verdicts.priors import distance_from, prior_of_building, prior_of_cloud
from warp_scanner.buildings.room_buildings import building_of_room
from warp_scanner.scenes.scenes import BOX, FLOOR, WALL, Primitives


def hall(size=(12, 7, 3), corner=(0.0, 0.0, 0.0)):
    """Points on the six sides of a hall, and the distance to them."""
    rng = np.random.default_rng(0)
    points = rng.random((20000, 3)) * size
    side = rng.integers(0, 3, 20000)
    points[np.arange(20000), side] = np.array(size)[side] * rng.integers(0, 2, 20000)
    points += corner
    return points, distance_from(prior_of_cloud(points))


@pytest.mark.parametrize("corner", [(0, 0, 0), (-6, -3.5, -1.5), (150_000, 470_000, 12)])
def test_metres_are_metres(corner):
    points, distance = hall(corner=corner)
    part = points[points[:, 0] < corner[0] + 8]
    fit = fit_of(part, distance)
    assert fit.unit == 1.0 and fit.share > 0.99 and fit.on > 0.9


@pytest.mark.parametrize("factor", UNITS)
def test_other_units_are_told(factor):
    """Of the whole hall, and of what a camera sees of its lower half."""
    points, distance = hall(corner=(20, 30, 0))
    assert fit_of(points / factor, distance).unit == factor
    part = points[(points[:, 0] > 27) & (points[:, 2] < 1.8)]
    assert fit_of(part / factor, distance).unit == factor
    assert fit_of(part / factor, distance, factor).on > 0.9


@pytest.mark.parametrize("storeys", [1, 14])
@pytest.mark.parametrize("corner", [(-5, -4, 0), (0, 0, 0)])
@pytest.mark.parametrize("inside", [0.5, 0.4, 0.3, 0.2, 0.08])
def test_metres_among_wide_ground_are_metres(inside, corner, storeys):
    """Drawn together to its origin, flat ground would lie on the floor of a building, and all else near it."""
    prior = prior_of_building(building_of_room(plain_house(corner, 3 * storeys), 0)[0])
    rng = np.random.default_rng(0)
    reach, turn = 60 * np.sqrt(rng.random(60000)), rng.uniform(0, 2 * np.pi, 60000)
    ground = np.column_stack([reach * np.cos(turn), reach * np.sin(turn), rng.normal(0, 0.02, 60000)])
    house = hall(size=(10, 8, 3 * storeys), corner=corner)[0]
    outside = ((ground[:, :2] < corner[:2]) | (ground[:, :2] > np.add(corner[:2], (10, 8)))).any(axis=1)
    ground = ground[outside][: round(len(house) * (1 - inside) / inside)]
    ground[::100, 2] = 90.0  # birds
    points = rng.permutation(np.concatenate([house[: round(len(ground) * inside / (1 - inside))], ground]))
    assert len(ground) / len(points) == pytest.approx(1 - inside, abs=0.01)
    fit = fit_of(points, distance_from(prior))
    assert fit.unit == 1.0 and fit.on == pytest.approx(inside, abs=0.03)


def plain_house(corner, height):
    """Four walls, a floor and a roof of 10 x 8 m, of no thickness worth the word."""
    size = np.array([[10, 8, 0.02], *[[10, 0.02, height]] * 2, *[[0.02, 8, height]] * 2, [10, 8, 0.02]]) / 2
    walls = [[x, y, height / 2] for x, y in ((5, 0), (5, 8), (0, 4), (10, 4))]
    place = np.array([[5, 4, 0], *walls, [5, 4, height]]) + corner
    return Primitives(
        np.full((1, 6), BOX, np.uint8), place[None].astype(np.float32), size[None].astype(np.float32),
        np.zeros((1, 6), np.float32), np.arange(6, dtype=np.int32)[None],
        np.array([[FLOOR, WALL, WALL, WALL, WALL, FLOOR]], np.uint8),
    )  # fmt: skip


def test_metres_near_the_origin_are_not_taken_for_millimetres():
    """Drawn together a thousandfold, any scan comes to lie on what is at the origin."""
    points, _ = hall(corner=(-6, -3.5, -1.5))
    pillar = prior_of_cloud(np.random.default_rng(0).random((500, 3)) * 0.3 + [0, 0, -0.1])
    fit = fit_of(points, distance_from(pillar))
    assert fit.unit == 1.0 and fit.share < LEAST_OVERLAP


def test_another_place_does_not_fit():
    points, distance = hall()
    assert fit_of(points + np.array([500, 0, 0]), distance) == (1.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize("place", [(1.5, 1.5, 1.4), (6, 3.5, 1.4)])
def test_points_in_the_sensors_frame_are_not_taken_for_feet(place):
    """Drawn together to a third about the origin, they all come near the prior, but do not lie on it."""
    points, distance = hall()
    elsewhere = fit_of((points - place)[points[:, 0] > 9] * 0.9 + [0, 0, 30], distance)
    assert elsewhere.unit == 1.0 and elsewhere.share < LEAST_OVERLAP
    assert fit_of(points - place, distance).unit == 1.0


@pytest.mark.parametrize(
    "factor, unit, words",
    [
        (0.9144, 1.0, "0.914 times its size: are its units yards (--unit 0.9144)?"),
        (1000.4, 0.001, "1000 times its size: are its units metres (--unit 1)?"),
        (1.1, 1.0, "1.1 times its size: check its unit (--unit 1.1 would fit), and that of the prior (--prior-unit)"),
    ],
)
def test_another_size_is_told_in_plain_numbers(factor, unit, words):
    assert scale_in_words(factor, unit) == f"at {words}"
