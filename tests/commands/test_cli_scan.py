"""`jaxmm scan`: a building and a pose become a scan file; what cannot be scanned ends in one line, code 2."""

import errno
import os
import subprocess
import sys

import numpy as np
import pytest
import trimesh

from jaxmm.commands import cli

Y_UP = trimesh.transformations.rotation_matrix(-np.pi / 2, [1, 0, 0])  # as glTF wants it

HOUSE = ("--sensor", "oak-d-pro-small")
GRAZING = "[imperfections]\ngrazing_dropout = 1.0\ngrazing_start = 30.0\n"


@pytest.fixture(scope="module")
def house(tmp_path_factory):
    """A mesh file of a room of 6 x 4 x 3 m in slabs, with a column in it."""
    scene = trimesh.Scene()
    parts = {
        "floor": ([6.4, 4.4, 0.2], [0, 0, -0.1]),
        "ceiling": ([6.4, 4.4, 0.2], [0, 0, 3.1]),
        "wall east": ([0.2, 4.4, 3], [3.1, 0, 1.5]),
        "wall west": ([0.2, 4.4, 3], [-3.1, 0, 1.5]),
        "wall north": ([6, 0.2, 3], [0, 2.1, 1.5]),
        "wall south": ([6, 0.2, 3], [0, -2.1, 1.5]),
        "column": ([0.5, 0.5, 3], [1.5, 0, 1.5]),
    }
    for name, (size, center) in parts.items():
        box = trimesh.creation.box(extents=size).apply_translation(center)
        scene.add_geometry(box, node_name=name, geom_name=f"geometry {name}")
    path = tmp_path_factory.mktemp("house") / "house.glb"
    path.write_bytes(scene.apply_transform(Y_UP).export(file_type="glb"))
    return path


def test_scans_what_is_there(house, tmp_path, capsys):
    out = tmp_path / "scan.npz"
    assert cli.main(["scan", str(house), "--pose", "-1,0,1.5,0", *HOUSE, "--out", str(out)]) == 0
    assert "64000 returns of 64000 rays" in capsys.readouterr().out
    with np.load(out) as arrays:
        middle = arrays["distance"].reshape(200, 320)[99:101, 159:161]
        names = arrays["guid"][arrays["element"].reshape(200, 320)[100, 160]]
        points = arrays["origin"] + (arrays["direction"] * arrays["distance"][:, None]) @ arrays["rotation"].T
    np.testing.assert_allclose(middle, 2.25, atol=1e-3)  # from -1 to the column's face at 1.25
    assert names == "column"
    assert np.all(np.abs(points) <= np.array([3, 2, 3]) + 1e-4) and points[:, 2].min() > -1e-4


def scanned(house, out, *more):
    """The arrays of one scan from (-1, 0, 1.5), looking along x."""
    assert cli.main(["scan", str(house), "--pose", "-1,0,1.5,0", "--out", str(out), *more]) == 0
    with np.load(out) as arrays:
        return dict(arrays)


