"""Real files, of IFC2X3, IFC4 and IFC4X3, in metres, millimetres and feet: marked, changed, and changed back.

On all eight files all shapes were compared, and EXPRESS rules checked, once by hand; here on those that are quick.
"""

import json
import re

import numpy as np
import pytest

ifcopenshell = pytest.importorskip("ifcopenshell")

from ifcopenshell.util import element as elements_of  # noqa: E402
from ifcopenshell.util.placement import get_local_placement  # noqa: E402

from jaxmm.ifc.marks import DEMOLISH, OWN_SET  # noqa: E402
from jaxmm.ifc.new_elements import FOOT_SLACK  # noqa: E402
from tests.cases.ifc_updates import (  # noqa: E402
    ADDED_COLUMN,
    ADDED_WALL,
    SCANS,
    WHEN,
    apart,
    check_place,
    errors,
    found,
    own_set,
    removed,
    status,
    surfaces,
    update,
    verdict,
    world_points,
)
from warp_scanner.buildings.ifc_files import read_ifc  # noqa: E402

QUICK = ("IfcOpenHouse_IFC4", "bimwhale_TallBuilding", "xbim_wall_door_column_4x3")
FILES = (
    *QUICK, "Schependomlaan_V_L_Constructief", "Schependomlaan_XELLA_Begane_grond", "bimwhale_LargeBuilding",
    "duplex_A", "xbim_House",
)  # fmt: skip
METRES = dict.fromkeys(FILES, 0.001) | {"duplex_A": 1.0, "xbim_wall_door_column_4x3": 0.3048}


@pytest.fixture(scope="module")
def real(data_root):
    """real(name) -> path, model, and the two elements that a test removes: the first has openings where any has."""

    def load(name):
        path = data_root / "ifc" / f"{name}.ifc"
        model = ifcopenshell.open(str(path))
        elements = [*model.by_type("IfcWall"), *model.by_type("IfcColumn")]
        elements.sort(key=lambda one: -len(one.HasOpenings))
        return path, model, elements[:2], elements[2:]

    return load


@pytest.mark.parametrize("name", FILES)
def test_a_real_file_is_marked(real, tmp_path, name):
    path, model, gone, rest = real(name)
    heights = np.random.default_rng(len(name)).uniform(-3.0, 14.0, 6)
    added = [ADDED_WALL, ADDED_COLUMN] * 3
    added = [one._replace(center=np.array([7.0, -3.0, foot + one.dimensions[2] / 2]))
             for one, foot in zip(added, heights, strict=True)]  # fmt: skip
    hidden = tuple(verdict(one, "occluded") for one in rest[:1])
    summary, after = update(path, found(*map(removed, gone), *added, elements=hidden), tmp_path)
    assert summary.notes == () and after.schema_identifier == model.schema_identifier
    assert name not in QUICK or not errors(summary.path) - errors(path)
    assert (tmp_path / "undo.json").stat().st_size < 2_000
    for one in gone:
        assert own_set(after, one.GlobalId)["Verdict"] == "removed"
        assert status(after, one.GlobalId) == (None if model.schema == "IFC2X3" else [DEMOLISH])
    levels = np.array(sorted((one.Elevation or 0.0) * METRES[name] for one in model.by_type("IfcBuildingStorey")))
    for guid, one, foot in zip(summary.added, added, heights, strict=True):
        check_place(world_points(after, guid), one)
        storey = elements_of.get_container(after.by_guid(guid))
        assert np.abs(levels - foot).min() > 1e-6
        below = levels[levels <= foot + FOOT_SLACK]
        level = below[-1] if len(below) else levels[0]
        assert (storey.Elevation or 0.0) * METRES[name] == pytest.approx(level)
        assert own_set(after, guid)["Scans"] == [one.file for one in SCANS]


def test_an_ifc2x3_file_is_told_once_who_updates_it(real, tmp_path):
    path, _, gone, _ = real("bimwhale_TallBuilding")
    once, _ = update(path, found(removed(gone[0]), ADDED_WALL), tmp_path / "once")
    twice, model = update(once.path, found(removed(gone[0]), ADDED_COLUMN), tmp_path / "twice")
    assert [one.ApplicationIdentifier for one in model.by_type("IfcApplication")].count("jaxmm") == 1
    history = model.by_guid(twice.added[0]).OwnerHistory
    assert history.OwningApplication.ApplicationIdentifier == "jaxmm" and history.ChangeAction == "ADDED"
    assert history.CreationDate == WHEN.timestamp()


