"""Files of every kind through `detect`: several scans with poses of their own, map grids, and where reports may go."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jaxmm import detect
from jaxmm.commands import detect_files
from jaxmm.commands.detect_options import notes_in_short
from jaxmm.files import _clear_unfinished, check_empty, load_json, write_folder
from jaxmm.formats.poses import OPTICAL, GivenPose, parse_pose, read_poses
from jaxmm.ifc.update import write_update
from jaxmm.inputs import InputError
from jaxmm.reports import drawing_process
from jaxmm.verdicts.settings import DetectSettings
from tests.cases.detections import true_case
from warp_scanner.buildings.ifc_files import read_ifc

BELIEVED = DetectSettings(refine=False, propose_views=False)
MAP = np.array([155_000.25, 463_000.5, 12.0])  # [m] on a national grid


@pytest.fixture(scope="module")
def room(tmp_path_factory):
    """Folder with a room's room.ifc and, as `jaxmm scan` writes them, a/scan and b/scan, two looks from one place."""
    from jaxmm.commands import cli

    folder = tmp_path_factory.mktemp("room")
    case = true_case(folder)
    x, y, z, yaw, pitch = case.detection.scans[0].pose
    for name, turn in (("a", 0.0), ("b", 100.0)):
        (folder / name).mkdir()
        pose = f"{x:.5f},{y:.5f},{z:.5f},{yaw + turn:.5f},{pitch:.5f}"
        for ending in (".npz", ".pcd"):
            out = folder / name / f"scan{ending}"
            arguments = ["scan", case.ifc, "--pose", pose, "--sensor", "oak-d-pro-small", "--out", out]
            assert cli.main([str(argument) for argument in arguments]) == 0
    return folder, case


def rays(folder, name):
    """Points (N, 3) in the sensor's frame, its position and its rotation."""
    arrays = np.load(folder / name / "scan.npz")
    hit = np.isfinite(arrays["distance"])
    return arrays["direction"][hit] * arrays["distance"][hit, None].astype(float), arrays["origin"], arrays["rotation"]


def in_world(folder, name):
    points, origin, rotation = rays(folder, name)
    return points @ rotation.T + origin


def close_to(record, position, rotation):
    """Whether a scan of the report stands, after registration, where it was taken from."""
    forward = np.asarray(rotation)[:, 0]
    turn = (record.pose[3] - np.degrees(np.arctan2(forward[1], forward[0])) + 180.0) % 360.0 - 180.0
    return np.abs(np.array(record.pose[:3]) - position).max() < 0.05 and abs(turn) < 1.0


def test_an_e57_file_of_two_scans_says_all(room, tmp_path, monkeypatch, said):
    """Reported into the empty folder that the user stands in."""
    pye57 = pytest.importorskip("pye57")
    folder, case = room
    with pye57.E57(str(tmp_path / "both.e57"), mode="w") as file:
        for name in "ab":
            points, origin, rotation = rays(folder, name)
            columns = {f"cartesian{axis}": points[:, number].copy() for number, axis in enumerate("XYZ")}
            x, y, z, w = Rotation.from_matrix(rotation).as_quat()
            file.write_scan_raw(columns, rotation=np.array([w, x, y, z]), translation=origin)
    arguments = ["--sensor", "oak-d-pro-small", "--classes", "wall,column", "--classes", "slab"]
    (tmp_path / "out").mkdir()
    monkeypatch.chdir(tmp_path / "out")
    assert said("detect", *arguments, case.ifc, tmp_path / "both.e57", "--out", ".") == (0, [])
    told = load_json(tmp_path / "out" / "report.json")
    assert [one["file"] for one in told["scans"]] == ["both.e57#0", "both.e57#1"]
    assert [one["pose_source"] for one in told["scans"]] == ["file", "file"] and told["mismatches"] == []
    assert [one["points"] for one in told["scans"]] == [len(rays(folder, name)[0]) for name in "ab"]
    yaws = [one["pose"][3] for one in told["scans"]]
    assert (yaws[1] - yaws[0]) % 360.0 == pytest.approx(100.0, abs=1.0)
    assert told["settings"]["classes"] == ["wall", "column", "slab"]
    assert {one["ifc_class"] for one in told["elements"]} == {"IfcWall", "IfcColumn", "IfcSlab"}


