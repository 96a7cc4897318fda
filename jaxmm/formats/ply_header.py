"""What stands before the numbers of a PLY file: its elements, their properties, and how binary ones lie."""

import io
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from jaxmm.formats.cloud_files import OFFSET, numbers_after
from jaxmm.formats.raw_scans import BLOCK, MOST_POINTS
from jaxmm.inputs import InputError

LONGEST_HEADER = 1 << 20  # [bytes]
LONGEST_LINE = 1 << 12  # [bytes]
MOST_PROPERTIES = 10_000
ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
KINDS = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4",
    "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4",
    "int64": "i8", "uint64": "u8", "float32": "f4", "float64": "f8",
}  # fmt: skip
LETTERS = {"i1": "b", "u1": "B", "i2": "h", "u2": "H", "i4": "i", "u4": "I", "i8": "q", "u8": "Q"}  # as struct has them


class Property(NamedTuple):
    """A number of an element, or a list of numbers."""

    name: str
    kind: np.dtype  # of the number, or of each in the list
    length: np.dtype | None = None  # of the number that tells how long the list is


class Element(NamedTuple):
    """A table of the file. Its plain properties lie in runs, between which its lists do."""

    name: str  # in small letters
    count: int
    properties: list[Property]

    def has_lists(self) -> bool:
        """Whether its rows may differ in length."""
        return any(one.length is not None for one in self.properties)

    def plain_places(self) -> list[int]:
        """Where among its properties those stand that are no lists."""
        return [place for place, one in enumerate(self.properties) if one.length is None]

    def plain_names(self) -> list[str]:
        """The names of those."""
        return [self.properties[place].name for place in self.plain_places()]

    def kind(self) -> np.dtype:
        """A row of an element without lists, with the fields f0, f1, ... as names may be given twice."""
        return np.dtype([(f"f{place}", one.kind) for place, one in enumerate(self.properties)])

    def least_size(self, order: str) -> float:
        """Bytes that a row takes at least: as text a digit and a gap for each property."""
        return 2.0 * len(self.properties) if not order else float(sum(_size(one) for one in self.properties))

    def offset_of(self, place: int) -> tuple[int, int]:
        """In which run a plain property lies, and how many bytes behind its beginning."""
        run = offset = 0
        for one in self.properties[:place]:
            run, offset = (run, offset + one.kind.itemsize) if one.length is None else (run + 1, 0)
        return run, offset

    def walk(self, path: Path, content: object, at: int) -> Iterator[tuple[np.ndarray, int]]:
        """Blocks (n, runs) int64 of the bytes at which runs of rows begin, and the byte behind the block.

        Args:
            path: the file, for the error.
            content: its bytes.
            at: where its first row begins.

        Raises:
            InputError: a list of negative length, or rows beyond the end of the file.
        """
        lists, before = [], 0
        for one in self.properties:
            if one.length is None:
                before += one.kind.itemsize
            else:
                length = struct.Struct((">" if one.length.str[0] == ">" else "<") + LETTERS[one.length.str[1:]])
                lists.append((before, length.unpack_from, length.size, one.kind.itemsize))
                before = 0
        for first in range(0, self.count, BLOCK):
            places = []
            for number in range(first, min(first + BLOCK, self.count)):
                runs = [at]
                for skipped, unpack, size, item in lists:
                    counted = at + skipped + size <= len(content)
                    length = unpack(content, at + skipped)[0] if counted else -1
                    at += skipped + size + length * item
                    if length < 0 or at > len(content):
                        raise InputError(
                            f"{path}: {self.name} {number}: expected lists that fit into {len(content)} bytes, got one "
                            + (f"of length {length}" if counted else "cut off")
                        )
                    runs.append(at)
                at += before
                places.append(runs)
            if at > len(content):
                raise InputError(f"{path}: truncated: expected {self.count} of {self.name}, found the end of the file")
            yield np.array(places, np.int64), at


def read_header(path: Path, file: io.BufferedReader) -> tuple[list[Element], str, list[float]]:
    """The elements of a file; its byte order: "<", ">", or "" of text; and what is to be added to its coordinates.

    The last (3,) is told by comments of our own files. The file is then at its first row.

    Raises:
        InputError: no header, or a line in it that says nothing of PLY.
    """
    if file.readline(LONGEST_LINE).strip() != b"ply":
        raise InputError(f"{path}: expected a PLY file, with a header from `ply` to `end_header`, found none")
    elements, order, number, offset = [], None, 1, [0.0] * 3
    while file.tell() < LONGEST_HEADER:
        raw = file.readline(LONGEST_LINE)
        number += 1
        words = raw.decode("latin-1").split()
        if not raw:
            break
        if words[:1] == ["end_header"]:
            if order is None:
                raise _wrong(path, number, "format ascii, binary_little_endian or binary_big_endian before", words)
            return elements, order, offset
        if words[:1] == ["format"]:
            order = ORDERS.get("".join(words[1:2]))
            if order is None:
                raise _wrong(path, number, "PLY that is ascii, binary_little_endian or binary_big_endian", words)
        elif words[:1] == ["comment"]:
            offset = numbers_after(OFFSET, words[1:], 3) or offset
        elif words[:1] == ["element"]:
            elements.append(_element(path, number, words))
        elif words[:1] == ["property"]:
            if not elements or len(elements[-1].properties) >= MOST_PROPERTIES:
                raise _wrong(path, number, f"an element before, with at most {MOST_PROPERTIES} properties", words)
            elements[-1].properties.append(_property(path, number, words, order or "<"))
    raise InputError(f"{path}: expected a PLY file, with a header from `ply` to `end_header`, found none")


def _element(path: Path, number: int, words: list[str]) -> Element:
    if len(words) != 3 or not words[2].isascii() or not words[2].isdigit() or int(words[2][:18]) > MOST_POINTS:
        raise _wrong(path, number, f"element, its name, and how many there are, at most {MOST_POINTS}", words)
    return Element(words[1].lower(), int(words[2][:18]), [])


def _property(path: Path, number: int, words: list[str], order: str) -> Property:
    kinds = words[2:4] if words[1:2] == ["list"] else words[1:2]
    if len(words) != 2 + len(kinds) + (words[1:2] == ["list"]) or any(kind.lower() not in KINDS for kind in kinds):
        raise _wrong(path, number, "property, its type, and its name, or property list and two types", words)
    dtypes = [np.dtype(order + KINDS[kind.lower()]) for kind in kinds]
    if len(dtypes) == 2 and dtypes[0].kind == "f":
        raise _wrong(path, number, "lists whose length is a whole number", words)
    return Property(words[-1], dtypes[-1], dtypes[0] if len(dtypes) == 2 else None)


def _size(one: Property) -> int:
    return one.kind.itemsize if one.length is None else one.length.itemsize


def _wrong(path: Path, number: int, wanted: str, words: list[str]) -> InputError:
    return InputError(f"{path}: line {number}: expected {wanted}, got {' '.join(words)[:80]!r}")
