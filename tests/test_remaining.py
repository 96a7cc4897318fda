"""What scans tell of elements that only stand behind what is gone."""

import numpy as np
import pytest
from box_building import building_of

from benchmarks.detections import elements_of
from jaxmm.detect_files import read_judges
from jaxmm.detect_settings import DetectSettings
from jaxmm.detection import NamedScan, detect_scans
from jaxmm.priors import prior_of_building
from jaxmm.room_scans import room_cases
from jaxmm.scan_rays import PosedScan
from jaxmm.verdicts import PRESENT, REMOVED, UNSCANNED
from jaxmm.weights import DEFAULT
from warp_scanner.scan import Rays
from warp_scanner.scenes import CEILING, FLOOR, PILLAR, TABLE, WALL
from warp_scanner.sensors import OAK_D_PRO_SMALL
from warp_scanner.triangles import cast_triangles, prepare

PLACE = np.array([-3.0, 0.2, 1.5])  # it looks along x
SHELL = (
    ((0, 0, -0.1), (8, 4, 0.1), FLOOR), ((0, 0, 2.7), (8, 4, 0.1), CEILING),
    ((0, -3.9, 1.3), (8, 0.1, 1.3), WALL), ((0, 3.9, 1.3), (8, 0.1, 1.3), WALL),
    ((-7.9, 0, 1.3), (0.1, 3.8, 1.3), WALL), ((7.9, 0, 1.3), (0.1, 3.8, 1.3), WALL),
)  # fmt: skip


def across(x, thickness=0.1, semantic=WALL):
    """A wall across the whole house."""
    return ((x, 0, 1.3), (thickness / 2, 3.8, 1.3), semantic)


@pytest.fixture(scope="module")
def judges():
    return read_judges(DEFAULT)


def scanned(boxes, place=PLACE):
    direction = OAK_D_PRO_SMALL.directions()
    distance = cast_triangles(prepare(building_of(boxes).triangles), Rays(place[None], direction)).distance[0]
    points = (place + direction * distance[:, None]).astype(np.float32)
    return NamedScan(PosedScan(points, place, np.eye(3), OAK_D_PRO_SMALL), "scan", len(points), "given")


def told(judges, more, stands, count=1, **settings):
    """Verdicts and mismatches of what is in the shell, of which some stands."""
    prior = prior_of_building(building_of((*SHELL, *more)))
    real = (*SHELL, *(one for one, there in zip(more, stands, strict=True) if there))
    found = detect_scans(prior, [scanned(real)] * count, judges, DetectSettings(refine=False, **settings))
    return found, [one.verdict for one in found.elements][4:]


@pytest.mark.parametrize("count", [1, 2])
def test_layers_of_a_wall_are_gone_one_behind_the_other(judges, count):
    layers = across(2.0, 0.1), across(2.15, 0.2), across(2.3, 0.1)
    found, verdicts = told(judges, layers, (False, False, False), count)
    assert verdicts == [REMOVED] * 3 and len(found.mismatches) == 3
    assert all(one.probability > 0.95 and one.observable_fraction > 0.9 for one in found.mismatches)
    assert told(judges, layers, (False, False, True), count)[1] == [REMOVED, REMOVED, PRESENT]
    assert told(judges, layers, (False, True, True), count)[1] == [REMOVED, PRESENT, UNSCANNED]
    assert told(judges, layers, (True, True, True), count)[1] == [PRESENT, UNSCANNED, UNSCANNED]


def test_of_two_elements_in_one_place_both_are_gone(judges):
    twice = across(2.0, 0.2), across(2.0, 0.2)
    assert told(judges, twice, (False, False))[1] == [REMOVED, REMOVED]
    assert sorted(told(judges, twice, (True, True))[1]) == [PRESENT, UNSCANNED]
    column = ((1.0, 0.0, 1.3), (0.2, 0.2, 1.3), PILLAR)
    cladding = ((1.0, 0.0, 1.3), (0.25, 0.25, 1.3), PILLAR)
    assert told(judges, (cladding, column), (False, False))[1] == [REMOVED, REMOVED]
    assert told(judges, (cladding, column), (False, True))[1] == [REMOVED, PRESENT]


def test_the_room_behind_a_wall_that_is_gone_is_told_of(judges):
    """Its column, its far wall and what stands there that nobody planned; the points of all are drawn."""
    column = ((4.0, 1.0, 1.3), (0.2, 0.2, 1.3), PILLAR)
    more = across(2.0), column
    found, verdicts = told(judges, more, (False, True))
    assert verdicts == [REMOVED, PRESENT] and found.elements[3].verdict == PRESENT
    shown = found.drawing.prior_element == len(SHELL) + 1
    assert shown.sum() == found.elements[-1].points > 20
    found, verdicts = told(judges, more, (False, False))
    assert verdicts == [REMOVED, REMOVED] and [one.object_type for one in found.mismatches] == ["wall", "pillar"]
    table = ((3.0, 1.0, 0.4), (0.4, 0.8, 0.4), TABLE)
    prior, real = building_of((*SHELL, *more)), (*SHELL, column, table)
    found = detect_scans(prior_of_building(prior), [scanned(real)], judges, DetectSettings(refine=False))
    assert [one.mismatch_type for one in found.mismatches] == ["removed"]


def test_only_classes_that_are_asked_for_are_looked_past(judges):
    found, _ = told(
        judges, (across(2.0), ((4.0, 1.0, 1.3), (0.2, 0.2, 1.3), PILLAR)), (False, True), classes=("column",)
    )
    assert [one.verdict for one in found.elements] == [UNSCANNED]


def test_true_verdicts_are_of_what_remains_too(judges):
    """Rooms of which two walls are gone: what only shows past the nearer one is true to be there, or gone."""
    more = 0
    for case in room_cases("walls_removed", "clean", 78, range(6)):
        found = detect_scans(
            case.prior, [NamedScan(case.scan, "scan", 1, "given")], judges, DetectSettings(refine=False)
        )
        number_of = dict(zip(case.prior.building.elements.guid, case.ids.tolist(), strict=True))
        gone = set(case.pairs.box.element[case.row, case.pairs.box.change[case.row] < 0].tolist())
        for (truth, verdict, _), guid in elements_of(found, case):
            assert truth not in (PRESENT, REMOVED) or (truth == REMOVED) == (number_of[guid] in gone)
            if truth in (PRESENT, REMOVED) and not np.any(case.pairs.dt.element[case.row] == number_of[guid]):
                more += 1
                assert verdict == truth
    assert more >= 3
