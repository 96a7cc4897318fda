"""Finds what the library for IFC cannot take: infinite numbers, circles as wide as a country, and some kinds of shapes.

The library asks nothing of numbers. A direction of `-inf`, which is none in STEP but which its parser takes, keeps it
computing without end; an `inf` without a sign is left out, so that a point of three numbers becomes one of two; and a
circle gets corners by its radius, some hundred thousand at 1,000 km, which takes minutes to triangulate. Cylinders and
cones of constructive geometry it leaves out, and where they were joined to something, or cut out of it, without a word.
Profiles that are derived from others it makes without what moves, mirrors or scales them.
"""

import mmap
import re
from pathlib import Path
from typing import Any

from warp_scanner.buildings.ifc_bodies import may_be_body
from warp_scanner.buildings.ifc_model import at_zero
from warp_scanner.buildings.ifc_schemas import Lost

_WIDEST = 1e5  # [m] radius that a curve may have
# What stands where a number should, and exponents beyond 99, whose powers soon are infinite; E+003, of three digits as
# some programs write them all, is none.
_NO_NUMBER = re.compile(
    rb"(?:(?<=[(,+-])(?:inf|nan)[a-z()]{0,7}|(?<=[\d.])e\+?0*[1-9]\d{2,})(?=\s*[,)])", re.IGNORECASE
)
_STATEMENT = re.compile(rb"\s*#\s*(\d{1,9})\s*=")
# Names that a version of the schema lacks match nothing.
_ROUND = {
    "IfcCircle": ("Radius",), "IfcEllipse": ("SemiAxis1", "SemiAxis2"), "IfcCircleProfileDef": ("Radius",),
    "IfcEllipseProfileDef": ("SemiAxis1", "SemiAxis2"), "IfcSweptDiskSolid": ("Radius",), "IfcSphere": ("Radius",),
    "IfcRightCircularCylinder": ("Radius",), "IfcRightCircularCone": ("BottomRadius",),
    "IfcCylindricalSurface": ("Radius",), "IfcSphericalSurface": ("Radius",),
    "IfcToroidalSurface": ("MajorRadius", "MinorRadius"),
}  # fmt: skip
_GEOMETRY = ("IfcRepresentationItem", "IfcProfileDef", "IfcObjectPlacement")
# What leads from a number to the products that are made with it.
_CARRIERS = (*_GEOMETRY, "IfcRepresentation", "IfcRepresentationMap", "IfcRepresentationContext",
             "IfcProductRepresentation")  # fmt: skip
# Of these only some attributes tell shape or place: an author or the north that a file lacks leave both as they are.
_PARTS = {
    "IfcProduct": ("ObjectPlacement", "Representation"),
    "IfcRepresentationContext": ("WorldCoordinateSystem", "ParentContext"),
}


def beyond_the_library(path: Path, model: Any, unit: float, lost: list[Lost]) -> dict[int, str]:
    """For each product whose shape or place holds such a thing, by STEP id, the reason.

    Cylinders are made extruded circles, in the model as it is in memory, so they cost nothing.

    Args:
        path: the STEP text.
        model: the same, parsed.
        unit: [m] of a length in it.
        lost: its references to nothing.
    """
    reasons: dict[int, str] = {}
    for cylinder in model.by_type("IfcRightCircularCylinder"):
        _extrude(model, cylinder)
    hazards = *_without_number(path, model), *_too_wide(model, unit), *_not_made(model), *_without_parts(model, lost)
    for item, why in hazards:
        for product in _made_with(model, item):
            reasons.setdefault(product.id(), why)
    return reasons


def mapped_from_elsewhere(model: Any) -> set[int]:
    """STEP ids of products that show a representation whose MappingOrigin moves or turns it.

    The standard can be read in two ways: it is a place for what is mapped, as the library takes it, or a point of it
    that comes to lie on the target, which is its inverse.
    """
    sources = [one for one in model.by_type("IfcRepresentationMap") if not at_zero(one.MappingOrigin)]
    return {product.id() for source in sources for product in _made_with(model, source)}


