"""PTX scans: text, a grid of columns and rows for each scan, with the pose of its scanner and its way to the world.

A scan begins with ten lines: how many columns; how many rows; the position of the scanner; its three axes, a line each;
and a 4x4 matrix by which rows (x, y, z, 1) are multiplied from the right. A line for each ray of the grid follows. Rays
that came back from nowhere are written as 0 0 0: they are left out, and so unseen.

Most programs write the scanner's frame, and its pose twice: as position and axes, and as the matrix. Points that are in
the world already come with the identity as matrix.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple, TextIO

import numpy as np

from jaxmm.formats.raw_scans import MOST_POINTS, GrowingPoints, RawScan, to_world
from jaxmm.formats.text import rows
from jaxmm.formats.text_header import COMMENTS, LONGEST_LINE, remarks_on_end
from jaxmm.inputs import InputError

AXES = (0, 1, 2)  # columns of x, y and z
LEAST_LINE = 6  # [bytes] of 0 0 0 and its end
RIGHT_ANGLES = 1e-3  # by which the product of a rotation with its transpose may be off the identity
SAME_PLACE = 0.01  # of the file's unit: positions in one header that are nearer to each other are one
HEADER = (
    ("the number of columns", 1), ("the number of rows", 1), ("the position of the scanner", 3),
    *((f"the {axis} axis of the scanner", 3) for axis in "xyz"), *((f"row {row} of a 4x4 matrix", 4) for row in "1234"),
)  # fmt: skip


class _Header(NamedTuple):
    """What stands before the rays of a scan."""

    count: int  # of rays
    position: np.ndarray  # (3,) of the scanner in the world
    rotation: np.ndarray  # (3, 3) its axes are the columns
    linear: np.ndarray  # (3, 3) takes points to the world, then
    shift: np.ndarray  # (3,) is added


def read_ptx(path: Path) -> list[RawScan]:
    """All scans of a file, in the world, each with the pose of its scanner.

    A scan has no pose where its header names two places, or its matrix is no rotation and shift; a remark says so. Nor
    has one whose header says nothing at all, and whose points do not lie around its zero.

    Raises:
        InputError: no header of ten lines; rays that are no numbers; fewer of them than it says.
    """
    found: list[RawScan] = []
    try:
        with open(path, encoding="utf-8-sig") as file:
            first = 1
            while start := _header(path, file, first, len(found) + 1):
                header, first = start
                found.append(_scan(path, file, header, first, len(found) + 1))
                first += header.count
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: expected PTX as text, got bytes that are none") from error
    found[-1] = found[-1]._replace(remarks=(*found[-1].remarks, *remarks_on_end(path)))
    return found


def _header(path: Path, file: TextIO, first: int, number: int) -> tuple[_Header, int] | None:
    """The next header and the number of the line behind it; None at the end of the file."""
    values: list[np.ndarray] = []
    while len(values) < len(HEADER):
        line = file.readline(LONGEST_LINE)
        if not values and not line and number > 1:
            return None
        bare = line.strip()
        if values or not line or (bare and not bare.startswith(COMMENTS)):  # these count nowhere between scans
            values.append(_values(path, line, first, number, *HEADER[len(values)]))
        first += 1
    return _checked_header(path, values, number), first


def _values(path: Path, line: str, first: int, number: int, wanted: str, width: int) -> np.ndarray:
    """The numbers (width,) of a line of a header."""
    try:
        row = np.array([float(word) for word in line.split()])
    except ValueError:
        row = np.zeros(0)
    if len(row) != width or not np.isfinite(row).all() or (width == 1 and not 0 <= row[0] == int(row[0])):
        raise InputError(f"{path}: line {first}: expected {wanted} of scan {number}, got {line.strip()[:80]!r}")
    return row


def _checked_header(path: Path, values: list[np.ndarray], number: int) -> _Header:
    columns, lines = int(values[0][0]), int(values[1][0])
    count, size = columns * lines, path.stat().st_size
    if not 0 <= count <= MOST_POINTS or count * LEAST_LINE > size + 1:
        raise InputError(
            f"{path}: scan {number}: expected rays that fit into its {size} bytes, its header promises "
            f"{columns} x {lines}"
        )
    matrix = np.array(values[6:])
    if not matrix[3, :3].any() and matrix[:3, 3].any():  # some write it by columns
        matrix = matrix.T
    if matrix[:3, 3].any() or matrix[3, 3] != 1.0:
        raise InputError(f"{path}: scan {number}: expected a 4x4 matrix with 0 0 0 1, got {matrix.tolist()}")
    return _Header(count, values[2], np.array(values[3:6]).T, matrix[:3, :3].T, matrix[3, :3])


def _scan(path: Path, file: TextIO, header: _Header, first: int, number: int) -> RawScan:
    points, found = GrowingPoints(), 0
    for block in _rays(path, file, header.count, first, number):
        found += len(block)
        points.append(block[(block != 0.0).any(axis=1)])
    if found < header.count:
        raise InputError(
            f"{path}: truncated: expected {header.count} rays of scan {number} as its header promises, found {found}"
        )
    return _placed(points.points(), header, number)


def _rays(path: Path, file: TextIO, count: int, first: int, number: int) -> Iterator[np.ndarray]:
    last = ""

    def lines() -> Iterator[str]:
        nonlocal last
        for line in file:
            last = line
            yield line

    try:
        yield from rows(lines(), count, usecols=AXES)
    except UnicodeDecodeError:
        raise
    except ValueError as error:
        if _is_cut(last):
            raise InputError(
                f"{path}: truncated: expected {count} rays of scan {number} as its header promises, the file ends "
                f"inside a line: {last[:80]!r}"
            ) from error
        raise InputError(
            f"{path}: scan {number}: expected {count} lines of x y z and more from line {first} on: {error}"
        ) from error


def _is_cut(line: str) -> bool:
    """Whether a file ends within this line of a ray: it has no end, and does not hold all numbers."""
    if line.endswith("\n"):
        return False
    try:
        return not list(rows([line], usecols=AXES))
    except ValueError:
        return True


def _placed(points: np.ndarray, header: _Header, number: int) -> RawScan:
    """Points taken to the world, with the pose if the header tells one."""
    identity = np.array_equal(header.linear, np.eye(3)) and not header.shift.any()
    untold = not header.position.any() and np.array_equal(header.rotation, np.eye(3))
    if identity and untold and not _surround_zero(points):
        return RawScan(points)
    if not identity:
        to_world(points, header.linear, header.shift)
    if not _is_rotation(header.linear):
        told = f"the matrix of scan {number} is no rotation and shift: its points are moved by it, but it tells no pose"
        return RawScan(points, remarks=(told,))
    if identity:
        rotation = header.rotation if _is_rotation(header.rotation) else np.eye(3)
        return RawScan(points, header.position, rotation, in_world=True)
    if header.position.any() and np.abs(header.position - header.shift).max() > SAME_PLACE:
        by_position, by_matrix = (
            " ".join(f"{value:.10g}" for value in place) for place in (header.position, header.shift)
        )
        told = f"scan {number} names two places of its scanner, {by_position} and, by its matrix, {by_matrix}: it is "
        return RawScan(points, remarks=(f"{told}read without a pose",))
    return RawScan(points, header.shift, header.linear, in_world=True)


def _is_rotation(turn: np.ndarray) -> bool:
    return bool(np.abs(turn @ turn.T - np.eye(3)).max() < RIGHT_ANGLES and np.linalg.det(turn) > 0.0)


def _surround_zero(points: np.ndarray) -> bool:
    """Whether the box around points (N, 3) holds 0, 0 in plan, as of a scanner in its own frame."""
    return bool(len(points) and (points[:, :2].min(axis=0) < 0.0).all() and (points[:, :2].max(axis=0) > 0.0).all())
