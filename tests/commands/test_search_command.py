"""`jaxmm detect --pose search` as a user types it, and from Python."""

import numpy as np
import pytest

from jaxmm import DetectSettings, Reading, detect
from jaxmm.files import load_json
from jaxmm.formats.poses import read_poses
from jaxmm.inputs import InputError
from tests.cases.box_building import building_of, table_of
from tests.verdicts.test_pose_search import COLUMN, INNER, ROOM, SPINNING, assert_turned, seen, turned
from warp_scanner.buildings.room_ifc import write_room
from warp_scanner.sensors.sensors import OAK_D_PRO

POSITION, ROTATION = np.array([0.3, -0.4, 1.1]), turned(140.0, 1.0, -1.5)


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A room's room.ifc; scan.npy in the sensor's frame, after its column was taken out; the same of a bare room."""
    from jaxmm.verdicts.priors import prior_of_building

    folder = tmp_path_factory.mktemp("search")
    write_room(folder / "room.ifc", table_of((*ROOM, *INNER, *COLUMN)), 0)
    write_room(folder / "bare.ifc", table_of(ROOM), 0)
    np.save(folder / "scan.npy", seen(prior_of_building(building_of((*ROOM, *INNER))), POSITION, ROTATION))
    np.save(folder / "bare.npy", seen(prior_of_building(building_of(ROOM)), POSITION, ROTATION))
    return folder


def test_the_place_is_found_and_the_report_says_so(files, tmp_path, said):
    arguments = ("--pose", "search", "--out", tmp_path / "out")
    assert said("detect", files / "room.ifc", files / "scan.npy", *arguments) == (0, [])
    told = load_json(tmp_path / "out" / "report.json")
    (scan,) = told["scans"]
    assert scan["pose_source"] == "searched" and scan["doubts"] == []
    np.testing.assert_allclose(scan["pose"][:3], POSITION, atol=0.03)
    assert_turned(scan["pose"][3], 140.0)
    assert any("its pose was searched: " in note and "elsewhere" in note for note in scan["notes"])
    assert [(one["object_type"], one["mismatch_type"]) for one in told["mismatches"]] == [("pillar", "removed")]
    assert "The pose was searched" in (tmp_path / "out" / "report.md").read_text(encoding="utf-8")


def test_places_that_look_alike_are_named_and_nothing_is_written(files, tmp_path, refused):
    arguments = ["detect", files / "bare.ifc", files / "bare.npy", "--pose", "search", "--out", tmp_path / "out"]
    refused(arguments, "bare.npy", "2 places look alike", "0.30,-0.40,1.10,140.", "-0.30,0.40,1.10,-40.")
    assert not (tmp_path / "out").exists()


def test_what_cannot_be_searched_is_refused_before_the_prior_is_read(files, tmp_path, refused):
    """So it is where the prior could not be read."""
    for name in ("broken.ifc", "broken.npy"):
        (tmp_path / name).write_text("nothing of the kind")
    command = ["detect", tmp_path / "broken.ifc", files / "scan.npy", "--pose", "search", "--out", tmp_path / "out"]
    refused([*command, "--sensor", "oak-d-pro"], "--pose search", "80 degrees of azimuth", "at least 150")
    command[1] = tmp_path / "broken.npy"
    refused(command, "--pose search", "broken.npy", "point cloud")
    assert not (tmp_path / "out").exists()


@pytest.mark.long
def test_one_word_counts_for_all_scans_and_each_may_have_its_own(files, tmp_path):
    """Once for two scans; and beside a pose that is given, also in a file."""
    settings = DetectSettings(propose_views=False)
    scans = [files / "scan.npy", tmp_path / "again.npy"]
    np.save(scans[1], np.load(scans[0])[1:])  # two equal ones would be refused
    found = detect(files / "room.ifc", scans, "search", settings=settings)
    assert [one.pose_source for one in found.scans] == ["searched", "searched"]
    (tmp_path / "poses.json").write_text('["search", {"position": [0.3, -0.4, 1.1], "yaw": 140, "pitch": -1}]')
    poses = read_poses([str(tmp_path / "poses.json")])
    assert poses[0] == "search" and read_poses(["search"]) == ["search"]
    found = detect(files / "room.ifc", scans, poses, reading=Reading(frame="sensor"), settings=settings)
    assert [one.pose_source for one in found.scans] == ["searched", "given"]
    for one in found.scans:
        np.testing.assert_allclose(one.pose[:3], POSITION, atol=0.03)
    with pytest.raises(InputError, match="too narrow"):
        detect(files / "room.ifc", scans, "search", reading=Reading(sensor=OAK_D_PRO))
    with pytest.raises(InputError, match="--pose: expected one for each of 2 scans"):
        detect(files / "room.ifc", scans, ["search"] * 3)


def test_a_camera_in_the_file_is_too_narrow(files, tmp_path, refused):
    points = np.load(files / "scan.npy")
    np.save(tmp_path / "narrow.npy", points[np.abs(np.arctan2(points[:, 1], points[:, 0])) < 0.7])
    command = ["detect", files / "room.ifc", tmp_path / "narrow.npy", "--pose", "search", "--out", tmp_path / "out"]
    refused(command, "narrow.npy", "too narrow to search its pose", "79 degrees", "at least 150")
    assert not (tmp_path / "out").exists()


def test_a_spinning_sensor_may_be_named(files):
    found = detect(
        files / "room.ifc", files / "scan.npy", "search", reading=Reading(sensor=SPINNING),
        settings=DetectSettings(propose_views=False),
    )  # fmt: skip
    assert [one.mismatch_type for one in found.mismatches] == ["removed"]
