"""Bags of ROS 1 and 2, and MCAP files, as scans, through rosbags: clouds of one topic, with the poses that they tell.

A message is a scan; messages of a sensor at rest are one scan together. Whether it stood still tell the poses; without
any, the clouds do, where something holds them in all directions. After a pause of minutes the next message is a scan of
its own, wherever it was taken: what a building is like is told by its date.
"""

import contextlib
import itertools
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from jaxmm.formats.dates import from_unix
from jaxmm.formats.raw_scans import GrowingPoints, RawScan, check_name, to_world
from jaxmm.formats.ros_frames import FrameTree, RobotPose
from jaxmm.formats.ros_messages import CLOUD, LIVOX, ODOMETRY, TRANSFORMS, Cloud, cloud_of, transforms_of
from jaxmm.formats.standstill import is_rest, looks_at_rest
from jaxmm.inputs import InputError, clipped, one_line

ENDINGS = (".bag", ".mcap", ".db3")
MCAP_START = b"\x89MCAP0\r\n\x01"  # magic, and the kind of the first record
MCAP_HEAD = 1 << 10  # [bytes] that hold its profile
METADATA = "metadata.yaml"  # in the folder of a ROS 2 bag
EXTRA = "needs the extra ros: pip install 'jaxmm[ros]'"
MOST_POINTS = 100_000_000  # of all messages together: more do not fit into usual memory
PAUSE = 600.0  # [s] from message to message of a sensor at rest, at most: what it shows may have changed since
SET = 946_684_800.0  # [s] of the year 2000, since 1970: a clock that tells less counts from a start that nobody knows
OPTICAL = ("_optical", "_optical_frame")  # ends of the names of such frames (ROS Enhancement Proposal 103)


class _Group:
    """Messages of a sensor at rest: in the world where it has a pose, else in the frame of the first.

    Its date is that of the first: its own, or when it was logged, where a clock began when the sensor was switched on.
    """

    def __init__(self, cloud: Cloud, pose: RobotPose | None, logged: float):
        self.frame, self.pose, self.messages, self.points = cloud.frame, pose, 0, GrowingPoints()
        self.date = from_unix(cloud.time) or from_unix(logged)
        self.first: np.ndarray | None = cloud.points if pose is None else None  # whether others look like it
        self.take(cloud, pose, logged)

    def take(self, cloud: Cloud, pose: RobotPose | None, logged: float) -> None:
        """Add the points of a message."""
        self.times = cloud.time, logged
        points = cloud.points.copy()
        if pose is not None:
            to_world(points, pose.rotation, pose.position)
        self.points.append(points)
        self.messages += 1

    def is_rest(self, cloud: Cloud, pose: RobotPose | None, logged: float) -> bool:
        """Whether a message was taken from the same place, soon after the last one: by its own clock, and the log's."""
        if cloud.frame != self.frame or (pose is None) != (self.pose is None):
            return False
        clocks = zip((cloud.time, logged), self.times, strict=True)
        if any(min(now, last) > SET and abs(now - last) > PAUSE for now, last in clocks):
            return False
        return looks_at_rest(self.first, cloud.points) if pose is None else is_rest(self.pose, pose)

    def scan(self, in_world: bool) -> RawScan:
        """All of them as one scan; `in_world` says that their frame stands still, although nobody told the sensor's."""
        optical = self.frame.endswith(OPTICAL)
        frame = None if in_world and self.pose is None else "optical" if optical else "sensor"
        if self.pose is None:
            return RawScan(self.points.points(), frame=frame, taken=self.date)
        return RawScan(self.points.points(), *self.pose, in_world=True, frame=frame, taken=self.date)


def is_bag(path: Path) -> bool:
    """Whether a path is a bag, by its ending or by what its folder holds."""
    return path.suffix.lower() in ENDINGS or (path.is_dir() and (path / METADATA).is_file())


def read_bag(path: Path, topic: str | None = None) -> list[RawScan]:
    """The scans of a bag.

    Args:
        path: a file, or the folder of a ROS 2 bag.
        topic: of the clouds; None: the only one that there is.

    Raises:
        InputError: no topic with clouds, or several and none named; a message that ends early or has no x, y and z.
    """
    try:
        from rosbags import rosbag1, rosbag2
    except ImportError as error:
        raise InputError(f"{path}: {EXTRA}") from error
    check_name(path)
    _check_profile(path)
    ros = 1 if path.suffix.lower() == ".bag" and path.is_file() else 2
    with (rosbag1 if ros == 1 else rosbag2).Reader(path) as reader:
        chosen = _connections(path, reader, topic)
        tree, remarks = _frames(path, reader, ros), []
        stride = _stride(path, reader, chosen, ros)
        count = sum(connection.msgcount for connection in chosen)
        if stride > 1:
            remarks.append(
                f"one of {stride} of its {count} messages is read: all hold more points than fit into memory"
            )
        groups = list(_groups(path, reader, chosen, ros, tree, stride))
    if not groups:
        raise InputError(f"{path}: expected messages with points on {clipped(chosen[0].topic)}, got none in {count}")
    posed = [group for group in groups if group.pose is not None]
    if posed and len(posed) < len(groups):
        lost = sum(group.messages for group in groups) - sum(group.messages for group in posed)
        remarks.append(f"{lost} messages have no pose, as others of {clipped(chosen[0].topic)} have, and are left out")
    scans = [group.scan(tree.is_world(group.frame)) for group in posed or groups]
    scans[0] = scans[0]._replace(remarks=tuple(remarks))
    return scans


