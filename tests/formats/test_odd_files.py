"""Scan files as some programs write them, against the letter or habit of their formats: every point in its place."""

import re
import struct

import numpy as np
import pytest

from jaxmm.formats import e57, ply, ply_header
from jaxmm.formats.readers import read_scans
from jaxmm.inputs import InputError
from jaxmm.stations.sources import scan_of, sources_of
from tests.cases.e57_files import write_e57

RNG = np.random.default_rng(17)
POINTS = np.round(RNG.uniform([-5, -4, 0], [5, 4, 3], (50, 3)), 3)


def read(path, data):
    """The only scan of a file of these bytes."""
    path.write_bytes(data.encode() if isinstance(data, str) else data)
    (found,) = read_scans(path)
    return found


PCD = "# .PCD v0.7\n{}DATA {}\n"


@pytest.mark.parametrize(
    "head, fields",
    [
        ("VERSION .7\nFIELDS x y z\nSIZE 8 8 8\nTYPE F F F\nWIDTH 50\nHEIGHT 1\nPOINTS 50\n", "xyz"),
        ("VERSION .5\nFIELDS x y z\nSIZE 8 8 8\nTYPE F F F\nCOUNT 1 1 1\nPOINTS 50\n", "xyz"),
        ("VERSION .6\nCOLUMNS X Y Z\nSIZE 8 8 8\nTYPE F F F\nWIDTH 25\nHEIGHT 2\n", "xyz"),
        ("FIELDS x y X Y Z\nSIZE 4 4 8 8 8\nTYPE F F F F F\nWIDTH 50\n", "abxyz"),
        (
            "FIELDS z ring x _ y t\nSIZE 8 1 8 1 8 4\nTYPE F U F U F U\nCOUNT 1 0 1 3 1 1\nWIDTH 50\nPOINTS 50\n",
            "z_x3yt",
        ),
    ],
    ids=["no COUNT, no VIEWPOINT", "version .5", "COLUMNS in capitals", "pixels beside", "COUNT 0"],
)
@pytest.mark.parametrize("kind", ["ascii", "binary"])
def test_pcd_headers_of_others(tmp_path, head, fields, kind):
    parts = {"x": "<f8", "y": "<f8", "z": "<f8", "a": "<f4", "b": "<f4", "3": ("u1", 3), "t": "<u4", "_": None}
    kinds = [
        (name, *([parts[name]] if isinstance(parts[name], str) else parts[name])) for name in fields if parts[name]
    ]
    table = np.ones(50, kinds)
    for number, axis in enumerate("xyz"):
        table[axis] = POINTS[:, number]
    body = table.tobytes()
    if kind == "ascii":
        numbers = (np.concatenate([np.ravel(row[name]) for name in table.dtype.names]) for row in table)
        body = "".join(" ".join(f"{value:g}" for value in row) + "\n" for row in numbers).encode()
    found = read(tmp_path / "a.pcd", PCD.format(head, kind).encode() + body)
    np.testing.assert_array_equal(found.points, POINTS)
    assert found.position is None


def test_pcd_without_sizes_holds_floats(tmp_path):
    body = POINTS.astype("<f4").tobytes()
    found = read(tmp_path / "a.pcd", PCD.format("FIELDS x y z\nWIDTH 50\n", "binary").encode() + body)
    np.testing.assert_array_equal(found.points, POINTS.astype(np.float32))


@pytest.mark.parametrize(
    "head, why",
    [
        ("FIELDS x y z\nSIZE 4 4\nWIDTH 50\n", "FIELDS, SIZE, TYPE and COUNT of the same length, got 3, 2, 3, 3"),
        ("FIELDS x y z\nCOUNT 1 1 0\nWIDTH 50\n", "fields x, y and z once each, got x, y, z"),
        ("FIELDS x y z x\nWIDTH 50\n", "fields x, y and z once each, got x, y, z, x"),
        ("FIELDS x y z\nSIZE 4 4 a\nWIDTH 50\n", "line 3: expected SIZE in whole numbers, got '4 4 a'"),
        ("FIELDS x y z\nSIZE 4 4 2\nWIDTH 50\n", "expected z of (4, 8) bytes, got TYPE F SIZE 2"),
        ("FIELDS x y z\nTYPE F F Q\nWIDTH 50\n", "expected z of TYPE F, I or U, and 4 or 8 bytes, got TYPE Q SIZE 4"),
        ("FIELDS x y z\n", "WIDTH and HEIGHT, or POINTS, found neither"),
        ("FIELDS x y z\nWIDTH 50\nVIEWPOINT 0 0\n", "line 4: expected VIEWPOINT and 7 numbers, got '0 0'"),
        ("FIELDS x y z\nWIDTH 50\nHEIGHT 2\nPOINTS 50\n", "as many POINTS as WIDTH x HEIGHT, 50 x 2, got 50"),
    ],
)
def test_pcd_headers_that_contradict_themselves_are_refused(tmp_path, head, why):
    with pytest.raises(InputError, match=re.escape(why)):
        read(tmp_path / "a.pcd", PCD.format(head, "binary").encode() + bytes(600))


