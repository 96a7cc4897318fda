"""How far off its place an element stands, in its model: in the file's units, gaps left out, valid everywhere."""

import numpy as np
import pytest

ifcopenshell = pytest.importorskip("ifcopenshell")

from ifcopenshell.util import element as elements_of  # noqa: E402
from ifcopenshell.util.pset import get_template  # noqa: E402

from jaxmm.ifc.marks import _BASES, DEVIATION_SET, OWN_SET, UNCERTAINTY_SET  # noqa: E402
from jaxmm.verdicts.results import ElementVerdict  # noqa: E402
from tests.cases.displaced import deviation  # noqa: E402
from tests.cases.ifc_updates import SCANS, errors, found, removed, update  # noqa: E402
from warp_scanner.buildings.room_ifc import write_room  # noqa: E402
from warp_scanner.rooms.rooms import RoomConfig, make_rooms  # noqa: E402

OFF = deviation(-0.023)._replace(scans=(1,))


@pytest.fixture(scope="module")
def room(tmp_path_factory):
    path = tmp_path_factory.mktemp("room") / "room.ifc"
    write_room(path, make_rooms(RoomConfig(), 11, np.arange(1)), 0)
    return path


def in_millimetres(room, path):
    """The same file with its numbers read as millimetres."""
    model = ifcopenshell.open(str(room))
    for unit in model.by_type("IfcSIUnit"):
        if unit.UnitType == "LENGTHUNIT":
            unit.Prefix = "MILLI"
    model.write(str(path))
    return path


def measured(element, verdict="present", off=OFF):
    return ElementVerdict(element.GlobalId, element.is_a(), "", "", verdict, 0.02, 5, (0, 90, 1, 2), None, off)


def told(model, guid, name=DEVIATION_SET):
    values = elements_of.get_psets(model.by_guid(guid)).get(name, {})
    return {key: value for key, value in values.items() if key != "id"}


@pytest.mark.parametrize("unit", [1.0, 0.001])
def test_numbers_are_in_the_unit_of_the_file_and_gaps_are_left_out(room, tmp_path, unit):
    prior = room if unit == 1.0 else in_millimetres(room, tmp_path / "prior.ifc")
    wall, other, third = ifcopenshell.open(str(prior)).by_type("IfcWall")[:3]
    elements = (measured(wall, "displaced"), measured(other), measured(third, "unscanned", None))
    summary, model = update(prior, found(elements=elements), tmp_path / "out")
    assert not errors(summary.path) and summary.notes == ()
    off = told(model, wall.GlobalId)
    lengths = {"Distance": -0.023, "DistanceLow": -0.025, "DistanceHigh": -0.021, "OffsetX": -0.023,
               "OffsetXLow": -0.025, "OffsetXHigh": -0.021, "Flatness": 0.004}  # fmt: skip
    assert {name: off[name] for name in lengths} == pytest.approx({k: v / unit for k, v in lengths.items()})
    assert not {"OffsetY", "OffsetYLow", "OffsetZ", "Lean", "Doubts"} & off.keys()
    assert off["Turn"] == pytest.approx(np.radians(0.12), abs=1e-8)  # the file has radians
    assert (off["Rays"], off["LevelOfAccuracy"], off["DIN18202"]) == (1234, "LOA20", "beyond")
    assert off["Scans"] == [SCANS[1].file] and off["Date"].startswith("2026-03-04")
    assert told(model, wall.GlobalId, OWN_SET)["Verdict"] == "displaced"
    assert told(model, other.GlobalId) == off and not told(model, other.GlobalId, OWN_SET)
    assert not told(model, third.GlobalId)
    entity = next(one for one in model.by_type("IfcPropertySingleValue") if one.Name == "OffsetX")
    assert entity.NominalValue.is_a("IfcLengthMeasure")


def test_an_element_that_is_gone_is_not_told_to_be_off(room, tmp_path):
    wall = ifcopenshell.open(str(room)).by_type("IfcWall")[0]
    for apply in (False, True):
        detection = found(removed(wall), elements=(measured(wall),))
        _, model = update(room, detection, tmp_path / str(apply), apply=apply)
        assert apply or not told(model, wall.GlobalId)


def test_the_standards_set_is_there_where_the_schema_has_it(room, tmp_path):
    """In IFC4X3; the words and kinds are those of the standard's own template."""
    text = room.read_text()
    wall = ifcopenshell.open(str(room)).by_type("IfcWall")[0]
    for schema in ("IFC4", "IFC4X3_ADD2"):
        prior = tmp_path / f"{schema}.ifc"
        prior.write_text(text.replace("'IFC4'", f"'{schema}'"))
        summary, model = update(prior, found(elements=(measured(wall),)), tmp_path / schema)
        assert not errors(summary.path)
        off = told(model, wall.GlobalId, UNCERTAINTY_SET)
        if schema == "IFC4":
            assert off == {}
            continue
        assert off["UncertaintyBasis"] == ["MEASUREMENT"]
        assert off["LinearUncertainty"] == pytest.approx(0.004)  # the width of the interval
        template = get_template("IFC4X3_ADD2").get_by_name(UNCERTAINTY_SET)
        known = {one.Name: one for one in template.HasPropertyTemplates}
        assert off.keys() <= known.keys()
        values = [one.wrappedValue for one in known["UncertaintyBasis"].Enumerators.EnumerationValues]
        assert tuple(values) == _BASES


def test_an_update_of_an_update_replaces_what_was_told(room, tmp_path):
    wall = ifcopenshell.open(str(room)).by_type("IfcWall")[0]
    one, _ = update(room, found(elements=(measured(wall),)), tmp_path / "one")
    _, model = update(one.path, found(elements=(measured(wall, "present", deviation(0.05)),)), tmp_path / "two")
    assert told(model, wall.GlobalId)["Distance"] == pytest.approx(0.05)
    names = [relation.RelatingPropertyDefinition.Name for relation in model.by_guid(wall.GlobalId).IsDefinedBy]
    assert names.count(DEVIATION_SET) == 1
