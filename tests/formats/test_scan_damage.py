"""Scan files that lie: cut off anywhere, with counts of a billion, or swelling when unpacked; one line, no memory."""

import io
import os
import re
import struct
import tracemalloc
import zipfile

import numpy as np
import pytest

from jaxmm.formats.readers import READERS, read_scans
from jaxmm.inputs import InputError
from tests.cases.valid_files import PRIORS, SCANS
from tests.cases.valid_ifc import ifc_text
from warp_scanner.buildings.files import read_building

LIBRARIES = {"bag": "rosbags", "pcd": "pypcd4", "e57": "pye57", "las": "laspy", "laz": "lazrs"}
TEXT = ("csv-thesis", "csv-commas", "xyz", "pts", "ptx")  # may end after any line, or scan
FEW = 50 << 20  # bytes that a refusal may take


@pytest.fixture(params=SCANS)
def valid(request):
    """Name and content of a small valid file, in every format."""
    if library := LIBRARIES.get(request.param[:3]):
        pytest.importorskip(library)
    return request.param, SCANS[request.param]()


def refusal(path, data):
    """The line that refuses these bytes, which must not cost memory."""
    path.write_bytes(data)
    tracemalloc.start()
    try:
        with pytest.raises(InputError, match=re.escape(str(path))) as caught:
            read_scans(path)
        assert tracemalloc.get_traced_memory()[1] < FEW
    finally:
        tracemalloc.stop()
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_what_is_cut_off_is_refused(tmp_path, valid):
    name, file = valid
    path = tmp_path / f"a{file.ending}"
    path.write_bytes(file.data)
    count = sum(len(scan.points) for scan in read_scans(path))
    for length in range(0, len(file.data) - 1, 23):
        path.write_bytes(file.data[:length])
        try:
            found = read_scans(path)
        except InputError as error:
            assert str(path) in str(error)
        else:
            if name in TEXT:
                assert sum(len(scan.points) for scan in found) <= count
            else:  # all the points are there: only what follows them is cut off, or digits of the last
                assert sum(len(scan.points) for scan in found) == count
                assert name in ("las-1.4", "ply-text", "pcd-ascii")


def test_another_format_under_the_ending_is_refused(tmp_path, valid):
    _, file = valid
    endings = {".las": (".las", ".laz"), ".laz": (".las", ".laz")}
    text = (".csv", ".xyz", ".txt", ".asc", ".pts")
    for ending in READERS:
        if (
            ending != file.ending
            and ending not in endings.get(file.ending, ())
            and not {ending, file.ending} <= {*text}
        ):
            assert f"a{ending}" in refusal(tmp_path / f"a{ending}", file.data)


@pytest.mark.parametrize(
    "name, honest, lie",
    [
        ("ply-text", b"element vertex 40", b"element vertex 1000000000"),
        ("ply-binary", b"element vertex 40", b"element vertex 1000000000"),
        ("ply-binary", b"element vertex 40", b"element vertex 0"),
        ("ply-binary", b"element vertex 40", b"element vertex -40"),
        ("pcd-ascii", b"40", b"1000000000"),
        ("pcd-binary", b"40", b"1000000000"),
        ("pcd-compressed", b"40", b"1000000000"),
        ("pcd-compressed", b"40", b"0"),
        ("pcd-binary", b"COUNT 1", b"COUNT 1000000000"),
        ("pcd-binary", b"HEIGHT 1", b"HEIGHT 2"),
        ("e57", b'recordCount="40"', b'recordCount="1000000000"'),
        ("e57", b'recordCount="40"', b'recordCount="41"'),
        ("e57", b"?>", b"?><!DOCTYPE e57Root [<!ELEMENT e57Root ANY>]>"),
        ("las", struct.pack("<I", 40), struct.pack("<I", 10**9)),
        ("laz", struct.pack("<I", 40), struct.pack("<I", 10**9)),
        ("laz-1.4", struct.pack("<Q", 40), struct.pack("<Q", 10**9)),
        ("npy", b"(40, 3)", b"(1000000000, 3)"),
        ("npz-points", b"(40, 3)", b"(1000000000, 3)"),
    ],
)
def test_counts_that_lie_are_refused(tmp_path, name, honest, lie):
    if library := LIBRARIES.get(name[:3]):
        pytest.importorskip(library)
    file = SCANS[name]()
    content = file.unwrap(file.data) if file.unwrap else file.data
    assert honest in content
    if name.startswith("pcd") and honest == b"40":
        content = content.replace(b"WIDTH 40", b"WIDTH " + lie).replace(b"POINTS 40", b"POINTS " + lie)
    elif name == "e57":
        start, length = struct.unpack("<QQ", content[24:40])
        first = start // 1024 * 1020 + start % 1024
        xml = content[first : first + length].replace(honest, lie, 1)
        content = content[:32] + struct.pack("<Q", len(xml)) + content[40:first] + xml
    else:
        content = content.replace(honest, lie, 1)
    refusal(tmp_path / f"a{file.ending}", file.wrap(file.data, content) if file.wrap else content)


