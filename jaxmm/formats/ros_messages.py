"""Messages of ROS, taken apart: clouds, transforms, odometry; as ROS 1 and as ROS 2 (CDR) lay them out.

The few types that matter here are fixed, so nothing is made from definitions that a bag brings along. N points.
Sources: the definitions of sensor_msgs, nav_msgs, tf2_msgs, livox_ros_driver; OMG's Common Data Representation.
"""

import struct
from typing import NamedTuple

import numpy as np

from jaxmm.formats.raw_scans import axes_of
from jaxmm.inputs import InputError

CLOUD = "sensor_msgs/msg/PointCloud2"
LIVOX = ("livox_ros_driver/msg/CustomMsg", "livox_ros_driver2/msg/CustomMsg")
TRANSFORMS = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
ODOMETRY = "nav_msgs/msg/Odometry"
KINDS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}  # of fields of a cloud
MOST_FIELDS = 1000
LIVOX_POINT, LIVOX_GAP = 19, 20  # [bytes] of a point, and from one to the next in CDR


class Cloud(NamedTuple):
    """A cloud as it was measured."""

    points: np.ndarray  # (N, 3) float64 of rays that came back
    frame: str  # that they are in
    time: float  # [s]; 0 where nobody set it


class Transform(NamedTuple):
    """Where a frame is in another."""

    parent: str
    child: str
    time: float  # [s]
    position: np.ndarray  # (3,) [m]
    quaternion: np.ndarray  # (4,) x, y, z, w


class _Reader:
    """A place in a message; everything read moves it on."""

    def __init__(self, data: bytes, ros: int):
        self.data, self.ros, self.at, self.order, self.start = data, ros, 0, "<", 0
        if ros == 2:
            if data[:2] not in (b"\0\0", b"\0\1"):
                raise InputError(f"expected a message in CDR, got one that begins with {data[:2].hex()}")
            self.order, self.at, self.start = ("<" if data[1] else ">"), 4, 4

    def align(self, size: int) -> None:
        if self.ros == 2:
            self.at += -(self.at - self.start) % size

    def number(self, code: str) -> float:
        size = struct.calcsize(code)
        self.align(size)
        return struct.unpack(self.order + code, self.bytes(size))[0]

    def bytes(self, size: int) -> bytes:
        found = self.data[self.at : self.at + size]
        if len(found) < size:
            raise InputError(f"expected {size} bytes more at byte {self.at} of a message, found {len(found)}")
        self.at += size
        return found

    def text(self) -> str:
        return self.bytes(self.number("I")).rstrip(b"\0").decode("utf-8", "replace")

    def numbers(self, count: int) -> np.ndarray:
        self.align(8)
        return np.frombuffer(self.bytes(8 * count), f"{self.order}f8").astype(np.float64)

    def header(self) -> tuple[float, str]:
        """Time [s] and frame."""
        if self.ros == 1:
            self.number("I")
        seconds = self.number("I" if self.ros == 1 else "i") + 1e-9 * self.number("I")
        return seconds, self.text().lstrip("/")


def cloud_of(kind: str, data: bytes, ros: int) -> Cloud:
    """The cloud in a message of the kind CLOUD or LIVOX, as ROS 1 or 2 lays it out.

    Points that are not finite or at 0, 0, 0 are rays without a return, and left out.

    Raises:
        InputError: it ends early, or has no x, y and z.
    """
    message = _Reader(data, ros)
    time, frame = message.header()
    points = _points(message) if kind == CLOUD else _livox_points(message)
    back = np.isfinite(points).all(axis=1) & points.any(axis=1)
    return Cloud(points[back], frame, time)


def _points(message: _Reader) -> np.ndarray:
    height, width, count = (message.number("I") for _ in range(3))
    if count > MOST_FIELDS:
        raise InputError(f"expected at most {MOST_FIELDS} fields of a cloud, got {count}")
    fields = []
    for _ in range(count):
        fields.append((message.text(), message.number("I"), message.number("B")))
        message.number("I")  # how many numbers, of which the first is meant
    order = ">" if message.number("B") else "<"
    step, row = message.number("I"), message.number("I")
    data = message.bytes(message.number("I"))
    axes = axes_of([name for name, _, _ in fields])
    if axes is None or any(fields[axis][2] not in KINDS for axis in axes):
        told = ", ".join(name for name, _, _ in fields)[:200]
        raise InputError(f"expected a cloud with the numbers x, y and z once each, got {told or 'no field'}")
    if not height * width:
        return np.zeros((0, 3))
    kinds = [np.dtype(order + KINDS[fields[axis][2]]) for axis in axes]
    row = row if height > 1 else step * width
    ends = [fields[axis][1] + kind.itemsize for axis, kind in zip(axes, kinds, strict=True)]
    if max(ends) > step or row < step * width or (height - 1) * row + width * step > len(data):
        raise InputError(f"expected {height} x {width} points of {step} bytes, which do not fit into {len(data)} bytes")
    columns = [
        np.ndarray((height, width), kind, data, fields[axis][1], (row, step)).astype(np.float64).ravel()
        for axis, kind in zip(axes, kinds, strict=True)
    ]
    return np.column_stack(columns)


def _livox_points(message: _Reader) -> np.ndarray:
    message.number("Q")  # time of the first point
    message.bytes(4 + 1 + 3)  # number of points, which the list says again; device; three that are reserved
    count = message.number("I")
    if not count:
        return np.zeros((0, 3))
    message.align(4)
    gap = LIVOX_GAP if message.ros == 2 else LIVOX_POINT
    data = message.bytes(gap * (count - 1) + LIVOX_POINT)
    return np.ndarray((count, 3), f"{message.order}f4", data, 4, (gap, 4)).astype(np.float64)


def transforms_of(kind: str, data: bytes, ros: int) -> list[Transform]:
    """The transforms in a message of the kind TRANSFORMS, or the one that an ODOMETRY tells.

    Raises:
        InputError: it ends early.
    """
    message, found = _Reader(data, ros), []
    for _ in range(1 if kind == ODOMETRY else message.number("I")):
        time, parent = message.header()
        child = message.text().lstrip("/")
        numbers = message.numbers(7)
        if np.isfinite(numbers).all() and numbers[3:].any():
            found.append(Transform(parent, child, time, numbers[:3], numbers[3:]))
    return found
