"""Brings the files of one building into one frame: as they are, over their map grids, or told by how a mesh fits.

B files, E elements. Frames are in metres, z up; (4, 4) matrices lead from a file's own frame to that of the whole.
"""

import itertools
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from warp_scanner.lengths import length_in_words
from warp_scanner.scenes.building import Building, element_bounds
from warp_scanner.sensors.triangles import TriangleScene, clearance, prepare

TOGETHER = 50.0  # [m] between what two files hold, up to which both may be of one place
FAR = 3.0  # times as far from the middle as nine in ten elements: left behind somewhere else
TOUCHES = 0.05  # [m] from a surface of the others, within which a point of a file's surface touches it
CLEARLY = 0.1  # so much more of a file must touch the others to be elsewhere than it says
LEAST_TOUCHING = 0.02  # share of a mesh, below which it is tried in other units
TOO_LARGE = 1.5  # times as long as all others: no mesh of the same building
SAME_PLACE = 0.01  # [m] by which two ways may put a file, and are the same
UNITS = {0.001: "millimetres", 0.01: "centimetres", 0.0254: "inches", 0.3048: "feet"}
_POINTS = 3000  # of a surface, that are asked whether they touch
_UP = {"z": np.eye(4), "y": np.array([[1.0, 0, 0, 0], [0, 0, -1.0, 0], [0, 1.0, 0, 0], [0, 0, 0, 1.0]])}
AS_IT_IS = np.eye(4)


class Read(NamedTuple):
    """One file as it was read."""

    name: str
    building: Building
    is_ifc: bool
    told: bool = False  # of a mesh: its unit or axes are known


class Placed(NamedTuple):
    """One file in the frame of the whole."""

    read: Read
    to_world: np.ndarray  # (4, 4)


class Way(NamedTuple):
    """A way in which a file may lie."""

    matrix: np.ndarray  # (4, 4)
    words: str  # why, to be said after "it"; empty for as it is


def bring_together(files: list[Read], first: str | None) -> tuple[list[Placed], tuple[str, ...]]:
    """All files in one frame, in their order, and what was told by how they fit, a sentence each.

    Args:
        files: at least one, with different names.
        first: name of the one whose frame is that of the whole; None: that which most elements are in.

    Raises:
        ValueError: one shares no place with the others, by any way.
    """
    boxes = [main_box(one.building) for one in files]
    group = _frame(files, boxes, first)
    anchor = max(group, key=lambda row: (files[row].name == first, files[row].building.to_map is not None,
                                         len(files[row].building.elements.guid)))  # fmt: skip
    ways, notes = dict.fromkeys(group, AS_IT_IS), []
    scene = _Surface([files[row].building for row in group])
    span = (np.min([boxes[row][0] for row in group], axis=0), np.max([boxes[row][1] for row in group], axis=0))
    for row, one in enumerate(files):
        if row == anchor or (row in group and not _may_lie_otherwise(one, files[anchor])):
            continue
        others = scene if row not in group else _Surface([files[other].building for other in group if other != row])
        way = _way(one, boxes[row], files[anchor], others, span)
        if way is None:
            away = length_in_words(gap(boxes[row], span))
            raise ValueError(
                f"{one.name}: expected a file of the same place as {files[anchor].name}, found it {away} away "
                "from it; a model holds one building"
            )
        ways[row] = way.matrix
        if way.words:
            notes.append(f"{one.name} {way.words}")
    return [Placed(one, ways[row]) for row, one in enumerate(files)], tuple(notes)


def main_box(building: Building) -> tuple[np.ndarray, np.ndarray]:
    """Least and greatest coordinates (3,) [m] of a file's elements, but for the few that lie far from all others."""
    low, high = (side.astype(np.float64) + building.origin for side in element_bounds(building.triangles))
    middle = (low + high) / 2.0
    away = np.abs(middle - np.median(middle, axis=0)).max(axis=1)
    near = away <= max(TOGETHER, FAR * float(np.quantile(away, 0.9)))
    return low[near].min(axis=0), high[near].max(axis=0)


def gap(one: tuple[np.ndarray, np.ndarray], other: tuple[np.ndarray, np.ndarray]) -> float:
    """Distance [m] between two boxes; 0 where they meet."""
    return float(np.linalg.norm(np.maximum(np.maximum(one[0] - other[1], other[0] - one[1]), 0.0)))


