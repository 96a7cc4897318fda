"""A building as triangles, each with the element it belongs to, and a table of those elements.

E elements, S storeys, V vertices, T triangles. World frame: the file's own, in metres, z up. National-grid coordinates
do not fit float32, so positions are a float64 origin plus float32 offsets from it; poses, rays and scans of a building
are offsets too.
"""

import dataclasses
from pathlib import Path
from typing import NamedTuple

import numpy as np

from warp_scanner.scenes.scenes import CABINET, CARTON, CHAIR, FURNITURE, PERSON, TABLE

_NEAR = 500.0  # [m] coordinates up to this keep the file's own origin: float32 is exact to 0.03 mm there
_MOVABLE = (TABLE, CHAIR, FURNITURE, CABINET, CARTON, PERSON)
_LIMIT = 1e9  # [m] coordinates beyond this are taken for mistakes
_FAR = 8192.0  # [m] from the origin: beyond it float32 is not exact to half a millimetre
MOST_NAMED = 5  # of elements that something is remarked of
_THIN = 1e-8  # [m] height of a triangle that counts as none: what float64 leaves of one at national-grid coordinates


class Twin(NamedTuple):
    """An element that another has the triangles of: one of another file at the same place, or others that it is of."""

    guid: str
    ifc_class: str
    name: str
    storey: int  # row of the storey table or -1
    semantic: int
    file: str


class Elements(NamedTuple):
    """What the objects of a building are; position in the table is the element id."""

    guid: tuple[str, ...]  # IFC GlobalId, or the node's name in a mesh file; unique among those of one file
    ifc_class: tuple[str, ...]  # as the file has it, e.g. IfcWallStandardCase; empty for meshes
    name: tuple[str, ...]  # may be empty
    storey: np.ndarray  # (E,) int32 row of the storey table; -1 where the file names none
    semantic: np.ndarray  # (E,) uint8 class of scenes.py
    file: tuple[str, ...]  # that it is of: its name, below the folder of the model where that has several
    twins: tuple[tuple[Twin, ...], ...]  # of each, the same in other files


class Triangles(NamedTuple):
    """The surfaces of all elements."""

    vertices: np.ndarray  # (V, 3) float32 [m] offsets from the origin
    faces: np.ndarray  # (T, 3) int32 corners
    element: np.ndarray  # (T,) int32
    semantic: np.ndarray  # (E,) uint8 class of every element


class Storeys(NamedTuple):
    """The levels that a building is divided into, from the lowest up; never empty."""

    guid: tuple[str, ...]  # IFC GlobalId; empty for the one storey of a file without any
    name: tuple[str, ...]
    elevation: np.ndarray  # (S,) float64 [m] above the origin


class Failure(NamedTuple):
    """An element of the file whose shape is missing or not as it should be, and why."""

    guid: str
    ifc_class: str
    name: str
    reason: str
    file: str = ""  # where the building is of several


class Source(NamedTuple):
    """One of the files that a building was put together from."""

    file: str  # name, below the folder of the model
    kind: str  # "ifc" | "mesh"
    unit: float  # [m] length of its unit
    project: str | None  # GlobalId of the IfcProject, of an IFC file
    elements: int  # of those with a shape
    to_world: np.ndarray  # (4, 4) float64 from the file's own frame, in metres, to that of the building


class Whole(NamedTuple):
    """What is put together from elements: a stair of flights, a roof of slabs; it may be an element itself."""

    guid: str  # IFC GlobalId
    ifc_class: str
    name: str
    storey: int  # row of the storey table or -1
    parts: tuple[str, ...]  # guids of elements, of the same file
    file: str = ""  # where the building is of several


class Pieced(NamedTuple):
    """An element that another file has in pieces, which have the triangles. Its box is upright, and about it alone."""

    element: Twin
    twins: tuple[Twin, ...]  # the same in other files, in one piece there, too
    pieces: tuple[tuple[str, str], ...]  # file and guid of each; the triangles may be those of a piece's twin
    center: tuple[float, float, float]  # [m] offset
    size: tuple[float, float, float]  # [m] full edge lengths along its own axes
    yaw: float  # [deg]


class Building(NamedTuple):
    """What a file holds."""

    elements: Elements
    triangles: Triangles
    origin: np.ndarray  # (3,) float64 [m] world position that offsets count from
    storeys: Storeys
    failures: tuple[Failure, ...]  # elements without triangles
    zero_area: int  # triangles left out because they have no area
    notes: tuple[str, ...]  # what was assumed or mended, a sentence each
    to_map: np.ndarray | None  # (4, 4) float64 world to map grid [m], where the file is georeferenced
    flaws: tuple[Failure, ...] = ()  # elements that are there, but whose surface cannot be that of a solid
    unit: float = 1.0  # [m] length of the file's unit
    project: str | None = None  # GlobalId of the IfcProject, of an IFC file
    sources: tuple[Source, ...] = ()  # the files, where it is of several
    wholes: tuple[Whole, ...] = ()  # parts that a model without some of its elements lacks may still be named
    clear: np.ndarray | None = None  # (T,) bool: triangles of glass, by their material; None: nobody knows
    pieced: tuple[Pieced, ...] = ()  # where it is of several files; pieces that a model lacks may still be named


