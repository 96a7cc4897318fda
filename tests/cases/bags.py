"""Bags as ROS 1 and 2 record them, written by rosbags: clouds of a box room from within, transforms, odometry."""

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from tests.cases.depth_recordings import HALF

KINDS = ("ros1", "sqlite3", "mcap")
CUSTOM_POINT = "uint32 offset_time\nfloat32 x\nfloat32 y\nfloat32 z\nuint8 reflectivity\nuint8 tag\nuint8 line\n"
CUSTOM = (
    "std_msgs/Header header\nuint64 timebase\nuint32 point_num\nuint8 lidar_id\nuint8[3] rsvd\nCustomPoint[] points\n"
)
LIVOX = "livox_ros_driver2/msg/"


class Types:
    """Message types of ROS 1 or 2, by their last names."""

    def __init__(self, kind: str):
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore

        self.ros = 1 if kind == "ros1" else 2
        self.store = get_typestore(Stores.ROS1_NOETIC if self.ros == 1 else Stores.ROS2_HUMBLE)
        point = get_types_from_msg(CUSTOM_POINT, f"{LIVOX}CustomPoint")
        if self.ros == 1:
            told = get_types_from_msg("geometry_msgs/TransformStamped[] transforms\n", "tf2_msgs/msg/TFMessage")
            self.store.register(told)
        self.store.register(point | get_types_from_msg(CUSTOM, f"{LIVOX}CustomMsg"))

    def __getitem__(self, name: str):
        return next(kind for full, kind in self.store.types.items() if full.endswith(f"/{name}"))

    def header(self, time: float, frame: str):
        """Time [s] and frame."""
        seconds = int(np.floor(time + 1e-7))
        stamp = self.store.types["builtin_interfaces/msg/Time"](
            sec=seconds, nanosec=max(0, round((time - seconds) * 1e9))
        )
        more = {"seq": 7} if self.ros == 1 else {}
        return self["Header"](stamp=stamp, frame_id=frame, **more)

    def cloud(self, time: float, frame: str, points: np.ndarray, order: str = "<", kind: str = "f4", padding: int = 0):
        """Points (N, 3), or (rows, columns, 3) with `padding` bytes behind each row; z stands first in a record."""
        image = points.reshape(1, *points.shape) if points.ndim == 2 else points
        fields = [("z", order + kind), ("ring", "u1"), ("x", order + kind), ("y", order + kind), ("t", "u2")]
        table = np.zeros(image.shape[:2], fields)
        for number, axis in enumerate("xyz"):
            table[axis] = image[..., number]
        rows = np.zeros((len(table), table.itemsize * table.shape[1] + padding), np.uint8)
        rows[:, : rows.shape[1] - padding] = table.view(np.uint8).reshape(len(table), -1)
        codes = {"f4": 7, "f8": 8, "u1": 2, "u2": 4}
        told = [
            self["PointField"](
                name=name, offset=table.dtype.fields[name][1], datatype=codes[told[-2:].lstrip("<>")], count=1
            )
            for name, told in fields
        ]
        return self["PointCloud2"](
            header=self.header(time, frame), height=len(table), width=table.shape[1], fields=told,
            is_bigendian=order == ">", point_step=table.itemsize, row_step=rows.shape[1],
            data=rows.ravel(), is_dense=False,
        )  # fmt: skip

    def livox(self, time: float, frame: str, points: np.ndarray):
        """Points (N, 3) as a Livox device sends them."""
        made = [
            self["CustomPoint"](offset_time=n, x=float(x), y=float(y), z=float(z), reflectivity=9, tag=3, line=n % 6)
            for n, (x, y, z) in enumerate(points)
        ]
        return self["CustomMsg"](
            header=self.header(time, frame), timebase=12, point_num=len(made), lidar_id=1,
            rsvd=np.zeros(3, np.uint8), points=made,
        )  # fmt: skip

    def _transform(self, pose: tuple[np.ndarray, np.ndarray]):
        shift = self["Vector3"](*map(float, pose[0]))
        return self["Transform"](shift, self["Quaternion"](*map(float, Rotation.from_matrix(pose[1]).as_quat())))

    def tf(self, time: float, *told: tuple[str, str, tuple[np.ndarray, np.ndarray]]):
        """Parent, child and the child's pose in the parent, of each."""
        return self["TFMessage"](
            transforms=[
                self["TransformStamped"](
                    header=self.header(time, parent), child_frame_id=child, transform=self._transform(pose)
                )
                for parent, child, pose in told
            ]
        )

    def odometry(self, time: float, parent: str, child: str, pose: tuple[np.ndarray, np.ndarray]):
        """The child's pose in the parent."""
        made, none = self._transform(pose), np.zeros(36)
        place = self["Pose"](self["Point"](made.translation.x, made.translation.y, made.translation.z), made.rotation)
        still = self["Twist"](self["Vector3"](0.0, 0.0, 0.0), self["Vector3"](0.0, 0.0, 0.0))
        return self["Odometry"](
            header=self.header(time, parent), child_frame_id=child,
            pose=self["PoseWithCovariance"](place, none), twist=self["TwistWithCovariance"](still, none),
        )  # fmt: skip


def write_bag(path: Path, kind: str, messages: list[tuple[str, float, object]], packed: str = "") -> Path:
    """Write messages of topics, with the time [s] at which they came; returns what to read: a file, or a folder.

    `packed` is lz4 or bz2 in ROS 1; in ROS 2 what is packed by zstd: storage (of MCAP), message or file.
    """
    types = Types(kind)
    if kind == "ros1":
        from rosbags.rosbag1 import Writer

        path, made = path.with_suffix(".bag"), Writer(path.with_suffix(".bag"))
        if packed:
            made.set_compression(Writer.CompressionFormat[packed.upper()])
    else:
        from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

        made = Writer(path, version=9, storage_plugin=StoragePlugin[kind.upper()])
        if packed:
            made.set_compression(CompressionMode[packed.upper()], CompressionFormat.ZSTD)
    with made as writer:
        connections = {}
        for topic, time, message in messages:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, message.__msgtype__, typestore=types.store)
            pack = types.store.serialize_ros1 if types.ros == 1 else types.store.serialize_cdr
            writer.write(connections[topic], round(time * 1e9), bytes(pack(message, message.__msgtype__)))
    return path


def seen_from(pose: tuple[np.ndarray, np.ndarray], count: int = 4000, seed: int = 0) -> np.ndarray:
    """(N, 3) float32 exact points on the walls of the room, in the frame of a sensor that looks all around."""
    rays = np.random.default_rng(seed).normal(size=(count, 3))
    direction = rays / np.linalg.norm(rays, axis=1, keepdims=True) @ pose[1].T
    reach = np.min((np.sign(direction) * HALF - pose[0]) / direction, axis=1)
    return ((direction * reach[:, None]) @ pose[1]).astype(np.float32)
