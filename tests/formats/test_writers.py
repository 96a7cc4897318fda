"""Scan files, read back by other readers: positions to the micrometre, elements, the pose, nothing half-written."""

import errno
import os

import numpy as np
import pytest
import trimesh

from jaxmm import inputs
from jaxmm.formats import writers
from jaxmm.formats.readers import read_scans
from jaxmm.inputs import InputError
from warp_scanner.scenes.building import Elements
from warp_scanner.sensors.poses import rotation_of
from warp_scanner.sensors.sensors import Pinhole

GRID = np.array([192_340.125, 444_123.375, 12.5])  # [m] a place on a national grid


@pytest.fixture
def scan():
    """A made-up scan with misses, far from the origin."""
    rng = np.random.default_rng(0)
    directions = Pinhole(40, 30).directions()
    distance = rng.uniform(0.5, 20.0, len(directions)).astype(np.float32)
    distance[::7] = np.inf
    element = np.where(np.isfinite(distance), rng.integers(0, 3, len(distance)), -1).astype(np.int32)
    semantic = np.where(element >= 0, 3, 0).astype(np.uint8)
    rotation = rotation_of([33.0], [-12.0])[0].astype(np.float64)
    incidence = np.where(np.isfinite(distance), rng.uniform(0.0, 1.5, len(distance)), np.nan).astype(np.float32)
    light = np.where(np.isfinite(distance), rng.uniform(0.0, 1.0, len(distance)), 0.0).astype(np.float32)
    rays = (directions, distance, element, semantic, incidence, light)
    ids, storey = ("a", "b", "c"), np.array([0, -1, 0], np.int32)
    elements = Elements(
        ids, ("IfcWall", "", "IfcDoor"), ("North", "", "Öffnung"), storey, np.zeros(3, np.uint8), ids, ((),) * 3
    )
    return writers.SensorScan(GRID, rotation, *rays, elements)


def expected_points(scan):
    """World points in plain double precision, one by one."""
    return np.array(
        [
            scan.position + scan.rotation @ (float(distance) * direction.astype(float))
            for distance, direction in zip(scan.distance, scan.directions, strict=True)
            if np.isfinite(distance)
        ]
    )


def read_ply(path):
    data = trimesh.load(path).metadata["_ply_raw"]["vertex"]["data"]
    return np.stack([data[axis] for axis in "xyz"], axis=1), data["scalar_element"], data["scalar_intensity"]


def read_pcd(path):
    pypcd4 = pytest.importorskip("pypcd4")
    cloud = pypcd4.PointCloud.from_path(path)
    assert cloud.metadata.viewpoint == (0, 0, 0, 1, 0, 0, 0)  # by another one PCL's viewer would move the cloud
    return cloud.numpy(("x", "y", "z")), *(cloud.numpy((name,))[:, 0] for name in ("element", "intensity"))


def read_e57(path):
    pye57 = pytest.importorskip("pye57")
    file = pye57.E57(str(path))
    header = file.get_header(0)
    np.testing.assert_allclose(header.translation, GRID)
    data = file.read_scan(0)
    raw = file.read_scan_raw(0, ignore_unsupported_fields=True)
    assert len(raw["cartesianX"]) == len(data["cartesianX"]) == header.point_count
    assert file.image_file.extensionsUri(1) == writers.E57_EXTENSION
    columns = {name: np.zeros(header.point_count, np.longlong) for name in ("jaxmm:element", "jaxmm:semantic")}
    buffers = pye57.libe57.VectorSourceDestBuffer()
    for name, column in columns.items():
        buffers.append(pye57.libe57.SourceDestBuffer(file.image_file, name, column, len(column), True, True))
    header.points.reader(buffers).read()
    guids = header.node["jaxmm:guid"]
    assert [guids[row].value() for row in range(guids.childCount())] == ["a", "b", "c"]
    assert set(columns["jaxmm:semantic"]) == {3}
    file.close()
    return np.stack([data[f"cartesian{axis}"] for axis in "XYZ"], axis=1), columns["jaxmm:element"], raw["intensity"]


def read_csv(path):
    lines = path.read_text().splitlines()
    assert lines[0] == ",".join(inputs.CSV_COLUMNS)
    table = np.loadtxt(lines[1:], delimiter=",")
    return table[:, :3], table[:, 3], None


def read_las(path):
    laspy = pytest.importorskip("laspy")
    data = laspy.read(path)
    np.testing.assert_array_equal(data.header.offsets % 1000.0, 0.0)
    np.testing.assert_array_equal(data.header.scales, 1e-4)
    assert (data["semantic"] == 3).all() and (data.return_number == data.number_of_returns).all()
    assert data.intensity.max() == 65535
    return np.array(data.xyz), np.array(data["element"]), None


def read_laz(path):
    assert path.stat().st_size < 20 * 1200  # packed: a record has 25 bytes
    return read_las(path)


READERS = {"ply": read_ply, "pcd": read_pcd, "e57": read_e57, "las": read_las, "laz": read_laz, "csv": read_csv}
STEPS = {"las": 5.1e-5, "laz": 5.1e-5}  # [m] half of what LAS rounds to; all others keep doubles


@pytest.mark.parametrize("kind", READERS)
def test_other_readers_find_the_same_points_and_elements(scan, tmp_path, kind):
    path = tmp_path / f"scan.{kind}"
    written = writers.write_scan(path, scan)
    points, element, light = READERS[kind](path)
    np.testing.assert_allclose(points, expected_points(scan), rtol=0, atol=STEPS.get(kind, 1e-6))
    np.testing.assert_array_equal(element, scan.element[np.isfinite(scan.distance)])
    assert light is None or np.array_equal(np.float32(light), scan.intensity[np.isfinite(scan.distance)])
    beside = [tmp_path / f"scan.offset_192000_444000_0.{kind}"] if kind in ("ply", "pcd") else []
    assert written == (path, *beside) and set(tmp_path.iterdir()) == set(written)


