"""Scans from outdoors: what counts as inside, and what is told of a house and of what stands around it."""

import numpy as np
import pytest

from benchmarks.outdoors import Street
from benchmarks.outdoors import _pose as a_pose
from benchmarks.outdoors import _things_around as things_around
from benchmarks.outdoors import table as outdoor_table
from benchmarks.views.kept_views import KeptViews
from jaxmm.inputs import InputError
from jaxmm.verdicts.detection import detect_scans
from jaxmm.verdicts.outdoors import OUTDOORS, indoors, is_outdoors
from jaxmm.verdicts.priors import prior_of_building, prior_of_cloud
from jaxmm.verdicts.settings import DetectSettings
from jaxmm.verdicts.verdicts import PRESENT, REMOVED, UNSCANNED
from tests.cases.box_building import building_of, scan_of
from warp_scanner.buildings.positions import away_from
from warp_scanner.scenes.building import element_bounds
from warp_scanner.scenes.scenes import CEILING, FLOOR, OTHER, PILLAR, WALL
from warp_scanner.sensors.sensors import OAK_D_PRO_SMALL

# A house of 8 x 6 m; its walls from 2 on: south, north, west, east. Terrain of 40 x 40 m lies 0.1 m below its floor.
SLAB, ROOF = ((0, 0, -0.1), (4, 3, 0.1), FLOOR), ((0, 0, 2.7), (4, 3, 0.1), CEILING)
WALLS = (
    ((0, -2.9, 1.3), (4, 0.1, 1.3), WALL), ((0, 2.9, 1.3), (4, 0.1, 1.3), WALL),
    ((-3.9, 0, 1.3), (0.1, 2.8, 1.3), WALL), ((3.9, 0, 1.3), (0.1, 2.8, 1.3), WALL),
)  # fmt: skip
TERRAIN = ((0, 0, -0.25), (20, 20, 0.05), OTHER)
HOUSE = (SLAB, ROOF, *WALLS)
# A tree, a lamp post, a fence and a house across the street.
AROUND = (
    ((-7.0, 2.0, 2.5), (0.15, 0.15, 2.5), OTHER), ((-5.5, -2.0, 2.0), (0.1, 0.1, 2.0), OTHER),
    ((-6.0, 5.5, 1.2), (0.05, 2.0, 1.2), OTHER), ((14.0, 1.0, 3.0), (3.0, 8.0, 3.0), OTHER),
)  # fmt: skip
PLACE = np.array([-10.0, 0.5, 1.5])  # it looks along x, at the west wall


def scanned(boxes, place=PLACE):
    return scan_of(boxes, place, OAK_D_PRO_SMALL, most=30.0)


def verdicts(found):
    return [one.verdict for one in found.elements]


def test_indoors_is_what_is_on_a_floor_or_under_something():
    places = np.array([[0, 0, 1.5], [0, 0, 7.0], [-10, 0, 1.5], [-3.9, 0, 1.5], [0, 5, 1.5], [0, 0, -3.0]], float)
    for more in ((), (TERRAIN,)):  # a mesh does not say what terrain is: beyond the walls nobody is indoors
        prior = prior_of_building(building_of((*HOUSE, *more)))
        assert indoors(prior, places).tolist() == [True, False, False, True, False, False], more
    beside = np.array([[-4.3, 0.0, 1.5], [-4.7, 0.0, 1.5]])  # of a wall at -4
    assert indoors(prior_of_building(building_of(HOUSE)), beside).tolist() == [True, False]
    unroofed = prior_of_building(building_of((SLAB, *WALLS)))
    assert indoors(unroofed, places).tolist() == [True, False, False, True, False, False]
    walls_only = prior_of_building(building_of(WALLS))  # within its box, or 2 m beside it
    assert indoors(walls_only, places + np.array([0.0, 0.0, 0.2])).tolist()[:3] == [True, False, False]
    assert indoors(prior_of_building(building_of((SLAB,))), places[[0, 2]]).tolist() == [True, False]  # no walls yet
    cloud = prior_of_cloud(np.random.default_rng(3).uniform(-3.0, 3.0, (100, 3)))
    assert not is_outdoors(cloud, PLACE)
    assert away_from(building_of(HOUSE), np.array([-7.0, 7.0, 1.0])) == pytest.approx(5.0)


@pytest.mark.long
@pytest.mark.parametrize("terrain, refine", [((), True), ((TERRAIN,), False)])
def test_a_wall_that_is_gone_is_told_from_outdoors_and_nothing_of_what_stands_around(judges, terrain, refine):
    prior, settings = prior_of_building(building_of((*HOUSE, *terrain))), DetectSettings(refine=refine)
    whole, without = (*HOUSE, TERRAIN, *AROUND), (*HOUSE[:4], *HOUSE[5:], TERRAIN, *AROUND)
    same = detect_scans(prior, [scanned(whole)], judges, settings)
    assert same.mismatches == () and verdicts(same)[2] == PRESENT and REMOVED not in verdicts(same)
    assert OUTDOORS in same.scans[0].notes
    gone = detect_scans(prior, [scanned(without)], judges, settings)
    (one,) = gone.mismatches
    assert one.mismatch_type == "removed" and one.element == prior.building.elements.guid[4]
    assert verdicts(gone)[2] == REMOVED and REMOVED not in [*verdicts(gone)[:2], *verdicts(gone)[3:]]


