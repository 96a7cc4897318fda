"""What stands before the numbers of a text file: encoding, header, delimiter, and which columns are x, y and z.

Surveyors' programs name columns in their language, and write decimal commas where commas do not split the columns.
"""

import csv
import itertools
import re
import unicodedata
from pathlib import Path
from typing import NamedTuple, TextIO

from jaxmm.formats.raw_scans import axes_of
from jaxmm.inputs import InputError, clipped

LONGEST_LINE = 1 << 16  # [characters] of a line before the points
MOST_DIGITS = 18  # of a number of points
COMMENTS = ("#", "//")
UTF_8, WINDOWS = "utf-8-sig", "cp1252"
UNKNOWN = "expected UTF-8, UTF-16 or Windows-1252 text, got bytes that are none"
HEAD = 4096  # [bytes] that tell the encoding
MARKS = {b"\xff\xfe": "utf-16", b"\xfe\xff": "utf-16"}
NO_TEXT = set(range(9)) | {11, *range(14, 27)}  # bytes that no text holds
# Easting, northing and height, by how they are called in one program: all three of a row, or none.
NAMES = (
    ("x", "y", "z"), ("easting", "northing", "elevation"), ("easting", "northing", "height"), ("e", "n", "h"),
    ("east", "north", "height"), ("east", "north", "elevation"), ("east", "north", "up"), ("e", "n", "z"),
    ("rechtswert", "hochwert", "hohe"), ("rechts", "hoch", "hohe"), ("ost", "nord", "hohe"), ("e", "n", "hohe"),
    ("ostwert", "nordwert", "hohe"), ("est", "nord", "altitude"), ("est", "nord", "hauteur"), ("est", "nord", "z"),
    ("points0", "points1", "points2"), ("pointsx", "pointsy", "pointsz"),
)  # fmt: skip
# What a name says besides its axis.
BESIDE = re.compile(r"koordinaten?|coordonnees?|coordinates?|coords?|koord|achse|axis|wert")
UNITS = re.compile(r"\((?:mm|cm|m|ft|in)\)|\[(?:mm|cm|m|ft|in)\]")
WHOLE = re.compile(r"[+-]?\d+(?:[eE][+-]?\d+)?")
FRACTION = re.compile(r"[+-]?\d*[.,]\d*(?:[eE][+-]?\d+)?")
DECIMAL_COMMA = re.compile(r"[+-]?\d+,\d+(?:[eE][+-]?\d+)?")


class Start(NamedTuple):
    """What stands before the points of a file, and their first row."""

    header: str  # a line that names x, y and z; empty where none does
    count: int  # of points, where a line of its own says so, else 0
    row: str  # the first row of numbers; empty where there is none

    @property
    def delimiter(self) -> str | None:
        """Between columns; None: blanks."""
        line = self.header or self.row
        found = delimiter_of(line)
        # Without a header, blanks split what looks like decimal commas: 1,5 2,5 3,5.
        words = self.row.split()
        alone = not self.header and len(words) >= 3 and all(DECIMAL_COMMA.fullmatch(word) for word in words[:3])
        return None if found == "," and alone else found

    def names(self) -> list[str]:
        """Of the columns, as the header has them."""
        return fields_of(self.header.lstrip("/# "), self.delimiter) if self.header else []


def encoding_of(path: Path) -> str:
    """How the text of a file is encoded: UTF-8 if it can be, else what older programs write on Windows.

    Raises:
        InputError: it holds bytes that no text does.
    """
    with open(path, "rb") as file:
        head = file.read(HEAD)
        if (mark := head[:2]) in MARKS:
            return MARKS[mark]
        try:
            head.decode("utf-8")
        except UnicodeDecodeError as error:
            if error.start < len(head) - 4 or len(head) < HEAD:  # no character that is cut off
                if NO_TEXT.isdisjoint(head) and b"\n" in head:
                    return WINDOWS
                raise InputError(f"{path}: {UNKNOWN}") from error
    return UTF_8


def start_of(file: TextIO) -> Start:
    """All up to the first row: comments and empty lines are passed over, one that names the axes is the header."""
    header, count = "", 0
    while line := file.readline(LONGEST_LINE):
        bare = line.strip()
        if not header and named_axes(fields_of(bare.lstrip("/# "), delimiter_of(bare)), once=False) is not None:
            header = bare
        elif not count and is_count(bare):
            count = int(bare[:MOST_DIGITS])
        elif bare and not bare.startswith(COMMENTS):
            return Start(header, count, line)
    return Start(header, count, "")


