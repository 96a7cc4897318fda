"""What scans tell of elements that only stand behind what is gone."""

import dataclasses

import numpy as np
import pytest

from benchmarks.detections import elements_of
from jaxmm.rays.scan_rays import rays_of_scan
from jaxmm.runs.room_scans import room_cases
from jaxmm.verdicts.behind_removed import (
    Says,
    ask_again,
    filling,
    judged_anew,
    look_past_what_is_gone,
    past_nothing,
)  # fmt: skip
from jaxmm.verdicts.detection import detect_scans
from jaxmm.verdicts.named_scans import NamedScan
from jaxmm.verdicts.priors import prior_of_building
from jaxmm.verdicts.settings import DetectSettings
from jaxmm.verdicts.station_steps import look_at
from jaxmm.verdicts.verdicts import OCCLUDED, PRESENT, REMOVED, UNSCANNED, VerdictSettings
from tests.cases.box_building import building_of, scan_of
from warp_scanner.scenes.scenes import CEILING, DOOR, FLOOR, FURNITURE, OTHER, PILLAR, TABLE, WALL
from warp_scanner.sensors.scan import Rays
from warp_scanner.sensors.sensors import OAK_D_PRO_SMALL, VELODYNE_16
from warp_scanner.sensors.triangles import cast_triangles, prepare

SENSOR = dataclasses.replace(OAK_D_PRO_SMALL, width=160, height=100)
PLACE = np.array([-3.0, 0.2, 1.5])  # it looks along x
SHELL = (
    ((0, 0, -0.1), (8, 4, 0.1), FLOOR), ((0, 0, 2.7), (8, 4, 0.1), CEILING),
    ((0, -3.9, 1.3), (8, 0.1, 1.3), WALL), ((0, 3.9, 1.3), (8, 0.1, 1.3), WALL),
    ((-7.9, 0, 1.3), (0.1, 3.8, 1.3), WALL), ((7.9, 0, 1.3), (0.1, 3.8, 1.3), WALL),
)  # fmt: skip


def across(x, thickness=0.1, semantic=WALL):
    """A wall across the whole house."""
    return ((x, 0, 1.3), (thickness / 2, 3.8, 1.3), semantic)


def scanned(boxes, place=PLACE):
    return scan_of(boxes, place, SENSOR)


def told(judges, more, stands, **settings):
    """Verdicts and mismatches of what is in the shell, of which some stands."""
    prior = prior_of_building(building_of((*SHELL, *more)))
    real = (*SHELL, *(one for one, there in zip(more, stands, strict=True) if there))
    found = detect_scans(prior, [scanned(real)], judges, DetectSettings(refine=False, **settings))
    return found, [one.verdict for one in found.elements][4:]


def test_layers_of_a_wall_are_gone_one_behind_the_other(judges):
    layers = across(2.0, 0.1), across(2.15, 0.2), across(2.3, 0.1)
    found, verdicts = told(judges, layers, (False, False, False))
    assert verdicts == [REMOVED] * 3 and len(found.mismatches) == 3
    assert all(one.probability > 0.95 and one.observable_fraction > 0.9 for one in found.mismatches)
    assert told(judges, layers, (False, False, True))[1] == [REMOVED, REMOVED, PRESENT]
    assert told(judges, layers, (False, True, True))[1] == [REMOVED, PRESENT, UNSCANNED]
    assert told(judges, layers, (True, True, True))[1] == [PRESENT, UNSCANNED, UNSCANNED]


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


def test_what_is_not_asked_for_is_looked_past_without_a_verdict(judges):
    found, _ = told(
        judges, (across(2.0), ((4.0, 1.0, 1.3), (0.2, 0.2, 1.3), PILLAR)), (False, True), classes=("column",)
    )
    assert [one.verdict for one in found.elements] == [PRESENT] and not found.mismatches


@pytest.mark.long
@pytest.mark.parametrize("semantic", [OTHER, CEILING, FURNITURE])
def test_what_lines_a_wall_hides_nothing_where_it_is_gone_whatever_it_is(judges, semantic):
    """Covering, plate or proxy: only the wall gets a verdict."""
    lined = across(1.8, 0.2, semantic), across(2.0, 0.2), across(2.2, 0.2, semantic)
    for stands, verdict in (
        ((False, False, False), REMOVED),
        ((False, True, True), PRESENT),
        ((True, True, True), UNSCANNED),
    ):
        found, verdicts = told(judges, lined, stands)
        assert verdicts == [verdict]
        assert [one.mismatch_type for one in found.mismatches] == (["removed"] if verdict == REMOVED else [])


