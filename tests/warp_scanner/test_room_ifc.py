"""A generated room as IFC: valid, read back with every element, and the same to every ray."""

import errno
import os

import numpy as np
import pytest

from warp_scanner.rooms.rooms import RoomConfig, make_rooms
from warp_scanner.scenes.building import Building, fixed
from warp_scanner.scenes.scenes import (
    BOX,
    CABINET,
    CARTON,
    CEILING,
    CYLINDER,
    DOOR,
    FLOOR,
    GAP,
    OTHER,
    PERSON,
    PILLAR,
    TABLE,
    WALL,
    take,
)
from warp_scanner.sensors.poses import rotation_of
from warp_scanner.sensors.scan import Rays, cast_rays
from warp_scanner.sensors.sensors import Pinhole
from warp_scanner.sensors.triangles import cast_triangles, prepare

ifcopenshell = pytest.importorskip("ifcopenshell")

from warp_scanner.buildings.ifc_files import read_ifc  # noqa: E402
from warp_scanner.buildings.room_ifc import write_room  # noqa: E402

ROOMS = range(3)


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """Generated rooms with the files they were written to and the GlobalIds of their elements."""
    primitives, folder = make_rooms(RoomConfig(), 11, np.arange(len(ROOMS))), tmp_path_factory.mktemp("ifc")
    return primitives, [(path := folder / f"{room}.ifc", write_room(path, primitives, room)) for room in ROOMS]


@pytest.fixture(scope="module")
def buildings(written) -> list[Building]:
    return [read_ifc(path) for path, _ in written[1]]


@pytest.mark.parametrize("room", ROOMS)
def test_the_validator_finds_nothing(written, room):
    import ifcopenshell.validate

    logger = ifcopenshell.validate.json_logger()
    ifcopenshell.validate.validate(ifcopenshell.open(str(written[1][room][0])), logger)
    assert logger.statements == []


@pytest.mark.long
def test_no_rule_of_the_schema_is_broken(written):
    import ifcopenshell.validate

    logger = ifcopenshell.validate.json_logger()
    ifcopenshell.validate.validate(ifcopenshell.open(str(written[1][0][0])), logger, express_rules=True)
    assert logger.statements == []


@pytest.mark.parametrize("room", ROOMS)
def test_every_element_comes_back_with_its_id_and_class(written, buildings, room):
    primitives, guids = written[0], written[1][room][1]
    building = buildings[room]
    there = primitives.kind[room] != GAP
    assert sorted(guids) == sorted(set(primitives.element[room, there].tolist()))
    assert set(building.elements.guid) == set(guids.values()) and building.failures == () == building.notes
    semantic = dict(zip(building.elements.guid, building.elements.semantic, strict=True))
    for number, guid in guids.items():
        own = primitives.semantic[room, there & (primitives.element[room] == number)][0]
        if own in (FLOOR, CEILING, WALL, PILLAR, DOOR):
            assert semantic[guid] == own
    assert building.storeys.elevation == pytest.approx([-1.5]) and np.all(building.elements.storey == 0)


@pytest.mark.parametrize("room", ROOMS)
def test_the_file_scans_as_the_primitives(written, buildings, room):
    primitives, building = take(written[0], [room]), buildings[room]
    rng = np.random.default_rng(room)
    sensor = Pinhole(160, 100)
    views = 6
    origin = rng.uniform([-4.5, -4.5, -1.3], [4.5, 4.5, 1.3], (views, 3)).astype(np.float32)
    rays = Rays(origin, sensor.directions(), rotation_of(rng.uniform(-180, 180, views), rng.uniform(-40, 40, views)))
    truth = cast_rays(take(primitives, np.zeros(views, int)), None, rays)
    ours = cast_triangles(prepare(building.triangles), rays)
    guid = np.array(["", *building.elements.guid])[ours.element + 1]
    names = np.full(max(written[1][room][1]) + 2, "", dtype=guid.dtype)
    for number, name in written[1][room][1].items():
        names[number] = name
    flat = ~np.isin(truth.element, primitives.element[primitives.kind == CYLINDER])
    flat &= ~np.isin(guid, names[np.unique(primitives.element[primitives.kind == CYLINDER])])
    near = np.abs(ours.distance - truth.distance) <= 1e-4
    # What is left over are rays at edges, and rays that the facets of something round let pass or stop.
    assert flat.mean() > 0.5 and near[flat].mean() > 0.999
    np.testing.assert_array_equal(guid[flat & near], names[truth.element[flat & near]])
    if room == 1:  # the one with something round in view
        assert np.mean(np.abs(ours.distance - truth.distance)[~flat] < 0.02) > 0.9


