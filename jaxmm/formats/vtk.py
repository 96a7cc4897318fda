"""Points of legacy VTK files, as libpointmatcher and PCL write them: text, or big-endian numbers.

Kitware, "VTK File Formats": five parts, of which the points of the geometry are read: POINTS, how many, of which type,
and three coordinates each. Cells, normals and other data of points are left alone. The file says no pose.
"""

from pathlib import Path
from typing import BinaryIO

import numpy as np

from jaxmm.formats.raw_scans import RawScan, check_count, filled, records
from jaxmm.inputs import InputError, clipped

MAGIC = b"# vtk DataFile Version"
KINDS = ("POLYDATA", "UNSTRUCTURED_GRID", "STRUCTURED_GRID")
TYPES = {"float": ">f4", "double": ">f8", "int": ">i4", "long": ">i8", "short": ">i2"}
LONGEST = 4096  # [bytes] of a line of the header
MOST_LINES = 64  # before POINTS
TEXT_BYTES = 6  # of a point as text, at least: 0 0 0 and its end


def read_vtk(path: Path) -> list[RawScan]:
    """The one scan of a file.

    Raises:
        InputError: another format, no points, or fewer than the header says.
    """
    with open(path, "rb") as file:
        if not _line(path, file).startswith(MAGIC):
            raise InputError(f"{path}: expected a legacy VTK file, which begins with {MAGIC.decode()!r}")
        _line(path, file)  # its title
        coding = _line(path, file).strip().decode("ascii", "replace")
        if coding not in ("ASCII", "BINARY"):
            raise InputError(f"{path}: expected ASCII or BINARY in line 3, got {clipped(coding)!r}")
        count, kind = _promised(path, file)
        if coding == "BINARY":
            return [RawScan(_numbers(path, file, count, kind))]
        check_count(path, count, TEXT_BYTES)
        values = np.fromfile(file, np.float64, 3 * count, sep=" ")
    if len(values) != 3 * count:
        raise InputError(f"{path}: expected {count} points of three numbers, found {len(values) // 3}")
    return [RawScan(values.reshape(count, 3))]


def _line(path: Path, file: BinaryIO) -> bytes:
    line = file.readline(LONGEST)
    if len(line) == LONGEST:
        raise InputError(f"{path}: expected a header of short lines, got one of {LONGEST} bytes and more")
    return line


def _promised(path: Path, file: BinaryIO) -> tuple[int, str]:
    """How many points follow, and of which type."""
    for _ in range(MOST_LINES):
        line = _line(path, file)
        words = line.decode("ascii", "replace").split()
        if not line:
            break
        if words[:1] == ["DATASET"] and words[1:] and words[1] not in KINDS:
            raise InputError(f"{path}: expected a DATASET of {', '.join(KINDS)}, got {clipped(words[1])}")
        if words[:1] != ["POINTS"]:
            continue
        if len(words) != 3 or not words[1].isdecimal() or len(words[1]) > 12 or words[2] not in TYPES:
            told = clipped(" ".join(words))
            raise InputError(f"{path}: expected POINTS, their number, and one of {', '.join(TYPES)}, got {told!r}")
        return int(words[1]), TYPES[words[2]]
    raise InputError(f"{path}: expected POINTS within {MOST_LINES} lines, found none")


def _numbers(path: Path, file: BinaryIO, count: int, kind: str) -> np.ndarray:
    """(N, 3) of numbers that follow."""
    check_count(path, count, 3 * np.dtype(kind).itemsize)
    return filled(path, count, records(file, np.dtype([(axis, kind) for axis in "xyz"]), count))
