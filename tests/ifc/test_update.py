"""What a detection found, written into the model of a room: in the right place, valid, and nothing else changed."""

import hashlib
import math
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest

from tests.cases.detections import true_case

ifcopenshell = pytest.importorskip("ifcopenshell")

from ifcopenshell.util import element as elements_of  # noqa: E402
from ifcopenshell.util.placement import get_local_placement  # noqa: E402
from ifcopenshell.util.pset import get_template  # noqa: E402

from jaxmm.ifc.marks import COMMON_SETS, DEMOLISH, NEW, OWN_SET  # noqa: E402
from jaxmm.ifc.update import write_update  # noqa: E402
from jaxmm.inputs import InputError  # noqa: E402
from jaxmm.verdicts.results import ElementVerdict, Mismatch  # noqa: E402
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
from warp_scanner.buildings.room_ifc import write_room  # noqa: E402
from warp_scanner.rooms.rooms import RoomConfig, make_rooms  # noqa: E402


@pytest.fixture(scope="module", params=["pillar_added", "all_four", "wall_moved"])
def case(request, tmp_path_factory):
    return true_case(tmp_path_factory.mktemp(request.param), request.param, 1)


@pytest.mark.parametrize("apply", [False, True])
def test_a_room_is_updated_as_it_truly_changed(case, tmp_path, apply):
    summary, model = update(case.ifc, case.detection, tmp_path, apply=apply)
    assert summary.notes == () and not errors(summary.path)
    changes = {kind: [one for one in case.detection.mismatches if one.mismatch_type == kind]
               for kind in ("added", "removed")}  # fmt: skip
    assert summary.removed == tuple(one.element for one in changes["removed"])
    assert summary.occluded == tuple(one.guid for one in case.detection.elements if one.verdict == "occluded")
    before, building = surfaces(case.building), read_ifc(summary.path)
    after = surfaces(building)
    assert after.keys() == before.keys() - (set(summary.removed) if apply else set()) | set(summary.added)
    for guid in before.keys() & after.keys():
        assert apart(after[guid], before[guid]) < 1e-5
    assert len(summary.added) == len(changes["added"])
    for guid, one in zip(summary.added, changes["added"], strict=True):
        check_place(after[guid], one)
        row = building.elements.guid.index(guid)
        assert building.elements.ifc_class[row] == {"wall": "IfcWall", "pillar": "IfcColumn"}[one.object_type]
        assert building.storeys.name[building.elements.storey[row]] == "storey"
        assert status(model, guid) == [NEW] and own_set(model, guid)["Verdict"] == "added"
    if not apply:
        assert all(status(model, guid) == [DEMOLISH] for guid in summary.removed)
    told = {one.GlobalId for one in model.by_type("IfcProduct") if OWN_SET in elements_of.get_psets(one)}
    assert told == {*summary.added, *summary.occluded, *(() if apply else summary.removed)}


