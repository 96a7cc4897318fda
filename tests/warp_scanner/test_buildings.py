"""Reading buildings: real IFC files land in metres and whole, meshes node by node, bad files end in one line."""

import importlib.util

import numpy as np
import pytest
import trimesh

from warp_scanner.buildings.files import read_building
from warp_scanner.buildings.ifc_model import unit_scale
from warp_scanner.buildings.positions import check_position
from warp_scanner.scenes.building import Failure, ReadOptions, bounds
from warp_scanner.scenes.building_edits import join
from warp_scanner.scenes.remarks import remarks
from warp_scanner.scenes.scenes import DOOR, OTHER, PILLAR, WALL, WINDOW
from warp_scanner.sensors.scan import Rays
from warp_scanner.sensors.triangles import cast_triangles, prepare

Y_UP = trimesh.transformations.rotation_matrix(-np.pi / 2, [1, 0, 0])  # as glTF wants it

# Elements, of them walls and columns; size [m] of what stands there; storeys.
REAL = {
    "IfcOpenHouse_IFC4": (14, 4, 0, (10.65, 5.8, 7.78), 1),
    "Schependomlaan_V_L_Constructief": (530, 296, 32, (23.24, 23.56, 14.7), 9),
    "Schependomlaan_XELLA_Begane_grond": (37, 37, 0, (21.3, 20.89, 3.0), 1),
    "bimwhale_LargeBuilding": (114, 18, 0, (53.19, 39.12, 8.15), 2),
    "bimwhale_TallBuilding": (55, 24, 0, (8.28, 8.2, 16.55), 5),
    "duplex_A": (215, 57, 0, (9.28, 26.56, 8.18), 4),
    "xbim_House": (134, 46, 5, (17.54, 14.11, 9.85), 3),
    "xbim_wall_door_column_4x3": (3, 1, 1, (6.67, 0.84, 6.1), 2),
}


@pytest.mark.long
@pytest.mark.parametrize("name", REAL)
def test_real_files_land_in_metres_with_every_element(real_building, name):
    building = real_building(name)
    count, walls, columns, size, storeys = REAL[name]
    elements = building.elements
    assert len(elements.guid) == len(set(elements.guid)) == count and building.failures == ()
    assert np.sum(elements.semantic == WALL) == walls and np.sum(elements.semantic == PILLAR) == columns
    low, high = bounds(building.triangles)
    np.testing.assert_allclose(high - low, size, atol=0.011)
    assert len(building.storeys.name) == storeys and np.all(np.diff(building.storeys.elevation) > 0)
    np.testing.assert_array_equal(np.unique(building.triangles.element), np.arange(count))
    assert np.mean(elements.storey >= 0) > 0.99


def test_a_quarter_of_the_house_is_not_lost_to_misused_stars(real_building):
    assert "by *" in real_building("xbim_House").notes[0]
    assert not any("by *" in note for note in real_building("duplex_A").notes)


def test_a_wall_of_blocks_is_one_element_under_the_name_of_the_wall(real_building):
    assert set(real_building("Schependomlaan_XELLA_Begane_grond").elements.ifc_class) == {"IfcWallStandardCase"}
    house = real_building("IfcOpenHouse_IFC4").elements
    assert np.sum(house.semantic == WINDOW) == 5 and "IfcMember" not in house.ifc_class


def test_open_doors_and_clear_glass_let_rays_pass(real_building, data_root):
    solid = real_building("duplex_A")
    path = data_root / "ifc" / "duplex_A.ifc"
    passable = read_building(path, ReadOptions(glass="transparent", doors="open"))
    assert DOOR in solid.elements.semantic and DOOR not in passable.elements.semantic
    window = solid.elements.semantic == WINDOW
    assert np.sum(passable.elements.semantic == WINDOW) == 22  # frames stay; two of the 24 are panes and nothing else
    # From the middle of every window, along its thinnest axis: glass stops the ray, clear glass does not.
    stopped = {}
    for name, building in (("solid", solid), ("clear", passable)):
        scene, blocked = prepare(building.triangles), []
        for guid in np.array(solid.elements.guid)[window]:
            corners = solid.triangles.vertices[
                solid.triangles.faces[solid.triangles.element == solid.elements.guid.index(guid)]
            ].reshape(-1, 3)
            middle, size = (corners.min(0) + corners.max(0)) / 2, np.ptp(corners, axis=0)
            axis = np.eye(3)[np.argmin(size)]
            # A quarter off the middle, where no window has its post.
            start = middle - 0.6 * axis + 0.13 * size * (1 - axis)
            hit = cast_triangles(scene, Rays(start[None], axis[None])).element[0, 0]
            blocked.append(hit >= 0 and building.elements.guid[hit] == guid)
        stopped[name] = np.mean(blocked)
    assert stopped["solid"] > 0.9 and stopped["clear"] < 0.3


