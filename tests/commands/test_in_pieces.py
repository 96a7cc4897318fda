"""`jaxmm detect` where one file has in pieces what another has in one: each is judged, and all together."""

import itertools
import json
import shutil
import zipfile
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import jaxmm
from jaxmm import detect
from jaxmm.commands.detect_files import Reading, write_all
from jaxmm.commands.scanning import scan
from jaxmm.formats.poses import parse_pose
from jaxmm.formats.writers import write_scan
from jaxmm.ifc.undo import revert
from tests.cases.box_building import shell_of, table_of
from tests.commands.test_project import BELIEVED, POSE, SENSOR, SHELL, WALL_GONE, detected
from warp_scanner.buildings.ifc_files import read_ifc
from warp_scanner.buildings.room_ifc import write_room
from warp_scanner.scenes.scenes import OTHER, PILLAR

jsonschema = pytest.importorskip("jsonschema")


def thirds(ends=(0.0, 1.0 / 3.0, 2.0 / 3.0, 1.0)):
    """The wall in pieces, end to end."""
    (x, y, z), (long, thick, high), kind = WALL_GONE
    return [
        ((x + long * (a + b - 1.0), y, z), (long * (b - a), thick, high), kind) for a, b in itertools.pairwise(ends)
    ]


@pytest.fixture
def seen(tmp_path):
    """Of an architect's wall and its pieces by the mason: what is told where some boxes stand."""
    write_room(tmp_path / "architect.ifc", table_of((*SHELL, WALL_GONE)), 0)

    def told_where(standing, pieces=None, more=(), turn=0.0, **given):
        write_room(tmp_path / "mason.ifc", table_of(pieces or thirds()), 0)
        built = table_of((*SHELL, *standing))
        built.yaw[0, len(SHELL) :] = turn
        write_room(tmp_path / "built.ifc", built, 0)
        write_scan(tmp_path / "scan.ply", scan(tmp_path / "built.ifc", POSE, SENSOR))
        also = [tmp_path / "mason.ifc", *more]
        found = detected(tmp_path / "architect.ifc", tmp_path / "scan.ply", also)
        shutil.rmtree(tmp_path / "out", ignore_errors=True)
        write_all(found, tmp_path / "architect.ifc", tmp_path / "out", also=also, **given)
        walls = [one for one in found.elements if one.file == "architect.ifc" and one.parts]
        return found, walls, [one for one in found.elements if one.file == "mason.ifc"]

    return told_where


def marked(folder):
    """Elements of each file that have our mark of what is gone; Status has one among its values."""
    count = {path.name: path.read_text().count("'DEMOLISH'") - 1 for path in (folder / "updated").glob("*.ifc")}
    return {name: marks for name, marks in count.items() if marks > 0}


def test_of_a_wall_whose_pieces_all_stand_nothing_is_told(seen):
    found, (wall,), pieces = seen([WALL_GONE])
    assert not found.mismatches and {one.verdict for one in (wall, *pieces)} == {"present"}
    assert set(wall.parts) == {one.key for one in pieces} and not wall.parts_gone
    assert all(one.part_of == (wall.key,) for one in pieces)


def test_one_piece_that_is_gone_is_told_by_itself_and_the_whole_names_it(seen, tmp_path):
    first, middle, last = thirds()
    found, (wall,), pieces = seen([first, last])
    (gone,) = [one for one in pieces if one.verdict == "removed"]
    assert [one.verdict for one in pieces].count("present") == 2 and wall.verdict == "present"
    assert wall.parts_gone == (gone.key,)
    (one,) = found.mismatches
    assert one.key == gone.key
    np.testing.assert_allclose(one.center, middle[0], atol=1e-5)
    np.testing.assert_allclose(one.dimensions, np.multiply(middle[1], 2.0), atol=1e-5)
    assert any("a part of it is gone" in note and gone.guid in note and wall.guid in note for note in found.notes)
    assert marked(tmp_path / "out") == {"mason.ifc": 1}
    revert(tmp_path / "out/updated/mason.ifc", tmp_path / "back.ifc")
    assert (tmp_path / "back.ifc").read_bytes() == (tmp_path / "mason.ifc").read_bytes()
    report = json.loads((tmp_path / "out/report.json").read_text())
    jsonschema.validate(report, json.loads(Path(jaxmm.__file__).with_name("report_schema.json").read_text()))
    (told_of,) = [each for each in report["elements"] if each["parts_gone"]]
    assert told_of["parts_gone"] == [{"file": gone.file, "guid": gone.guid}]
    with zipfile.ZipFile(tmp_path / "out/mismatches.bcf") as archive:
        texts = [archive.read(name).decode() for name in archive.namelist() if name.endswith("markup.bcf")]
    (topic,) = [text for text in texts if gone.guid in text and "Overview" not in text]
    assert f"A part of {wall.guid} of architect.ifc." in topic


