"""Scan files: what any library wrote comes back, with its pose, and damage is one line."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jaxmm.formats import e57, las, pcd, raw_scans, text, writers
from jaxmm.formats.readers import READERS, read_scans
from jaxmm.inputs import InputError

RNG = np.random.default_rng(5)
POINTS = np.round(RNG.uniform([-5, -4, 0], [5, 4, 3], (300, 3)), 4)
GRID = np.array([412_345.0, 5_678_901.0, 30.0])
NATIONAL = POINTS + GRID
POSE = np.array([1.0, -2.0, 1.5])


class NoElements:
    guid = ifc_class = name = file = ("a",)
    storey = np.zeros(1, np.int32)


def scan_of(position):
    direction = RNG.normal(size=(200, 3)).astype(np.float32)
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    distance = RNG.uniform(1, 5, 200).astype(np.float32)
    distance[::7] = np.inf
    rotation = Rotation.from_euler("zy", [30, -10], degrees=True).as_matrix()
    gap = np.where(np.isfinite(distance), 0, -1).astype(np.int32)
    light = np.ones(200, np.float32)
    return writers.SensorScan(
        position, rotation, direction, distance, gap, (gap + 1).astype(np.uint8), light, light, NoElements()
    )


@pytest.mark.parametrize("ending", [".ply", ".pcd", ".e57", ".csv", ".npz"])
@pytest.mark.parametrize("place", [POSE, POSE + GRID], ids=["near", "national grid"])
def test_what_jaxmm_scan_writes_is_read_again(tmp_path, ending, place):
    path, scan = tmp_path / f"scan{ending}", scan_of(place)
    writers.write_scan(path, scan)
    (found,) = read_scans(path)
    np.testing.assert_allclose(found.points, writers.world_points(scan), atol=1e-3)
    if ending in (".pcd", ".e57", ".npz"):
        np.testing.assert_allclose(found.position, scan.position, atol=1e-6)
        np.testing.assert_allclose(found.rotation, scan.rotation, atol=1e-6)
    else:
        assert found.position is None and found.rotation is None
    assert found.in_world == (ending in (".pcd", ".e57", ".npz"))


def write_ply_ascii(path):
    lines = [f"{x} {y} 7 {z}" for x, y, z in NATIONAL]
    header = "ply\nformat ascii 1.0\nelement vertex 300\nproperty double x\nproperty double y\nproperty int id\n"
    path.write_text(header + "property double z\nend_header\n" + "\n".join(lines) + "\n")


def write_ply_big(path):
    header = "ply\nformat binary_big_endian 1.0\nelement vertex 300\n" + "".join(
        f"property double {a}\n" for a in "xyz"
    )
    path.write_bytes((header + "end_header\n").encode() + NATIONAL.astype(">f8").tobytes())


def write_las(path, points=NATIONAL, kind=0):
    import laspy

    cloud = laspy.create(point_format=kind)
    cloud.header.offsets, cloud.header.scales = GRID, [1e-4] * 3
    cloud.x, cloud.y, cloud.z = points.T
    cloud.write(path)


def write_pcd(encoding):
    def write(path):
        from pypcd4 import Encoding, PointCloud

        kinds = (np.float64,) * 3
        PointCloud.from_points(list(NATIONAL.T), ("x", "y", "z"), kinds).save(path, encoding=Encoding(encoding))

    return write


def write_text(pattern, header=""):
    return lambda path: path.write_text(header + "\n".join(pattern.format(*point) for point in NATIONAL) + "\n")


@pytest.mark.parametrize(
    "name, write",
    [
        ("ascii.ply", write_ply_ascii),
        ("big.ply", write_ply_big),
        ("plain.las", write_las),
        ("packed.laz", write_las),
        *((f"{kind}.pcd", write_pcd(kind)) for kind in ("ascii", "binary", "binary_compressed")),
        ("thesis.csv", write_text("{};{};{};3", "X;Y;Z;categoryID\n")),
        ("commas.csv", write_text("9,{2},{1},{0}", "id,z,y,x\n")),
        ("bare.csv", write_text("{},{},{}")),
        ("plain.xyz", write_text("{} {} {} 0.5")),
        ("tabs.txt", write_text("{}\t{}\t{}")),
        ("array.npy", lambda path: np.save(path, NATIONAL)),
        ("wide.npy", lambda path: np.save(path, np.column_stack([NATIONAL, NATIONAL]))),
        ("points.npz", lambda path: np.savez(path, points=NATIONAL)),
    ],
)
def test_what_others_write_is_read(tmp_path, name, write):
    if name.endswith((".las", ".laz")):
        pytest.importorskip("laspy")
    if name.endswith(".pcd"):
        pytest.importorskip("pypcd4")
    write(tmp_path / name)
    (found,) = read_scans(tmp_path / name)
    np.testing.assert_allclose(found.points, NATIONAL, atol=2e-4)
    assert found.points.dtype == np.float64 and found.position is None and found.remarks == ()


ENDINGS = [".ply", ".pcd", ".e57", ".las", ".laz", ".csv"]


@pytest.mark.parametrize("block", [1, 7, 300])
@pytest.mark.parametrize("ending", ENDINGS)
def test_blocks_of_any_size_give_the_same_points(tmp_path, monkeypatch, ending, block):
    path, scan = tmp_path / f"scan{ending}", scan_of(POSE)
    write_las(path) if ending[:3] == ".la" else writers.write_scan(path, scan)
    (whole,) = read_scans(path)
    for module in (raw_scans, e57, las, pcd, text):
        monkeypatch.setattr(module, "BLOCK", block)
    (found,) = read_scans(path)
    np.testing.assert_allclose(found.points, whole.points, rtol=0, atol=1e-12)


@pytest.mark.parametrize("kind", [0, 6])
@pytest.mark.parametrize("ending", [".las", ".laz"])
def test_scaled_integers_lose_nothing_over_many_chunks(tmp_path, ending, kind):
    pytest.importorskip("lazrs")
    points = GRID + RNG.integers(-(10**6), 10**6, (120_000, 3)) * 1e-4  # LAZ packs 50,000 at a time
    write_las(tmp_path / f"a{ending}", points, kind)
    (found,) = read_scans(tmp_path / f"a{ending}")
    np.testing.assert_allclose(found.points, points, rtol=0, atol=2e-9)  # what float64 holds of a national grid


def test_points_without_coordinates_are_left_out_and_told(tmp_path):
    points = NATIONAL.copy()
    points[3], points[8, 1] = np.nan, np.inf
    np.save(tmp_path / "a.npy", points)
    (found,) = read_scans(tmp_path / "a.npy")
    assert len(found.points) == 298 and found.remarks[0].startswith("2 of 300 points")


@pytest.mark.parametrize("ending", sorted(READERS))
@pytest.mark.parametrize("content", [b"", b"x", b"\x00" * 500, b"ply\n" + b"\xff" * 300, b"PK\x03\x04" + b"1" * 60])
def test_rubbish_is_one_line(tmp_path, ending, content):
    path = tmp_path / f"bad{ending}"
    path.write_bytes(content)
    with pytest.raises(InputError, match=str(path)) as caught:
        read_scans(path)
    assert "\n" not in str(caught.value) and len(str(caught.value)) < 600


def test_what_is_pickled_is_never_unpickled(tmp_path):
    np.save(tmp_path / "a.npy", np.array([{"a": 1}], object))
    np.savez(tmp_path / "a.npz", points=np.array([{"a": 1}], object))
    for name in ("a.npy", "a.npz"):
        with pytest.raises(InputError, match="to hold numbers, got pickled objects"):
            read_scans(tmp_path / name)


def test_promises_beyond_the_file_are_refused(tmp_path):
    header = "ply\nformat binary_little_endian 1.0\nelement vertex 1000000000\n"
    header += "".join(f"property float {axis}\n" for axis in "xyz") + "end_header\n"
    (tmp_path / "a.ply").write_bytes(header.encode() + b"\0" * 120)
    with pytest.raises(InputError, match="promises 1000000000"):
        read_scans(tmp_path / "a.ply")


@pytest.mark.parametrize(
    "points, word", [(np.zeros((5, 3)), "the same one"), (np.full((4, 3), np.nan), "none among 4"),
                     (np.zeros((5, 2)), r"\(N, 3\)"), (np.zeros((0, 3)), "none among 0")],
)  # fmt: skip
def test_points_that_are_none_are_refused(tmp_path, points, word):
    np.save(tmp_path / "a.npy", points)
    with pytest.raises(InputError, match=word):
        read_scans(tmp_path / "a.npy")


def test_real_scans(data_root):
    pytest.importorskip("pye57")
    folder = data_root / "scans"
    assert len(read_scans(folder / "pcl_office1.pcd")[0].points) == 254_456
    assert len(read_scans(folder / "pye57_pump.e57")[0].points) == 155_201


@pytest.mark.parametrize(
    "body, why",
    [("1 2 3\n" * 5, "truncated: expected 10 points as its header promises, found 5"),
     ("1 2 3\n" * 5 + "3 0 1 2\n" * 6, "expected 10 vertices of 3 numbers")],
    ids=["too few", "faces instead"],
)  # fmt: skip
def test_text_that_is_no_vertices_is_refused(tmp_path, body, why):
    header = "ply\nformat ascii 1.0\nelement vertex 10\n" + "".join(f"property float {axis}\n" for axis in "xyz")
    (tmp_path / "a.ply").write_text(header + "end_header\n" + body)
    with pytest.raises(InputError) as told:
        read_scans(tmp_path / "a.ply")
    assert str(told.value).startswith(f"{tmp_path / 'a.ply'}: {why}")


@pytest.mark.parametrize("gone", [0.0, np.nan, np.inf])
def test_points_that_are_left_out_anywhere_leave_all_others_in_their_order(tmp_path, monkeypatch, gone):
    """They are moved together in blocks, in place."""
    monkeypatch.setattr(raw_scans, "BLOCK", 7)
    points, lost = POINTS.copy(), np.random.default_rng(3).random(300) < 0.4
    points[lost] = gone
    np.save(tmp_path / "a.npy", points)
    (found,) = read_scans(tmp_path / "a.npy")
    np.testing.assert_array_equal(found.points, POINTS[~lost])
    assert f"{lost.sum()} of 300 points" in found.remarks[0]


def test_rays_of_an_npz_file_that_brought_nothing_back_are_known(tmp_path):
    """One in each place, in the sensor's frame; directions that are none are none of them."""
    scan = scan_of(POSE)
    scan.directions[7] = scan.directions[0]  # of two in one place one is enough
    scan.directions[14] = np.nan
    scan.directions[21] *= 3.0
    writers.write_scan(tmp_path / "a.npz", scan)
    (found,) = read_scans(tmp_path / "a.npz")
    wanted = scan.directions[~np.isfinite(scan.distance)]
    wanted = np.delete(wanted, [1, 2], axis=0)
    wanted /= np.linalg.norm(wanted, axis=1, keepdims=True)
    assert found.unseen.dtype == np.float32 and len(found.unseen) == len(wanted)
    apart = np.linalg.norm(found.unseen[:, None] - wanted[None], axis=2)
    assert apart.min(axis=0).max() < 1e-6 and len(np.unique(apart.argmin(axis=1))) == len(wanted)


@pytest.mark.parametrize("name, value, words", [
    ("distance", -1.0, "expected distances of 0 and more, got -1"),
    ("distance", np.inf, "expected rays that come back, got 200 of which none does"),
    ("origin", np.nan, "expected a finite origin and rotation of the sensor"),
])  # fmt: skip
def test_rays_that_are_none_are_named(tmp_path, name, value, words):
    scan = scan_of(POSE)
    writers.write_scan(tmp_path / "a.npz", scan)
    arrays = dict(np.load(tmp_path / "a.npz"))
    arrays[name] = np.full_like(arrays[name], value)
    np.savez(tmp_path / "a.npz", **arrays)
    with pytest.raises(InputError, match=f"a.npz: {words}"):
        read_scans(tmp_path / "a.npz")