def test_every_node_of_a_mesh_file_is_an_element(tmp_path):
    scene = trimesh.Scene()
    scene.add_geometry(trimesh.creation.box(extents=[4, 0.2, 3]), node_name="Wall 1", geom_name="a")
    turn = trimesh.transformations.translation_matrix([0, 3, 0])
    scene.add_geometry(
        trimesh.creation.cylinder(radius=0.2, height=3), node_name="column", geom_name="b", transform=turn
    )
    scene.add_geometry(trimesh.creation.box(extents=[1, 1, 1]), node_name="thing", geom_name="c", transform=2 * turn)
    path = tmp_path / "house.glb"
    path.write_bytes(scene.apply_transform(Y_UP).export(file_type="glb"))
    building = read_building(path)
    assert sorted(building.elements.name) == ["Wall 1", "column", "thing"]
    found = dict(zip(building.elements.name, building.elements.semantic, strict=True))
    assert found == {"Wall 1": WALL, "column": PILLAR, "thing": OTHER}
    assert "no storeys" in building.notes[0] and building.storeys.elevation[0] == pytest.approx(-1.5)


@pytest.mark.parametrize("suffix", ["obj", "ply", "stl", "glb"])
def test_units_and_axes_of_mesh_files(tmp_path, suffix):
    box = trimesh.creation.box(extents=[2000, 3000, 1000]).apply_translation([0, 1500, 0])
    path = tmp_path / f"box.{suffix}"
    box.export(path)
    up = None if suffix == "glb" else True  # glTF has y up anyway
    low, high = bounds(read_building(path, ReadOptions(y_up=up, unit=0.001)).triangles)
    np.testing.assert_allclose(low, [-1, -0.5, 0], atol=1e-6)
    np.testing.assert_allclose(high, [1, 0.5, 3], atol=1e-6)


def test_national_grid_coordinates_lose_nothing(tmp_path):
    corner = np.array([192_340.125, 444_123.375, 12.5])
    box = trimesh.creation.box(extents=[4, 5, 3])
    path = tmp_path / "far.obj"
    path.write_text(trimesh.Trimesh(box.vertices + corner, box.faces, process=False).export(file_type="obj", digits=6))
    building = read_building(path)
    low, high = bounds(building.triangles)
    assert building.origin.dtype == np.float64
    np.testing.assert_allclose(building.origin + low, corner - [2, 2.5, 1.5], atol=1e-6)
    np.testing.assert_allclose(high - low, [4, 5, 3], atol=1e-6)
    assert building.storeys.elevation[0] + building.origin[2] == pytest.approx(11.0)


def test_something_left_at_zero_does_not_cost_the_building_its_place(tmp_path):
    corner = np.array([192_340.125, 444_123.375, 12.5])
    lines, box = [], trimesh.creation.box(extents=[4, 5, 3])
    for number, place in enumerate((corner, corner + np.array([10.0, 0.0625, 0.0]), corner * 0)):
        lines += [f"o part {number}", *("v {:.6f} {:.6f} {:.6f}".format(*vertex) for vertex in box.vertices + place)]
        lines += ["f {} {} {}".format(*face) for face in box.faces + 1 + 8 * number]
    (tmp_path / "stray.obj").write_text("\n".join(lines) + "\n")
    building = read_building(tmp_path / "stray.obj")
    corners = building.triangles.vertices[building.triangles.faces]
    for number, place in enumerate((corner, corner + np.array([10.0, 0.0625, 0.0]))):
        own = corners[building.triangles.element == building.elements.name.index(f"part {number}")]
        np.testing.assert_allclose(building.origin + own.min(axis=(0, 1)), place - [2, 2.5, 1.5], rtol=0, atol=1e-6)
    (far,) = [note for note in building.notes if "farther" in note]
    assert far.startswith("1 elements farther than 8.2 km") and "444 km" in far and "rounded to 0.03 m" in far


