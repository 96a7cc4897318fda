"""Upright boxes around elements: known boxes in any turn, and what is always true of them."""

import numpy as np
import pytest
import trimesh

from jaxmm.learning.element_boxes import UprightBox, box_around, boxes_of


def turned(box: UprightBox) -> np.ndarray:
    """(8, 3) its corners."""
    low, high = (box.center[2] + way * box.dimensions[2] / 2 for way in (-1, 1))
    return np.array([(*corner, z) for corner in box.corners for z in (low, high)])


@pytest.mark.parametrize("angle", [0.0, 30.0, 89.9, -45.5, -90.0, 12.345])
def test_the_box_of_a_box_is_that_box(angle):
    box = UprightBox((155000.0, -3.5, 1.5), (4.0, 0.2, 3.0), angle)
    found = box_around(turned(box))
    np.testing.assert_allclose(found.center, box.center, atol=1e-6)
    np.testing.assert_allclose(found.dimensions, box.dimensions, atol=1e-6)
    assert abs((found.rotation - angle + 90.0) % 180.0 - 90.0) < 1e-4


@pytest.mark.parametrize("seed", range(20))
def test_it_holds_all_points_and_is_no_larger_than_any_other(seed):
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(rng.integers(3, 60), 3)) * rng.uniform(0.1, 5, 3)
    found = box_around(points)
    angle = np.radians(found.rotation)
    axes = np.array([[np.cos(angle), np.sin(angle), 0], [-np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    inside = (points - found.center) @ axes.T
    assert (np.abs(inside) <= np.array(found.dimensions) / 2 + 1e-9).all()
    assert found.dimensions[0] >= found.dimensions[1] and -90.0 <= found.rotation < 90.0
    area = found.dimensions[0] * found.dimensions[1]
    assert area <= trimesh.bounds.oriented_bounds_2D(points[:, :2])[1].prod() + 1e-9
    for other in np.radians(np.arange(0.0, 90.0, 0.5)):
        way = np.array([[np.cos(other), np.sin(other)], [-np.sin(other), np.cos(other)]])
        assert area <= np.prod(np.ptp(points[:, :2] @ way.T, axis=0)) + 1e-9


def test_flat_and_single_points_have_boxes():
    upright = np.array([[0.0, 0.0, 0.0], [3.0, 4.0, 0.0], [3.0, 4.0, 2.0], [0.0, 0.0, 2.0]])
    found = box_around(upright)
    np.testing.assert_allclose(found.dimensions, (5.0, 0.0, 2.0), atol=1e-9)
    assert found.rotation == pytest.approx(np.degrees(np.arctan2(4.0, 3.0)))
    assert box_around(np.ones((1, 3))) == UprightBox((1.0, 1.0, 1.0), (0.0, 0.0, 0.0), 0.0)


def test_each_element_gets_its_own_and_one_without_triangles_none():
    meshes = [trimesh.creation.box((1.0, 2.0, 3.0)).apply_translation((10.0 * n, 0, 0)) for n in range(3)]
    vertices = np.concatenate([one.vertices for one in meshes]).astype(np.float32)
    faces = np.concatenate([one.faces + 8 * n for n, one in enumerate(meshes)])
    element = np.repeat([4, 0, 2], 12)
    shuffled = np.random.default_rng(0).permutation(36)
    found = boxes_of(vertices, faces[shuffled], element[shuffled], np.array([0, 1, 2, 4]))
    assert found[1] is None
    assert [one.center for one in found if one] == [(10.0, 0.0, 0.0), (20.0, 0.0, 0.0), (0.0, 0.0, 0.0)]
    assert {one.dimensions for one in found if one} == {(2.0, 1.0, 3.0)}
    assert found[0].shifted(np.array([1.0, 2.0, 3.0])).center == (11.0, 2.0, 3.0)