def test_a_sensor_reaches_and_errs_as_it_says(house, tmp_path):
    sensor = tmp_path / "sensor.toml"
    flat = 'kind = "spinning"\nazimuth_steps = 720\nelevations = [0.0]\nrange_limits = [1.5, 2.5]\n'
    ideal = scanned(house, tmp_path / "a.npz", "--sensor", "velodyne-16")
    sensor.write_text(flat)
    short = scanned(house, tmp_path / "b.npz", "--sensor", str(sensor))
    kept = np.isfinite(short["distance"])
    assert 0.1 < kept.mean() < 0.9 and np.all(short["element"][~kept] == -1)
    assert short["distance"][kept].min() >= 1.5 and short["distance"][kept].max() <= 2.5
    # A ray is lost the likelier the more it is beyond 30 degrees to the normal of what it hits.
    sensor.write_text(flat.replace("1.5, 2.5", "0.0, 99.0") + GRAZING)
    grazing = scanned(house, tmp_path / "c.npz", "--sensor", str(sensor))
    sensor.write_text(flat.replace("1.5, 2.5", "0.0, 99.0"))
    whole = scanned(house, tmp_path / "c.npz", "--sensor", str(sensor))
    points = whole["origin"] + whole["direction"] * whole["distance"][:, None]
    normal_x = np.abs(np.abs(points[:, 1]) - 2.0) > 1e-3  # on a wall, or a side of the column, that faces along x
    normal_x &= ~((np.abs(points[:, 0] - 1.5) < 0.2499) & (np.abs(np.abs(points[:, 1]) - 0.25) < 1e-3))
    cosine = np.abs(np.where(normal_x, whole["direction"][:, 0], whole["direction"][:, 1]))
    lost = ~np.isfinite(grazing["distance"])
    assert not lost[cosine > 0.867].any() and lost[cosine < 0.5].mean() > 0.3
    first, again, other = (
        scanned(house, tmp_path / "d.npz", "--sensor", "velodyne-16-real", "--seed", seed)["distance"]
        for seed in ("1", "1", "2")
    )
    np.testing.assert_array_equal(first, again)
    both = np.isfinite(first) & np.isfinite(other)
    error = np.abs(first - ideal["distance"])[np.isfinite(first)]
    assert 0.005 < np.median(error) < 0.03 and np.any(first[both] != other[both])


def test_what_cannot_be_scanned_is_one_line(house, tmp_path, refused):
    out = tmp_path / "scan.ply"

    def scan(pose="-1,0,1.5,0", scene=house, out=out, more=HOUSE):
        return ["scan", scene, "--pose", pose, "--out", out, *more]

    refused(scan("3.1,0,1.5,0"), "inside element 'wall east'")
    refused(scan("1.5,0,1.5,0"), "inside element 'column'")
    refused(scan("90,0,1.5,0"), "outside the building", "-3.20 to 3.20", "34.4 m")
    refused(scan("0,0,-5,0"), "--pose 0,0,-5,0: no ray of the sensor comes back")
    refused(["scan", "a.ifc", "--pose", "0,0,1,0", "--out", out, "--unit", "0.001"], "--unit", "a.ifc")
    for pose in ("1,2,3", "a,b,c,d", "1,2,nan,0", "1,2,1,0,91", "", "1,2,3,4,5,6,7"):
        refused(scan(pose), "--pose", "X,Y,Z,YAW")
    for pose in ("1e300,0,1.5,0", "0,-2e9,1.5,0", "0,0,1e10,0,1"):
        refused(scan(pose), "--pose", "within 1e+09 m", pose)
    refused(scan(out=tmp_path / "scan.xyz"), "scan.xyz", ".e57")
    refused(scan(more=["--sensor", "eye"]), "oak-d-pro", "eye: expected a sensor file")
    refused(scan(more=[*HOUSE, "--unit", "0"]), "unit")
    refused(scan(more=[*HOUSE, "--seed", "-1"]), "--seed", "at least 0")
    refused(scan(scene=tmp_path / "none.ifc"), "none.ifc", "nothing there")
    broken = tmp_path / "broken.ifc"
    broken.write_text("no building")
    refused(scan(scene=broken), "broken.ifc", "expected an IFC file")
    refused(scan(out=tmp_path / "broken.ifc" / "scan.ply"), "--out", "broken.ifc")
    assert [path.name for path in tmp_path.iterdir()] == ["broken.ifc"]
    faces = {"f 1 2 3": "NaN or infinity in 1 of 'mesh'", "": "expected a mesh with faces, found none"}
    for face, words in faces.items():
        mesh = tmp_path / "mesh.obj"
        mesh.write_text(f"v nan 0 0\nv 1 0 0\nv 0 1 0\n{face}\n")
        refused(scan(scene=mesh), "mesh.obj", words)


