"""What stands in the place of a removed element, and lower, is no support for it."""

import numpy as np
import pytest

from jaxmm.verdicts.detection import detect_scans
from jaxmm.verdicts.priors import prior_of_building
from jaxmm.verdicts.settings import DetectSettings
from tests.cases.box_building import building_of, scan_of, shell_of
from warp_scanner.scenes.scenes import PILLAR, TABLE
from warp_scanner.sensors.sensors import sensor_named

ROW = 6
SHELL, HIGH = shell_of(5.0, 4.0, 3.0), 1.5
COLUMN = ((1.5, 0.0, HIGH), (0.2, 0.2, HIGH), PILLAR)
PLACE = np.array([-1.5, 0.4, 1.4])
LIKE_IT = ((1.6, 0.08, 1.1), (0.2, 0.2, 1.1), TABLE)  # as it is in plan, beside its place
STACK = (
    ((1.44, 0.04, 0.45), (0.24, 0.22, 0.45), TABLE), ((1.55, -0.05, 1.3), (0.2, 0.25, 0.4), TABLE),
    ((1.5, 0.0, 1.9), (0.24, 0.24, 0.2), TABLE),
)  # fmt: skip


def told(judges, *there):
    """The verdict on the column where something else stands."""
    scan = scan_of((*SHELL, *there), PLACE, sensor_named("ouster-64"))
    settings = DetectSettings(propose_views=False)
    found = detect_scans(prior_of_building(building_of((*SHELL, COLUMN))), [scan], judges, settings)
    verdicts = {one.guid: one.verdict for one in found.elements}
    guid = building_of((*SHELL, COLUMN)).elements.guid
    assert "removed" not in [verdicts[one] for one in guid[2:ROW]]
    return verdicts[guid[ROW]]


# Rays end on it where they should end on the column, without the shape of one.
ABOUT_IT = (((1.48, 0.0, 0.5), (0.3, 0.25, 0.5), TABLE), ((1.42, 0.02, 1.6), (0.14, 0.24, 0.6), TABLE))


@pytest.mark.long
@pytest.mark.parametrize("there", [(LIKE_IT,), STACK, ABOUT_IT], ids=["like it", "stack", "about it"])
def test_what_is_lower_than_a_column_in_its_place_is_no_column(judges, there):
    assert told(judges, *there) == "removed"


@pytest.mark.parametrize(("off", "verdict"), [((0.0, 0.0), "present"), ((-0.2, 0.2), "displaced")])
def test_a_column_that_stands_is_told_as_it_stands(judges, off, verdict):
    """Also where low things stand before it, and where it should stand."""
    (x, y, z), size, kind = COLUMN
    before, beside = ((0.7, 0.0, 0.4), (0.2, 0.6, 0.4), TABLE), ((x + 0.05, y - 0.2, 0.5), (0.2, 0.2, 0.5), TABLE)
    assert told(judges, ((x + off[0], y + off[1], z), size, kind), before, beside) == verdict


def test_half_a_column_in_its_place_is_present(judges):
    """Concrete that was poured to half its height is no other thing."""
    assert told(judges, ((1.5, 0.0, 0.9), (0.2, 0.2, 0.9), PILLAR)) == "present"
