"""Recordings of depth images of a box room from within, as every program lays them out: exact up to the depth unit."""

import json
from pathlib import Path

import numpy as np
from PIL import Image
from scipy.spatial.transform import Rotation

HALF = np.array([3.0, 2.5, 1.4])  # [m] half the size of the room, whose middle is the world's zero
CAMERA = {"fx": 60.0, "fy": 62.0, "cx": 31.5, "cy": 22.0, "width": 64, "height": 48}
OPENGL = np.diag([1.0, -1.0, -1.0])  # columns: axes of a camera looking along -z in an optical frame
Y_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])  # from a world with z up
LAYOUTS = ("plain", "tum", "stray", "record3d")


def poses(count: int, seed: int = 3) -> list[tuple[np.ndarray, np.ndarray]]:
    """Positions in the room, and rotations of an optical frame to the world."""
    rng = np.random.default_rng(seed)
    turns = Rotation.random(count, rng=seed).as_matrix()
    return [(rng.uniform(-0.4, 0.4, 3) * HALF, turn) for turn in turns]


def depth_of(pose: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """(height, width) [m] along the optical axis to the walls."""
    row, column = np.indices((CAMERA["height"], CAMERA["width"]))
    rays = np.stack(
        [(column - CAMERA["cx"]) / CAMERA["fx"], (row - CAMERA["cy"]) / CAMERA["fy"], row * 0 + 1.0], axis=-1
    )
    direction = rays @ pose[1].T
    with np.errstate(divide="ignore"):
        return np.min((np.sign(direction) * HALF - pose[0]) / direction, axis=-1)


def off_walls(points: np.ndarray) -> float:
    """[m] the farthest that any of points (N, 3) lies from the walls."""
    return float(np.abs(np.max(np.abs(points) - HALF, axis=1)).max())


def units_of(layout: str) -> float:
    """Depth units per metre."""
    return 5000.0 if layout in ("plain", "tum") else 1000.0


def write_recording(folder: Path, layout: str, taken: list, images: list[np.ndarray], posed: bool = True) -> None:
    """Write depths [m] (0: nothing came back) taken from poses, an image every 0.1 s."""
    (folder / "depth").mkdir(parents=True)
    names = [
        f"{100.0 + number / 10:.6f}" if layout in ("plain", "tum") else str(number) for number in range(len(images))
    ]
    for name, image in zip(names, images, strict=True):
        depth = np.round(image * units_of(layout)).astype(np.uint16)
        Image.fromarray(depth).save(folder / "depth" / f"{name}.png")
    {"plain": _plain, "tum": _tum, "stray": _stray, "record3d": _record3d}[layout](folder, names, taken, posed)


def _trajectory(names: list[str], taken: list) -> str:
    rows = (
        (name, *place, *Rotation.from_matrix(turn).as_quat()) for name, (place, turn) in zip(names, taken, strict=True)
    )
    return "# time x y z qx qy qz qw\n" + "".join(" ".join(map(str, row)) + "\n" for row in rows)


def _plain(folder: Path, names: list[str], taken: list, posed: bool) -> None:
    (folder / "intrinsics.json").write_text(json.dumps(CAMERA | {"depth_scale": units_of("plain")}))
    if posed:
        (folder / "trajectory.txt").write_text(_trajectory(names, taken))


def _tum(folder: Path, names: list[str], taken: list, posed: bool) -> None:
    _plain(folder, names, taken, False)
    (folder / "depth.txt").write_text("# depth maps\n" + "".join(f"{name} depth/{name}.png\n" for name in names))
    if posed:
        (folder / "groundtruth.txt").write_text(_trajectory(names, taken))


def _colour(width: int, height: int) -> np.ndarray:
    """(3, 3) the camera's matrix in as many pixels."""
    across, down = width / CAMERA["width"], height / CAMERA["height"]
    middle = (CAMERA["cx"] + 0.5) * across - 0.5, (CAMERA["cy"] + 0.5) * down - 0.5
    return np.array([[CAMERA["fx"] * across, 0, middle[0]], [0, CAMERA["fy"] * down, middle[1]], [0, 0, 1]])


def _stray(folder: Path, names: list[str], taken: list, posed: bool) -> None:
    np.savetxt(folder / "camera_matrix.csv", _colour(1920, 1440), delimiter=", ")
    if posed:
        rows = (
            (100 + number / 10, f"{number:06d}", *Y_UP @ place, *Rotation.from_matrix(Y_UP @ turn).as_quat())
            for number, (place, turn) in enumerate(taken)
        )
        text = "".join(", ".join(map(str, row)) + "\n" for row in rows)
        (folder / "odometry.csv").write_text("timestamp, frame, x, y, z, qx, qy, qz, qw\n" + text)


def _record3d(folder: Path, names: list[str], taken: list, posed: bool) -> None:
    told = {"w": 720, "h": 540, "K": _colour(720, 540).T.ravel().tolist(), "fps": 30}
    if posed:
        turns = (Rotation.from_matrix(Y_UP @ turn @ OPENGL).as_quat().tolist() for _, turn in taken)
        told["poses"] = [[*turn, *(Y_UP @ place).tolist()] for turn, (place, _) in zip(turns, taken, strict=True)]
    (folder / "metadata.json").write_text(json.dumps(told))