def test_the_same_room_gives_the_same_bytes(written, tmp_path):
    primitives, files = written
    write_room(tmp_path / "again.ifc", primitives, 0)
    assert (tmp_path / "again.ifc").read_bytes() == files[0][0].read_bytes()
    assert set(files[0][1].values()) == set(write_room(tmp_path / "again.ifc", primitives, 0).values())
    other = write_room(tmp_path / "other.ifc", primitives, 0, name="other")
    assert not set(other.values()) & set(files[0][1].values())


def test_boxes_are_exact_in_the_file(written):
    primitives, files = written
    model = ifcopenshell.open(str(files[0][0]))
    profiles = model.by_type("IfcRectangleProfileDef")
    boxes = primitives.kind[0] == BOX
    expected = sorted((2.0 * primitives.half_size[0, boxes, 0].astype(float)).tolist())
    np.testing.assert_allclose(sorted(profile.XDim for profile in profiles), expected, rtol=1e-12)


def test_nothing_to_write_and_no_place_to_write(written, tmp_path, monkeypatch):
    primitives = written[0]
    empty = primitives._replace(kind=np.zeros_like(primitives.kind))
    with pytest.raises(ValueError, match="at least one primitive"):
        write_room(tmp_path / "a.ifc", empty, 0)

    def full(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "replace", full)
    with pytest.raises(OSError, match="No space left"):
        write_room(tmp_path / "a.ifc", primitives, 0)
    assert list(tmp_path.iterdir()) == []


def test_elements_that_share_a_global_id_are_all_there(written, tmp_path):
    model = ifcopenshell.open(str(written[1][0][0]))
    count = len(model.by_type("IfcElement"))
    first, second, third = model.by_type("IfcWall")[:3]
    own = first.GlobalId
    second.GlobalId = third.GlobalId = own
    model.write(str(tmp_path / "twice.ifc"))
    building = read_ifc(tmp_path / "twice.ifc")
    assert len(set(building.elements.guid)) == len(building.elements.guid) == count and building.failures == ()
    names = dict(zip(building.elements.guid, building.elements.name, strict=True))
    assert [names[own + end] for end in ("", "_1", "_2")] == [first.Name, second.Name, third.Name]
    assert building.notes == (f"more than one element has the GlobalId {own!r}: a suffix tells them apart",)
    # Of two with one id, one without a body: it is listed, and the other is there.
    second.Representation = None
    model.write(str(tmp_path / "twice.ifc"))
    building = read_ifc(tmp_path / "twice.ifc")
    assert len(building.elements.guid) == count - 1
    assert [(failure.guid, failure.name) for failure in building.failures] == [(f"{own}_1", second.Name)]


def test_products_that_are_no_elements_are_there_too(written, tmp_path):
    model = ifcopenshell.open(str(written[1][0][0]))
    wall = model.by_type("IfcWall")[0]
    count = len(model.by_type("IfcElement"))
    shown = {"ObjectPlacement": wall.ObjectPlacement, "Representation": wall.Representation}
    for kind in ("IfcProxy", "IfcAnnotation", "IfcGrid", "IfcSpace", "IfcStructuralSurfaceMember"):
        more = {"ProxyType": "PRODUCT"} if kind == "IfcProxy" else {}
        model.create_entity(kind, GlobalId=ifcopenshell.guid.new(), Name=f"my {kind}", **shown, **more)
    site = model.by_type("IfcSite")[0]
    site.Representation = wall.Representation
    model.write(str(tmp_path / "more.ifc"))
    building = read_ifc(tmp_path / "more.ifc")
    assert building.elements.name[count:] == ("my IfcProxy",) and building.elements.ifc_class[count:] == ("IfcProxy",)
    assert building.elements.semantic[count] == OTHER and building.failures == ()
    assert building.notes == ("the shape of IfcSite 'site' was left out: it is no element of the building",)
    assert building.elements.name.index(wall.Name) < count


@pytest.mark.parametrize("semantic, word", [(CABINET, "cabinet"), (CARTON, "carton"), (PERSON, "person")])
def test_what_can_be_moved_is_no_part_of_the_building_when_read_back(written, tmp_path, semantic, word):
    primitives = written[0]
    moved = primitives._replace(semantic=np.where(primitives.semantic == TABLE, semantic, primitives.semantic))
    guids = write_room(tmp_path / "a.ifc", moved, 0)
    building = read_ifc(tmp_path / "a.ifc")
    own = [guids[number] for number in np.unique(moved.element[0, moved.semantic[0] == semantic])]
    rows = [building.elements.guid.index(guid) for guid in own]
    assert rows and not fixed(building.triangles)[rows].any()
    assert all(building.elements.name[row].startswith(word) for row in rows)
    model = ifcopenshell.open(str(tmp_path / "a.ifc"))
    assert all(model.by_guid(guid).ObjectType == word for guid in own)