def test_scans_of_any_kind_together(room, tmp_path):
    """PCD with viewpoints, of one name in two folders; LAS, which says nothing of where it is from."""
    laspy = pytest.importorskip("laspy")
    folder, case = room
    cloud = laspy.create(point_format=0)
    cloud.header.scales = [1e-4] * 3
    cloud.x, cloud.y, cloud.z = in_world(folder, "a").T
    cloud.write(tmp_path / "c.las")
    found = detect(case.ifc, (folder / "a" / "scan.pcd", folder / "b" / "scan.pcd", tmp_path / "c.las"))
    assert [one.file for one in found.scans] == ["a/scan.pcd", "b/scan.pcd", "c.las"]
    assert [one.pose_source for one in found.scans] == ["file", "file", "estimated"]
    for one, name in zip(found.scans, "aba", strict=True):
        assert close_to(one, *rays(folder, name)[1:])
    assert found.mismatches == ()


def test_one_scan_may_get_a_pose_and_another_keep_that_of_its_file(room, tmp_path):
    folder, case = room
    scans = [folder / name / "scan.pcd" for name in "ab"]
    origin = rays(folder, "a")[1]
    yaw, pitch = case.detection.scans[0].pose[3:]
    given = parse_pose(f"{','.join(f'{value:.6f}' for value in origin)},{yaw},{pitch}")
    found = detect(case.ifc, scans, [given, None])
    assert [one.pose_source for one in found.scans] == ["given", "file"]
    for one, name in zip(found.scans, "ab", strict=True):
        assert close_to(one, *rays(folder, name)[1:])
    with pytest.raises(InputError, match=r"expected one for each of 2 scans \(or own\), got 1"):
        detect(case.ifc, scans, [None])


def test_a_camera_with_something_right_before_it_stands_where_the_prior_was_scanned_from(room, tmp_path):
    """A quarter of the view is gone, as where it was filtered out; the pose was never written down."""
    folder, _ = room
    points, (in_sensor, position, rotation) = in_world(folder, "a"), rays(folder, "a")
    part = points[in_sensor[:, 1] > -0.35 * in_sensor[:, 0]]
    for name, cloud in (
        ("before.npy", points),
        ("after.npy", part),
        ("elsewhere.npy", points + np.array([0.5, 0.0, 0.0])),
    ):
        np.save(tmp_path / name, cloud)
    found = detect(tmp_path / "before.npy", tmp_path / "after.npy")
    assert found.scans[0].pose_source == "estimated" and close_to(found.scans[0], position, rotation)
    assert any("from the points of the prior" in note for note in found.scans[0].notes)
    why = r"after\.npy: the viewpoint cannot be estimated: at best its points touch.*only a camera's can be"
    with pytest.raises(InputError, match=why):
        detect(tmp_path / "elsewhere.npy", tmp_path / "after.npy")


def test_a_scan_and_pose_on_the_map_are_brought_into_the_building(room, tmp_path):
    ifcopenshell = pytest.importorskip("ifcopenshell")
    folder, case = room
    model = ifcopenshell.open(str(case.ifc))
    context = model.by_type("IfcGeometricRepresentationContext", include_subtypes=False)[0]
    east, north, height = (float(value) for value in MAP)
    model.create_entity(
        "IfcMapConversion", context, model.create_entity("IfcProjectedCRS", "EPSG:28992"), Eastings=east,
        Northings=north, OrthogonalHeight=height, XAxisAbscissa=0.0, XAxisOrdinate=1.0,
    )  # fmt: skip
    model.write(str(tmp_path / "room.ifc"))
    quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    np.save(tmp_path / "scan.npy", in_world(folder, "a") @ quarter.T + MAP)
    _, origin, rotation = rays(folder, "a")
    yaw, pitch = case.detection.scans[0].pose[3:]
    place = ",".join(f"{value:.6f}" for value in origin @ quarter.T + MAP)
    found = detect(tmp_path / "room.ifc", tmp_path / "scan.npy", parse_pose(f"{place},{yaw + 90.0},{pitch}"))
    assert close_to(found.scans[0], origin, rotation) and "IfcMapConversion" in found.scans[0].notes[0]
    assert found.mismatches == () and {one.verdict for one in found.elements} >= {"present"}


