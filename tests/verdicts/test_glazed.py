"""Furniture with a top of glass: rays that end on its shelf do not tell that it stands off its place."""

import numpy as np
import pytest

from jaxmm.verdicts.detection import detect_scans
from jaxmm.verdicts.priors import prior_of_building
from jaxmm.verdicts.settings import DetectSettings
from tests.cases.box_building import building_of, scan_of, shell_of
from warp_scanner.scenes.building_edits import without
from warp_scanner.scenes.scenes import OTHER
from warp_scanner.sensors.sensors import sensor_named

SHELL = shell_of(4.0, 3.0, 3.0)
SHELF, TOP = ((1.0, 0.0, 0.35), (0.6, 0.4, 0.01), OTHER), ((1.0, 0.0, 0.45), (0.6, 0.4, 0.01), OTHER)


@pytest.mark.parametrize("is_glass", [True, False])
def test_a_shelf_below_glass_moves_no_table(judges, is_glass):
    building = building_of((*SHELL, SHELF, TOP))
    triangles, last = building.triangles, len(SHELL) + 1
    top = triangles.element == last
    element = np.where(top, np.int32(last - 1), triangles.element)
    building = without(building._replace(triangles=triangles._replace(element=element), clear=top & is_glass), [last])
    scan = scan_of((*SHELL, SHELF), np.array([-2.5, 0.3, 1.6]), sensor_named("ouster-64"))
    settings = DetectSettings(classes=("all",), refine=False, propose_views=False)
    found = detect_scans(prior_of_building(building), [scan], judges, settings)
    assert (found.elements[-1].verdict == "displaced") == (not is_glass)


@pytest.mark.parametrize("is_glass", [True, False])
def test_a_showcase_is_not_looked_for_beside_its_place(judges, is_glass):
    """It is as slender as a column: of such, what stands beside its place is found by its shape."""
    case = ((1.0, 0.0, 1.0), (0.3, 0.3, 1.0), OTHER)
    building, last = building_of((*SHELL, case)), len(SHELL)
    triangles = building.triangles
    sides = (triangles.element == last) & (np.cumsum(triangles.element == last) > 8)
    scan = scan_of((*SHELL, ((1.0, 0.2, 1.0), *case[1:])), np.array([-2.5, 0.3, 1.6]), sensor_named("ouster-64"))
    settings = DetectSettings(classes=("all",), refine=False, propose_views=False)
    found = detect_scans(prior_of_building(building._replace(clear=sides & is_glass)), [scan], judges, settings)
    assert (found.elements[-1].deviation is None) == is_glass