@pytest.fixture(scope="module")
def room(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("room") / "room.ifc"
    write_room(path, make_rooms(RoomConfig(), 11, np.arange(1)), 0)
    return path


def changed(room: Path, path: Path, change) -> Path:
    """A copy of a file with its model changed."""
    model = ifcopenshell.open(str(room))
    change(model)
    model.write(str(path))
    return path


def first(model, kind: str):
    return model.by_type(kind)[0]


def place_far(model):
    """Site and storey turned, shifted to a national grid, and georeferenced on top."""
    for kind, offset, yaw in (("IfcSite", (155_000.123, 463_000.456, 12.3), 40.0),
                              ("IfcBuildingStorey", (3.5, -8.25, 0.5), -77.0)):  # fmt: skip
        axes = first(model, kind).ObjectPlacement.RelativePlacement
        axes.Location = model.create_entity("IfcCartesianPoint", offset)
        ahead = (math.cos(math.radians(yaw)), math.sin(math.radians(yaw)), 0.0)
        axes.RefDirection = model.create_entity("IfcDirection", ahead)
    system = model.create_entity("IfcProjectedCRS", "EPSG:28992")
    context = model.by_type("IfcGeometricRepresentationContext", include_subtypes=False)[0]
    model.create_entity("IfcMapConversion", context, system, 1e5, 2e5, 3.0, 0.6, 0.8)


def drop_body_context(model):
    """Bodies in the context of the whole model, as old exporters have them."""
    context = model.by_type("IfcGeometricRepresentationContext", include_subtypes=False)[0]
    for shape in model.by_type("IfcShapeRepresentation"):
        shape.ContextOfItems = context
    model.remove(first(model, "IfcGeometricRepresentationSubContext"))


def askew(model):
    """A reference direction that is not across the axis: the x axis is where it points to, laid across."""
    axes = first(model, "IfcBuildingStorey").ObjectPlacement.RelativePlacement
    axes.Axis = model.create_entity("IfcDirection", (0.0, 0.0, 1.0))
    axes.RefDirection = model.create_entity("IfcDirection", (1.0, 0.0, 0.3))


def drop_placements(model):
    first(model, "IfcBuildingStorey").ObjectPlacement = None


@pytest.mark.parametrize(
    ("change", "place"),
    [
        (place_far, (155_000.0, 463_000.0, 10.0)),
        (drop_body_context, (0.0, 0.0, 0.0)),
        (askew, (0.0, 0.0, 0.0)),
        (drop_placements, (5.0, 0.0, 0.0)),
    ],
)
def test_added_objects_stand_at_their_world_place_however_the_file_is_placed(room, tmp_path, change, place):
    prior = changed(room, tmp_path / "prior.ifc", change)
    boxes = [one._replace(center=one.center + place) for one in (ADDED_WALL, ADDED_COLUMN)]
    summary, _ = update(prior, found(*boxes), tmp_path / "out")
    building = read_ifc(summary.path)
    after = surfaces(building)
    for guid, one in zip(summary.added, boxes, strict=True):
        check_place(after[guid], one)
        assert building.elements.storey[building.elements.guid.index(guid)] == 0
    assert errors(summary.path) == errors(prior)


def test_a_random_box_comes_back(room, tmp_path):
    rng = np.random.default_rng(2)
    boxes = [
        Mismatch(
            ("wall", "pillar")[row % 2], "added", rng.uniform(-20, 20, 3), rng.uniform(0.05, 4, 3),
            rng.uniform(-400, 400), rng.random(),
        )
        for row in range(40)
    ]  # fmt: skip
    summary, model = update(room, found(*boxes), tmp_path)
    for number, (guid, one) in enumerate(zip(summary.added, boxes, strict=True), 1):
        check_place(world_points(model, guid), one, 1e-6)
        assert model.by_guid(guid).Name == f"added {one.object_type} {number}"
        assert own_set(model, guid)["Probability"] == pytest.approx(one.probability, abs=1e-6)
        assert model.by_guid(guid).PredefinedType == {"wall": "SOLIDWALL", "pillar": "COLUMN"}[one.object_type]


def test_a_walls_own_x_runs_along_it(room, tmp_path):
    summary, model = update(room, found(ADDED_WALL), tmp_path)
    matrix = get_local_placement(model.by_guid(summary.added[0]).ObjectPlacement)
    np.testing.assert_allclose(matrix[:3, 0], [-0.5, math.sqrt(3) / 2, 0.0], atol=1e-12)  # 30 deg + 90 deg


def test_the_mark_of_what_is_nearly_sure_does_not_say_sure(room, tmp_path):
    wall = ifcopenshell.open(str(room)).by_type("IfcWall")[0]
    _, model = update(room, found(removed(wall)._replace(probability=1.0 - 3e-7)), tmp_path)
    assert own_set(model, wall.GlobalId)["Probability"] == 0.999999


def test_the_mark_tells_where_it_comes_from(room, tmp_path):
    model = ifcopenshell.open(str(room))
    wall, other = model.by_type("IfcWall")[:2]
    moved = ADDED_WALL._replace(moved_from=0, observable_fraction=0.625, type_probability=0.75)
    summary, model = update(room, found(removed(wall), moved, elements=(verdict(other, "occluded"),)), tmp_path)
    shared = {
        "Scans": [one.file for one in SCANS],
        "Date": "2026-03-04T05:06:07+00:00",
        "Software": f"jaxmm {version('jaxmm')}",
    }
    told = {guid: {k: v for k, v in own_set(model, guid).items() if k != "id"}
            for guid in (wall.GlobalId, other.GlobalId, *summary.added)}  # fmt: skip
    assert told[wall.GlobalId] == shared | {"Verdict": "removed", "Probability": 0.93, "ObservableFraction": 0.5}
    assert told[other.GlobalId] == shared | {"Verdict": "occluded", "Probability": 0.02}
    assert told[summary.added[0]] == shared | {
        "Verdict": "added", "Probability": 0.81, "TypeProbability": 0.75, "ObservableFraction": 0.625,
        "MovedFrom": wall.GlobalId,
    }  # fmt: skip
    assert status(model, other.GlobalId) is None


def test_present_and_unscanned_elements_are_not_touched(room, tmp_path):
    walls = ifcopenshell.open(str(room)).by_type("IfcWall")
    named = [verdict(wall, name) for wall, name in zip(walls, ("present", "unscanned"), strict=False)]
    summary, _ = update(room, found(elements=tuple(named)), tmp_path)
    assert summary.path.read_bytes() == room.read_bytes()


def test_a_removed_verdict_without_a_mismatch_is_marked_and_never_deleted(room, tmp_path):
    wall = first(ifcopenshell.open(str(room)), "IfcWall")
    summary, model = update(room, found(elements=(verdict(wall, "removed"),)), tmp_path, apply=True)
    assert own_set(model, wall.GlobalId)["Verdict"] == "removed" and status(model, wall.GlobalId) is None
    assert summary.removed == ()


# Property sets that are there already.


def give_common_set(model):
    """Two walls and the wall's type share one Pset_WallCommon; a third has Status in its own."""
    walls = model.by_type("IfcWall")[:3]
    fire = model.create_entity("IfcPropertySingleValue", "FireRating", None, model.create_entity("IfcLabel", "F90"))
    old = model.create_entity("IfcPropertyEnumeratedValue", "Status", None, [model.create_entity("IfcLabel", "NEW")])
    for owners, properties in ((walls[:2], [fire]), (walls[2:], [fire, old])):
        pset = model.create_entity(
            "IfcPropertySet", ifcopenshell.guid.new(), Name="Pset_WallCommon", HasProperties=properties
        )
        model.create_entity(
            "IfcRelDefinesByProperties", ifcopenshell.guid.new(), RelatedObjects=owners, RelatingPropertyDefinition=pset
        )


def test_other_properties_and_other_owners_of_a_set_stay_as_they_were(room, tmp_path):
    prior = changed(room, tmp_path / "prior.ifc", give_common_set)
    walls = ifcopenshell.open(str(prior)).by_type("IfcWall")
    summary, model = update(prior, found(removed(walls[0]), removed(walls[2])), tmp_path / "out")
    sets = [elements_of.get_psets(model.by_guid(wall.GlobalId))["Pset_WallCommon"] for wall in walls[:3]]
    told = [{name: value for name, value in one.items() if name != "id"} for one in sets]
    assert told == [{"FireRating": "F90", "Status": [DEMOLISH]}, {"FireRating": "F90"},
                    {"FireRating": "F90", "Status": [DEMOLISH]}]  # fmt: skip
    assert not errors(summary.path)
    # The Status that nobody uses any more is gone with its text.
    assert len(model.by_type("IfcPropertyEnumeratedValue")) == 2 and len(model.by_type("IfcPropertyEnumeration")) == 1


def test_an_update_of_an_update_replaces_our_mark(room, tmp_path):
    wall = first(ifcopenshell.open(str(room)), "IfcWall")
    one, _ = update(room, found(removed(wall), ADDED_WALL), tmp_path / "one")
    again = removed(wall, 0.5)._replace(observable_fraction=None)
    two, model = update(one.path, found(again, ADDED_COLUMN), tmp_path / "two")
    mark = own_set(model, wall.GlobalId)
    assert mark["Probability"] == 0.5 and "ObservableFraction" not in mark
    names = [one.RelatingPropertyDefinition.Name for one in model.by_guid(wall.GlobalId).IsDefinedBy]
    assert sorted(names) == ["Pset_WallCommon", OWN_SET]
    assert {*one.added, *two.added} <= {one.GlobalId for one in model.by_type("IfcElement")}
    assert not errors(two.path)


@pytest.mark.parametrize(("schema", "there"), [("IFC2X3", False), ("IFC4", True), ("IFC4X3", True)])
def test_status_is_where_the_standards_own_templates_have_it(schema, there):
    templates = get_template("IFC4X3_ADD2" if schema == "IFC4X3" else schema)
    for name in COMMON_SETS.values():
        known = {one.Name: one for one in templates.get_by_name(name).HasPropertyTemplates}
        assert ("Status" in known) is there
        if there:
            values = {one.wrappedValue for one in known["Status"].Enumerators.EnumerationValues}
            assert known["Status"].Enumerators.Name == "PEnum_ElementStatus" and {NEW, DEMOLISH} <= values


# What cannot be done is said, and nothing is changed for it.


def test_what_is_not_one_element_of_the_file_is_named_and_left_alone(room, tmp_path):
    def repeat(model):
        walls = model.by_type("IfcWall")
        walls[1].GlobalId = walls[0].GlobalId

    prior = changed(room, tmp_path / "prior.ifc", repeat)
    model = ifcopenshell.open(str(prior))
    twice = first(model, "IfcWall").GlobalId
    storey = first(model, "IfcRelAggregates").GlobalId
    flat = ADDED_WALL._replace(dimensions=np.array([1.0, 0.0, 3.0]))
    lost = ADDED_COLUMN._replace(center=np.array([0.0, np.nan, 0.0]))
    bad = [removed(one) for one in (twice, f"{twice}_1", None, storey)]
    occluded = ElementVerdict(twice, "IfcWall", "", "", "occluded", 0.02, 1, (0, 0, 1, 0))
    for apply in (False, True):
        detection = found(*bad, flat, lost, elements=(occluded,))
        summary, _ = update(prior, detection, tmp_path / str(apply), apply=apply)
        assert summary.path.read_bytes() == prior.read_bytes()
        assert summary[1:4] == ((), (), ()) and len(summary.notes) == 7
        for number, note in enumerate(summary.notes[1:5], 2):
            assert f"mismatch {number}," in note or "occluded" in note
        assert f"{twice}, of which the file has 2" in summary.notes[0] and f"{twice}_1" in summary.notes[1]


def test_what_a_mismatch_calls_removed_is_not_called_occluded(room, tmp_path):
    wall = first(ifcopenshell.open(str(room)), "IfcWall")
    summary, model = update(room, found(removed(wall), elements=(verdict(wall, "occluded"),)), tmp_path)
    assert summary.occluded == () and own_set(model, wall.GlobalId)["Verdict"] == "removed"


def test_two_mismatches_of_one_element_are_one_removal(room, tmp_path):
    wall = first(ifcopenshell.open(str(room)), "IfcWall")
    summary, _ = update(room, found(removed(wall), removed(wall, 0.1)), tmp_path, apply=True)
    assert summary.removed == (wall.GlobalId,) and summary.notes == ()


def test_the_file_itself_is_never_written_to(room, tmp_path):
    prior = tmp_path / "updated.ifc"
    prior.write_bytes(room.read_bytes())
    (tmp_path / "link").symlink_to(tmp_path)
    for out in (tmp_path, tmp_path / "link"):
        with pytest.raises(InputError, match="must stay as it is"):
            write_update(prior, found(ADDED_WALL), out)
    assert prior.read_bytes() == room.read_bytes() and not (tmp_path / "undo.json").exists()


@pytest.mark.parametrize("content", [None, b"", b"no IFC", b"ISO-10303-21;\nHEADER;\nFILE_SCHEMA(('IFC9'));\nENDSEC;"])
def test_a_prior_that_cannot_be_read_leaves_nothing(tmp_path, content):
    prior = tmp_path / "prior.ifc"
    if content is not None:
        prior.write_bytes(content)
    with pytest.raises(InputError, match=r"prior\.ifc"):
        write_update(prior, found(ADDED_WALL), tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_the_same_input_gives_the_same_bytes(room, tmp_path):
    wall = first(ifcopenshell.open(str(room)), "IfcWall")
    digests = set()
    for number in range(2):
        write_update(room, found(removed(wall), ADDED_WALL), tmp_path / str(number), when=WHEN)
        digests.add(hashlib.sha256((tmp_path / str(number) / "updated.ifc").read_bytes()).hexdigest())
    write_update(room, found(removed(wall), ADDED_WALL), tmp_path / "naive", when=WHEN.replace(tzinfo=None))
    digests.add(hashlib.sha256((tmp_path / "naive" / "updated.ifc").read_bytes()).hexdigest())
    dated = found(removed(wall), ADDED_WALL)._replace(date="2026-03-04T05:06:07")
    write_update(room, dated, tmp_path / "dated")  # of the day of the scans, not of the run
    digests.add(hashlib.sha256((tmp_path / "dated" / "updated.ifc").read_bytes()).hexdigest())
    assert len(digests) == 1


def test_what_may_stand_in_part_is_marked_and_never_deleted(room, tmp_path):
    """Of one wall a fifth of the rays still end on it, of the other fewer."""
    short, gone = ifcopenshell.open(str(room)).by_type("IfcWall")[:2]
    told = removed(short)._replace(standing=0.2), removed(gone)._replace(standing=0.19)
    summary, model = update(room, found(*told), tmp_path, apply=True)
    left = {one.GlobalId for one in model.by_type("IfcWall")}
    assert short.GlobalId in left and gone.GlobalId not in left
    assert own_set(model, short.GlobalId)["Verdict"] == "removed" and status(model, short.GlobalId) == ["DEMOLISH"]
    (note,) = [one for one in summary.notes if short.GlobalId in one]
    assert "marked, not deleted: 20% of its rays end on it" in note
