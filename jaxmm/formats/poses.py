"""Where scans were taken from, as users and files say it. World frame: metres, z up."""

import json
import math
import os
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from jaxmm.inputs import InputError

FARTHEST = 1e9  # [m] coordinates beyond this are taken for mistakes
OWN = "own"  # in place of a pose: that of the scan's file, or the estimated one
SEARCH = "search"  # in place of a pose: the place in the building that the scan fits, and no other
FORM = "X,Y,Z,YAW[,PITCH[,ROLL]], finite, pitch within 90 degrees"
JSON_FORM = (
    'expected {"position": [x, y, z], "yaw": degrees, "pitch": degrees, "roll": degrees}, or "quaternion": '
    '[x, y, z, w] in place of the angles, or a 4x4 matrix, or a list of those, of nulls for own, and of "search"'
)
TUM_FORM = "expected lines of a TUM trajectory, timestamp x y z qx qy qz qw, with a quaternion of length 1"
ANGLES = ("yaw", "pitch", "roll")
UNIT_LENGTH = 0.01  # by which the length of a quaternion may be off 1: files round
RIGHT_ANGLES = 1e-3  # by which the product of a rotation with its transpose may be off the identity
# Columns are the axes of an optical frame (x right, y down, z forward: ROS, Kinect, PCL) in that of a sensor.
OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


class GivenPose(NamedTuple):
    """A place and where a sensor looks there."""

    position: np.ndarray  # (3,) float64 [m] world
    yaw: float  # [deg] counter-clockwise from +x
    pitch: float  # [deg] upwards
    roll: float = 0.0  # [deg] about the direction of view, its right side down
    of_points: bool = False  # the angles are of the frame of the scan's points, which may be an optical one

    @property
    def rotation(self) -> np.ndarray:
        """(3, 3) float64 sensor frame (x forward, y left, z up) to world: first roll, then pitch, then yaw."""
        return Rotation.from_euler("ZYX", [self.yaw, -self.pitch, self.roll], degrees=True).as_matrix()

    def seen_from(self, frame: str) -> "GivenPose":
        """The pose of the sensor, where points are in `frame`.

        A quaternion or matrix is that of the frame of the points: of an optical one, z is forward.
        """
        if frame != "optical" or not self.of_points:
            return self
        return _pose_of(self.position, self.rotation @ OPTICAL.T)._replace(of_points=False)


AskedPose = GivenPose | Literal["search"] | None  # None: the scan's own, that of its file or the estimated one


def read_poses(words: list[str]) -> list[AskedPose]:
    """The poses that the values of --pose give: numbers, OWN, SEARCH, or files that hold one pose or several.

    A file is JSON by its ending, and else a TUM trajectory.

    Raises:
        InputError: none of these, or not of the form.
    """
    found: list[AskedPose] = []
    for word in words:
        path = Path(word)
        if word == SEARCH:
            found.append(SEARCH)
        elif path.suffix.lower() == ".json":
            found += _from_json(path)
        elif word != OWN and os.path.isfile(word):  # which bears names that no file can have
            found += _from_trajectory(path)
        else:
            found.append(None if word == OWN else parse_pose(word, f"{FORM}, or {OWN}, {SEARCH}, or a file"))
    return found


def parse_pose(text: str, form: str = FORM) -> GivenPose:
    """X,Y,Z,YAW[,PITCH[,ROLL]] as a pose; `form` says what was expected.

    Raises:
        InputError: it is not of that form.
    """
    try:
        values = [float(value) for value in text.split(",")]
    except ValueError:
        values = []
    return _checked(values, "--pose", repr(text), form)


def _from_json(path: Path) -> list[AskedPose]:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"--pose: {path}: cannot be read: {error.strerror}") from error
    except (ValueError, RecursionError) as error:
        raise InputError(f"--pose: {path}: {JSON_FORM}, got no valid JSON") from error
    entries = content if isinstance(content, list) and not _is_matrix(content) else [content]
    if not entries:
        raise InputError(f"--pose: {path}: {JSON_FORM}, got none")
    words = {None: None, SEARCH: SEARCH} if entries is content else {}
    return [
        words[entry] if (entry is None or isinstance(entry, str)) and entry in words else _entry(path, entry)
        for entry in entries
    ]


def _is_matrix(value: Any) -> bool:
    return (
        isinstance(value, list)
        and len(value) == 4
        and all(isinstance(row, list) and len(row) == 4 and all(map(_is_number, row)) for row in value)
    )


def _is_number(value: Any) -> bool:
    """Whether JSON gave a number that a float can hold; it bounds no integer."""
    return not isinstance(value, bool) and isinstance(value, int | float) and abs(value) < 1e300


def _numbers(value: Any, count: int) -> bool:
    return isinstance(value, list) and len(value) == count and all(map(_is_number, value))