def rows_by_key(elements: Elements) -> dict[tuple[str, str], int]:
    """Rows of all elements, by file and GlobalId; what is the same in other files has the row of the one kept."""
    rows = {(twin.file, twin.guid): row for row, own in enumerate(elements.twins) for twin in own}
    return rows | {key: row for row, key in enumerate(zip(elements.file, elements.guid, strict=True))}


class Part(NamedTuple):
    """One element as a reader found it."""

    guid: str
    ifc_class: str
    name: str
    storey: int  # row of the storey table or -1
    semantic: int
    vertices: np.ndarray  # (v, 3) float64 [m] world
    faces: np.ndarray  # (t, 3) int
    clear: np.ndarray | None = None  # (t,) bool: of a transparent material; None: none is


@dataclasses.dataclass(frozen=True)
class ReadOptions:
    """How to read a building."""

    glass: str = "solid"  # or "transparent": windows' glass is left out, rays pass
    doors: str = "closed"  # or "open": doors are left out
    y_up: bool | None = None  # of meshes, clouds: y is up in the file; None: in glTF, which says so, and in no other
    unit: float = 1.0  # [m] of meshes, clouds: length of the file's unit; IFC files say it themselves
    # Of clouds: what the points are in, "world", "sensor" or "optical" (x right, y down, z forward); None: the world.
    frame: str | None = None

    def __post_init__(self):
        frames = (None, "world", "sensor", "optical")
        for name, allowed in (
            ("glass", ("solid", "transparent")), ("doors", ("closed", "open")), ("frame", frames),
        ):  # fmt: skip
            if getattr(self, name) not in allowed:
                raise ValueError(f"{name} must be one of {allowed}, got {getattr(self, name)!r}")
        if not 0.0 < self.unit < np.inf:
            raise ValueError(f"unit must be a positive length in metres, got {self.unit}")


AS_IT_IS = ReadOptions()


class Found(NamedTuple):
    """What a reader found in a file besides its parts; storeys in world coordinates."""

    storeys: Storeys
    failures: tuple[Failure, ...] = ()
    notes: tuple[str, ...] = ()
    to_map: np.ndarray | None = None
    flaws: tuple[Failure, ...] = ()
    unit: float = 1.0
    project: str | None = None
    wholes: tuple[Whole, ...] = ()


WITHOUT_STOREYS = "the file has no storeys: the floor of the bounding box stands for one"
NO_STOREYS = Storeys((), (), np.zeros(0))


class WithoutSurfacesError(ValueError):
    """A file that can be read, and has no element with a surface."""

    def __init__(self, source: str, why: str):
        """`source` is the name of the file; `why` is empty, or goes on behind it."""
        super().__init__(f"{source}: expected a building with surfaces, found none{why}")
        self.why = why


def assemble(source: str, parts: list[Part], found: Found) -> Building:
    """Elements to one building: triangles without area are left out and counted, an element with no others fails.

    Args:
        source: name of the file, for errors.
        parts: at least one, with unique guids.
        found: the rest; without storeys the floor of the bounding box stands for one.

    Raises:
        WithoutSurfacesError: no element has one.
        ValueError: a vertex is NaN, infinite or beyond 1e9 m; a face names a vertex that is not there.
    """
    for part in parts:
        _check_part(source, part)
    solid = [_solid(part) for part in parts]
    failures = list(found.failures)
    failures += [_failed(part, "all its triangles have zero area" if len(part.faces) else "it has no faces")
                 for part, left in zip(parts, solid, strict=True) if not len(left.faces)]  # fmt: skip
    zero_area = sum(len(part.faces) for part in parts) - sum(len(part.faces) for part in solid)
    solid = [part for part in solid if len(part.faces)]
    if not solid:
        why = f"; the first of {len(failures)} elements failed because {failures[0].reason}" if failures else ""
        raise WithoutSurfacesError(source, why)

    low = np.array([part.vertices[part.faces].min(axis=(0, 1)) for part in solid])
    high = np.array([part.vertices[part.faces].max(axis=(0, 1)) for part in solid])
    origin, far = origin_of(low, high)
    storeys, notes = found.storeys, [*found.notes, *far]
    if not storeys.name:
        notes.append(WITHOUT_STOREYS)
        storeys = Storeys(("",), ("",), low[:, 2].min(keepdims=True))
        solid = [part._replace(storey=0) for part in solid]
    storeys = storeys._replace(elevation=storeys.elevation - origin[2])
    elements = Elements(
        *(tuple(getattr(part, name) for part in solid) for name in ("guid", "ifc_class", "name")),
        np.array([part.storey for part in solid], np.int32),
        np.array([part.semantic for part in solid], np.uint8),
        (Path(source).name,) * len(solid),
        ((),) * len(solid),
    )
    triangles = _joined(solid, origin, elements.semantic)
    clear = [np.zeros(len(part.faces), bool) if part.clear is None else part.clear for part in solid]
    return Building(
        elements, triangles, origin, storeys, tuple(failures), zero_area, tuple(notes), found.to_map, found.flaws,
        found.unit, found.project, (), found.wholes, np.concatenate(clear),
    )  # fmt: skip


