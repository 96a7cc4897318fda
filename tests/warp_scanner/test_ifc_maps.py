"""Buildings at national-grid coordinates: of positions, storeys and scans nothing is lost, however they are placed."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from warp_scanner.rooms.rooms import RoomConfig, make_rooms
from warp_scanner.sensors.poses import rotation_of
from warp_scanner.sensors.scan import Rays
from warp_scanner.sensors.sensors import Pinhole
from warp_scanner.sensors.triangles import cast_triangles, prepare

ifcopenshell = pytest.importorskip("ifcopenshell")

from ifcopenshell.util.geolocation import auto_xyz2enh  # noqa: E402

from warp_scanner.buildings.ifc_files import read_ifc  # noqa: E402
from warp_scanner.buildings.ifc_maps import to_map  # noqa: E402
from warp_scanner.buildings.room_ifc import write_room  # noqa: E402
from warp_scanner.scenes.building import Building  # noqa: E402

PLACES = (
    pytest.param((155_000.123, 463_000.456, 12.345), id="1e5"),
    pytest.param((9_876_543.217, -1_234_567.891, 250.75), id="1e7"),
)


@pytest.fixture(scope="module")
def room(tmp_path_factory):
    """Path of a generated room's file, and what is read from it."""
    path = tmp_path_factory.mktemp("room") / "room.ifc"
    write_room(path, make_rooms(RoomConfig(), 11, np.arange(1)), 0)
    return path, read_ifc(path)


def corners_of(building: Building) -> dict[str, np.ndarray]:
    """World positions (3 t, 3) float64 [m] of each element's triangles, by GlobalId."""
    world = building.origin + building.triangles.vertices.astype(np.float64)
    corners, element = world[building.triangles.faces], building.triangles.element
    return {guid: corners[element == row].reshape(-1, 3) for row, guid in enumerate(building.elements.guid)}


def shift(point, offset):
    point.Coordinates = tuple(float(a + b) for a, b in zip(point.Coordinates, offset, strict=True))


def move_site(model, offset, corners):
    shift(model.by_type("IfcSite")[0].ObjectPlacement.RelativePlacement.Location, offset)


def move_storey(model, offset, corners):
    shift(model.by_type("IfcBuildingStorey")[0].ObjectPlacement.RelativePlacement.Location, offset)


def move_shapes(model, offset, corners):
    """The far coordinates stand in the shapes; nothing is placed but the storey's height."""
    shift(model.by_type("IfcBuildingStorey")[0].ObjectPlacement.RelativePlacement.Location, [0.0, 0.0, offset[2]])
    for product in model.by_type("IfcElement"):
        own = (corners[product.GlobalId] + offset).tolist()
        points = model.create_entity("IfcCartesianPointList3D", own)
        rows = np.arange(1, len(own) + 1).reshape(-1, 3).tolist()
        surface = model.create_entity("IfcTriangulatedFaceSet", points, CoordIndex=rows)
        body = product.Representation.Representations[0]
        body.RepresentationType, body.Items, product.ObjectPlacement = "Tessellation", [surface], None


@pytest.mark.parametrize("move", [move_site, move_storey, move_shapes])
@pytest.mark.parametrize("place", PLACES)
def test_a_far_building_is_the_near_one_elsewhere(room, tmp_path, move, place):
    path, near = room
    model, corners = ifcopenshell.open(str(path)), corners_of(near)
    move(model, np.array(place), corners)
    model.write(str(tmp_path / "far.ifc"))
    far = read_ifc(tmp_path / "far.ifc")
    assert far.origin.dtype == np.float64 and np.abs(far.origin - place).max() < 10.0
    assert far.failures == () and far.notes == ()
    moved = corners_of(far)
    assert moved.keys() == corners.keys()
    for guid, own in corners.items():
        # The order of corners may differ: a kernel starts anywhere on a surface.
        back = moved[guid] - place
        assert max(cKDTree(own).query(back)[0].max(), cKDTree(back).query(own)[0].max()) < 1e-5
    np.testing.assert_allclose(far.storeys.elevation + far.origin[2], near.storeys.elevation + place[2], atol=1e-6)

    origin = np.array([[0.5, -0.25, 0.0], [-2.0, 1.0, 0.3]])
    turn, directions = rotation_of([20.0, -130.0], [-5.0, 10.0]), Pinhole(64, 40).directions()
    here = cast_triangles(prepare(near.triangles), Rays(origin, directions, turn))
    there = cast_triangles(prepare(far.triangles), Rays(origin + np.array(place) - far.origin, directions, turn))
    alike = np.array(near.elements.guid)[here.element] == np.array(far.elements.guid)[there.element]
    assert alike.mean() > 0.999  # at edges a hair decides
    assert np.abs(here.distance - there.distance)[alike].max() < 1e-4


