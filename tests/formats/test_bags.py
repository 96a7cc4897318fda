"""Bags: every cloud in the world where transforms or odometry tell its place, one scan for a sensor at rest."""

import re

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jaxmm.formats import bags
from jaxmm.formats.readers import read_scans
from jaxmm.inputs import InputError
from tests.cases.bags import KINDS, Types, seen_from, write_bag
from tests.cases.depth_recordings import off_walls, poses

pytest.importorskip("rosbags")
MOUNT = (np.array([0.2, 0.0, 0.3]), Rotation.from_euler("zyx", [90, 5, 0], degrees=True).as_matrix())
ORIGIN = (np.array([1.0, -0.5, 0.0]), Rotation.from_euler("z", 30, degrees=True).as_matrix())


def times(one, other):
    """The pose of a frame whose pose in a second one is `other`, and that one's pose is `one`."""
    return one[0] + one[1] @ other[0], one[1] @ other[1]


def back(one):
    return -one[1].T @ one[0], one[1].T


def robot_of(pose):
    """Where the robot's base is in the odometry's frame, for its sensor to stand at a pose in the map."""
    return times(times(back(ORIGIN), pose), back(MOUNT))


def recording(kind, taken, odometry=False, frame="lidar", step=0.1):
    """Messages of a sensor at poses in the map, one each `step` seconds."""
    types = Types(kind)
    messages = [("/tf_static", 100.0, types.tf(100.0, ("base", frame, MOUNT)))]
    for number, pose in enumerate(taken):
        time = 100.0 + step * number
        if odometry:
            messages.append(("/odom", time, types.odometry(time, "odom", "base", times(pose, back(MOUNT)))))
        else:
            told = types.tf(time, ("map", "odom", ORIGIN), ("/odom", "/base", robot_of(pose)))
            messages.append(("/tf", time, told))
        messages.append(("/points", time, types.cloud(time, frame, seen_from(pose, seed=number))))
    return messages


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("odometry", [False, True], ids=["tf", "odometry"])
def test_messages_in_motion_are_scans_in_the_world_each(tmp_path, kind, odometry):
    taken = poses(5)
    found = read_scans(write_bag(tmp_path / "a", kind, recording(kind, taken, odometry)))
    assert len(found) == 5
    for scan, (place, turn) in zip(found, taken, strict=True):
        assert len(scan.points) == 4000 and off_walls(scan.points) < 1e-5 and scan.remarks == ()
        np.testing.assert_allclose(scan.position, place, atol=1e-9)
        np.testing.assert_allclose(scan.rotation, turn, atol=1e-9)
        assert scan.in_world and scan.frame == "sensor"


@pytest.mark.parametrize("kind", KINDS)
def test_messages_at_rest_are_one_scan(tmp_path, kind):
    one, other = poses(2)
    found = read_scans(write_bag(tmp_path / "a", kind, recording(kind, [one, one, one, other, other, one])))
    assert [len(scan.points) for scan in found] == [12_000, 8_000, 4_000]
    assert max(off_walls(scan.points) for scan in found) < 1e-5


@pytest.mark.parametrize("kind", KINDS)
def test_without_any_pose_the_clouds_tell_whether_the_sensor_stood(tmp_path, kind):
    one = poses(1)[0]
    moved = (one[0] + [0.1, 0.0, 0.0], one[1])
    turned = (one[0], one[1] @ Rotation.from_euler("z", 2, degrees=True).as_matrix())
    types, messages = Types(kind), []
    for number, pose in enumerate([one, one, one, moved, turned, turned]):
        time = 100.0 + 0.1 * number
        messages.append(("/points", time, types.cloud(time, "lidar", seen_from(pose, 20_000, number))))
    found = read_scans(write_bag(tmp_path / "a", kind, messages))
    assert [len(scan.points) for scan in found] == [60_000, 20_000, 40_000]
    for scan, pose in zip(found, (one, moved, turned), strict=True):
        assert off_walls(scan.points @ pose[1].T + pose[0]) < 1e-5
        assert scan.position is None and scan.frame == "sensor" and not scan.in_world


@pytest.mark.parametrize("kind", KINDS)
def test_between_bare_walls_nobody_knows_whether_the_sensor_stood(tmp_path, kind):
    """Two walls and a floor, endless as far as is seen: along them all places look alike."""
    types, rng, messages = Types(kind), np.random.default_rng(0), []
    for number in range(2):
        points = rng.uniform([-20, -1.5, -1], [20, 1.5, 2], (20_000, 3))
        points[::2, 1] = np.sign(points[::2, 1]) * 1.5
        points[1::2, 2] = -1.0
        messages.append(("/points", 100.0 + number, types.cloud(100.0 + number, "lidar", points)))
    assert len(read_scans(write_bag(tmp_path / "a", kind, messages))) == 2


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("order", "<>")
@pytest.mark.parametrize("number", ["f4", "f8"])
def test_rays_without_a_return_of_organised_clouds_are_no_points(tmp_path, kind, order, number):
    points = seen_from(poses(1)[0], 600).reshape(20, 30, 3)
    points[3, 5:9], points[7, 7] = 0.0, np.nan
    types = Types(kind)
    message = types.cloud(100.0, "lidar", points, order, number, padding=13)
    (found,) = read_scans(write_bag(tmp_path / "a", kind, [("/points", 100.0, message)]))
    np.testing.assert_array_equal(found.points, np.delete(points.reshape(-1, 3), [95, 96, 97, 98, 217], axis=0))
    assert found.remarks == ()


