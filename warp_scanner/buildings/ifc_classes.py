"""Which classes of IFC are kinds of which: from the schemas that ifcopenshell knows, of all versions together.

A name that one version lacks (IfcBuiltElement, IfcWallStandardCase) may stand in the file of another.
"""

import functools

from warp_scanner.buildings.ifc_model import import_ifcopenshell

_SCHEMAS = ("IFC2X3", "IFC4", "IFC4X3_ADD2")
_ROOT = "IfcProduct"  # what has a place in the building, and may have a shape


@functools.cache
def kinds_of(name: str) -> frozenset[str]:
    """Names of a class of products, in any case, and of all that are a kind of it; empty where no schema has it.

    Raises:
        ImportError: ifcopenshell is not installed.
    """
    library = import_ifcopenshell().ifcopenshell_wrapper
    found: set[str] = set()
    for schema in map(library.schema_by_name, _SCHEMAS):
        products = _below(schema.declaration_by_name(_ROOT))
        found |= next((kinds for own, kinds in products.items() if own.lower() == name.lower()), set())
    return frozenset(found)


def _below(entity) -> dict[str, set[str]]:
    """An entity and all below it by name, each with the names of its own kinds."""
    found, own = {}, {entity.name()}
    for lower in entity.subtypes():
        below = _below(lower)
        found |= below
        own |= below[lower.name()]
    return found | {entity.name(): own}
