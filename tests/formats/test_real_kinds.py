"""Kinds of files that surveyors' and robots' programs write, on a national grid: exact to a tenth of a millimetre.

Columns, types, byte orders, packings and scales that no small sample holds.
"""

import json
import struct

import numpy as np
import pytest

from jaxmm.formats.readers import read_scans
from jaxmm.inputs import InputError
from tests.cases.bags import Types, write_bag
from tests.cases.depth_recordings import depth_of, poses, write_recording
from tests.cases.valid_files import GRID, bag
from tests.cases.valid_files import POINTS as HELD
from tests.cases.valid_inside import bag_packed, e57_scaled, laz_chunks, mcap_packed

UTM = np.array([412_345.678, 5_678_901.234, 123.456])
POINTS = np.round(np.random.default_rng(3).uniform([-30, -20, 0], [30, 20, 4], (200, 3)), 3) + UTM
NEAR = 5e-5  # [m] half of a tenth of a millimetre


def read(path, data):
    path.write_bytes(data.encode() if isinstance(data, str) else data)
    (found,) = read_scans(path)
    return found


def rows(ends, gap=" "):
    return [gap.join([*(f"{value:.4f}" for value in point), *end]) for point, end in zip(POINTS, ends, strict=True)]


@pytest.mark.parametrize("newline", ["\n", "\r\n"])
@pytest.mark.parametrize("gap", [" ", "\t", "  "])
@pytest.mark.parametrize("count", ["200", "200 ", None])
@pytest.mark.parametrize("more", ["", "-1024", "0.5", "12 34 56", "-1024 12 34 56", "0.25 255 0 7 0.1 0.2 0.97"])
def test_pts_of_any_columns(tmp_path, more, count, gap, newline):
    lines = rows([more.split()] * len(POINTS), gap)
    text = newline.join([*([] if count is None else [count]), *lines]) + newline
    found = read(tmp_path / "a.pts", text)
    np.testing.assert_allclose(found.points, POINTS, rtol=0, atol=NEAR)
    assert not found.remarks


def test_ptx_of_windows_with_comments(tmp_path):
    head = "# exported\n// by a program\n200\n1\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n"
    scan = head + "\n".join(rows([["0.5", "1", "2", "3"]] * len(POINTS))) + "\n"
    for text in (scan, scan.replace("\n", "\r\n"), "\ufeff" + scan):
        (tmp_path / "a.ptx").write_bytes((2 * text if text[0] != "\ufeff" else text).encode())
        for found in read_scans(tmp_path / "a.ptx"):
            np.testing.assert_allclose(found.points, POINTS, rtol=0, atol=NEAR)


@pytest.mark.parametrize("ending", ["xyz", "csv", "pts", "ptx", "pcd", "ply"])
def test_a_text_that_ends_within_a_line_is_refused_or_told(tmp_path, ending):
    heads = {
        "csv": "X;Y;Z;i\n", "pts": "200\n", "pcd": "FIELDS x y z i\nWIDTH 200\nDATA ascii\n",
        "ptx": "200\n1\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n",
        "ply": "ply\nformat ascii 1.0\nelement vertex 200\n"
        + "".join(f"property double {name}\n" for name in "xyzi") + "end_header\n",
    }  # fmt: skip
    gap = ";" if ending == "csv" else " "
    whole = heads.get(ending, "") + "\n".join(rows([["12345"]] * len(POINTS), gap))
    assert not read(tmp_path / f"a.{ending}", whole + "\n").remarks
    for cut in (whole, whole[:-3]):
        (remark,) = read(tmp_path / f"a.{ending}", cut).remarks
        assert "its last line has no end" in remark
    with pytest.raises(InputError):  # no intensity any more, and who knows of the height
        read(tmp_path / f"a.{ending}", whole[:-8])


