"""What a scan is compared with, whatever file it comes in."""

import re

import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree

from jaxmm.files import sha256_of
from jaxmm.formats.readers import PointScan
from jaxmm.inputs import InputError
from jaxmm.learning.prediction import read_judges
from jaxmm.verdicts.detection import detect_scans
from jaxmm.verdicts.priors import (
    _stray,
    distance_from,
    kind_of,
    prior_of_building,
    prior_of_cloud,
    read_prior,
    unasked,
    without_stray,
)
from jaxmm.verdicts.results import PriorFile
from jaxmm.verdicts.settings import DetectSettings
from jaxmm.weights import DEFAULT
from tests.cases.box_building import building_of, scan_of
from tests.cases.valid_ifc import ifc_text
from warp_scanner.buildings.room_buildings import building_of_room
from warp_scanner.scenes.building import ReadOptions, element_bounds
from warp_scanner.scenes.scenes import BOX, CYLINDER, FLOOR, PILLAR, WALL, Primitives
from warp_scanner.sensors.sensors import OUSTER_64
from warp_scanner.sensors.triangles import clearance, prepare


def walls_and_columns():
    """Two walls of 0.2 m, one of 0.1 m that stands askew, and a column of 0.4 x 0.3 m."""
    size = np.array([[4, 0.2, 3], [6, 0.2, 3], [3, 0.1, 3], [0.4, 0.3, 3]]) / 2
    place = np.array([[0, 0, 1.5], [0, 4, 1.5], [6, 2, 1.5], [2, 2, 1.5]])
    return Primitives(
        np.array([[BOX] * 4], np.uint8), place[None].astype(np.float32), size[None].astype(np.float32),
        np.array([[0, 0, 0.5, 0.2]], np.float32), np.arange(4, dtype=np.int32)[None],
        np.array([[WALL, WALL, WALL, PILLAR]], np.uint8),
    )  # fmt: skip


def test_sizes_are_the_buildings_own_however_it_is_turned():
    prior = prior_of_building(building_of_room(walls_and_columns(), 0)[0])
    assert prior.known.walls == pytest.approx((0.2, 0.1))
    assert prior.known.columns[0][:2] == pytest.approx((0.3, 0.4)) and prior.has_elements


NOBODY = np.zeros(4, bool)


def test_parts_of_curtain_walls_are_named_as_what_gets_no_verdict():
    building = building_of_room(walls_and_columns(), 0)[0]
    assert not unasked(building, NOBODY)
    table = building.elements._replace(ifc_class=("IfcPlate", "IfcWall", "IfcMember", "IfcColumn"))
    (note,) = unasked(building._replace(elements=table), NOBODY)
    assert note.startswith("note: 2 elements are of the classes IfcCurtainWall, IfcPlate, IfcMember")
    (note,) = unasked(building._replace(elements=table), np.array([True, False, False, False]))
    assert note.startswith("note: 1 element is")
    assert not unasked(building._replace(elements=table), ~NOBODY)


def test_what_may_be_a_column_by_another_name_is_told_to_get_no_verdict():
    building = building_of_room(walls_and_columns(), 0)[0]
    table = building.elements._replace(ifc_class=("IfcWall", "IfcWall", "IfcWall", "IfcBuildingElementProxy"))
    low, high = element_bounds(building.triangles)
    tall = float(high[3, 2] - low[3, 2]) >= 2.0
    assert tall and unasked(building._replace(elements=table), NOBODY) == [
        "note: 1 element is of the class IfcBuildingElementProxy and 2 m high or higher: "
        "rays meet it, but it gets no verdict"
    ]
    flat = building.triangles._replace(vertices=building.triangles.vertices * np.float32([1.0, 1.0, 0.3]))
    assert not unasked(building._replace(elements=table, triangles=flat), NOBODY)