def convert(model, map_unit=None, **values):
    """Give the model an IfcMapConversion, and a unit of the map that is not the file's."""
    unit = None
    if map_unit:
        unit = model.create_entity("IfcSIUnit", UnitType="LENGTHUNIT", Name="METRE", Prefix=map_unit)
    system = model.create_entity("IfcProjectedCRS", "EPSG:28992", MapUnit=unit)
    context = model.by_type("IfcGeometricRepresentationContext", include_subtypes=False)[0]
    model.create_entity("IfcMapConversion", context, system, **values)


@pytest.mark.parametrize(
    "values",
    [
        pytest.param({}, id="as it is"),
        pytest.param({"XAxisAbscissa": 0.0, "XAxisOrdinate": 1.0}, id="a quarter turn"),
        pytest.param({"XAxisAbscissa": -0.6, "XAxisOrdinate": 0.8, "Scale": 0.9996}, id="turned, on a projection"),
        pytest.param({"map_unit": "MILLI", "Scale": 1000.0}, id="a map in millimetres"),
    ],
)
@pytest.mark.parametrize("place", PLACES)
def test_the_map_is_where_ifcopenshell_finds_it(room, tmp_path, place, values):
    path, near = room
    model = ifcopenshell.open(str(path))
    metres = 0.001 if "map_unit" in values else 1.0
    east, north, height = (float(value) / metres for value in place)
    convert(model, Eastings=east, Northings=north, OrthogonalHeight=height, **values)
    model.write(str(tmp_path / "map.ifc"))
    building = read_ifc(tmp_path / "map.ifc")
    assert building.notes == () and building.to_map.dtype == np.float64
    np.testing.assert_array_equal(building.triangles.vertices, near.triangles.vertices)  # the file's frame stays
    for point in ([0.0, 0.0, 0.0], [120.0, -35.0, 2.5]):
        expected = metres * np.array(auto_xyz2enh(model, *point))
        np.testing.assert_allclose((building.to_map @ [*point, 1.0])[:3], expected, rtol=0, atol=1e-6)


def test_a_scale_that_confuses_units_is_left_out_and_said(room, tmp_path):
    model = ifcopenshell.open(str(room[0]))
    convert(model, map_unit="MILLI", Eastings=155e6, Northings=463e6, OrthogonalHeight=0.0)  # and no Scale
    model.write(str(tmp_path / "map.ifc"))
    building = read_ifc(tmp_path / "map.ifc")
    assert len(building.notes) == 1 and "stretch the building by 0.001" in building.notes[0]
    np.testing.assert_allclose(building.to_map @ [10.0, 20.0, 0.0, 1.0], [155_010, 463_020, 0, 1], atol=1e-6)


@pytest.mark.parametrize("scale, metres", [(1.0, 0.001), (None, 0.001), (0.001, 1.0), (0.001 * 0.9996, 1.0)])
def test_a_map_without_a_unit_has_the_files_or_metres_where_its_scale_leads_to_them(scale, metres):
    model = ifcopenshell.file(schema="IFC4")
    system = model.create_entity("IfcProjectedCRS", "EPSG:28992")
    context = model.create_entity("IfcGeometricRepresentationContext")
    model.create_entity("IfcMapConversion", context, system, 155e3, 463e3, 10.0, Scale=scale)
    matrix, notes = to_map(model, 0.001)
    assert len(notes) == (metres == 1.0) and all("taken as metres" in note for note in notes)
    np.testing.assert_allclose(matrix[:3, 3], np.array([155e3, 463e3, 10.0]) * metres)
    np.testing.assert_allclose(matrix[0, 0], 0.9996 if scale == 0.001 * 0.9996 else 1.0)