@pytest.mark.parametrize("place", [(0.0, 0.0, 0.0), (192_340.1, 444_123.3, 12.5)])
def test_flat_triangles_are_counted_and_flat_elements_listed(tmp_path, place):
    """At national-grid coordinates three points on a line are not quite so."""
    points = np.array([[0, 0, 0], [0.1, 0.2, 0.3], [0.3, 0.6, 0.9], [1, 0, 0], [0.7, 1.4, 2.1], [0, 0, 0]]) + place
    vertices = "".join("v {:.6f} {:.6f} {:.6f}\n".format(*point) for point in points)
    path = tmp_path / "flat.obj"
    path.write_text(vertices + "o good\nf 1 2 4\nf 1 2 3\nf 1 6 4\no flat\nf 2 3 5\n")
    building = read_building(path)
    assert building.zero_area == 3 and len(building.triangles.faces) == 1
    assert [(failure.name, failure.reason) for failure in building.failures] == [
        ("flat", "all its triangles have zero area")
    ]
    assert remarks(building)[:2] == [
        "without a shape: element 'flat' (flat): all its triangles have zero area",
        "note: 3 triangles without area were left out",
    ]


@pytest.mark.parametrize("count, told", [(5, 5), (6, 6), (90, 6)])
def test_many_elements_with_the_same_flaw_are_counted(tmp_path, count, told):
    trimesh.creation.box(extents=[1, 1, 1]).export(tmp_path / "box.ply")
    flaws = tuple(Failure(f"id {number}", "IfcDoor", "door", "has a hole") for number in range(count))
    lines = remarks(read_building(tmp_path / "box.ply")._replace(flaws=flaws, notes=("in metres",)))
    assert len(lines) == told + 1 and lines[-1] == "note: in metres"
    assert lines[0] == "not a solid: IfcDoor 'door' (id 0): has a hole"
    assert (lines[-2] == f"not a solid: {count - 5} more elements, for such reasons") == (count > 5)
    left_out = remarks(read_building(tmp_path / "box.ply")._replace(failures=flaws))
    assert sum(line.startswith("without a shape: ") for line in left_out) == count  # each has no verdict


def test_what_several_files_lack_alike_is_told_once_and_last(tmp_path):
    trimesh.creation.box(extents=[1, 1, 1]).export(tmp_path / "box.ply")
    files = ("a.ifc", "b.ifc", "c.ifc")
    lost = [Failure(f"id {file}", "IfcBuildingElementProxy", "zero", "no faces", file) for file in files]
    lost.insert(1, Failure("id", "IfcWall", "wall", "no faces", "b.ifc"))
    lines = remarks(read_building(tmp_path / "box.ply")._replace(failures=tuple(lost), notes=("in metres",)))
    assert lines == [
        "b.ifc: without a shape: IfcWall 'wall' (id): no faces",
        "note: in metres",
        "without a shape: IfcBuildingElementProxy 'zero' of 3 files: no faces",
    ]
    # Two files of one model lack much alike.
    for word in ("failures", "flaws"):
        lost = [Failure(f"id {n}{file}", "IfcWall", f"wall {n}", "open", file) for n in range(99) for file in files]
        (line,) = remarks(read_building(tmp_path / "box.ply")._replace(**{word: tuple(lost)}))[-1:]
        assert line.endswith(": 99 of the class IfcWall of 3 files: open")


@pytest.mark.parametrize("suffix", ["obj", "ply", "stl", "glb"])
def test_edges_of_more_than_two_triangles_are_listed_and_scanned(tmp_path, suffix):
    """Whether the format repeats corners (STL) or not; a fin on an edge of the box, and one triangle drawn twice."""
    box, path = trimesh.creation.box(extents=[2, 2, 2]), tmp_path / f"box.{suffix}"
    box.export(path)
    z_up = ReadOptions(y_up=False)
    assert read_building(path, z_up).flaws == ()
    along = np.flatnonzero((box.vertices[:, 0] > 0) & (box.vertices[:, 1] > 0))
    fin = trimesh.Trimesh(np.vstack([box.vertices, [3, 3, 0]]), [*box.faces, [*along, 8], box.faces[0]], process=False)
    fin.export(path)
    building = read_building(path, z_up)
    assert [flaw.reason for flaw in building.flaws] == ["more than two triangles meet in 4 of its edges"]
    assert remarks(building)[0].startswith("not a solid: element ") and building.failures == ()
    assert len(building.triangles.faces) == 14
    hit = cast_triangles(prepare(building.triangles), Rays([[1.5, 5.0, 0.0], [5.0, 0.0, 0.5]], [[0.0, -1.0, 0.0]]))
    np.testing.assert_allclose(hit.distance, [[3.5], [np.inf]], atol=1e-6)