def test_lines_that_end_in_a_delimiter_or_not_have_the_same_columns(tmp_path):
    text = "X;Y;Z;\n" + "".join(f"{x};{y};{z};\n" for x, y, z in POINTS[:-1]) + ";".join(map(str, POINTS[-1]))
    np.testing.assert_array_equal(read(tmp_path / "a.csv", text).points, POINTS)


KINDS = {"uchar": "u1", "short": "i2", "float": "f4", "double": "f8", "int": "i4"}


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("layout", [
    "uchar:red double:x double:y double:z uchar:alpha short:n",
    "double:z float:nx uchar:red double:x float:ny uchar:green double:y float:nz int:label",
])  # fmt: skip
def test_ply_of_mixed_types(tmp_path, layout, order):
    fields = [field.split(":") for field in layout.split()]
    table = np.zeros(len(POINTS), [(name, order + KINDS[kind]) for kind, name in fields])
    for axis, column in zip("xyz", POINTS.T, strict=True):
        table[axis] = column
    name = "little" if order == "<" else "big"
    head = f"ply\nformat binary_{name}_endian 1.0\ncomment a\nobj_info b\nelement vertex {len(POINTS)}\n"
    head += "".join(f"property {kind} {name}\n" for kind, name in fields) + "end_header\n"
    np.testing.assert_array_equal(read(tmp_path / "a.ply", head.encode() + table.tobytes()).points, POINTS)


@pytest.mark.parametrize("order", ["<", ">"])
def test_pcd_with_padding_and_normals(tmp_path, order):
    """As PCL writes structures that are aligned: four bytes behind z, and behind the normal."""
    fields = [("x", 8, "F", 1), ("y", 8, "F", 1), ("z", 8, "F", 1), ("_", 1, "U", 8), ("normal_x", 4, "F", 1),
              ("normal_y", 4, "F", 1), ("normal_z", 4, "F", 1), ("_", 1, "U", 4), ("curvature", 4, "F", 1),
              ("_", 1, "U", 12)]  # fmt: skip
    size = sum(one[1] * one[3] for one in fields)
    data = np.zeros((len(POINTS), size), np.uint8)
    data[:, :24] = np.ascontiguousarray(POINTS).view(np.uint8).reshape(-1, 24)
    told = [" ".join(str(one[column]) for one in fields) for column in range(4)]
    head = f"VERSION 0.7\nFIELDS {told[0]}\nSIZE {told[1]}\nTYPE {told[2]}\nCOUNT {told[3]}\nWIDTH 20\nHEIGHT 10\n"
    head += "VIEWPOINT 0 0 0 1 0 0 0\nPOINTS 200\nDATA binary\n"
    np.testing.assert_array_equal(read(tmp_path / "a.pcd", head.encode() + data.tobytes()).points, POINTS)


@pytest.mark.parametrize("kind", range(11))
@pytest.mark.parametrize("ending", ["las", "laz"])
def test_las_of_every_point_format_at_utm_coordinates(tmp_path, kind, ending):
    laspy = pytest.importorskip("laspy")
    if kind in (4, 5, 9, 10) and ending == "laz":
        pytest.skip("lazrs packs no waveforms")
    header = laspy.LasHeader(version="1.4" if kind > 5 else "1.3" if kind > 3 else "1.2", point_format=kind)
    header.scales, header.offsets = [1e-3] * 3, [412_000.0, 5_678_000.0, 0.0]
    for number in range(3):
        header.vlrs.append(laspy.VLR("surveyor", number, "about", b"x" * 1000 * number))
    header.add_extra_dim(laspy.ExtraBytesParams("quality", "float64"))
    cloud = laspy.LasData(header)
    cloud.x, cloud.y, cloud.z = POINTS.T
    cloud.write(tmp_path / f"a.{ending}")
    (found,) = read_scans(tmp_path / f"a.{ending}")
    np.testing.assert_allclose(found.points, POINTS, rtol=0, atol=1e-9)


@pytest.mark.parametrize("variable", [False, True])
def test_laz_of_many_chunks(tmp_path, variable):
    pytest.importorskip("lazrs")
    np.testing.assert_allclose(read(tmp_path / "a.laz", laz_chunks(variable).data).points, HELD, rtol=0, atol=NEAR)