def _check_profile(path: Path) -> None:
    """Refuse an MCAP file that does not say that it is of ROS 2: the library does not read it, whatever it holds."""
    if path.suffix.lower() != ".mcap" or not path.is_file():
        return
    with open(path, "rb") as file:
        head = file.read(MCAP_HEAD)
    if head[:9] != MCAP_START:
        raise InputError(f"{path}: expected an MCAP file, which begins with a header, found something else")
    profile = head[21 : 21 + int.from_bytes(head[17:21], "little")].decode("utf-8", "replace")
    if profile != "ros2":
        raise InputError(
            f"{path}: expected MCAP as ROS 2 records it, with the profile ros2, got {clipped(profile)!r}; convert it, "
            "as with `ros2 bag convert`"
        )


def _connections(path: Path, reader: Any, topic: str | None) -> list[Any]:
    """Those of the topic with clouds."""
    clouds = [one for one in reader.connections if one.msgtype in (CLOUD, *LIVOX) and one.msgcount]
    topics = sorted({one.topic for one in clouds})
    if topic is None and len(topics) == 1:
        return clouds
    if not topics:
        told = ", ".join(sorted({f"{one.topic} ({one.msgtype})" for one in reader.connections}))[:300]
        raise InputError(f"{path}: expected a topic of PointCloud2 or Livox CustomMsg, found {told or 'none'}")
    if topic is None:
        raise InputError(f"{path}: expected --topic with one of {clipped(', '.join(topics))}, as there are several")
    if topic not in topics:
        raise InputError(f"{path}: --topic: expected one of {clipped(', '.join(topics))}, got {topic}")
    return [one for one in clouds if one.topic == topic]


def _frames(path: Path, reader: Any, ros: int) -> FrameTree:
    """All that tells where frames are: of each, transforms count first, else the first topic of odometry with it."""
    tree, teller = FrameTree(), {}
    for kinds in (TRANSFORMS, (ODOMETRY,)):
        wanted = [one for one in reader.connections if one.msgtype in kinds]
        for connection, _, data in reader.messages(connections=wanted) if wanted else ():
            source = connection.topic if connection.msgtype == ODOMETRY else TRANSFORMS
            with _told_of(path, connection.topic):
                for transform in transforms_of(connection.msgtype, data, ros):
                    if teller.setdefault(transform.child, source) == source:
                        tree.add(transform, fixed=connection.topic.endswith("tf_static"))
    tree.close()
    return tree


def _stride(path: Path, reader: Any, chosen: list[Any], ros: int) -> int:
    """Of how many messages one is read, so that all fit into memory, were they as large as the first."""
    for connection, _, data in reader.messages(connections=chosen):
        with _told_of(path, connection.topic):
            size = len(cloud_of(connection.msgtype, data, ros).points)
        return max(1, -(-size * sum(one.msgcount for one in chosen) // MOST_POINTS))
    return 1


def _groups(path: Path, reader: Any, chosen: list[Any], ros: int, tree: FrameTree, stride: int) -> Iterator[_Group]:
    group: _Group | None = None
    for connection, logged, data in itertools.islice(reader.messages(connections=chosen), 0, None, stride):
        with _told_of(path, connection.topic):
            cloud = cloud_of(connection.msgtype, data, ros)
        if not len(cloud.points):
            continue
        pose = tree.pose_of(cloud.frame, cloud.time or logged * 1e-9)
        if group is not None and group.is_rest(cloud, pose, logged * 1e-9):
            group.take(cloud, pose, logged * 1e-9)
            continue
        if group is not None:
            group.first = None  # not needed any more, and large
            yield group
        group = _Group(cloud, pose, logged * 1e-9)
    if group is not None:
        yield group


@contextlib.contextmanager
def _told_of(path: Path, topic: str) -> Iterator[None]:
    """Errors in a message name the file and its topic."""
    try:
        yield
    except (InputError, struct.error, OverflowError) as error:
        raise InputError(f"{path}: {clipped(topic)}: {one_line(error)}") from error
