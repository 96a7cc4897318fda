"""Deletes elements from an IFC model with all that is theirs, and leaves no reference to what is gone.

Theirs are their parts, their openings, and shapes, placements and property sets that nothing else uses. What merely
hangs on them (doors and windows in their openings, coverings) stays where it is. So do types, materials and styles:
definitions may wait for their next use.
"""

from typing import Any

from jaxmm.ifc.draft import Draft
from jaxmm.ifc.placements import new_axes
from warp_scanner.buildings.ifc_model import own_matrix

_FEATURES = (
    ("IfcRelVoidsElement", "RelatingBuildingElement", "RelatedOpeningElement"),
    ("IfcRelProjectsElement", "RelatingElement", "RelatedFeatureElement"),
    ("IfcRelAdheresToElement", "RelatingElement", "RelatedSurfaceFeatures"),
    ("IfcRelAggregates", "RelatingObject", "RelatedObjects"),
)  # relation, whole, what belongs to it
_HANGING = (
    ("IfcRelFillsElement", "RelatingOpeningElement", "RelatedBuildingElement"),
    ("IfcRelCoversBldgElements", "RelatingBuildingElement", "RelatedCoverings"),
    ("IfcRelNests", "RelatingObject", "RelatedObjects"),
)
# What goes when its last user goes; anything else is a definition of its own. Unknown names match nothing.
_USED = (
    "IfcRepresentation", "IfcRepresentationItem", "IfcRepresentationMap", "IfcProductRepresentation", "IfcProfileDef",
    "IfcObjectPlacement", "IfcConnectionGeometry", "IfcPropertySetDefinition", "IfcProperty", "IfcPhysicalQuantity",
    "IfcMaterialLayerSetUsage", "IfcPresentationStyleAssignment", "IfcMaterialProfileSetUsage",
)  # fmt: skip
# What speaks of a shape without using it: it goes along.
_REMARKS = ("IfcStyledItem", "IfcShapeAspect", "IfcPresentationLayerAssignment", "IfcIndexedColourMap",
            "IfcTextureCoordinate")  # fmt: skip


def belongings(elements: list[Any]) -> list[Any]:
    """The elements and all that goes with them: parts, openings, features; sorted by number."""
    return _closure(elements, _FEATURES)


def hanging_on(elements: list[Any]) -> list[Any]:
    """What would lose its host with these elements and their belongings, but stays; sorted by number."""
    going = belongings(elements)
    hanging = {one.id(): one for whole in going for one in _related(whole, _HANGING)}
    return [one for number, one in sorted(hanging.items()) if one not in going]


def delete(draft: Draft, elements: list[Any]) -> None:
    """Delete elements with their belongings."""
    orphans: list[int] = []
    going = belongings(elements)
    _place_anew(draft, going, orphans)
    for one in going:
        _delete(draft, one, orphans)
    while orphans:
        number = orphans.pop()
        if draft.has(number):
            one = draft.model.by_id(number)
            if all(any(map(referrer.is_a, _REMARKS)) for referrer in _referrers(draft, one)):
                _delete(draft, one, orphans)


def _place_anew(draft: Draft, going: list[Any], orphans: list[int]) -> None:
    """Place what stays, but stands relative to something that goes, at the same spot relative to what stays."""
    numbers = {one.id() for one in going}
    places = {one.ObjectPlacement.id(): one.ObjectPlacement for one in going if one.ObjectPlacement}
    places = {
        number: place
        for number, place in places.items()
        if place.is_a("IfcLocalPlacement") and all(one.id() in numbers for one in place.PlacesObject)
    }
    for _, place in sorted(places.items()):
        for other in _referrers(draft, place):
            if other.is_a("IfcLocalPlacement") and other.id() not in places:
                matrix, within = own_matrix(other), other.PlacementRelTo
                while within and within.id() in places:
                    matrix, within = own_matrix(within) @ matrix, within.PlacementRelTo
                orphans.append(other.RelativePlacement.id())
                draft.put(other, "PlacementRelTo", within)
                draft.put(other, "RelativePlacement", new_axes(draft, matrix))


def _closure(elements: list[Any], table: tuple) -> list[Any]:
    found = {one.id(): one for one in elements}
    queue = list(elements)
    while queue:
        for one in _related(queue.pop(), table):
            if one.id() not in found:
                found[one.id()] = one
                queue.append(one)
    return [one for _, one in sorted(found.items())]


def _related(whole: Any, table: tuple) -> list[Any]:
    """What the table's relations lead to from a whole."""
    model, found = whole.file, []
    for relation in model.get_inverse(whole):
        for kind, relating, related in table:
            if relation.is_a(kind) and getattr(relation, relating) == whole:
                value = getattr(relation, related)
                found += value if isinstance(value, tuple) else [value]
    return found


def _referrers(draft: Draft, one: Any) -> list[Any]:
    return sorted(draft.model.get_inverse(one), key=lambda entity: entity.id())


def _delete(draft: Draft, one: Any, orphans: list[int]) -> None:
    """Delete one entity, and what makes no sense without it; adds to `orphans` what may have lost its last user."""
    for referrer in _referrers(draft, one):
        if not _lets_go(draft, referrer, one):
            _delete(draft, referrer, orphans)
    children = [child for child in draft.model.traverse(one, 1) if child.id() and child != one]
    orphans += [child.id() for child in children if any(map(child.is_a, _USED))]
    draft.remove(one)


def _lets_go(draft: Draft, referrer: Any, one: Any) -> bool:
    """End every reference of an entity to another; False where it makes no sense without that one."""
    for place, value in enumerate(referrer):
        if isinstance(value, tuple) and one in value:
            rest = [other for other in value if other != one]
            if not rest:
                return False
            draft.put(referrer, place, rest)
        elif value == one:
            # A relation is about its ends; that it names another relation is a remark.
            if one.is_a("IfcRelationship") and referrer.is_a("IfcRelationship"):
                draft.put(referrer, place, None)
            else:
                return False
    return True