def test_e57_of_scaled_numbers_and_spherical_coordinates(tmp_path):
    pytest.importorskip("pye57")
    (tmp_path / "a.e57").write_bytes(e57_scaled().data)
    first, second = read_scans(tmp_path / "a.e57")
    told = np.abs(HELD - GRID) / 4.0
    np.testing.assert_allclose(first.points, told, rtol=0, atol=6e-4)
    reach, azimuth, elevation = told.T
    level = reach * np.cos(elevation)
    there = np.column_stack([level * np.cos(azimuth), level * np.sin(azimuth), reach * np.sin(elevation)])
    np.testing.assert_allclose(second.points, there, rtol=0, atol=3e-3)
    assert first.position is None and second.position is None


@pytest.mark.parametrize("packed", ["lz4", "bz2", "zstd", "mcap-lz4", "unindexed", "message", "file", "storage"])
def test_bags_however_they_are_packed(tmp_path, packed):
    pytest.importorskip("rosbags")
    if packed in ("lz4", "bz2"):
        (tmp_path / "a.bag").write_bytes(bag_packed(packed).data)
        found = read_scans(tmp_path / "a.bag")
    elif packed in ("zstd", "mcap-lz4", "unindexed"):
        coding = {"zstd": "zstd", "mcap-lz4": "lz4", "unindexed": ""}[packed]
        (tmp_path / "a.mcap").write_bytes(mcap_packed(coding).data)
        found = read_scans(tmp_path / "a.mcap")
    else:
        kind = "mcap" if packed == "storage" else "sqlite3"
        types, messages = Types(kind), []
        for number in range(2):
            time, place = 100.0 + number, np.array([0.5 * number, 0.0, 1.5])
            messages.append(("/tf", time, types.tf(time, ("map", "lidar", (place, np.eye(3))))))
            messages.append(("/points", time, types.cloud(time, "lidar", HELD - GRID)))
        found = read_scans(write_bag(tmp_path / "a", kind, messages, packed))
    assert len(found) == 2
    for number, scan in enumerate(found):
        np.testing.assert_allclose(scan.points, HELD - GRID + [0.5 * number, 0.0, 1.5], rtol=0, atol=1e-6)
        np.testing.assert_allclose(scan.position, [0.5 * number, 0.0, 1.5])


def test_what_a_bag_calls_its_topics_stays_one_short_line(tmp_path):
    pytest.importorskip("rosbags")
    types = Types("ros1")
    nothing = np.full((4, 3), np.nan)
    for topic, points in (("/po\nints" + "s" * 4000, nothing), ("/a\u2028b", nothing)):
        path = write_bag(tmp_path / f"{len(topic)}", "ros1", [(topic, 100.0, types.cloud(100.0, "map", points))])
        with pytest.raises(InputError, match="expected messages with points on /") as caught:
            read_scans(path)
        assert len(str(caught.value).splitlines()) == 1 and len(str(caught.value)) < 600


@pytest.mark.parametrize("profile", [b"", b"ros1", b"x" * 40])
def test_mcap_that_is_not_of_ros_2_is_refused_by_its_profile(tmp_path, profile):
    data = bag("mcap").data
    (length,) = struct.unpack("<Q", data[9:17])
    head = struct.pack("<Q", length - 4 + len(profile)) + struct.pack("<I", len(profile)) + profile
    (tmp_path / "a.mcap").write_bytes(data[:9] + head + data[25:])
    with pytest.raises(InputError, match=f"with the profile ros2, got '{profile.decode()}'"):
        read_scans(tmp_path / "a.mcap")


