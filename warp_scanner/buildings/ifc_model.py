"""Opens IFC files: checks their text, parses them by ifcopenshell, mends exporters' errors, reads their unit."""

import importlib.util
import math
import mmap
import re
from pathlib import Path
from typing import Any

import numpy as np

from warp_scanner.buildings.ifc_schemas import Lost, parse

_UNIT = 1e-4  # by which the length of a direction may be off 1, as rounded ratios are
_STILL = (("Location", "Coordinates", (0.0, 0.0, 0.0)), ("Axis", "DirectionRatios", (0.0, 0.0, 1.0)),
          ("RefDirection", "DirectionRatios", (1.0, 0.0, 0.0)))  # fmt: skip
_BEGIN = 4096  # bytes in which a file says that it is one
MISSING = "reading IFC needs the extra ifc: pip install 'jaxmm[ifc]'"


def check_installed() -> None:
    """Look for the library without loading it.

    Raises:
        ImportError: it is not installed.
    """
    if importlib.util.find_spec("ifcopenshell") is None:
        raise ImportError(MISSING)


def import_ifcopenshell() -> Any:
    """The library, with what is needed of it.

    Raises:
        ImportError: it is not installed.
    """
    try:
        import ifcopenshell
        import ifcopenshell.geom
        import ifcopenshell.guid
        import ifcopenshell.util.element
        import ifcopenshell.util.placement
        import ifcopenshell.util.unit
    except ImportError as error:
        raise ImportError(MISSING) from error
    return ifcopenshell


def check_text(path: Path) -> None:
    """Refuse what is no IFC file by the words that its text must hold.

    Raises:
        ValueError: missing; of a name that the library cannot read; not IFC; cut off.
    """
    if not path.is_file():
        raise ValueError(f"{path}: expected a file, found {'a folder' if path.is_dir() else 'nothing there'}")
    try:
        str(path).encode()
    except UnicodeEncodeError as error:
        raise ValueError(f"{path}: expected a name in UTF-8, which the library for IFC needs; rename it") from error
    begins = ends = has_schema = False
    with open(path, "rb") as file:
        begins = b"ISO-10303-21" in file.read(_BEGIN)
        if begins:
            # Headers have any length, and so has what may follow the end, so nothing less than the whole tells.
            with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as text:
                ends = text.rfind(b"END-ISO-10303-21") >= 0
                has_schema = text.find(b"FILE_SCHEMA") >= 0
    if not begins:
        raise ValueError(f"{path}: expected an IFC file (text that begins with ISO-10303-21), found something else")
    if not ends:
        raise ValueError(f"{path}: the file is cut off: it does not end with END-ISO-10303-21")
    if not has_schema:
        raise ValueError(f"{path}: expected an IFC file, whose header names its FILE_SCHEMA, found none")


def open_model(path: Path) -> tuple[Any, tuple[str, ...], list[Lost]]:
    """The parsed file, notes of what had to be mended in it, and its references to nothing.

    Raises:
        ValueError: the library cannot read it; a number stands for several entities.
        ImportError: ifcopenshell is not installed.
    """
    ifcopenshell = import_ifcopenshell()
    try:
        model, notes, lost = parse(ifcopenshell, path)
    except Exception as error:  # the parser raises classes of its own, and plain ones on unknown schemas
        raise ValueError(f"{path}: not a readable IFC file: {' '.join(str(error).split())[:150]}") from error
    numbers: set[int] = set()
    for entity in model.by_type("IfcRoot"):
        if entity.id() in numbers:  # the library cuts an opening as often as it stands there, which may take for ever
            raise ValueError(f"{path}: not a readable IFC file: the number #{entity.id()} stands for several entities")
        numbers.add(entity.id())
        if not entity.GlobalId:
            entity.GlobalId = identity_of(entity)  # the library's shape iterator never ends at one without
    for direction in model.by_type("IfcDirection"):
        _make_unit(model, direction)
    mended = sum(_mend(product) for product in model.by_type("IfcProduct"))
    told = f"{mended} elements of the file mark an empty value by *, where IFC has $: nothing is lost by it"
    return model, (*notes, told) if mended else notes, lost


