"""Reads IFC files: every product with a body becomes one element, in metres and world coordinates, openings cut.

A body is what is represented as such: not the space that a door needs to open, no axis, no box, no sketch. Spaces,
openings, annotations, grids, ports and structural analysis have no matter and are left out; so is, with a note, what a
site or another part of the spatial structure shows of itself (terrain, outlines). What a wall, column, door, window or
slab is put together from (plates, members, layers) belongs to it, and so does what is added to it as a feature; all
else that is put together (stairs, roofs) stays as its parts, but a layer is of what it is a layer of. Elements whose
shape cannot be made are listed with the reason.
"""

import contextlib
import itertools
import re
from collections import Counter
from collections.abc import Container
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from warp_scanner.buildings import kept_models
from warp_scanner.buildings.arrays import packed, unpacked
from warp_scanner.buildings.ifc_bodies import keep_bodies
from warp_scanner.buildings.ifc_grids import place_by_grids
from warp_scanner.buildings.ifc_hazards import beyond_the_library, mapped_from_elsewhere
from warp_scanner.buildings.ifc_maps import to_map
from warp_scanner.buildings.ifc_model import (
    check_installed,
    check_text,
    identity_of,
    open_model,
    unit_scale,
    world_matrix,
)
from warp_scanner.buildings.ifc_wholes import owner_of, put_together, wholes_of
from warp_scanner.buildings.ifc_zips import plain_file
from warp_scanner.guarded import Plain
from warp_scanner.scenes.building import (
    AS_IT_IS,
    MOST_NAMED,
    Building,
    Failure,
    Found,
    Part,
    ReadOptions,
    Storeys,
    Whole,
    WithoutSurfacesError,
    assemble,
)
from warp_scanner.scenes.scenes import CEILING, DOOR, FLOOR, FURNITURE, OTHER, PILLAR, WALL, WINDOW

# The plain CGAL kernel loses elements without a word; this one falls back on OpenCASCADE for what CGAL cannot do.
_KERNEL = "hybrid-cgal-simple-opencascade"
_THREADS = 1  # of its iterator: two are no faster on seven of eight files, and take 1.2 to 8 times the computing
_GLOBAL_ID = re.compile(r"[0-3][0-9A-Za-z_$]{21}")
_CLEAR = 0.3  # transparency from which a material counts as glass
# Names that a version of the schema lacks match nothing.
_WITHOUT_MATTER = (
    "IfcFeatureElementSubtraction", "IfcSurfaceFeature", "IfcVirtualElement", "IfcAnnotation", "IfcGrid",
    "IfcPositioningElement", "IfcLinearElement", "IfcPort", "IfcStructuralActivity", "IfcStructuralItem",
)  # fmt: skip
_SPATIAL = ("IfcSpatialElement", "IfcSpatialStructureElement")
_VOLUMES = ("IfcSpace", "IfcSpatialZone", "IfcExternalSpatialStructureElement")  # the air between elements
_CLASSES = (
    ("IfcWall", WALL),
    ("IfcColumn", PILLAR),
    ("IfcDoor", DOOR),
    ("IfcWindow", WINDOW),
    ("IfcSlab", FLOOR),
    ("IfcRoof", CEILING),
    ("IfcFurnishingElement", FURNITURE),
)

_EMPTY = "without surfaces"  # the one word that is answered for a file of which nothing can be made


class _Shape(NamedTuple):
    vertices: np.ndarray  # (v, 3) float64 [m] world
    faces: np.ndarray  # (t, 3)
    clear: np.ndarray  # (t,) bool: of a transparent material


def read_ifc(path: Path | str, options: ReadOptions = AS_IT_IS) -> Building:
    """The building that an IFC file (STEP text, .ifc, or packed, .ifczip) describes.

    ifcopenshell runs in a process of its own: brackets without end, or a shape that is none, can crash or stall it.

    Args:
        path: the file.
        options: whether glass and doors are there.

    Raises:
        ValueError: missing; not IFC or cut off; an archive without one model; no length unit, or an unknown one; no
            element with a shape; so damaged that the library crashes, or takes longer or more memory than `limits_for`
            the file allows.
        ImportError: ifcopenshell is not installed.
    """
    path = Path(path)
    with plain_file(path) as plain:
        check_text(plain)
        check_installed()
        found = kept_models.read(_parsed, plain, options)
        if found.words.keys() == {_EMPTY}:
            raise WithoutSurfacesError(str(plain), found.words[_EMPTY])
        building = unpacked(found)
    table = building.elements._replace(file=(path.name,) * len(building.elements.guid))
    return building._replace(elements=table, wholes=tuple(one._replace(file=path.name) for one in building.wholes))


def reading_ahead(path: Path, options: ReadOptions = AS_IT_IS) -> AbstractContextManager[None]:
    """Within, an IFC file is read in the background, and `read_ifc` waits for it; of what is no such file, nothing.

    Whatever is wrong with the file, `read_ifc` tells.
    """
    try:
        check_text(path)
        check_installed()
    except (ValueError, ImportError, OSError):
        return contextlib.nullcontext()
    return kept_models.ahead(_parsed, path, options)