@pytest.mark.parametrize("wrong", [{"frame": "x"}, {"unit": 0.0}, {"unit": np.inf}])
def test_a_reading_that_makes_no_sense_is_refused(wrong):
    with pytest.raises(InputError, match=rf"--{next(iter(wrong))}: expected"):
        detect_files.Reading(**wrong)


def test_no_scans_are_refused(room):
    with pytest.raises(InputError, match="expected at least one, got none"):
        detect(room[1].ifc, [])


@pytest.mark.parametrize("place", ["stands in", "links to", "links to nothing", "names anew"])
def test_reports_go_to_any_empty_folder(tmp_path, monkeypatch, place):
    """One that is there stays the same folder: whoever stands in it sees what is written."""
    real = tmp_path / "real"
    out = {"stands in": Path("."), "names anew": real / "deep"}.get(place, tmp_path / "link")
    if place in ("stands in", "links to"):
        real.mkdir()
    if place == "stands in":
        monkeypatch.chdir(real)
    elif place != "names anew":
        out.symlink_to(real)
    before = real.stat().st_ino if real.exists() else None
    write_folder(out, lambda folder: [(folder / name).write_text(name) for name in "ab"])
    assert sorted(path.name for path in out.iterdir()) == ["a", "b"]
    assert before in (None, real.stat().st_ino)
    assert not [path for path in tmp_path.rglob("*") if path.name.startswith(".")]


@pytest.mark.parametrize("there", [False, True])
def test_what_a_killed_process_left_is_removed_and_what_is_being_filled_is_not(tmp_path, there):
    out = tmp_path / "out"
    left = (out if there else tmp_path) / ".out.0abc123_.unfinished"
    others = [tmp_path / name for name in (".other.0abc123_.unfinished", ".out.stations")]
    for folder in (left, *others):
        folder.mkdir(parents=True)
    (left / "plan.png").write_bytes(b"half")

    def write(work):
        write_folder(tmp_path / "out 2", lambda second: None)
        _clear_unfinished(out)  # as another process does meanwhile
        assert work.is_dir() and not left.exists()
        (work / "a").write_text("a")

    check_empty(out, "--out")
    write_folder(out, write)
    assert [path.name for path in out.iterdir()] == ["a"]
    assert sorted(tmp_path.iterdir()) == sorted([out, tmp_path / "out 2", *others])


