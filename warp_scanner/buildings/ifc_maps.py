"""Where an IFC file lies on the map: the transform that its IfcMapConversion describes, in metres."""

from typing import Any

import numpy as np

_STRETCH = 0.01  # a map projection's scale differs from 1 by less; what differs by more is a confusion of units


def to_map(model: Any, unit: float) -> tuple[np.ndarray | None, tuple[str, ...]]:
    """World to map grid, both in metres, of the file's first IfcMapConversion.

    Args:
        model: the parsed file.
        unit: [m] length of the file's unit.

    Returns:
        (4, 4) float64, None without a conversion (IFC2X3 knows none), and what had to be assumed, a sentence each.
    """
    found = model.by_type("IfcMapConversion") if model.schema != "IFC2X3" else []
    if not found:
        return None, ()
    from ifcopenshell.util.unit import get_named_unit_scale

    conversion, notes = found[0], ()
    map_unit = getattr(conversion.TargetCRS, "MapUnit", None)
    scale = conversion.Scale or 1.0
    # Without a unit of its own the map has the file's; but one of metres where its Scale leads to them.
    leads_to_metres = not map_unit and unit != 1.0 and abs(scale / unit - 1.0) <= _STRETCH
    if leads_to_metres:
        notes = (f"its IfcMapConversion names no unit; taken as metres, to which its Scale of {scale:g} leads",)
    metres = float(get_named_unit_scale(map_unit)) if map_unit else 1.0 if leads_to_metres else unit
    # The file's Scale leads from its units to those of the map, and holds the projection's scale as well.
    stretch = scale * metres / unit
    if abs(stretch - 1.0) > _STRETCH:
        notes = (f"the Scale of its IfcMapConversion would stretch the building by {stretch:g}; taken as 1",)
        stretch = 1.0
    # IFC4X3 has a kind with a factor for each axis.
    factors = stretch * np.array([getattr(conversion, f"Factor{axis}", None) or 1.0 for axis in "XYZ"])
    x, y = conversion.XAxisAbscissa or 0.0, conversion.XAxisOrdinate or 0.0
    turn = np.arctan2(y, x)
    matrix = np.eye(4)
    matrix[:2, :2] = [[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]
    matrix[:3, :3] *= factors
    matrix[:3, 3] = np.array([conversion.Eastings, conversion.Northings, conversion.OrthogonalHeight]) * metres
    return matrix, notes