def remarks_on_end(path: Path) -> tuple[str, ...]:
    """What is to be said of a text file that ends within a line, as one does that was cut off; nothing of any other.

    Most programs end the last line, some do not: where it has all its columns, its last number may still be cut.

    Raises:
        InputError: that line has fewer columns than the one before.
    """
    with open(path, "rb") as file:
        file.seek(max(0, path.stat().st_size - 2 * LONGEST_LINE))
        *before, last = re.split(rb"[\r\n]", file.read())
    if not last.strip() or b"\0" in last or not before:  # of UTF-16 only every second byte tells
        return ()
    previous = next((line.decode("latin-1") for line in reversed(before) if line.strip()), "")
    delimiter = delimiter_of(previous)
    # A line may end in a delimiter or not.
    told, wanted = (
        len(fields_of(line.rstrip().rstrip(delimiter), delimiter)) for line in (last.decode("latin-1"), previous)
    )
    if told < wanted:
        raise InputError(
            f"{path}: truncated: it ends within a line of {told} columns, where the one before has {wanted}: "
            f"{clipped(last.decode('latin-1'))!r}"
        )
    return ("its last line has no end: if the file was cut off there, its last number is not whole",)


def named_axes(names: list[str], once: bool = True) -> list[int] | None:
    """Where x, y and z stand among the names of columns, in one of NAMES; None where they do not stand there once each.

    `once` False: it is enough that they are there.
    """
    if {name.lower() for name in names} >= {"x", "y", "z"}:
        return axes_of(names) if once else [0, 0, 0]
    plain = [_plain(name) for name in names]
    for axes in NAMES:
        if all(plain.count(axis) == 1 for axis in axes):
            return [plain.index(axis) for axis in axes]
    return None


def missing_axis(names: list[str]) -> str:
    """Which of X, Y and Z is not among the names of columns, where the other two are; empty where no one alone is."""
    plain = {_plain(name) for name in names}
    lost = ([axis for axis, name in zip("XYZ", axes, strict=True) if name not in plain] for axes in NAMES)
    return next((axis for axis, *others in filter(None, lost) if not others), "")


def is_count(line: str) -> bool:
    """Whether a line holds a number of points and nothing else."""
    bare = line.strip()
    return bare.isascii() and bare.isdigit()


def counts_points(lines: list[str], delimiter: str | None) -> bool:
    """Whether the first of four columns or more, without names, counts the points: whole, rising, beside fractions."""
    table = [fields_of(line, delimiter)[:4] for line in lines if line.strip() and not is_count(line)]
    if len(table) < 2 or any(len(row) < 4 or not is_count(row[0]) for row in table):
        return False
    if any(not FRACTION.fullmatch(field) and not WHOLE.fullmatch(field) for row in table for field in row[1:]):
        return False  # X, Y and Z would hold a word
    numbers = [int(row[0][:MOST_DIGITS]) for row in table]
    fractions = sum(all(FRACTION.fullmatch(row[axis]) for row in table) for axis in (1, 2, 3))
    return fractions >= 2 and all(a < b for a, b in itertools.pairwise(numbers))


def delimiter_of(line: str) -> str | None:
    """What splits a line into columns; None: blanks."""
    return next((mark for mark in (";", ",", "\t") if mark in line), None)


def fields_of(line: str, delimiter: str | None) -> list[str]:
    """The columns of a line, without the quotes around them."""
    if delimiter is None:
        return [word.strip('"') for word in line.split()]
    return [field.strip().strip('"') for field in next(csv.reader([line.strip()], delimiter=delimiter), [])]


def _plain(name: str) -> str:
    """A name in small letters without accents, units, and words for coordinates: "Y-Koordinate [m]" is y."""
    letters = unicodedata.normalize("NFKD", UNITS.sub("", name.lower().replace("ö", "o").replace("oe", "o")))
    bare = "".join(letter for letter in letters if letter.isascii() and letter.isalnum())
    return BESIDE.sub("", bare) if bare not in ("rechtswert", "hochwert", "ostwert", "nordwert") else bare
