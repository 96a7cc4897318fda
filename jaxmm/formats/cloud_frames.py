"""In which frame the points of a file are: the world's, the sensor's, or that of its optics; and how they come upright.

N points of a scan, or of a cloud that is a prior. World frame: z up.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from jaxmm.formats.poses import OPTICAL
from jaxmm.formats.raw_scans import to_world
from jaxmm.formats.readers import PointScan
from jaxmm.inputs import InputError
from jaxmm.vectors import directions

FRAMES = ("world", "sensor", "optical")
Y_UP_TO_Z_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])  # of rows
AHEAD, WIDE = 0.98, 70.0  # share of a camera's points within an angle [deg] of where it looks
UPRIGHT = 30.0  # [deg] from upright, within which the axis is of what looks around


def carried_by_file(scan: PointScan) -> PointScan:
    """A scan that its file's pose takes to the world; as it is where there is none, or the reader did so."""
    if scan.position is None or scan.in_world:
        return scan
    points = scan.points.copy()
    to_world(points, scan.rotation, scan.position)
    return scan._replace(points=points, in_world=True)


def of_sensor(unseen: np.ndarray | None) -> np.ndarray | None:
    """Directions (K, 3) in the frame of optics, in the sensor's; None stays so."""
    return None if unseen is None else (unseen @ OPTICAL.T).astype(np.float32)


def brought_upright(scan: PointScan, frame: str | None, y_up: bool) -> PointScan:
    """A scan of which nobody gives a pose, with z up.

    Args:
        scan: as read.
        frame: one of FRAMES, which its points are in, unless the format tells that itself; None: untold, and they stay
            where they are. The pose in its file takes those of a sensor to the world; without one, those of optics (x
            right, y down, z forward) are turned, and those of a sensor, which have z up, stay.
        y_up: of the world that they are in then, y is up.
    """
    frame = scan.frame or frame
    if frame in ("sensor", "optical") and not scan.in_world:
        turned = scan._replace(points=scan.points @ OPTICAL.T) if frame == "optical" else scan
        scan = turned if scan.position is None else carried_by_file(scan)
    if not y_up:
        return scan
    scan = scan._replace(points=scan.points @ Y_UP_TO_Z_UP)
    if scan.position is None:
        return scan
    return scan._replace(position=scan.position @ Y_UP_TO_Z_UP, rotation=Y_UP_TO_Z_UP.T @ scan.rotation)


def check_frame(path: Path, scans: Sequence[PointScan], frame: str | None) -> None:
    """Refuse a frame that the user tells, where a file tells another; None: untold.

    What the pose in a file took to the world was of a sensor, and may be told to be of either.

    Raises:
        InputError: one line that names the right one.
    """
    for scan in scans:
        own = scan.frame or ("sensor" if scan.in_world else frame)
        if frame is not None and own != frame and not (scan.in_world and frame == "world"):
            raise InputError(
                f"{path}: its file tells the frame of its points: --prior-frame {frame} does not fit; leave it out, "
                f"or give --prior-frame {own}"
            )


def without_pose(path: Path, scans: Sequence[PointScan], frame: str | None) -> tuple[str, ...]:
    """A note on a file that says no pose, where its points are told to be in a sensor's frame, or that of optics."""
    if frame not in ("sensor", "optical") or all(one.position is not None or one.in_world for one in scans):
        return ()
    return (f"{path.name} says no pose: its sensor was taken to be at zero, level, and to look along x",)


def is_before(points: np.ndarray) -> tuple[bool, bool]:
    """Whether all that a camera sees lies before the x axis of its points (N, 3), and before the z axis."""
    unit = directions(points)
    before_x, _, before_z = np.mean(unit > np.cos(np.radians(WIDE)), axis=0) >= AHEAD
    return bool(before_x), bool(before_z)


def is_optical(own: np.ndarray, rotation: np.ndarray) -> bool:
    """Whether the axes of a scan's points are those of optics: x right, y down, z forward.

    All that a camera sees is before its z axis then, and not before its x axis. What looks around sees all azimuths,
    and less elevations about what is upright: then y points down.

    Args:
        own: (N, 3) points in these axes.
        rotation: (3, 3) of these axes to the world.
    """
    before_x, before_z = is_before(own)
    if before_x or before_z:
        return before_z and not before_x
    low, high = np.percentile(directions(own), [1, 99], axis=0)
    return bool(rotation[2, 1] < -np.cos(np.radians(UPRIGHT)) and (high - low)[1] < (high - low)[2])
