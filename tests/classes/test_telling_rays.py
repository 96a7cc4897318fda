"""Which rays tell of an element that stands before a wall, or in one: all true by how the scene is made."""

import numpy as np
import pytest
import trimesh

from jaxmm.classes.telling_rays import Known, telling_rays
from jaxmm.rays.scan_rays import ScanRays
from warp_scanner.scenes.building import Triangles
from warp_scanner.scenes.scenes import DOOR, FURNITURE, OTHER, WALL, WINDOW
from warp_scanner.sensors.scan import Rays
from warp_scanner.sensors.triangles import cast_triangles, prepare

BACK = (0, [5.0, 0.0, 0.0], [0.1, 20.0, 20.0])  # element, centre and edges [m] of a wall behind everything
FRAME = [
    (1, [3.0, y, 0.0], [0.1, 0.1, 2.0]) for y in (-0.45, 0.45)
] + [(1, [3.0, 0.0, z], [0.1, 0.8, 0.1]) for z in (-0.95, 0.95)]  # fmt: skip
PANE = [(1, [3.0, 0.0, 0.0], [0.02, 0.8, 1.8])]
SOLID = [(1, [3.0, 0.0, 0.0], [0.1, 1.0, 2.0])]
ASKED = np.array([False, True])


def triangles_of(boxes, semantic):
    """Triangles of boxes (element, centre, edges)."""
    shapes = [trimesh.creation.box(size, trimesh.transformations.translation_matrix(at)) for _, at, size in boxes]
    start = np.cumsum([0, *(len(one.vertices) for one in shapes)])
    return Triangles(
        np.concatenate([one.vertices for one in shapes]).astype(np.float32),
        np.concatenate([one.faces + first for one, first in zip(shapes, start, strict=False)]).astype(np.int32),
        np.repeat([element for element, *_ in boxes], 12).astype(np.int32),
        np.array([WALL, semantic], np.uint8),
    )


def known_of(boxes, semantic, clear=(), ifc_class="IfcFurniture", in_facade=False):
    """A model; `clear` are the numbers of boxes of glass."""
    triangles = triangles_of(boxes, semantic)
    glass = np.repeat(np.isin(np.arange(len(boxes)), clear), 12)
    return Known(prepare(triangles), ("IfcWall", ifc_class), glass, np.array([False, in_facade]))


def scan_of(boxes, noise=0.0, shift=(0.0, 0.0, 0.0)):
    """Rays from the origin at what there is, their ranges with errors [m]; the sensor is held to be at the origin."""
    y, z = (one.ravel() for one in np.meshgrid(np.linspace(-0.25, 0.25, 121), np.linspace(-0.45, 0.45, 161)))
    direction = np.stack([np.ones_like(y), y, z], axis=1)
    direction = (direction / np.linalg.norm(direction, axis=1, keepdims=True)).astype(np.float32)
    scene = prepare(triangles_of(boxes, OTHER))
    distance = cast_triangles(scene, Rays(np.array([shift]), direction)).distance[0]
    distance = distance + np.random.default_rng(0).normal(0.0, noise, len(distance)).astype(np.float32)
    back = np.isfinite(distance)
    return ScanRays(np.zeros(3), direction[back], distance[back], int(back.sum()), direction, 0.005, 100.0)


def told(known, scan, gone=(False, False)):
    found = telling_rays(known, scan, ASKED, np.array(gone))
    assert all(one[0] == 0 for one in found)  # nobody asked for the wall
    return tuple(int(one[1]) for one in found)


@pytest.mark.parametrize("gone", [False, True], ids=["held for present", "held for gone"])
@pytest.mark.parametrize("semantic", [FURNITURE, OTHER])
def test_a_solid_thing_is_told_by_all_its_rays(semantic, gone):
    known = known_of([BACK, *SOLID], semantic)
    through, support, glass = told(known, scan_of([BACK, *SOLID], 0.005), gone=(False, gone))
    assert support > 1000 and through == glass == 0
    through, support, glass = told(known, scan_of([BACK], 0.005), gone=(False, gone))
    assert through > 1000 and support == glass == 0


@pytest.mark.parametrize("gone", [False, True], ids=["held for present", "held for gone"])
def test_what_stands_so_far_away_that_a_camera_errs_by_more_than_its_depth_is_not_passed(gone):
    """All rays toward it are too long, and by more than near by: their errors grow with the square of the range."""
    back, bar = (0, [13.0, 0.0, 0.0], [0.1, 40.0, 40.0]), (1, [9.8, 0.0, 0.0], [0.2, 1.6, 3.0])
    known = known_of([back, bar], OTHER, ifc_class="IfcBeam")
    rng = np.random.default_rng(1)

    def seen(boxes):
        scan = scan_of(boxes)
        error = scan.distance**2 * (0.0016 + rng.normal(0.0, 0.0008, len(scan.distance)))
        return scan._replace(distance=(scan.distance + error).astype(np.float32))

    through, support, _ = told(known, seen([back, bar]), gone=(False, gone))
    assert support > 10 * through
    through, support, _ = told(known, seen([back]), gone=(False, gone))
    assert through > 500 and support < 0.01 * through


