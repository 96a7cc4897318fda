"""PCD scans: text, binary and compressed, with the sensor's pose where VIEWPOINT tells it.

The header is read by pypcd4, the points here: pypcd4 holds several copies of all fields, and a damaged COUNT lets it
make names of fields without end.
"""

import io
import struct
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from jaxmm.formats.raw_scans import BLOCK, RawScan, check_count, check_swelling, filled, records
from jaxmm.formats.text import rows
from jaxmm.inputs import InputError, one_line

LONGEST_LINE = 1 << 16  # [bytes] of a header
MOST_LINES = 100
LARGEST_RECORD = 1 << 16  # [bytes] of a point
NO_VIEWPOINT = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)  # the default, which most writers leave as it is: it says nothing


def read_pcd(path: Path) -> list[RawScan]:
    """The points of a file.

    Raises:
        InputError: no header, or one that contradicts itself; no x, y and z; fewer points than promised.
    """
    with open(path, "rb") as file:
        header = _header(path, file)
        count, record = header.points, sum(size * times for size, times in zip(header.size, header.count, strict=True))
        if header.data == "ascii":
            check_count(path, count, 2.0 * sum(header.count))  # a digit and a gap each
            blocks = _text_points(path, file, header)
        elif header.data == "binary":
            check_count(path, count, record)
            blocks = records(file, _kind(path, header, record), count)
        else:
            check_count(path, count)
            check_swelling(path, count * record)
            blocks = _unpacked(path, file, header, count * record)
        return [RawScan(filled(path, count, blocks), *_pose(header.viewpoint))]


def _header(path: Path, file: io.BufferedReader) -> Any:
    """What pypcd4 makes of the lines up to DATA, checked against itself."""
    from pypcd4.pypcd4 import MetaData

    lines: list[str] = []
    while not lines or not lines[-1].startswith("DATA"):
        raw = file.readline(LONGEST_LINE)
        if not raw or len(lines) > MOST_LINES:
            raise InputError(f"{path}: expected a PCD header with DATA, found none")
        if line := raw.decode("ascii", "replace").strip():
            lines.append(line)
    try:
        header = MetaData.parse_header(lines)
    except Exception as error:  # its own words run over many lines
        raise InputError(f"{path}: expected a whole PCD header: {one_line(error)}") from error
    fields = len(header.fields)
    if not fields == len(header.size) == len(header.type) == len(header.count):
        raise InputError(f"{path}: expected FIELDS, SIZE, TYPE and COUNT of the same length, got {fields}, "
                         f"{len(header.size)}, {len(header.type)}, {len(header.count)}")  # fmt: skip
    if header.width * header.height != header.points:
        area = f"{header.width} x {header.height}"
        raise InputError(f"{path}: expected as many POINTS as WIDTH x HEIGHT, {area}, got {header.points}")
    if any(header.fields.count(axis) != 1 or header.count[header.fields.index(axis)] != 1 for axis in "xyz"):
        raise InputError(f"{path}: expected fields x, y and z once each, got {', '.join(header.fields)[:200]}")
    if sum(size * times for size, times in zip(header.size, header.count, strict=True)) > LARGEST_RECORD:
        raise InputError(f"{path}: expected points of at most {LARGEST_RECORD} bytes, its header promises larger ones")
    return header


def _axis_kind(path: Path, header: Any, axis: str) -> np.dtype:
    place = header.fields.index(axis)
    letter = {"F": "f", "I": "i", "U": "u"}[header.type[place]]
    sizes = (4, 8) if letter == "f" else (1, 2, 4, 8)
    if header.size[place] not in sizes:
        raise InputError(
            f"{path}: expected {axis} of {sizes} bytes, got TYPE {letter.upper()} SIZE {header.size[place]}"
        )
    return np.dtype(f"<{letter}{header.size[place]}")


def _offset(header: Any, axis: str) -> int:
    """Bytes of a point before the axis."""
    place = header.fields.index(axis)
    return sum(size * times for size, times in zip(header.size[:place], header.count[:place], strict=True))


def _kind(path: Path, header: Any, record: int) -> np.dtype:
    return np.dtype(
        {
            "names": list("xyz"),
            "formats": [_axis_kind(path, header, axis) for axis in "xyz"],
            "offsets": [_offset(header, axis) for axis in "xyz"],
            "itemsize": record,
        }
    )


def _text_points(path: Path, file: io.BufferedReader, header: Any) -> Iterator[np.ndarray]:
    columns = [sum(header.count[: header.fields.index(axis)]) for axis in "xyz"]
    lines = io.TextIOWrapper(file, "latin-1")
    try:
        for block in rows(lines, width=sum(header.count)):
            yield block[:, columns]
    except ValueError as error:
        raise InputError(f"{path}: expected points of {sum(header.count)} numbers: {error}") from error


def _unpacked(path: Path, file: io.BufferedReader, header: Any, size: int) -> Iterable[np.ndarray]:
    """Blocks of what one compressed lump holds: all x, then all y, and so on."""
    import lzf  # comes with pypcd4

    sizes = file.read(8)
    packed, unpacked = struct.unpack("<II", sizes) if len(sizes) == 8 else (0, 0)
    if unpacked != size:
        raise InputError(f"{path}: expected {size} bytes of points as its header promises, got {unpacked}")
    lump = file.read(packed) if packed <= path.stat().st_size else b""
    if len(lump) != packed or not packed:
        raise InputError(f"{path}: truncated: expected {packed} bytes of compressed points, got {len(lump)}")
    lump = lzf.decompress(lump, size)
    if lump is None or len(lump) != size:
        raise InputError(f"{path}: expected compressed points, got what does not unpack to {size} bytes")
    axes = [
        np.frombuffer(lump, _axis_kind(path, header, axis), header.points, header.points * _offset(header, axis))
        for axis in "xyz"
    ]
    for start in range(0, header.points, BLOCK):
        yield np.column_stack([axis[start : start + BLOCK].astype(np.float64) for axis in axes])


def _pose(viewpoint: tuple[float, ...]) -> tuple[np.ndarray | None, np.ndarray | None]:
    """Position and rotation; None where the file says nothing, or what is no rotation."""
    from scipy.spatial.transform import Rotation

    x, y, z, w, i, j, k = viewpoint
    if tuple(viewpoint) == NO_VIEWPOINT or not 0.5 < np.linalg.norm([w, i, j, k]) < 2.0:
        return None, None
    return np.array([x, y, z]), Rotation.from_quat([i, j, k, w]).as_matrix()