FACES = "element face 2\nproperty list uchar int vertex_indices\n"


def vertices(order, names, lists):
    """Header, and vertices as text or bytes; `lists` names the properties that are lists, of 0 to 3 numbers."""
    head = f"element vertex {len(POINTS)}\n"
    head += "".join(f"property {'list uint ushort' if name in lists else 'double'} {name}\n" for name in names)
    rows = b""
    for number, point in enumerate(POINTS):
        for name in names:
            value = float(point["xyz".index(name.lower())]) if name.lower() in "xyz" else number
            values = list(range(number % 4)) if name in lists else [value]
            if order == "":
                rows += (" ".join(map(str, ([len(values)] if name in lists else []) + values)) + " ").encode()
            elif name in lists:
                rows += struct.pack(f"{order}I{len(values)}H", len(values), *values)
            else:
                rows += struct.pack(f"{order}d", value)
        rows += b"\n" if order == "" else b""
    return head, rows


FORMATS = {"": "ascii", "<": "binary_little_endian", ">": "binary_big_endian"}


@pytest.mark.parametrize("order", FORMATS)
@pytest.mark.parametrize("before", ["", "element camera 1\nproperty float focal\n", FACES])
@pytest.mark.parametrize(
    "names, lists",
    [("xyz", ""), ("XYZ", ""), ("xyzv", "v"), ("vxwyZ", "vw"), ("vxyz", "v"), ("xyXYZ", ""), ("zzxy", "")],
)
def test_ply_with_lists_among_its_vertices_and_elements_before_them(tmp_path, monkeypatch, order, before, names, lists):
    for module in (ply, ply_header):
        monkeypatch.setattr(module, "BLOCK", 7)
    first = {"": b"", "e": b"7.5\n" if order == "" else struct.pack(f"{order}f", 7.5)}
    faces = b"3 0 1 2\n4 0 1 2 3\n" if order == "" else struct.pack(f"{order}B3iB4i", 3, 0, 1, 2, 4, 0, 1, 2, 3)
    head, rows = vertices(order, names, lists)
    body = (faces if before == FACES else first[before[:1]]) + rows
    path = tmp_path / "a.ply"
    data = f"ply\nformat {FORMATS[order]} 1.0\n{before}{head}end_header\n".encode() + body
    if names == "zzxy":  # which z is meant nobody knows
        with pytest.raises(InputError, match="x, y and z once each, found z, z, x, y"):
            read(path, data)
        return
    np.testing.assert_array_equal(read(path, data).points, POINTS)
    for cut in (1, 9):
        with pytest.raises(InputError, match=r"a\.ply: "):
            read(path, data[:-cut] if order else data[: data.rindex(b"\n", 0, -cut - 1)])


def test_lists_that_lie_are_told_by_their_row(tmp_path):
    head, rows = vertices("<", "xyzv", "v")
    rows = rows[:-6] + struct.pack("<I", 4_000_000_000) + rows[-2:]  # of the last, which has one number
    with pytest.raises(InputError, match=r"vertex 49: expected lists that fit into \d+ bytes, got one of length 4"):
        read(tmp_path / "a.ply", f"ply\nformat binary_little_endian 1.0\n{head}end_header\n".encode() + rows)


@pytest.mark.parametrize("names", ["xyz", "XYZ"])
@pytest.mark.parametrize("kind", ["<f4", "<i4"])
def test_structured_arrays(tmp_path, names, kind):
    table = np.zeros((5, 10), [("intensity", "u2"), *((name, kind) for name in names[::-1])])
    for number, name in enumerate(names):
        table[name] = (POINTS[:, number] * 1000).reshape(5, 10)
    np.save(tmp_path / "a.npy", table)
    np.savez(tmp_path / "a.npz", points=table)
    for name in ("a.npy", "a.npz"):
        (found,) = read_scans(tmp_path / name)
        np.testing.assert_allclose(found.points, POINTS * 1000, rtol=0, atol=1.0)
    np.save(tmp_path / "a.npy", np.zeros(5, [("x", "f4"), ("y", "f4")]))
    with pytest.raises(InputError, match="fields x, y and z of numbers once each, got x, y"):
        read_scans(tmp_path / "a.npy")


