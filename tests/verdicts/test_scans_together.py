"""Several scans of one building: what each shows, and what they say together of one place."""

import numpy as np
import pytest

from jaxmm.learning.prediction import Side, read_judges
from jaxmm.rays.evidence import View
from jaxmm.rays.scan_rays import ScanRays
from jaxmm.reports.report_json import to_json
from jaxmm.runs.room_scans import room_cases
from jaxmm.verdicts import mismatches
from jaxmm.verdicts.detection import detect_scans
from jaxmm.verdicts.mismatches import shown_by_each
from jaxmm.verdicts.named_scans import NamedScan
from jaxmm.verdicts.results import Mismatch
from jaxmm.verdicts.scan_fusion import Looked, judged_side
from jaxmm.weights import DEFAULT
from tests.cases.exact_poses import AS_IS


@pytest.fixture(scope="module")
def seen_and_not():
    """A room with a new pillar, its scan, and the same without the rays that met the pillar."""
    for case in room_cases("pillar_added", "clean", 22, range(8)):
        back = np.isfinite(case.pairs.robot.distance[case.row])
        met = case.pairs.changed_robot[case.row][back]
        if met.sum() > 400:
            return case.prior, case.scan, case.scan._replace(points=case.scan.points[~met])
    raise AssertionError("no room shows its pillar")


def found_in(prior, *scans):
    named = [NamedScan(scan, f"{number}.ply", len(scan.points), "given") for number, scan in enumerate(scans)]
    return detect_scans(prior, named, read_judges(DEFAULT), AS_IS)


@pytest.mark.long
def test_each_scan_tells_which_mismatches_it_shows(seen_and_not):
    prior, scan, blind = seen_and_not
    one = found_in(prior, scan)
    assert len(one.mismatches) == 1 and (one.scans[0].shows, one.scans[0].alone) == (1, 1)
    two = found_in(prior, blind, scan)
    assert [(each.shows, each.alone) for each in two.scans] == [(0, 0), (1, 1)]
    assert two.mismatches[0].told_by[0] == 0 < 8 <= two.mismatches[0].told_by[1]
    twice = found_in(prior, scan, scan, blind)
    assert [(each.shows, each.alone) for each in twice.scans] == [(1, 0), (1, 0), (0, 0)]
    said = to_json(twice)
    assert [each["shows"] for each in said["scans"]] == [1, 1, 0] and "told_by" not in said["mismatches"][0]


def test_a_scan_is_needed_where_all_others_together_have_fewer_than_eight_rays():
    rays = [(50, 0, 0), (50, 7, 0), (50, 4, 4), (3, 3, 3), (0, 2, 0)]
    found = [Mismatch("wall", "removed", np.zeros(3), np.ones(3), 0.0, 0.9, told_by=each) for each in rays]
    shows, alone = shown_by_each(tuple(found), 3)
    assert shows.tolist() == [4, 4, 2] and alone.tolist() == [3, 2, 1]
    assert [each.tolist() for each in shown_by_each((), 2)] == [[0, 0], [0, 0]]


def test_the_same_scan_twice_is_the_same_object(seen_and_not):
    prior, scan, _ = seen_and_not
    (one,), (two,) = found_in(prior, scan).mismatches, found_in(prior, scan, scan).mismatches
    np.testing.assert_allclose(two.center, one.center, atol=1e-9)
    np.testing.assert_allclose(two.dimensions, one.dimensions, atol=1e-9)
    assert min(one.probability, two.probability) > 0.99  # it is sure of both


def looked(points, pillar, position):
    count = len(points)
    nothing = np.zeros(count, np.float32)
    view = View(points, nothing - 1, np.zeros((count, 4), int), *(nothing,) * 4, nothing > 0)
    rays = ScanRays(np.asarray(position, float), points, nothing, count, points, 0.01, np.inf)
    side = Side(view, pillar.astype(np.float32), (pillar / 2).astype(np.float32))
    return Looked(rays, nothing, side, side, (0.0, 3.0))


def test_rays_of_a_storey_are_told_by_the_scan_that_they_are_of(monkeypatch):
    """Whatever order the storeys are gone through in; each scan has as many rays as it is numbered."""
    points = np.random.default_rng(0).uniform(0, 1, (4, 3)).astype(np.float32)
    scans = [
        looked(points[:number], np.full(number, 0.5), [0, 0, 1])._replace(levels=(floor, floor + 3.0))
        for number, floor in enumerate((3.3, 0.0, 3.2, 0.1), 1)
    ]

    def fitted(prior, some, change, settings, alone):
        told = tuple(len(one.rays.distance) for one in some[0])
        return [Mismatch("wall", change, np.zeros(3), np.ones(3), 0.0, 0.9, told_by=told)]

    monkeypatch.setattr(mismatches, "_fitted", fitted)
    found = mismatches._all_fitted(None, scans, ("added", False), AS_IS, mismatches._asks_of(None, scans, None))
    assert [one.told_by for one in found] == [(0, 2, 0, 4), (1, 0, 3, 0)]


def test_sides_of_one_scan_stay_and_of_two_are_fused():
    rng = np.random.default_rng(0)
    points, pillar = rng.uniform(0, 5, (300, 3)).astype(np.float32), rng.uniform(0.05, 0.95, 300)
    near, far = looked(points, pillar, [2.5, 2.5, 1.5]), looked(points + 20.0, pillar, [22.5, 2.5, 1.5])
    for change in ("added", "removed"):
        alone = judged_side([near], change)
        np.testing.assert_array_equal(alone.pillar, near.added.pillar)
        np.testing.assert_array_equal(alone.wall, near.added.wall)
        apart = judged_side([near, far], change)
        if change == "removed":  # the robot's rays do not end on the prior's points
            assert apart.rays is None
        else:
            assert [one.direction is scan.rays.direction for one, scan in zip(apart.rays, (near, far), strict=True)]
            np.testing.assert_array_equal([one.origin for one in apart.rays], apart.sensor)
        np.testing.assert_array_equal(apart.pillar, np.tile(near.added.pillar, 2))
        both = judged_side([near, near], change)
        assert len(both.points) == 600 and (both.pillar[:300] * both.pillar[300:] == 0.0).all()
        said = np.maximum(both.pillar[:300], both.pillar[300:])
        # Where one voxel holds several points of a scan, one of them speaks for all.
        assert (said > 0.0).mean() > 0.95
        speaks = (said > 0.0) & (np.abs(pillar - 0.5) > 0.01)
        surer = np.abs(said - 0.5) > np.abs(pillar - 0.5)
        assert surer[speaks].mean() > 0.95
