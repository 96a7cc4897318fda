"""What an IFC model is told of how far off its place an element stands: properties, in the file's own units."""

import math
from typing import Any, NamedTuple

from jaxmm.deviations.deviation import Deviation
from jaxmm.ifc.marks import Measure


class Units(NamedTuple):
    """The units of a file."""

    length: float  # [m]
    angle: float  # [rad]

    def of_length(self, metres: float | None) -> Measure | None:
        """A length in the file's unit; None where it is not known."""
        return _measure("IfcLengthMeasure", metres, self.length)

    def of_angle(self, degrees: float | None) -> Measure | None:
        """An angle in the file's unit; None where it is not known."""
        return _measure("IfcPlaneAngleMeasure", None if degrees is None else math.radians(degrees), self.angle)


def units_of(model: Any) -> Units:
    """The units of a model."""
    from ifcopenshell.util.unit import calculate_unit_scale

    return Units(*(float(calculate_unit_scale(model, kind)) for kind in ("LENGTHUNIT", "PLANEANGLEUNIT")))


def told_of(one: Deviation, units: Units) -> dict[str, Any]:
    """The properties of one element by name; None for what is not known, like an offset along what no face fixes.

    `Distance` is along `Direction`, toward the scanner positive; `OffsetX` and so on are along the axes of the world.
    Low and High bound the interval of 95 %.
    """
    told: dict[str, Any] = {
        "Distance": units.of_length(one.distance),
        "DistanceLow": units.of_length(one.distance - one.half),
        "DistanceHigh": units.of_length(one.distance + one.half),
        "Direction": " ".join(f"{value + 0.0:.4f}" for value in one.direction),
    }
    for axis, value, span in zip("XYZ", one.offset, one.interval, strict=True):
        ends = (value, *span) if span is not None else (None, None, None)
        for end, number in zip(("", "Low", "High"), ends, strict=True):
            told[f"Offset{axis}{end}"] = units.of_length(number)
    return told | {
        "Turn": units.of_angle(one.turn), "Lean": units.of_angle(one.lean), "Flatness": units.of_length(one.flatness),
        "Coverage": _known(one.coverage), "Rays": one.rays, "LevelOfAccuracy": one.classes["loa"],
        "DIN18202": one.classes["din18202"],
    }  # fmt: skip


def _measure(kind: str, value: float | None, unit: float) -> Measure | None:
    value = _known(value)
    return None if value is None else Measure(kind, round(value / unit, 9) + 0.0)


def _known(value: float | None) -> float | None:
    return None if value is None or not math.isfinite(value) else round(float(value), 9)