@pytest.mark.parametrize("number", ["ENOSPC", "EDQUOT", "EACCES", "EROFS", "ENOTDIR"])
def test_a_file_that_cannot_be_written_is_named(house, tmp_path, monkeypatch, refused, number):
    number = getattr(errno, number)

    def fail(*_):
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(os, "replace", fail)
    out = tmp_path / "scan.ply"
    refused(["scan", house, "--pose", "-1,0,1.5,0", *HOUSE, "--out", out], out, os.strerror(number))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("suffix", ["ply", "pcd", "e57", "csv", "npz"])
def test_a_file_that_the_system_refuses_to_grow_is_named(house, tmp_path, suffix):
    out = tmp_path / f"scan.{suffix}"
    code = "import resource, sys; resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096))\n"
    code += "from jaxmm.commands import cli; sys.exit(cli.main())"
    arguments = ["scan", house, "--pose", "-1,0,1.5,0", *HOUSE, "--out", out]
    done = subprocess.run([sys.executable, "-c", code, *map(str, arguments)], capture_output=True, text=True)
    assert done.returncode == 2, done.stderr
    assert len(done.stderr.splitlines()) == 1 and f"scan.{suffix}: " in done.stderr
    assert not list(tmp_path.iterdir())


def test_a_place_on_a_national_grid_is_named_in_full(tmp_path, refused):
    box = trimesh.creation.box(extents=[4, 4, 3]).apply_translation([155_000.5, 463_000.5, 1.5])
    path = tmp_path / "far.obj"
    path.write_text(box.export(file_type="obj", digits=4))
    refused(
        ["scan", path, "--pose", "155109.125,463000.5,1.5,0", "--out", tmp_path / "scan.npz"],
        "pose 155109.125, 463000.5, 1.5 is outside", "154998.50 to 155002.50",
    )  # fmt: skip
    assert not (tmp_path / "scan.npz").exists()


def test_says_what_of_a_mesh_is_no_solid_or_was_left_out(tmp_path, capsys):
    fin = "v 0 0 0\nv 4 0 0\nv 0 4 0\nv 4 4 0\nv 2 2 3\nf 1 2 3\nf 2 4 3\nf 2 3 5\nf 1 1 2\n"
    (tmp_path / "fin.obj").write_text(f"o floor\n{fin}")
    arguments = ["scan", tmp_path / "fin.obj", "--pose", "1,0.5,1,45", *HOUSE, "--out", tmp_path / "scan.npz"]
    assert cli.main([str(argument) for argument in arguments]) == 0
    flaw, flat, storey, _ = capsys.readouterr().out.splitlines()
    assert flaw.startswith("not a solid: element 'floor' (floor)") and "two triangles meet in 1 of its edges" in flaw
    assert flat == "note: 1 triangles without area were left out" and "no storeys" in storey


@pytest.mark.parametrize("suffix", ["ply", "pcd", "e57", "csv"])
def test_scans_a_real_building_in_feet(data_root, tmp_path, suffix, capsys):
    pytest.importorskip("ifcopenshell")
    path, out = data_root / "ifc" / "xbim_wall_door_column_4x3.ifc", tmp_path / f"scan.{suffix}"
    assert cli.main(["scan", str(path), "--pose", "-8,9.9,1.5,90", *HOUSE, "--out", str(out)]) == 0
    assert "2 elements" in capsys.readouterr().out and out.stat().st_size > 10_000


def test_a_rolled_camera_sees_the_same_directions_turned_about_its_view(house, tmp_path):
    """By a quarter of a turn what was to the left is above; the middle stays."""
    level, rolled = (scanned_from(house, tmp_path / f"{roll}.npz", f"-1,0,1.5,0,0,{roll}") for roll in (0, 90))
    turn = level["rotation"].T @ rolled["rotation"]
    np.testing.assert_allclose(turn, [[1, 0, 0], [0, 0, -1], [0, 1, 0]], atol=1e-6)
    np.testing.assert_allclose(rolled["rotation"][2, 1], 1.0, atol=1e-6)  # its left is up: its right side is down


def scanned_from(house, out, pose):
    assert cli.main(["scan", str(house), "--pose", pose, *HOUSE, "--out", str(out)]) == 0
    with np.load(out) as arrays:
        return dict(arrays)