def test_a_wall_all_of_whose_pieces_are_gone_is_one_mismatch_and_marked_in_each_file(seen, tmp_path):
    found, (wall,), pieces = seen([])
    assert {one.verdict for one in (wall, *pieces)} == {"removed"} and set(wall.parts_gone) == {
        one.key for one in pieces
    }
    (one,) = found.mismatches
    assert one.key == wall.key
    np.testing.assert_allclose(one.center, WALL_GONE[0], atol=1e-5)
    np.testing.assert_allclose(one.dimensions, np.multiply(WALL_GONE[1], 2.0), atol=1e-5)
    assert marked(tmp_path / "out") == {"mason.ifc": 3, "architect.ifc": 1}
    with zipfile.ZipFile(tmp_path / "out/mismatches.bcf") as archive:
        texts = [archive.read(name).decode() for name in archive.namelist() if name.endswith("markup.bcf")]
    (topic,) = [text for text in texts if "Overview" not in text]
    assert "architect.ifc</Filename>" in topic and "mason.ifc</Filename>" in topic
    write_all(found, tmp_path / "architect.ifc", tmp_path / "applied", also=[tmp_path / "mason.ifc"], apply=True)
    assert "IFCWALL" not in (tmp_path / "applied/updated/mason.ifc").read_text()


def test_a_piece_that_stands_off_its_place_is_displaced_and_the_whole_stands(seen):
    first, ((x, y, z), half, kind), last = thirds()
    found, (wall,), pieces = seen([first, ((x, y - 0.06, z), half, kind), last])
    assert not found.mismatches and wall.verdict == "present" and not wall.parts_gone
    assert [one.verdict for one in pieces].count("displaced") == 1


def test_a_wall_all_of_whose_pieces_stand_off_their_places_is_displaced(seen):
    (x, y, z), half, kind = WALL_GONE
    found, (wall,), pieces = seen([((x, y - 0.06, z), half, kind)])
    assert not found.mismatches and {one.verdict for one in (wall, *pieces)} == {"displaced"}
    np.testing.assert_allclose(wall.deviation.offset, (0.0, -0.06, 0.0), atol=0.01)


@pytest.mark.long
def test_a_wall_in_pieces_that_was_turned_is_told_and_written_as_one(seen, tmp_path):
    """By two degrees about its middle: of pieces each by itself the outer ones are shifted, too."""
    turn = np.radians(2.0)
    found, (wall,), pieces = seen([WALL_GONE], turn=turn, as_built=True)
    assert not found.mismatches and wall.verdict == "displaced" and len(pieces) == 3
    assert wall.deviation.turn == pytest.approx(2.0, abs=0.1)
    np.testing.assert_allclose(wall.deviation.offset, 0.0, atol=3e-3)
    (folder,) = {path.parent for path in (tmp_path / "out").rglob("architect.ifc")} - {tmp_path / "out/updated"}
    stands = read_ifc(folder / "architect.ifc")
    row = stands.elements.guid.index(wall.guid)
    corners = stands.triangles.vertices[stands.triangles.faces[stands.triangles.element == row]].reshape(-1, 3)
    back = (corners + stands.origin - WALL_GONE[0]) @ Rotation.from_rotvec((0.0, 0.0, turn)).as_matrix()
    np.testing.assert_allclose(np.abs(back), np.broadcast_to(WALL_GONE[1], back.shape), atol=8e-3)


