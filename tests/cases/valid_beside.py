"""Valid files that are read with others beside them, or that tell poses: recordings of depth images, trajectories."""

import json
import struct
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from tests.cases.depth_recordings import depth_of, poses, write_recording
from tests.cases.valid_files import ValidFile

SIGNATURE = 8  # [bytes] that a PNG file begins with
IMAGES = 3


def recorded(layout: str, place: str, confidence: bool = False) -> ValidFile:
    """A recording of depth images, of which one file is damaged: at `place` in its folder."""
    with tempfile.TemporaryDirectory() as folder:
        whole, taken = Path(folder) / "recording", poses(IMAGES)
        write_recording(whole, layout, taken, [depth_of(pose) for pose in taken])
        if confidence:
            _write_confidence(whole)
        held = {one.relative_to(whole).as_posix(): one.read_bytes() for one in whole.rglob("*") if one.is_file()}
    data, image = held.pop(place), place.endswith(".png")
    guard = (_without_checksums, _with_checksums) if image else (None, None)
    return ValidFile(Path(place).suffix, data, *guard, place=place, beside=held)


def _write_confidence(folder: Path) -> None:
    from PIL import Image

    (folder / "confidence").mkdir()
    for image in (folder / "depth").iterdir():
        with Image.open(image) as opened:
            width, height = opened.size
        Image.fromarray(np.full((height, width), 2, np.uint8)).save(folder / "confidence" / image.name)


def _without_checksums(data: bytes) -> bytes:
    """A PNG file without the checksum behind each of its chunks."""
    found, at = data[:SIGNATURE], SIGNATURE
    while at < len(data):
        end = at + 8 + struct.unpack(">I", data[at : at + 4])[0]
        found, at = found + data[at:end], end + 4
    return found


def _with_checksums(_: bytes, content: bytes) -> bytes:
    """Right checksums again, as far as lengths of chunks lead."""
    import zlib

    found, at = content[:SIGNATURE], SIGNATURE
    while at + 8 <= len(content):
        end = at + 8 + struct.unpack(">I", content[at : at + 4])[0]
        chunk = content[at:end]
        found, at = found + chunk + struct.pack(">I", zlib.crc32(chunk[4:])), end
    return found + content[at:]


def trajectory() -> ValidFile:
    rows = "".join(f"{100 + n / 10} {n / 5} 1.5 0.25 0 0 0.6 0.8\n" for n in range(4))
    return ValidFile(".txt", f"# time x y z qx qy qz qw\n{rows}".encode())


def pose_list() -> ValidFile:
    """In all forms that a JSON file may tell a pose in."""
    matrix = [[0, -1, 0, 4], [1, 0, 0, -3], [0, 0, 1, 1.5], [0, 0, 0, 1]]
    told = [
        {"position": [4, -3, 1.5], "yaw": 90, "pitch": 0, "roll": 0},
        {"position": [4, -3, 1.5], "quaternion": [0, 0, 0.6, 0.8]},
        matrix, {"matrix": matrix}, None, "search",
    ]  # fmt: skip
    return ValidFile(".json", json.dumps(told).encode())


FOLDERS: dict[str, Callable[[], ValidFile]] = {
    "depth-image": lambda: recorded("plain", "depth/100.100000.png"),
    "depth-confidence": lambda: recorded("stray", "confidence/1.png", confidence=True),
    "depth-intrinsics": lambda: recorded("plain", "intrinsics.json"),
    "depth-trajectory": lambda: recorded("plain", "trajectory.txt"),
    "depth-stray-camera": lambda: recorded("stray", "camera_matrix.csv"),
    "depth-stray-odometry": lambda: recorded("stray", "odometry.csv"),
    "depth-record3d": lambda: recorded("record3d", "metadata.json"),
    "depth-tum-times": lambda: recorded("tum", "depth.txt"),
    "depth-tum-truth": lambda: recorded("tum", "groundtruth.txt"),
}
POSES: dict[str, Callable[[], ValidFile]] = {"pose-trajectory": trajectory, "pose-json": pose_list}
