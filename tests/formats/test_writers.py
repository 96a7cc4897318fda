"""Scan files, read back by other readers: positions to the micrometre, elements, the pose, nothing half-written."""

import errno
import os

import numpy as np
import pytest
import trimesh

from jaxmm import inputs
from jaxmm.formats import writers
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
    return np.stack([data[axis] for axis in "xyz"], axis=1), data["element"], data["intensity"]


def read_pcd(path):
    pypcd4 = pytest.importorskip("pypcd4")
    cloud = pypcd4.PointCloud.from_path(path)
    np.testing.assert_allclose(cloud.metadata.viewpoint[:3], GRID, atol=1e-6)
    return cloud.numpy(("x", "y", "z")), *(cloud.numpy((name,))[:, 0] for name in ("element", "intensity"))


def read_e57(path):
    pye57 = pytest.importorskip("pye57")
    file = pye57.E57(str(path))
    header = file.get_header(0)
    np.testing.assert_allclose(header.translation, GRID)
    data = file.read_scan(0, ignore_missing_fields=True)
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
    assert lines[0] == ";".join(inputs.CSV_COLUMNS)
    table = np.loadtxt(lines[1:], delimiter=";")
    return table[:, :3], table[:, 3], None


@pytest.mark.parametrize("reader", [read_ply, read_pcd, read_e57, read_csv], ids=lambda reader: reader.__name__[5:])
def test_other_readers_find_the_same_points_and_elements(scan, tmp_path, reader):
    path = tmp_path / f"scan.{reader.__name__[5:]}"
    writers.write_scan(path, scan)
    points, element, light = reader(path)
    np.testing.assert_allclose(points, expected_points(scan), rtol=0, atol=1e-6)
    np.testing.assert_array_equal(element, scan.element[np.isfinite(scan.distance)])
    assert light is None or np.array_equal(np.float32(light), scan.intensity[np.isfinite(scan.distance)])
    assert [path.name for path in tmp_path.iterdir()] == [path.name]


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
    for name in ("scan.las", "scan"):
        with pytest.raises(InputError, match="expected a file ending in"):
            writers.write_scan(tmp_path / name, scan)
    nothing = scan._replace(distance=np.full_like(scan.distance, np.inf))
    for suffix in (".ply", ".pcd", ".e57", ".csv"):
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


def test_pcd_is_single_precision_where_that_is_exact_enough(scan, tmp_path):
    """Not every reader knows doubles; those of a national grid need them."""
    pypcd4 = pytest.importorskip("pypcd4")
    for position, dtype, error in ((GRID, np.float64, 1e-6), (GRID / 1000, np.float32, 2.5e-4)):
        near = scan._replace(position=position)
        writers.write_scan(tmp_path / "scan.pcd", near)
        cloud = pypcd4.PointCloud.from_path(tmp_path / "scan.pcd")
        assert cloud.types[:3] == (dtype,) * 3
        np.testing.assert_allclose(cloud.numpy(("x", "y", "z")), expected_points(near), rtol=0, atol=error)
