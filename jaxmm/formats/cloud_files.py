"""Point clouds as PLY and PCD files, whole or not at all, that every reader opens in their place.

Many readers hold coordinates in single precision, and some take doubles for zeros without a word. So coordinates are
single where that keeps a tenth of a millimetre. Where it does not, as on a national grid, the file holds doubles, and
beside it lies a second one in single precision, moved by whole kilometres that its name and its header tell.

N points. World frame: metres, z up.
"""

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from jaxmm.files import write_atomically

SINGLE = 2048.0  # [m] coordinates below that single precision holds to 0.061 mm: half of 2^-13 m
STEP = 1000.0  # [m] that clouds are moved by
OFFSET = "jaxmm offset"  # in a header: three numbers [m] to be added to all coordinates
SENSOR = "jaxmm sensor"  # in a header: position [m] and quaternion w, x, y, z of the sensor in the frame of the points
PLY_NAMES = {"f4": "float", "f8": "double", "u1": "uchar", "i4": "int"}
PCD_LETTERS = {"f": "F", "u": "U", "i": "I"}


class Sensor(NamedTuple):
    """Where points were seen from."""

    position: np.ndarray  # (3,) float64 [m] world
    quaternion: np.ndarray  # (4,) float64 w, x, y, z, from the sensor's frame to the world


def write_ply(
    path: Path, points: np.ndarray, fields: Mapping[str, np.ndarray], comments: Iterable[str] = ()
) -> tuple[Path, ...]:
    """Write a binary PLY file.

    Args:
        path: the file.
        points: (N, 3) float64 [m].
        fields: (N,) float32, int32 or uint8 each, by name; CloudCompare keeps those called scalar_.
        comments: lines of the header.

    Returns:
        The files that were written, `path` first.

    Raises:
        OSError: one cannot be written; then both stay as they were.
    """

    def content(table: np.ndarray, offset: np.ndarray) -> bytes:
        said = [*comments, *([f"{OFFSET} {_numbers(offset)}: metres to be added"] if offset.any() else [])]
        header = "".join((
            "ply\nformat binary_little_endian 1.0\n", *(f"comment {line}\n" for line in said),
            f"element vertex {len(table)}\n",
            *(f"property {PLY_NAMES[kind[1:]]} {name}\n" for name, kind in table.dtype.descr), "end_header\n",
        ))  # fmt: skip
        return header.encode("ascii") + table.tobytes()

    return _write(path, points, fields, content)


def write_pcd(
    path: Path, points: np.ndarray, fields: Mapping[str, np.ndarray], sensor: Sensor | None = None
) -> tuple[Path, ...]:
    """Write a binary PCD file, version .7, in the manner of `write_ply`.

    Points are in the world and VIEWPOINT says nothing: PCL's viewer moves a cloud by it, others do not. Where the
    sensor stood is told in a comment of the header.
    """

    def content(table: np.ndarray, offset: np.ndarray) -> bytes:
        kinds = [(name, np.dtype(kind)) for name, kind in table.dtype.descr]
        said = [f"{OFFSET} {_numbers(offset)}: metres to be added"] if offset.any() else []
        if sensor is not None:
            said.append(f"{SENSOR} {_numbers([*(sensor.position - offset), *sensor.quaternion])}")
        header = "".join((
            "# .PCD v0.7 - Point Cloud Data file format\n", *(f"# {line}\n" for line in said), "VERSION 0.7\n",
            f"FIELDS {' '.join(name for name, _ in kinds)}\n",
            f"SIZE {' '.join(str(kind.itemsize) for _, kind in kinds)}\n",
            f"TYPE {' '.join(PCD_LETTERS[kind.kind] for _, kind in kinds)}\n",
            f"COUNT {' '.join('1' for _ in kinds)}\n",
            f"WIDTH {len(table)}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {len(table)}\nDATA binary\n",
        ))  # fmt: skip
        return header.encode("ascii") + table.tobytes()

    return _write(path, points, fields, content)


def offset_of(points: np.ndarray) -> np.ndarray:
    """(3,) float64 [m], whole kilometres, by which points (N, 3) are near enough for single precision; often zero."""
    if not len(points):
        return np.zeros(3)
    low, high = points.min(axis=0), points.max(axis=0)
    far = np.maximum(np.abs(low), np.abs(high)) >= SINGLE
    return np.where(far, STEP * np.round((low + high) / (2.0 * STEP)), 0.0) + 0.0


def moved_name(path: Path, offset: np.ndarray) -> Path:
    """The file beside `path` whose points are moved: scan.offset_155000_463000_0.ply."""
    return path.with_name(f"{path.stem}.offset_{'_'.join(f'{value:.0f}' for value in offset)}{path.suffix}")


def numbers_after(key: str, words: list[str], count: int) -> list[float] | None:
    """So many finite numbers behind OFFSET or SENSOR among the words of a comment; None: it says something else."""
    begin = key.split()
    told = words[len(begin) : len(begin) + count]
    if words[: len(begin)] != begin or len(told) != count:
        return None
    try:
        values = [float(word.rstrip(":")) for word in told]
    except ValueError:
        return None
    return values if np.isfinite(values).all() else None


def _write(
    path: Path, points: np.ndarray, fields: Mapping[str, np.ndarray], content: Callable[[np.ndarray, np.ndarray], bytes]
) -> tuple[Path, ...]:
    points, nothing = np.asarray(points, np.float64), np.zeros(3)
    offset = offset_of(points)
    if not offset.any():
        data = content(_table(points, fields, "<f4"), nothing)
        write_atomically(path, lambda temporary: temporary.write_bytes(data))
        return (path,)
    moved, written = moved_name(path, offset), []

    def write(temporary: Path) -> None:
        temporary.write_bytes(content(_table(points, fields, "<f8"), nothing))
        near = content(_table(points - offset, fields, "<f4"), offset)
        write_atomically(moved, lambda beside: beside.write_bytes(near))
        written.append(moved)

    try:
        write_atomically(path, write)
    except BaseException:
        for one in written:
            one.unlink(missing_ok=True)
        raise
    return path, moved


def _table(points: np.ndarray, fields: Mapping[str, np.ndarray], kind: str) -> np.ndarray:
    names = [(name, values.dtype.newbyteorder("<")) for name, values in fields.items()]
    table = np.zeros(len(points), [*((axis, kind) for axis in "xyz"), *names])
    for axis, name in enumerate("xyz"):
        table[name] = points[:, axis]
    for name, values in fields.items():
        table[name] = values
    return table


def _numbers(values: Iterable[float]) -> str:
    return " ".join(f"{float(value):.12g}" for value in values)
