"""Cuts the surfaces of a prior at one height: what a floor plan draws.

V vertices, T triangles. Any frame with z up, lengths in metres.
"""

from typing import NamedTuple

import numpy as np

WELD = 1e-4  # [m] corners that round to the same multiple are one: many files give every face its own


class Outline(NamedTuple):
    """One line of a cut."""

    element: int  # row of the table of elements
    points: np.ndarray  # (n, 2) float64 [m] x, y; the first again at the end where it is closed
    closed: bool


def cut_surfaces(vertices: np.ndarray, faces: np.ndarray, element: np.ndarray, height: float) -> list[Outline]:
    """The outlines of every element at a height, solid on the left of each.

    A surface with holes gives lines that are not closed.

    Args:
        vertices: (V, 3) float [m].
        faces: (T, 3) int, their corners counter-clockwise from outside.
        element: (T,) int.
        height: z [m] of the cut.
    """
    above = vertices[:, 2] > height
    crossed = np.flatnonzero(above[faces].any(axis=1) & ~above[faces].all(axis=1))
    outlines: list[Outline] = []
    order = crossed[np.argsort(element[crossed], kind="stable")]
    for own in np.split(order, np.flatnonzero(np.diff(element[order])) + 1):
        if len(own):
            outlines += [
                Outline(int(element[own[0]]), line, closed) for line, closed in _lines(vertices, faces[own], height)
            ]
    return outlines


def _lines(vertices: np.ndarray, faces: np.ndarray, height: float) -> list[tuple[np.ndarray, bool]]:
    """Segments of one element joined to lines: two triangles share the edge at which their segments meet."""
    used, faces = np.unique(faces, return_inverse=True)
    _, kept, weld = np.unique(
        np.round(vertices[used] / WELD).astype(np.int64), axis=0, return_index=True, return_inverse=True
    )
    corners, faces = vertices[used][kept].astype(np.float64), weld[faces].reshape(-1, 3)
    above = corners[:, 2] > height
    following: dict[tuple[int, int], list[tuple[int, int]]] = {}
    place: dict[tuple[int, int], np.ndarray] = {}
    for face in faces:
        ends = {}
        for a, b in zip(face, np.roll(face, -1), strict=True):
            if above[a] != above[b]:
                edge = (int(min(a, b)), int(max(a, b)))
                share = (height - corners[a, 2]) / (corners[b, 2] - corners[a, 2])
                place[edge] = corners[a, :2] + share * (corners[b, :2] - corners[a, :2])
                ends[bool(above[b])] = edge
        # From the edge that leads down, counter-clockwise, to the one that leads up, the solid is at the left.
        if ends and ends[False] != ends[True]:
            following.setdefault(ends[False], []).append(ends[True])
    return [(np.array([place[edge] for edge in line]), line[0] == line[-1]) for line in _walked(following)]


def _walked(following: dict[tuple, list[tuple]]) -> list[list[tuple]]:
    """Chains of a table of successors, those with a beginning first; what then is left runs in circles."""
    ends = {edge for successors in following.values() for edge in successors}
    lines = []
    for start in [*(edge for edge in following if edge not in ends), *following]:
        while following.get(start):
            line = [start]
            while following.get(line[-1]) and (len(line) == 1 or line[-1] != start):
                line.append(following[line[-1]].pop())
            lines.append(line)
    return lines
