"""Things that are in no model: how points become boxes."""

import numpy as np
import pytest

from jaxmm.classes.unexplained import UnexplainedSettings, unexplained_things


def box_points(center, size, yaw, step=0.05):
    """Points inside an upright box, evenly; the outermost on its faces."""
    axes = [np.linspace(-edge / 2, edge / 2, round(edge / step) + 1) for edge in size]
    x, y, z = (one.ravel() for one in np.meshgrid(*axes))
    c, s = np.cos(np.radians(yaw)), np.sin(np.radians(yaw))
    return np.stack([c * x - s * y, s * x + c * y, z], axis=1) + center


@pytest.mark.parametrize("yaw", [0.0, 20.0, 63.0, -45.0, 89.0])
def test_a_box_comes_back_however_it_is_turned(yaw):
    size = np.array([1.2, 0.5, 0.9])
    (found,) = unexplained_things(box_points([3.0, -2.0, 1.0], size, yaw), UnexplainedSettings())
    assert np.allclose(found.center, [3.0, -2.0, 1.0], atol=0.08)
    turned = abs((found.rotation - yaw + 45.0) % 90.0 - 45.0)
    assert turned < 6.0 and np.allclose(np.sort(found.dimensions[:2]), [0.5, 1.2], atol=0.16)
    assert found.dimensions[2] == pytest.approx(0.9, abs=0.11)
    assert -90.0 <= found.rotation < 90.0 and found.points > 100


@pytest.mark.parametrize("yaw", [0.0, 20.0, 63.0, -45.0])
@pytest.mark.parametrize("size", [(1.2, 0.6), (1.2, 0.4), (2.0, 0.6)])
def test_of_two_faces_that_are_seen_the_box_lies_along_them(size, yaw):
    """The smallest box around them stands askew, on their ends."""
    rng = np.random.default_rng(2)
    for _ in range(10):
        faces = box_points([0, 0, 0], [*size, 1.8], 0.0)
        faces = faces[(faces[:, 0] > size[0] / 2 - 1e-6) | (faces[:, 1] > size[1] / 2 - 1e-6)]
        c, s = np.cos(np.radians(yaw)), np.sin(np.radians(yaw))
        faces = (faces + rng.normal(0.0, 0.006, faces.shape)) @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
        (found,) = unexplained_things(faces + rng.uniform(-1.0, 1.0, 3), UnexplainedSettings())
        assert abs((found.rotation - yaw + 45.0) % 90.0 - 45.0) < 8.0
        assert np.allclose(np.sort(found.dimensions[:2]), np.sort(size), atol=0.16)


def test_things_apart_are_told_apart_the_larger_first():
    small, large = box_points([0, 0, 0], [0.5, 0.5, 0.5], 0), box_points([2, 0, 0], [1, 1, 1], 30)
    found = unexplained_things(np.concatenate([small, large]), UnexplainedSettings())
    assert [round(float(one.center[0])) for one in found] == [2, 0] and found[0].points > found[1].points


@pytest.mark.parametrize(
    "points, settings",
    [
        pytest.param(np.zeros((0, 3)), {}, id="nothing"),
        pytest.param(np.zeros((500, 3)), {}, id="one place"),
        pytest.param(box_points([0, 0, 0], [0.2, 0.2, 0.2], 0), {"least_points": 1}, id="small"),
        pytest.param(np.random.default_rng(0).uniform(-20, 20, (500, 3)), {}, id="stray points"),
        pytest.param(box_points([0, 0, 0], [1, 1, 1], 0), {"least_points": 10_000}, id="too few"),
    ],
)
def test_what_is_small_or_scattered_is_nothing(points, settings):
    assert unexplained_things(points, UnexplainedSettings(**settings)) == ()


def test_an_upright_sheet_has_a_box_and_the_order_of_points_changes_nothing():
    sheet = box_points([1, 2, 1], [2.0, 1e-9, 1.5], 35.0)
    (found,) = unexplained_things(sheet, UnexplainedSettings())
    assert found.dimensions.max() == pytest.approx(2.0, abs=0.15) and sorted(found.dimensions)[0] < 0.15
    rng = np.random.default_rng(1)
    (again,) = unexplained_things(np.tile(sheet, (3, 1))[rng.permutation(3 * len(sheet))], UnexplainedSettings())
    assert again.points == found.points and np.allclose(again.center, found.center, atol=0.1)
