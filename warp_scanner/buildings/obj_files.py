"""OBJ files: what stands under a name, its corners and triangles.

Read here and not by trimesh, which drops the names of groups and takes negative indices from the end of the file: they
count back from where they stand.

V vertices, T triangles. The file's own frame and unit.
"""

import contextlib
import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from warp_scanner.buildings.polygons import triangles_of

OTHER_INDICES = re.compile(r"/\S*")  # of texture and normal, behind that of the vertex
LONGEST_LINE = 4096  # bytes
SIGNS = ("-", "+", ".", "-.")  # of a number that has not begun
NAMELESS = ("", "default", "off")  # groups that programs write where there is none


class MeshNode(NamedTuple):
    """One named mesh of a file."""

    name: str
    vertices: np.ndarray  # (V, 3) float64, of its own
    faces: np.ndarray  # (T, 3) int64


_Face = tuple[int, str, int]  # number of the line, from 1; what it says of corners; how many vertices stand before it


def read_obj(path: Path) -> list[MeshNode]:
    """Objects (`o`) where there are several, else groups (`g`), else all as one; groups of one name are one.

    Raises:
        ValueError: corners that are no numbers, or that are not there, or a file that ends within a line of them; one
            line that names the file and the line.
    """
    words = unended_line(path).split()
    if words and words[0] in ("v", "f") and (len(words) < 4 or words[-1] in SIGNS):
        raise ValueError(f"{path}: truncated: it ends within a line: {' '.join(words)[:80]!r}")
    coordinates, faces = _lines(path)
    vertices = np.zeros((0, 3))
    if any(map(str.strip, coordinates)):
        try:
            vertices = np.loadtxt(coordinates, usecols=(0, 1, 2), ndmin=2)
        except ValueError as error:
            why = " ".join(str(error).split())[:200]
            raise ValueError(f"{path}: expected vertices of three numbers: {why}") from error
    if len(vertices) < len(coordinates):
        raise ValueError(f"{path}: expected vertices of three numbers, got a line without any")
    return [_node(path, name, vertices, told) for name, told in _elements(faces, path.stem)]


def unended_line(path: Path) -> str:
    """What a file ends with that ends within a line, as one does that was cut off; nothing of any other."""
    with open(path, "rb") as file:
        file.seek(max(0, path.stat().st_size - LONGEST_LINE))
        return re.split(rb"[\r\n]", file.read())[-1].decode("utf-8", "replace")


def remarks_on_end(path: Path) -> tuple[str, ...]:
    """What is to be said of a file that ends within a line that may be whole."""
    if not unended_line(path).startswith("f"):
        return ()
    return ("its last line has no end: if the file was cut off there, its last face is not whole, and more is missing",)


def _lines(path: Path) -> tuple[list[str], dict[tuple[int, str, str], list[_Face]]]:
    """The vertices as they are written, and the faces by the object's number and name, and the group's name."""
    coordinates, faces = [], {}
    object_number, object_name, group = 0, "", ""
    told = faces.setdefault((object_number, object_name, group), [])
    text = path.read_text(encoding="utf-8", errors="replace").replace("\t", " ")
    text = text.replace("\\\r\n", " ").replace("\\\n", " ")  # lines that go on
    for number, line in enumerate(text.split("\n"), 1):
        if line[:2] not in ("v ", "f "):
            line = line.strip()
        word, rest = line[:2].rstrip(), line[2:]
        if word == "v":
            coordinates.append(rest)
        elif word == "f":
            told.append((number, rest, len(coordinates)))
        elif word in ("o", "g"):
            if word == "o":
                object_number, object_name, group = object_number + 1, rest.strip(), ""
            else:
                group = rest.strip()
            told = faces.setdefault((object_number, object_name, group), [])
    return coordinates, {key: told for key, told in faces.items() if told}


def _elements(faces: dict[tuple[int, str, str], list[_Face]], unnamed: str) -> list[tuple[str, list[_Face]]]:
    """Names, and the faces under them."""
    objects = len({number for number, _, _ in faces}) > 1
    found: dict[object, tuple[str, list[_Face]]] = {}
    for (number, name, group), told in faces.items():
        label = name if objects or group.lower() in NAMELESS else group
        key = number if objects else label
        found.setdefault(key, (label or unnamed, []))[1].extend(told)
    return list(found.values())


def _node(path: Path, name: str, vertices: np.ndarray, told: list[_Face]) -> MeshNode:
    corners = np.concatenate([np.zeros((0, 3), np.int64), *_triangles(path, vertices, told)])
    used, faces = np.unique(corners, return_inverse=True)
    return MeshNode(name, vertices[used], faces.reshape(-1, 3))


def _triangles(path: Path, vertices: np.ndarray, told: list[_Face]) -> Iterator[np.ndarray]:
    """(n, 3) int64 into all vertices: of all faces at once where they are triangles, else of one after the other."""
    bare = OTHER_INDICES.sub("", "\n".join(words for _, words, _ in told))
    with contextlib.suppress(ValueError, OverflowError):  # what is wrong is told by its line, below
        if all(len(row.split()) == 3 for row in bare.split("\n")):
            corners = np.fromiter(map(int, bare.split()), np.int64, 3 * len(told)).reshape(-1, 3)
            before = np.array([before for _, _, before in told])
            corners = np.where(corners < 0, corners + before[:, None], corners - 1)
            if 0 <= corners.min() <= corners.max() < len(vertices):
                yield corners
                return
    for line, words, before in told:
        try:
            corners = [int(word) for word in OTHER_INDICES.sub("", words).partition("#")[0].split()]
        except ValueError:
            corners = []
        corners = [before + corner if corner < 0 else corner - 1 for corner in corners]
        if len(corners) < 3 or min(corners) < 0 or max(corners) >= len(vertices):
            raise ValueError(
                f"{path}: line {line}: expected a face of three corners or more, of {len(vertices)} vertices, got "
                f"{words.strip()[:80]!r}"
            )
        yield np.array(corners)[triangles_of(vertices[corners])]
