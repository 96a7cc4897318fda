"""Releases of IFC that the library does not know, text before the file, and entities of classes that a schema lacks."""

import re

import pytest

from tests.warp_scanner.test_hard_ifc import Model, span
from warp_scanner.scenes.building import AS_IT_IS

ifcopenshell = pytest.importorskip("ifcopenshell")

from jaxmm.ifc.draft import open_draft  # noqa: E402
from warp_scanner.buildings.ifc_files import parse_ifc  # noqa: E402

LAST = "the file is of schema {}, and was read as {}, the nearest that is known"


def text_of(schema):
    """A model of two columns, of 3 m, the second with a place of its own at x = 5."""
    model = Model(schema)
    model.product("IfcColumn", "first", model.box((0, 0, 0), (0.4, 0.4, 3)))
    model.product("IfcColumn", "second", model.box((0, 0, 0), (0.4, 0.4, 3)), at=(5, 0, 0))
    return model.file.to_string()


def renamed(text, schema):
    return re.sub(r"FILE_SCHEMA\(\('\w+'\)\)", f"FILE_SCHEMA(('{schema}'))", text)


@pytest.mark.parametrize(
    "made, named, known",
    [
        pytest.param("IFC4X3", "IFC4X3", "IFC4X3_ADD2", id="the first of a standard"),
        pytest.param("IFC4X3", "IFC4X3_RC2", "IFC4X3_ADD2", id="a candidate"),
        pytest.param("IFC4X3", "ifc4x3_add1", "IFC4X3_ADD2", id="small letters"),
        pytest.param("IFC4", "IFC4X1", "IFC4", id="a successor"),
        pytest.param("IFC4X3", "IFC4X2", "IFC4X3_ADD2", id="whichever knows the classes of the file"),
        pytest.param("IFC4", "IFC4X3_RC1", "IFC4", id="and knows those that were taken out since"),
        pytest.param("IFC2X3", "IFC2X3_TC1", "IFC2X3", id="a correction"),
    ],
)
def test_other_releases_are_read_as_the_nearest_that_is_known(tmp_path, made, named, known):
    path = tmp_path / "model.ifc"
    text = renamed(text_of(made), named)
    if named == "IFC4X2":
        text = text.replace("IFCCOLUMN", "IFCBEARING", 1)
    if named in ("IFC4X1", "IFC4X3_RC1"):
        text = text.replace("IFCCOLUMN", "IFCCOLUMNSTANDARDCASE", 1)
    path.write_text(text)
    building = parse_ifc(path, AS_IT_IS)
    assert set(building.elements.name) == {"first", "second"} and not building.failures
    assert building.notes[0] == LAST.format(named.upper(), known)
    original, draft = open_draft(path, None, "2026-01-01T00:00:00")
    assert original == path.read_bytes() and len(draft.model.by_type("IfcElement")) == 2


def test_a_mark_of_the_encoding_before_the_file_is_passed_over(tmp_path):
    path = tmp_path / "model.ifc"
    path.write_bytes(b"\xef\xbb\xbf" + text_of("IFC4").replace("\n", "\r\n").encode())
    building = parse_ifc(path, AS_IT_IS)
    assert set(building.elements.name) == {"first", "second"} and building.notes[0].startswith(
        "the file has no storeys"
    )


@pytest.mark.parametrize("schema", ["IFC9", "IFC5X1", "AP214"])
def test_what_is_near_to_no_schema_is_refused(tmp_path, schema):
    path = tmp_path / "model.ifc"
    path.write_text(renamed(text_of("IFC4"), schema))
    with pytest.raises(ValueError, match=f"not a readable IFC file: Unsupported schema: {schema}"):
        parse_ifc(path, AS_IT_IS)


@pytest.mark.parametrize(
    "lost",
    [
        pytest.param(r"(#\d+=)IFCLOCALPLACEMENT\([^;]*", id="place"),
        pytest.param(r"(#\d+=)IFCRECTANGLEPROFILEDEF\([^;]*", id="part of a body"),
    ],
)
def test_an_element_without_its_place_or_a_part_of_its_body_is_said_to_be_missing(tmp_path, lost):
    text, path = text_of("IFC4"), tmp_path / "model.ifc"
    last = list(re.finditer(lost, text))[-1]
    path.write_text(text[: last.start()] + last[1] + "IFCNEWTHING(1.)" + text[last.end() :])
    building = parse_ifc(path, AS_IT_IS)
    assert building.elements.name == ("first",)
    assert [(one.name, "is of an unknown class" in one.reason) for one in building.failures] == [("second", True)]
    assert building.notes[0] == "entities of classes that the schema lacks were left out: IFCNEWTHING"
    assert span(building, "first")[1, 0] < 1.0


@pytest.mark.parametrize(
    "begin, old, new",
    [
        pytest.param("IFCCOLUMN(", ",$,", ",#9999,", id="author"),
        pytest.param("IFCGEOMETRICREPRESENTATIONCONTEXT(", ",$)", ",#9999)", id="north"),
        pytest.param(
            "IFCPRODUCTDEFINITIONSHAPE($,$,", "(#", "(#8001,#",
            id="axis",
        ),
    ],
)  # fmt: skip
def test_an_element_that_lacks_what_is_no_part_of_its_body_is_as_it_was(tmp_path, begin, old, new):
    path, text = tmp_path / "model.ifc", text_of("IFC4")
    body = re.search(r"(#\d+)=IFCGEOMETRICREPRESENTATIONSUBCONTEXT", text)[1]
    axis = f"#8000=IFCNEWTHING(1.);\n#8001=IFCSHAPEREPRESENTATION({body},'Axis','Curve2D',(#8000));\n"
    lines = text.replace("DATA;\n", f"DATA;\n{axis}").splitlines(keepends=True)
    path.write_text("".join(line.replace(old, new, 1) if begin in line else line for line in lines))
    building = parse_ifc(path, AS_IT_IS)
    assert building.elements.name == ("first", "second") and not building.failures
    assert span(building, "second")[0, 0] == pytest.approx(span(building, "first")[0, 0] + 5.0)


@pytest.mark.parametrize("line", ["#{}=IFCNEWTHING(1.);", "#{}=IFCNEWTHING(#8000);", ""])
def test_new_entities_take_no_number_that_the_file_has_or_refers_to(tmp_path, line):
    path, text = tmp_path / "model.ifc", text_of("IFC4")
    last = max(map(int, re.findall(r"#(\d+)=", text))) + 1
    author = text.replace(",$,'second'", f",#{last},'second'")
    path.write_text(author.replace("DATA;\n", f"DATA;\n{line.format(last)}\n"))
    _, draft = open_draft(path, None, "2026-01-01T00:00:00")
    assert draft.create("IfcCartesianPoint", (0.0, 0.0, 0.0)).id() == last + 1
