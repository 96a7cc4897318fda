"""Colours in updated models: what a geometry kernel sees of them, in every schema, shared bodies, and the way back."""

import numpy as np
import pytest

from tests.cases.valid_ifc import ifc_text

ifcopenshell = pytest.importorskip("ifcopenshell")

from ifcopenshell import geom  # noqa: E402

from jaxmm.ifc.colours import ADDED, COLOURS, REMOVED  # noqa: E402
from tests.cases.ifc_updates import ADDED_COLUMN, ADDED_WALL, errors, found, removed, update  # noqa: E402

SCHEMAS = ("IFC2X3", "IFC4", "IFC4X3_ADD2")
WALL, COLUMN, WEDGE = (f"0$ScRe4drECQ4DMSqUjd6{letter}" for letter in "knp")
GREY = (0.5, 0.5, 0.5)


def seen(model, guid):
    """The colours, as whole numbers, of the faces that the kernel makes of an element."""
    shape = geom.create_shape(geom.settings(), model.by_guid(guid))
    used = [shape.geometry.materials[row].diffuse for row in set(shape.geometry.material_ids) if row >= 0]
    return {tuple(round(255 * value) for value in (one.r(), one.g(), one.b())) for one in used}


def style_of(model, item, colour=GREY):
    """Paint an item as its own author may have done."""
    rgb = model.create_entity("IfcColourRgb", None, *colour)
    style = model.create_entity("IfcSurfaceStyle", "author", "BOTH", [model.create_entity(
        "IfcSurfaceStyleRendering", SurfaceColour=rgb, ReflectanceMethod="FLAT"
    )])  # fmt: skip
    if model.schema == "IFC2X3":
        style = model.create_entity("IfcPresentationStyleAssignment", [style])
    return model.create_entity("IfcStyledItem", item, [style])


def through_a_map(model, *guids, depth=1):
    """The body of the first element becomes a map that all of these elements use."""
    first = model.by_guid(guids[0])
    body = first.Representation.Representations[0]
    context, origin = body.ContextOfItems, model.by_type("IfcAxis2Placement3D")[0]
    target = model.create_entity(
        "IfcCartesianTransformationOperator3D", LocalOrigin=model.create_entity("IfcCartesianPoint", (0.0, 0.0, 0.0))
    )
    for _ in range(depth):
        shared = model.create_entity("IfcRepresentationMap", origin, body)
        body = model.create_entity(
            "IfcShapeRepresentation", context, "Body", "MappedRepresentation",
            [model.create_entity("IfcMappedItem", shared, target)],
        )  # fmt: skip
    for guid in guids:
        own = model.create_entity(
            "IfcShapeRepresentation", context, "Body", "MappedRepresentation",
            [model.create_entity("IfcMappedItem", body.Items[0].MappingSource, target)],
        )  # fmt: skip
        model.by_guid(guid).Representation = model.create_entity("IfcProductDefinitionShape", None, None, [own])
    model.remove(body)


@pytest.fixture(params=SCHEMAS)
def prior(request, tmp_path):
    """Writes the small file of a schema after some edits."""
    text = ifc_text("IFC2X3" if request.param == "IFC2X3" else "IFC4").decode()

    def write(edit=lambda model: None):
        path = tmp_path / "prior.ifc"
        path.write_text(text.replace("('IFC4')", f"('{request.param}')"))
        model = ifcopenshell.open(str(path))
        edit(model)
        path.write_text(model.to_string())
        return path

    return write


def check(path, out, *guids, notes=0):
    """What is removed and what is new has its colour, all else keeps its own, and no error is new."""
    before = ifcopenshell.open(str(path))
    summary, model = update(path, found(*map(removed, guids), ADDED_WALL, ADDED_COLUMN), out)
    assert len(summary.notes) == notes, summary.notes
    assert not errors(summary.path) - errors(path)
    for guid in summary.added:
        assert seen(model, guid) == {COLOURS[ADDED]}
    for guid in {WALL, COLUMN, WEDGE} - set(guids):
        assert seen(model, guid) == seen(before, guid)
    return model


def test_bodies_without_a_style_get_one(prior, tmp_path):
    model = check(prior(), tmp_path / "out", WALL, WEDGE)
    assert seen(model, WALL) == seen(model, WEDGE) == {COLOURS[REMOVED]}
    # One style for all of a kind.
    assert sorted(one.Name for one in model.by_type("IfcSurfaceStyle")) == [ADDED, REMOVED]
    assert {len(item.StyledByItem) for item in model.by_type("IfcExtrudedAreaSolid")} <= {0, 1}


def test_a_style_of_the_file_is_taken_over_for_the_one_element(prior, tmp_path):
    def edit(model):
        for guid in (WALL, COLUMN):
            style_of(model, model.by_guid(guid).Representation.Representations[0].Items[0])

    model = check(prior(edit), tmp_path / "out", WALL)
    assert seen(model, WALL) == {COLOURS[REMOVED]} and len(seen(model, COLUMN)) == 1


@pytest.mark.parametrize("styled", [False, True])
@pytest.mark.parametrize("depth", [1, 2])
def test_of_elements_that_share_a_body_only_the_one_is_painted(prior, tmp_path, depth, styled):
    def edit(model):
        if styled:
            style_of(model, model.by_guid(COLUMN).Representation.Representations[0].Items[0])
        through_a_map(model, COLUMN, WEDGE, depth=depth)

    path = prior(edit)
    model = check(path, tmp_path / "out", COLUMN)
    assert seen(model, COLUMN) == {COLOURS[REMOVED]}
    corners = [
        np.array(geom.create_shape(geom.settings(), one.by_guid(COLUMN)).geometry.verts)
        for one in (model, ifcopenshell.open(str(path)))
    ]
    np.testing.assert_allclose(*corners, atol=1e-9)


def test_what_shares_its_whole_shape_keeps_its_colour_and_is_told(prior, tmp_path):
    def edit(model):
        model.by_guid(WEDGE).Representation = model.by_guid(COLUMN).Representation

    model = check(prior(edit), tmp_path / "out", COLUMN, notes=1)
    assert COLOURS[REMOVED] not in seen(model, COLUMN)


def test_parts_are_painted_with_their_whole_and_holes_are_not(prior, tmp_path):
    def edit(model):
        model.create_entity(
            "IfcRelAggregates", ifcopenshell.guid.new(), model.by_type("IfcOwnerHistory")[0], None, None,
            model.by_guid(WALL), [model.by_guid(WEDGE)],
        )  # fmt: skip

    model = check(prior(edit), tmp_path / "out", WALL, WEDGE)
    assert seen(model, WEDGE) == {COLOURS[REMOVED]}
    hole = model.by_type("IfcOpeningElement")[0].Representation.Representations[0].Items[0]
    assert not hole.StyledByItem
