"""Scans as text: CSV (`;`, `,` or tabs) with or without a header that names X, Y and Z, and XYZ split by blanks.

NumPy parses about a million lines in one to two seconds, the fastest of all ways at hand (its fromstring, Python's
float and split take longer); in blocks, as the lines of 50 million points take more memory than the points.
"""

import itertools
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from jaxmm.inputs import InputError
from jaxmm.raw_scans import BLOCK, RawScan

LONGEST_LINE = 1 << 16  # [characters] of the first line


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
            raise ValueError(f"{where}{' '.join(str(error).split())[:200]}") from error
        if table.size:
            if width is not None and table.shape[1] != width:
                raise ValueError(f"found {table.shape[1]} numbers in a line")
            yield table
        first += len(block)


def read_text(path: Path) -> list[RawScan]:
    """The points of a file whose header names X, Y and Z, or whose first three columns are plain numbers.

    Raises:
        InputError: other columns; decimal commas; a row that does not hold them; text that is not UTF-8.
    """
    try:
        with open(path, encoding="utf-8-sig", errors="strict") as file:
            first = file.readline(LONGEST_LINE)
            delimiter = next((mark for mark in (";", ",", "\t") if mark in first), None)
            names = [name.strip().strip('"').lower() for name in first.lstrip("/# ").split(delimiter)]
            if all(axis in names for axis in "xyz"):
                columns = [names.index(axis) for axis in "xyz"]
                lines: Iterable[str] = file
            else:
                columns = [0, 1, 2]
                lines = itertools.chain([first], file)
            start = list(itertools.islice(lines, 1))
            _check_first(path, start[0] if start else "", delimiter, names)
            blocks = list(rows(itertools.chain(start, lines), delimiter=delimiter, usecols=columns))
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: expected UTF-8 text, got bytes that are none") from error
    except InputError:
        raise
    except ValueError as error:
        raise InputError(f"{path}: expected rows of numbers: {error}") from error
    if not blocks:
        raise InputError(f"{path}: expected at least one row of points, got none")
    return [RawScan(np.concatenate(blocks))]


def _check_first(path: Path, line: str, delimiter: str | None, names: list[str]) -> None:
    """Refuse a table whose first row of numbers is none, or not of the columns that the header names."""
    fields = [field.strip() for field in line.split(delimiter)]
    words = line.split()
    single = len(words) > 1 and all(word.count(",") == 1 and word.strip(",") == word for word in words)
    if single or (delimiter != "," and any("," in field for field in fields)):
        raise InputError(f"{path}: expected numbers with a decimal point, got decimal commas: {line.strip()[:80]}")
    if not all(axis in names for axis in "xyz"):
        if len(fields) < 3 or not all(map(_is_number, fields[:3])):
            raise InputError(f"{path}: expected columns X, Y and Z, got {', '.join(names)[:200]}")
        return
    wanted, found = (len(row) - (row[-1:] == [""]) for row in (names, fields))  # the last may end in a delimiter
    if line.strip() and found != wanted:
        guess = "; decimal commas?" if delimiter == "," and found > wanted else ""
        raise InputError(f"{path}: expected rows of {wanted} columns as its header names, got {found}{guess}")


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True