def test_organised_arrays_without_returns(tmp_path):
    image = POINTS.reshape(5, 10, 3).copy()
    image[2, 3:5], image[4, 4] = 0.0, np.nan
    np.save(tmp_path / "a.npy", image)
    (found,) = read_scans(tmp_path / "a.npy")
    np.testing.assert_array_equal(found.points, np.delete(POINTS, [23, 24, 44], axis=0))


def las(path, kind, withheld, classes, version, points=POINTS):
    laspy = pytest.importorskip("laspy")
    cloud = laspy.create(point_format=kind, file_version=version)
    cloud.header.scales = [1e-3] * 3
    cloud.x, cloud.y, cloud.z = points.T
    cloud.withheld, cloud.classification = withheld, classes
    cloud.write(path)


@pytest.mark.parametrize("ending", [".las", ".laz"])
@pytest.mark.parametrize("kind, version, noise", [(1, "1.2", [7]), (6, "1.4", [7, 18])])
def test_withheld_points_and_noise_are_left_out(tmp_path, ending, kind, version, noise):
    withheld = np.arange(50) % 10 == 3
    classes = np.where(np.arange(50) % 5 == 0, noise[-1], 18 if kind == 1 else 2)
    classes[25] = noise[0]
    las(tmp_path / f"a{ending}", kind, withheld, classes, version)
    (found,) = read_scans(tmp_path / f"a{ending}")
    stays = ~withheld & ~np.isin(classes, noise)
    np.testing.assert_allclose(found.points, POINTS[stays], atol=1e-6)
    assert found.remarks == (
        f"{50 - stays.sum()} of 50 points are withheld or noise, as the file says, and are left out",
    )
    las(tmp_path / f"a{ending}", kind, np.ones(50, bool), classes, version)
    with pytest.raises(InputError, match="expected points, got 50, all withheld or noise"):
        read_scans(tmp_path / f"a{ending}")


@pytest.mark.parametrize("kind, version", [(1, "1.2"), (6, "1.4")])
@pytest.mark.parametrize("count", [50, 50_000, 50_001])
def test_an_empty_last_chunk_of_laz_holds_no_points(tmp_path, count, kind, version):
    """A chunk holds 50,000 points."""
    laspy, lazrs = pytest.importorskip("laspy"), pytest.importorskip("lazrs")
    points = np.resize(POINTS, (count, 3))
    las(tmp_path / "a.laz", kind, np.zeros(count, bool), np.full(count, 2), version, points)
    data = (tmp_path / "a.laz").read_bytes()
    with laspy.open(tmp_path / "a.laz") as file:
        start = file.header.offset_to_point_data
        layout = lazrs.LazVlr(file.header.vlrs.get("LasZipVlr")[0].record_data)
    (place,) = struct.unpack("<q", data[start : start + 8])
    with open(tmp_path / "a.laz", "rb") as file:
        file.seek(start)
        chunks = lazrs.read_chunk_table(file, layout)
    with open(tmp_path / "b.laz", "wb") as file:
        file.write(data[:place])
        lazrs.write_chunk_table(file, [*chunks, (0, 0)], layout)
    (found,) = read_scans(tmp_path / "b.laz")
    np.testing.assert_allclose(found.points, points, atol=1e-6)


@pytest.mark.parametrize(
    "header, order",
    [("x,y,X,Y,Z", "ppxyz"), ("x,y,z,X,Y,Z", "pppxyz"), ("X,row,Y,col,z,i", "xpypzp"), ("x,y,z,Z,i", "xyzpp")],
)
def test_columns_that_are_named_twice(tmp_path, header, order):
    body = "".join(
        ",".join(str(point["xyz".index(axis)]) if axis in "xyz" else str(number) for axis in order) + "\n"
        for number, point in enumerate(POINTS)
    )
    np.testing.assert_array_equal(read(tmp_path / "a.csv", f"{header}\n{body}").points, POINTS)


@pytest.mark.parametrize("header", ["x,y,z,x", "X,Y,Z,x,y,z,X", "x,Y,z,Y"])
def test_columns_of_which_nobody_knows_which_is_meant(tmp_path, header):
    row = ",".join("1" * (header.count(",") + 1))
    with pytest.raises(InputError, match=f"columns X, Y and Z once each, got {header.replace(',', ', ')}"):
        read(tmp_path / "a.csv", f"{header}\n{row}\n")


def e57_columns(points, **more):
    return {f"cartesian{axis}": np.ascontiguousarray(points[:, number]) for number, axis in enumerate("XYZ")} | more


