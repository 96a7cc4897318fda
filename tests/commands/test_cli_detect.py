"""`jaxmm detect` as a user runs it: files in, a folder of reports out; what cannot be used is refused in one line."""

import json
import subprocess
import sys
from importlib.util import find_spec

import numpy as np
import pytest
import trimesh

from jaxmm.files import load_json, sha256_of
from jaxmm.formats.poses import parse_pose
from jaxmm.formats.readers import read_scans
from jaxmm.inputs import InputError
from jaxmm.verdicts.results import FORMAT
from tests.cases.detections import true_case
from warp_scanner.clouds.points import points_of

OUTPUTS = {
    "report.json", "report.md", "report.html", "sentences.txt", "mismatches.csv", "elements.csv", "deviations.csv",
    "unexplained.csv",
    "mismatches.ply", "points.ply", "mismatches.bcf", "plan.png", "evidence.png", "probability.png", "updated.ifc",
    "undo.json",
}  # fmt: skip


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A room whose pillar moved: its IFC file, the scan as NPY, and the pose in words."""
    folder = tmp_path_factory.mktemp("room")
    case = true_case(folder, "pillar_moved")
    back = np.isfinite(case.pairs.robot.distance[0])
    points = points_of(case.pairs.pose, case.pairs.directions, case.pairs.robot.distance)[0, back]
    np.save(folder / "scan.npy", points)
    return case.ifc, folder / "scan.npy", ",".join(f"{value:.5f}" for value in case.detection.scans[0].pose), case


@pytest.fixture(scope="module")
def report(files, tmp_path_factory):
    from jaxmm.commands import cli

    ifc, scan, pose, _ = files
    out = tmp_path_factory.mktemp("found") / "out"
    before = ifc.read_bytes()
    arguments = ["detect", ifc, scan, "--pose", pose, "--sensor", "oak-d-pro-small", "--out", out]
    assert cli.main([str(argument) for argument in arguments]) == 0
    assert ifc.read_bytes() == before
    return out


NOT_NEEDED = ("jax", "flax", "sklearn", "optax", "orbax", "matplotlib")  # a second and more, of libraries that train


def test_it_loads_nothing_that_it_does_not_need(files, tmp_path):
    ifc, scan, pose, _ = files
    code = (
        "import sys; from jaxmm.commands.cli import main; sys.argv[1:1] = ['detect']; code = main(); "
        f"print([name for name in {NOT_NEEDED} if name in sys.modules]); sys.exit(code)"
    )
    words = [ifc, scan, "--pose", pose, "--sensor", "oak-d-pro-small", "--out", tmp_path / "out"]
    done = subprocess.run([sys.executable, "-c", code, *map(str, words)], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.splitlines()[-1] == "[]"


def test_everything_is_written_and_nothing_else(report):
    workbook = {"elements.xlsx"} if find_spec("openpyxl") else set()
    assert {path.name for path in report.iterdir()} == OUTPUTS | workbook
    assert list(report.parent.iterdir()) == [report]


def test_the_report_says_what_moved(report, files):
    told = load_json(report / "report.json")
    kinds = [(one["object_type"], one["mismatch_type"]) for one in told["mismatches"]]
    assert kinds == [("pillar", "removed"), ("pillar", "added")]
    removed, added = told["mismatches"]
    true = {one.mismatch_type: one for one in files[3].detection.mismatches}
    assert removed["element"] == true["removed"].element and added["moved_from"] == 0
    np.testing.assert_allclose(added["center"], true["added"].center, atol=0.1)
    assert told["sentences"] == (report / "sentences.txt").read_text().splitlines()
    assert {one["verdict"] for one in told["elements"]} == {"present", "removed", "unscanned"}
    assert told["scans"][0]["pose_source"] == "given" and told["registration"]["refined"]
    project = files[3].building.project
    prior = {"file": "room.ifc", "kind": "ifc", "unit": 1.0, "project": project, "sha256": sha256_of(files[0])}
    prior |= {"files": []}
    assert told["prior"] == prior and len(project) == 22
    assert told["format"] == FORMAT and told["scans"][0]["taken"] == {"date": told["date"], "source": "modified"}
    boxes = {one["guid"]: one["box"] for one in told["elements"]}
    np.testing.assert_allclose(boxes[removed["element"]]["center"], true["removed"].center, atol=1e-3)
    np.testing.assert_allclose(boxes[removed["element"]]["dimensions"], true["removed"].dimensions, atol=1e-3)
    assert f"room.ifc, in metres, IfcProject `{project}`." in (report / "report.md").read_text()


def test_revert_gives_the_model_back(report, files, tmp_path, said):
    assert said("revert", report / "updated.ifc", "--out", tmp_path / "before.ifc") == (0, [])
    assert (tmp_path / "before.ifc").read_bytes() == files[0].read_bytes()


def test_the_library_says_the_same(report, files):
    from jaxmm import detect
    from jaxmm.commands.detect_files import Reading
    from warp_scanner.sensors.sensors import OAK_D_PRO_SMALL

    ifc, scan, pose, _ = files
    found = detect(ifc, scan, [parse_pose(pose)], reading=Reading(sensor=OAK_D_PRO_SMALL))
    assert list(found.sentences) == load_json(report / "report.json")["sentences"]
    assert "pillar" in found._repr_html_()


@pytest.mark.parametrize("suffix", [".obj", ".ply", ".glb", ".stl"])
def test_meshes_and_other_scans(files, tmp_path, said, suffix):
    """The same room as a mesh, in y up where the format says so; its scan in millimetres, the pose in a file."""
    _, scan, pose, case = files
    triangles = case.building.triangles
    mesh = trimesh.Trimesh(triangles.vertices, triangles.faces, process=False)
    if suffix == ".glb":
        mesh.apply_transform(trimesh.transformations.rotation_matrix(-np.pi / 2, [1, 0, 0]))
    mesh.export(tmp_path / f"room{suffix}")
    np.save(tmp_path / "mm.npy", np.load(scan) * 1000.0)
    values = [float(value) for value in pose.split(",")]
    (tmp_path / "pose.json").write_text(json.dumps({"position": values[:3], "yaw": values[3], "pitch": values[4]}))
    arguments = ["--pose", tmp_path / "pose.json", "--out", tmp_path / "out"]
    assert said("detect", tmp_path / f"room{suffix}", tmp_path / "mm.npy", *arguments)[0] == 0
    told = load_json(tmp_path / "out" / "report.json")
    assert "millimetres" in told["scans"][0]["notes"][0] and not (tmp_path / "out" / "updated.ifc").exists()
    added = [one for one in told["mismatches"] if one["mismatch_type"] == "added"]
    assert [one["object_type"] for one in added] == ["pillar"]


def test_a_mesh_with_y_up_is_recognised(files, tmp_path, said):
    _, scan, pose, case = files
    triangles = case.building.triangles
    mesh = trimesh.Trimesh(triangles.vertices, triangles.faces, process=False)
    mesh.apply_transform(trimesh.transformations.rotation_matrix(-np.pi / 2, [1, 0, 0]))
    mesh.export(tmp_path / "room.obj")
    assert said("detect", tmp_path / "room.obj", scan, "--pose", pose, "--out", tmp_path / "out")[0] == 0
    assert any("y up" in note for note in load_json(tmp_path / "out" / "report.json")["notes"])


def test_a_cloud_as_prior_and_an_estimated_pose(files, tmp_path, said):
    case = files[3]
    hit = np.isfinite(case.pairs.dt.distance[0])
    np.save(tmp_path / "before.npy", points_of(case.pairs.pose, case.pairs.directions, case.pairs.dt.distance)[0, hit])
    assert said("detect", tmp_path / "before.npy", files[1], "--out", tmp_path / "out")[0] == 0
    told = load_json(tmp_path / "out" / "report.json")
    assert told["elements"] == [] and told["scans"][0]["pose_source"] == "estimated"
    np.testing.assert_allclose(told["scans"][0]["pose"][:3], case.detection.scans[0].pose[:3], atol=0.1)
    assert len(told["scans"][0]["deviation"]) == 5


def test_the_thesis_preset_keeps_its_own_boxes(files, tmp_path, said):
    ifc, scan, pose, _ = files
    assert said("detect", ifc, scan, "--pose", pose, "--preset", "thesis", "--out", tmp_path / "out")[0] == 0
    told = load_json(tmp_path / "out" / "report.json")
    assert told["settings"]["preset"] == "thesis" and told["settings"]["boxes"]["threshold"] == 0.6
    assert all(one["rotation"] == 0.0 for one in told["mismatches"])


def test_a_preset_of_the_settings_counts_unless_another_is_given(files, tmp_path, monkeypatch, said):
    from jaxmm.commands import detect_files

    found = []

    def seen(*_, settings, **__):
        found.append(settings)
        raise InputError("that will do")

    monkeypatch.setattr(detect_files, "detect", seen)
    (tmp_path / "settings.toml").write_text('preset = "thesis"\nclasses = ["door"]\n')
    asked = ["detect", files[0], files[1], "--out", tmp_path / "out", "--settings", tmp_path / "settings.toml"]
    for more in ([], ["--preset", "default"], ["--preset", "thesis", "--classes", "wall, slab"]):
        assert said(*asked, *more)[0] == 2
    assert [one.preset for one in found] == ["thesis", "default", "thesis"]
    assert [one.classes for one in found] == [("door",), ("door",), ("wall", "slab")]


@pytest.mark.parametrize(
    "change, words",
    [
        pytest.param({"prior": "nothing.ifc"}, ["nothing.ifc", "found nothing there"], id="no prior"),
        pytest.param({"prior": "scan.xyzw"}, ["scan.xyzw"], id="a prior of no known kind"),
        pytest.param({"scan": "nothing.ply"}, ["nothing.ply", "nothing there"], id="no scan"),
        pytest.param({"--pose": "1,2,3"}, ["--pose", "expected X,Y,Z,YAW"], id="half a pose"),
        pytest.param({"--pose": "100,100,0,0"}, ["outside the building"], id="a pose outside"),
        pytest.param({"--sensor": "eye"}, ["eye"], id="an unknown sensor"),
        pytest.param({"--settings": "none.toml"}, ["none.toml"], id="no settings"),
        pytest.param({"--classes": "IfcBeam"}, ["--classes", "no element of the class IfcBeam"], id="no such element"),
        pytest.param({"--classes": "wall,roof"}, ["--classes", "got roof", "wall"], id="an unknown class"),
        pytest.param({"--classes": "IfcNonsense"}, ["--classes must be all", "got IfcNonsense"], id="none of IFC"),
        pytest.param({"--pose": "own", "--sensor": "velodyne-16"}, ["--pose search"], id="a scanner without a pose"),
        pytest.param({"--model": "none.safetensors"}, ["none.safetensors"], id="no model"),
        pytest.param({"--unit": "-1"}, ["--unit", "above 0"], id="a negative unit"),
        pytest.param({"--prior-unit": "0.001"}, ["--prior-unit", "IFC"], id="a unit for IFC"),
        pytest.param({"--prior-frame": "optical"}, ["--prior-frame", "only for a point cloud"], id="a frame for IFC"),
        pytest.param(
            {"prior": "scan.npy", "--prior-frame": "optical", "--up": "y"}, ["--up", "--prior-frame"], id="up twice"
        ),
        pytest.param({"prior": "room.obj", "--apply": None}, ["--apply", "only for IFC"], id="a mesh to apply to"),
        pytest.param({"prior": "scan.npy", "--apply": None}, ["--apply", "only for IFC"], id="a cloud to apply to"),
        pytest.param({"prior": "room.obj", "--as-built": None}, ["--as-built", "only for IFC"], id="a mesh as built"),
        pytest.param({"prior": "dots.ply", "--open-doors": None}, ["--open-doors", "point cloud"], id="no doors"),
        pytest.param({"prior": "scan.npy", "--clear-glass": None}, ["--clear-glass", "point cloud"], id="no glass"),
        pytest.param({"--out": "."}, ["--out", "holds something"], id="a folder that is not empty"),
    ],
)
def test_what_cannot_be_used_is_refused(files, refused, tmp_path, change, words):
    ifc, scan, pose, _ = files
    prior = ifc if "prior" not in change else ifc.parent / change.pop("prior")
    scan = scan if "scan" not in change else scan.parent / change.pop("scan")
    (ifc.parent / "scan.xyzw").write_bytes(b"1 2 3")
    (ifc.parent / "room.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    trimesh.PointCloud(np.load(files[1])).export(ifc.parent / "dots.ply")
    asked = {"--pose": pose, "--out": str(tmp_path / "out")} | change
    if asked["--out"] == ".":
        asked["--out"] = str(ifc.parent)
    given = [word for pair in asked.items() for word in pair if word is not None]
    refused(["detect", prior, scan, *given], *words)
    assert not (tmp_path / "out").exists() and not list(tmp_path.iterdir())


def test_a_pose_per_scan_is_needed(files, refused, tmp_path):
    ifc, scan, pose, _ = files
    refused(["detect", ifc, scan, scan, "--pose", pose, "--out", tmp_path / "out"], "--pose", "2 scans", "got 1")
    assert not list(tmp_path.iterdir())


def test_a_scan_of_another_room_is_refused(files, refused, tmp_path):
    ifc, _, pose, _ = files
    rng = np.random.default_rng(0)
    np.save(tmp_path / "other.npy", rng.normal(size=(5000, 3)) * [0.7, 0.7, 0.2] + [60.0, 40.0, 0.0])
    asked = ["detect", ifc, tmp_path / "other.npy", "--pose", pose, "--out", tmp_path / "out"]
    refused(asked, "other.npy", "prior's place")
    assert [path.name for path in tmp_path.iterdir()] == ["other.npy"]


def test_a_scan_that_says_where_it_was_taken_needs_no_pose(files, tmp_path, said):
    """Through `jaxmm scan` and its NPZ file: an unchanged building has no mismatch."""
    ifc, _, pose, _ = files
    assert said("scan", ifc, "--pose", pose, "--sensor", "oak-d-pro-small", "--out", tmp_path / "scan.npz") == (0, [])
    assert read_scans(tmp_path / "scan.npz")[0].position is not None
    assert said("detect", ifc, tmp_path / "scan.npz", "--out", tmp_path / "out")[0] == 0
    told = load_json(tmp_path / "out" / "report.json")
    assert told["mismatches"] == [] and told["scans"][0]["pose_source"] == "file"
