"""Mismatches out of verdicts and objects: how high they are, which are false, in which order they come."""

import numpy as np
import pytest

from jaxmm.learning.boxes import Box, BoxSettings
from jaxmm.learning.prediction import read_judges
from jaxmm.rays.scan_rays import rays_of_scan
from jaxmm.runs.room_scans import room_cases, true_boxes
from jaxmm.verdicts.detection import detect_scans
from jaxmm.verdicts.mismatches import _below_roof, _measured_by_thesis, mismatches_of
from jaxmm.verdicts.named_scans import NamedScan
from jaxmm.verdicts.priors import prior_of_building, prior_of_cloud
from jaxmm.verdicts.scan_fusion import Looked, _sky
from jaxmm.verdicts.settings import DetectSettings
from jaxmm.verdicts.station_steps import look_at
from jaxmm.weights import DEFAULT
from tests.cases.box_building import building_of, scan_of
from warp_scanner.scenes.scenes import CEILING, CYLINDER, FLOOR, WALL
from warp_scanner.sensors.sensors import OAK_D_PRO_SMALL


@pytest.mark.parametrize(
    "x, seen, top",
    [
        pytest.param(1.0, 2.0, 5.0, id="under the high roof"),
        pytest.param(-1.0, 2.0, 3.0, id="under the low one"),
        pytest.param(0.1, 2.0, 3.0, id="under the edge of both"),
        pytest.param(-1.0, 3.5, 5.0, id="seen above the low one"),
        pytest.param(9.0, 2.0, 5.0, id="in the open"),
    ],
)
def test_a_new_object_goes_no_higher_than_the_roof_above_it(x, seen, top):
    """Made up to 5 m, the ceiling above the sensor; walls and beams above it are no roof."""
    building = building_of([
        ((0.0, 0.0, -0.1), (4.0, 4.0, 0.1), FLOOR), ((2.0, 0.0, 5.1), (2.0, 4.0, 0.1), CEILING),
        ((-2.0, 0.0, 3.1), (2.0, 4.0, 0.1), CEILING), ((1.0, 0.0, 2.5), (0.5, 4.0, 0.1), WALL),
    ])  # fmt: skip
    prior = prior_of_building(building)
    box = Box("pillar", np.array([x, 0.5, 2.5]), np.array([0.4, 0.6, 5.0]), 30.0, "rectangular", 0.9, 40)
    found = _below_roof(prior, box._replace(center=box.center - prior.origin), seen - prior.origin[2])
    high = found.center[2] + prior.origin[2] + found.dimensions[2] / 2
    assert high == pytest.approx(top, abs=1e-4)
    assert high - found.dimensions[2] == pytest.approx(0.0, abs=1e-4)
    np.testing.assert_array_equal(found.dimensions[:2], box.dimensions[:2])


def test_of_a_roof_a_cloud_tells_nothing():
    box = Box("wall", np.array([0.0, 0.0, 2.5]), np.array([2.0, 0.2, 5.0]), 0.0, "rectangular", 0.9, 40)
    assert _below_roof(prior_of_cloud(np.random.default_rng(0).uniform(0, 3, (50, 3))), box, 2.0) is box


def raised(looked, by):
    """The same scan of the storey above."""
    sides = {}
    for change, side in (("added", looked.added), ("removed", looked.removed)):
        view = side.view._replace(points=side.view.points + np.float32([0, 0, by]), levels=side.view.levels + by)
        sides[change] = side._replace(view=view)
    rays = looked.rays._replace(position=looked.rays.position + np.array([0, 0, by]))
    return looked._replace(rays=rays, levels=tuple(level + by for level in looked.levels), **sides)


def test_every_storey_has_a_floor_and_a_ceiling_of_its_own():
    (case,) = room_cases("pillar_added", "clean", 22, range(1), preset="thesis")
    looked, _ = look_at(case.prior, rays_of_scan(case.scan), read_judges(DEFAULT))
    settings = DetectSettings()
    (alone,) = mismatches_of(case.prior, [looked], None, settings)
    below, above = mismatches_of(case.prior, [looked, raised(looked, 3.4)], None, settings)
    for one, rise in ((below, 0.0), (above, 3.4)):
        np.testing.assert_allclose(one.center, alone.center + np.array([0, 0, rise]), atol=1e-3)
        np.testing.assert_allclose(one.dimensions, alone.dimensions, atol=1e-3)
    assert len(mismatches_of(case.prior, [looked, looked], None, settings)) == 1  # of one storey, one object


