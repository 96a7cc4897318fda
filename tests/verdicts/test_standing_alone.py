"""One object as if it stood alone: counts by hand."""

import numpy as np
import pytest

from jaxmm.learning.boxes import Box
from jaxmm.rays.scan_rays import ScanRays
from jaxmm.verdicts import standing_alone
from tests.cases.box_building import building_of
from warp_scanner.scenes.building import Triangles
from warp_scanner.scenes.scenes import BOX, WALL, Primitives, scene_mesh
from warp_scanner.sensors.scan import Rays
from warp_scanner.sensors.triangles import cast_triangles, prepare


def rays(distance, spread=0.5, count=41, limit=np.inf):
    """A fan of level rays along x, all of one range or of given ones."""
    turn = np.linspace(-spread, spread, count)
    direction = np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1).astype(np.float32)
    distance = np.broadcast_to(np.asarray(distance, np.float32), count).copy()
    return ScanRays(np.zeros(3), direction, distance, count, direction, 0.02, limit)


def pillar(x=3.0, edge=1.0, yaw=0.0, shape="rectangular"):
    return Box("pillar", np.array([x, 0.0, 0.0]), np.array([edge, edge, 3.0]), yaw, shape)


def face(box, scan):
    """Ranges to the near face of an upright box that faces the sensor."""
    return ((box.center[0] - box.dimensions[0] / 2) / scan.direction[:, 0]).astype(np.float32)


def test_rays_that_end_on_a_new_object_tell_and_those_that_pass_do_not():
    scan, box = rays(8.0), pillar()
    reach = face(box, scan)
    meets = np.abs(scan.direction[:, 1] * reach) < 0.5
    found = standing_alone.of_box(box, np.full(41, 8.0), scan._replace(distance=np.where(meets, reach, 8.0)))
    assert found.would_meet == pytest.approx(meets.sum(), abs=2) and found.deny == 0
    assert found.tell == pytest.approx(found.would_meet, abs=2)


def test_rays_through_the_place_deny_a_new_object_and_tell_that_one_is_gone():
    scan, box = rays(8.0), pillar()
    assert standing_alone.of_box(box, np.full(41, 8.0), scan).deny > 5
    assert standing_alone.of_box(box, np.full(41, 8.0), scan).tell == 0
    gone = standing_alone.of_gone_box(box, scan)
    assert gone.tell > 5 and gone.deny == 0


def test_rays_below_or_above_what_is_seen_of_a_wall_pass_an_opening_and_others_deny_it():
    """A wall of 4 m across the view, of which a metre on either side of an opening is met."""
    box, scan = Box("wall", np.array([3.0, 0.0, 0.0]), np.array([4.0, 0.2, 3.0]), 90.0), rays(8.0)
    reach = 2.9 / scan.direction[:, 0]
    across = reach * scan.direction[:, 1]
    solid = (np.abs(across) > 0.4) & (np.abs(across) < 1.4)
    scan = scan._replace(distance=np.where(solid, reach, 8.0).astype(np.float32))
    along = np.arange(-1.4, 1.41, 0.1)  # with a sill below the opening, and without one
    sill, gap = (
        standing_alone.of_box(box, np.full(41, 8.0), scan, face) for face in (along, along[np.abs(along) > 0.4])
    )
    none = standing_alone.of_box(box, np.full(41, 8.0), scan)
    assert sill.deny == sill.through == gap.deny == none.deny > 5 and none.through == 0
    assert gap.through <= 2 and standing_alone.of_box(box, np.full(41, 8.0), scan, np.zeros(0)).through == 0
    assert sill.tell == pytest.approx(solid.sum(), abs=1)


