"""OBJ files: what stands under a name, its corners and triangles.

Read here and not by trimesh, which drops the names of groups and takes negative indices from the end of the file: they
count back from where they stand.

V vertices, T triangles. The file's own frame and unit.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from warp_scanner.buildings.polygons import triangles_of

NAMELESS = ("", "default", "off")  # groups that programs write where there is none


class MeshNode(NamedTuple):
    """One named mesh of a file."""

    name: str
    vertices: np.ndarray  # (V, 3) float64, of its own
    faces: np.ndarray  # (T, 3) int64


class _Face(NamedTuple):
    """One line of a face."""

    line: int  # of the file, from 1
    words: str
    before: int  # vertices that stand before it


def read_obj(path: Path) -> list[MeshNode]:
    """Objects (`o`) where there are several, else groups (`g`), else all as one; groups of one name are one.

    Raises:
        ValueError: corners that are no numbers, or that are not there; one line that names the file and the line.
    """
    coordinates, faces = _lines(path)
    vertices = np.zeros((0, 3))
    if coordinates:
        if not all(coordinates):
            raise ValueError(f"{path}: expected vertices of three numbers, got a line without any")
        try:
            vertices = np.loadtxt(coordinates, usecols=(0, 1, 2), ndmin=2, comments=None)
        except ValueError as error:
            why = " ".join(str(error).split())[:200]
            raise ValueError(f"{path}: expected vertices of three numbers: {why}") from error
    return [_node(path, name, vertices, told) for name, told in _elements(faces, path.stem)]


def _lines(path: Path) -> tuple[list[str], dict[tuple[int, str, str], list[_Face]]]:
    """The vertices as they are written, and the faces by the object's number and name, and the group's name."""
    coordinates, faces = [], {}
    object_number, object_name, group = 0, "", ""
    text = path.read_text(encoding="utf-8", errors="replace").replace("\\\r\n", " ").replace("\\\n", " ")
    for number, line in enumerate(text.split("\n"), 1):
        word, _, rest = line.strip().replace("\t", " ").partition(" ")
        if word == "v":
            coordinates.append(rest.partition("#")[0].strip())
        elif word == "f":
            told = faces.setdefault((object_number, object_name, group), [])
            told.append(_Face(number, rest, len(coordinates)))
        elif word == "o":
            object_number, object_name, group = object_number + 1, rest.strip(), ""
        elif word == "g":
            group = rest.strip()
    return coordinates, faces


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
    """(n, 3) int64 of each face, into all vertices; those of three corners together at the end."""
    plain = []
    for face in told:
        try:
            corners = [int(word.partition("/")[0]) for word in face.words.partition("#")[0].split()]
        except ValueError:
            corners = []
        corners = [face.before + corner if corner < 0 else corner - 1 for corner in corners]
        if len(corners) < 3 or min(corners) < 0 or max(corners) >= len(vertices):
            raise ValueError(
                f"{path}: line {face.line}: expected a face of three corners or more, of {len(vertices)} vertices, got "
                f"{face.words[:80]!r}"
            )
        if len(corners) == 3:
            plain.append(corners)
        else:
            yield np.array(corners)[triangles_of(vertices[corners])]
    if plain:
        yield np.array(plain, np.int64)