def test_what_may_look_gone_only_from_where_the_pose_is_guessed_is_not_looked_past(judges):
    prior = prior_of_building(building_of((*SHELL, across(2.0), ((4.0, 1.0, 1.3), (0.2, 0.2, 1.3), PILLAR))))
    seen, told = look_at(prior, rays_of_scan(scanned(SHELL).scan), judges)
    wall, column = len(SHELL), len(SHELL) + 1

    view = past_nothing(seen, told)

    def looking_past(sure):
        views = [view]

        def again(gone):
            new = ask_again(prior, seen, views[-1], gone, judges, VerdictSettings())
            views.append(new)
            return [None if new is views[-2] else Says(new.told, new.told)]

        (says,) = look_past_what_is_gone(prior.building, [Says(told, sure)], VerdictSettings(), again)
        return says.told, judged_anew(prior, seen, views[-1], judges)

    after, past = looking_past(told)
    assert past is not seen and after.rays[column].sum() > 0 and after.logit[wall] == told.logit[wall] > 0
    doubted = told._replace(logit=np.where(np.arange(len(told.logit)) == wall, np.nan, told.logit))
    after, past = looking_past(doubted)  # that the wall is gone
    assert past is seen and after is told and told.rays[column].sum() == 0


HALF = ((4.0, 2.15, 1.3), (0.1, 1.65, 1.3), WALL)  # of a wall at 4 m: what stands of it, from y = 0.5 on


@pytest.mark.parametrize("places", [[PLACE], [np.array([-3.0, -3.0, 1.5]), PLACE], [PLACE, np.array([0.0, 1.0, 1.5])]])
def test_what_stands_of_a_wall_behind_one_that_is_gone_is_not_new_and_is_told(judges, places):
    prior = prior_of_building(building_of((*SHELL, across(1.0), across(4.0, 0.2))))
    scans = [scanned((*SHELL, HALF), place) for place in places]
    found = detect_scans(prior, scans, judges, DetectSettings(refine=False))
    assert all(one.mismatch_type == "removed" for one in found.mismatches)
    behind = next(one for one in found.mismatches if abs(one.center[0] - 4.0) < 0.1)
    assert behind.standing > 0.2 and any("(element 7) is told to be removed" in note for note in found.notes)


@pytest.mark.parametrize("sensor", [SENSOR, VELODYNE_16])
def test_an_element_is_told_by_all_that_one_sees_of_it_past_what_is_gone(judges, sensor):
    """Beside the wall that is gone an edge of the next shows, which is gone, too; most of that stands."""
    near = ((1.0, -1.0, 1.3), (0.1, 2.8, 1.3), WALL)  # to y = 1.8
    prior = prior_of_building(building_of((*SHELL, near, across(3.0, 0.2))))
    stands = ((3.0, -0.8, 1.3), (0.1, 3.0, 1.3), WALL)  # to y = 2.2
    scan = scan_of((*SHELL, stands), PLACE, sensor)
    found = detect_scans(prior, [scan], judges, DetectSettings(refine=False))
    assert not any(one.mismatch_type == "added" for one in found.mismatches)
    assert found.elements[-1].verdict == PRESENT and found.elements[-1].rays[1] > found.elements[-1].rays[0]


def test_where_all_that_is_gone_may_stand_in_part_it_is_all_looked_past(judges):
    """Else nobody would ever look on."""
    walls = ((2.0, -1.9, 1.3), (0.1, 1.9, 1.3), WALL), ((2.0, 1.9, 1.3), (0.1, 1.9, 1.3), WALL)
    parts = ((2.0, -0.6, 1.3), (0.1, 0.5, 1.3), WALL), ((2.0, 1.0, 1.3), (0.1, 0.5, 1.3), WALL)
    prior = prior_of_building(building_of((*SHELL, *walls)))
    found = detect_scans(prior, [scanned((*SHELL, *parts))], judges, DetectSettings(refine=False))
    assert [one.standing >= 0.2 for one in found.mismatches] == [True, True]
    assert [one.verdict for one in found.elements[3:]] == [PRESENT, REMOVED, REMOVED]