def test_sizes_are_known_to_the_millimetre_and_counted_by_the_centimetre():
    """Bricks are 0.115 m wide: rounded to a centimetre, a new wall would be told too thick, as measured."""
    table = walls_and_columns()
    table.half_size[0, :, 1] = np.array([0.364, 0.364, 0.362, 0.305]) / 2
    known = prior_of_building(building_of_room(table, 0)[0]).known
    assert known.walls == (0.364,) and known.usual_wall == 0.364 and known.columns == ((0.305, 0.4, False),)
    table.half_size[0, :3, 1] = np.array([0.115, 0.24, 0.24]) / 2
    assert prior_of_building(building_of_room(table, 0)[0]).known.walls == (0.24, 0.115)


def test_the_usual_thickness_is_that_of_half_the_length_of_the_walls():
    table = walls_and_columns()
    for length, usual in ((3.0, 0.2), (9.9, 0.2), (10.1, 0.1)):  # of the thin one; the others are 10 m long
        table.half_size[0, 2, 0] = length / 2
        assert prior_of_building(building_of_room(table, 0)[0]).known.usual_wall == pytest.approx(usual)
    assert prior_of_cloud(np.zeros((5, 3))).known.usual_wall == 0.0


@pytest.mark.parametrize("turn", [0.0, 0.4, 2.0])
def test_inner_walls_say_what_is_usual_where_they_are_thinner_than_outer_ones(turn):
    """A house of 12 x 8 m with one wall across it, a shorter one that ends free, and a porch's wall outside."""

    def house(outer, inner, porch=0.1, has_inner=True):
        size = [
            [12, outer, 3],
            [12, outer, 3],
            [outer, 8, 3],
            [outer, 8, 3],
            [porch, 3, 3],
            [inner, 8, 3],
            [3, inner, 3],
        ]
        place = [[0, -4, 1.5], [0, 4, 1.5], [-6, 0, 1.5], [6, 0, 1.5], [9, 0, 1.5], [2, 0, 1.5], [-1, 1, 1.5]]
        count = 7 if has_inner else 5
        way = np.array([[np.cos(turn), np.sin(turn), 0], [-np.sin(turn), np.cos(turn), 0], [0, 0, 1]])
        table = Primitives(
            np.array([[BOX] * count], np.uint8), (np.array(place) @ way)[None, :count].astype(np.float32),
            np.array(size)[None, :count].astype(np.float32) / 2, np.full((1, count), turn, np.float32),
            np.arange(count, dtype=np.int32)[None], np.full((1, count), WALL, np.uint8),
        )  # fmt: skip
        return prior_of_building(building_of_room(table, 0)[0]).known.usual_wall

    assert house(0.4, 0.12) == pytest.approx(0.12)
    assert house(0.3, 0.36) == pytest.approx(0.3)
    assert house(0.4, 0.12, has_inner=False) == pytest.approx(0.4)


def test_walls_that_may_pass_for_pillars_are_short_but_longer_than_thick():
    table = walls_and_columns()
    table.half_size[0, :3, 0] = (0.6, 0.15, 0.9)  # 1.2, 0.3 and 1.8 m long
    assert prior_of_building(building_of_room(table, 0)[0]).known.short_walls == (pytest.approx((0.2, 1.2)),)


def test_a_round_column_is_as_wide_as_it_is_deep():
    table = walls_and_columns()
    table.kind[0, 3], table.half_size[0, 3] = CYLINDER, (0.25, 0.25, 1.5)
    prior = prior_of_building(building_of_room(table, 0)[0])
    assert prior.known.columns[0][:2] == pytest.approx((0.5, 0.5), abs=0.02)


def test_distances_are_to_the_surface_within_reach():
    prior = prior_of_building(building_of_room(walls_and_columns(), 0)[0])
    found = distance_from(prior)(np.array([[0, 1.1, 1.5], [0, 0.05, 1.5], [50, 0, 0]]), 2.0)
    np.testing.assert_allclose(found, [1.0, 0.05, np.inf], atol=1e-5)