def test_floor_and_ceiling_around_the_ends_of_a_gone_object_do_not_deny_it():
    """Rays that fan out in height: those next to the box's lower end meet the floor just before or within it."""
    tilt = np.linspace(-0.7, 0.7, 141)
    direction = np.stack([np.cos(tilt), 0 * tilt, np.sin(tilt)], axis=1).astype(np.float32)
    with np.errstate(divide="ignore"):
        distance = np.minimum(8.0 / direction[:, 0], 1.5 / np.abs(direction[:, 2])).astype(np.float32)
    scan = ScanRays(np.zeros(3), direction, distance, 141, direction, 0.01, np.inf)
    found = standing_alone.of_gone_box(pillar(), scan)
    assert found.tell > 20 and found.deny == 0
    on_it = np.minimum(2.5 / direction[:, 0], 1.5 / np.abs(direction[:, 2])).astype(np.float32)
    assert standing_alone.of_gone_box(pillar(), scan._replace(distance=on_it)).deny > 20


def test_what_ends_before_it_or_nowhere_says_nothing():
    for distance in (1.0, np.inf):
        for found in (
            standing_alone.of_box(pillar(), np.full(41, 8.0), rays(distance)),
            standing_alone.of_gone_box(pillar(), rays(distance)),
        ):
            assert found.tell == found.deny == 0 and found.would_meet > 10


def test_a_round_object_is_narrower_at_its_sides():
    square, circle = (
        standing_alone.of_box(pillar(shape=shape), np.full(41, 8.0), rays(8.0)) for shape in ("rectangular", "round")
    )
    assert circle.would_meet < square.would_meet


def test_beyond_the_sensors_reach_nothing_would_be_met():
    assert standing_alone.of_box(pillar(), np.full(41, 8.0), rays(np.inf, limit=2.0)).would_meet == 0


@pytest.mark.parametrize("distance, tell, deny", [(8.0, True, False), (2.5, False, True), (1.0, False, False)])
def test_an_element_of_a_building(distance, tell, deny):
    one = Primitives(
        np.array([[BOX, BOX]], np.uint8), np.array([[[3, 0, 0], [6, 0, 0]]], np.float32),
        np.array([[[0.5, 0.5, 1.5], [0.1, 5, 1.5]]], np.float32), np.zeros((1, 2), np.float32),
        np.array([[0, 1]], np.int32), np.full((1, 2), WALL, np.uint8),
    )  # fmt: skip
    vertices, faces, slot = scene_mesh(one, 0)
    scene = prepare(
        Triangles(
            vertices.astype(np.float32), faces.astype(np.int32), slot.astype(np.int32), np.full(2, WALL, np.uint8)
        )
    )
    scan = rays(distance, spread=0.1)
    if distance == 2.5:
        scan = scan._replace(distance=(2.5 / scan.direction[:, 0]).astype(np.float32))
    found = standing_alone.of_element(scene, 0, scan)
    assert found.would_meet == 41 and (found.tell == 41) == tell and (found.deny == 41) == deny


@pytest.mark.parametrize("half", [0.0, 0.75])  # [m] half the height of what still stands of it
def test_rays_that_end_on_what_touches_a_gone_element_do_not_deny_that_it_is_gone(half):
    gone = ((3.0, 0.0, 0.0), (0.5, 0.5, 1.5), WALL)
    beside = ((3.0, 0.6, 0.0), (0.5, 0.1, 1.5), WALL)  # its face is where that of the gone one ends
    still = ((3.0, 0.0, -1.5 + half), (0.5, 0.5, half), WALL)
    turn, up = (axis.ravel() for axis in np.meshgrid(np.linspace(-0.25, 0.25, 2001), (-0.3, 0.0, 0.3)))
    direction = np.stack([np.cos(turn) * np.cos(up), np.sin(turn) * np.cos(up), np.sin(up)], axis=1).astype(np.float32)
    behind = ((6.0, 0.0, 0.0), (0.1, 5.0, 5.0), WALL)
    real = prepare(building_of((beside, behind, *((still,) if half else ()))).triangles)
    distance = cast_triangles(real, Rays(np.zeros((1, 3)), direction)).distance[0]
    scan = ScanRays(np.zeros(3), direction, distance, len(distance), direction, 0.001, np.inf)
    found = standing_alone.of_element(prepare(building_of((gone, beside, behind)).triangles), 0, scan)
    assert found.tell > 1000 and (found.deny > 1000 if half else found.deny == 0)
