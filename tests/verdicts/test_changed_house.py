"""A house of boxes of which something is gone, off its place, open or hanging: what detection makes of it."""

import dataclasses

import numpy as np
import pytest

from jaxmm.rays.scan_rays import PosedScan
from jaxmm.verdicts.detection import detect_scans
from jaxmm.verdicts.priors import prior_of_building, prior_of_cloud
from jaxmm.verdicts.settings import DetectSettings
from jaxmm.verdicts.verdicts import DISPLACED, REMOVED
from tests.cases.box_building import building_of
from tests.cases.exact_poses import AS_IS, named
from warp_scanner.scenes.scenes import CEILING, DOOR, FLOOR, PILLAR, TABLE, WALL, WINDOW
from warp_scanner.sensors.scan import Rays
from warp_scanner.sensors.sensors import OAK_D_PRO_SMALL
from warp_scanner.sensors.triangles import cast_triangles, prepare

BEYOND = ((6, 0, 1.3), (0.1, 6, 1.3), WALL)


def walls_of_room(at, *more, far_wall=((0, 2.85),)):
    """A room of 8 x 6 m, its far wall (elements from 5 on) at `at` [m] in x; the sensor looks along x.

    Of the far wall there are parts (y, half its length), and `more` are other boxes; by default a wall BEYOND.
    """
    return building_of((
        ((0, 0, -0.1), (8, 6, 0.1), FLOOR), ((0, 0, 2.7), (8, 6, 0.1), CEILING), ((-4, 0, 1.3), (0.1, 3, 1.3), WALL),
        ((0, 3, 1.3), (4, 0.1, 1.3), WALL), ((0, -3, 1.3), (4, 0.1, 1.3), WALL),
        *(((at, y, 1.3), (0.1, half, 1.3), WALL) for y, half in far_wall), *(more or (BEYOND,)),
    ))  # fmt: skip


def scan_of(building, position):
    """What a level camera sees of a building along x."""
    direction = OAK_D_PRO_SMALL.directions()
    distance = cast_triangles(prepare(building.triangles), Rays(position[None], direction)).distance[0]
    points = position + direction[np.isfinite(distance)] * distance[np.isfinite(distance), None]
    return PosedScan(points.astype(np.float32), position, np.eye(3), OAK_D_PRO_SMALL)


MORE_OFF = (False, -1.0), (False, -0.5), (False, 0.5), (True, 0.5)


@pytest.mark.parametrize(
    "near, by",
    [(False, 0.35), (False, 1.0), (True, -0.5), (True, 0.35)]
    + [pytest.param(*one, marks=pytest.mark.long) for one in MORE_OFF],
)
def test_a_wall_that_was_built_off_its_place_is_gone_there_and_new_here(judges, near, by):
    """Before its old place or behind it; `near` the camera it fills the view, and hardly anything else tells.

    Nothing but that wall holds the pose along x: a registration may take the pose for off instead, but not silently.
    """
    position = np.array([1.5 if near else -2.0, 0.2, 1.4])
    prior, scan = prior_of_building(walls_of_room(3.0)), scan_of(walls_of_room(3.0 + by), position)
    for refine in (False, True):
        found = detect_scans(prior, [named(scan)], judges, DetectSettings(refine=refine, propose_views=False))
        if refine and found.scans[0].registration["shift"] > 0.1:
            assert f"off by {abs(by):.2f} m" in str(found.scans[0].doubts)
            continue
        (gone,) = [one for one in found.elements if one.guid == prior.building.elements.guid[5]]
        new = [one for one in found.mismatches if one.mismatch_type == "added"]
        assert [one.object_type for one in new] == ["wall"]
        assert new[0].center[0] == pytest.approx(3.0 + by, abs=0.08)
        if by > 0.0:  # else the new one hides it
            assert gone.verdict == REMOVED


@pytest.mark.parametrize("away", [0.4, 0.9])
@pytest.mark.parametrize("width", [0.3, 0.5])
def test_a_column_that_moved_straight_away_is_gone_there_and_new_here(judges, away, width):
    """Its old place is before it: all that is seen of it is beyond what the rays should have met, as old things are."""
    column, moved = (((x, 0.2, 1.3), (width / 2, width / 2, 1.3), PILLAR) for x in (0.5, 0.5 + away))
    prior, position = prior_of_building(walls_of_room(3.0, column)), np.array([-2.0, 0.2, 1.4])
    found = detect_scans(prior, [named(scan_of(walls_of_room(3.0, moved), position))], judges, AS_IS)
    gone, new = found.mismatches
    assert (gone.mismatch_type, new.mismatch_type, new.object_type) == ("removed", "added", "pillar")
    assert np.abs(new.center[:2] - [0.5 + away, 0.2]).max() < 0.06 and new.moved_from == 0


