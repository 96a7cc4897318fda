"""Folders of depth images: every point on the walls that were seen, from where the camera stood; no depth, no point."""

import json
import re

import numpy as np
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation

from jaxmm.formats import depth_images
from jaxmm.formats.poses import parse_pose
from jaxmm.formats.readers import read_scans
from jaxmm.inputs import InputError
from jaxmm.verdicts.scan_frames import own_scan
from tests.cases.depth_recordings import CAMERA, LAYOUTS, depth_of, off_walls, poses, units_of, write_recording

PIXELS = CAMERA["width"] * CAMERA["height"]


@pytest.mark.parametrize("layout", LAYOUTS)
def test_images_in_motion_are_scans_in_the_world_each(tmp_path, layout):
    taken = poses(12)
    write_recording(tmp_path / "a", layout, taken, [depth_of(pose) for pose in taken])
    found = read_scans(tmp_path / "a")
    assert len(found) == 12
    for scan, (place, turn) in zip(found, taken, strict=True):
        assert len(scan.points) == PIXELS and scan.remarks == ()
        assert off_walls(scan.points) < 1.5 / units_of(layout)  # half a unit along the axis; more along a ray aside
        np.testing.assert_allclose(scan.position, place, atol=1e-5)
        np.testing.assert_allclose(scan.rotation, turn, atol=1e-5)
        assert scan.in_world and scan.frame == "optical"


