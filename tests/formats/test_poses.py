"""Poses as users give them."""

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jaxmm.formats.poses import OPTICAL, GivenPose, parse_pose, read_poses
from jaxmm.inputs import InputError
from warp_scanner.sensors.poses import rotation_of


def test_numbers_and_files_give_the_same_pose(tmp_path):
    path = tmp_path / "poses.json"
    path.write_text(json.dumps([{"position": [1, 2.5, -3], "yaw": 30, "pitch": -10}, {"position": [0, 0, 0]}]))
    first, second = read_poses([str(path)])
    (same,) = read_poses(["1,2.5,-3,30,-10"])
    np.testing.assert_array_equal(first.position, same.position)
    assert (first.yaw, first.pitch) == (same.yaw, same.pitch) and (second.yaw, second.pitch) == (0.0, 0.0)
    assert len(read_poses([str(path), "1,2,3,4"])) == 3


def test_some_scans_may_keep_their_own_pose(tmp_path):
    path = tmp_path / "poses.json"
    path.write_text(json.dumps([None, {"position": [0, 0, 0]}]))
    own, given, other, last = read_poses([str(path), "own", "1,2,3,4"])
    assert own is None and other is None and given.yaw == 0.0 and last.yaw == 4.0


@pytest.mark.parametrize("seed", range(20))
def test_rotations_are_the_scanners(seed):
    yaw, pitch = np.random.default_rng(seed).uniform([-180, -90], [180, 90])
    np.testing.assert_allclose(parse_pose(f"0,0,0,{yaw},{pitch}").rotation, rotation_of([yaw], [pitch])[0], atol=1e-6)


@pytest.mark.parametrize(
    "text", ["", "1,2,3", "1,2,3,4,5,6,7", "a,b,c,d", "nan,0,0,0", "0,0,0,0,91", "1e10,0,0,0", "1;2;3;4"]
)
def test_what_is_no_pose_is_refused_in_one_line(text):
    with pytest.raises(InputError, match="--pose: expected") as told:
        parse_pose(text)
    assert "\n" not in str(told.value)


@pytest.mark.parametrize(
    "content",
    ["", "{", "[]", "3", "null", '{"position": [1, 2]}', '{"position": [1, 2, "x"]}', '{"position": [1, 2, true]}',
     '{"position": [1, 2, 3], "yaw": null}', '{"position": [1, 2, 1e99]}', "[" * 100_000,
     '{"position": [1, 2, 3], "Yaw": 90}', '{"position": [1, 2, 3], "yaw": 90, "quaternion": [0, 0, 0, 1]}',
     '{"position": [1, 2, 3], "quaternion": [0, 0, 0, 2]}', '{"position": [1, 2, 3], "quaternion": [0, 0, 1]}',
     '{"matrix": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, -1, 0], [0, 0, 0, 1]]}', "[[1, 0, 0, 0], [0, 1, 0, 0]]",
     '{"matrix": [[2, 0, 0, 0], [0, 2, 0, 0], [0, 0, 2, 0], [0, 0, 0, 1]]}', '{"matrix": 3}',
     '{"position": [1, 2, 3], "quaternion": [1e400, 0, 0, 1]}',
     '{"position": [1' + 400 * "0" + ", 0, 0]}"],
)  # fmt: skip
def test_files_without_poses_are_refused_in_one_line(tmp_path, content):
    path = tmp_path / "pose.json"
    path.write_text(content)
    with pytest.raises(InputError, match=r"pose\.json") as told:
        read_poses([str(path)])
    assert "\n" not in str(told.value)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(InputError, match=r"nothing\.json: cannot be read"):
        read_poses([str(tmp_path / "nothing.json")])


def random_turns(count):
    """Rotations of every kind, and those that look straight up and down."""
    turns = Rotation.random(count, rng=5).as_matrix()
    straight = [Rotation.from_euler("ZYX", [30, sign * 90, 0], degrees=True).as_matrix() for sign in (-1, 1)]
    return [*turns, *straight, np.eye(3)]