@pytest.mark.parametrize("away", [0.06, 0.15, 0.25])
def test_a_column_that_stands_straight_behind_its_place_is_displaced(judges, away):
    """As a wall is: neither gone nor new."""
    column, moved = (((x, 0.2, 1.3), (0.2, 0.2, 1.3), PILLAR) for x in (0.5, 0.5 + away))
    prior, position = prior_of_building(walls_of_room(3.0, column)), np.array([-2.0, 0.2, 1.4])
    found = detect_scans(prior, [named(scan_of(walls_of_room(3.0, moved), position))], judges, AS_IS)
    assert not found.mismatches
    (told,) = [one for one in found.elements if one.verdict == DISPLACED]
    assert told.deviation.offset == pytest.approx((away, 0.0, 0.0), abs=1e-3)


@pytest.mark.parametrize("by", [0.06, -0.06, 0.25, -0.25])
def test_a_wall_that_stands_off_its_place_is_displaced(judges, by):
    """From either side: neither gone, nor hidden, nor new."""
    position = np.array([-2.0, 0.2, 1.4])
    prior, scan = prior_of_building(walls_of_room(3.0)), scan_of(walls_of_room(3.0 + by), position)
    found = detect_scans(prior, [named(scan)], judges, AS_IS)
    assert not found.mismatches
    (told,) = [one for one in found.elements if one.verdict == DISPLACED]
    assert told.guid == prior.building.elements.guid[5] and found.summary().count("1 displaced") == 1
    assert told.deviation.offset == pytest.approx((by, 0.0, 0.0), abs=1e-4)


def test_what_is_not_of_its_size_behind_a_column_that_is_gone_is_no_column(judges):
    column, cabinet = ((0.5, 0.2, 1.3), (0.2, 0.2, 1.3), PILLAR), ((1.4, 0.2, 0.9), (0.3, 0.5, 0.9), TABLE)
    prior, position = prior_of_building(walls_of_room(3.0, column)), np.array([-2.0, 0.2, 1.4])
    found = detect_scans(prior, [named(scan_of(walls_of_room(3.0, cabinet), position))], judges, AS_IS)
    assert [one.mismatch_type for one in found.mismatches] == ["removed"]


def test_open_doors_are_told_but_for_those_in_walls_that_are_gone(judges):
    sides, door = [(1.7, 1.2), (-1.7, 1.2)], ((3.0, 0.0, 1.3), (0.02, 0.5, 1.3), DOOR)
    house, position = walls_of_room(3.0, door, BEYOND, far_wall=sides), np.array([-2.0, 0.2, 1.4])
    shut, opened = scan_of(house, position), scan_of(walls_of_room(3.0, far_wall=sides), position)

    def told(scan, **settings):
        found = detect_scans(prior_of_building(house), [named(scan)], judges, dataclasses.replace(AS_IS, **settings))
        return [note for note in found.notes if "let rays pass" in note or "lets rays pass" in note]

    (note,) = told(opened)
    assert note.startswith("1 door lets rays pass") and "--open-doors" in note
    assert told(shut) == told(opened, classes=("wall", "door")) == []
    whole = walls_of_room(3.0, door, BEYOND)  # a wall that the door is in
    gone = detect_scans(prior_of_building(whole), [named(scan_of(walls_of_room(6.0), position))], judges, AS_IS)
    assert any(one.mismatch_type == "removed" for one in gone.mismatches)
    assert not any("rays pass" in note for note in gone.notes)


def test_a_new_wall_has_openings_that_one_looks_through(judges):
    """Two metres of wall around an open window; what is seen between posts, from floor to ceiling, is no opening."""
    sides = [((0.0, 0.2 + y, 1.3), (0.1, 0.3, 1.3), WALL) for y in (-0.7, 0.7)]
    rest = [((0.0, 0.2, z), (0.1, 0.4, half), WALL) for z, half in ((0.4, 0.4), (2.3, 0.3))]
    prior, position = prior_of_building(walls_of_room(3.0)), np.array([-2.5, 0.2, 1.4])
    (new,) = detect_scans(
        prior, [named(scan_of(walls_of_room(3.0, *sides, *rest), position))], judges, AS_IS
    ).mismatches
    assert new.object_type == "wall" and np.abs(new.center[:2] - [0.0, 0.2]).max() < 0.1
    assert max(new.dimensions[:2]) == pytest.approx(2.0, abs=0.1)
    for gap in (0.3, 0.8):
        posts = [((0.0, 0.2 + way * (0.3 + gap / 2), 1.3), (0.3, 0.3, 1.3), WALL) for way in (-1.0, 1.0)]
        two = detect_scans(prior, [named(scan_of(walls_of_room(3.0, *posts), position))], judges, AS_IS).mismatches
        assert [one.object_type for one in two] == ["pillar", "pillar"]