@pytest.mark.parametrize("degrees", [0.0, 35.0])
def test_a_closed_door_behind_a_wall_that_is_gone_hides_what_is_behind_it(degrees):
    """However the building is turned: boxes along its axes would take the door for one in the first wall."""
    doors = ((3.0, 0.0, 1.0), (0.12, 0.5, 1.0), DOOR), ((1.0, 2.0, 1.0), (0.04, 0.5, 1.0), DOOR)
    building = building_of((across(1.0), across(3.0), *doors))
    turn, vertices = np.radians(degrees), building.triangles.vertices.copy()
    vertices[:, :2] = vertices[:, :2] @ np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    building = building._replace(triangles=building.triangles._replace(vertices=vertices.astype(np.float32)))
    assert filling(building, np.array([True, False, False, False])).tolist() == [False, False, False, True]
    assert filling(building, np.array([False, True, False, False])).tolist() == [False, False, True, False]


def test_true_verdicts_are_of_what_remains_too(judges):
    """Rooms of which two walls are gone: what only shows past the nearer one is true to be there, or gone."""
    more = 0
    for case in room_cases("walls_removed", "clean", 78, range(4)):
        found = detect_scans(
            case.prior, [NamedScan(case.scan, "scan", 1, "given")], judges, DetectSettings(refine=False)
        )
        number_of = dict(zip(case.prior.building.elements.guid, case.ids.tolist(), strict=True))
        for (truth, verdict, _), guid in elements_of(found, case):
            if truth in (PRESENT, REMOVED) and not np.any(case.pairs.dt.element[case.row] == number_of[guid]):
                more += 1
                assert verdict == truth
    assert more >= 2


WALL_GONE = ((1.0, 0.0, 1.3), (0.1, 3.8, 1.3), WALL)
COLUMN = ((4.0, 0.0, 1.3), (0.2, 0.2, 1.3), PILLAR)
# What stands before the column: in the room behind, close to the wall that was there, a door that was in it, a part.
BEFORE = {
    "cupboard": ((2.5, 0.0, 1.3), (0.1, 1.0, 1.3), TABLE),
    "screen": ((0.87, 0.0, 1.3), (0.02, 1.0, 1.3), TABLE),
    "door": ((1.0, 0.0, 1.0), (0.12, 0.6, 1.0), DOOR),
    "part": ((1.0, 0.0, 1.3), (0.1, 0.9, 1.3), WALL),
}
GATE = ((1.0, 0.0, 1.2), (0.12, 3.7, 1.2), DOOR)  # in the wall, and gone with it


@pytest.mark.parametrize("what", BEFORE)
@pytest.mark.parametrize("classes", [("wall", "column"), ("wall", "column", "door")])
def test_the_next_view_is_sought_past_what_is_gone(judges, what, classes):
    """But not past what stands there: from where one is sent, the column is seen, and without walking through."""
    planned = (WALL_GONE, COLUMN, BEFORE["door"] if what == "door" else GATE)
    real = building_of((*SHELL, BEFORE[what], COLUMN))
    prior = prior_of_building(building_of((*SHELL, *planned)))
    settings = DetectSettings(refine=False, classes=classes)
    found = detect_scans(prior, [scanned((*SHELL, BEFORE[what], COLUMN))], judges, settings)
    told = {one.guid: one for one in found.elements}
    wall, column = (told[prior.building.elements.guid[len(SHELL) + row]] for row in (0, 1))
    assert wall.verdict == REMOVED and column.verdict == OCCLUDED
    place = np.array(column.next_view[:3])
    edges = np.array(np.meshgrid([3.85, 4.15], [-0.19, 0.19], [0.4, 1.3, 2.0])).reshape(3, -1).T
    toward = edges - place
    toward = (toward / np.linalg.norm(toward, axis=1, keepdims=True)).astype(np.float32)
    hit = cast_triangles(prepare(real.triangles), Rays(place[None], toward))
    assert np.mean(hit.element == len(SHELL) + 1) > 0.2
    assert place[0] < 1.0


def test_the_next_view_of_a_door_that_was_in_a_wall_that_is_gone_is_sought_too(judges):
    """It fills a wall that is gone, and nobody knows of it: it stays where it is looked for."""
    door, screen = ((1.0, 2.0, 1.0), (0.12, 0.5, 1.0), DOOR), ((0.0, 1.6, 1.0), (0.05, 1.0, 1.0), TABLE)
    prior = prior_of_building(building_of((*SHELL, WALL_GONE, door)))
    settings = DetectSettings(refine=False, classes=("wall", "door"))
    found = detect_scans(prior, [scanned((*SHELL, screen, door))], judges, settings)
    assert [one.verdict for one in found.elements[4:]] == [REMOVED, OCCLUDED]
    assert found.elements[-1].next_view is not None