@pytest.mark.parametrize("kind", KINDS)
def test_livox_messages_hold_the_same_points(tmp_path, kind):
    pose, types = poses(1)[0], Types(kind)
    points = seen_from(pose, 301)
    sent = np.concatenate([np.zeros((4, 3), np.float32), points])
    messages = [*recording(kind, [pose])[:-1], ("/livox/lidar", 100.0, types.livox(100.0, "lidar", sent))]
    (found,) = read_scans(write_bag(tmp_path / "a", kind, messages))
    np.testing.assert_allclose(found.points, points @ pose[1].T + pose[0], atol=1e-6)
    np.testing.assert_allclose(found.position, pose[0], atol=1e-9)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    "frame, told", [("camera_depth_optical_frame", "optical"), ("map", None), ("velodyne", "sensor"), ("/odom", None)]
)
def test_frames_are_told_by_their_names(tmp_path, kind, frame, told):
    message = Types(kind).cloud(100.0, frame, seen_from(poses(1)[0]))
    (found,) = read_scans(write_bag(tmp_path / "a", kind, [("/points", 100.0, message)]))
    assert found.frame == told and found.position is None


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    "root, moves, posed",
    [
        ("base_link", False, False),
        ("base_link", True, False),
        ("mount", False, False),
        ("hall", True, True),
        ("map", False, True),
    ],
)
def test_only_a_frame_that_stands_still_is_the_world(tmp_path, kind, root, moves, posed):
    """A mount that is told again and again says nothing of where the robot is; nor does an arm that moves on it."""
    types, taken, messages = Types(kind), poses(3), []
    for number, pose in enumerate(taken):
        time = 100.0 + number / 10
        messages.append(("/tf", time, types.tf(time, (root, "lidar", pose if moves else taken[0]))))
        messages.append(("/points", time, types.cloud(time, "lidar", seen_from(pose, seed=number))))
        messages.append(("/own", time, types.cloud(time, root, seen_from(pose, seed=number))))
    path = write_bag(tmp_path / "a", kind, messages)
    assert {scan.position is not None for scan in read_scans(path, "/points")} == {posed}
    assert {scan.frame for scan in read_scans(path, "/own")} == {None if posed else "sensor"}
    assert {scan.position for scan in read_scans(path, "/own")} == {None}


def test_an_optical_frame_keeps_its_name_in_the_world(tmp_path):
    taken = poses(1)
    path = write_bag(tmp_path / "a", "mcap", recording("mcap", taken, frame="camera_optical_frame"))
    (found,) = read_scans(path)
    assert found.frame == "optical" and off_walls(found.points) < 1e-5
    np.testing.assert_allclose(found.rotation, taken[0][1], atol=1e-9)


@pytest.mark.parametrize("kind", KINDS)
def test_poses_between_transforms_are_told_by_them_and_farther_ones_are_none(tmp_path, kind):
    place, turn = poses(1)[0]
    taken = [
        (place + np.array([0.02 * n, 0, 0]), turn @ Rotation.from_rotvec([0, 0, 0.01 * n]).as_matrix())
        for n in range(7)
    ]
    messages = recording(kind, taken)
    silent = [100.1, 100.3, 100.5]  # no transform then
    messages = [one for one in messages if one[0] != "/tf" or min(abs(one[1] - time) for time in silent) > 0.01]
    late = Types(kind).cloud(109.0, "lidar", seen_from(taken[0]))
    found = read_scans(write_bag(tmp_path / "a", kind, [*messages, ("/points", 109.0, late)]))
    assert found[0].remarks == ("1 messages have no pose, as others of /points have, and are left out",)
    assert len(found) == 7 and max(off_walls(scan.points) for scan in found) < 2e-3
    np.testing.assert_allclose([scan.position for scan in found], [pose[0] for pose in taken], atol=2e-3)


@pytest.mark.parametrize("kind", KINDS)
def test_only_one_topic_is_read_and_which_must_be_clear(tmp_path, kind):
    one, other = poses(2)
    types, messages = Types(kind), recording(kind, [one])
    path = write_bag(
        tmp_path / "a", kind, [*messages, ("/camera", 100.0, types.cloud(100.0, "lidar", seen_from(other, 50)))]
    )
    with pytest.raises(InputError, match="expected --topic with one of /camera, /points, as there are several"):
        read_scans(path)
    with pytest.raises(InputError, match="--topic: expected one of /camera, /points, got /lidar"):
        read_scans(path, "/lidar")
    assert len(read_scans(path, "/camera")[0].points) == 50 and len(read_scans(path, "/points")[0].points) == 4000
    path = write_bag(tmp_path / "b", kind, messages[:2])
    with pytest.raises(
        InputError, match=re.escape("PointCloud2 or Livox CustomMsg, found /tf (tf2_msgs/msg/TFMessage)")
    ):
        read_scans(path)