def bounds(triangles: Triangles) -> tuple[np.ndarray, np.ndarray]:
    """Least and greatest coordinates (3,) float32 [m] of all triangles."""
    used = np.zeros(len(triangles.vertices), bool)
    used[triangles.faces.ravel()] = True
    corners = np.ascontiguousarray(triangles.vertices[used].T)  # long rows reduce fast
    return corners.min(axis=1), corners.max(axis=1)


def element_bounds(triangles: Triangles) -> tuple[np.ndarray, np.ndarray]:
    """Least and greatest coordinates (E, 3) float32 [m] of every element; inf and -inf for one without triangles."""
    order = np.argsort(triangles.element, kind="stable")
    present, start = np.unique(triangles.element[order], return_index=True)
    a, b, c = (triangles.vertices[corner] for corner in triangles.faces[order].T)
    spans = []
    for pick, gap in ((np.minimum, np.inf), (np.maximum, -np.inf)):
        span = np.full((len(triangles.semantic), 3), gap, np.float32)
        span[present] = pick.reduceat(pick(pick(a, b), c), start)
        spans.append(span)
    return spans[0], spans[1]


def faces_by_element(triangles: Triangles) -> tuple[np.ndarray, np.ndarray]:
    """The faces (T,) int of one element after another, and where those of each begin, and the last end (E + 1,)."""
    order = np.argsort(triangles.element, kind="stable")
    return order, np.searchsorted(triangles.element[order], np.arange(len(triangles.semantic) + 1))


def fixed(triangles: Triangles) -> np.ndarray:
    """(E,) bool: what is part of the building; nothing that is added, and no sensor, stands on its furniture."""
    return ~np.isin(triangles.semantic, _MOVABLE)


def origin_of(low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, list[str]]:
    """Where offsets count from, given the elements' bounding boxes (n, 3), and what float32 loses of those far off."""
    if max(-low.min(), high.max()) <= _NEAR:
        return np.zeros(3), []
    # The middle of most: an element that was left behind at the file's zero must not cost the others their places.
    origin = np.rint(np.median((low + high) / 2, axis=0))
    reach = np.maximum(origin - low, high - origin).max(axis=1)
    far, step = np.sum(reach > _FAR), np.spacing(np.float32(reach.max()))
    if not far:
        return origin, []
    where = f"elements farther than {_FAR / 1000:.1f} km from the middle of most, at up to {reach.max() / 1000:.0f} km"
    return origin, [f"{far} {where}: their positions are rounded to {step:.1g} m"]


def _check_part(source: str, part: Part) -> None:
    bad = ~np.isfinite(part.vertices).all(axis=1)
    if bad.any():
        raise ValueError(f"{source}: expected finite vertices, got NaN or infinity in {bad.sum()} of {part.name!r}")
    if np.any(np.abs(part.vertices) > _LIMIT):
        reach = np.abs(part.vertices).max()
        raise ValueError(f"{source}: expected vertices within {_LIMIT:g} m, got {reach:g} m in {part.name!r}")
    if len(part.faces) and not (0 <= part.faces.min() and part.faces.max() < len(part.vertices)):
        raise ValueError(f"{source}: a face of {part.name!r} names a vertex that is not there")


def _solid(part: Part) -> Part:
    """The part without triangles of zero area."""
    corners = part.vertices[part.faces.reshape(-1, 3)]
    sides = np.roll(corners, -1, axis=1) - corners
    area = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
    longest = np.linalg.norm(sides, axis=2).max(axis=1)
    kept = area > _THIN * longest
    clear = None if part.clear is None else part.clear[kept]
    return part._replace(faces=part.faces.reshape(-1, 3)[kept], clear=clear)


def _failed(part: Part, reason: str) -> Failure:
    return Failure(part.guid, part.ifc_class, part.name, reason)


def _joined(parts: list[Part], origin: np.ndarray, semantic: np.ndarray) -> Triangles:
    start = np.cumsum([0] + [len(part.vertices) for part in parts[:-1]])
    return Triangles(
        np.concatenate([part.vertices - origin for part in parts]).astype(np.float32),
        np.concatenate([part.faces + first for part, first in zip(parts, start, strict=True)]).astype(np.int32),
        np.repeat(np.arange(len(parts), dtype=np.int32), [len(part.faces) for part in parts]),
        semantic,
    )
