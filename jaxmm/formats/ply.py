"""PLY scans, text or binary: the vertices, wherever x, y and z stand among their properties.

The header is read by trimesh, the vertices here: trimesh keeps several copies of all properties, and rounds to float32.
"""

import io
from pathlib import Path

import numpy as np

from jaxmm.formats.raw_scans import RawScan, check_count, filled, records
from jaxmm.formats.text import rows
from jaxmm.inputs import InputError

LONGEST_HEADER = 1 << 20  # [bytes]


def read_ply(path: Path) -> list[RawScan]:
    """The vertices of a file.

    Raises:
        InputError: no whole header; no vertices, or not first, or without x, y and z; fewer of them than promised.
    """
    with open(path, "rb") as file:
        elements, is_ascii = _header(path, file)
        vertex = elements.get("vertex")
        if vertex is None or not {"x", "y", "z"} <= set(vertex["properties"]):
            found = ", ".join(elements)[:200] or "no element"
            raise InputError(f"{path}: expected vertices with x, y and z, found {found}")
        if next(iter(elements)) != "vertex":
            raise InputError(f"{path}: expected vertices before all other elements")
        if any("LIST" in kind for kind in vertex["properties"].values()):
            raise InputError(f"{path}: expected vertices of plain numbers, found lists in them")
        count, names = vertex["length"], list(vertex["properties"])
        if is_ascii:
            check_count(path, count, 2.0 * len(names))  # a digit and a gap each
            return [RawScan(_text_points(path, file, count, names))]
        kind = np.dtype(list(vertex["properties"].items()))
        check_count(path, count, kind.itemsize)
        return [RawScan(filled(path, count, records(file, kind, count)))]


def _header(path: Path, file: io.BufferedReader) -> tuple[dict, bool]:
    from trimesh.exchange import ply

    head = file.read(LONGEST_HEADER)
    if not head.startswith(b"ply") or b"end_header" not in head:
        raise InputError(f"{path}: expected a PLY file, with a header from `ply` to `end_header`, found none")
    if not any(kind in head[:100] for kind in (b"ascii", b"binary_little_endian", b"binary_big_endian")):
        raise InputError(f"{path}: expected PLY that is ascii, binary_little_endian or binary_big_endian")
    file.seek(0)
    elements, is_ascii, _ = ply._parse_header(file)
    return elements, is_ascii


def _text_points(path: Path, file: io.BufferedReader, count: int, names: list[str]) -> np.ndarray:
    lines = io.TextIOWrapper(file, "latin-1")
    try:
        columns = [names.index(axis) for axis in "xyz"]
        blocks = (block[:, columns] for block in rows(lines, count, width=len(names)))
        return filled(path, count, blocks)
    except InputError:  # says all of it, and is a ValueError, too
        raise
    except ValueError as error:
        raise InputError(f"{path}: expected {count} vertices of {len(names)} numbers: {error}") from error