def test_a_new_wall_in_the_house_is_told_from_outdoors_too(judges):
    prior = prior_of_building(building_of((*HOUSE[:4], *HOUSE[5:])))  # open to the west
    new = ((0.0, 0.5, 1.3), (0.1, 1.5, 1.3), WALL)
    found = detect_scans(prior, [scanned((*HOUSE[:4], *HOUSE[5:], TERRAIN, *AROUND, new))], judges, DetectSettings())
    (one,) = found.mismatches
    assert (one.object_type, one.mismatch_type) == ("wall", "added")
    assert np.abs(one.center[:2] - [0.0, 0.5]).max() < 0.15


@pytest.mark.long
@pytest.mark.parametrize("off", [-0.3, 0.0, 0.03])
def test_a_new_outer_wall_is_told_wherever_the_slab_ends(judges, off):
    rest = (*HOUSE[:4], *HOUSE[5:])
    prior, new = prior_of_building(building_of(rest)), ((-3.9 + off, 0.0, 1.3), (0.1, 2.7, 1.3), WALL)
    found = detect_scans(prior, [scanned((*rest, TERRAIN, *AROUND, new))], judges, DetectSettings(refine=False))
    (one,) = found.mismatches
    assert (one.object_type, one.mismatch_type) == ("wall", "added")
    assert one.center[0] == pytest.approx(-3.9 + off, abs=0.1)


def test_an_unfinished_house_is_indoors_whatever_its_slab_is_called(judges):
    """No roof yet, and the slab is a footing; one small landing is a floor."""
    slab, landing = ((0, 0, -0.1), (4, 3, 0.1), OTHER), ((3.2, 2.2, 1.3), (0.5, 0.5, 0.1), FLOOR)
    prior, place = prior_of_building(building_of((slab, landing, *WALLS))), np.array([-3.0, 0.3, 1.5])
    new = ((1.0, 0.5, 1.3), (0.2, 0.2, 1.3), PILLAR)
    assert not is_outdoors(prior, place)
    found = detect_scans(prior, [scanned((slab, landing, *WALLS, new), place)], judges, DetectSettings())
    assert [(one.object_type, one.mismatch_type) for one in found.mismatches] == [("pillar", "added")]


def test_an_indoor_scan_beside_one_from_outdoors_keeps_what_it_tells(judges):
    new, place = ((1.0, 0.5, 1.3), (0.2, 0.2, 1.3), PILLAR), np.array([-3.0, 0.3, 1.5])
    prior, real = prior_of_building(building_of(HOUSE)), (*HOUSE, TERRAIN, *AROUND, new)
    found = detect_scans(prior, [scanned(real), scanned(real, place)], judges, DetectSettings())
    (one,) = found.mismatches
    assert (one.object_type, one.told_by[0]) == ("pillar", 0) and np.abs(one.center[:2] - [1.0, 0.5]).max() < 0.1
    assert [OUTDOORS in scan.notes for scan in found.scans] == [True, False]


def test_a_scan_that_does_not_fit_says_how_far_outside_it_would_be(judges):
    prior, scan = prior_of_building(building_of(HOUSE)), scanned((TERRAIN, *AROUND))
    few = scan._replace(scan=scan.scan._replace(points=scan.scan.points[::8]))
    with pytest.raises(InputError, match=r"scan: .*; it would be 6\.0 m outside the building$"):
        detect_scans(prior, [few], judges, DetectSettings())


def test_the_street_of_the_benchmark_leaves_the_building_and_the_sensor_free():
    street = Street(np.array([3.0, -2.0]), np.array([6.0, 4.0]), 1.0)
    for number in range(50):
        draw = np.random.default_rng(number)
        pose = a_pose(street, draw, False)
        place, yaw = pose.position[0].astype(np.float64), pose.yaw[0]
        low, high = element_bounds(things_around(street, place, draw))
        away = np.maximum(np.maximum(low[1:, :2] - place[:2], place[:2] - high[1:, :2]), 0.0)
        assert np.linalg.norm(away, axis=1).min() > 0.0  # of all but the ground
        beside = np.maximum(low[1:, :2] - street.middle, street.middle - high[1:, :2])
        assert np.all(np.any(beside > street.half, axis=1)) and high[0, 2] == pytest.approx(0.95)
        ahead = street.middle - place[:2]
        assert np.cos(np.arctan2(ahead[1], ahead[0]) - np.radians(yaw)) > 0.5


def test_the_benchmark_counts_verdicts_of_what_is_gone_and_all_that_is_told_wrongly(tmp_path):
    def view(gone, verdict, wrong=(), new=0):
        return {"gone": gone, "verdict": verdict, "wrong": list(wrong), "new": new, "doubts": []}

    views = [view(True, REMOVED), view(True, PRESENT, ["a"]), view(False, None, ["b", "c"], 1), view(True, UNSCANNED)]
    files = (("house_ouster-64_3", [*views, {"gone": True, "refused": "why"}]), ("house_ouster-64-real_3", views[:1]))
    for name, of_file in files:
        kept = KeptViews(tmp_path / f"{name}.jsonl")
        for number, one in enumerate(of_file):
            kept.add((number,), one)
    rows = outdoor_table(tmp_path, 3).splitlines()
    assert "| ouster-64 | 5 | 1 | 3 | 1 | 0 | 1 | 0 | 1 | 3 | 1 |" in rows
    assert "| ouster-64-real | 1 | 0 | 1 | 0 | 0 | 1 | 0 | 0 | 0 | 0 |" in rows