@pytest.mark.parametrize("position", [GRID, GRID / 1000, -GRID * [10, 3, 1]], ids=["grid", "near", "beyond"])
@pytest.mark.parametrize("suffix", writers.WRITERS)
def test_our_readers_find_every_point_and_the_pose_wherever_it_stands(scan, tmp_path, suffix, position):
    placed = scan._replace(position=position)
    for path in writers.write_scan(tmp_path / f"scan{suffix}", placed):
        (read,) = read_scans(path)
        np.testing.assert_allclose(read.points, expected_points(placed), rtol=0, atol=1e-4)
        if suffix in (".pcd", ".e57", ".npz"):
            np.testing.assert_allclose(read.position, position, rtol=0, atol=1e-6)
            np.testing.assert_allclose(read.rotation, scan.rotation, rtol=0, atol=1e-7)  # of single precision
            assert read.in_world or suffix == ".npz"


@pytest.mark.parametrize("suffix", [".ply", ".pcd"])
def test_single_precision_where_that_keeps_a_tenth_of_a_millimetre(scan, tmp_path, suffix):
    """Not every reader knows doubles; what is moved for them says in its header by how much."""
    near = scan._replace(position=np.array([1900.0, -1900.0, 31.0]))
    (path,) = writers.write_scan(tmp_path / f"near{suffix}", near)
    (read,) = read_scans(path)
    np.testing.assert_array_equal(read.points, read.points.astype(np.float32))
    np.testing.assert_allclose(read.points, expected_points(near), rtol=0, atol=1e-4)
    path, moved = writers.write_scan(tmp_path / f"far{suffix}", scan)
    words = [line.split()[1:] for line in moved.read_bytes().split(b"\n")[:9] if b"offset" in line]
    assert words == [b"jaxmm offset 192000 444000 0: metres to be added".split()]
    assert b"offset" not in path.read_bytes()[:300]
    (read,) = read_scans(moved)
    local = read.points - np.array([192_000.0, 444_000.0, 0.0])
    np.testing.assert_array_equal(local, local.astype(np.float32))


def test_a_comment_of_others_moves_nothing(scan, tmp_path):
    near = scan._replace(position=GRID / 1000)
    (path,) = writers.write_scan(tmp_path / "scan.ply", near)
    content = path.read_bytes()
    for words in (b"offset 1 2 3", b"jaxmm offset 1 2", b"jaxmm offset 1 nan 3", b"jaxmm offset a b c", b"jaxmm"):
        path.write_bytes(content.replace(b"metres, z up", words))
        np.testing.assert_allclose(read_scans(path)[0].points, expected_points(near), rtol=0, atol=1e-4)
    path.write_bytes(content.replace(b"metres, z up", b"jaxmm offset 1 2 3"))
    np.testing.assert_allclose(
        read_scans(path)[0].points, expected_points(near) + np.array([1, 2, 3]), rtol=0, atol=1e-4
    )


def test_an_archive_keeps_every_ray_and_the_names_of_the_elements(scan, tmp_path):
    writers.write_scan(tmp_path / "scan.npz", scan)
    with np.load(tmp_path / "scan.npz", allow_pickle=False) as arrays:
        for name in ("distance", "element", "semantic", "incidence", "intensity"):
            np.testing.assert_array_equal(arrays[name], getattr(scan, name))
        np.testing.assert_array_equal(arrays["origin"], GRID)
        points = (
            arrays["origin"]
            + (arrays["direction"] * arrays["distance"][:, None].astype(float))[np.isfinite(arrays["distance"])]
            @ arrays["rotation"].T
        )
        for name in ("guid", "ifc_class", "name", "storey"):
            assert arrays[name].tolist() == list(getattr(scan.elements, name))
    np.testing.assert_allclose(points, expected_points(scan), rtol=0, atol=1e-5)


def test_refuses_unknown_endings_and_scans_of_nothing(scan, tmp_path):
    for name in ("scan.xyz", "scan"):
        with pytest.raises(InputError, match="expected a file ending in"):
            writers.write_scan(tmp_path / name, scan)
    nothing = scan._replace(distance=np.full_like(scan.distance, np.inf))
    for suffix in (".ply", ".pcd", ".e57", ".laz", ".csv"):
        with pytest.raises(InputError, match="every ray missed"):
            writers.write_scan(tmp_path / f"scan{suffix}", nothing)
    writers.write_scan(tmp_path / "scan.npz", nothing)
    assert [path.name for path in tmp_path.iterdir()] == ["scan.npz"]


@pytest.mark.parametrize("suffix", writers.WRITERS)
def test_a_full_disk_leaves_nothing_half_written(scan, tmp_path, monkeypatch, suffix):
    path = tmp_path / f"scan{suffix}"
    path.write_text("before")

    def full(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "replace", full)
    with pytest.raises(OSError, match="No space left") as failure:
        writers.write_scan(path, scan)
    assert failure.value.filename == str(path)
    assert path.read_text() == "before" and len(list(tmp_path.iterdir())) == 1


@pytest.mark.parametrize("suffix", [".ply", ".pcd"])
def test_of_two_files_both_are_written_or_neither(scan, tmp_path, monkeypatch, suffix):
    moves, replace = [], os.replace

    def full(source, target):
        moves.append(target)
        if len(moves) == 2:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        replace(source, target)

    monkeypatch.setattr(os, "replace", full)
    with pytest.raises(OSError, match="No space left"):
        writers.write_scan(tmp_path / f"scan{suffix}", scan)
    assert len(moves) == 2 and not list(tmp_path.iterdir())