IFC_HEAD = "ISO-10303-21;\nHEADER;\nFILE_DESCRIPTION((''),'2;1');\nFILE_NAME('','',(''),(''),'','','');\n"
IFC_PROJECT = "FILE_SCHEMA(('IFC4'));\nENDSEC;\nDATA;\n#1=IFCPROJECT('0$ScRe4drECQ4DMSqUjd6d',$,'x',$,$,$,$,$,{});\n{}"
IFC_UNIT = "#2=IFCUNITASSIGNMENT((#3));\n#3=IFCSIUNIT(*,.LENGTHUNIT.,$,.METRE.);\n"
IFC_END = "ENDSEC;\nEND-ISO-10303-21;\n"


CUBIT = "#3=IFCCONTEXTDEPENDENTUNIT(#4,.LENGTHUNIT.,'cubit');\n#4=IFCDIMENSIONALEXPONENTS(1,0,0,0,0,0,0);\n"
FOOT = "#3=IFCCONVERSIONBASEDUNIT(#4,.LENGTHUNIT.,'{}',#5);\n#4=IFCDIMENSIONALEXPONENTS(1,0,0,0,0,0,0);\n"
FOOT += "#5=IFCMEASUREWITHUNIT(IFCLENGTHMEASURE({}),#{});\n#6=IFCSIUNIT(*,.LENGTHUNIT.,{},.METRE.);\n"


def with_unit(text):
    return IFC_HEAD + IFC_PROJECT.format("#2", "#2=IFCUNITASSIGNMENT((#3));\n" + text) + IFC_END


@pytest.mark.parametrize(
    "text, words",
    [
        pytest.param(CUBIT, "IfcContextDependentUnit cubit", id="context"),
        pytest.param("#3=IFCSIUNIT(*,.LENGTHUNIT.,.FOO.,.METRE.);\n", "IfcSIUnit FOO METRE", id="prefix"),
        pytest.param("#3=IFCSIUNIT(*,.LENGTHUNIT.,$,.FURLONG.);\n", "IfcSIUnit FURLONG", id="SI unit"),
        pytest.param("#3= IfcSiUnit (*,.LENGTHUNIT.,\n$,.GRAM.) ;\n", "IfcSIUnit GRAM", id="mass"),
        pytest.param("#3=IFCSIUNIT(*,.LENGTHUNIT.,$,$);\n", "IfcSIUnit without a name", id="nameless"),
        pytest.param(FOOT.format("FOOT", "0.", 6, "$"), "IfcConversionBasedUnit FOOT", id="zero"),
        pytest.param(FOOT.format("FOOT", "-1.", 6, "$"), "IfcConversionBasedUnit FOOT", id="negative"),
        pytest.param(FOOT.format("FOOT", "0.3048", 6, ".FOO."), "IfcConversionBasedUnit FOOT", id="of a prefix"),
        pytest.param(FOOT.format("FOOT", "0.3048", 3, "$"), "IfcConversionBasedUnit FOOT", id="of itself"),
    ],
)
def test_an_unknown_unit_is_not_taken_for_a_metre(tmp_path, text, words):
    pytest.importorskip("ifcopenshell")
    (tmp_path / "a.ifc").write_text(with_unit(text))
    with pytest.raises(ValueError, match=f"the length unit {words} is unknown") as refusal:
        read_building(tmp_path / "a.ifc")
    assert "a.ifc" in str(refusal.value) and "\n" not in str(refusal.value)


@pytest.mark.parametrize(
    "text, metres",
    [
        pytest.param("#3=IFCSIUNIT(*,.LENGTHUNIT.,$,.METRE.);\n", 1.0, id="metre"),
        pytest.param("#3=IFCSIUNIT(*,.LENGTHUNIT.,*,.METRE.);\n", 1.0, id="metre with a star"),
        pytest.param("#3=IFCSIUNIT(*,.LENGTHUNIT.,.MILLI.,.METRE.);\n", 0.001, id="millimetre"),
        pytest.param(FOOT.format("FOOT", "304.8", 6, ".MILLI."), 0.3048, id="foot"),
    ],
)
def test_known_units_have_their_length(tmp_path, text, metres):
    model = pytest.importorskip("ifcopenshell").file.from_string(with_unit(text))
    (tmp_path / "a.ifc").write_text(with_unit(text))
    assert unit_scale(model, tmp_path / "a.ifc") == pytest.approx(metres, rel=1e-12)


