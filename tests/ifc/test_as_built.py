"""as_built.ifc: displaced elements stand where they were measured, all else where it stood; all can be taken back."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

ifcopenshell = pytest.importorskip("ifcopenshell")

from ifcopenshell.util.placement import get_local_placement  # noqa: E402

from jaxmm.ifc.as_built import NOT_WRITTEN, write_as_built  # noqa: E402
from jaxmm.ifc.undo import AS_BUILT, AS_BUILT_UNDO, revert  # noqa: E402
from jaxmm.verdicts.results import Detection, Drawing, ElementVerdict  # noqa: E402
from tests.cases.displaced import deviation  # noqa: E402
from tests.cases.ifc_updates import SCANS, apart, check_references, errors, surfaces  # noqa: E402
from warp_scanner.buildings.ifc_files import read_ifc  # noqa: E402
from warp_scanner.buildings.room_ifc import write_room  # noqa: E402
from warp_scanner.rooms.rooms import RoomConfig, make_rooms  # noqa: E402

TURNED = (0.004, -0.003, 0.01)  # [rad]


@pytest.fixture(scope="module")
def room(tmp_path_factory):
    """A room with a door, of which the file is placed in turned coordinates."""
    path = tmp_path_factory.mktemp("room") / "room.ifc"
    write_room(path, make_rooms(RoomConfig(), 11, np.arange(1)), 0)
    model = ifcopenshell.open(str(path))
    axes = model.by_type("IfcBuildingStorey")[0].ObjectPlacement.RelativePlacement
    axes.Location = model.create_entity("IfcCartesianPoint", (120_000.5, -31.25, 4.0))
    axes.RefDirection = model.create_entity("IfcDirection", (0.6, 0.8, 0.0))
    hang_door(model)
    model.write(str(path))
    return path


def placed(model, within, matrix):
    """A placement relative to another that is this world matrix."""
    own = np.linalg.solve(get_local_placement(within), matrix)
    point = model.create_entity("IfcCartesianPoint", own[:3, 3].tolist())
    axis, ahead = (model.create_entity("IfcDirection", own[:3, column].tolist()) for column in (2, 0))
    axes = model.create_entity("IfcAxis2Placement3D", point, axis, ahead)
    return model.create_entity("IfcLocalPlacement", within, axes)


def hang_door(model):
    """The room's door in an opening of a wall: each placed relative to the other, as exporters do."""
    wall, door = (model.by_type(kind)[0] for kind in ("IfcWall", "IfcDoor"))
    last = model.by_type("IfcWall")[-1]  # placed relative to the first, but no part of it
    last.ObjectPlacement = placed(model, wall.ObjectPlacement, get_local_placement(last.ObjectPlacement))
    at = get_local_placement(door.ObjectPlacement)
    opening = model.create_entity(
        "IfcOpeningElement", ifcopenshell.guid.new(), ObjectPlacement=placed(model, wall.ObjectPlacement, at)
    )
    door.ObjectPlacement = placed(model, opening.ObjectPlacement, at)
    model.create_entity("IfcRelVoidsElement", ifcopenshell.guid.new(), None, None, None, wall, opening)
    model.create_entity("IfcRelFillsElement", ifcopenshell.guid.new(), None, None, None, opening, door)


def detection_of(building, *elements):
    """What a detection of this building has, as far as placements need it."""
    triangles, nothing = building.triangles, np.zeros((0, 3), np.float32)
    drawing = Drawing(
        building.origin, nothing, nothing[:, 0], None, None, nothing, nothing[:, 0], None, None,
        building.elements.guid, triangles.vertices, triangles.faces, triangles.element, (),
    )  # fmt: skip
    return Detection((), elements, SCANS, {}, {}, {}, (), drawing)


def told(guid, verdict="displaced", off=None):
    off = off or deviation(0.0)._replace(offset=(0.06, -0.02, 0.01), turned=TURNED)
    return ElementVerdict(guid, "IfcWall", "w", "", verdict, 0.01, 5, (0, 90, 0, 0), None, off)