@pytest.mark.long
def test_a_wall_in_pieces_keeps_its_deviation_though_nobody_asks_for_the_pieces(seen):
    (x, y, z), half, kind = WALL_GONE
    found, (wall,), _ = seen([WALL_GONE])
    np.testing.assert_allclose(wall.deviation.offset, 0.0, atol=2e-3)
    pieces = [(center, size, OTHER) for center, size, _ in thirds()]
    found, (wall,), pieces = seen([((x, y - 0.06, z), half, kind)], pieces)
    assert not pieces and not found.mismatches and wall.verdict == "displaced"
    np.testing.assert_allclose(wall.deviation.offset, (0.0, -0.06, 0.0), atol=0.01)


@pytest.mark.long
@pytest.mark.parametrize("stands", [True, False])
def test_a_far_column_in_many_pieces_is_told_as_one_in_one(tmp_path, stands):
    shell, column = shell_of(30.0, 5.0, 3.0), ((14.0, 1.0, 1.5), (0.2, 0.2, 1.5), PILLAR)
    pieces = [((14.0, 1.0, z + 0.125), (0.2, 0.2, 0.125), PILLAR) for z in np.arange(0.0, 3.0, 0.25)]
    write_room(tmp_path / "architect.ifc", table_of((*shell, column)), 0)
    write_room(tmp_path / "mason.ifc", table_of(pieces), 0)
    write_room(tmp_path / "built.ifc", table_of((*shell, column) if stands else shell), 0)
    pose = parse_pose("-8,-1,1.5,0")
    write_scan(tmp_path / "scan.ply", scan(tmp_path / "built.ifc", pose, SENSOR))
    found = detect(
        tmp_path / "architect.ifc", tmp_path / "scan.ply", [pose], also=[tmp_path / "mason.ifc"],
        reading=Reading(sensor=SENSOR), settings=BELIEVED,
    )  # fmt: skip
    (whole,) = [one for one in found.elements if one.parts]
    assert whole.verdict == ("present" if stands else "removed")
    assert [one.key for one in found.mismatches] == ([] if stands else [whole.key])
    told = {one.verdict for one in found.elements if one.part_of and sum(one.rays[:2])}
    assert told == {whole.verdict} and max(sum(one.rays[:2]) for one in found.elements if one.part_of) < 10


def test_a_wall_that_three_trades_have_cut_in_three_ways_is_one_mismatch_and_marked_in_all(seen, tmp_path):
    write_room(tmp_path / "third.ifc", table_of(thirds((0.0, 0.5, 1.0))), 0)
    found, (wall,), _ = seen([], more=[tmp_path / "third.ifc"])
    (one,) = found.mismatches
    assert one.key == wall.key
    np.testing.assert_allclose(one.dimensions, np.multiply(WALL_GONE[1], 2.0), atol=1e-5)
    assert marked(tmp_path / "out") == {"mason.ifc": 3, "architect.ifc": 1, "third.ifc": 2}
    with zipfile.ZipFile(tmp_path / "out/mismatches.bcf") as archive:
        texts = [archive.read(name).decode() for name in archive.namelist() if name.endswith("markup.bcf")]
    assert len([text for text in texts if "Overview" not in text]) == 1


@pytest.mark.long
def test_what_two_trades_cut_at_other_places_is_told_by_the_smaller_parts(seen, tmp_path):
    """Two walls of one, three of the other in their row: none is whole in the other's."""
    halves = thirds((0.0, 0.5, 1.0))
    write_room(tmp_path / "architect.ifc", table_of((*SHELL, *halves)), 0)
    found, walls, pieces = seen(halves)
    assert not found.mismatches and {one.verdict for one in (*walls, *pieces)} == {"present"}
    left, right = sorted(walls, key=lambda one: one.box.center[0])
    first, middle, last = (one.key for one in sorted(pieces, key=lambda one: one.box.center[0]))
    assert (left.parts, right.parts) == ((first, middle), (middle, last))
    found, walls, pieces = seen([])
    assert {one.verdict for one in (*walls, *pieces)} == {"removed"}
    assert sorted(one.file for one in found.mismatches) == ["architect.ifc"] * 2
    found, walls, pieces = seen(thirds()[1:])
    assert [one.key for one in found.mismatches] == [first]
    left, right = sorted(walls, key=lambda one: one.box.center[0])
    assert (left.verdict, left.parts_gone, right.verdict, right.parts_gone) == ("present", (first,), "present", ())
