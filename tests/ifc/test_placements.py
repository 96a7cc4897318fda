"""Placements of IFC files as matrices, with reference directions that are not across the axis."""

import numpy as np
import pytest

from tests.warp_scanner.test_hard_ifc import Model, read
from warp_scanner.rooms.rooms import RoomConfig, make_rooms

ifcopenshell = pytest.importorskip("ifcopenshell")

import ifcopenshell.geom as geom  # noqa: E402

from warp_scanner.buildings.ifc_files import read_ifc  # noqa: E402
from warp_scanner.buildings.ifc_model import world_matrix  # noqa: E402
from warp_scanner.buildings.room_ifc import write_room  # noqa: E402


@pytest.fixture
def model(tmp_path):
    path = tmp_path / "room.ifc"
    write_room(path, make_rooms(RoomConfig(), 11, np.arange(1)), 0)
    return ifcopenshell.open(str(path))


def placement(model, above, at, axis, reference):
    axis, reference = (model.create_entity("IfcDirection", list(map(float, way))) for way in (axis, reference))
    point = model.create_entity("IfcCartesianPoint", list(map(float, at)))
    axes = model.create_entity("IfcAxis2Placement3D", point, axis, reference)
    return model.create_entity("IfcLocalPlacement", above, axes)


def test_the_world_of_a_placement_is_that_of_the_kernel_that_makes_shapes(model):
    rng, wall = np.random.default_rng(0), model.by_type("IfcWall")[0]
    for _ in range(20):
        wall.ObjectPlacement = None
        for _ in range(rng.integers(1, 5)):
            at, axis, reference = rng.normal(size=(3, 3))
            wall.ObjectPlacement = placement(model, wall.ObjectPlacement, 10.0 * at, axis, reference)
        shape = geom.create_shape(geom.settings(), wall)
        kernel = np.array(shape.transformation.matrix).reshape(4, 4).T
        np.testing.assert_allclose(world_matrix(wall.ObjectPlacement), kernel, atol=1e-9)


def test_a_storey_is_as_high_as_it_stands(model, tmp_path):
    storey = model.by_type("IfcBuildingStorey")[0]
    above = placement(model, None, (0, 0, 1), (0, 0, 1), (1, 0, 0.1))  # level: its x axis is 1, 0, 0
    storey.ObjectPlacement = placement(model, above, (50, 0, 3), (0, 0, 1), (1, 0, 0))
    model.write(str(tmp_path / "askew.ifc"))
    building = read_ifc(tmp_path / "askew.ifc")
    assert building.storeys.elevation[0] + building.origin[2] == pytest.approx(4.0)


@pytest.mark.parametrize(
    "at, turned", [((0, 0, 0), None), ((-0.0, 0, 0), (1, 0, 0)), ((5, 0, 0), None), ((0, 0, 0), (0, 1, 0))]
)
@pytest.mark.parametrize("name", ["Body", "Box"])
def test_elements_mapped_from_another_origin_are_named(tmp_path, name, at, turned):
    made = Model()
    body = made.box((0, 0, 0), (1, 1, 3))
    axes = made.axes(*at)
    if turned:
        axes.Axis, axes.RefDirection = (made.new("IfcDirection", tuple(map(float, way))) for way in ((0, 0, 1), turned))
    source = made.new("IfcRepresentationMap", axes, made.box((0, 0, 0), (1, 1, 3), name))
    target = made.new(
        "IfcCartesianTransformationOperator3D", None, None, made.new("IfcCartesianPoint", (0.0, 0.0, 0.0))
    )
    item = made.new("IfcMappedItem", source, target)
    shown = [made.new("IfcShapeRepresentation", made.body, name, "MappedRepresentation", [item])]
    made.product("IfcColumn", "mapped", *shown, *([body] if name == "Box" else []))
    made.product("IfcColumn", "square", body)
    told = [note for note in read(made.file, tmp_path).notes if "MappingOrigin" in note]
    doubted = name == "Body" and (at[0] == 5 or turned == (0, 1, 0))
    assert [note.rpartition(": ")[2] for note in told] == ["mapped"] * doubted