def moved(points, middle, off):
    return Rotation.from_rotvec(off.turned).apply(points - middle) + middle + off.offset


def written(prior, detection, out):
    """The new building, after what holds for every such file."""
    before = prior.read_bytes()
    notes = write_as_built(prior, detection, out)
    assert {path.name for path in out.iterdir()} == {AS_BUILT, AS_BUILT_UNDO} and prior.read_bytes() == before
    check_references((out / AS_BUILT).read_bytes())
    revert(out / AS_BUILT, out / "back.ifc")
    assert (out / "back.ifc").read_bytes() == before
    assert not errors(out / AS_BUILT)
    return read_ifc(out / AS_BUILT), notes


def hosted(path):
    """A wall with an opening that a door or window fills, and what fills it: GlobalIds."""
    model = ifcopenshell.open(str(path))
    for fills in model.by_type("IfcRelFillsElement"):
        wall = fills.RelatingOpeningElement.VoidsElements[0].RelatingBuildingElement
        return wall.GlobalId, fills.RelatedBuildingElement.GlobalId
    raise AssertionError("the room has no door")


def test_displaced_elements_stand_where_they_were_measured_with_what_is_in_them(room, tmp_path):
    building = read_ifc(room)
    before = surfaces(building)
    wall, door = hosted(room)
    one = told(wall)
    after, notes = written(room, detection_of(building, one), tmp_path / "out")
    assert notes == ()
    now, middle = surfaces(after), (before[wall].min(axis=0) + before[wall].max(axis=0)) / 2.0
    assert now.keys() == before.keys()
    for guid in before:
        expected = moved(before[guid], middle, one.deviation) if guid in (wall, door) else before[guid]
        assert apart(now[guid], expected) < 2e-4, guid
    assert apart(now[wall], before[wall]) > 0.05


@pytest.mark.parametrize("verdict", ["present", "displaced"])
def test_a_door_that_was_measured_itself_stands_where_it_was_measured(room, tmp_path, verdict):
    building = read_ifc(room)
    before = surfaces(building)
    wall, door = hosted(room)
    own = told(door, verdict, deviation(0.0)._replace(offset=(-0.05, 0.0, 0.0)))
    now = surfaces(written(room, detection_of(building, told(wall), own), tmp_path / "out")[0])
    expected = before[door] + (own.deviation.offset if verdict == "displaced" else np.zeros(3))
    assert apart(now[door], expected) < 2e-4


def share_placement(model):
    """Two walls on one placement; a third without any, as if drawn in world coordinates."""
    walls, storey = model.by_type("IfcWall"), model.by_type("IfcBuildingStorey")[0]
    storey.ObjectPlacement.RelativePlacement.Location.Coordinates = (3.0, -2.0, 1.0)  # not far from the world's origin
    walls[1].ObjectPlacement = walls[0].ObjectPlacement
    walls[2].ObjectPlacement = None


def test_who_shares_a_placement_or_has_none_is_moved_alone(room, tmp_path):
    model = ifcopenshell.open(str(room))
    share_placement(model)
    prior = tmp_path / "shared.ifc"
    model.write(str(prior))
    building = read_ifc(prior)
    before, walls = surfaces(building), [one.GlobalId for one in model.by_type("IfcWall")]
    moving = (walls[1], walls[2])
    now = surfaces(written(prior, detection_of(building, *map(told, moving)), tmp_path / "out")[0])
    for guid in walls:
        middle = (before[guid].min(axis=0) + before[guid].max(axis=0)) / 2.0
        expected = moved(before[guid], middle, told(guid).deviation) if guid in moving else before[guid]
        assert apart(now[guid], expected) < 2e-4