def _facts(model, guids: list[str]) -> dict:
    """What a reader knows of elements: class, attributes, sets, container, type, material, shapes."""
    known = {}
    for one in map(model.by_guid, guids):
        sets = elements_of.get_psets(one)
        sets = {
            name: {k: v for k, v in values.items() if k != "id"} for name, values in sets.items() if name != OWN_SET
        }
        container, kind = elements_of.get_container(one), elements_of.get_type(one)
        material = elements_of.get_material(one)
        known[one.GlobalId] = (
            one.is_a(), one.Name, one.Tag, sets, container and container.GlobalId, kind and kind.GlobalId,
            material and material.id(), [shape.id() for shape in one.Representation.Representations]
            if one.Representation else None,
        )  # fmt: skip
    return known


def _litter(model, text: bytes) -> set[int]:
    """Shapes, placements and properties that nothing uses: remarks on them (styles, layers, aspects) are no use."""
    used = set()
    for line in re.findall(rb"#\d+\s*=[^;]*;", re.sub(rb"'(?:[^']|'')*'", b"", text)):
        if not re.match(rb"#\d+\s*=\s*IFC(STYLEDITEM|PRESENTATIONLAYERASSIGNMENT|SHAPEASPECT)", line):
            used.update(map(int, re.findall(rb"#(\d+)", line)[1:]))
    kinds = ("IfcRepresentationItem", "IfcShapeRepresentation", "IfcObjectPlacement", "IfcProperty", "IfcProfileDef")
    return {one.id() for kind in kinds for one in model.by_type(kind) if not one.is_a("IfcStyledItem")} - used


def _places(model, guids) -> dict[str, np.ndarray]:
    placement = {guid: model.by_guid(guid).ObjectPlacement for guid in guids}
    return {guid: get_local_placement(one) for guid, one in placement.items() if one}


@pytest.mark.long
@pytest.mark.parametrize("name", FILES)
def test_of_a_real_file_only_what_was_removed_is_deleted(real, tmp_path, name):
    path, model, gone, _ = real(name)
    going = {one.GlobalId for one in gone} | {
        part.GlobalId for one in gone for part in elements_of.get_decomposition(one)
        if not part.is_a("IfcDoor") and not part.is_a("IfcWindow")
    }  # fmt: skip
    hosted = {fill.RelatedBuildingElement.GlobalId for one in gone for opening in one.HasOpenings
              for fill in opening.RelatedOpeningElement.HasFillings}  # fmt: skip
    summary, after = update(path, found(*map(removed, gone), ADDED_WALL), tmp_path, apply=True)
    assert name not in QUICK or not errors(summary.path) - errors(path)
    assert len(summary.notes) == len(hosted)
    for guid in hosted:
        assert own_set(after, guid)["Note"] == "its host was removed" and guid in " ".join(summary.notes)
    staying = [one.GlobalId for one in model.by_type("IfcElement") if one.GlobalId not in going]
    assert {*staying, *summary.added} == {one.GlobalId for one in after.by_type("IfcElement")}
    sample = [*hosted, *np.random.default_rng(1).permutation(staying)[:40].tolist()]
    assert _facts(after, sample) == _facts(model, sample)
    places = _places(model, staying)
    for guid, matrix in _places(after, places).items():
        np.testing.assert_allclose(matrix, places[guid], atol=1e-6)
    assert _litter(after, summary.path.read_bytes()) <= _litter(model, path.read_bytes())
    undo = json.loads((tmp_path / "undo.json").read_text())
    assert sum(len(one["before"]) for one in undo["edits"]) < 0.15 * path.stat().st_size


@pytest.mark.parametrize("name", QUICK[1:])
def test_deleting_changes_no_other_shape(real, real_building, tmp_path, name):
    path, _, gone, _ = real(name)
    summary, _ = update(path, found(*map(removed, gone), ADDED_WALL), tmp_path, apply=True)
    before, after = surfaces(real_building(name)), surfaces(read_ifc(summary.path))
    assert after.keys() == before.keys() - set(summary.removed) | set(summary.added)
    for guid in before.keys() & after.keys():
        assert apart(after[guid], before[guid]) < 1e-5
    check_place(after[summary.added[0]], ADDED_WALL)
