"""A building whose model is in several files, as its trades hand them in: read, brought together, and joined to one.

E elements of all files together. World frame: that of the file, or of the files, whose frame the whole has.
"""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from warp_scanner.buildings.files import read_building
from warp_scanner.buildings.frames import Placed, Read, bring_together, moved
from warp_scanner.buildings.ifc_zips import is_ifc
from warp_scanner.buildings.model_files import Model, ModelFile
from warp_scanner.buildings.storeys import FileStoreys, merged_storeys
from warp_scanner.buildings.twins import with_twins
from warp_scanner.scenes.building import (
    AS_IT_IS,
    WITHOUT_STOREYS,
    Building,
    Elements,
    Failure,
    ReadOptions,
    Source,
    Storeys,
    Triangles,
    Whole,
    WithoutSurfacesError,
    element_bounds,
    origin_of,
)
from warp_scanner.scenes.building_edits import without

AT_ONCE = 2  # files that are read at a time; most of a reader's work is of one thread
LARGEST_MARK = 2.0  # [m] of what marks the zero of a file
AT_ZERO = 0.01  # [m] from it
MANY_FILES = 4  # that are counted, not named, where all are alike
_PROXY = "IfcBuildingElementProxy"
Reader = Callable[..., Building]


def read_model(model: Model, options: ReadOptions = AS_IT_IS, read: Reader = read_building) -> Building:
    """The building in all files of a model, or in its only one.

    Args:
        model: its files.
        options: how to read them.
        read: reads one file, as `files.read_building` does.

    Raises:
        ValueError: a file cannot be read, or shares no place with the others; none has a surface; one line.
        ImportError: one is an IFC file, and ifcopenshell is not installed.
    """
    if len(model.files) == 1:
        return read(model.files[0].path, options)
    told = options.unit != 1.0 or options.y_up is not None

    def one_of(file: ModelFile) -> Read:
        return Read(file.name, named(read(file.path, options), file.name), is_ifc(file.path), told)

    with ThreadPoolExecutor(AT_ONCE) as pool:
        # The largest first: it takes longest. Errors come in the order of the names, whichever was met first.
        order = sorted(model.files, key=lambda one: -one.path.stat().st_size)
        found = {file.name: pool.submit(one_of, file) for file in order}
        files, empty = [], {}
        for file in model.files:
            try:
                files.append(found[file.name].result())
            except WithoutSurfacesError as error:
                # A schedule, or a trade that has drawn nothing yet, is none of the others' business.
                empty[file.name] = error
            except BaseException:
                pool.shutdown(cancel_futures=True)
                raise
    if not files:
        raise next(iter(empty.values()))
    left_out = tuple(f"{name} has no element with a surface{error.why}" for name, error in empty.items())
    if len(files) == 1:
        alone = Placed(files[0], np.eye(4))
        whole = alone.read.building._replace(sources=(_source(alone),))
    else:
        whole = together(files, None if model.first in empty else model.first)
    return whole._replace(notes=(*left_out, *whole.notes))


def named(building: Building, name: str) -> Building:
    """The building of one file, under the name that the file has among others."""
    failures, flaws = (tuple(one._replace(file=name) for one in each) for each in (building.failures, building.flaws))
    table = building.elements._replace(file=(name,) * len(building.elements.guid))
    wholes = tuple(one._replace(file=name) for one in building.wholes)
    return building._replace(elements=table, failures=failures, flaws=flaws, wholes=wholes)


def together(files: Sequence[Read], first: str | None = None) -> Building:
    """Files as one building: in one frame, with one table of storeys, and every element once.

    Args:
        files: two or more, with different names; their order does not matter.
        first: name of the one whose frame is that of the whole; None: that which most elements are in.

    Raises:
        ValueError: one shares no place with the others.
    """
    files = sorted(files, key=lambda one: one.name)
    files, marks = _without_marks(files)
    placed, moves = bring_together(files, first)
    building = joined(placed)
    building, same = with_twins(building)
    notes = (*moves, *same, *building.notes, *marks)
    said = f"{len(files)} files are read as one building"
    return building._replace(notes=(said, *notes))


def joined(placed: Sequence[Placed]) -> Building:
    """The elements of all files in one table, their surfaces in one frame, and their storeys as one.

    Args:
        placed: files where they lie, with different names.
    """
    buildings = [one.read.building for one in placed]
    vertices = [
        moved(one.triangles.vertices + one.origin, each.to_world) for one, each in zip(buildings, placed, strict=True)
    ]
    bounds = [
        element_bounds(one.triangles._replace(vertices=world)) for one, world in zip(buildings, vertices, strict=True)
    ]
    origin, far = origin_of(*(np.concatenate(sides).astype(np.float64) for sides in zip(*bounds, strict=True)))
    storeys = [
        FileStoreys(
            each.read.name,
            _raised(one, each.to_world, origin),
            one.elements.storey,
            low[:, 2] - origin[2],
            (low[:, 2] + high[:, 2]) / 2.0 - origin[2],
        )
        for one, each, (low, high) in zip(buildings, placed, bounds, strict=True)
    ]
    table, rows, told = merged_storeys(storeys)
    first = np.cumsum([0] + [len(one.elements.guid) for one in buildings[:-1]])
    elements = Elements(
        *(sum((getattr(one.elements, name) for one in buildings), ()) for name in ("guid", "ifc_class", "name")),
        np.concatenate(rows),
        np.concatenate([one.elements.semantic for one in buildings]),
        sum((one.elements.file for one in buildings), ()),
        sum((one.elements.twins for one in buildings), ()),
    )
    start = np.cumsum([0] + [len(one) for one in vertices[:-1]])
    triangles = Triangles(
        np.concatenate([world - origin for world in vertices]).astype(np.float32),
        np.concatenate([
            one.triangles.faces + np.int32(begin) for one, begin in zip(buildings, start, strict=True)
        ]),
        np.concatenate([
            one.triangles.element + np.int32(begin) for one, begin in zip(buildings, first, strict=True)
        ]),
        elements.semantic,
    )  # fmt: skip
    failures: tuple[Failure, ...] = sum((one.failures for one in buildings), ())
    flaws: tuple[Failure, ...] = sum((one.flaws for one in buildings), ())
    return Building(
        elements, triangles, origin, table, failures, sum(one.zero_area for one in buildings),
        (*told, *far, *_notes(placed)), _to_map(placed), flaws, sources=tuple(map(_source, placed)),
        wholes=_wholes(buildings, rows), clear=_clear(buildings),
    )  # fmt: skip


