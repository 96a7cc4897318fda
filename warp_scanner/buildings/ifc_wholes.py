"""Parts and wholes in IFC: what a product is a part of, whose shape its own is, and what is put together from what."""

import itertools
from collections.abc import Iterable
from typing import Any

# Own what they are put together from; a slab what is of none of the others.
_WHOLES = (("IfcWall", "IfcColumn", "IfcDoor", "IfcWindow"), ("IfcSlab",))
_LAYER = "IfcBuildingElementPart"  # is of whatever it is a part of


def put_together(owners: Iterable[Any]) -> list[tuple[Any, list[int]]]:
    """Each whole (a stair, a roof, an assembly) that elements with a shape are parts of, with the STEP ids of those.

    Of a whole that is a part of another, the parts are those of both.
    """
    found: dict[Any, list[int]] = {}
    for owner in owners:
        for whole in wholes_of(owner):
            found.setdefault(whole, []).append(owner.id())
    return list(found.items())


def wholes_of(product: Any) -> list[Any]:
    """All that the product is a part of, or is added to as a feature, from the nearest up."""
    wholes, whole = [], _whole_of(product)
    while whole is not None and whole.is_a("IfcElement") and whole not in wholes:
        wholes.append(whole)
        whole = _whole_of(whole)
    return wholes


def _whole_of(product: Any) -> Any:
    from ifcopenshell.util.element import get_aggregate

    if product.is_a("IfcFeatureElementAddition"):
        for relation in product.ProjectsElements or ():
            return relation.RelatingElement
    return get_aggregate(product)


def owner_of(product: Any) -> Any:
    """The element that the product's shape belongs to: the outermost wall, column, door or window; slab; or itself.

    What is added to an element, and a layer, belongs to what has it, whatever that is.
    """
    line = [product, *wholes_of(product)]
    own = itertools.dropwhile(lambda one: one.is_a("IfcFeatureElementAddition") or one.is_a(_LAYER), line)
    nearest = next(own, product)
    for kinds in _WHOLES:
        owners = [whole for whole in line if any(map(whole.is_a, kinds))]
        if owners:
            return owners[-1]
    return nearest