def test_parts_keep_their_place_relative_to_what_moves(room, tmp_path):
    """So tools that show where a door is in its wall show what they did."""
    wall, door = hosted(room)
    written(room, detection_of(read_ifc(room), told(wall)), tmp_path / "out")
    relative = []
    for path in (room, tmp_path / "out" / AS_BUILT):
        model = ifcopenshell.open(str(path))
        places = [get_local_placement(model.by_guid(guid).ObjectPlacement) for guid in (wall, door)]
        relative.append(np.linalg.solve(*places))
    np.testing.assert_allclose(*relative, atol=1e-6)


def test_without_anything_displaced_the_file_is_the_same(room, tmp_path):
    building = read_ifc(room)
    written(room, detection_of(building, told(building.elements.guid[0], "present")), tmp_path / "out")
    assert (tmp_path / "out" / AS_BUILT).read_bytes() == room.read_bytes()


def test_what_is_no_element_of_the_file_is_named_and_doubts_keep_all_where_it_is(room, tmp_path):
    building = read_ifc(room)
    _, notes = written(room, detection_of(building, told("nobody")), tmp_path / "out")
    assert len(notes) == 1 and "nobody stays" in notes[0]
    detection = detection_of(building, told(hosted(room)[0]))
    doubted = detection._replace(scans=(SCANS[0]._replace(doubts=("is it?",)),))
    assert write_as_built(room, doubted, tmp_path / "none") == (NOT_WRITTEN,) and not (tmp_path / "none").exists()


def in_feet(path, out):
    """The same numbers, which then are feet."""
    model = ifcopenshell.open(str(path))
    metre = next(one for one in model.by_type("IfcSIUnit") if one.UnitType == "LENGTHUNIT")
    size = model.create_entity("IfcMeasureWithUnit", model.create_entity("IfcLengthMeasure", 0.3048), metre)
    exponents = model.create_entity("IfcDimensionalExponents", 1, 0, 0, 0, 0, 0, 0)
    foot = model.create_entity("IfcConversionBasedUnit", exponents, "LENGTHUNIT", "FOOT", size)
    for units in model.by_type("IfcUnitAssignment"):
        units.Units = [foot if one == metre else one for one in units.Units]
    model.write(str(out))
    return out


def askew(path, out):
    """The same frame, by a reference direction that is not across the axis."""
    model = ifcopenshell.open(str(path))
    axes = model.by_type("IfcBuildingStorey")[0].ObjectPlacement.RelativePlacement
    axes.Axis, axes.RefDirection = (
        model.create_entity("IfcDirection", way) for way in ((0.0, 0.0, 1.0), (6.0, 8.0, 3.0))
    )
    model.write(str(out))
    return out


@pytest.mark.parametrize("change", [None, in_feet, askew])
def test_a_displaced_element_placed_relative_to_another_one_moves_by_its_own_offset_alone(room, tmp_path, change):
    """And what is in either of them with it; in a file of feet, too."""
    prior = change(room, tmp_path / "changed.ifc") if change else room
    building = read_ifc(prior)
    before, (wall, door) = surfaces(building), hosted(prior)
    last = ifcopenshell.open(str(prior)).by_type("IfcWall")[-1].GlobalId
    other = deviation(0.0)._replace(offset=(-0.03, 0.05, 0.0), turned=(0.0, 0.0, -0.02))
    elements = told(wall), told(last, off=other)
    now, notes = written(prior, detection_of(building, *elements), tmp_path / "out")
    assert not notes
    after = surfaces(now)
    lows, highs = {}, {}
    for guid, points in before.items():
        lows[guid], highs[guid] = points.reshape(-1, 3).min(axis=0), points.reshape(-1, 3).max(axis=0)
    for guid, (leader, off) in {
        wall: (wall, elements[0].deviation), door: (wall, elements[0].deviation), last: (last, other),
    }.items():  # fmt: skip
        middle = (lows[leader] + highs[leader]) / 2.0
        assert apart(after[guid], moved(before[guid], middle, off)) < 2e-5
    for guid in before.keys() - {wall, door, last}:
        assert apart(after[guid], before[guid]) < 2e-5