def _parsed(path: Path, options: dict[str, Any]) -> Plain:
    """What goes from one process to another, where errors are words: what is no fault of the file is no error there."""
    try:
        return packed(parse_ifc(path, ReadOptions(**options)))
    except WithoutSurfacesError as error:
        return Plain({_EMPTY: error.why}, {})


def parse_ifc(path: Path, options: ReadOptions) -> Building:
    """What `read_ifc` does, in this process, which a damaged file may end.

    Raises:
        ValueError: as `read_ifc` does.
    """
    try:
        with np.errstate(all="ignore"):
            return _building(path, options)
    except Exception as error:  # a file that is text of the right kind may still hold anything in any place
        if isinstance(error, ValueError) and str(path) in str(error):
            raise
        why = f"{type(error).__name__}: {' '.join(str(error).split())[:150]}"
        raise ValueError(f"{path}: not a readable IFC file: its parts do not fit together ({why})") from error


def _building(path: Path, options: ReadOptions) -> Building:
    model, notes, lost = open_model(path)
    unit = unit_scale(model, path)
    shapeless = place_by_grids(model) | beyond_the_library(path, model, unit, lost)
    storeys, rows = _storeys(model, unit, shapeless)
    products, left_out = _products(model)
    guids, repeated = _unique_guids(products)
    represented = [product for product in products if product.Representation]
    shapeless |= keep_bodies(model, represented)
    shapes, reasons = _shapes(model, [product for product in represented if product.id() not in shapeless])
    reasons |= shapeless
    pieces: dict[Any, list[_Shape]] = {}
    for product in products:
        if product.id() in shapes:
            pieces.setdefault(owner_of(product), []).append(shapes[product.id()])
    parts = [
        part._replace(guid=guids[owner.id()])
        for owner, shape in pieces.items()
        if (part := _part(owner, shape, rows, options))
    ]
    # What has no body of its own is there when something that it is put together from is.
    shown = shapes.keys() | {whole.id() for number in shapes for whole in wholes_of(model.by_id(number))}
    failures = [
        Failure(guids[product.id()], product.is_a(), product.Name or "", reasons.get(product.id(), "it has no body"))
        for product in products
        if product.id() not in shown
    ]
    placed, assumed = to_map(model, unit)
    projects = map(identity_of, model.by_type("IfcProject"))
    project = next((guid for guid in projects if not guid.startswith("#")), None)
    elsewhere = mapped_from_elsewhere(model)
    named = [product.Name or guids[product.id()] for product in products if product.id() in elsewhere]
    doubted = ("a MappingOrigin that is not zero is read in two ways; these may stand elsewhere: " + _listed(named),)
    told = notes + left_out + repeated + assumed + (doubted if named else ())
    wholes = tuple(
        Whole(guids[whole.id()], whole.is_a(), whole.Name or "", _storey_of(whole, rows), tuple(guids[n] for n in own))
        for whole, own in put_together(pieces)
    )
    found = Found(storeys, tuple(failures), told, placed, unit=unit, project=project, wholes=wholes)
    return assemble(str(path), parts, found)


def _products(model: Any) -> tuple[list[Any], tuple[str, ...]]:
    """All that may have a body: elements, then other products that show something; and a note for each left out."""
    others = [product for product in model.by_type("IfcProduct") if product.Representation]
    others = [product for product in others if not product.is_a("IfcElement")]
    spatial = [product for product in others if any(map(product.is_a, _SPATIAL))]
    # Terrain would make all that lies above it the inside of the building.
    notes = tuple(
        f"the shape of {product.is_a()} {product.Name or ''!r} was left out: it is no element of the building"
        for product in spatial
        if not any(map(product.is_a, _VOLUMES))
    )
    products = [*model.by_type("IfcElement"), *(product for product in others if product not in spatial)]
    return [product for product in products if not any(map(product.is_a, _WITHOUT_MATTER))], notes


def _unique_guids(products: list[Any]) -> tuple[dict[int, str], tuple[str, ...]]:
    """What elements go by, by STEP id, and notes of what is wrong with GlobalIds.

    That is their GlobalId as it is, with a suffix where an earlier product has the same, or else their number.
    """
    guids: dict[int, str] = {}
    count, taken = Counter(), set()
    for product in products:
        own = identity_of(product)
        guid = next(g for n in itertools.count(count[own]) if (g := f"{own}_{n}" if n else own) not in taken)
        count[own] += 1
        taken.add(guid)
        guids[product.id()] = guid
    missing = [guid for guid in guids.values() if guid.startswith("#")]
    odd = [guids[product.id()] for product in products if not _GLOBAL_ID.fullmatch(identity_of(product))]
    odd = [guid for guid in odd if guid not in missing]
    repeated = [repr(own) for own, times in count.items() if times > 1]
    told = (
        (repeated, "more than one element has the GlobalId {}: a suffix tells them apart"),
        (missing, "elements without a GlobalId go by their number in the file: {}"),
        (odd, "elements have a GlobalId that is not of 22 characters of its alphabet, and go by it as it is: {}"),
    )
    return guids, tuple(words.format(_listed(which)) for which, words in told if which)