@pytest.mark.parametrize("kind, measured", [("wall", (True, False, False)), ("pillar", (True, True, False))])
def test_the_thesis_assumes_a_walls_thickness_and_all_heights(kind, measured):
    one = Box(kind, np.zeros(3), np.array([3.0, 0.2, 2.5]))
    assert _measured_by_thesis(one, DetectSettings(preset="thesis")) == measured
    unstretched = DetectSettings(preset="thesis", boxes=BoxSettings(stretch=False))
    assert _measured_by_thesis(one, unstretched) == (*measured[:2], True)


def test_what_is_less_probable_than_asked_for_is_left_out():
    """Two pillars are new here, of which one is told more surely than the other."""
    (case,) = room_cases("pillars_added", "occluded", 22, range(10, 11))
    looked, _ = look_at(case.prior, rays_of_scan(case.scan), read_judges(DEFAULT))

    def told(least):
        found = mismatches_of(case.prior, [looked], [], DetectSettings(least_probability=least))
        return [one.probability for one in found]

    every = told(0.0)
    between = (min(every) + max(every)) / 2
    assert min(every) < between < max(every)
    assert told(between) == [one for one in every if one >= between]
    assert told(min(every)) == every and told(1.0) == []


@pytest.mark.long
def test_a_pillar_that_moved_is_one_whether_it_is_round_or_square():
    judges, shapes, linked = read_judges(DEFAULT), [], []
    for case in room_cases("pillar_moved", "clean", 22, range(8), preset="thesis"):
        scan = NamedScan(case.scan, "scan", len(case.scan.points), "given")
        found = detect_scans(case.prior, [scan], judges, DetectSettings(refine=False, propose_views=False))
        gone = [one for one in found.mismatches if one.mismatch_type == "removed"]
        if len(gone) != 1 or len(found.mismatches) != 2:
            continue
        element = case.pairs.box.element[case.row][case.pairs.box.change[case.row] < 0]
        kind = case.pairs.prior.kind[case.row][np.isin(case.pairs.prior.element[case.row], element)]
        assert gone[0].shape == ("round" if (kind == CYLINDER).any() else "rectangular")
        assert np.linalg.norm(gone[0].center - true_boxes(case.pairs, case.row, -1)[0][0].center) < 0.02
        shapes.append(gone[0].shape)
        linked.append(found.mismatches[1].moved_from == 0)
    assert set(shapes) == {"round", "rectangular"} and np.mean(linked) > 0.7


@pytest.mark.parametrize("across", [False, True])
def test_a_new_wall_is_made_up_through_the_place_of_one_that_is_gone(across):
    """Its end is all that is seen of it, and 0.9 m behind that stood a wall which the same scan tells to be gone."""
    hall = (
        ((0, 0, -0.1), (5, 4, 0.1), FLOOR), ((0, 0, 2.7), (5, 4, 0.1), CEILING), ((5, 0, 1.3), (0.1, 4, 1.3), WALL),
        ((0, -3.9, 1.3), (5, 0.1, 1.3), WALL), ((0, 3.9, 1.3), (5, 0.1, 1.3), WALL),
    )  # fmt: skip
    old = ((1.0, 0.0, 1.3), (0.1, 3.0, 1.3), WALL)
    scan = scan_of((*hall, ((1.1, 0.0, 1.3), (1.1, 0.09, 1.3), WALL)), np.array([-3.0, 0.0, 1.4]), OAK_D_PRO_SMALL)
    prior = prior_of_building(building_of((*hall, old) if across else hall))
    settings = DetectSettings(refine=False, propose_views=False)
    found = detect_scans(prior, [scan], read_judges(DEFAULT), settings).mismatches
    gone, new = ([one for one in found if one.mismatch_type == change] for change in ("removed", "added"))
    assert len(gone) == across and [one.object_type for one in new] == ["wall"]
    assert new[0].dimensions[0] == pytest.approx(2.0, abs=0.05)


@pytest.mark.parametrize("rises, seen", [(True, True), (False, False)])
def test_one_looks_through_where_the_sky_sends_nothing_back_and_not_where_the_ground_does(rises, seen):
    """Half a view brings nothing back, and should meet nothing of the model: that which rises, or looks down."""
    scan = scan_of([((4.0, 0.0, 1.5), (0.1, 9.0, 4.0), WALL)], np.array([0.0, 0.0, 1.5]), OAK_D_PRO_SMALL).scan
    lost = (scan.points[:, 2] > 1.5) == rises
    rays = rays_of_scan(scan._replace(points=scan.points[~lost]))
    expected = np.full(len(rays.distance), np.inf)
    expected[0] = 3.0
    sky = _sky(Looked(rays, expected, None, None, (0.0, 3.0)))
    assert (len(sky) > 100) == seen and np.all(sky[:, 2] > 1.5)