def test_rays_through_glass_tell_nothing_and_the_frame_tells_all():
    known = known_of([BACK, *FRAME, *PANE], WINDOW, clear=[5])
    through, support, glass = told(known, scan_of([BACK, *FRAME]))  # it stands, and rays pass its pane
    assert support > 300 and glass > 1000 and through == 0
    through, support, glass = told(known, scan_of([BACK]))
    assert through > 100 and support == 0 and glass > 1000
    through, support, glass = told(known, scan_of([BACK, *FRAME, *PANE]))  # of dirty glass rays come back
    assert support > 1300 and through == glass == 0


@pytest.mark.parametrize("semantic, clear", [(WINDOW, []), (WINDOW, [1]), (DOOR, [])])
def test_what_does_not_show_its_pane_is_told_near_its_outline(semantic, clear):
    known = known_of([BACK, *SOLID], semantic, clear)
    through, support, glass = told(known, scan_of([BACK, *FRAME]))
    assert support > 300 and glass > 1000 and through <= 0.02 * support
    through, support, glass = told(known, scan_of([BACK]))
    assert through > 100 and support == 0 and glass > 1000


@pytest.mark.parametrize("clear", [[], [1]])
def test_a_pane_of_a_facade_has_no_frame_of_its_own(clear):
    known = known_of([BACK, *SOLID], OTHER, clear, "IfcPlate", in_facade=True)
    through, support, glass = told(known, scan_of([BACK]))
    assert (glass > 1000 and through == 0) if clear else (through > 1000 and glass == 0)
    assert support == 0


def test_glass_of_any_other_class_lets_rays_pass_too():
    known = known_of([BACK, *SOLID], OTHER, [1], "IfcRailing")
    through, _, glass = told(known, scan_of([BACK]))
    assert through == 0 and glass > 1000


def test_a_pane_close_before_a_wall_says_that_it_was_passed():
    """No ray tells whether it is there, but networks alone must not take it away either: rays went through glass."""
    wall, pane = (0, [3.11, 0.0, 0.0], [0.1, 20.0, 20.0]), (1, [3.0, 0.0, 0.0], [0.02, 1.0, 2.0])
    through, support, glass = told(known_of([wall, pane], OTHER, [1], "IfcRailing"), scan_of([wall]))
    assert through == support == 0 and glass > 1000


def test_a_ray_that_would_end_on_the_wall_behind_as_well_tells_nothing():
    """A lining of 2 cm on the wall: no single ray tells whether it is there."""
    lining = (1, [4.94, 0.0, 0.0], [0.02, 1.0, 2.0])
    known = known_of([BACK, lining], OTHER)
    for there in ([BACK, lining], [BACK]):
        assert told(known, scan_of(there, 0.01)) == (0, 0, 0)


def test_all_rays_at_a_casing_tell_together_what_none_tells_alone():
    casing = (1, [4.935, 0.0, 0.0], [0.03, 1.0, 2.0])
    known = known_of([BACK, casing], DOOR)
    through, support, _ = told(known, scan_of([BACK, casing], 0.015))
    assert support > 300 and through == 0
    through, support, _ = told(known, scan_of([BACK], 0.015))
    assert through > 300 and support == 0


def test_glass_far_away_is_no_casing_to_a_camera():
    """What is behind it is nearer than its ranges are known to: nobody can tell on which of both rays end."""
    solid = (1, [12.4, 0.0, 0.0], [0.2, 0.9, 1.8])
    frame = [(1, [12.4, y, 0.0], [0.2, 0.07, 1.8]) for y in (-0.415, 0.415)]
    frame += [(1, [12.4, 0.0, z], [0.2, 0.76, 0.07]) for z in (-0.865, 0.865)]
    back = (0, [13.0, 0.0, 0.0], [0.1, 40.0, 40.0])
    scan = scan_of([back, *frame])
    error = scan.distance**2 * np.random.default_rng(1).normal(0.0, 0.0008, len(scan.distance))
    scan = scan._replace(distance=(scan.distance + error).astype(np.float32))
    through, support, _ = told(known_of([back, solid], WINDOW), scan)
    assert through < 20 and through <= support


def test_a_rail_beside_which_a_small_error_leads_rays_is_not_gone():
    """It is 2 cm thick, and the sensor was 1.2 cm beside where it is held to be."""
    rail = (1, [3.0, 0.0, 0.0], [0.02, 0.02, 2.0])
    through, *_ = told(known_of([BACK, rail], OTHER), scan_of([BACK, rail], shift=(0.0, 0.012, 0.0)))
    assert through == 0


def test_an_open_leaf_keeps_a_door_without_a_frame():
    known = known_of([BACK, *SOLID], DOOR)
    leaf = (0, [3.5, 0.48, 0.0], [1.0, 0.04, 2.0])  # behind the opening, at a right angle
    through, _, glass = told(known, scan_of([BACK, leaf]))
    assert through == 0 and glass > 1000
    through, _, glass = told(known, scan_of([BACK]))
    assert through > 100
