"""Detection from arrays: true rooms, several scans, clouds as priors."""

import dataclasses

import numpy as np
import pytest

from jaxmm.inputs import InputError
from jaxmm.learning.box_match import match_boxes
from jaxmm.rays.scan_rays import PosedScan, rays_of_scan
from jaxmm.runs.room_scans import as_cloud, room_cases, true_boxes
from jaxmm.verdicts.detection import detect_scans
from jaxmm.verdicts.placement import OF_CLOUDS, FitLimits
from jaxmm.verdicts.priors import prior_of_building, prior_of_cloud
from jaxmm.verdicts.results import box_of
from jaxmm.verdicts.settings import DetectSettings
from jaxmm.verdicts.station_steps import look_at
from jaxmm.verdicts.verdicts import OCCLUDED, PRESENT, REMOVED, UNSCANNED
from tests.cases.exact_poses import AS_IS, named
from warp_scanner.scenes.scenes import FLOOR
from warp_scanner.sensors.scan import Rays
from warp_scanner.sensors.sensors import OAK_D_PRO_SMALL
from warp_scanner.sensors.triangles import cast_triangles

UNSEEN_SEED = 78  # that no training, validation or test of ours uses


def test_verdicts_agree_with_the_truth(judges):
    """Of walls in occluded rooms, one of which is gone: none is called what it is not, whatever hides it."""
    found = dict.fromkeys((PRESENT, REMOVED, OCCLUDED, UNSCANNED), 0)
    for pairs, row, ids, prior, scan in room_cases("wall_removed", "occluded", UNSEEN_SEED, range(10)):
        said = {one.guid: one for one in detect_scans(prior, [named(scan)], judges, AS_IS).elements}
        gone = pairs.box.element[row, 0]
        for number, guid in zip(ids, prior.building.elements.guid, strict=True):
            if guid in said:
                one = said[guid]
                assert one.verdict != (PRESENT if number == gone else REMOVED), (row, one)
                if one.verdict == UNSCANNED:
                    assert not (pairs.dt.element[row] == number).any()
                found[one.verdict] += 1
    assert found[REMOVED] >= 7 and found[PRESENT] >= 7 and found[UNSCANNED] > 0


@pytest.mark.long
def test_what_moved_is_two_mismatches_that_are_linked(judges):
    linked = right = total = 0
    for pairs, row, _, prior, scan in room_cases("pillar_moved", "clean", UNSEEN_SEED, range(8)):
        found = detect_scans(prior, [named(scan)], judges, AS_IS)
        (new,), (shown,) = true_boxes(pairs, row, 1)
        (gone,), (was_shown,) = true_boxes(pairs, row, -1)
        if min(shown, was_shown) < 0.4:
            continue
        added = [one for one in found.mismatches if one.mismatch_type == "added"]
        total += 1
        right += len(match_boxes([box_of(one) for one in added], [new]))
        for old in (found.mismatches[one.moved_from] for one in added if one.moved_from is not None):
            linked += 1
            assert old.mismatch_type == "removed" and old.element is not None
            np.testing.assert_allclose(old.center, gone.center, atol=0.05)
    assert total >= 4 and right >= 0.7 * total and linked >= 2


def test_two_scans_say_more_than_one(judges):
    """The same room from two places: what either sees is known, and the record says what the second added."""
    (first, second), (prior, _) = _two_views()
    one = detect_scans(prior, [named(first)], judges, AS_IS)
    both = detect_scans(prior, [named(first), named(second)], judges, AS_IS)
    told = [{each.guid for each in found.elements if each.verdict in (PRESENT, REMOVED)} for found in (one, both)]
    assert told[0] < told[1]
    assert sum(both.scans[0].told.values()) == sum(each.verdict != UNSCANNED for each in one.elements)
    assert both.scans[0].told[UNSCANNED] == 0  # is what all are called before the first scan
    assert sum(both.scans[1].told.values()) >= len(told[1] - told[0])


def _two_views():
    """An unchanged room, scanned ideally from its middle towards two sides."""
    from warp_scanner.sensors.poses import rotation_of

    pairs, row, _, prior, _ = next(room_cases("unchanged", "clean", UNSEEN_SEED, range(1)))
    place, yaw, scans = pairs.pose.position[row].astype(float), float(pairs.pose.yaw[row]), []
    for turn in (yaw, yaw + 150.0):
        rotation = rotation_of([turn], [0.0])[0].astype(float)
        direction = (OAK_D_PRO_SMALL.directions() @ rotation.T).astype(np.float32)
        reach = cast_triangles(prior.scene, Rays(place[None], direction)).distance[0]
        hit = np.isfinite(reach)
        points = (place + direction[hit] * reach[hit, None]).astype(np.float32)
        scans.append(PosedScan(points, place, rotation, OAK_D_PRO_SMALL))
    return scans, (prior, pairs)