def _listed(names: list[str]) -> str:
    more = f" and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else ""
    return ", ".join(names[:MOST_NAMED]) + more


def _part(owner: Any, shapes: list[_Shape], rows: dict[int, int], options: ReadOptions) -> Part | None:
    """The element that these shapes make up; None when the options leave all of it out."""
    semantic = _semantic(owner)
    if semantic == DOOR and options.doors == "open":
        return None
    start = np.cumsum([0] + [len(shape.vertices) for shape in shapes[:-1]])
    vertices = np.concatenate([shape.vertices for shape in shapes])
    faces = np.concatenate([shape.faces + first for shape, first in zip(shapes, start, strict=True)])
    clear = np.concatenate([shape.clear for shape in shapes])
    if options.glass == "transparent":
        # A window whose materials say nothing is taken for glass as a whole.
        clear |= semantic == WINDOW and not clear.any()
        if clear.all():
            return None
        faces, clear = faces[~clear], None
    named = identity_of(owner), owner.is_a(), owner.Name or ""
    return Part(*named, _storey_of(owner, rows), semantic, vertices, faces, clear)


def _storeys(model: Any, scale: float, placeless: Container[int]) -> tuple[Storeys, dict[int, int]]:
    """The storeys from the lowest up, and the row of each STEP id."""

    def elevation(storey: Any) -> float:
        # The placement is where things really stand; the attribute is a remark that some files get wrong.
        if storey.ObjectPlacement and storey.id() not in placeless:
            return float(world_matrix(storey.ObjectPlacement)[2, 3]) * scale
        return float(storey.Elevation or 0.0) * scale

    found = sorted(((elevation(storey), storey) for storey in model.by_type("IfcBuildingStorey")), key=lambda s: s[0])
    guids = tuple(identity_of(storey) for _, storey in found)
    names = tuple(storey.Name or "" for _, storey in found)
    rows = {storey.id(): row for row, (_, storey) in enumerate(found)}
    return Storeys(guids, names, np.array([z for z, _ in found])), rows


def _storey_of(product: Any, rows: dict[int, int]) -> int:
    from ifcopenshell.util.element import get_container

    storey = get_container(product, ifc_class="IfcBuildingStorey")
    return rows[storey.id()] if storey else -1


def _semantic(product: Any) -> int:
    kind = getattr(product, "PredefinedType", None)
    if product.is_a("IfcSlab") and kind == "ROOF":
        return CEILING
    if product.is_a("IfcCovering"):
        return {"CEILING": CEILING, "FLOORING": FLOOR}.get(kind, OTHER)
    return next((semantic for name, semantic in _CLASSES if product.is_a(name)), OTHER)


def _shapes(model: Any, products: list[Any]) -> tuple[dict[int, _Shape], dict[int, str]]:
    """Shapes by STEP id, as GlobalIds may repeat, and for those that have none the reason."""
    import ifcopenshell.geom

    settings = ifcopenshell.geom.settings()
    settings.set("use-world-coords", True)
    settings.set("weld-vertices", True)
    shapes: dict[int, _Shape] = {}
    if not products:
        return shapes, {}
    iterator = ifcopenshell.geom.iterator(settings, model, _THREADS, include=products, geometry_library=_KERNEL)
    for made in iterator:
        _keep(shapes, made)
    reasons = {}
    for product in products:
        if product.id() in shapes:
            continue
        # The iterator passes over what fails, and may end there: each of the rest gets a try of its own.
        try:
            made = ifcopenshell.geom.create_shape(settings, product, geometry_library=_KERNEL)
        except Exception as error:  # the geometry kernels raise whatever they like
            reasons[product.id()] = _why(error, product)
        else:
            _keep(shapes, made)
            reasons[product.id()] = "its body has no faces"
    return shapes, reasons


def _why(error: Exception, product: Any) -> str:
    """What the library says before it lists the entities, and of which kind of representation."""
    said = " ".join(str(error).split()).partition(" Product: ")[0].rstrip(".") or type(error).__name__
    kinds = dict.fromkeys(one.RepresentationType or "?" for one in product.Representation.Representations or ())
    return f"{said[:150]} ({', '.join(kinds)[:50]})"


def _keep(shapes: dict[int, _Shape], made: Any) -> None:
    geometry = made.geometry
    faces = np.array(geometry.faces, np.int64).reshape(-1, 3)
    if not len(faces):
        return
    transparency = np.nan_to_num(np.array([material.transparency for material in geometry.materials], np.float64))
    # A triangle without a material has the number -1, which picks the gap at the end.
    clear = np.append(transparency >= _CLEAR, False)[np.array(geometry.material_ids, np.int64)]
    shapes[made.id] = _Shape(np.array(geometry.verts, np.float64).reshape(-1, 3), faces, clear)
