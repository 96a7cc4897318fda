"""Detections of many stations with poses that are off: what the model alone misleads, other stations hold."""

import numpy as np
import pytest

from jaxmm.commands.detect_files import detect
from jaxmm.formats.poses import GivenPose
from jaxmm.stations.work_folder import Work
from jaxmm.verdicts.settings import DetectSettings
from tests.cases.box_building import scan_of, table_of
from tests.rays.test_joint_poses import LAST, MOVED, PLACES, REACH, SENSOR, motion_of, site
from warp_scanner.buildings.room_ifc import write_room

OFF = np.array([
    [0.1, -0.1, 0.0], [-0.2, 0.1, 0.02], [0.0, 0.0, 0.0], [0.15, 0.2, -0.02], [-0.1, -0.15, 0.0], [0.2, -0.2, 0.01],
])  # fmt: skip
YAW = [0.5, -1.0, 0.0, 1.0, 0.0, 1.5]  # [deg]


@pytest.fixture(scope="module")
def scans(tmp_path_factory):
    """The model, and scans of a building of which one room stands elsewhere, as poses that are off have them."""
    folder = tmp_path_factory.mktemp("site")
    write_room(folder / "model.ifc", table_of(site()), 0)
    files, poses = [], []
    for number, place in enumerate(PLACES):
        motion = motion_of(OFF[number], YAW[number], place)
        points = scan_of(site(MOVED), place, SENSOR, REACH if number == LAST else np.inf).scan.points
        files.append(folder / f"{number}.npy")
        np.save(files[-1], (points @ motion[:3, :3].T + motion[:3, 3]).astype(np.float32))
        poses.append(GivenPose(place + OFF[number], YAW[number], 0.0))
    return folder / "model.ifc", files, poses


@pytest.mark.long
def test_stations_of_a_building_of_which_a_room_was_built_elsewhere(scans):
    model, files, poses = scans
    found = detect(model, files, poses, work=Work(workers=1))
    apart = [np.linalg.norm(np.array(one.pose[:3]) - place) for one, place in zip(found.scans, PLACES, strict=True)]
    assert max(apart) < 0.03
    assert any("held by surfaces that it shares with" in note for note in found.scans[LAST].notes)


@pytest.mark.long
def test_their_order_changes_no_pose(scans):
    model, files, poses = scans
    found, order = detect(model, files, poses, work=Work(workers=1)), [5, 1, 4, 0, 3, 2]
    again = detect(model, [files[one] for one in order], [poses[one] for one in order], work=Work(workers=1))
    assert [one.pose for one in again.scans] == [found.scans[one].pose for one in order]


@pytest.mark.long
def test_one_station_is_laid_upon_the_model_alone(scans):
    model, files, poses = scans
    alone = detect(model, files[LAST], poses[LAST])
    assert np.linalg.norm(np.array(alone.scans[0].pose[:3]) - PLACES[LAST]) > 0.2  # drawn to where the model has it
    some = slice(LAST - 1, None)
    believed = detect(model, files[some], poses[some], settings=DetectSettings(refine=False), work=Work(workers=1))
    assert [one.pose[:3] for one in believed.scans] == [tuple(one.position) for one in poses[some]]
