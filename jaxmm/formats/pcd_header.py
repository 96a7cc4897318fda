"""What stands before the points of a PCD file: fields, how they lie, and where the sensor stood.

Versions .5 to .7, as the Point Cloud Library reads them: SIZE, TYPE and COUNT may be missing (4, F and 1 each), as may
WIDTH and HEIGHT, and VIEWPOINT; fields were once called COLUMNS. A field with a COUNT of 0 takes no bytes.
"""

import io
from pathlib import Path
from typing import NamedTuple

import numpy as np

from jaxmm.formats.cloud_files import OFFSET, SENSOR, numbers_after
from jaxmm.formats.raw_scans import axes_of
from jaxmm.inputs import InputError

LONGEST_LINE = 1 << 16  # [bytes] of a header
MOST_LINES = 100
LARGEST_RECORD = 1 << 16  # [bytes] of a point
WORDS = ("VERSION", "FIELDS", "COLUMNS", "SIZE", "TYPE", "COUNT", "WIDTH", "HEIGHT", "VIEWPOINT", "POINTS", "DATA")
SIZES = {"F": (4, 8), "I": (1, 2, 4, 8), "U": (1, 2, 4, 8)}
DATA = ("ascii", "binary", "binary_compressed")


class PcdHeader(NamedTuple):
    """The header of a file; K fields."""

    sizes: list[int]  # (K,) bytes of a number
    counts: list[int]  # (K,) numbers of a field
    axes: list[int]  # which fields are x, y and z
    kinds: list[np.dtype]  # (3,) of x, y and z
    points: int
    viewpoint: list[float]  # (7,) position, and quaternion w, x, y, z
    data: str  # one of DATA
    offset: list[float]  # (3,) to be added to all coordinates, as files of ours say in a comment
    sensor: list[float] | None  # (7,) as `viewpoint`, of points that are in the world, in the same manner

    @property
    def record(self) -> int:
        """Bytes of a point."""
        return sum(size * count for size, count in zip(self.sizes, self.counts, strict=True))

    def offsets(self) -> list[int]:
        """(3,) bytes of a point before x, y and z."""
        fields = list(zip(self.sizes, self.counts, strict=True))
        return [sum(size * count for size, count in fields[:axis]) for axis in self.axes]

    def columns(self) -> list[int]:
        """(3,) numbers of a line before x, y and z."""
        return [sum(self.counts[:axis]) for axis in self.axes]


def read_pcd_header(path: Path, file: io.BufferedReader) -> PcdHeader:
    """The header of an open file, which is then at its first point.

    Raises:
        InputError: no header with FIELDS and DATA, or one that contradicts itself or has no x, y and z.
    """
    told, number, offset, sensor = {}, 0, [0.0] * 3, None
    while "DATA" not in told:
        raw = file.readline(LONGEST_LINE)
        number += 1
        if not raw or number > MOST_LINES:
            raise InputError(f"{path}: expected a PCD header with DATA, found none")
        words = raw.decode("ascii", "replace").split()
        if words and words[0] in WORDS:
            told[words[0]] = (number, words[1:])
        elif words[:1] == ["#"]:
            offset, sensor = (
                numbers_after(OFFSET, words[1:], 3) or offset,
                numbers_after(SENSOR, words[1:], 7) or sensor,
            )
    names = told.get("FIELDS", told.get("COLUMNS", (0, [])))[1]
    sizes, counts = _wholes(path, told, "SIZE", [4] * len(names)), _wholes(path, told, "COUNT", [1] * len(names))
    types = told.get("TYPE", (0, ["F"] * len(names)))[1]
    if not len(names) == len(sizes) == len(types) == len(counts):
        raise InputError(
            f"{path}: expected FIELDS, SIZE, TYPE and COUNT of the same length, got {len(names)}, {len(sizes)}, "
            f"{len(types)}, {len(counts)}"
        )
    axes = axes_of([name if count else "" for name, count in zip(names, counts, strict=True)])
    if axes is None or any(counts[axis] != 1 for axis in axes):
        raise InputError(f"{path}: expected fields x, y and z once each, got {', '.join(names)[:200] or 'none'}")
    kinds = [_axis_kind(path, name, types[axis], sizes[axis]) for name, axis in zip("xyz", axes, strict=True)]
    data = " ".join(told["DATA"][1])
    if data.lower() not in DATA:
        raise InputError(f"{path}: line {told['DATA'][0]}: expected DATA {', '.join(DATA)}, got {data[:80]!r}")
    found = PcdHeader(
        sizes, counts, axes, kinds, _count(path, told), _viewpoint(path, told), data.lower(), offset, sensor
    )
    if found.record > LARGEST_RECORD:
        raise InputError(f"{path}: expected points of at most {LARGEST_RECORD} bytes, its header promises larger ones")
    return found


def _count(path: Path, told: dict[str, tuple[int, list[str]]]) -> int:
    """How many points there are, of which WIDTH and HEIGHT, and POINTS, tell alike."""
    (points, *_), (width, *_), (height, *_) = (
        _wholes(path, told, name, [gap]) or [gap] for name, gap in (("POINTS", -1), ("WIDTH", -1), ("HEIGHT", 1))
    )
    if points < 0 and width < 0:
        raise InputError(f"{path}: expected a PCD header with WIDTH and HEIGHT, or POINTS, found neither")
    if 0 <= points != width * height >= 0:
        raise InputError(f"{path}: expected as many POINTS as WIDTH x HEIGHT, {width} x {height}, got {points}")
    return points if points >= 0 else width * height


def _wholes(path: Path, told: dict[str, tuple[int, list[str]]], name: str, gap: list[int]) -> list[int]:
    if name not in told:
        return gap
    number, words = told[name]
    if not all(word.isascii() and word.isdigit() and len(word) <= 18 for word in words):
        raise InputError(f"{path}: line {number}: expected {name} in whole numbers, got {' '.join(words)[:80]!r}")
    return [int(word) for word in words]


def _axis_kind(path: Path, name: str, letter: str, size: int) -> np.dtype:
    if size not in SIZES.get(letter.upper(), ()):
        sizes = SIZES.get(letter.upper(), "TYPE F, I or U, and 4 or 8")
        raise InputError(f"{path}: expected {name} of {sizes} bytes, got TYPE {letter[:8]} SIZE {size}")
    return np.dtype(f"<{letter.lower()}{size}")


def _viewpoint(path: Path, told: dict[str, tuple[int, list[str]]]) -> list[float]:
    if "VIEWPOINT" not in told:
        return [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]
    number, words = told["VIEWPOINT"]
    try:
        values = [float(word) for word in words]
    except ValueError:
        values = []
    if len(values) != 7:
        raise InputError(f"{path}: line {number}: expected VIEWPOINT and 7 numbers, got {' '.join(words)[:80]!r}")
    return values
