"""Where an IFC file lies on the map: the transform that its IfcMapConversion describes, in metres.

IFC2X3 knows none: there a property set `ePset_MapConversion` of the site or project holds the same, by the agreement of
buildingSMART Australasia that IFC exporters follow.
"""

from typing import Any, NamedTuple

import numpy as np

from warp_scanner.buildings.ifc_model import at_zero

_STRETCH = 0.01  # a map projection's scale differs from 1 by less; what differs by more is a confusion of units
_SETS = {"conversion": "epset_mapconversion", "system": "epset_projectedcrs"}  # written in any case
_UNITS = {"METRE": 1.0, "METER": 1.0, "M": 1.0, "MILLIMETRE": 0.001, "MILLIMETER": 0.001, "MM": 0.001,
          "FOOT": 0.3048, "US SURVEY FOOT": 1200.0 / 3937.0}  # fmt: skip


class _Conversion(NamedTuple):
    """What a file says of its place on the map."""

    source: str  # what says it
    values: dict[str, Any]  # by the names of the attributes of IfcMapConversion and its kinds
    metres: float | None  # of the map's unit; None where it names none


def to_map(model: Any, unit: float) -> tuple[np.ndarray | None, tuple[str, ...]]:
    """World to map grid, both in metres, of the file's first IfcMapConversion, or of a property set that holds one.

    Args:
        model: the parsed file.
        unit: [m] length of the file's unit.

    Returns:
        (4, 4) float64, None without a conversion, and what had to be assumed or is not used, a sentence each.
    """
    conversion = _attributes(model) or _properties(model)
    if conversion is None:
        return None, _on_the_globe(model)
    source, values, metres = conversion
    notes, scale = (), float(values.get("Scale") or 1.0)
    if metres is None:
        # Without a unit of its own the map has the file's; but one of metres where its Scale leads to them.
        leads_to_metres = unit != 1.0 and abs(scale / unit - 1.0) <= _STRETCH
        metres = 1.0 if leads_to_metres else unit
        if leads_to_metres:
            notes = (f"its {source} names no unit; taken as metres, to which its Scale of {scale:g} leads",)
    # The file's Scale leads from its units to those of the map, and holds the projection's scale as well.
    stretch = scale * metres / unit
    if abs(stretch - 1.0) > _STRETCH:
        notes = (f"the Scale of its {source} would stretch the building by {stretch:g}; taken as 1",)
        stretch = 1.0
    # IFC4X3 has a kind with a factor for each axis.
    factors = stretch * np.array([values.get(f"Factor{axis}") or 1.0 for axis in "XYZ"])
    turn = np.arctan2(values.get("XAxisOrdinate") or 0.0, values.get("XAxisAbscissa") or 0.0)
    matrix = np.eye(4)
    matrix[:2, :2] = [[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]
    matrix[:3, :3] *= factors
    contexts = model.by_type("IfcGeometricRepresentationContext", include_subtypes=False)
    if not all(at_zero(context.WorldCoordinateSystem) for context in contexts):
        notes += ("its WorldCoordinateSystem is moved or turned; taken as zero, so scans on a map grid may not fit it",)
    place = [values.get(name) or 0.0 for name in ("Eastings", "Northings", "OrthogonalHeight")]
    matrix[:3, 3] = np.array(place, float) * metres
    return matrix, notes


def _attributes(model: Any) -> _Conversion | None:
    """Of the first IfcMapConversion."""
    found = model.by_type("IfcMapConversion") if model.schema != "IFC2X3" else []
    if not found:
        return None
    from ifcopenshell.util.unit import get_named_unit_scale

    map_unit = getattr(found[0].TargetCRS, "MapUnit", None)
    metres = float(get_named_unit_scale(map_unit)) if map_unit else None
    return _Conversion("IfcMapConversion", found[0].get_info(), metres)


def _properties(model: Any) -> _Conversion | None:
    """Of the first property set that names a place in numbers."""
    sets: dict[str, dict[str, Any]] = {}
    for one in model.by_type("IfcPropertySet"):
        name = (one.Name or "").casefold()
        if name in _SETS.values() and name not in sets:
            values = {each.Name: getattr(each, "NominalValue", None) for each in one.HasProperties}
            sets[name] = {key: value.wrappedValue for key, value in values.items() if value is not None}
    values = {key: value for key, value in sets.get(_SETS["conversion"], {}).items() if isinstance(value, int | float)}
    if not {"Eastings", "Northings"} <= values.keys():
        return None
    named = str(sets.get(_SETS["system"], {}).get("MapUnit") or "").strip().upper()
    return _Conversion("ePset_MapConversion", values, _UNITS.get(named))


def _on_the_globe(model: Any) -> tuple[str, ...]:
    """That a site has a latitude and a longitude, which are no place on a map grid."""
    for site in model.by_type("IfcSite"):
        if site.RefLatitude and site.RefLongitude:
            north, east = (_degrees(angle) for angle in (site.RefLatitude, site.RefLongitude))
            return (
                f"its site lies at latitude {north:.5f}, longitude {east:.5f}, but the file has no IfcMapConversion: "
                "scans on a map grid do not fit it",
            )
    return ()


def _degrees(angle: tuple[int, ...]) -> float:
    """Of degrees, minutes, seconds, millionths of a second, all of one sign."""
    return sum(part / size for part, size in zip(angle, (1, 60, 3600, 3.6e9), strict=False))
