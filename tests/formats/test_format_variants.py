"""What each format of scan files can say, and how it may be said: several scans, poses, comments, gaps, headers."""

import re

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jaxmm.formats.readers import read_scans
from jaxmm.inputs import InputError
from tests.cases.e57_files import write_e57

RNG = np.random.default_rng(5)
POINTS = np.round(RNG.uniform([-5, -4, 0], [5, 4, 3], (300, 3)), 4)
GRID = np.array([412_345.0, 5_678_901.0, 30.0])
NATIONAL = POINTS + GRID
POSE = np.array([1.0, -2.0, 1.5])


def test_every_scan_of_an_e57_file_comes_with_its_pose(tmp_path):
    pye57 = pytest.importorskip("pye57")
    poses = [(POSE + GRID, [0.8, 0.0, 0.0, 0.6]), (GRID, [0.5, 0.5, 0.5, 0.5])]
    with pye57.E57(str(tmp_path / "a.e57"), mode="w") as file:
        for position, turn in poses:
            columns = {f"cartesian{axis}": POINTS[:, number].copy() for number, axis in enumerate("XYZ")}
            file.write_scan_raw(columns, rotation=np.array(turn), translation=position)
    found = read_scans(tmp_path / "a.e57")
    assert len(found) == 2
    for scan, (position, (w, x, y, z)) in zip(found, poses, strict=True):
        rotation = Rotation.from_quat([x, y, z, w]).as_matrix()
        np.testing.assert_allclose(scan.rotation, rotation, atol=1e-12)
        np.testing.assert_array_equal(scan.position, position)
        np.testing.assert_allclose(scan.points, POINTS @ rotation.T + position, atol=1e-8)
        assert scan.in_world


def test_spherical_invalid_and_empty_scans_of_an_e57_file(tmp_path):
    pytest.importorskip("pye57")
    distance = np.linalg.norm(POINTS, axis=1)
    columns = {
        "sphericalRange": distance,
        "sphericalAzimuth": np.arctan2(POINTS[:, 1], POINTS[:, 0]),
        "sphericalElevation": np.arcsin(POINTS[:, 2] / distance),
        "sphericalInvalidState": (np.arange(300) % 3).astype(np.int8),
    }
    none = {f"cartesian{axis}": np.zeros(0) for axis in "XYZ"}
    write_e57(tmp_path / "a.e57", [(none, None), (columns, None)])
    (found,) = read_scans(tmp_path / "a.e57")
    np.testing.assert_allclose(found.points, POINTS[::3], atol=1e-12)
    assert found.position is None and found.remarks == ("1 of 2 scans hold no points and are left out",)


def test_vertices_stand_among_comments_and_before_faces(tmp_path):
    header = "ply\nformat {}\ncomment a b element vertex\nobj_info c\nelement vertex 300\nproperty uchar red\n"
    header += "".join(f"property double {axis}\n" for axis in "zyx")
    header += "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    rows = "".join(f"7 {z} {y} {x}\n" for x, y, z in NATIONAL) + "3 0 1 2\n"
    (tmp_path / "a.ply").write_text((header.format("ascii 1.0") + rows).replace("\n", "\r\n"), newline="")
    table = np.zeros(300, [("red", "u1"), ("z", "<f8"), ("y", "<f8"), ("x", "<f8")])
    for number, axis in enumerate("xyz"):
        table[axis] = NATIONAL[:, number]
    body = table.tobytes() + b"\3\0\0\0\0\1\0\0\0\2\0\0\0"
    (tmp_path / "b.ply").write_bytes(header.format("binary_little_endian 1.0").encode() + body)
    for name in ("a.ply", "b.ply"):
        np.testing.assert_array_equal(read_scans(tmp_path / name)[0].points, NATIONAL)


@pytest.mark.parametrize(
    "viewpoint, posed",
    [("1 2 3 0.8 0 0 0.6", True), ("0 0 0 1 0 0 0", False), ("0 0 0 0 1 0 0", False), ("0 0 0 0 0 0 0", False)],
)
def test_viewpoints_of_pcd(tmp_path, viewpoint, posed):
    pytest.importorskip("pypcd4")
    head = "# .PCD v0.7\nVERSION 0.7\nFIELDS _ x normal y z\nSIZE 1 4 4 4 4\nTYPE U F F F F\nCOUNT 3 1 3 1 1\n"
    head += f"WIDTH 150\nHEIGHT 2\nVIEWPOINT {viewpoint}\nPOINTS 300\nDATA binary\n"
    fields = [("_", "u1", 3), ("x", "<f4"), ("normal", "<f4", 3), ("y", "<f4"), ("z", "<f4")]
    table = np.ones(300, fields)
    for number, axis in enumerate("xyz"):
        table[axis] = POINTS[:, number]
    (tmp_path / "a.pcd").write_bytes(head.encode() + table.tobytes())
    (found,) = read_scans(tmp_path / "a.pcd")
    np.testing.assert_array_equal(found.points, POINTS.astype(np.float32))
    assert (found.position is not None) == posed == (found.rotation is not None)
    if posed:
        np.testing.assert_allclose(found.position, [1, 2, 3])
        np.testing.assert_allclose(found.rotation, Rotation.from_quat([0, 0, 0.6, 0.8]).as_matrix(), atol=1e-12)


