"""What lies in a folder of depth images: images, their camera, and the trajectory if there is one.

| folder of | told by | camera | trajectory | a depth unit |
|---|---|---|---|---|
| plain images | intrinsics.json | in it | trajectory.txt, TUM | 1 / depth_scale |
| Stray Scanner | camera_matrix.csv | in it, of the colour image | odometry.csv | 1 mm |
| Record3D | metadata.json or metadata | K in it, of the colour image | poses in it | 1 mm |
| TUM RGB-D | depth.txt | intrinsics.json, else the benchmark's usual one | groundtruth.txt | 0.2 mm |

Sources: Sturm et al., IROS 2012, and the benchmark's page on its file formats; Stray Scanner's data specification;
Record3D's export as nerfstudio reads it. Phones have y up in their world, which is turned to z up here.
"""

import bisect
import json
import math
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from jaxmm.formats.poses import PoseAtTime, read_trajectory
from jaxmm.inputs import InputError, one_line

Pose = tuple[np.ndarray, np.ndarray]  # position (3,) [m] and rotation (3, 3) of the optical frame to a world with z up

MOST_PIXELS = 50_000_000
LARGEST = 1e9  # number of a camera
WIDEST_STEP = 0.1  # [s] between two poses, within which the ones between are told by them
NEAR_TIME = 0.02  # [s] from an image to the only pose near it: what the benchmark's own tools take
TUM_CAMERA = (525.0, 525.0, 319.5, 239.5, 640, 480)
STRAY_COLOUR = (1920, 1440)  # pixels of the colour image that the camera matrix is of
Z_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])  # from a world with y up
FROM_OPENGL = np.diag([1.0, -1.0, -1.0])  # of a camera that looks along -z, with y up, to an optical one


class Camera(NamedTuple):
    """A pinhole; pixels, the middle of the first at 0, 0."""

    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int

    def resized(self, width: int, height: int) -> "Camera":
        """The same view in another number of pixels."""
        across, down = width / self.width, height / self.height
        return Camera(
            self.fx * across,
            self.fy * down,
            (self.cx + 0.5) * across - 0.5,
            (self.cy + 0.5) * down - 0.5,
            width,
            height,
        )


class DepthFolder(NamedTuple):
    """What was found."""

    images: list[Path]  # in the order of time
    camera: Camera
    units: float  # of a depth, per metre
    poses: list[Pose | None] | None  # of each image; None where there is no trajectory
    confidence: Path | None  # folder of maps, each named as its image


def open_depth_folder(path: Path) -> DepthFolder:
    """Find out what lies in a folder.

    Raises:
        InputError: no images in depth/, no camera, or a file that does not say what it should.
    """
    images = sorted((path / "depth").glob("*.png"), key=_order)
    if not images:
        raise InputError(f"{path}: expected depth/*.png of depth images, found none")
    metadata = next((path / name for name in ("metadata.json", "metadata") if (path / name).is_file()), None)
    if (path / "camera_matrix.csv").is_file():
        found = _stray(path, images)
    elif metadata is not None:
        found = _record3d(metadata, images)
    elif (path / "depth.txt").is_file():
        found = _tum(path, images)
    elif (path / "intrinsics.json").is_file():
        found = _plain(path, images)
    else:
        raise InputError(
            f"{path}: expected a camera beside depth/, as intrinsics.json, camera_matrix.csv, metadata.json or TUM's "
            "depth.txt, found none"
        )
    confidence = path / "confidence"
    return found._replace(confidence=confidence if confidence.is_dir() else None)


def _order(image: Path) -> tuple[float, str]:
    return _number(image.stem), image.stem


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.inf


def _plain(path: Path, images: list[Path]) -> DepthFolder:
    camera, units = _intrinsics(path / "intrinsics.json")
    trajectory = path / "trajectory.txt"
    poses = None
    if trajectory.is_file():
        known = read_trajectory(trajectory, str(trajectory))
        times = [_number(image.stem) for image in images]
        poses = [_at_time(known, time) for time in times]
        if not any(poses) and len(known) == len(images):  # images that are named by number
            poses = [(one.pose.position, one.pose.rotation) for one in known]
    return DepthFolder(images, camera, units, poses, None)


def _tum(path: Path, images: list[Path]) -> DepthFolder:
    listed = []
    for number, line in enumerate(_text(path / "depth.txt").splitlines(), 1):
        words = line.split("#")[0].split()
        if words:
            if len(words) != 2 or not math.isfinite(_number(words[0])):
                raise InputError(
                    f"{path / 'depth.txt'}: line {number}: expected a time and an image, got {line[:80]!r}"
                )
            listed.append((float(words[0]), path / words[1]))
    held = {image.resolve() for image in images}
    listed = [(time, image) for time, image in sorted(listed) if image.resolve() in held]
    if not listed:
        raise InputError(f"{path / 'depth.txt'}: expected the times of images in depth/, got none")
    camera, units = Camera(*TUM_CAMERA), 5000.0
    if (path / "intrinsics.json").is_file():
        camera, units = _intrinsics(path / "intrinsics.json")
    poses = None
    if (path / "groundtruth.txt").is_file():
        known = read_trajectory(path / "groundtruth.txt", str(path / "groundtruth.txt"))
        poses = [_at_time(known, time) for time, _ in listed]
    return DepthFolder([image for _, image in listed], camera, units, poses, None)


