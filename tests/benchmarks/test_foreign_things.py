"""Foreign things are solids that stand in the room, and what is said of probabilities is what is counted."""

from collections import Counter

import numpy as np
import pytest

from benchmarks.pillars import _ece, _risk
from benchmarks.views.foreign_things import GAP, KINDS, Thing, standing, thing_of, with_things
from warp_scanner.scenes.building import Triangles
from warp_scanner.scenes.scenes import TABLE, WALL


@pytest.mark.parametrize("kind", KINDS)
def test_things_are_closed_and_stand_between_floor_and_ceiling(kind):
    for seed in range(30):
        ceiling = 2.3 + 0.05 * seed
        vertices, faces = KINDS[kind](np.random.default_rng(seed), ceiling - GAP)
        assert abs(vertices[:, 2].min()) < 1e-9 and vertices[:, 2].max() < ceiling
        assert set(np.unique(faces)) == set(range(len(vertices)))
        edges = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        assert set(Counter(map(tuple, edges)).values()) == {2}  # each between two triangles: no holes


def test_all_kinds_are_drawn_and_stand_where_they_are_put():
    rng = np.random.default_rng(0)
    things = [thing_of(rng, 2.7) for _ in range(100)]
    assert {one.kind for one in things} == set(KINDS)
    put = standing(Thing("box", *KINDS["box"](rng, 2.5)), np.array([3.0, -2.0]), 0.3)
    np.testing.assert_allclose(put.vertices[:, :2].mean(axis=0), [3.0, -2.0], atol=1e-9)


def test_a_building_keeps_its_own_elements_before_them():
    corners, one = np.eye(3, dtype=np.float32), np.array([[0, 1, 2]], np.int32)
    own = Triangles(corners, one, np.zeros(1, np.int32), np.array([WALL]))
    box = Thing("box", *KINDS["box"](np.random.default_rng(0), 2.5))
    found = with_things(own, [box, box])
    assert found.semantic.tolist() == [WALL, TABLE, TABLE] and found.element.tolist() == [0] + [1] * 12 + [2] * 12
    np.testing.assert_allclose(found.vertices[found.faces[13:]], box.vertices[box.faces], atol=1e-6)
    np.testing.assert_array_equal(found.faces[0], own.faces[0])


def test_calibration_and_risk_are_what_is_counted():
    sure, right = np.full(10, 0.95), np.arange(10) < 5
    assert _ece(sure, right) == pytest.approx(0.45)
    assert _ece(np.repeat([0.25, 0.75], 4), np.array([1, 0, 0, 0, 1, 1, 1, 0], bool)) == pytest.approx(0.0)
    assert _ece(np.zeros(0), np.zeros(0, bool)) == 0.0
    assert _risk(np.array([0.9, 0.8, 0.7, 0.6]), np.array([1, 1, 0, 0], bool), 0.5) == "0.00"
    assert _risk(np.array([0.9, 0.8, 0.7, 0.6]), np.array([1, 1, 0, 0], bool), 1.0) == "0.50"