@pytest.mark.parametrize(
    "name, text, word",
    [
        ("a.csv", "X,Y,Z\n1,5,2,5,3,5\n", "3 columns as its header names, got 6; decimal commas?"),
        ("a.xyz", "1,5, 2,5, 3,5\n2,5, 1,0, 1,1\n", "decimal commas: 1,5, 2,5"),
        ("a.csv", "X;Y;Z\n1.234,5;2,5;3,5\n", "1.234.5"),
        ("a.csv", 'X,Y,Z\n"3,0000","4,5","5,5"\n', 'decimal commas: "3,0000'),
        ("a.csv", '"3,0000","4,5","5,5"\n', 'decimal commas: "3,0000'),
        ("a.csv", "X;Y\n1;2\n", "columns X, Y and Z, got X, Y: Z is missing"),
        ("a.csv", "Rechtswert;Höhe;Code\n1;2;3\n", "got Rechtswert, Höhe, Code: Y is missing"),
        ("a.csv", "Name;Code\n1;2\n", "columns X, Y and Z, got Name, Code"),
        ("a.csv", "X;Y;Z\n", "at least one row"),
        ("a.csv", "X;Y;Z\n1;2;3\n4;;6\n", "rows of numbers"),
        ("a.csv", "x,y,z,i\n1,2,3,4,5\n", "4 columns as its header names, got 5"),
        ("a.csv", "x,y,z,i\n1,2,3\n", "4 columns as its header names, got 3"),
        ("a.txt", "1 2\n3 4\n", "columns X, Y and Z"),
        ("a.txt", "# only comments\n// and no points\n", "columns X, Y and Z, got none"),
        ("a.txt", "3\n1 2 3 4\n5 6 7 8\n", "truncated: expected 3 points as it says itself, found 2"),
        ("a.txt", "7\n8\n9\n", "columns X, Y and Z, got 8"),
        ("a.txt", "1 2 3\n# a comment amid points\n4 5 6\n", "rows of numbers"),
        ("a.wrl", "#VRML V2.0 utf8\n", "a scan ending in .ply, .pcd, .e57, .las, .laz, .csv"),
        ("a.ply", "# vtk DataFile Version 3.0\n", "expected a PLY file"),
    ],
)
def test_text_that_cannot_be_meant_is_refused(tmp_path, name, text, word):
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=re.escape(word)):
        read_scans(tmp_path / name)


@pytest.mark.parametrize(
    "text",
    [
        "//X Y Z R\n{0} {1} {2} 7\n",
        "# x y z r\n{0} {1} {2} 7\n",
        '"X";"Y";"Z";\r\n{0};{1};{2};\r\n\r\n',
        "x,y,z,intensity\n{0},{1},{2},\n",  # a last cell that is empty
        "x,y,z\n{0},{1},{2},\n",
    ],
)
def test_headers_that_others_write(tmp_path, text):
    header, row, *rest = text.splitlines(keepends=True)
    body = "".join(row.format(*point) for point in POINTS)
    (tmp_path / "a.txt").write_text(header + body + "".join(rest), newline="")
    np.testing.assert_array_equal(read_scans(tmp_path / "a.txt")[0].points, POINTS)


@pytest.mark.parametrize(
    "start",
    ["# made by a scanner; version 2, 3\n", "// a\n# b\n\n", "300\n", "# made by\n300\n", "//X Y Z i\n300\n",
     "# made by\n// X Y Z i\n# more\n", "\n\n", "\ufeff# made by\n"],
)  # fmt: skip
def test_what_others_write_before_the_points(tmp_path, start):
    """Comments, and the number of points."""
    body = "".join("{} {} {} 0.5\n".format(*point) for point in POINTS)
    (tmp_path / "a.xyz").write_text(start + body, encoding="utf-8")
    np.testing.assert_array_equal(read_scans(tmp_path / "a.xyz")[0].points, POINTS)