def test_a_ply_without_faces_is_a_cloud_and_with_them_a_building(tmp_path):
    box = trimesh.creation.box((4, 3, 2.5))
    trimesh.PointCloud(box.sample(5000)).export(tmp_path / "cloud.ply")
    box.export(tmp_path / "mesh.ply")
    cloud, mesh = read_prior(tmp_path / "cloud.ply"), read_prior(tmp_path / "mesh.ply")
    assert [kind_of(tmp_path / name) for name in ("cloud.ply", "mesh.ply")] == ["cloud", "mesh"]
    assert not cloud.has_elements and mesh.has_elements and cloud.known.walls == ()
    assert abs(distance_from(cloud)(box.sample(200), 1.0)).max() < 0.25


def test_the_prior_says_which_file_it_is_and_in_which_unit(tmp_path):
    box = trimesh.creation.box((4, 3, 2.5))
    np.save(tmp_path / "cloud.npy", box.sample(5000))
    box.export(tmp_path / "mesh.STL", file_type="stl")
    foot = ReadOptions(unit=0.3048)
    cloud, mesh = (sha256_of(tmp_path / name) for name in ("cloud.npy", "mesh.STL"))
    assert cloud != mesh
    assert read_prior(tmp_path / "cloud.npy").file == PriorFile("cloud.npy", "cloud", 1.0, None, cloud)
    assert read_prior(tmp_path / "cloud.npy", foot).file == PriorFile("cloud.npy", "cloud", 0.3048, None, cloud)
    assert read_prior(tmp_path / "mesh.STL", foot).file == PriorFile("mesh.STL", "mesh", 0.3048, None, mesh)
    assert prior_of_cloud(box.sample(100)).file is None


@pytest.mark.parametrize(
    "old, new, unit",
    [(b"", b"", 0.001), (b".MILLI.,.METRE.", b"$,.METRE.", 1.0), (b".MILLI.,.METRE.", b".CENTI.,.METRE.", 0.01)],
)
def test_an_ifc_file_says_its_unit_and_project(tmp_path, old, new, unit):
    pytest.importorskip("ifcopenshell")
    text = ifc_text("IFC4")
    assert old in text
    (tmp_path / "a.ifc").write_bytes(text.replace(old, new))
    guid = re.search(rb"IFCPROJECT\('([^']*)'", text)[1].decode()
    told = PriorFile("a.ifc", "ifc", pytest.approx(unit), guid, sha256_of(tmp_path / "a.ifc"))
    assert read_prior(tmp_path / "a.ifc").file == told


def test_a_cloud_without_points_is_no_prior():
    with pytest.raises(ValueError, match="expected the points of a prior, got none"):
        prior_of_cloud(np.zeros((0, 3)))


def test_a_cloud_on_a_national_grid_loses_nothing():
    corner = np.array([155_000.25, 463_000.5, 12.0])
    points = corner + np.random.default_rng(0).random((4000, 3)) * [10, 8, 3]
    prior = prior_of_cloud(points)
    back = prior.cloud.astype(np.float64) + prior.origin
    assert 100 < len(back) < 4000 and np.abs(prior.cloud).max() < 20
    from scipy.spatial import cKDTree

    assert cKDTree(points).query(back)[0].max() < 1e-5


@pytest.mark.parametrize(
    "name, word", [("none.ifc", "nothing there"), ("folder.ifc", "a folder"), ("x.doc", "ending in")]
)
def test_what_is_no_prior_is_refused_in_one_line(tmp_path, name, word):
    (tmp_path / "folder.ifc").mkdir()
    (tmp_path / "x.doc").write_bytes(b"hello")
    with pytest.raises(InputError, match=word) as told:
        read_prior(tmp_path / name)
    assert name in str(told.value) and "\n" not in str(told.value)


ROOM = (
    ((0, 0, -0.1), (4, 3, 0.1), FLOOR), ((0, 0, 2.7), (4, 3, 0.1), FLOOR), ((4.1, 0, 1.3), (0.1, 3, 1.3), WALL),
    ((-4.1, 0, 1.3), (0.1, 3, 1.3), WALL), ((0, 3.1, 1.3), (4, 0.1, 1.3), WALL), ((0, -3.1, 1.3), (4, 0.1, 1.3), WALL),
    ((1.5, 0.4, 1.3), (0.2, 0.2, 1.3), PILLAR),
)  # fmt: skip
PLACE = np.array([-2.0, 0.0, 1.4])


