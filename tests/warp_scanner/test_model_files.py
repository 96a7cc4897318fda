"""Which files a model is in, and IFC files that are packed: what is read, and what is refused in one line."""

import zipfile

import numpy as np
import pytest

from tests.cases.box_building import shell_of, table_of
from warp_scanner.buildings import ifc_zips
from warp_scanner.buildings.files import read_building
from warp_scanner.buildings.ifc_zips import ifc_text
from warp_scanner.buildings.model_files import model_of
from warp_scanner.buildings.projects import read_model
from warp_scanner.buildings.room_ifc import write_room

CLOUD = b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\n0\n"


def put(path, data=b""):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)
    return path


def packed(path, members, **how):
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, **how) as archive:
        for name, data in members.items():
            archive.writestr(name, data)
    return path


@pytest.fixture(scope="module")
def room(tmp_path_factory):
    path = tmp_path_factory.mktemp("room") / "room.ifc"
    write_room(path, table_of(shell_of(3.0, 2.0, 2.6)), 0)
    return path


def test_a_folder_is_its_models_and_those_below(tmp_path):
    for name in (
        "b.ifc",
        "a.IFCZIP",
        "sub/b.ifc",
        "sub/mesh.obj",
        ".hidden.ifc",
        ".git/c.ifc",
        "notes.txt",
        "mesh.mtl",
    ):
        put(tmp_path / name)
    put(tmp_path / "scan.ply", CLOUD)
    put(tmp_path / "found/report.json")
    put(tmp_path / "found/updated.ifc")
    other = put(tmp_path.parent / f"{tmp_path.name}-other" / "b.ifc")
    model = model_of(tmp_path, [other, tmp_path / "b.ifc"])
    names = ["a.IFCZIP", "b.ifc", f"{other.parent.name}/b.ifc", "sub/b.ifc", "sub/mesh.obj"]
    assert [one.name for one in model.files] == sorted(names)
    assert model.first is None and model.has_ifc and model.name == tmp_path.name


def test_files_named_one_by_one_go_by_what_tells_them_apart(tmp_path):
    first, other, third = (put(tmp_path / name) for name in ("architect/a.ifc", "mason/a.ifc", "mason/b.ifc"))
    model = model_of(first, [other, third, first])
    assert [one.name for one in model.files] == ["architect/a.ifc", "b.ifc", "mason/a.ifc"]
    assert model.first == "architect/a.ifc"


@pytest.mark.parametrize(
    ("prior", "also", "words"),
    [
        ("empty", [], "expected a folder with models"),
        ("a.ifc", ["missing.ifc"], "--also: expected an IFC or mesh file, found nothing there"),
        ("a.ifc", ["empty"], "--also: expected an IFC or mesh file, found a folder"),
        ("a.ifc", ["a.e57"], "--also: expected a model ending in .ifc, .ifczip"),
        ("a.ifc", ["scan.ply"], "--also: expected a model ending in"),
        ("a.e57", ["a.ifc"], "beside --also: expected a model ending in"),
    ],
)  # fmt: skip
def test_what_is_no_model_is_refused(tmp_path, prior, also, words):
    (tmp_path / "empty").mkdir()
    put(tmp_path / "a.ifc"), put(tmp_path / "a.e57"), put(tmp_path / "scan.ply", CLOUD)
    with pytest.raises(ValueError) as error:
        model_of(tmp_path / prior, [tmp_path / one for one in also])
    assert words in str(error.value) and "\n" not in str(error.value)


@pytest.mark.parametrize("name", ["room.ifczip", "room.ifcZIP"])
@pytest.mark.parametrize("member", ["Model.IFC", "sub/002.ifc"])
def test_a_packed_file_is_read_as_the_plain_one(room, tmp_path, name, member):
    path = packed(tmp_path / name, {member: room.read_bytes(), "readme.txt": b"x", "__MACOSX/._002.ifc": b"x"})
    plain, found = read_building(room), read_building(path)
    np.testing.assert_array_equal(found.triangles.vertices, plain.triangles.vertices)
    assert found.elements.guid == plain.elements.guid and set(found.elements.file) == {name}
    assert ifc_text(path) == room.read_bytes()


@pytest.mark.parametrize(
    ("members", "words"),
    [
        ({"a.ifc": b"x", "b.IFC": b"y"}, "expected one file ending in .ifc in the archive, found 2: 'a.ifc', 'b.IFC'"),
        ({"a.txt": b"x"}, "expected one file ending in .ifc in the archive, found none"),
        ({"a.ifc": b"no step text"}, "expected an IFC file"),
        ({"a.ifc": b"0" * (ifc_zips.SMALL + 1)}, "packed to no less than 1/100"),
    ],
)  # fmt: skip
def test_an_archive_without_one_model_is_refused(tmp_path, members, words):
    path = packed(tmp_path / "a.ifczip", members)
    with pytest.raises(ValueError) as error:
        read_building(path)
    assert words in str(error.value) and str(error.value).startswith(str(path)) and "\n" not in str(error.value)


def test_damaged_archives_are_refused_in_a_line(room, tmp_path):
    whole = packed(tmp_path / "a.ifczip", {"a.ifc": room.read_bytes()}).read_bytes()
    rng, path = np.random.default_rng(0), tmp_path / "b.ifczip"
    for number in range(60):
        data = bytearray(whole)
        if number % 2:
            data = data[: rng.integers(0, len(data))]
        else:
            data[rng.integers(0, len(data))] ^= int(rng.integers(1, 256))
        path.write_bytes(bytes(data))
        try:
            text = ifc_text(path)
        except ValueError as error:
            assert str(error).startswith(str(path)) and "\n" not in str(error)
        else:
            assert text == room.read_bytes()  # what was hit is told by nobody: a date, a name


def test_errors_of_one_file_name_it(room, tmp_path):
    put(tmp_path / "a.ifc", room.read_bytes())
    put(tmp_path / "b.ifc", room.read_bytes()[:-200])
    with pytest.raises(ValueError, match=r"b\.ifc: the file is cut off"):
        read_model(model_of(tmp_path))
    (tmp_path / "b.ifc").unlink()
    assert read_model(model_of(tmp_path)).sources == ()  # one file is that file