def _make_unit(model: Any, direction: Any) -> None:
    """What a solid is extruded along has a length that means nothing, by which one kernel multiplies its depth."""
    try:
        length = math.hypot(*direction.DirectionRatios or ())
    except TypeError:  # no numbers: what is extruded along it fails by itself
        return
    if abs(length - 1.0) < _UNIT or not 0.0 < length < math.inf:
        return
    if any(getattr(user, "ExtrudedDirection", None) == direction for user in model.get_inverse(direction)):
        direction.DirectionRatios = [ratio / length for ratio in direction.DirectionRatios]


def _mend(product: Any) -> bool:
    """Some exporters write `*` (derived) for an attribute that is merely empty, which no shape survives."""
    if ",*" not in str(product):
        return False
    for place in range(2, len(product)):
        if product[place] is None:
            product[place] = None
    return True


def identity_of(entity: Any) -> str:
    """GlobalId of an entity as the file has it; where that is missing, its number in the file: #12."""
    return entity.GlobalId or f"#{entity.id()}"


def world_matrix(placement: Any) -> np.ndarray:
    """(4, 4) float64 from a placement, or from none, to the world; lengths in the file's unit."""
    return np.eye(4) if placement is None else world_matrix(placement.PlacementRelTo) @ own_matrix(placement)


def own_matrix(placement: Any) -> np.ndarray:
    """(4, 4) float64 from an IfcLocalPlacement to what it is relative to; lengths in the file's unit."""
    from ifcopenshell.util.placement import get_axis2placement

    matrix = np.array(get_axis2placement(placement.RelativePlacement), np.float64)
    # RefDirection only tells in which plane the x axis lies. The library takes it for the axis, and so shears what lies
    # within; its y and z are right.
    matrix[:3, 0] = np.cross(matrix[:3, 1], matrix[:3, 2])
    return matrix


def at_zero(axes: Any) -> bool:
    """Whether an IfcAxis2Placement, or none, moves and turns nothing."""
    parts = ((getattr(getattr(axes, part, None), numbers, None), still) for part, numbers, still in _STILL)
    return all(found in (None, still, still[:2]) for found, still in parts)


def unit_scale(model: Any, path: Path | str) -> float:
    """Metres per unit of length in the file.

    Raises:
        ValueError: it names no unit of length, or one that is unknown.
    """
    from ifcopenshell.util.unit import get_project_unit

    unit = get_project_unit(model, "LENGTHUNIT")
    if unit is None:
        raise ValueError(f"{path}: expected a unit of length (IfcUnitAssignment with LENGTHUNIT), found none")
    scale = _metres(unit, Path(path))
    if not 0.0 < scale < np.inf:
        name = _prefix_and_name(unit, Path(path)) if unit.is_a("IfcSIUnit") else getattr(unit, "Name", None)
        shown = " ".join(str(name or "without a name").split())[:60]  # what is damaged may go on over many lines
        raise ValueError(f"{path}: the length unit {unit.is_a()} {shown} is unknown")
    return scale


def _metres(unit: Any, path: Path, depth: int = 0) -> float:
    """Metres per unit; NaN for one that is not the metre, with a known prefix or none, or a multiple of such a unit."""
    from ifcopenshell.util.unit import prefixes

    if unit.is_a("IfcSIUnit"):
        prefix, _, name = _prefix_and_name(unit, path).rpartition(" ")
        return prefixes.get(prefix, 1.0 if not prefix else np.nan) if name == "METRE" else np.nan
    # A unit that is defined by itself has no length.
    if not unit.is_a("IfcConversionBasedUnit") or depth > 8:
        return np.nan
    factor = unit.ConversionFactor
    value = getattr(factor and factor.ValueComponent, "wrappedValue", None)
    if not isinstance(value, int | float) or not factor.UnitComponent:
        return np.nan
    return float(value) * _metres(factor.UnitComponent, path, depth + 1)


def _prefix_and_name(unit: Any, path: Path) -> str:
    """Prefix and name of an IfcSIUnit, as `MILLI METRE`, from the text: the parser takes an unknown one for none."""
    entity = re.compile(rb"#\s*%d\s*=\s*IFCSIUNIT\s*\(([^;]*)\)\s*;" % unit.id(), re.IGNORECASE)
    found = entity.search(path.read_bytes())
    words = found[1].decode("ascii", "replace").split(",")[2:] if found else [unit.Prefix or "$", unit.Name or "$"]
    return " ".join(word.strip(" .\t\r\n").upper() for word in words if word.strip() not in ("$", "*"))
