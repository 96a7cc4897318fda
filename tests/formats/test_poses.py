"""Poses as users give them."""

import json

import numpy as np
import pytest

from jaxmm.formats.poses import parse_pose, read_poses
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
    "text", ["", "1,2,3", "1,2,3,4,5,6", "a,b,c,d", "nan,0,0,0", "0,0,0,0,91", "1e10,0,0,0", "1;2;3;4"]
)
def test_what_is_no_pose_is_refused_in_one_line(text):
    with pytest.raises(InputError, match="--pose: expected") as told:
        parse_pose(text)
    assert "\n" not in str(told.value)


@pytest.mark.parametrize(
    "content",
    ["", "{", "[]", "3", "null", '{"position": [1, 2]}', '{"position": [1, 2, "x"]}', '{"position": [1, 2, true]}',
     '{"position": [1, 2, 3], "yaw": null}', '{"position": [1, 2, 1e99]}', "[" * 100_000,
     '{"position": [1, 2, 3], "Yaw": 90}', '{"position": [1, 2, 3], "yaw": 90, "roll": 5}',
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
