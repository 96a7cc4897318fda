"""One element moved: where its corners come to lie, and that nothing else moves."""

import numpy as np
from scipy.spatial.transform import Rotation

from tests.cases.box_building import building_of
from warp_scanner.scenes.building import element_bounds
from warp_scanner.scenes.building_edits import move_element
from warp_scanner.scenes.scenes import WALL
from warp_scanner.sensors.triangles import prepare_part

BOXES = (((0, 0, 1.0), (2.0, 0.1, 1.0), WALL), ((3, 1, 1.0), (0.1, 1.0, 1.0), WALL))


def test_a_step_and_a_turn_are_about_the_middle_or_a_place():
    rng = np.random.default_rng(0)
    triangles = building_of(BOXES).triangles
    own = triangles.vertices[triangles.faces[triangles.element == 1]].astype(np.float64)
    for about in (None, rng.normal(size=3)):
        step, turn = rng.normal(size=3), rng.normal(size=3)
        found = move_element(triangles, 1, step, turn, about)
        middle = np.array([3.0, 1.0, 1.0]) if about is None else about
        wanted = Rotation.from_rotvec(turn).apply((own - middle).reshape(-1, 3)).reshape(own.shape) + middle + step
        np.testing.assert_allclose(found.vertices[found.faces[found.element == 1]], wanted, atol=1e-5)
        other = found.element == 0
        np.testing.assert_array_equal(
            found.vertices[found.faces[other]], triangles.vertices[triangles.faces[other]]
        )  # as exact as it was


def test_corners_that_two_elements_share_stay_with_the_other():
    triangles = building_of(BOXES[:1]).triangles
    shared = triangles._replace(
        element=(np.arange(len(triangles.faces)) % 2).astype(np.int32), semantic=np.uint8([WALL, WALL])
    )
    found = move_element(shared, 1, np.array([9.0, 0.0, 0.0]), np.zeros(3))
    before, after = (element_bounds(one) for one in (shared, found))
    np.testing.assert_array_equal(after[1][0], before[1][0])
    np.testing.assert_allclose(after[1][1], before[1][1] + [9.0, 0.0, 0.0])


def test_a_part_keeps_the_numbers_of_its_elements():
    triangles = building_of(BOXES).triangles
    part = prepare_part(triangles, triangles.element == 1)
    assert set(part.triangles.element.tolist()) == {1} and len(part.triangles.semantic) == 2
