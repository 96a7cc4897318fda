"""Of two elements that have a piece in common one is gone: it is never present, and the other one never removed."""

import numpy as np
import pytest

from jaxmm.verdicts.detection import detect_scans
from jaxmm.verdicts.named_scans import NamedScan
from jaxmm.verdicts.priors import prior_of_building
from jaxmm.verdicts.settings import DetectSettings
from tests.cases.box_building import building_of, scan_of
from warp_scanner.scenes.scenes import FLOOR, PILLAR, WALL
from warp_scanner.sensors.sensors import OUSTER_64

PLACE = np.array([0.3, 0.0, 1.4])
SHELL = (
    ((0.0, 0.0, -0.1), (4.0, 3.0, 0.1), FLOOR), ((-4.1, 0.0, 1.5), (0.1, 3.0, 1.5), WALL),
    ((0.0, -3.1, 1.5), (4.0, 0.1, 1.5), WALL),
)  # fmt: skip
POST = ((1.0, 9.0, 1.5), (0.3, 0.3, 1.5), PILLAR)  # not in the model; else nothing is behind the wall
WALL_AHEAD = ((-1.0, 3.1, 1.5), (2.5, 0.1, 1.5), WALL)
OTHERS = {
    "in its line": ((2.5, 3.1, 1.5), (1.3, 0.1, 1.5), WALL),
    "at its end, away": ((1.4, 4.5, 1.5), (0.1, 1.5, 1.5), WALL),
    "at its middle, away": ((-0.5, 4.5, 1.5), (0.1, 1.5, 1.5), WALL),
    "at its end, toward": ((1.6, 2.2, 1.5), (0.1, 1.0, 1.5), WALL),
    "column in it": ((-0.8, 3.15, 1.5), (0.2, 0.15, 1.5), PILLAR),
    "column before it": ((-0.8, 3.0, 1.5), (0.2, 0.2, 1.5), PILLAR),
}


def verdicts(judges, model, there, known=True):
    """Of the elements of a model, by a scan of what is there; its rays without a return told by sensor, or by file."""
    one = scan_of(there, PLACE, OUSTER_64)
    if not known:
        direction = OUSTER_64.directions()
        back = {tuple(np.round(way, 4)) for way in _unit(one.scan.points - PLACE)}
        unseen = np.array([way for way in direction if tuple(np.round(way, 4)) not in back], np.float32)
        one = NamedScan(one.scan._replace(sensor=None, unseen=unseen), "scan", one.points, "given")
    found = detect_scans(prior_of_building(building_of(model)), [one], judges, DetectSettings(propose_views=False))
    verdict = {one.guid: one.verdict for one in found.elements}
    return [verdict[guid] for guid in building_of(model).elements.guid if guid in verdict]


def _unit(offset):
    return offset / np.linalg.norm(offset, axis=1, keepdims=True)


@pytest.mark.parametrize("behind", [(), (POST,)], ids=["nothing behind", "a post behind"])
@pytest.mark.parametrize("other", OTHERS.values(), ids=OTHERS)
def test_what_is_gone_is_not_present_and_what_stands_is_not_removed(judges, other, behind):
    model = (*SHELL, WALL_AHEAD, other)
    *shell, wall, beside = verdicts(judges, model, (*SHELL, other, *behind))
    assert set(shell) == {"present"} and beside == "present"
    assert wall == "removed" if behind else wall in ("removed", "occluded")
    assert set(verdicts(judges, model, (*model, *behind))) <= {"present", "occluded"}


@pytest.mark.parametrize("behind", [(), (POST,)], ids=["nothing behind", "a post behind"])
def test_rays_without_a_return_tell_the_same_by_the_sensor_and_by_the_file(judges, behind):
    model = (*SHELL, WALL_AHEAD)
    by_sensor, by_file = (verdicts(judges, model, (*SHELL, *behind), known) for known in (True, False))
    assert by_sensor == by_file
    assert by_file[-1] in (("removed",) if behind else ("removed", "occluded"))


def test_rays_that_the_file_tells_of_are_no_reason_to_call_a_wall_out_of_view(judges):
    """Nothing at all comes back from its direction, and without these rays nobody knows that any went there."""
    high = ((-1.0, 3.1, 3.0), (2.5, 0.1, 1.0), WALL)
    only = ((0.0, -3.1, 1.5), (4.0, 0.1, 1.5), WALL), ((0.0, -1.5, -0.1), (4.0, 1.5, 0.1), FLOOR)
    assert verdicts(judges, (*only, high), only, known=False)[-1] == "occluded"
    alone = scan_of(only, PLACE, OUSTER_64)
    alone = alone._replace(scan=alone.scan._replace(sensor=None))
    prior = prior_of_building(building_of((*only, high)))
    found = detect_scans(prior, [alone], judges, DetectSettings(propose_views=False))
    assert found.elements[-1].verdict == "unscanned"