@pytest.mark.parametrize("kind", ["ros1", "sqlite3"])
@pytest.mark.parametrize("order", ["<", ">"])
def test_clouds_of_any_byte_order_with_padded_rows_and_small_intensities(tmp_path, order, kind):
    pytest.importorskip("rosbags")
    types = Types(kind)
    points = (HELD - GRID).reshape(8, 5, 3)
    cloud = types.cloud(100.0, "map", points, order, "f8", padding=7)
    (found,) = read_scans(write_bag(tmp_path / "a", kind, [("/points", 100.0, cloud)]))
    np.testing.assert_array_equal(found.points, HELD - GRID)


@pytest.mark.parametrize("scale", [1000.0, 5000.0, 4000.0])
def test_depth_images_of_any_scale(tmp_path, scale):
    """The same picture of the same room, in millimetres or fifths of them."""
    pose = poses(1)[0]
    write_recording(tmp_path / "a", "plain", [pose], [depth_of(pose)])
    told = json.loads((tmp_path / "a" / "intrinsics.json").read_text())
    from PIL import Image

    (image,) = (tmp_path / "a" / "depth").iterdir()
    with Image.open(image) as opened:
        depth = np.asarray(opened).astype(np.float64) / told["depth_scale"]
    Image.fromarray(np.round(depth * scale).astype(np.uint16)).save(image)
    (tmp_path / "a" / "intrinsics.json").write_text(json.dumps(told | {"depth_scale": scale}))
    (found,) = read_scans(tmp_path / "a")
    reach = np.linalg.norm(found.points - found.position, axis=1)
    there = depth[depth > 0]
    assert abs(np.median(reach) - np.median(np.linalg.norm(found.points - pose[0], axis=1))) < 1e-6
    assert abs((found.points - pose[0]) @ pose[1][:, 2] - there).max() < 1.0 / scale


def test_e57_of_several_images_and_a_scan_without_pose(tmp_path):
    pye57 = pytest.importorskip("pye57")
    from pye57 import libe57

    with pye57.E57(str(tmp_path / "a.e57"), mode="w") as file:
        file.write_scan_raw({f"cartesian{axis}": POINTS[:, number] - UTM[number] for number, axis in enumerate("XYZ")})
        image = file.image_file
        pictures = image.root()["images2D"]
        for number in range(3):
            picture, shown = libe57.StructureNode(image), libe57.StructureNode(image)
            pictures.append(picture)
            picture.set("guid", libe57.StringNode(image, f"{{{number}}}"))
            picture.set("visualReferenceRepresentation", shown)
            blob = libe57.BlobNode(image, 1500)
            shown.set("jpegImage", blob)
            data = np.frombuffer(b"\xff\xd8" + bytes(1498), np.uint8).copy()
            blob.write(data, 0, 1500)
            shown.set("imageWidth", libe57.IntegerNode(image, 10))
    (found,) = read_scans(tmp_path / "a.e57")
    np.testing.assert_allclose(found.points, POINTS - UTM, rtol=0, atol=1e-5)


def test_numbers_of_a_structure_of_numpy_in_any_order(tmp_path):
    table = np.zeros((10, 20), [("intensity", "<u2"), ("Z", "<f4"), ("Y", ">f8"), ("X", "<f8"), ("ring", "u1")])
    for axis, column in zip("XYZ", (POINTS - UTM).T, strict=True):
        table[axis] = column.reshape(10, 20)
    organised = POINTS.reshape(10, 20, 3)
    arrays = {
        "a": table, "b": np.asfortranarray(POINTS), "c": organised, "d": np.asfortranarray(organised),
        "e": np.repeat(POINTS, 2, axis=1)[:, ::2], "f": np.hstack([POINTS, POINTS]).astype(">f8"),
    }  # fmt: skip
    for name, array in arrays.items():
        np.save(tmp_path / f"{name}.npy", array)
        np.savez_compressed(tmp_path / f"{name}.npz", points=array)
        there = POINTS - UTM if name == "a" else POINTS
        for ending in ("npy", "npz"):
            (found,) = read_scans(tmp_path / f"{name}.{ending}")
            np.testing.assert_allclose(found.points, there, rtol=0, atol=1e-6)
