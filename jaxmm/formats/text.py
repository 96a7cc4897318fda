"""Scans as text: CSV (`;`, `,` or tabs) with or without a header that names X, Y and Z, XYZ and PTS split by blanks.

Lines that begin with # or // may stand before the points, and so may a line that holds their number alone. Behind so
many points another number may begin another scan, as in PTS files. A first column that counts the points is none of X,
Y and Z.

NumPy parses about a million lines in one to two seconds, the fastest of all ways at hand (its fromstring, Python's
float and split take longer); in blocks, as the lines of 50 million points take more memory than the points.
"""

import contextlib
import itertools
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from jaxmm.formats.raw_scans import BLOCK, GrowingPoints, RawScan
from jaxmm.formats.text_header import (
    DECIMAL_COMMA,
    MOST_DIGITS,
    UNKNOWN,
    UTF_8,
    WINDOWS,
    counts_points,
    encoding_of,
    fields_of,
    is_count,
    missing_axis,
    named_axes,
    remarks_on_end,
    start_of,
)
from jaxmm.inputs import InputError, one_line

AHEAD = 100  # rows behind the first that tell whether a column counts them
NUMBERED = "its first column counts the points: X, Y and Z were taken from the three behind it"
DECIMAL_POINT = "expected numbers with a decimal point, got decimal commas"


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
        InputError: other columns, or X, Y or Z twice; decimal commas where commas split the columns; a row that does
            not hold them; fewer rows than it says; no text.
    """
    told = encoding_of(path)
    for encoding in (told, WINDOWS) if told == UTF_8 else (told,):
        with contextlib.suppress(UnicodeDecodeError):
            return _read(path, encoding)
    raise InputError(f"{path}: {UNKNOWN}")


def _read(path: Path, encoding: str) -> list[RawScan]:
    try:
        with open(path, encoding=encoding) as file:
            start = start_of(file)
            delimiter, names = start.delimiter, start.names()
            rows_ahead = [start.row, *itertools.islice(file, AHEAD)]
            numbered = not start.header and counts_points(rows_ahead, delimiter)
            columns = named_axes(names) if start.header else [1, 2, 3] if numbered else [0, 1, 2]
            if columns is None:
                raise InputError(f"{path}: expected columns X, Y and Z once each, got {', '.join(names)[:200]}")
            commas = _has_decimal_commas(start.row, delimiter, columns)
            if commas and delimiter == ",":  # within quotes
                raise InputError(f"{path}: {DECIMAL_POINT}: {start.row.strip()[:80]}")
            _check_first(path, start.row.replace(",", ".") if commas else start.row, delimiter, names or None)
            lines = filter(str.strip, itertools.chain(rows_ahead, file))  # empty lines do not count
            if commas:
                lines = (line.replace(",", ".") for line in lines)
            how = {"delimiter": delimiter, "usecols": columns, "quotechar": '"' if '"' in start.row else None}
            told = ("its decimal commas were read as points",) if commas else ()
            told += (NUMBERED,) if numbered else ()
            found = [one._replace(remarks=told) for one in _clouds(path, lines, start.count, **how)]
        found[-1] = found[-1]._replace(remarks=(*told, *remarks_on_end(path)))
        return found
    except (InputError, UnicodeDecodeError):
        raise
    except ValueError as error:
        raise InputError(f"{path}: expected rows of numbers: {error}") from error


def _has_decimal_commas(row: str, delimiter: str | None, columns: list[int]) -> bool:
    """Whether a coordinate of a row has one; where commas split the columns, it can have one within quotes only."""
    fields = fields_of(row, delimiter)
    return len(fields) > max(columns) and any(DECIMAL_COMMA.fullmatch(fields[column]) for column in columns)


def _clouds(path: Path, lines: Iterator[str], count: int, **how: object) -> Iterator[RawScan]:
    """One scan after the other; `count` points are told of the first, 0 where nothing is."""
    first = True
    while True:
        points = GrowingPoints()
        if count or first:
            _append(points, lines, count, **how)
            if not len(points):
                raise InputError(f"{path}: expected at least one row of points, got none")
        if len(points) < count:
            raise InputError(f"{path}: truncated: expected {count} points as it says itself, found {len(points)}")
        following = next(lines, "")
        if following and not is_count(following):  # more points than it says
            _append(points, itertools.chain([following], lines), 0, **how)
            following = ""
        yield RawScan(points.points())
        if not following:
            return
        count, first = int(following[:MOST_DIGITS]), False


def _append(points: GrowingPoints, lines: Iterator[str], count: int, **how: object) -> None:
    """Take the next `count` rows of numbers, or all if it is 0."""
    for block in rows(lines, count or None, **how):
        points.append(block)


def _check_first(path: Path, line: str, delimiter: str | None, names: list[str] | None) -> None:
    """Refuse a table whose first row of numbers is none, or not of the columns that the header names, if it has one."""
    fields = fields_of(line, delimiter)
    words = line.split()
    if names is None and len(words) > 1 and all(DECIMAL_COMMA.fullmatch(word.rstrip(",")) for word in words):
        raise InputError(f"{path}: {DECIMAL_POINT}: {line.strip()[:80]}")
    if names is None:
        if len(fields) < 3 or not all(map(_is_number, fields[:3])):
            found, missing = ", ".join(fields), missing_axis(fields)
            told = f": {missing} is missing" if missing else ""
            if len(fields) > 3 and not _is_number(fields[0]) and all(map(_is_number, fields[1:4])):
                told = ": its first column holds names; a first line that names the columns tells which are X, Y and Z"
            raise InputError(f"{path}: expected columns X, Y and Z, got {found[:200] or 'none'}{told}")
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