def test_a_quaternion_of_zero_turns_nothing(tmp_path):
    write_e57(tmp_path / "a.e57", [(e57_columns(POINTS), ([1.0, 2.0, 3.0], [0.0, 0.0, 0.0, 0.0]))])
    (found,) = read_scans(tmp_path / "a.e57")
    np.testing.assert_allclose(found.points, POINTS + np.array([1, 2, 3]))
    np.testing.assert_array_equal(found.position, [1, 2, 3])
    np.testing.assert_array_equal(found.rotation, np.eye(3))
    assert found.remarks == ("the quaternion of its rotation is 0 0 0 0, which was taken for none",)


def test_structured_e57_with_rays_without_a_return(tmp_path):
    """Rows and columns; what came back from nowhere is called invalid, or is zero, or both."""
    rows, columns = (index.ravel() for index in np.indices((5, 10)))
    points, state = POINTS.copy(), np.zeros(50, np.int8)
    points[10:14], state[12:20] = 0.0, 2
    grid = {"rowIndex": rows.astype(float), "columnIndex": columns.astype(float)}
    pose = ([1.0, 2.0, 3.0], [0.8, 0.0, 0.0, 0.6])
    nothing = e57_columns(np.zeros((50, 3)), **grid)
    scans = [
        (e57_columns(points, **grid, cartesianInvalidState=state), pose),
        (e57_columns(POINTS, cartesianInvalidState=np.full(50, 2, np.int8)), pose),
        (nothing, pose),
        (e57_columns(points, **grid), pose),
    ]
    write_e57(tmp_path / "a.e57", scans)
    first, second = read_scans(tmp_path / "a.e57")
    assert first.remarks[0] == "2 of 4 scans hold no points and are left out"
    for found, gone in ((first, range(10, 20)), (second, range(10, 14))):
        turn = np.array([[0.28, -0.96, 0.0], [0.96, 0.28, 0.0], [0.0, 0.0, 1.0]])
        np.testing.assert_allclose(found.points, np.delete(POINTS, gone, axis=0) @ turn.T + [1, 2, 3], atol=1e-9)


@pytest.mark.parametrize("axes", [e57.CARTESIAN, e57.SPHERICAL])
def test_scans_of_an_e57_file_are_counted_as_they_are_read(tmp_path, monkeypatch, axes):
    """Also where the first ray that came back is far down, and beside scans of which none did."""
    monkeypatch.setattr(e57, "PROBE", 7)
    state = axes[0].replace("X", "InvalidState").replace("Range", "InvalidState")

    def scan(points, invalid=0):
        columns = {axis: np.ascontiguousarray(points[:, number]) for number, axis in enumerate(axes)}
        return columns | {state: np.full(len(points), invalid, np.int8)}, None

    late, damage = np.where(np.arange(50)[:, None] < 48, 0.0, POINTS), np.full((50, 3), np.nan)
    scans = [scan(POINTS, 2), scan(late), scan(np.zeros((50, 3))), scan(POINTS[:0]), scan(damage), scan(POINTS)]
    write_e57(tmp_path / "a.e57", scans)
    assert e57.scans_with_points(tmp_path / "a.e57") == ([1, 5], 6)
    assert [len(found.points) for found in read_scans(tmp_path / "a.e57")] == [2, 50]
    (first, _), (second, _) = sources_of([tmp_path / "a.e57"], None)
    assert first.remark == "4 of 6 scans hold no points and are left out" and second.remark == ""
    assert [len(scan_of(one).points) for one in (first, second)] == [2, 50]


def test_files_of_others(data_root):
    folder = data_root / "formats"
    assert len(read_scans(data_root / "faults" / "laz_empty_chunk" / "empty_last.laz")[0].points) == 8192
    counts = {"laz/1.2-with-color.copc.laz": 1065, "npy/1.2-with-color.npy": 1065, "pcd/autzen-utm.pcd": 1065}
    for name, count in counts.items():
        assert len(read_scans(folder / name)[0].points) == count
    for name in ("ouster_count0.pcd", "nocount_noview.pcd"):
        assert len(read_scans(data_root / "faults" / "pcd_count" / name)[0].points) == 8192


def test_arrays_by_other_names_and_lying_across(tmp_path):
    for name, arrays in (("a.npz", {"xyz": POINTS}), ("b.npz", {"arr_0": POINTS})):
        np.savez(tmp_path / name, **arrays)
        np.testing.assert_array_equal(read_scans(tmp_path / name)[0].points, POINTS)
    np.save(tmp_path / "a.npy", POINTS.T)
    with pytest.raises(InputError, match=r"expected points \(N, 3\) of numbers, got float64 \(3, 50\)"):
        read_scans(tmp_path / "a.npy")