def test_a_folder_that_cannot_be_filled_stays_as_it_was(room, tmp_path, monkeypatch):
    def full(work, *_):
        (work / "plan.png").write_bytes(b"half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(drawing_process, "_plan", full)
    (tmp_path / "out").mkdir()
    for out in (tmp_path / "out", tmp_path / "other"):
        with pytest.raises(InputError, match="--out: cannot write") as told:
            detect_files.write_all(room[1].detection, tmp_path / "mesh.obj", out)
        assert "No space left" in str(told.value)
    assert [path.name for path in tmp_path.rglob("*")] == ["out"]


def test_nothing_is_deleted_while_a_scan_may_be_of_another_place(tmp_path):
    pytest.importorskip("ifcopenshell")
    case = true_case(tmp_path)
    gone = {one.element for one in case.detection.mismatches}
    for doubted in (False, True):
        doubts = ("is it of this place?",) if doubted else ()
        scans = tuple(one._replace(doubts=doubts) for one in case.detection.scans)
        out = tmp_path / f"out {doubted}"
        told = case.detection._replace(scans=scans)
        said = detect_files.write_all(told, case.ifc, out, apply=True)
        assert any("marked, not deleted" in line for line in said) == doubted
        alone = write_update(case.ifc, told, tmp_path / f"alone {doubted}", apply=True)
        assert set(alone.notes) <= set(said)
        assert set(read_ifc(alone.path).elements.guid) == set(read_ifc(out / "updated.ifc").elements.guid)
        assert ("is it of this place?" in (out / "updated.ifc").read_text()) == doubted
        left = set(read_ifc(out / "updated.ifc").elements.guid)
        assert gone and (gone <= left) == doubted and bool(gone & left) == doubted
        record = load_json(out / "report.json")["scans"][0]
        assert record["doubted"] is doubted and record["doubts"] == list(doubts)


def test_a_given_pose_that_the_file_contradicts_is_doubted(room):
    folder, case = room
    x, y, *rest = case.detection.scans[0].pose
    for off in (0.0, 0.8):
        pose = parse_pose(",".join(map(str, (x + off, y, *rest))))
        doubts = detect(case.ifc, folder / "a" / "scan.npz", [pose], settings=BELIEVED).doubts
        assert any("its pose as given is 0.80 m from the one in its file" in one for one in doubts) == bool(off)


@pytest.mark.long
def test_nothing_is_deleted_while_points_contradict_their_pose(room, tmp_path, capsys):
    pytest.importorskip("ifcopenshell")
    from jaxmm.commands import cli

    folder, case = room
    np.save(tmp_path / "a.npy", in_world(folder, "a"))
    x, y, z, yaw, pitch = case.detection.scans[0].pose
    for turn in (0.0, 90.0):
        pose, out = f"--pose={x},{y},{z},{yaw + turn},{pitch}", tmp_path / f"out {turn}"
        arguments = [case.ifc, tmp_path / "a.npy", pose, "--sensor", "oak-d-pro-small", "--no-refine", "--apply"]
        assert cli.main(["detect", *map(str, arguments), "--out", str(out)]) == 0
        told = load_json(out / "report.json")["scans"][0]
        said = capsys.readouterr().out
        assert told["doubted"] == bool(turn) == ("marked, not deleted" in said)
        assert said.splitlines()[-2].startswith("in doubt: ") == bool(turn)
        assert any("outside the sensor's view" in note for note in told["notes"]) == bool(turn)


def test_an_optical_frame_is_read_and_named_where_it_would_fit(room, tmp_path):
    """The same scan in the frame of its optics, as ROS and Kinect have it, says the same of the room."""
    folder, case = room
    points, origin, rotation = rays(folder, "a")
    optical, expected = tmp_path / "optical.npy", tmp_path / "world.npy"
    np.save(optical, points @ OPTICAL)
    np.save(expected, in_world(folder, "a"))
    matrix = np.block([[rotation @ OPTICAL, origin[:, None]], [np.zeros((1, 3)), 1.0]])
    (tmp_path / "pose.json").write_text(json.dumps(matrix.tolist()))
    (by_matrix,) = read_poses([str(tmp_path / "pose.json")])
    x, y, z, yaw, pitch = case.detection.scans[0].pose
    by_angles = GivenPose(np.array([x, y, z]), yaw, pitch)
    world = detect(case.ifc, expected, by_angles, settings=BELIEVED)
    for pose in (by_matrix, by_angles):
        found = detect(case.ifc, optical, pose, reading=detect_files.Reading(frame="optical"), settings=BELIEVED)
        np.testing.assert_allclose(found.scans[0].pose, world.scans[0].pose, atol=1e-3)
        assert [one.verdict for one in found.elements] == [one.verdict for one in world.elements]
    for wrong in ("world", "sensor"):
        with pytest.raises(InputError, match=r"--frame optical$") as told:
            detect(case.ifc, optical, by_angles, reading=detect_files.Reading(frame=wrong))
        assert "\n" not in str(told.value)


def test_what_many_scans_have_in_common_is_told_once():
    told = [(f"drive#{number}", (f"its ranges err by {10 + number}.5 mm", "dark")) for number in range(6)]
    lines = list(notes_in_short([*told, ("b.ply", ("its ranges err", "dark"))]))
    assert lines == [
        "drive#0: its ranges err by 10.5 mm (and 5 scans more, but for the numbers; report.md has all)",
        "drive#0: dark (and 6 scans more, but for the numbers; report.md has all)",
        "b.ply: its ranges err",
    ]
    few = list(notes_in_short(told[:2]))
    first, second = (f"drive#{number}: its ranges err by {10 + number}.5 mm" for number in range(2))
    assert few == [first, second, "drive#0: dark", "drive#1: dark"]
