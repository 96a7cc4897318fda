"""IFC files that are hard to read: every body in its place, no other solid, gaps are said; numbers that are none."""

import numpy as np
import pytest

from tests.cases.valid_ifc import ifc_text
from warp_scanner.rooms.rooms import RoomConfig, make_rooms
from warp_scanner.scenes.building import AS_IT_IS, Building, element_bounds

ifcopenshell = pytest.importorskip("ifcopenshell")

from warp_scanner.buildings.ifc_files import parse_ifc, read_ifc  # noqa: E402
from warp_scanner.buildings.ifc_hazards import beyond_the_library  # noqa: E402
from warp_scanner.buildings.room_ifc import write_room  # noqa: E402


@pytest.fixture(scope="module")
def room(tmp_path_factory):
    """Path of a generated room's file."""
    path = tmp_path_factory.mktemp("room") / "room.ifc"
    write_room(path, make_rooms(RoomConfig(), 11, np.arange(1)), 0)
    return path


def read(model, folder) -> Building:
    """What is read of a model that was changed."""
    model.write(str(folder / "changed.ifc"))
    return parse_ifc(folder / "changed.ifc", AS_IT_IS)


@pytest.mark.parametrize("long", [5_000, 200_000])
def test_a_header_and_what_follows_the_end_may_be_long(room, tmp_path, long):
    text = room.read_text()
    options = ",".join(f"'Option {number:020d}'" for number in range(long // 30))
    text = text.replace("FILE_DESCRIPTION((", f"FILE_DESCRIPTION(({options},", 1) + "\n" * long
    (tmp_path / "long.ifc").write_text(text)
    assert text.index("FILE_SCHEMA") > long
    assert read_ifc(tmp_path / "long.ifc").elements.guid == read_ifc(room).elements.guid


def span(building, name):
    """Least and greatest corner (2, 3) [m] of the element of that name in the world."""
    low, high = element_bounds(building.triangles)
    row = building.elements.name.index(name)
    return building.origin + np.array([low[row], high[row]])


class Model:
    """A small model in metres, with the box of a column, and what tests add to it."""

    def __init__(self, schema="IFC4"):
        self.file = ifcopenshell.file(schema=schema)
        metres = self.new("IfcUnitAssignment", [self.new("IfcSIUnit", UnitType="LENGTHUNIT", Name="METRE")])
        self.context = self.new(
            "IfcGeometricRepresentationContext",
            ContextType="Model", CoordinateSpaceDimension=3, Precision=1e-5, WorldCoordinateSystem=self.axes(),
        )  # fmt: skip
        self.root("IfcProject", RepresentationContexts=[self.context], UnitsInContext=metres)
        self.body = self.view("Body")

    def new(self, kind, *values, **named):
        return self.file.create_entity(kind, *values, **named)

    def root(self, kind, **named):
        return self.new(kind, GlobalId=named.pop("GlobalId", ifcopenshell.guid.new()), **named)

    def axes(self, *at):
        return self.new("IfcAxis2Placement3D", self.new("IfcCartesianPoint", tuple(map(float, at or (0, 0, 0)))))

    def view(self, name, target="MODEL_VIEW"):
        return self.new(
            "IfcGeometricRepresentationSubContext",
            ContextIdentifier=name, ContextType="Model", ParentContext=self.context, TargetView=target,
        )  # fmt: skip

    def box(self, at, size, name="Body", context=None):
        """A representation: a box whose bottom has its middle at `at`."""
        flat = self.new("IfcAxis2Placement2D", self.new("IfcCartesianPoint", (0.0, 0.0)))
        profile = self.new("IfcRectangleProfileDef", "AREA", None, flat, *map(float, size[:2]))
        up = self.new("IfcDirection", (0.0, 0.0, 1.0))
        solid = self.new("IfcExtrudedAreaSolid", profile, self.axes(*at), up, float(size[2]))
        return self.new("IfcShapeRepresentation", context or self.body, name, "SweptSolid", [solid])

    def product(self, kind, name, *shapes, at=(0, 0, 0), **named):
        shown = self.new("IfcProductDefinitionShape", None, None, list(shapes)) if shapes else None
        placement = named.pop("ObjectPlacement", None) or self.new("IfcLocalPlacement", None, self.axes(*at))
        return self.root(kind, Name=name, ObjectPlacement=placement, Representation=shown, **named)


LOWER, UPPER = ((0, 0, 0), (0.4, 0.4, 1.5)), ((0, 0, 1.5), (0.4, 0.4, 1.5))
FAR = ((3, 0, 0), (2, 2, 2))
COLUMN = [[-0.2, -0.2, 0.0], [0.2, 0.2, 3.0]]


@pytest.mark.parametrize("schema", ["IFC2X3", "IFC4", "IFC4X3"])
@pytest.mark.parametrize("first", [True, False])
@pytest.mark.parametrize(
    "name, context",
    [
        ("Clearance", ("Clearance", "MODEL_VIEW")),
        ("Clearance", None),  # in the one context that all are in
        (" CLEARANCE ", None),
        ("Reference", ("Reference", "MODEL_VIEW")),
        ("Box", ("Box", "MODEL_VIEW")),
        ("Body-FallBack", ("Body", "MODEL_VIEW")),
        ("Body", ("Body", "SKETCH_VIEW")),
        (None, ("Clearance", "MODEL_VIEW")),
    ],
)
def test_only_bodies_count_all_of_them_and_whichever_comes_first(tmp_path, schema, name, context, first):
    model = Model(schema)
    bodies = [model.box(*LOWER), model.box(*UPPER)]
    other = model.box(*FAR, name, model.view(*context) if context else model.context)
    model.product("IfcColumn", "column", *([other, *bodies] if first else [*bodies, other]))
    building = read(model.file, tmp_path)
    np.testing.assert_allclose(span(building, "column"), COLUMN, atol=1e-6)
    assert building.failures == () and building.elements.guid[1:] == ()


@pytest.mark.parametrize("schema", ["IFC2X3", "IFC4", "IFC4X3"])
def test_two_bodies_alone_are_one_shape(tmp_path, schema):
    model = Model(schema)
    model.product("IfcColumn", "column", model.box(*LOWER), model.box(*UPPER, "BODY "))
    np.testing.assert_allclose(span(read(model.file, tmp_path), "column"), COLUMN, atol=1e-6)


def test_what_has_no_body_is_named_with_what_it_has(tmp_path):
    model = Model()
    model.product("IfcColumn", "column", model.box(*LOWER, None, model.context))  # called nothing: a body
    model.product("IfcDoor", "door", model.box(*FAR, "Clearance", model.view("Clearance")))
    model.product("IfcWall", "wall", model.box(*FAR, "Body", model.view("Body", "SKETCH_VIEW")))
    building = read(model.file, tmp_path)
    assert building.elements.name == ("column",)
    assert {one.name: one.reason for one in building.failures} == {
        "door": "it has no body, only Clearance", "wall": "it has no body, only Body (SKETCH_VIEW)",
    }  # fmt: skip


@pytest.mark.parametrize("schema", ["IFC2X3", "IFC4", "IFC4X3"])
def test_what_projects_from_an_element_is_of_it_and_openings_are_not(tmp_path, schema):
    model = Model(schema)
    wall = model.product("IfcWall", "wall", model.box((0, 0, 0), (4, 0.2, 3)))
    pilaster = model.product("IfcProjectionElement", "pilaster", model.box((-1, 0.3, 0), (0.4, 0.4, 3)))
    opening = model.product("IfcOpeningElement", "opening", model.box((1, 0, 0), (1, 4, 2)))
    model.root("IfcRelProjectsElement", RelatingElement=wall, RelatedFeatureElement=pilaster)
    model.root("IfcRelVoidsElement", RelatingBuildingElement=wall, RelatedOpeningElement=opening)
    building = read(model.file, tmp_path)
    assert building.elements.name == ("wall",) and building.failures == ()
    np.testing.assert_allclose(span(building, "wall"), [[-2, -0.1, 0], [2, 0.5, 3]], atol=1e-6)
    assert np.isclose(building.triangles.vertices, [0.5, 0.1, 2.0], atol=1e-5).all(axis=1).any()  # of the hole


@pytest.mark.parametrize(
    "whole, part, names",
    [
        ("IfcSlab", "IfcBuildingElementPart", ["whole"]),
        ("IfcSlab", "IfcPlate", ["whole"]),
        ("IfcSlab", "IfcSlab", ["whole"]),
        ("IfcWall", "IfcBuildingElementPart", ["whole"]),
        ("IfcRoof", "IfcBuildingElementPart", ["whole"]),
        ("IfcCovering", "IfcBuildingElementPart", ["whole"]),
        ("IfcRoof", "IfcSlab", ["lower", "upper"]),  # each gets a verdict as it is
        ("IfcStair", "IfcStairFlight", ["lower", "upper"]),
        ("IfcSlab", "IfcColumn", ["lower", "upper"]),
    ],
)
def test_slabs_and_layers_are_of_the_whole_other_parts_of_roofs_and_stairs_are_elements(tmp_path, whole, part, names):
    model = Model()
    parts = [model.product(part, "lower", model.box(*LOWER)), model.product(part, "upper", model.box(*UPPER))]
    model.root("IfcRelAggregates", RelatingObject=model.product(whole, "whole"), RelatedObjects=parts)
    building = read(model.file, tmp_path)
    assert sorted(building.elements.name) == names and building.failures == ()
    if names == ["whole"]:
        assert building.elements.ifc_class == (whole,)
        np.testing.assert_allclose(span(building, "whole"), COLUMN, atol=1e-6)


def axis(model, tag, *points, same_sense=True):
    line = model.new("IfcPolyline", [model.new("IfcCartesianPoint", tuple(map(float, point))) for point in points])
    return model.new("IfcGridAxis", tag, line, same_sense)


def on_grid(model, first, second, offsets=(0.0, 0.0, 0.0), reference=None):
    """A slim box, long along its own x axis, on the intersection of two axes of a grid at 10, 20, 1."""
    placement = model.new("IfcLocalPlacement", None, model.axes(10, 20, 1))
    model.root("IfcGrid", Name="grid", ObjectPlacement=placement, UAxes=[first], VAxes=[second])
    place = model.new("IfcGridPlacement")
    place.PlacementLocation = model.new("IfcVirtualGridIntersection", [first, second], offsets)
    place.PlacementRefDirection = reference
    model.product("IfcColumn", "column", model.box((1, 0, 0), (2, 0.1, 3)), ObjectPlacement=place)


@pytest.mark.parametrize("schema", ["IFC2X3", "IFC4", "IFC4X3"])
@pytest.mark.parametrize(
    "senses, offsets, expected",
    [
        # Along y at x = -2, and along x at y = 1.2: the first axis is the column's x axis.
        ((True, True), (0.0, 0.0, 0.0), [[7.95, 21.2, 1], [8.05, 23.2, 4]]),
        ((False, True), (0.0, 0.0, 0.0), [[7.95, 19.2, 1], [8.05, 21.2, 4]]),
        # To the left of +y is -x, of +x it is +y.
        ((True, True), (0.5, 0.25, 2.0), [[7.45, 21.45, 3], [7.55, 23.45, 6]]),
        ((True, False), (0.5, 0.25), [[7.45, 20.95, 1], [7.55, 22.95, 4]]),
    ],
)
def test_what_stands_on_grid_axes_stands_where_they_meet(tmp_path, schema, senses, offsets, expected):
    model = Model(schema)
    first = axis(model, "A", (-2, -3), (-2, 0), (-2, 3), same_sense=senses[0])
    second = axis(model, "1", (-4, 1.2), (-3, 1.2), same_sense=senses[1])  # as a line without end it meets the other
    on_grid(model, first, second, offsets)
    building = read(model.file, tmp_path)
    assert building.failures == ()
    np.testing.assert_allclose(span(building, "column"), expected, atol=1e-6)


def test_the_direction_on_a_grid_may_be_given(tmp_path):
    model = Model()
    first, second = axis(model, "A", (0, 0), (0, 1)), axis(model, "1", (0, 0), (1, 0))
    on_grid(model, first, second, reference=model.new("IfcDirection", (-3.0, 0.0, 0.0)))
    np.testing.assert_allclose(span(read(model.file, tmp_path), "column"), [[8, 19.95, 1], [10, 20.05, 4]], atol=1e-6)


@pytest.mark.parametrize("kind", ["parallel", "bent", "circle"])
def test_an_element_whose_axes_do_not_tell_its_place_is_named_and_not_put_anywhere(tmp_path, kind):
    model = Model()
    model.product("IfcWall", "wall", model.box((0, 0, 0), (4, 0.2, 3)))
    first = axis(model, "A", (0, 0), (0, 1))
    if kind == "circle":
        flat = model.new("IfcAxis2Placement2D", model.new("IfcCartesianPoint", (0.0, 0.0)))
        second = model.new("IfcGridAxis", "1", model.new("IfcCircle", flat, 5.0), True)
    else:
        second = axis(model, "1", (1, 0), *({"parallel": [(1, 1)], "bent": [(2, 0), (3, 1)]}[kind]))
    on_grid(model, first, second)
    building = read(model.file, tmp_path)
    assert building.elements.name == ("wall",)
    (failure,) = building.failures
    word = "are parallel" if kind == "parallel" else "axis '1' of its IfcGridPlacement is not straight"
    assert failure.name == "column" and failure.reason.startswith("its place is unknown: ") and word in failure.reason


OPENING = (
    "#31=IFCEXTRUDEDAREASOLID(#30,#90,#13,2000.);\n#90=IFCAXIS2PLACEMENT3D(#11,#13,#91);\n#91=IFCDIRECTION((1.,%s,0.));"
)
# The old text, the new, and what is made with it.
PLACES = {
    "place of a column": ("IFCCARTESIANPOINT((1000.,2000.,0.))", "IFCCARTESIANPOINT((1000.,%s,0.))", {"column"}),
    "radius behind a name": ("$,#24,150.)", "'a (inf) ''b''',#24,%s)", {"column"}),
    "corner": ("IFCCARTESIANPOINT((0.,3500.,0.))", "IFCCARTESIANPOINT((0.,%s,0.))", {"wedge"}),
    "list of corners": ("(0.,900.,0.)", "(0.,%s,0.)", {"pane"}),
    "hole in a wall": ("#31=IFCEXTRUDEDAREASOLID(#30,#12,#13,2000.);", OPENING, {"wall"}),
}


def lost(tmp_path, old, new):
    """The names of what has no shape, and why, in the valid file with one bit of text for another."""
    text = ifc_text("IFC4").decode()
    assert old in text
    (path := tmp_path / "odd.ifc").write_text(text.replace(old, new, 1))
    building = read_ifc(path)
    told = {failure.name: failure.reason for failure in building.failures}
    assert set(building.elements.name) | told.keys() == {"wall", "column", "wedge", "pane"}
    return told


@pytest.mark.long
@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("number", ["-inf", "INF", "-nan(ind)", "1E308"])
def test_what_is_no_number_costs_what_is_made_with_it(tmp_path, place, number):
    old, new, hit = PLACES[place]
    told = lost(tmp_path, old, new % number)
    assert told.keys() == hit and all("a number that is infinite, none, or beyond 1e99" in why for why in told.values())


@pytest.mark.parametrize(
    "ratios, top", [("0.,0.,2.", (0.1, 3.0)), ("0.,3.,4.", (1.9, 2.4)), ("0.,0.,1.E-3", (0.1, 3.0))]
)
def test_the_length_of_a_direction_means_nothing(tmp_path, ratios, top):
    """A wall of 0.2 m is extruded by 3 m, straight up or along 0, 0.6, 0.8."""
    wall, path = "#25=IFCEXTRUDEDAREASOLID(#22,#12,#%d", tmp_path / "long.ifc"
    text = ifc_text("IFC2X3").decode().replace(wall % 13, wall % 90)
    path.write_text(text.replace("#26=", f"#90=IFCDIRECTION(({ratios}));\n#26=", 1))
    _, high = span(read_ifc(path), "wall")
    np.testing.assert_allclose(high[1:], top, atol=1e-5)


@pytest.mark.parametrize("radius, fails", [("1.E7", False), ("1.E9", True), ("4294967295.", True), ("1.E30", True)])
def test_no_circle_is_as_wide_as_a_country(tmp_path, radius, fails):
    told = lost(tmp_path, "#24,150.)", f"#24,{radius})")
    assert ("column" in told) == fails and (not fails or "radius" in told["column"])


def test_what_all_stand_on_is_told_of_the_file(tmp_path):
    path = tmp_path / "odd.ifc"
    path.write_bytes(ifc_text("IFC2X3").replace(b"#14=IFCDIRECTION((1.,0.,0.))", b"#14=IFCDIRECTION((1.,-inf,0.))"))
    with pytest.raises(ValueError, match=r"odd\.ifc: expected a building with surfaces.*#14, IfcDirection"):
        read_ifc(path)


@pytest.mark.parametrize("name", ["-inf", "(inf", "a;b(nan,", "panel (infill)", "a,NaN,b", "it''s 1E155, wide"])
def test_names_may_hold_anything(tmp_path, name):
    path = tmp_path / "named.ifc"
    path.write_text(ifc_text("IFC4").decode().replace(".AREA.,$", f".AREA.,'{name}'"))
    assert not beyond_the_library(path, ifcopenshell.open(path), 0.001, [])


@pytest.mark.parametrize("shift, high, made", [(0.0, 1.0, True), (1.0, 1.0, False), (0.0, 2.0, False)])
def test_profiles_that_others_are_derived_from_are_told_where_they_move(tmp_path, shift, high, made):
    model = Model()
    shape = model.box(*LOWER)
    (solid,) = shape.Items
    origin = model.new("IfcCartesianPoint", (shift, 0.0))
    operator = model.new("IfcCartesianTransformationOperator2DnonUniform", None, None, origin, None, high)
    solid.SweptArea = model.new("IfcDerivedProfileDef", "AREA", None, solid.SweptArea, operator)
    model.product("IfcColumn", "derived", shape)
    model.product("IfcColumn", "square", model.box(*LOWER))
    building = read(model.file, tmp_path)
    assert ("derived" in building.elements.name) == made and len(building.failures) == (not made)


@pytest.mark.parametrize("zero", ["0.0E+000", "0.e000", "0.000000e-000"])
def test_exponents_of_three_digits_are_numbers(tmp_path, zero):
    assert not lost(tmp_path, "IFCCARTESIANPOINT((1000.,2000.,0.))", f"IFCCARTESIANPOINT((1.0E+003,2.E003,{zero}))")


@pytest.mark.parametrize("radius", ["'wide'", "(150.)", "150.);\n#90=IFCDIRECTION('up'"])
def test_one_value_of_another_type_costs_no_other_element(tmp_path, radius):
    assert lost(tmp_path, "#24,150.)", f"#24,{radius})").keys() <= {"column"}


@pytest.mark.parametrize("how, top", [("alone", 4.0), ("joined", 4.0), ("cut out", 1.0), ("cone", None)])
def test_cylinders_are_made_and_cones_are_told(tmp_path, how, top):
    """A cylinder of 4 m, a box of 2 x 2 x 1 m that it is joined to, or cut out of."""
    model = Model()
    tool = model.new("IfcRightCircularCylinder", model.axes(), 4.0, 0.5)
    if how == "cone":
        tool = model.new("IfcRightCircularCone", model.axes(), 4.0, 0.5)
    if how in ("joined", "cut out"):
        block = model.new("IfcBlock", model.axes(-1, -1, 0), 2.0, 2.0, 1.0)
        tool = model.new("IfcBooleanResult", "UNION" if how == "joined" else "DIFFERENCE", block, tool)
    items = [model.new("IfcCsgSolid", tool)]
    model.product("IfcColumn", "round", model.new("IfcShapeRepresentation", model.body, "Body", "CSG", items))
    model.product("IfcColumn", "square", model.box(*LOWER))
    building = read(model.file, tmp_path)
    if top is None:
        assert [one.name for one in building.failures] == ["round"]
        assert "IfcRightCircularCone, is of a kind that the library for IFC cannot make" in building.failures[0].reason
        return
    half = 0.5 if how == "alone" else 1.0
    np.testing.assert_allclose(span(building, "round"), [[-half, -half, 0], [half, half, top]], atol=0.01)
    row = building.elements.name.index("round")
    assert building.failures == () and np.sum(building.triangles.element == row) > 30  # the cylinder's own