@pytest.mark.parametrize(
    "name, text, words",
    [
        pytest.param("a.ifc", "hello", "expected an IFC file", id="not IFC"),
        pytest.param("a.ifc", IFC_HEAD + IFC_PROJECT.format("#2", IFC_UNIT), "cut off", id="truncated"),
        pytest.param("a.ifc", IFC_HEAD[:30], "cut off", id="truncated in its header"),
        pytest.param("a.ifc", IFC_HEAD + IFC_END, "names its FILE_SCHEMA, found none", id="no schema"),
        pytest.param("a.ifc", IFC_HEAD + IFC_PROJECT.format("$", "") + IFC_END, "unit of length", id="no units"),
        pytest.param(
            "a.ifc", IFC_HEAD + IFC_PROJECT.format("#2", IFC_UNIT) + IFC_END, "surfaces, found none", id="no geometry"
        ),
        pytest.param("a.ifc", IFC_HEAD + "FILE_SCHEMA(('X9'));\n" + IFC_END, "not a readable IFC", id="unknown schema"),
        pytest.param("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\n", "faces, found none", id="no faces"),
        pytest.param("a.obj", "v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "NaN or infinity in 1", id="NaN"),
        pytest.param(
            "a.obj", "v 1e200 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", r"within 1e\+09 m, got 1e\+200", id="too far"
        ),
        pytest.param("a.obj", "v 0 0 0\nv 0 0 0\nv 0 1 0\nf 1 2 3\n", "zero area", id="only flat triangles"),
        pytest.param("a.glb", "glTFxxxx", "not a readable mesh", id="damaged GLB"),
        pytest.param("a.ply", "ply\nformat ascii 1.0\nelement vertex 3\n", "a.ply", id="damaged PLY"),
        pytest.param("a.dwg", "x", "expected a file ending in .ifc", id="unknown ending"),
        pytest.param("a", "x", "no ending", id="no ending"),
    ],
)
def test_refuses_what_is_no_building(tmp_path, name, text, words):
    (tmp_path / name).write_text(text)
    with pytest.raises(ValueError, match=words) as refusal:
        read_building(tmp_path / name)
    assert name in str(refusal.value) and "\n" not in str(refusal.value)


@pytest.mark.parametrize("name", ["none.ifc", "none.obj"])
def test_refuses_missing_files_and_folders(tmp_path, name):
    with pytest.raises(ValueError, match="nothing there"):
        read_building(tmp_path / name)
    (tmp_path / name).mkdir()
    with pytest.raises(ValueError, match="a folder"):
        read_building(tmp_path / name)


def test_without_ifcopenshell_one_line_says_what_to_install(tmp_path, monkeypatch):
    path = tmp_path / "a.ifc"
    path.write_text(IFC_HEAD + IFC_PROJECT.format("#2", IFC_UNIT) + IFC_END)
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(ImportError, match=r"pip install 'jaxmm\[ifc\]'"):
        read_building(path)


@pytest.mark.parametrize("options", [{"glass": "dark"}, {"doors": "ajar"}, {"unit": 0.0}, {"unit": np.nan}])
def test_refuses_unknown_options(options):
    with pytest.raises(ValueError, match=next(iter(options))):
        ReadOptions(**options)


def test_joined_triangles_keep_their_elements(tmp_path):
    path = tmp_path / "box.obj"
    trimesh.creation.box().export(path)
    one = read_building(path).triangles
    both = join(one, one._replace(vertices=one.vertices + np.float32(5)))
    result = cast_triangles(prepare(both), Rays(np.array([[-3.0, 0.1, 0.2], [2.0, 5.1, 5.2]]), np.array([[1.0, 0, 0]])))
    np.testing.assert_array_equal(result.element, [[0], [1]])
    np.testing.assert_allclose(result.distance, 2.5, atol=1e-6)


def test_nobody_stands_inside_a_footing(real_building):
    house = real_building("IfcOpenHouse_IFC4")
    with pytest.raises(ValueError, match="inside IfcFooting"):
        check_position(house, prepare(house.triangles), np.array([0.0, 0.5, -1.0]))
