"""PLY scans, text or binary: the vertices, wherever x, y and z stand among their properties.

Read here and not by trimesh, which keeps several copies of all properties, rounds to float32, and knows no vertices
with lists among their properties (the views that saw a point, say).
"""

import io
import itertools
import mmap
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from jaxmm.formats.ply_header import Element, read_header
from jaxmm.formats.raw_scans import BLOCK, RawScan, axes_of, check_count, filled, records
from jaxmm.formats.text import rows
from jaxmm.formats.text_header import remarks_on_end
from jaxmm.inputs import InputError, one_line


def read_ply(path: Path) -> list[RawScan]:
    """The vertices of a file.

    Raises:
        InputError: no whole header; no vertices, or without x, y and z; fewer of them than promised.
    """
    with open(path, "rb") as file:
        elements, order, offset = read_header(path, file)
        place = next((place for place, element in enumerate(elements) if element.name == "vertex"), None)
        axes = None if place is None else axes_of(elements[place].plain_names())
        if axes is None:
            found = [element.name for element in elements] if place is None else elements[place].plain_names()
            raise InputError(
                f"{path}: expected vertices with x, y and z once each, found {', '.join(found)[:200] or 'nothing'}"
            )
        before, vertex = elements[:place], elements[place]
        axes = [vertex.plain_places()[axis] for axis in axes]
        check_count(path, vertex.count, vertex.least_size(order))
        if not order:
            blocks = _text_points(path, file, before, vertex, axes)
        elif vertex.has_lists() or any(element.has_lists() for element in before):
            blocks = _walked_points(path, file, before, vertex, axes)
        else:
            file.seek(sum(element.count * element.kind().itemsize for element in before), io.SEEK_CUR)
            blocks = records(file, vertex.kind(), vertex.count, tuple(f"f{axis}" for axis in axes))
        points = filled(path, vertex.count, blocks)
        points += offset
        ends = not order and not any(element.count for element in elements[place + 1 :])
        return [RawScan(points, remarks=remarks_on_end(path) if ends else ())]


def _text_points(
    path: Path, file: io.BufferedReader, before: list[Element], vertex: Element, axes: list[int]
) -> Iterator[np.ndarray]:
    """Blocks (n, 3): a line is a vertex."""
    lines, width = filter(str.strip, io.TextIOWrapper(file, "latin-1")), len(vertex.properties)
    for _ in itertools.islice(lines, sum(element.count for element in before)):
        pass
    try:
        if vertex.has_lists():
            lines = itertools.islice(lines, vertex.count)
            while block := list(itertools.islice(lines, BLOCK)):
                yield np.array([_axes_of_line(line.split(), vertex, axes) for line in block])
        else:
            for block in rows(lines, vertex.count, width=width):
                yield block[:, axes]
    except (ValueError, IndexError) as error:
        raise InputError(f"{path}: expected {vertex.count} vertices of {width} numbers: {one_line(error)}") from error


def _axes_of_line(words: list[str], vertex: Element, axes: list[int]) -> list[float]:
    """x, y and z of a vertex in whose line lists stand: their length, then so many numbers."""
    found, at = {}, 0
    for place, one in enumerate(vertex.properties):
        if one.length is not None:
            at += int(words[at])
        elif place in axes:
            found[place] = float(words[at])
        at += 1
    if at != len(words):
        raise ValueError(f"found a line of {len(words)} words where its lists make it {at}")
    return [found[axis] for axis in axes]


def _walked_points(
    path: Path, file: io.BufferedReader, before: list[Element], vertex: Element, axes: list[int]
) -> Iterator[np.ndarray]:
    """Blocks (n, 3) of binary vertices: where one begins is told by the lists of the one before."""
    start = file.tell()
    with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
        for element in before:
            if not element.has_lists():
                start += element.count * element.kind().itemsize
                continue
            for _, end in element.walk(path, content, start):
                start = end
        data = np.frombuffer(content, np.uint8)
        try:
            for places, _ in vertex.walk(path, content, start):
                columns = []
                for axis in axes:
                    kind, run, offset = vertex.properties[axis].kind, *vertex.offset_of(axis)
                    raw = data[(places[:, run] + offset)[:, None] + np.arange(kind.itemsize)]
                    columns.append(np.ascontiguousarray(raw).view(kind)[:, 0].astype(np.float64))
                yield np.column_stack(columns)
        finally:
            del data  # a file that is still looked at cannot be closed
