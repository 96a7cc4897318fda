"""What few faces tell of: a wall seen from its end, opposite walls that both moved. Neither is gone, nor new."""

import numpy as np
import pytest

from jaxmm.verdicts.as_built import AsBuilt, with_displaced
from jaxmm.verdicts.detection import detect_scans
from jaxmm.verdicts.priors import prior_of_building
from jaxmm.verdicts.settings import DetectSettings
from jaxmm.verdicts.verdicts import Verdict
from tests.cases.box_building import building_of, scan_of, shell_of
from tests.cases.displaced import deviation
from warp_scanner.scenes.scenes import WALL
from warp_scanner.sensors.sensors import sensor_named

SHELL = shell_of(5.0, 4.0, 3.0)
WEST, EAST, ROW = 3, 2, len(SHELL)
PARTITION = ((2.47, 0.0, 1.5), (0.97, 0.135, 1.5), WALL)
PLACE = np.array([-1.5, 0.1, 1.4])


def moved(box, step):
    middle, *rest = box
    return tuple(np.add(middle, step)), *rest


def told(judges, model, real):
    """All verdicts and deviations, by row; and how much is new."""
    building = building_of(model)
    scan, settings = scan_of(real, PLACE, sensor_named("ouster-64")), DetectSettings(propose_views=False)
    found = detect_scans(prior_of_building(building), [scan], judges, settings)
    by = {one.guid: one for one in found.elements}
    new = sum(one.mismatch_type == "added" for one in found.mismatches)
    return [by.get(one) for one in building.elements.guid], new


@pytest.mark.parametrize("by", [0.15, -0.27])
def test_a_wall_seen_from_its_end_is_told_where_it_stands(judges, by):
    """Its end shows beside its place, and rays pass where it should be: it was gone, and new there."""
    found, new = told(judges, (*SHELL, PARTITION), (*SHELL, moved(PARTITION, (0.0, by, 0.0))))
    low, high = found[ROW].deviation.interval[1]
    assert found[ROW].verdict == "displaced" and low <= by <= high and new == 0


def test_a_wall_seen_from_its_end_that_is_gone_is_removed(judges):
    found, _ = told(judges, (*SHELL, PARTITION), SHELL)
    assert found[ROW].verdict == "removed"


@pytest.mark.parametrize("steps", [(0.2, 0.085), (-0.1, -0.2)])
def test_of_opposite_walls_that_both_moved_nothing_false_is_told(judges, steps):
    """Nothing tells which is off by how much: null, or an interval that holds it."""
    real = list(SHELL)
    for row, step in zip((EAST, WEST), steps, strict=True):
        real[row] = moved(SHELL[row], (step, 0.0, 0.0))
    found, new = told(judges, SHELL, real)
    assert new == 0
    for row, step in zip((EAST, WEST), steps, strict=True):
        one = found[row]
        assert one.verdict == "present"
        assert one.deviation is None or one.deviation.interval[0][0] <= step <= one.deviation.interval[0][1]


@pytest.mark.parametrize(("stands", "verdict"), [(0.99, "present"), (0.9, "removed")])
def test_what_rays_end_on_stands_though_its_place_is_open(stands, verdict):
    """All that is off may be the pose: then nothing is told of its place, but it is not gone."""
    prior = prior_of_building(building_of(SHELL))
    one = deviation(0.1)._replace(interval=(None, None, None), stands=stands)
    gone = [Verdict("removed", 0.9, 100, (50, 50, 0, 0))] * ROW
    told = with_displaced(gone, AsBuilt(prior, {EAST: one}, np.full(ROW, 0.03), {}), 20)
    assert [one.verdict for one in told] == ["removed"] * EAST + [verdict] + ["removed"] * (ROW - EAST - 1)
    # A verdict and its probability do not contradict each other.
    assert told[EAST].probability == pytest.approx(0.01 if verdict == "present" else 0.9)