def found_of_gone(judges, real, prior, position=(-2.0, 0.2, 1.4)):
    """Whether the far wall is told as removed, and the mismatches that are new."""
    prior = prior_of_building(prior)
    found = detect_scans(prior, [named(scan_of(real, np.array(position)))], judges, AS_IS)
    (gone,) = [one for one in found.elements if one.guid == prior.building.elements.guid[5]]
    return gone.verdict == REMOVED, [one for one in found.mismatches if one.mismatch_type == "added"]


def test_a_part_of_a_wall_that_still_stands_is_not_new(judges):
    gone, new = found_of_gone(judges, walls_of_room(3.0, far_wall=((-1.9, 0.95),)), walls_of_room(3.0))
    assert gone and new == []


def test_doors_and_windows_are_gone_with_their_wall_and_hide_nothing_new(judges):
    openings = (((3.0, -0.7, 1.4), (0.11, 1.9, 1.1), WINDOW), ((3.0, 2.0, 1.2), (0.11, 0.7, 1.2), DOOR))
    gone, (new,) = found_of_gone(judges, walls_of_room(3.5), walls_of_room(3.0, BEYOND, *openings))
    assert gone and new.object_type == "wall" and new.center[0] == pytest.approx(3.5, abs=0.08)
    assert new.dimensions[:2].max() > 4.5


@pytest.mark.parametrize("at", [0.6, 0.9, 1.2])
def test_sides_of_windows_that_hang_where_their_wall_is_gone_are_not_new(judges, at):
    """Nobody saw them before: the wall hid them."""
    windows = [((3.0, way * (at + 0.45), 1.25), (0.11, 0.45, 1.05), WINDOW) for way in (-1.0, 1.0)]
    gone, new = found_of_gone(
        judges, walls_of_room(3.0, BEYOND, *windows, far_wall=()), walls_of_room(3.0, BEYOND, *windows), (1.2, 0.0, 1.4)
    )
    assert gone and new == []


def test_a_wall_that_the_model_lacks_is_found_around_the_windows_that_it_has(judges):
    """Strips of 0.7 m between windows, much of them within 0.1 m of these; each alone may be anything."""
    windows = [((3.0, y, 1.3), (0.05, 0.35, 0.9), WINDOW) for y in np.arange(-2.1, 2.2, 1.4)]
    prior = prior_of_building(walls_of_room(3.0, BEYOND, *windows, far_wall=()))
    found = detect_scans(
        prior, [named(scan_of(walls_of_room(3.0, BEYOND, *windows), np.array([1.6, 0.2, 1.4])))], judges, AS_IS
    )
    (new,) = found.mismatches
    assert new.object_type == "wall" and new.center[0] == pytest.approx(3.0, abs=0.1)
    assert any("4 doors and windows of the model are in no wall" in note for note in found.notes)


def test_what_is_seen_through_a_gone_outer_wall_is_not_new(judges):
    """A house across the street, on ground that is in the model; floor and ceiling end at the outer wall."""
    ground, across = ((8.0, 0.0, -0.3), (12.0, 12.0, 0.05), TABLE), ((9.0, 0.0, 1.5), (0.2, 6.0, 2.0), WALL)

    prior, real = walls_of_room(3.9, ground), walls_of_room(3.9, ground, across, far_wall=())
    gone, new = found_of_gone(judges, real, prior)
    assert gone and new == []
    _, (behind,) = found_of_gone(judges, walls_of_room(3.5), walls_of_room(3.0))  # indoors it is
    assert behind.center[0] == pytest.approx(3.5, abs=0.08)