def test_archives_that_swell_are_refused(tmp_path):
    made = io.BytesIO()
    with zipfile.ZipFile(made, "w", zipfile.ZIP_DEFLATED) as archive, archive.open("points.npy", "w") as file:
        np.lib.format.write_array_header_1_0(file, {"descr": "<f8", "fortran_order": False, "shape": (2_000_000, 3)})
        for _ in range(48):
            file.write(bytes(1_000_000))
    assert "swells to 0.048 GB" in refusal(tmp_path / "a.npz", made.getvalue())


@pytest.mark.parametrize("kind", [0, 6])
def test_points_that_pack_too_well_are_refused(tmp_path, kind):
    laspy = pytest.importorskip("laspy")
    pytest.importorskip("lazrs")
    cloud = laspy.create(point_format=kind)
    cloud.x = cloud.y = cloud.z = np.zeros(1_000_000)
    cloud.write(tmp_path / "a.laz")
    assert "swells to" in refusal(tmp_path / "b.laz", (tmp_path / "a.laz").read_bytes())


@pytest.mark.parametrize("name", ["ply-binary", "pcd-binary", "las", "csv-thesis", "npy", "npz-points"])
@pytest.mark.parametrize("value", [np.nan, np.inf, 7.0, 1e300])
def test_points_in_no_place_or_one_are_refused(tmp_path, name, value):
    path, points = tmp_path / f"a{SCANS[name]().ending}", np.full((40, 3), value)
    if name == "las":
        laspy = pytest.importorskip("laspy")
        cloud = laspy.create(point_format=0)
        cloud.x = cloud.y = cloud.z = np.zeros(40)
        cloud.header.offsets = [value] * 3
        cloud.write(path)
    elif name == "csv-thesis":
        path.write_text("X;Y;Z;categoryID\n" + "".join(f"{x};{y};{z};1\n" for x, y, z in points))
    elif name.startswith("np"):
        np.save(path, points) if name == "npy" else np.savez(path, points=points)
    else:
        file = SCANS[name]()
        path.write_bytes(file.data[: len(file.data) - 40 * 24] + points.tobytes())
    line = refusal(path, path.read_bytes())
    assert any(word in line for word in ("finite", "the same one")), line


def test_bytes_that_no_text_holds_are_refused(tmp_path):
    text = "X;Y;Z;Bauteil\n1;2;3;Säule\n4;5;6;\x81\n".encode("latin-1")
    assert "UTF-8" in refusal(tmp_path / "a.csv", text)


def test_names_that_are_not_utf_8_are_read_or_refused_in_one_line(tmp_path, valid):
    name, file = valid
    path = tmp_path / os.fsdecode(b"b\xfcro" + file.ending.encode())
    path.write_bytes(file.data)
    if file.ending == ".e57" or name.startswith("bag"):
        assert "rename it" in refusal(path, file.data)
    else:
        assert len(read_scans(path)[0].points) == 40


@pytest.mark.parametrize("name", PRIORS)
def test_names_of_priors_that_are_not_utf_8_are_read_or_refused_in_one_line(tmp_path, name):
    if name.startswith("ifc"):
        pytest.importorskip("ifcopenshell")
    file = PRIORS[name]()
    path = tmp_path / os.fsdecode(b"b\xfcro" + file.ending.encode())
    path.write_bytes(file.data)
    try:
        assert read_building(path).elements.guid
    except ValueError as error:
        assert str(path) in str(error) and "rename it" in str(error) and "\n" not in str(error)


def test_chunks_of_laz_without_a_byte_are_refused_before_lazrs_sees_them(tmp_path):
    """It would read what follows as the lengths of layers, and end the process for want of memory."""
    lazrs, laspy = pytest.importorskip("lazrs"), pytest.importorskip("laspy")
    valid, path = SCANS["laz-1.4"](), tmp_path / "a.laz"
    path.write_bytes(valid.data)
    with laspy.open(path) as file:
        start = file.header.offset_to_point_data
        layout = lazrs.LazVlr(file.header.vlrs.get("LasZipVlr")[0].record_data)
    (table,) = struct.unpack("<q", valid.data[start : start + 8])
    with open(path, "r+b") as file:
        file.seek(table)
        lazrs.write_chunk_table(file, [(0, 0), (40, table - start - 8)], layout)
    assert "got an empty one after 0" in refusal(path, path.read_bytes())


def test_a_number_that_stands_for_several_entities_is_told(tmp_path):
    pytest.importorskip("ifcopenshell")
    hole = ifc_text("IFC2X3").decode().partition("#35=")[0].splitlines(keepends=True)[-1]
    path = tmp_path / "twice.ifc"
    path.write_text(ifc_text("IFC2X3").decode().replace(hole, 13 * hole))
    with pytest.raises(ValueError, match=r"twice\.ifc: not a readable IFC file: the number #34 stands for several"):
        read_building(path)