def test_what_fits_into_memory_is_taken_evenly(tmp_path, monkeypatch):
    taken = poses(7)
    path = write_bag(tmp_path / "a", "mcap", recording("mcap", taken))
    monkeypatch.setattr(bags, "MOST_POINTS", 3 * 4000)
    found = read_scans(path)
    np.testing.assert_allclose([scan.position for scan in found], [taken[place][0] for place in (0, 3, 6)], atol=1e-9)
    assert found[0].remarks == ("one of 3 of its 7 messages is read: all hold more points than fit into memory",)


def short(cloud):
    cloud.data = cloud.data[:-1]


def named(cloud):
    cloud.fields[0].name = "range"


def huge(cloud):
    cloud.width = 4_000_000_000


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    "damage, why",
    [
        (short, "/points: expected 1 x 4000 points of 15 bytes, which do not fit into 59999 bytes"),
        (huge, "/points: expected 1 x 4000000000 points of 15 bytes, which do not fit into 60000 bytes"),
        (named, "/points: expected a cloud with the numbers x, y and z once each, got range, ring, x, y, t"),
    ],
)
def test_messages_that_lie_are_refused_in_one_line(tmp_path, kind, damage, why):
    messages = recording(kind, poses(1))
    damage(messages[-1][2])
    path = write_bag(tmp_path / "a", kind, messages)
    with pytest.raises(InputError, match=re.escape(f"{path}: {why}")):
        read_scans(path)


@pytest.mark.parametrize("kind", KINDS)
def test_bags_that_are_cut_off_are_refused_in_one_line(tmp_path, kind):
    path = write_bag(tmp_path / "a", kind, recording(kind, poses(2)))
    file = path if path.is_file() else next(one for one in path.iterdir() if one.suffix in (".mcap", ".db3"))
    data = file.read_bytes()
    for length in (0, 10, 100, len(data) // 2, len(data) - 9):
        file.write_bytes(data[:length])
        for asked in {path, file}:
            with pytest.raises(InputError, match=re.escape(str(path))) as told:
                read_scans(asked)
            assert "\n" not in str(told.value)


def test_a_file_of_a_bag_is_read_without_its_folder(tmp_path):
    for kind, ending in (("sqlite3", ".db3"), ("mcap", ".mcap")):
        path = write_bag(tmp_path / kind, kind, recording(kind, poses(2)))
        (file,) = path.glob(f"*{ending}")
        assert [len(scan.points) for scan in read_scans(file)] == [4000, 4000]


def test_packets_of_a_device_are_no_clouds(data_root):
    with pytest.raises(InputError, match=re.escape("/os_node0/lidar_packets (ouster_ros/msg/PacketMsg)")):
        read_scans(data_root / "real" / "ouster" / "512x10_raw.bag")


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(("stamp", "logged", "told"), [
    (1_772_461_800.5, 1_772_500_000.0, "2026-03-02T14:30:00Z"),
    (0.0, 1_772_461_800.0, "2026-03-02T14:30:00Z"),  # nobody set it
    (51.2, 1_772_461_800.0, "2026-03-02T14:30:00Z"),  # since it was switched on
    (51.2, 51.3, None),  # a simulator's clock
])  # fmt: skip
def test_the_date_of_a_scan_is_that_of_its_message(tmp_path, kind, stamp, logged, told):
    cloud = Types(kind).cloud(stamp, "lidar", seen_from(poses(1)[0]))
    (scan,) = read_scans(write_bag(tmp_path / "a", kind, [("/points", logged, cloud)]))
    assert scan.taken == told


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(("stamps", "logs"), [
    ((1_772_461_800.0, 1_772_721_000.0), (1_772_461_800.0, 1_772_721_000.0)),
    ((1_772_461_800.0, 1_772_721_000.0), (1_772_721_000.0, 1_772_721_000.1)),  # written into a bag later
    ((0.0, 0.0), (1_772_461_800.0, 1_772_721_000.0)),
])  # fmt: skip
@pytest.mark.parametrize("posed", [False, True])
def test_what_was_taken_on_another_day_is_a_scan_of_its_own(tmp_path, kind, stamps, logs, posed):
    types, place, messages = Types(kind), poses(1)[0], []
    for number, (stamp, logged) in enumerate(zip(stamps, logs, strict=True)):
        if posed:
            messages.append(("/tf", logged, types.tf(stamp or logged, ("map", "lidar", place))))
        messages.append(("/points", logged, types.cloud(stamp, "lidar", seen_from(place, 20_000, number))))
    found = read_scans(write_bag(tmp_path / "a", kind, messages))
    assert [len(scan.points) for scan in found] == [20_000, 20_000]
    assert [scan.taken for scan in found] == ["2026-03-02T14:30:00Z", "2026-03-05T14:30:00Z"]