def _stray(path: Path, images: list[Path]) -> DepthFolder:
    where = path / "camera_matrix.csv"
    matrix = _numbers(where, _text(where))
    if matrix.shape != (3, 3):
        raise InputError(f"{where}: expected a matrix of 3 x 3, got {matrix.shape}")
    colour = Camera(matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2], *STRAY_COLOUR)
    camera, poses = _checked(colour.resized(*_size(images[0])), where), None
    if (path / "odometry.csv").is_file():
        known = _odometry(path / "odometry.csv")
        poses = [known.get(_number(image.stem)) for image in images]
    return DepthFolder(images, camera, 1000.0, poses, None)


def _odometry(path: Path) -> dict[float, Pose]:
    """Number of a frame -> pose."""
    head, _, body = _text(path).partition("\n")
    names = [name.strip() for name in head.split(",")]
    wanted = ["frame", "x", "y", "z", "qx", "qy", "qz", "qw"]
    if any(names.count(name) != 1 for name in wanted):
        raise InputError(f"{path}: expected the columns {', '.join(wanted)} once each, got {', '.join(names)[:200]}")
    rows = _numbers(path, body)
    if rows.shape[1:] != (len(names),):
        raise InputError(f"{path}: expected rows of {len(names)} columns as its header names, got {rows.shape[1:]}")
    rows = rows[:, [names.index(name) for name in wanted]]
    return {row[0]: _turned(path, row[1:4], row[4:8], np.eye(3)) for row in rows}


def _record3d(path: Path, images: list[Path]) -> DepthFolder:
    told = _json(path)
    try:
        matrix = np.array(told["K"], np.float64).reshape(3, 3).T  # by columns
        size = int(told["w"]), int(told["h"])
        poses = None if told.get("poses") is None else np.array(told["poses"], np.float64).reshape(-1, 7)
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise InputError(f"{path}: expected K, w, h and poses as Record3D writes them: {one_line(error)}") from error
    colour = Camera(matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2], *size)
    if poses is not None and len(poses) < len(images):
        raise InputError(f"{path}: expected a pose for each of {len(images)} images, got {len(poses)}")
    camera = _checked(_checked(colour, path).resized(*_size(images[0])), path)
    found = None if poses is None else [_turned(path, pose[4:], pose[:4], FROM_OPENGL) for pose in poses[: len(images)]]
    return DepthFolder(images, camera, 1000.0, found, None)


def _turned(path: Path, position: np.ndarray, quaternion: np.ndarray, camera: np.ndarray) -> Pose:
    """A pose of a phone in a world with z up; `camera` (3, 3) takes an optical frame to the phone's."""
    if not (np.isfinite(position).all() and 0.5 < np.linalg.norm(quaternion) < 2.0):
        raise InputError(f"{path}: expected poses with finite positions and quaternions of length 1, got others")
    return Z_UP @ position, Z_UP @ Rotation.from_quat(quaternion).as_matrix() @ camera


def _at_time(known: list[PoseAtTime], time: float) -> Pose | None:
    """The pose at a time [s], between the two around it; None where none is near."""
    after = bisect.bisect_left(known, time, key=lambda one: one.time)
    around = known[max(0, after - 1) : after + 1]
    if len(around) == 2 and 0.0 < around[1].time - around[0].time <= WIDEST_STEP:
        share = (time - around[0].time) / (around[1].time - around[0].time)
        first, last = (Rotation.from_matrix(one.pose.rotation) for one in around)
        turn = first * Rotation.from_rotvec(share * (first.inv() * last).as_rotvec())
        return (1.0 - share) * around[0].pose.position + share * around[1].pose.position, turn.as_matrix()
    near = min(around, key=lambda one: abs(one.time - time))
    return (near.pose.position, near.pose.rotation) if abs(near.time - time) <= NEAR_TIME else None


def _intrinsics(path: Path) -> tuple[Camera, float]:
    told = _json(path)
    wanted = (*Camera._fields, "depth_scale")
    for name in wanted:
        value = told.get(name)
        if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < LARGEST:
            raise InputError(f"{path}: expected numbers {', '.join(wanted)}, got {name} {json.dumps(value)[:80]}")
    units = float(told["depth_scale"])
    if not 1.0 <= units <= 1e6:
        raise InputError(f"{path}: expected depth_scale in units per metre, 1000 of millimetres, got {units:g}")
    values = [float(told[name]) for name in Camera._fields[:4]]
    return _checked(Camera(*values, int(told["width"]), int(told["height"])), path), units


def _checked(camera: Camera, path: Path) -> Camera:
    right = np.isfinite(camera[:4]).all() and camera.fx > 0.0 and camera.fy > 0.0
    if not (right and 0 < camera.width * camera.height <= MOST_PIXELS and camera.width > 0):
        raise InputError(
            f"{path}: expected a camera of positive lengths and at most {MOST_PIXELS} pixels, got {camera}"
        )
    return camera


def _size(image: Path) -> tuple[int, int]:
    from PIL import Image

    try:
        with Image.open(image, formats=("PNG",)) as opened:
            return opened.size
    except (OSError, SyntaxError) as error:
        raise InputError(f"{image}: expected a whole PNG image: {one_line(error)}") from error


def _json(path: Path) -> dict[str, Any]:
    try:
        told = json.loads(_text(path))
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: expected JSON: {one_line(error)}") from error
    if not isinstance(told, dict):
        raise InputError(f"{path}: expected an object of JSON, got {type(told).__name__}")
    return told


def _numbers(path: Path, text: str) -> np.ndarray:
    """Rows of numbers split by commas."""
    try:
        return np.loadtxt(text.splitlines(), delimiter=",", ndmin=2)
    except ValueError as error:
        raise InputError(f"{path}: expected rows of numbers: {one_line(error)}") from error


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: expected UTF-8 text, got bytes that are none") from error
