"""IFC files that are valid and hard to read: every body in its place and no other solid, and what is not read is said."""

import numpy as np
import pytest

from warp_scanner.rooms.rooms import RoomConfig, make_rooms
from warp_scanner.scenes.building import Building, element_bounds

ifcopenshell = pytest.importorskip("ifcopenshell")

from warp_scanner.buildings.ifc_files import read_ifc  # noqa: E402
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
    return read_ifc(folder / "changed.ifc")


@pytest.mark.parametrize("long", [5_000, 200_000])
def test_a_header_and_what_follows_the_end_may_be_long(room, tmp_path, long):
    text = room.read_text()
    options = ",".join(f"'Option {number:020d}'" for number in range(long // 30))
    text = text.replace("FILE_DESCRIPTION((", f"FILE_DESCRIPTION(({options},", 1) + "\n" * long
    (tmp_path / "long.ifc").write_text(text)
    assert text.index("FILE_SCHEMA") > long
    assert read_ifc(tmp_path / "long.ifc").elements.guid == read_ifc(room).elements.guid
