"""Elements whose GlobalId is missing or malformed are read, told of and marked like all others."""

import numpy as np
import pytest

ifcopenshell = pytest.importorskip("ifcopenshell")

from ifcopenshell.util import element as elements_of  # noqa: E402

from jaxmm.ifc.marks import OWN_SET  # noqa: E402
from tests.cases.ifc_updates import ADDED_WALL, found, removed, update  # noqa: E402
from warp_scanner.buildings.ifc_files import parse_ifc  # noqa: E402
from warp_scanner.buildings.room_ifc import write_room  # noqa: E402
from warp_scanner.rooms.rooms import RoomConfig, make_rooms  # noqa: E402
from warp_scanner.scenes.building import AS_IT_IS  # noqa: E402

UUID = "4c8494a3-c12c-40c3-96bc-da7eb87a2ee9"
OWN = (
    UUID,
    f"{UUID}-007e3442",
    "",
    None,
    "zzzzzzzzzzzzzzzzzzzzzz",  # of 22 characters, and of more than 128 bits
    "wall ä <1> 'north'",
)


@pytest.mark.parametrize("apply", [False, True])
@pytest.mark.parametrize("own", OWN)
def test_an_element_with_such_a_global_id_is_told_of_and_edited(tmp_path, own, apply):
    path = tmp_path / "room.ifc"
    write_room(path, make_rooms(RoomConfig(), 11, np.arange(1)), 0)
    model = ifcopenshell.open(str(path))
    walls = model.by_type("IfcWall")[:2]
    walls[0].GlobalId = own
    walls[1].GlobalId = None  # missing twice: each has a name of its own
    model.by_type("IfcBuildingStorey")[0].GlobalId = None
    model.write(str(path))
    building = parse_ifc(path, AS_IT_IS)
    guids = [own or f"#{walls[0].id()}", f"#{walls[1].id()}"]
    assert set(guids) < set(building.elements.guid) and len(set(building.elements.guid)) == len(building.elements.guid)
    assert all(any(guid in note for note in building.notes) for guid in guids)
    detection = found(*(removed(guid) for guid in guids), ADDED_WALL)
    summary, after = update(path, detection, tmp_path / "out", apply=apply)
    assert summary.removed == tuple(guids) and len(summary.added) == 1 and summary.notes == ()
    left = {one.id(): one for one in after.by_type("IfcWall")}
    for wall in walls:
        assert (wall.id() in left) != apply
        if not apply:
            assert left[wall.id()].GlobalId == wall.GlobalId
            assert elements_of.get_psets(left[wall.id()])[OWN_SET]["Verdict"] == "removed"
