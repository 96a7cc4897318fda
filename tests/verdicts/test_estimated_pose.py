"""What a scan tells from a pose that was estimated: nothing that it would not tell from right beside."""

import numpy as np
import pytest

from jaxmm.verdicts.detection import detect_scans
from jaxmm.verdicts.priors import prior_of_building
from jaxmm.verdicts.settings import DetectSettings
from jaxmm.verdicts.verdicts import OCCLUDED, REMOVED, UNSCANNED
from tests.cases.box_building import building_of, scan_of
from warp_scanner.scenes.scenes import CEILING, FLOOR, PILLAR, WALL
from warp_scanner.sensors.sensors import OAK_D_PRO_SMALL

PLACE = np.array([-3.0, 0.0, 1.4])  # it looks along x
HALL = (
    ((0, 0, -0.1), (5, 4, 0.1), FLOOR), ((0, 0, 2.7), (5, 4, 0.1), CEILING), ((5, 0, 1.3), (0.1, 4, 1.3), WALL),
    ((0, -3.9, 1.3), (5, 0.1, 1.3), WALL), ((0, 3.9, 1.3), (5, 0.1, 1.3), WALL),
)  # fmt: skip
DEVIATION = (0.003, 0.007, 0.003, 0.2, 0.2)


def verdict_of(judges, column, real, deviation, off=(0.0, 0.0, 0.0)):
    """Of a column of the model, as a scan of what is real tells it from a pose that is a little off."""
    scan = scan_of(real, PLACE, OAK_D_PRO_SMALL)
    laid = scan.scan._replace(points=scan.scan.points + np.float32(off), position=PLACE + off)
    prior = prior_of_building(building_of((*HALL, column)))
    settings = DetectSettings(refine=False, propose_views=False)
    return detect_scans(prior, [scan._replace(scan=laid, deviation=deviation)], judges, settings).elements[-1].verdict


def test_a_column_right_beside_the_view_is_not_gone(judges):
    """From 3 cm to its side, where it is believed to be, the scanner would see its corner."""
    edge = np.radians(OAK_D_PRO_SMALL.horizontal_fov / 2)
    told = []
    for beyond in np.radians(np.arange(9.0, 13.0, 1.0)):
        center = PLACE[:2] + 0.8 * np.array([np.cos(edge + beyond), np.sin(edge + beyond)])
        column = ((*center, 1.3), (0.1, 0.1, 1.3), PILLAR)
        scans = [scan_of(real, PLACE, OAK_D_PRO_SMALL).scan.points for real in (HALL, (*HALL, column))]
        if not np.array_equal(*scans):  # its corner is in view from the true place, too
            continue
        told.append([verdict_of(judges, column, (*HALL, column), one, (0.0, 0.03, 0.0)) for one in (None, DEVIATION)])
    assert any(as_given == REMOVED for as_given, _ in told)
    assert all(estimated in (OCCLUDED, UNSCANNED) for _, estimated in told)


@pytest.mark.parametrize("y", [0.0, 1.0, 2.0])
def test_a_column_that_is_gone_from_the_view_is(judges, y):
    column = ((0.0, y, 1.3), (0.1, 0.1, 1.3), PILLAR)
    assert verdict_of(judges, column, HALL, DEVIATION, (0.01, -0.01, 0.0)) == REMOVED