def scan_with_a_trail(far, unit):
    """A scan of a room whose ranges err, with 60 mixed ones behind one edge of its column."""
    points, rng = scan_of(ROOM, PLACE, OUSTER_64).scan.points.astype(np.float64), np.random.default_rng(0)
    points = PLACE + (points - PLACE) * (1.0 + rng.normal(0.0, 0.003, (len(points), 1)))
    trail = PLACE + (np.array([1.3, 0.6, 0.0]) - PLACE) * rng.uniform(1.1, 1.6, (60, 1))
    trail[:, 2] = rng.uniform(0.5, 2.0, 60)
    return PointScan((np.concatenate([points, trail]) + far) / unit, (PLACE + far) / unit, np.eye(3), (), True)


def strays_of(scans, unit=1.0):
    """The prior of some scans in its own frame, and its points that hang in the middle of the room."""
    prior = prior_of_cloud(np.concatenate([scan.points for scan in scans]) * unit)
    return prior._replace(stray=_stray(prior, scans, unit))


@pytest.mark.parametrize("far, unit", [((0.0, 0.0, 0.0), 1.0), ((150000.0, 460000.0, 20.0), 0.001)])
def test_what_trails_behind_an_edge_is_none_of_a_prior_scanned_from_a_known_place(far, unit):
    scan, surface = scan_with_a_trail(np.array(far), unit), prepare(building_of(ROOM).triangles)
    prior = strays_of([scan], unit)
    hangs = clearance(surface, prior.cloud + prior.origin - far, 1.0) > 0.15
    assert hangs.sum() > 40 and prior.stray[hangs].mean() > 0.9 and prior.stray[~hangs].mean() < 0.005
    without = without_stray(prior)
    np.testing.assert_array_equal(without.cloud, prior.cloud[~prior.stray])
    assert "of the prior's points, between surfaces" in without.notes[-1] and without_stray(without) is without
    for other in (scan._replace(in_world=False), scan._replace(position=None, rotation=None, in_world=False)):
        assert not strays_of([other], unit).stray.any()  # a remark in its file, or nothing, on where it is from


def test_an_exact_prior_and_one_of_several_scans_stay_as_they_are():
    places, rooms = (PLACE, np.array([3.0, -1.0, 1.4])), (*ROOM, ((0, 0, 1.3), (0.1, 3, 1.3), WALL))
    exact, other = (scan_of(rooms, place, OUSTER_64).scan.points.astype(np.float64) for place in places)
    noise = np.random.default_rng(1).normal(0.0, 0.01, (len(exact) + len(other), 3))
    both = np.concatenate([exact, other])
    for points in (exact, both + noise):
        assert not strays_of([PointScan(points, PLACE, np.eye(3), (), True)]).stray.any()
    scan = scan_with_a_trail(np.zeros(3), 1.0)
    seen_by_another = PointScan(scan.points[-60:], None, None, ())  # what hangs in one scan stands in the other
    trail = cKDTree(scan.points[-60:])
    for scans, most in (([scan], 60), ([scan, seen_by_another], 0)):
        prior = strays_of(scans)
        assert np.sum(trail.query(prior.cloud[prior.stray])[0] < 1e-3) in range(most > 0, most + 1)


@pytest.mark.parametrize("settings", [{}, {"settle": False}, {"preset": "thesis"}])
def test_a_prior_settles_only_where_scans_do(settings):
    prior = strays_of([scan_with_a_trail(np.zeros(3), 1.0)])
    robot = scan_of(ROOM, PLACE, OUSTER_64)
    found = detect_scans(prior, [robot], read_judges(DEFAULT), DetectSettings(**settings))
    assert any("of the prior's points" in note for note in found.notes) == (not settings)
