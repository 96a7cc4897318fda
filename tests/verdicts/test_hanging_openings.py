"""Doors and windows that stand in no wall: which do, and what that changes."""

import numpy as np
import pytest

from jaxmm.deviations.deviation import faces_of
from jaxmm.deviations.pose_errors import EXACT
from jaxmm.deviations.shifted_columns import beside_columns
from jaxmm.rays.scan_rays import rays_of_scan
from jaxmm.verdicts.as_built import as_built, panes_of
from jaxmm.verdicts.hanging_openings import hanging, without_hanging
from jaxmm.verdicts.priors import prior_of_building, prior_of_cloud
from jaxmm.verdicts.settings import DetectSettings
from tests.cases.box_building import building_of, scan_of, shell_of
from warp_scanner.scenes.building_edits import without
from warp_scanner.scenes.scenes import CEILING, DOOR, FLOOR, FURNITURE, TABLE, WALL, WINDOW
from warp_scanner.sensors.sensors import sensor_named

FLOOR_SLAB, ROOF = ((0, 0, -0.1), (8, 6, 0.1), FLOOR), ((0, 0, 2.7), (8, 6, 0.1), CEILING)
A_WALL, A_WINDOW = ((3.0, 0, 1.3), (0.1, 2.85, 1.3), WALL), ((3.0, 1.0, 1.4), (0.05, 0.5, 0.6), WINDOW)
A_DOOR = ((3.0, -1.0, 1.05), (0.05, 0.45, 1.05), DOOR)
SKYLIGHT = ((0.0, 0.0, 2.85), (0.6, 0.6, 0.1), WINDOW)


def nobody_asks(prior):
    """(E,) bool: for no verdict at all."""
    return np.zeros(len(prior.building.elements.guid) if prior.building else 0, bool)


def test_what_stands_in_a_wall_does_not_hang_and_without_the_wall_it_does():
    building = building_of((FLOOR_SLAB, ROOF, A_WALL, A_WINDOW, A_DOOR, SKYLIGHT))
    assert hanging(building).tolist() == []
    assert hanging(without(building, np.array([2]))).tolist() == [2, 3]  # a skylight lies on its roof


def test_a_row_of_windows_from_floor_to_ceiling_is_held_at_its_ends():
    row = [((3.0, y, 1.3), (0.05, 0.5, 1.3), WINDOW) for y in np.arange(-2.0, 2.1, 1.0)]
    ends = [((3.0, y, 1.3), (0.1, 0.2, 1.3), WALL) for y in (-2.7, 2.7)]
    assert hanging(building_of((FLOOR_SLAB, *row, *ends))).tolist() == []
    assert hanging(building_of((FLOOR_SLAB, *row, ends[0]))).tolist() == []
    assert hanging(building_of((FLOOR_SLAB, *row))).tolist() == [1, 2, 3, 4, 5]
    gap = [*row[:2], *row[3:]]
    assert hanging(building_of((FLOOR_SLAB, *gap, ends[0]))).tolist() == [3, 4]


def test_a_roof_holds_its_windows():
    dormer = ((0.0, 0.0, 3.2), (0.4, 0.4, 0.45), WINDOW)
    assert hanging(building_of((FLOOR_SLAB, ROOF, dormer))).tolist() == []
    assert hanging(building_of((FLOOR_SLAB, dormer))).tolist() == [1]


@pytest.mark.parametrize("semantic, holds", [(WALL, True), (FURNITURE, False), (TABLE, False), (FLOOR, False)])
def test_only_what_is_part_of_the_building_and_upright_holds_a_door(semantic, holds):
    beside = ((3.0, -0.4, 1.3), (0.1, 0.1, 1.3), semantic)
    assert len(hanging(building_of((FLOOR_SLAB, A_DOOR, beside)))) == (not holds)
    apart = ((3.0, 0.0, 1.3), (0.1, 0.1, 1.3), semantic)
    assert len(hanging(building_of((FLOOR_SLAB, A_DOOR, apart)))) == 1


def test_the_surface_lacks_what_hangs_and_a_note_says_so():
    prior = prior_of_building(building_of((FLOOR_SLAB, A_WINDOW, A_DOOR)))
    left = without_hanging(prior, nobody_asks(prior))
    assert set(left.scene.triangles.element) == {0} and left.building is prior.building
    assert left.notes[-1].startswith("2 doors and windows of the model are in no wall")
    asked = without_hanging(
        prior, prior.building.elements.semantic == DOOR
    )  # somebody wants to know whether the door is there
    assert set(asked.scene.triangles.element) == {0, 2} and asked.notes[-1].startswith("1 ")


def test_priors_in_which_nothing_hangs_stay_as_they_are():
    whole = prior_of_building(building_of((FLOOR_SLAB, A_WALL, A_WINDOW)))
    windows = prior_of_building(building_of((A_WINDOW,)))  # nothing would be left of it
    cloud = prior_of_cloud(np.random.default_rng(3).uniform(-3.0, 3.0, (100, 3)))
    for prior in (whole, windows, cloud):
        assert without_hanging(prior, nobody_asks(prior)) is prior


def test_in_whole_models_nothing_hangs(data_root, real_building):
    paths = sorted((data_root / "ifc").glob("*.ifc"))
    assert paths
    for path in paths:
        assert hanging(real_building(path.stem)).tolist() == [], path.stem


def test_what_hangs_shifts_no_glass_and_does_not_come_back_with_what_moved():
    """A glazed wall behind a door in no wall, and another wall that stands 60 mm off."""
    shell = shell_of(4.0, 3.0, 3.0)
    boxes = (((0.0, 1.5, 1.05), (0.45, 0.05, 1.05), DOOR), *shell)
    building = building_of(boxes)
    glazed = len(boxes) - 1
    building = building._replace(clear=building.triangles.element == glazed)
    prior = prior_of_building(building)
    left = without_hanging(prior, nobody_asks(prior))
    np.testing.assert_array_equal(panes_of(left), left.scene.triangles.element == glazed)
    off = [
        (np.add(center, (-0.06, 0.0, 0.0)) if row == 2 else center, *more) for row, (center, *more) in enumerate(shell)
    ]
    place = np.array([-1.0, 0.5, 1.5])
    rays = rays_of_scan(scan_of(off, place, sensor_named("ouster-64")).scan)
    faces = faces_of(left.scene, rays, EXACT, None, panes_of(left))
    assert glazed not in {one.element for one in faces.seen}
    beside = beside_columns(left.scene, rays, 0.3)
    found = as_built(left, [faces], [beside], lambda there, rows: [faces._replace(seen=[])], DetectSettings())
    moved, unmoved = (one.scene.triangles for one in (found.prior, left))
    assert found.deviation(3) is not None
    assert np.abs(moved.vertices[moved.faces] - unmoved.vertices[unmoved.faces]).max() > 0.05
    assert set(moved.element) == set(unmoved.element) == {1, 2, 3, 4, 5, 6}
