"""What is partly of glass: rays that end behind its panes tell nothing of its place, what is not of glass does."""

import numpy as np
import pytest

from jaxmm.verdicts.detection import detect_scans
from jaxmm.verdicts.priors import prior_of_building
from jaxmm.verdicts.settings import DetectSettings
from tests.cases.box_building import building_of, scan_of, shell_of
from warp_scanner.scenes.building_edits import without
from warp_scanner.scenes.scenes import OTHER, PILLAR, WALL
from warp_scanner.sensors.sensors import sensor_named

SHELL = shell_of(4.0, 3.0, 3.0)
SHELF, TOP = ((1.0, 0.0, 0.35), (0.6, 0.4, 0.01), OTHER), ((1.0, 0.0, 0.45), (0.6, 0.4, 0.01), OTHER)
PLACE, OUSTER = np.array([-2.5, 0.3, 1.6]), sensor_named("ouster-64")
SETTINGS = DetectSettings(classes=("all",), refine=False, propose_views=False)
# A partition with a pane in its middle.
PARTS = tuple(
    ((1.0, y, z), (0.05, half, high), WALL)
    for y, z, half, high in ((-1.4, 1.5, 0.6, 1.5), (1.4, 1.5, 0.6, 1.5), (0.0, 0.45, 0.8, 0.45), (0.0, 2.8, 0.8, 0.2))
)
PANE = ((1.0, 0.0, 1.75), (0.02, 0.8, 0.85), WALL)
POSTS = (-2.84, -0.95, 0.95, 2.84)
CHEST = ((1.6, 0.0, 0.9), (0.15, 0.8, 0.9), OTHER)  # behind the glass


def joined(boxes, glass):
    """A building in which all boxes behind the shell are one element, some of them of glass."""
    building, first = building_of((*SHELL, *boxes)), len(SHELL)
    triangles = building.triangles
    clear = np.isin(triangles.element, [first + number for number in glass])
    element = np.minimum(triangles.element, np.int32(first))
    building = building._replace(triangles=triangles._replace(element=element), clear=clear)
    return without(building, list(range(first + 1, first + len(boxes))))


def shifted(boxes, step):
    return tuple((tuple(np.add(center, step)), *rest) for center, *rest in boxes)


def told(judges, building, boxes):
    """What a scan of the shell with some boxes tells of the last element."""
    scan = scan_of((*SHELL, *boxes), PLACE, OUSTER)
    return detect_scans(prior_of_building(building), [scan], judges, SETTINGS)


@pytest.mark.parametrize("by", [0.0, 0.004, -0.06, 0.2])
def test_a_wall_with_a_pane_is_measured_by_the_rest_of_it(judges, by):
    found = told(judges, joined((*PARTS, PANE), [len(PARTS)]), shifted(PARTS, (by, 0.0, 0.0)))
    one = found.elements[-1]
    assert one.verdict == ("displaced" if abs(by) > 0.03 else "present")
    assert one.deviation.offset == pytest.approx((by, 0.0, 0.0), abs=2e-4) and not found.mismatches


@pytest.mark.long
@pytest.mark.parametrize("by", [0.0, -0.1, -0.21])
def test_a_wall_that_is_mostly_of_glass_is_not_gone_because_rays_pass_its_panes(judges, by):
    frame = tuple(
        ((1.0, y, z), (0.05, half, high), WALL)
        for y, z, half, high in ((0.0, 0.25, 2.9, 0.25), (0.0, 2.85, 2.9, 0.15), *((y, 1.6, 0.06, 1.1) for y in POSTS))
    )
    panes = tuple(((1.0, y, 1.6), (0.012, 0.86, 1.1), WALL) for y in (-1.89, 0.0, 1.89))
    glass = range(len(frame), len(frame) + len(panes))
    found = told(judges, joined((*frame, *panes), [*glass]), (*shifted(frame, (by, 0.0, 0.0)), CHEST))
    assert found.elements[-1].verdict == ("displaced" if by else "present")
    assert not [one for one in found.mismatches if one.mismatch_type == "removed"]


def test_a_wall_that_is_mostly_of_glass_is_gone_where_nothing_of_it_stands(judges):
    building = joined((*PARTS, PANE), [len(PARTS)])
    assert told(judges, building, ()).elements[-1].verdict == "removed"


@pytest.mark.parametrize("behind", [0.08, 0.25])
def test_what_stands_behind_a_pane_moves_no_wall(judges, behind):
    """As a blind, or a cupboard: of a partition that is nearly all glass, most rays end there."""
    frame, pane = ((1.0, 0.0, 0.1), (0.05, 2.0, 0.1), WALL), ((1.0, 0.0, 1.6), (0.02, 2.0, 1.4), WALL)
    blind = ((1.0 + behind, 0.0, 1.6), (0.01, 2.0, 1.4), OTHER)
    one = told(judges, joined((frame, pane), [1]), (frame, blind)).elements[-1]
    assert one.verdict == "present" and one.deviation.offset == pytest.approx((0.0, 0.0, 0.0), abs=2e-4)


def test_of_a_wall_that_is_all_of_glass_nothing_is_measured(judges):
    assert told(judges, joined((PANE,), [0]), ()).elements[-1].deviation is None


@pytest.mark.parametrize("is_glass", [True, False])
def test_a_shelf_below_glass_moves_no_table(judges, is_glass):
    one = told(judges, joined((SHELF, TOP), [1] if is_glass else []), (SHELF,)).elements[-1]
    assert (one.verdict == "displaced") == (not is_glass)


@pytest.mark.parametrize("is_glass", [True, False])
def test_a_showcase_is_not_looked_for_beside_its_place(judges, is_glass):
    """It is as slender as a column: of such, what stands beside its place is found by its shape."""
    foot, case = ((1.0, 0.0, 0.05), (0.3, 0.3, 0.05), PILLAR), ((1.0, 0.0, 1.05), (0.3, 0.3, 0.95), PILLAR)
    found = told(judges, joined((foot, case), [1] if is_glass else []), shifted((foot, case), (0.0, 0.2, 0.0)))
    assert (found.elements[-1].verdict == "displaced") == (not is_glass)