def _without_number(path: Path, model: Any) -> list[tuple[Any, str]]:
    found, begin, last = {}, 0, 0
    with open(path, "rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as text:
        for odd in _NO_NUMBER.finditer(text):
            begin, last = max(begin, text.rfind(b";", last, odd.start()) + 1), odd.start()
            statement = _STATEMENT.match(text, begin)
            item = _by_id(model, int(statement[1])) if statement else None
            # Names, of profiles too, may hold anything: within one, an odd number of quotes stands before.
            if (
                item is not None
                and item.id() not in found
                and any(map(item.is_a, _GEOMETRY))
                and text[begin:last].count(b"'") % 2 == 0
            ):
                why = "has a number that is infinite, none, or beyond 1e99"
                found[item.id()] = (item, f"#{item.id()}, {item.is_a()}, {why}")
    return list(found.values())


def _too_wide(model: Any, unit: float) -> list[tuple[Any, str]]:
    found = []
    for name, attributes in _ROUND.items():
        try:
            items = model.by_type(name)
        except RuntimeError:
            continue
        for item in items:
            sizes = (getattr(item, attribute) for attribute in attributes)
            # What is of another type fails with its element.
            widest = max((one for one in sizes if isinstance(one, float)), default=0.0) * unit
            if widest > _WIDEST:
                why = f"#{item.id()}, {item.is_a()}, has a radius of {widest:.3g} m, expected at most {_WIDEST:g} m"
                found.append((item, why))
    return found


def _not_made(model: Any) -> list[tuple[Any, str]]:
    moved = [one for one in model.by_type("IfcDerivedProfileDef") if not _as_it_is(one.Operator)]
    found = [*model.by_type("IfcRightCircularCone"), *moved]
    return [(one, f"#{one.id()}, {one.is_a()}, is of a kind that the library for IFC cannot make") for one in found]


def _without_parts(model: Any, lost: list[Lost]) -> list[tuple[Any, str]]:
    """Shapes and places that lack a part; without its place an element would stand at the origin."""
    found = []
    for one in lost:
        item = model.by_id(one.user)
        kind = next((kind for kind in (*_CARRIERS, "IfcProduct") if item.is_a(kind)), "")
        attribute = item.attribute_name(one.attribute)
        if kind and attribute in _PARTS.get(kind, (attribute,)):
            why = f"refers to #{one.number}, which is of an unknown class or not in the file"
            found.append((item, f"#{item.id()}, {item.is_a()}, {why}"))
    return found


def _as_it_is(operator: Any) -> bool:
    """Whether an IfcCartesianTransformationOperator2D moves, turns, mirrors and scales nothing."""
    if operator is None:  # of an IfcMirroredProfileDef, which says by its name what it does
        return False
    axes = ((operator.Axis1, (1.0, 0.0)), (operator.Axis2, (0.0, 1.0)), (operator.LocalOrigin, (0.0, 0.0)))
    scales = (operator.Scale, getattr(operator, "Scale2", None))  # the second only of those that are not uniform
    return all(one in (None, 1.0) for one in scales) and all(one is None or one[0] == still for one, still in axes)


def _extrude(model: Any, cylinder: Any) -> None:
    """A circle that is extruded as high takes the place of a cylinder wherever it is used."""
    if not all(isinstance(one, float) for one in (cylinder.Radius, cylinder.Height)):
        return
    new = model.create_entity
    middle = new("IfcAxis2Placement2D", new("IfcCartesianPoint", (0.0, 0.0)))
    circle = new("IfcCircleProfileDef", "AREA", None, middle, cylinder.Radius)
    solid = new(
        "IfcExtrudedAreaSolid", circle, cylinder.Position, new("IfcDirection", (0.0, 0.0, 1.0)), cylinder.Height
    )
    _put_in_place(model, cylinder, solid)


def _put_in_place(model: Any, old: Any, new: Any) -> None:
    """One item for another wherever it is used; a tree of constructive geometry that is it alone goes with it."""
    for user in model.get_inverse(old):
        if user.is_a("IfcCsgSolid"):
            _put_in_place(model, user, new)
            continue
        for place in range(len(user)):
            if user[place] == old:
                user[place] = new
            elif isinstance(user[place], tuple) and old in user[place]:
                user[place] = [new if one == old else one for one in user[place]]


def _by_id(model: Any, number: int) -> Any:
    try:
        return model.by_id(number)
    except RuntimeError:
        return None


def _made_with(model: Any, item: Any) -> list[Any]:
    """The products whose shape or place an item is part of, or that it is; what such a one cuts or adds to is, too."""
    products, seen, left = [item] if item.is_a("IfcProduct") else [], {item.id()}, [item]
    while left:
        part = left.pop()
        if part.is_a("IfcShapeRepresentation") and not may_be_body(part):  # its axis, its footprint
            continue
        for user in model.get_inverse(part):
            if user.id() in seen:
                continue
            if user.is_a("IfcProduct"):
                products.append(user)
            elif user.is_a("IfcRelVoidsElement"):
                products += filter(None, [user.RelatingBuildingElement])
                continue
            elif user.is_a("IfcRelProjectsElement"):
                products += filter(None, [user.RelatingElement])
                continue
            elif not any(map(user.is_a, _CARRIERS)):
                continue
            seen.add(user.id())
            left.append(user)
    return products