ROW = "{0};{1};{2}\n"


@pytest.mark.parametrize(
    "text",
    [
        "X;Y;Z\n" + ROW, "X\tY\tZ\n" + ROW.replace(";", "\t"), ROW.replace(";", " "), ROW,
        "Punkt;X;Y;Z;Code\n" + f"Stütze 3;{ROW[:-1]};7\n",
    ],
    ids=["semicolons", "tabs", "blanks", "no header", "columns beside"],
)  # fmt: skip
def test_decimal_commas_where_commas_do_not_split_columns(tmp_path, text):
    header, row = ("", text) if text.startswith("{") else text.split("\n", 1)
    body = "".join(row.format(*(f"{value:.3f}".replace(".", ",") for value in point)) for point in POINTS)
    (tmp_path / "a.csv").write_text(f"{header}\n{body}", encoding="utf-8")
    (found,) = read_scans(tmp_path / "a.csv")
    np.testing.assert_allclose(found.points, POINTS, atol=1e-3)
    assert found.remarks == ("its decimal commas were read as points",)


@pytest.mark.parametrize("encoding", ["utf-8", "cp1252", "utf-16"])
@pytest.mark.parametrize(
    "header, order",
    [
        ("Nr;Rechtswert;Hochwert;Höhe", "012"), ("Nr;Hochwert;Rechtswert;Höhe", "102"), ("Nr;E [m];N [m];H [m]", "012"),
        ("Nr;Z-Koordinate;X-Koordinate;Y-Koordinate", "201"), ("N°;Est;Nord;Altitude", "012"),
        ("id;Easting;Northing;Elevation (m)", "012"), ('"Normals:0";"Points:0";"Points:1";"Points:2"', "012"),
    ],
)  # fmt: skip
def test_columns_named_as_surveyors_do(tmp_path, header, order, encoding):
    rows = "".join(";".join(["7", *(str(point[int(axis)]) for axis in order)]) + "\n" for point in POINTS)
    (tmp_path / "a.csv").write_bytes(f"{header}\n{rows}".encode(encoding))
    np.testing.assert_array_equal(read_scans(tmp_path / "a.csv")[0].points, POINTS)


@pytest.mark.parametrize("header", ["lat;lon;h", "E;N;E;H", "Ost;Nord", "Est;Northing;Höhe", "x;y;height"])
def test_columns_of_which_nobody_knows_what_they_are(tmp_path, header):
    row = ";".join("1" * (header.count(";") + 1))
    (tmp_path / "a.csv").write_text(f"{header}\n{row}\n{row}\n", encoding="utf-8")
    with pytest.raises(InputError, match="columns X, Y and Z"):
        read_scans(tmp_path / "a.csv")


@pytest.mark.parametrize("split, start", [(" ", ""), (",", ""), (";", "300\n"), ("\t", "# made by\n")])
@pytest.mark.parametrize("step", [1, 7])
def test_a_first_column_that_counts_the_points_is_no_coordinate(tmp_path, split, start, step):
    rows = (split.join([str(5 + step * row), *map(str, point), "40"]) for row, point in enumerate(NATIONAL))
    (tmp_path / "a.txt").write_text(start + "\n".join(rows) + "\n")
    (found,) = read_scans(tmp_path / "a.txt")
    np.testing.assert_array_equal(found.points, NATIONAL)
    assert any("its first column counts the points" in told for told in found.remarks)


def test_whole_numbers_may_be_coordinates(tmp_path):
    """Rising ones beside whole ones, or with words where Z would be; and those that do not rise in every row, are X."""
    whole, named = [[1, 2, 3, 4], [2, 5, 7, 4], [3, 9, 9, 4]], [[1, 2.5, 3.5, "wall"], [2, 5.5, 7.5, "floor"]]
    for rows in (whole, named, [[1, 2.5, 3.5, 4], [2, 5.5, 7.5, 4], [2, 9.5, 9.5, 4]]):
        (tmp_path / "a.xyz").write_text("".join(" ".join(map(str, row)) + "\n" for row in rows))
        (found,) = read_scans(tmp_path / "a.xyz")
        np.testing.assert_array_equal(found.points, [row[:3] for row in rows])
        assert not found.remarks


def test_a_first_column_of_names_is_told(tmp_path):
    (tmp_path / "a.txt").write_text("P1 1.0 2.0 3.0\nP2 1.5 2.5 3.0\n")
    with pytest.raises(InputError, match="its first column holds names; a first line that names the columns"):
        read_scans(tmp_path / "a.txt")
