"""What ends on a surface that two elements have in common tells of neither, where one's own surface is empty."""

import numpy as np
import pytest

from jaxmm.rays.hits import hits_of
from jaxmm.rays.scan_rays import PosedScan, rays_of_scan
from jaxmm.rays.shared_ends import LEAST_OWN, shared_rays
from tests.cases.box_building import building_of
from warp_scanner.scenes.scenes import OTHER, WALL
from warp_scanner.sensors.scan import Rays
from warp_scanner.sensors.sensors import OUSTER_64
from warp_scanner.sensors.triangles import cast_triangles, prepare

PLACE = np.array([0.0, 0.0, 1.5])
# In one line, the same faces, and 0.4 m of each is also the other's.
LEFT, RIGHT = ((-1.8, 3.1, 1.5), (2.0, 0.1, 1.5), WALL), ((1.8, 3.1, 1.5), (2.0, 0.1, 1.5), WALL)
BEHIND = ((0.0, 8.0, 1.5), (5.0, 0.1, 1.5), WALL)  # so that rays come back from behind what is gone


def shared(there, boxes=(LEFT, RIGHT)):
    """Which of the rays that should meet each element tell nothing of it: (n,) bool by element, and where they end."""
    direction = OUSTER_64.directions()
    reach = cast_triangles(prepare(building_of(there).triangles), Rays(PLACE[None], direction)).distance[0]
    back = np.isfinite(reach)
    points = (PLACE + direction[back] * reach[back, None].astype(np.float64)).astype(np.float32)
    rays = rays_of_scan(PosedScan(points, PLACE, np.eye(3), OUSTER_64))
    scene = prepare(building_of(boxes).triangles)
    expected = hits_of(scene, rays.position, rays.direction)
    found = shared_rays(scene, rays, expected)
    ends = rays.position + rays.direction * np.minimum(rays.distance, 1e3)[:, None]
    return [(found[expected.element == row], ends[expected.element == row]) for row in range(len(boxes))]


@pytest.mark.parametrize("behind", [(), (BEHIND,)], ids=["nothing comes back", "something behind"])
def test_the_common_piece_of_two_walls_tells_nothing_of_the_one_that_is_gone(behind):
    for gone, stands in ((0, 1), (1, 0)):
        walls = [LEFT, RIGHT]
        del walls[gone]
        found = shared((*walls, *behind))
        mine, ends = found[gone]
        on_it = np.abs(ends[:, 1] - 3.0) < 0.01
        assert np.array_equal(mine, on_it) and np.all(np.abs(ends[mine, 0]) < 0.2 + 1e-3)
        assert not found[stands][0].any()
        # Of what both have, either may be the one that rays meet first.
        assert on_it.sum() + np.sum(np.abs(found[stands][1][:, 0]) < 0.2) > 5 * LEAST_OWN


@pytest.mark.parametrize("behind", [(), (BEHIND,)])
def test_of_walls_that_stand_all_rays_tell(behind):
    assert not any(mine.any() for mine, _ in shared((LEFT, RIGHT, *behind)))


def test_of_what_has_nothing_of_its_own_nobody_knows_better():
    """A sheet on a wall, within what ranges err by: that it is gone cannot be told, nor that it stands."""
    sheet = ((0.0, 2.995, 1.5), (0.5, 0.005, 0.5), OTHER)
    boxes = (LEFT, RIGHT, sheet)
    assert not shared((LEFT, RIGHT), boxes)[2][0].any()
    assert not shared((BEHIND,), boxes)[2][0].any()


def test_a_wall_with_a_hole_that_the_model_lacks_keeps_what_it_shares():
    """A third of its own surface is seen through, and two thirds end rays."""
    parts = (((-2.9, 3.1, 1.5), (0.9, 0.1, 1.5), WALL), ((-0.4, 3.1, 1.5), (0.6, 0.1, 1.5), WALL))
    assert not any(mine.any() for mine, _ in shared((*parts, RIGHT, BEHIND)))
