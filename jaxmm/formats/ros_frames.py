"""Where frames of a robot are over time, as its transforms and its odometry tell: the tree from the world down.

World frame: the root of the tree, metres, z up.
"""

import bisect
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from jaxmm.formats.ros_messages import Transform
from jaxmm.formats.standstill import is_rest

WORLDS = ("map", "odom", "world", "earth", "camera_init")  # frames that stand still; the last is of LOAM and its kin
ROBOTS = ("base_link", "base_footprint")  # ends of the names of frames that never do, whatever moves in them
WIDEST_STEP = 1.0  # [s] between two transforms, within which the ones between are told by them
NEAR_TIME = 0.1  # [s] from a time to the last or first transform
DEEPEST = 100  # frames from a sensor to the root


class RobotPose(NamedTuple):
    """Where a frame is in the world."""

    position: np.ndarray  # (3,) float64 [m]
    rotation: np.ndarray  # (3, 3) float64 frame to world


class FrameTree:
    """All transforms of a bag."""

    def __init__(self):
        self._moving: dict[str, dict[str, list[Transform]]] = {}  # child -> parent -> in the order of time
        self._fixed: dict[str, Transform] = {}
        self._above_motion: set[str] = set()  # frames in which others move, or frames in which others move, and so on

    def add(self, transform: Transform, fixed: bool) -> None:
        """Take one over; `fixed` holds at all times."""
        if fixed:
            self._fixed[transform.child] = transform
        elif transform.child and transform.child != transform.parent:
            self._moving.setdefault(transform.child, {}).setdefault(transform.parent, []).append(transform)

    def close(self) -> None:
        """Call it when all are there, before any pose is asked for."""
        for parents in self._moving.values():
            for told in parents.values():
                told.sort(key=lambda one: one.time)
        for parents in self._moving.values():
            for parent, told in parents.items():
                if not all(is_rest(_pose(told[0]), _pose(one)) for one in told):
                    self._above_motion |= {parent, *self._above(parent)}

    def _above(self, frame: str) -> list[str]:
        """The frames that a frame hangs on, from the next one up."""
        found: list[str] = []
        while len(found) < DEEPEST:
            if frame in self._fixed:
                frame = self._fixed[frame].parent
            elif frame in self._moving:
                frame = next(iter(self._moving[frame]))
            else:
                break
            found.append(frame)
        return found

    def pose_of(self, frame: str, time: float) -> RobotPose | None:
        """Where a frame that moves is at a time [s].

        None where it hangs on no world, its transforms are of other times, or it is a world itself.
        """
        if self.is_world(frame):
            return None
        position, rotation = np.zeros(3), Rotation.identity()
        for _ in range(DEEPEST):
            if frame in self._fixed:
                step = self._fixed[frame]
            elif frame in self._moving:
                step = self._at(frame, time)
                if step is None:
                    return None
            else:
                break
            turn = Rotation.from_quat(step.quaternion)
            position, rotation, frame = turn.apply(position) + step.position, turn * rotation, step.parent
        else:
            return None  # frames that hang on each other in a circle
        return RobotPose(position, rotation.as_matrix()) if self.is_world(frame) else None

    def is_world(self, frame: str) -> bool:
        """Whether a frame stands still: its name says so, or it is a root in which others move, and not the robot's.

        Transforms that are told again and again, but never change, may be those of a mount.
        """
        if frame in WORLDS:
            return True
        is_root = frame not in self._fixed and frame not in self._moving
        return is_root and frame in self._above_motion and not frame.endswith(ROBOTS)

    def _at(self, frame: str, time: float) -> Transform | None:
        """The transform of a frame; with several parents, as of tf and of odometry, that of the first that told it."""
        for told in self._moving[frame].values():
            after = bisect.bisect_left(told, time, key=lambda one: one.time)
            around = told[max(0, after - 1) : after + 1]
            if len(around) == 2 and around[1].time - around[0].time <= WIDEST_STEP:
                return _between(*around, time)
            near = min(around, key=lambda one: abs(one.time - time))
            if abs(near.time - time) <= NEAR_TIME:
                return near
        return None


def _pose(one: Transform) -> tuple[np.ndarray, np.ndarray]:
    return one.position, Rotation.from_quat(one.quaternion).as_matrix()


def _between(one: Transform, other: Transform, time: float) -> Transform:
    share = (time - one.time) / max(other.time - one.time, 1e-9)
    first, last = Rotation.from_quat(one.quaternion), Rotation.from_quat(other.quaternion)
    turn = first * Rotation.from_rotvec(share * (first.inv() * last).as_rotvec())
    position = (1.0 - share) * one.position + share * other.position
    return one._replace(time=time, position=position, quaternion=turn.as_quat())