def moved(points: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """Points (n, 3) float64 [m] by a matrix; the very same by that of no motion."""
    if np.array_equal(matrix, AS_IT_IS):
        return points
    # About their middle: products of national-grid coordinates would lose what float64 has.
    middle = points.mean(axis=0) if len(points) else np.zeros(3)
    return (points - middle) @ matrix[:3, :3].T + (matrix[:3, :3] @ middle + matrix[:3, 3])


def _frame(files: list[Read], boxes: list, first: str | None) -> list[int]:
    """Rows of the IFC files that share a place as they are: those with the first, or the most elements.

    Of meshes, whose unit is not known, only one; an IFC file, which says its own, comes before any.
    """
    rows = [row for row, one in enumerate(files) if one.is_ifc] or range(len(files))
    size = [len(one.building.elements.guid) for one in files]
    first_row = next((row for row in rows if files[row].name == first), None)
    if not files[rows[0]].is_ifc:
        return [max(rows, key=size.__getitem__) if first_row is None else first_row]
    groups: list[list[int]] = []
    for row in rows:
        near = [one for one in groups if any(gap(boxes[row], boxes[other]) <= TOGETHER for other in one)]
        groups = [one for one in groups if one not in near] + [sorted([row, *itertools.chain(*near)])]
    if first_row is not None:
        return next(one for one in groups if first_row in one)
    return max(groups, key=lambda one: (sum(size[row] for row in one), -one[0]))


def _may_lie_otherwise(one: Read, anchor: Read) -> bool:
    """Whether the map conversions of two files say that one does not lie as it is."""
    own, other = one.building.to_map, anchor.building.to_map
    if own is None or other is None:
        return False
    low, high = main_box(one.building)
    ends = np.array([low, high])
    return bool(np.abs(moved(ends, np.linalg.solve(other, own)) - ends).max() > SAME_PLACE)


def _way(one: Read, box: tuple, anchor: Read, others: "_Surface", span: tuple) -> Way | None:
    """How a file lies among the others; None where it is far from them in every way."""
    if not one.is_ifc:
        return _mesh_way(one, box, others, span)
    ways = [*_map_ways(one.building, anchor), Way(AS_IT_IS, "")]
    near = [way for way in ways if gap(_box_by(one.building, way.matrix), span) <= TOGETHER]
    both_say = one.building.to_map is not None and anchor.building.to_map is not None
    if not both_say or len(ways) == 1:
        return near[-1] if near and not near[-1].words else (near[0] if near else None)
    touching = [others.touched_by(one.building, way.matrix) for way in ways]
    if touching[-1] > touching[0] + CLEARLY:  # what the map conversions say, it does not do
        words = f"lies as it is: moved as its map conversion says, {touching[0]:.0%} of it would touch the others, "
        return Way(AS_IT_IS, f"{words}not {touching[-1]:.0%}")
    return ways[0] if ways[0] in near else None


def _map_ways(building: Building, anchor: Read) -> Iterator[Way]:
    """Over the map grids of both, or of the one that says a conversion, as the other then is on the grid."""
    own, other = building.to_map, anchor.building.to_map
    if own is not None and other is not None:
        yield Way(np.linalg.solve(other, own), f"was moved into the frame of {anchor.name}, over the map grid of both")
    elif other is not None:
        words = f"lies on the map grid of {anchor.name}, and was moved into its frame"
        yield Way(np.linalg.inv(other), words)
    elif own is not None:
        yield Way(own, f"was moved onto its map grid, on which {anchor.name} lies")


def _mesh_way(one: Read, box: tuple, others: "_Surface", span: tuple) -> Way | None:
    """A mesh as it is, unless it fits clearly better on its side, or is too large or far away for metres."""
    length, size = float((box[1] - box[0]).max()), float((span[1] - span[0]).max())
    as_it_is = others.touched_by(one.building, AS_IT_IS)
    near = gap(box, span) <= TOGETHER
    if one.told:
        return Way(AS_IT_IS, "") if near else None
    units = {1.0: "metres"}
    if not near or length > TOO_LARGE * size or as_it_is < LEAST_TOUCHING:
        units |= {unit: name for unit, name in UNITS.items() if unit * length >= 0.1}
    best, least = (Way(AS_IT_IS, ""), as_it_is + CLEARLY) if near and length <= TOO_LARGE * size else (None, 0.0)
    for (unit, name), (up, turn) in itertools.product(units.items(), _UP.items()):
        matrix = np.diag([unit, unit, unit, 1.0]) @ turn
        if unit * length > TOO_LARGE * size or gap(_box_by(one.building, matrix), span) > TOGETHER:
            continue
        share = others.touched_by(one.building, matrix)
        if share > least or best is None:
            said = [f"in {name}"] * (unit != 1.0) + [f"with {up} of the file up"] * (up == "y")
            best, least = Way(matrix, f"fits the others {' and '.join(said)}, and was read so"), share
    return best


def _box_by(building: Building, matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The main box of a file that a matrix moves."""
    low, high = main_box(building)
    corners = moved(np.array(list(itertools.product(*zip(low, high, strict=True)))), matrix)
    return corners.min(axis=0), corners.max(axis=0)


class _Surface:
    """The surfaces of files as they are, each ready to be asked once somebody asks."""

    def __init__(self, buildings: list[Building]):
        self._buildings = buildings
        self._scenes: list[TriangleScene] | None = None

    def touched_by(self, building: Building, matrix: np.ndarray) -> float:
        """Share of the points of a file's surface, moved by a matrix, that touch these."""
        if self._scenes is None:
            self._scenes = [prepare(one.triangles) for one in self._buildings]
        corners = np.unique(building.triangles.faces)
        corners = corners[np.arange(min(_POINTS, len(corners))) * len(corners) // min(_POINTS, len(corners))]
        points = moved(building.triangles.vertices[corners].astype(np.float64) + building.origin, matrix)
        touches = np.zeros(len(points), bool)
        for one, scene in zip(self._buildings, self._scenes, strict=True):
            touches |= clearance(scene, points - one.origin, TOUCHES) < np.float32(TOUCHES)
        return float(touches.mean())