@pytest.mark.parametrize("x", [0.0, 5.0])
def test_a_world_that_is_moved_is_said_where_there_is_a_map(room, tmp_path, x):
    model = ifcopenshell.open(str(room[0]))
    for context in model.by_type("IfcGeometricRepresentationContext", include_subtypes=False):
        point = model.create_entity("IfcCartesianPoint", (x, 0.0, 0.0))
        context.WorldCoordinateSystem = model.create_entity("IfcAxis2Placement3D", point)
    assert to_map(model, 1.0)[0] is None
    convert(model, Eastings=155e3, Northings=463e3, OrthogonalHeight=0.0)
    matrix, notes = to_map(model, 1.0)
    assert [note.split()[1] for note in notes] == ["WorldCoordinateSystem"] * (x != 0.0)
    np.testing.assert_allclose(matrix[:3, 3], [155e3, 463e3, 0.0])


def with_sets(model, unit_name=None, name="ePset_MapConversion", **values):
    """Give the model's site the property sets that stand for an IfcMapConversion in IFC2X3."""
    site = model.by_type("IfcSite")[0]
    system = {"Name": "EPSG:25832"} | ({"MapUnit": unit_name} if unit_name else {})
    for called, properties in ((name, values), ("ePset_ProjectedCRS", system)):
        made = [
            model.create_entity("IfcPropertySingleValue", Name=key, NominalValue=model.create_entity(kind, value))
            for key, value in properties.items()
            for kind in ["IfcLabel" if isinstance(value, str) else "IfcReal"]
        ]
        own = model.create_entity("IfcPropertySet", GlobalId=ifcopenshell.guid.new(), Name=called, HasProperties=made)
        model.create_entity("IfcRelDefinesByProperties", ifcopenshell.guid.new(), None, None, None, [site], own)


@pytest.mark.parametrize("schema", ["IFC2X3", "IFC4"])
@pytest.mark.parametrize("name", ["ePset_MapConversion", "EPset_MapConversion"])
@pytest.mark.parametrize("unit, unit_name, scale", [(1.0, None, 1.0), (0.001, "METRE", 0.001), (0.001, None, 0.001)])
def test_a_property_set_says_the_same_as_a_map_conversion(schema, name, unit, unit_name, scale):
    values = {"Eastings": 4e5, "Northings": 5.6e6, "OrthogonalHeight": 30.0, "XAxisAbscissa": -0.6,
              "XAxisOrdinate": 0.8, "Scale": scale}  # fmt: skip
    model = ifcopenshell.file(schema=schema)
    model.create_entity("IfcSite", GlobalId=ifcopenshell.guid.new())
    assert to_map(model, unit) == (None, ())
    with_sets(model, unit_name, name, **values)
    matrix, notes = to_map(model, unit)
    other = ifcopenshell.file(schema="IFC4")
    map_unit = other.create_entity("IfcSIUnit", UnitType="LENGTHUNIT", Name="METRE") if unit_name else None
    system = other.create_entity("IfcProjectedCRS", "EPSG:25832", MapUnit=map_unit)
    context = other.create_entity("IfcGeometricRepresentationContext")
    other.create_entity("IfcMapConversion", context, system, **values)
    expected, said = to_map(other, unit)
    np.testing.assert_allclose(matrix, expected, rtol=0, atol=1e-9)
    assert [note.replace("ePset_", "Ifc") for note in notes] == list(said)


def test_a_latitude_alone_is_said():
    model = ifcopenshell.file(schema="IFC2X3")
    site = model.create_entity("IfcSite", GlobalId=ifcopenshell.guid.new())
    site.RefLatitude, site.RefLongitude = (52, 9, 18, 0), (-5, -23, -13, -500_000)
    matrix, (note,) = to_map(model, 1.0)
    assert matrix is None and "latitude 52.15500, longitude -5.38708" in note and "no IfcMapConversion" in note