@pytest.mark.parametrize(
    "thing",
    [((4.6, 0.0, 1.3), (0.4, 0.4, 1.3)), ((5.4, 0.5, 1.3), (0.1, 1.5, 1.3)), ((3.6, 1.0, 1.3), (0.4, 0.1, 1.3))],
)
def test_behind_what_is_gone_only_a_wall_beside_its_place_is_new(judges, thing):
    """No pillar, no wall in the next room, none across: of what stands there nobody knows since when."""
    real = walls_of_room(3.0, BEYOND, (*thing, WALL), far_wall=())
    gone, new = found_of_gone(judges, real, walls_of_room(3.0))
    assert gone and new == []


@pytest.mark.parametrize("dark", [1.5, 1.8, 2.0])
def test_against_a_cloud_what_brings_nothing_back_is_not_looked_through(judges, dark):
    """Nobody knows where nothing should come back from: the upper part of a pillar is dark."""
    position, pillar = np.array([-2.0, 0.2, 1.4]), ((0.8, 0.9, 1.3), (0.25, 0.25, 1.3), PILLAR)
    prior = prior_of_cloud(scan_of(walls_of_room(3.0), position).points.astype(np.float64))
    scan = scan_of(walls_of_room(3.0, BEYOND, pillar), position)
    on_it = np.all(np.abs(scan.points[:, :2] - [0.8, 0.9]) < 0.3, axis=1)
    scan = scan._replace(points=scan.points[~on_it | (scan.points[:, 2] < dark)])
    found = detect_scans(prior, [named(scan)], judges, AS_IS).mismatches
    assert [(one.object_type, one.mismatch_type) for one in found] == [("pillar", "added")]


A_TABLE = ((-1.4, 0.4, 0.65), (0.2, 0.6, 0.65), TABLE)


@pytest.mark.parametrize("height, more", [(1.2, ()), (1.8, ()), (2.6, ()), (3.2, ()), (2.6, (A_TABLE,))])
def test_in_the_open_things_end_where_nothing_comes_back_above_them(judges, height, more):
    """Nothing is behind them: what ends as low as furniture is none of the building's, and what does not is."""
    slab, wall = ((0, 0, -0.1), (8, 6, 0.1), FLOOR), ((4.0, -3.5, 2.5), (0.1, 1.5, 2.5), WALL)
    thing = ((0.8, 0.9, height / 2), (0.25, 0.25, height / 2), PILLAR)
    prior, position = prior_of_building(building_of((slab, wall))), np.array([-3.0, 0.0, 1.4])
    scan = scan_of(building_of((slab, wall, thing, *more)), position)
    found = detect_scans(prior, [named(scan)], judges, AS_IS).mismatches
    if height < 2.25:
        assert found == ()
    else:
        (new,) = found
        assert new.object_type == "pillar" and np.abs(new.center[:2] - [0.8, 0.9]).max() < 0.1
        assert new.dimensions[2] == pytest.approx(height, abs=0.15)
        assert new.measured[2] == (not more)  # nobody saw its foot behind a table


def with_capital(y):
    """The room with a column, whose head is part of it, at (1, y)."""
    room = walls_of_room(4.0, ((1, y, 1.3), (0.2, 0.2, 1.3), PILLAR), ((1, y, 2.4), (0.5, 0.5, 0.2), PILLAR))
    column = len(room.elements.guid) - 2
    triangles = room.triangles._replace(
        element=np.minimum(room.triangles.element, column), semantic=room.triangles.semantic[: column + 1]
    )
    elements = room.elements._replace(**{name: one[: column + 1] for name, one in room.elements._asdict().items()})
    return room._replace(triangles=triangles, elements=elements)


def test_a_column_with_a_capital_that_moved_is_known_again_by_its_shaft(judges):
    prior, position = prior_of_building(with_capital(-0.7)), np.array([-2.5, 0.0, 1.3])
    (section,) = prior.known.columns
    assert section == pytest.approx((0.4, 0.4, False)) and prior.known.own.longer[-1] == pytest.approx(0.4)
    found = detect_scans(prior, [named(scan_of(with_capital(0.8), position))], judges, AS_IS).mismatches
    (new,) = (one for one in found if one.mismatch_type == "added")
    (gone,) = (one for one in found if one.mismatch_type == "removed")
    assert (new.object_type, gone.object_type, found[new.moved_from].element) == ("pillar", "pillar", gone.element)
    np.testing.assert_allclose(new.center, [1.0, 0.8, 1.3], atol=0.05)
    np.testing.assert_allclose(new.dimensions, [0.4, 0.4, 2.6], atol=0.08)
    np.testing.assert_allclose(gone.dimensions, [1.0, 1.0, 2.6], atol=1e-3)