@pytest.mark.parametrize("layout", LAYOUTS)
def test_pixels_without_depth_or_confidence_are_no_points(tmp_path, layout):
    taken = poses(2)
    images = [depth_of(pose) for pose in taken]
    images[0][5:9, 7:20] = 0.0
    images[1][0, :3] = 65535 / units_of(layout)  # as far as 16 bits go: at least so far
    write_recording(tmp_path / "a", layout, taken, images)
    (tmp_path / "a" / "confidence").mkdir()
    confidence = np.full((CAMERA["height"], CAMERA["width"]), 2, np.uint8)
    confidence[40:, 3], confidence[40:, 4] = 0, 1
    for path in (tmp_path / "a" / "depth").iterdir():
        Image.fromarray(confidence).save(tmp_path / "a" / "confidence" / path.name)
    first, second = read_scans(tmp_path / "a")
    assert len(first.points) == PIXELS - 4 * 13 - 8 and len(second.points) == PIXELS - 3 - 8
    assert max(off_walls(scan.points) for scan in (first, second)) < 1.5 / units_of(layout)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_images_at_rest_are_one_scan(tmp_path, layout):
    one, other = poses(2)
    shaken = (one[0] + [0.004, 0, 0], one[1] @ Rotation.from_euler("x", 0.1, degrees=True).as_matrix())
    turned = (one[0], one[1] @ Rotation.from_euler("x", 1.0, degrees=True).as_matrix())
    taken = [one, shaken, one, turned, other, other, one]
    write_recording(tmp_path / "a", layout, taken, [depth_of(pose) for pose in taken])
    found = read_scans(tmp_path / "a")
    assert [len(scan.points) // PIXELS for scan in found] == [3, 1, 2, 1]
    assert max(off_walls(scan.points) for scan in found) < 1.5 / units_of(layout)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_without_a_trajectory_points_are_in_the_cameras_frame_and_a_pose_takes_them_to_the_world(tmp_path, layout):
    pose = parse_pose("0.5,-0.4,0.2,30,-12,5")
    turn = pose.rotation @ [[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]  # x right, y down, z forward
    write_recording(tmp_path / "a", layout, [None], [depth_of((pose.position, turn))], posed=False)
    (found,) = read_scans(tmp_path / "a")
    assert found.position is None and found.frame == "optical"
    for frame in ("world", "sensor", "optical"):  # the format itself says which it is
        own = own_scan(found, pose, frame)
        assert off_walls(own.world(own.points)) < 1.5 / units_of(layout)
        np.testing.assert_allclose(own.rotation, pose.rotation, atol=1e-12)


def test_a_given_pose_counts_more_than_the_trajectory(tmp_path):
    pose, taken = parse_pose("0.5,-0.4,0.2,30,-12,5"), poses(1)
    turn = pose.rotation @ [[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]
    write_recording(tmp_path / "a", "tum", taken, [depth_of((pose.position, turn))])
    (found,) = read_scans(tmp_path / "a")
    own = own_scan(found, pose, "world")
    assert off_walls(own.world(own.points)) < 1e-3
    assert off_walls(found.points) > 0.1


def test_poses_between_those_of_a_trajectory_are_told_by_them(tmp_path):
    place, turn = poses(1)[0]
    steps = [
        (place + np.array([0.01 * step, 0, 0]), turn @ Rotation.from_rotvec([0, 0.02 * step, 0]).as_matrix())
        for step in range(9)
    ]
    write_recording(tmp_path / "a", "tum", steps, [depth_of(step) for step in steps])
    path = tmp_path / "a" / "groundtruth.txt"
    lines = path.read_text().splitlines()
    times = [f"{float(line.split()[0]) / 4 + 75:.4f} {line.partition(' ')[2]}" for line in lines[1::2]]
    path.write_text("\n".join(lines[:1] + times) + "\n")  # every second pose only, and four times as fast
    listed = (tmp_path / "a" / "depth.txt").read_text().splitlines()
    fast = [f"{float(line.split()[0]) / 4 + 75:.4f} {line.split()[1]}" for line in listed[1:]]
    (tmp_path / "a" / "depth.txt").write_text("\n".join([*fast, "999.0 depth/100.000000.png"]) + "\n")
    found = read_scans(tmp_path / "a")
    assert len(found) == 9 and found[0].remarks == ("1 of 10 images have no pose in its trajectory and are left out",)
    for scan, (position, rotation) in zip(found, steps, strict=True):
        np.testing.assert_allclose(scan.position, position, atol=1e-6)
        np.testing.assert_allclose(scan.rotation, rotation, atol=1e-6)
        assert off_walls(scan.points) < 1e-3


def test_plain_images_that_are_numbered_take_poses_in_their_order(tmp_path):
    taken = poses(11)
    write_recording(tmp_path / "a", "plain", taken, [depth_of(pose) for pose in taken])
    for number, path in enumerate(sorted((tmp_path / "a" / "depth").iterdir())):
        path.rename(path.with_name(f"{number}.png"))  # 10 comes behind 9
    assert max(off_walls(scan.points) for scan in read_scans(tmp_path / "a")) < 1e-3


def test_more_images_than_fit_into_memory_are_taken_evenly(tmp_path, monkeypatch):
    taken = poses(7)
    write_recording(tmp_path / "a", "tum", taken, [depth_of(pose) for pose in taken])
    monkeypatch.setattr(depth_images, "MOST_POINTS", 3 * PIXELS)
    found = read_scans(tmp_path / "a")
    np.testing.assert_allclose([scan.position for scan in found], [taken[place][0] for place in (0, 3, 6)], atol=1e-5)
    assert found[0].remarks == ("one of 3 of its 7 images is read: all hold more points than fit into memory",)


def break_json(name, **values):
    def breaks(folder):
        told = json.loads((folder / name).read_text())
        (folder / name).write_text(json.dumps({**told, **values}))

    return breaks


def write(name, text):
    return lambda folder: (folder / name).write_text(text)


def cut(folder):
    path = sorted((folder / "depth").iterdir())[0]
    path.write_bytes(path.read_bytes()[:90])


def save(name, image):
    return lambda folder: Image.fromarray(image).save(folder / "depth" / name)


@pytest.mark.parametrize(
    "layout, breaks, why",
    [
        ("plain", lambda folder: (folder / "intrinsics.json").unlink(), "a: expected a camera beside depth/"),
        ("plain", break_json("intrinsics.json", fx=None), "intrinsics.json: expected numbers fx, fy, cx, cy, width, "),
        ("plain", break_json("intrinsics.json", fx=0), "intrinsics.json: expected a camera of positive lengths"),
        ("plain", break_json("intrinsics.json", width=10**12), "got width 1000000000000"),
        ("plain", break_json("intrinsics.json", depth_scale=0.001), "depth_scale in units per metre, 1000 of mil"),
        ("plain", break_json("intrinsics.json", width=65), "png: expected an image of 65 x 48 pixels, as its"),
        ("plain", write("intrinsics.json", "{"), "intrinsics.json: expected JSON"),
        ("plain", write("intrinsics.json", "[" * 99999), "intrinsics.json: expected JSON"),
        ("plain", write("trajectory.txt", "1 2 3\n"), "trajectory.txt: line 1: expected lines of a TUM trajectory"),
        ("plain", write("trajectory.txt", "7 0 0 0 0 0 0 1\n"), "expected a trajectory with a pose for its images"),
        ("plain", cut, "png: expected a whole PNG image"),
        ("plain", save("100.05.png", np.zeros((48, 64, 3), np.uint8)), "expected a PNG image of 16 bits of grey"),
        ("plain", save("100.05.png", np.zeros((48, 64), np.uint8)), "expected a PNG image of 16 bits of grey"),
        ("plain", lambda folder: (folder / "confidence").mkdir(), "png: expected a PNG image of 8 bits of grey, fo"),
        ("tum", write("depth.txt", "x depth/1.png\n"), "depth.txt: line 1: expected a time and an image, got"),
        ("tum", write("depth.txt", "1 depth/1.png\n"), "depth.txt: expected the times of images in depth/, got none"),
        ("stray", write("camera_matrix.csv", "1,2\n3,4\n"), "csv: expected a matrix of 3 x 3, got (2, 2)"),
        ("stray", write("camera_matrix.csv", "1;2\n"), "camera_matrix.csv: expected rows of numbers"),
        ("stray", write("odometry.csv", "frame, x\n0, 1\n"), "odometry.csv: expected the columns frame, x, y, z, qx"),
        ("record3d", write("metadata.json", "[]"), "metadata.json: expected an object of JSON, got list"),
        ("record3d", break_json("metadata.json", K=[1, 2]), "metadata.json: expected K, w, h and poses as Record3D"),
        ("record3d", break_json("metadata.json", poses=[[0, 0, 0, 1, 0, 0, 0]]), "a pose for each of 2 images, got 1"),
        ("record3d", break_json("metadata.json", poses=2 * [7 * [0]]), "metadata.json: expected poses with finite"),
    ],
)  # fmt: skip
def test_damage_is_one_line_that_names_the_file(tmp_path, layout, breaks, why):
    taken = poses(2)
    write_recording(tmp_path / "a", layout, taken, [depth_of(pose) for pose in taken])
    breaks(tmp_path / "a")
    with pytest.raises(InputError, match=re.escape(why)) as told:
        read_scans(tmp_path / "a")
    assert "\n" not in str(told.value) and str(told.value).startswith(str(tmp_path / "a"))


def test_other_folders_are_refused(tmp_path):
    with pytest.raises(InputError, match=re.escape("expected depth/*.png of depth images, found none")):
        read_scans(tmp_path)


def test_images_in_which_nothing_came_back_are_left_out(tmp_path):
    taken = poses(3)
    images = [depth_of(pose) for pose in taken]
    images[0][:] = 0.0
    write_recording(tmp_path / "a", "tum", taken, images)
    found = read_scans(tmp_path / "a")
    assert len(found) == 2 and found[0].remarks == ("1 of 3 scans hold no points and are left out",)