def _entry(path: Path, entry: Any) -> GivenPose:
    """One pose of a JSON file."""
    where, wrong = f"--pose: {path}", InputError(f"--pose: {path}: {JSON_FORM}, got {json.dumps(entry)[:80]}")
    if _is_matrix(entry):
        return _of_matrix(np.array(entry, np.float64), where)
    if not isinstance(entry, dict):
        raise wrong
    if entry.keys() == {"matrix"} and _is_matrix(entry["matrix"]):
        return _of_matrix(np.array(entry["matrix"], np.float64), where)
    if not _numbers(entry.get("position"), 3):
        raise wrong
    if entry.keys() == {"position", "quaternion"}:
        if not _numbers(entry["quaternion"], 4):
            raise wrong
        return _of_quaternion(entry["position"], entry["quaternion"], where, JSON_FORM)
    if not entry.keys() <= {"position", *ANGLES}:  # "Yaw" is no yaw of 0
        raise wrong
    angles = [entry.get(name, 0.0) for name in ANGLES]
    if not all(map(_is_number, angles)):
        raise wrong
    return _checked([float(value) for value in (*entry["position"], *angles)], where, json.dumps(entry)[:80])


def _of_matrix(matrix: np.ndarray, where: str) -> GivenPose:
    """A pose out of a matrix that takes points of the sensor to the world, or of its transpose, as in PTX files."""
    if np.allclose(matrix[:3, 3], 0.0) and not np.allclose(matrix[3, :3], 0.0):
        matrix = matrix.T
    turn = matrix[:3, :3]
    rigid = np.abs(turn @ turn.T - np.eye(3)).max() < RIGHT_ANGLES and np.linalg.det(turn) > 0.0
    if not rigid or not np.allclose(matrix[3], (0.0, 0.0, 0.0, 1.0), atol=1e-6):
        raise InputError(f"{where}: expected a 4x4 matrix of a rotation and a shift in metres, got {matrix.tolist()}")
    return _pose_of(_near(matrix[:3, 3], where), turn)


def _of_quaternion(position: list[float], quaternion: list[float], where: str, form: str) -> GivenPose:
    length = math.hypot(*quaternion)
    if not abs(length - 1.0) < UNIT_LENGTH:
        raise InputError(f"{where}: {form}, got one of length {length:.4g}")
    return _pose_of(_near(np.array(position, np.float64), where), Rotation.from_quat(quaternion).as_matrix())


def _pose_of(position: np.ndarray, rotation: np.ndarray) -> GivenPose:
    """A pose by its rotation matrix (3, 3); looking straight up or down it has no roll of its own."""
    forward, left, up = rotation.T
    level = float(np.hypot(forward[0], forward[1]))
    pitch = math.degrees(math.atan2(forward[2], level))
    if level > 1e-9:
        yaw, roll = math.degrees(math.atan2(forward[1], forward[0])), math.degrees(math.atan2(left[2], up[2]))
    else:
        yaw, roll = math.degrees(math.atan2(-left[0], left[1])), 0.0
    return GivenPose(position, yaw, pitch, roll, of_points=True)


class PoseAtTime(NamedTuple):
    """One line of a trajectory."""

    time: float  # [s]
    pose: GivenPose


def _from_trajectory(path: Path) -> list[AskedPose]:
    return [one.pose for one in read_trajectory(path, f"--pose: {path}")]


def read_trajectory(path: Path, where: str) -> list[PoseAtTime]:
    """The poses of a TUM trajectory, in their order (Sturm et al., IROS 2012, for its form).

    Args:
        path: its file.
        where: what errors begin with.

    Raises:
        InputError: it cannot be read, or a line is not of the form.
    """
    found = []
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except OSError as error:
        raise InputError(f"{where}: cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise InputError(f"{where}: {TUM_FORM}, got no text") from error
    for number, line in enumerate(lines, 1):
        words = line.split("#")[0].split()
        if not words:
            continue
        try:
            values = [float(word) for word in words]
        except ValueError:
            values = []
        if len(values) != 8 or not np.isfinite(values).all():
            raise InputError(f"{where}: line {number}: {TUM_FORM}, got {line[:80]!r}")
        pose = _of_quaternion(values[1:4], values[4:], f"{where}: line {number}", TUM_FORM)
        found.append(PoseAtTime(values[0], pose))
    if not found:
        raise InputError(f"{where}: {TUM_FORM}, got none")
    return found


def _checked(values: list[float], where: str, came: str, form: str = FORM) -> GivenPose:
    if len(values) not in (4, 5, 6) or not np.isfinite(values).all() or (len(values) > 4 and abs(values[4]) > 90.0):
        raise InputError(f"{where}: expected {form}, got {came}")
    yaw, pitch, roll = (*values[3:], 0.0, 0.0)[:3]
    return GivenPose(_near(np.array(values[:3]), where, came), yaw, pitch, roll)


def _near(position: np.ndarray, where: str, came: str | None = None) -> np.ndarray:
    if not np.abs(position).max() <= FARTHEST:
        raise InputError(f"{where}: expected X, Y and Z within {FARTHEST:g} m, got {came or position.tolist()}")
    return position