def test_matrices_quaternions_and_trajectories_are_the_poses_that_they_say(tmp_path):
    turns = random_turns(2000)
    places = np.random.default_rng(1).uniform(-50, 50, (len(turns), 3))
    matrices = [
        np.block([[turn, place[:, None]], [np.zeros((1, 3)), 1.0]]) for turn, place in zip(turns, places, strict=True)
    ]
    quaternions = [Rotation.from_matrix(turn).as_quat() for turn in turns]
    files = {
        "matrices.json": json.dumps([matrix.tolist() for matrix in matrices]),
        "named.json": json.dumps([{"matrix": matrix.tolist()} for matrix in matrices]),
        "transposed.json": json.dumps([matrix.T.tolist() for matrix in matrices]),
        "quaternions.json": json.dumps(
            [{"position": list(p), "quaternion": list(q)} for p, q in zip(places, quaternions, strict=True)]
        ),
        "poses.tum": "# a trajectory\n\n"
        + "".join(
            f"{n} {' '.join(map(repr, map(float, (*p, *q))))}\n"
            for n, (p, q) in enumerate(zip(places, quaternions, strict=True))
        ),
    }
    for name, text in files.items():
        (tmp_path / name).write_text(text)
        found = read_poses([str(tmp_path / name)])
        assert len(found) == len(turns), name
        np.testing.assert_allclose([pose.position for pose in found], places, atol=1e-9, err_msg=name)
        np.testing.assert_allclose([pose.rotation for pose in found], turns, atol=1e-7, err_msg=name)


def test_roll_turns_the_right_side_down_and_comes_back_as_an_angle(tmp_path):
    rolled = parse_pose("1,2,3,40,-20,30")
    level = parse_pose("1,2,3,40,-20")
    np.testing.assert_allclose(rolled.rotation[:, 0], level.rotation[:, 0], atol=1e-12)  # it looks the same way
    assert -rolled.rotation[2, 1] < -level.rotation[2, 1] - 0.4  # to the right is lower
    (tmp_path / "pose.json").write_text(json.dumps({"position": [1, 2, 3], "yaw": 40, "pitch": -20, "roll": 30}))
    (same,) = read_poses([str(tmp_path / "pose.json")])
    np.testing.assert_array_equal(same.rotation, rolled.rotation)


def test_a_matrix_is_of_the_frame_of_the_points_and_angles_are_of_the_view(tmp_path):
    """A camera that looks along world y: its optical z is world y, its x is world x, its y points down."""
    turn = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
    matrix = np.block([[turn, np.array([[1.0], [2.0], [3.0]])], [np.zeros((1, 3)), 1.0]])
    (tmp_path / "pose.json").write_text(json.dumps(matrix.tolist()))
    (given,) = read_poses([str(tmp_path / "pose.json")])
    sensor = given.seen_from("optical")
    np.testing.assert_allclose([sensor.yaw, sensor.pitch, sensor.roll], [90.0, 0.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(sensor.rotation @ OPTICAL, turn, atol=1e-12)
    assert given.seen_from("sensor") is given
    by_angles = GivenPose(np.zeros(3), 90.0, 0.0)
    assert by_angles.seen_from("optical") is by_angles


@pytest.mark.parametrize(
    "line", ["0 1 2 3 0 0 0", "0 1 2 3 0 0 0 2", "0 1 2 3 0 0 0 x", "0 1 2 3 0 0 0 nan", "", "# x"]
)
def test_what_is_no_trajectory_is_refused_in_one_line(tmp_path, line):
    path = tmp_path / "poses.tum"
    path.write_text(f"0 1 2 3 0 0 0 1\n{line}\n" if line.strip("# x") else f"{line}\n")
    with pytest.raises(InputError, match=r"poses\.tum: .*TUM") as told:
        read_poses([str(path)])
    assert "\n" not in str(told.value)


@pytest.mark.parametrize("word", ["1," * 400, "x" * 5000, "a\0b", ".", ""])
def test_words_that_no_file_can_be_called_are_no_poses(word):
    with pytest.raises(InputError, match="--pose: expected") as told:
        read_poses([word])
    assert "\n" not in str(told.value)
