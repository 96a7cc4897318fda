"""Places what an IFC file places on the intersection of two grid axes, which the library leaves without a place.

Axes are straight: polylines, lines and their trimmed pieces. Coordinates are those of the grid, in the file's unit.
"""

from typing import Any, NamedTuple

import numpy as np

_STRAIGHT = 1e-6  # of the length of an axis, by which its points may lie beside it
_PARALLEL = 1e-6  # sine of the angle between axes that do not meet


class _Line(NamedTuple):
    start: np.ndarray  # (2,)
    way: np.ndarray  # (2,) unit


def place_by_grids(model: Any) -> dict[int, str]:
    """Turn each IfcGridPlacement, in the model as it is in memory, into the local placement that it means.

    Returns:
        For each product whose place remains unknown, by STEP id, the reason.
    """
    reasons = {}
    for placement in model.by_type("IfcGridPlacement"):
        try:
            local = _local(model, placement)
        except ValueError as error:
            reasons |= {product.id(): f"its place is unknown: {error}" for product in _placed(model, placement)}
            continue
        for user in model.get_inverse(placement):
            for attribute in ("ObjectPlacement", "PlacementRelTo"):
                if getattr(user, attribute, None) == placement:
                    setattr(user, attribute, local)
    return reasons


def _local(model: Any, placement: Any) -> Any:
    """The IfcLocalPlacement of the same place, relative to the grid's."""
    at, first = _meeting(placement.PlacementLocation)
    x_axis, reference = first.way, placement.PlacementRefDirection
    if reference is not None and reference.is_a("IfcDirection"):
        x_axis = np.array(reference.DirectionRatios[:2], float)
    elif reference is not None:
        x_axis = (_meeting(reference)[0] - at)[:2]
    length = np.linalg.norm(x_axis)
    if not length > 0.0:
        raise ValueError("the direction of its IfcGridPlacement has no length")
    point = model.create_entity("IfcCartesianPoint", at.tolist())
    up = model.create_entity("IfcDirection", (0.0, 0.0, 1.0))
    along = model.create_entity("IfcDirection", [*(x_axis / length).tolist(), 0.0])
    axes = model.create_entity("IfcAxis2Placement3D", point, up, along)
    return model.create_entity("IfcLocalPlacement", _grid(placement.PlacementLocation).ObjectPlacement, axes)


def _meeting(intersection: Any) -> tuple[np.ndarray, _Line]:
    """Where two axes meet, each moved to its left by its offset (3,), and the first of them."""
    offsets = [float(offset) for offset in intersection.OffsetDistances or ()] + [0.0] * 3
    first, second = (
        _moved(_line(axis), offset) for axis, offset in zip(intersection.IntersectingAxes, offsets, strict=False)
    )
    across = first.way[0] * second.way[1] - first.way[1] * second.way[0]
    if abs(across) < _PARALLEL:
        raise ValueError("the axes of its IfcGridPlacement are parallel")
    off = second.start - first.start
    along = (off[0] * second.way[1] - off[1] * second.way[0]) / across
    return np.append(first.start + along * first.way, offsets[2]), first


def _moved(line: _Line, offset: float) -> _Line:
    return line._replace(start=line.start + offset * np.array([-line.way[1], line.way[0]]))


def _line(axis: Any) -> _Line:
    """The line of a grid axis, in its sense.

    Raises:
        ValueError: it is no straight one.
    """
    points = _points(axis.AxisCurve)
    if points is None or not (length := np.linalg.norm(points[-1] - points[0])) > 0.0:
        raise ValueError(
            f"axis {axis.AxisTag or ''!r} of its IfcGridPlacement is not straight ({axis.AxisCurve.is_a()})"
        )
    way = (points[-1] - points[0]) / length
    if np.abs((points - points[0]) @ [-way[1], way[0]]).max() > _STRAIGHT * length:
        raise ValueError(
            f"axis {axis.AxisTag or ''!r} of its IfcGridPlacement is not straight ({axis.AxisCurve.is_a()})"
        )
    return _Line(points[0], -way if axis.SameSense is False else way)


def _points(curve: Any) -> np.ndarray | None:
    """Points (n >= 2, 2) along a curve that may be straight; None for one that is not."""
    if curve.is_a("IfcPolyline"):
        return np.array([point.Coordinates[:2] for point in curve.Points], float)
    if curve.is_a("IfcIndexedPolyCurve") and not any(one.is_a("IfcArcIndex") for one in curve.Segments or ()):
        return np.array(curve.Points.CoordList, float)[:, :2]
    if curve.is_a("IfcLine"):
        start = np.array(curve.Pnt.Coordinates[:2], float)
        return np.array([start, start + np.array(curve.Dir.Orientation.DirectionRatios[:2], float)])
    if curve.is_a("IfcTrimmedCurve"):
        points = _points(curve.BasisCurve)
        return points[::-1] if points is not None and curve.SenseAgreement is False else points
    return None


def _grid(intersection: Any) -> Any:
    """The grid of an intersection's axes.

    Raises:
        ValueError: they are of none.
    """
    axis = intersection.IntersectingAxes[0]
    for grids in (axis.PartOfU, axis.PartOfV, axis.PartOfW):
        for grid in grids or ():
            return grid
    raise ValueError("the axes of its IfcGridPlacement are of no grid")


def _placed(model: Any, placement: Any) -> list[Any]:
    """All products that stand where a placement says, or relative to that."""
    found, queue, known = [], [placement], set()
    while queue:
        one = queue.pop()
        if one.id() in known:
            continue
        known.add(one.id())
        for user in model.get_inverse(one):
            if user.is_a("IfcProduct"):
                found.append(user)
            elif getattr(user, "PlacementRelTo", None) == one:
                queue.append(user)
    return found