def _wholes(buildings: Sequence[Building], rows: Sequence[np.ndarray]) -> tuple[Whole, ...]:
    """Of all files, on the storeys that their elements (E of each) have in the table of the whole."""
    found = []
    for one, new in zip(buildings, rows, strict=True):
        storey = dict(zip(one.elements.storey.tolist(), np.asarray(new).tolist(), strict=True))
        found += [each._replace(storey=storey.get(each.storey, -1)) for each in one.wholes]
    return tuple(found)


def _clear(buildings: Sequence[Building]) -> np.ndarray | None:
    """Which triangles of all files are of glass; files that do not say have none. None where no file says."""
    if all(one.clear is None for one in buildings):
        return None
    each = [np.zeros(len(one.triangles.faces), bool) if one.clear is None else one.clear for one in buildings]
    return np.concatenate(each)


def _source(one: Placed) -> Source:
    building = one.read.building
    return Source(
        one.read.name, "ifc" if one.read.is_ifc else "mesh", building.unit * _scale(one), building.project,
        len(building.elements.guid), one.to_world,
    )  # fmt: skip


def _scale(one: Placed) -> float:
    """What a mesh's unit was told to be; IFC files and their grids keep theirs."""
    return 1.0 if one.read.is_ifc else float(round(np.cbrt(abs(np.linalg.det(one.to_world[:3, :3]))), 9))


def _raised(building: Building, to_world: np.ndarray, origin: np.ndarray) -> Storeys:
    """A file's storeys, at their heights above the origin of the whole."""
    at = np.tile(building.origin, (len(building.storeys.name), 1))
    at[:, 2] += building.storeys.elevation
    return building.storeys._replace(elevation=moved(at, to_world)[:, 2] - origin[2])


def _to_map(placed: Sequence[Placed]) -> np.ndarray | None:
    """From the frame of the whole to the map grid, by the file of most elements that says it."""
    known = [one for one in placed if one.read.building.to_map is not None]
    if not known:
        return None
    best = max(known, key=lambda one: (np.array_equal(one.to_world, np.eye(4)), len(one.read.building.elements.guid)))
    return best.read.building.to_map @ np.linalg.inv(best.to_world)


def _notes(placed: Sequence[Placed]) -> tuple[str, ...]:
    """What was assumed or mended in each file; what is the same of several is said once."""
    said: dict[str, list[str]] = {}
    for one in placed:
        for note in one.read.building.notes:
            if note != WITHOUT_STOREYS:  # their elements are on those of the others
                said.setdefault(note, []).append(one.read.name)
    return tuple(f"{', '.join(files)}: {note}" for note, files in said.items())


def _without_marks(files: list[Read]) -> tuple[list[Read], tuple[str, ...]]:
    """Files without what marks their zero, as some offices put one into every file; and a note of it.

    Such a proxy is no part of the building: it would enlarge what the building spans, or lie far from it.
    """
    marks: dict[tuple, list[tuple[int, int]]] = {}
    for number, one in enumerate(files):
        for row in _at_zero(one.building):
            low, high = (side[row] for side in element_bounds(one.building.triangles))
            shape = tuple(np.round(np.array([low, high]).ravel() + np.tile(one.building.origin, 2), 2).tolist())
            marks.setdefault((one.building.elements.name[row], shape), []).append((number, int(row)))
    gone: dict[int, list[int]] = {}
    notes = []
    for (name, _), places in sorted(marks.items()):
        if len({number for number, _ in places}) < 2:
            continue
        names = [files[number].name for number, _ in places]
        told = ", ".join(names) if len(names) < MANY_FILES else f"{len(names)} files"
        notes.append(f"{_PROXY} {name!r} marks the zero of {told}: left out")
        for number, row in places:
            gone.setdefault(number, []).append(row)
    left = []
    for number, one in enumerate(files):
        rows = gone.get(number, [])
        if 0 < len(rows) < len(one.building.elements.guid):
            one = one._replace(building=without(one.building, np.array(rows)))
        left.append(one)
    return left, tuple(notes)


def _at_zero(building: Building) -> np.ndarray:
    """Rows of small proxies that the zero of the file is in, or on."""
    low, high = (side + building.origin for side in element_bounds(building.triangles))
    holds = np.all((low <= AT_ZERO) & (high >= -AT_ZERO), axis=1) & ((high - low).max(axis=1) <= LARGEST_MARK)
    return np.flatnonzero(holds & (np.asarray(building.elements.ifc_class, str) == _PROXY))
