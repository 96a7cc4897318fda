"""Scans as text: CSV (`;`, `,` or tabs) with or without a header that names X, Y and Z, XYZ and PTS split by blanks.

Lines that begin with # or // may stand before the points, and so may a line that holds their number alone. Behind so
many points another number may begin another scan, as in PTS files.

NumPy parses about a million lines in one to two seconds, the fastest of all ways at hand (its fromstring, Python's
float and split take longer); in blocks, as the lines of 50 million points take more memory than the points.
"""

import itertools
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple, TextIO

import numpy as np

from jaxmm.formats.raw_scans import BLOCK, GrowingPoints, RawScan, axes_of
from jaxmm.inputs import InputError, one_line

LONGEST_LINE = 1 << 16  # [characters] of a line before the points
MOST_DIGITS = 18  # of a number of points
COMMENTS = ("#", "//")


class _Start(NamedTuple):
    """What stands before the points of a file."""

    header: str  # a line that names x, y and z; empty where none does
    count: int  # of points, where a line of its own says so, else 0
    row: str  # the first row of numbers; empty where there is none


def rows(
    lines: Iterable[str], most: int | None = None, width: int | None = None, **how: object
) -> Iterator[np.ndarray]:
    """Blocks (n, columns) float64 of lines of numbers; empty lines do not count.

    Args:
        lines: an open file, or any iterator over lines.
        most: lines to read at most.
        width: numbers that each line must hold.
        how: further arguments of numpy.loadtxt.

    Raises:
        ValueError: a line that does not hold the numbers, named by where it stands.
    """
    lines, first = itertools.islice(lines, most), 0
    while block := list(itertools.islice(lines, BLOCK)):
        try:
            table = np.loadtxt(block, comments=None, ndmin=2, **how)
        except ValueError as error:
            where = f"after row {first}, " if first else ""
            raise ValueError(f"{where}{one_line(error)}") from error
        if table.size:
            if width is not None and table.shape[1] != width:
                raise ValueError(f"found {table.shape[1]} numbers in a line")
            yield table
        first += len(block)


def read_text(path: Path) -> list[RawScan]:
    """The scans of a file whose header names X, Y and Z, or whose first three columns are plain numbers.

    Raises:
        InputError: other columns, or X, Y or Z twice; decimal commas; a row that does not hold them; fewer rows than it
            says; text that is not UTF-8.
    """
    try:
        with open(path, encoding="utf-8-sig", errors="strict") as file:
            start = _start(file)
            delimiter = _delimiter(start.header or start.row)
            names = [name.strip().strip('"') for name in start.header.lstrip("/# ").split(delimiter)]
            columns = axes_of(names) if start.header else [0, 1, 2]
            if columns is None:
                raise InputError(f"{path}: expected columns X, Y and Z once each, got {', '.join(names)[:200]}")
            _check_first(path, start.row, delimiter, names if start.header else None)
            lines = filter(str.strip, itertools.chain([start.row], file))  # empty lines do not count
            return list(_clouds(path, lines, start.count, delimiter=delimiter, usecols=columns))
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: expected UTF-8 text, got bytes that are none") from error
    except InputError:
        raise
    except ValueError as error:
        raise InputError(f"{path}: expected rows of numbers: {error}") from error


def _clouds(path: Path, lines: Iterator[str], count: int, **how: object) -> Iterator[RawScan]:
    """One scan after the other; `count` points are told of the first, 0 where nothing is."""
    while True:
        points = GrowingPoints()
        _append(points, lines, count, **how)
        if not len(points):
            raise InputError(f"{path}: expected at least one row of points, got none")
        if len(points) < count:
            raise InputError(f"{path}: truncated: expected {count} points as it says itself, found {len(points)}")
        following = next(lines, "")
        if following and not _is_count(following):  # more points than it says
            _append(points, itertools.chain([following], lines), 0, **how)
            following = ""
        yield RawScan(points.points())
        if not following:
            return
        count = int(following[:MOST_DIGITS])


def _append(points: GrowingPoints, lines: Iterator[str], count: int, **how: object) -> None:
    """Take the next `count` rows of numbers, or all if it is 0."""
    for block in rows(lines, count or None, **how):
        points.append(block)


def _is_count(line: str) -> bool:
    bare = line.strip()
    return bare.isascii() and bare.isdigit()


def _start(file: TextIO) -> _Start:
    """All up to the first row: comments and empty lines are passed over, one that names the axes is the header."""
    header, count = "", 0
    while line := file.readline(LONGEST_LINE):
        bare = line.strip()
        names = {name.strip().strip('"').lower() for name in bare.lstrip("/# ").split(_delimiter(bare))}
        if not header and names >= {"x", "y", "z"}:
            header = bare
        elif not count and _is_count(bare):
            count = int(bare[:MOST_DIGITS])
        elif bare and not bare.startswith(COMMENTS):
            return _Start(header, count, line)
    return _Start(header, count, "")


def _delimiter(line: str) -> str | None:
    return next((mark for mark in (";", ",", "\t") if mark in line), None)


def _check_first(path: Path, line: str, delimiter: str | None, names: list[str] | None) -> None:
    """Refuse a table whose first row of numbers is none, or not of the columns that the header names, if it has one."""
    fields = [field.strip() for field in line.split(delimiter)]
    words = line.split()
    single = len(words) > 1 and all(word.count(",") == 1 and word.strip(",") == word for word in words)
    if single or (delimiter != "," and any("," in field for field in fields)):
        raise InputError(f"{path}: expected numbers with a decimal point, got decimal commas: {line.strip()[:80]}")
    if names is None:
        if len(fields) < 3 or not all(map(_is_number, fields[:3])):
            found = ", ".join(field.strip('"').lower() for field in fields)
            raise InputError(f"{path}: expected columns X, Y and Z, got {found[:200] or 'none'}")
        return
    wanted = len(names) - (names[-1:] == [""])  # a line may end in a delimiter
    found = len(fields) - (len(fields) > wanted and fields[-1] == "")
    if line and found != wanted:
        guess = "; decimal commas?" if delimiter == "," and found > wanted else ""
        raise InputError(f"{path}: expected rows of {wanted} columns as its header names, got {found}{guess}")


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True