def test_a_pose_that_is_put_right_is_told_of_the_scan_and_is_no_doubt(judges):
    scans, (prior, _) = _two_views()
    cos, sin = np.cos(np.radians(3.0)), np.sin(np.radians(3.0))
    turn, place = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]]), scans[0].position
    points = ((scans[0].points - place) @ turn.T + place).astype(np.float32)
    off = scans[0]._replace(points=points, rotation=turn @ scans[0].rotation)
    (record,) = detect_scans(prior, [named(off)], judges, DetectSettings()).scans
    assert "its pose was off by 0.00 m and 3.0 degrees: put right" in record.notes and not record.doubted
    (record,) = detect_scans(prior, [named(scans[0])], judges, DetectSettings()).scans
    assert not any("its pose was" in note for note in record.notes)


def test_nothing_is_found_where_nothing_changed_and_georeferenced_rooms_are_the_same(judges):
    scans, (prior, _) = _two_views()
    found = detect_scans(prior, [named(scans[0])], judges, DetectSettings())
    assert found.mismatches == () and found.scans[0].registration["shift"] < 0.01
    grid = np.array([155_000.0, 463_000.0, 12.0])
    there = prior_of_building(prior.building._replace(origin=grid))
    again = detect_scans(there, [named(scans[0])], judges, DetectSettings())
    assert [one.verdict for one in again.elements] == [one.verdict for one in found.elements]
    np.testing.assert_allclose(np.subtract(again.scans[0].pose[:3], found.scans[0].pose[:3]), grid, atol=1e-6)


def test_a_cloud_is_a_prior_too(judges):
    """Objects of a wall that is gone, from two clouds alone."""
    right = total = 0
    for pairs, row, _, _, scan in room_cases("wall_removed", "clean", UNSEEN_SEED, range(6)):
        reach = pairs.dt.distance[row]
        hit = np.isfinite(reach)
        direction = pairs.directions[hit] @ scan.rotation.T
        cloud = prior_of_cloud(scan.position + direction * reach[hit, None])
        found = detect_scans(cloud, [named(scan)], judges, AS_IS)
        true, shown = true_boxes(pairs, row, -1)
        assert found.elements == ()
        if shown[0] > 0.5:
            total += 1
            right += len(match_boxes([box_of(one) for one in found.mismatches if one.mismatch_type == "removed"], true))
    assert total >= 2 and right >= total - 1


def test_a_cloud_refuses_what_was_scanned_elsewhere_and_takes_what_looks_past_a_wall_that_is_gone(judges):
    """In room 4 of this seed most of the walls in view are behind the one that is gone, which no cloud shows."""
    walls_asked = dataclasses.replace(OF_CLOUDS, least_upright=0.6)
    registered = dataclasses.replace(AS_IS, refine=True, cloud_limits=walls_asked)
    case, other = room_cases("wall_removed", "occluded", 21, range(4, 6))
    cloud = as_cloud(case)
    found = detect_scans(cloud, [named(case.scan)], judges, registered)
    assert [(one.object_type, one.mismatch_type) for one in found.mismatches] == [("wall", "removed")]
    turn = case.scan.rotation @ other.scan.rotation.T
    points = ((other.scan.points - other.scan.position) @ turn.T + case.scan.position).astype(np.float32)
    with pytest.raises(InputError, match=r"strange: the scan does not fit the prior"):
        detect_scans(cloud, [named(case.scan._replace(points=points), "strange")], judges, registered)


def test_the_floor_of_a_storey_without_a_slab_is_where_it_begins(judges):
    """A room of the generator whose floor is 3.4 m lower, on a storey of that height."""
    (case,) = room_cases("pillar_added", "clean", UNSEEN_SEED, range(1))
    building = case.prior.building
    level = building.triangles.semantic == FLOOR
    vertices = building.triangles.vertices.copy()
    of_floor = np.unique(building.triangles.faces[level[building.triangles.element]])
    vertices[of_floor, 2] -= 3.4
    rays = rays_of_scan(case.scan)
    floor = look_at(case.prior, rays, judges)[0].levels[0]
    for elevation, expected in ((floor, floor), (floor + 40.0, floor - 3.4)):
        storeys = building.storeys._replace(elevation=np.array([elevation]))
        open_below = building._replace(triangles=building.triangles._replace(vertices=vertices), storeys=storeys)
        found = look_at(prior_of_building(open_below), rays, judges)[0].levels[0]
        assert found == pytest.approx(expected, abs=0.02)


def test_a_scan_that_does_not_fit_names_its_file(judges):
    scans, (prior, _) = _two_views()
    rng = np.random.default_rng(0)
    cloud = (scans[0].position + rng.normal(size=(9000, 3)) * [1.0, 1.0, 0.3]).astype(np.float32)
    settings = dataclasses.replace(DetectSettings(), limits=FitLimits(least_overlap=0.5))
    with pytest.raises(InputError, match=r"^lost\.ply: the scan does not fit"):
        detect_scans(prior, [named(scans[0]._replace(points=cloud), "lost.ply")], judges, settings)
