"""Marks on elements of an IFC model: property sets of our own, and Status and uncertainty where the schema has them."""

from typing import Any, NamedTuple

from jaxmm.ifc.draft import Draft
from warp_scanner.buildings.ifc_model import identity_of

OWN_SET, DEVIATION_SET = "jaxmm_Verdict", "jaxmm_Deviation"  # the prefix Pset_ is the standard's
UNCERTAINTY_SET = "Pset_Uncertainty"  # from IFC4X3 on
COMMON_SETS = {"IfcWall": "Pset_WallCommon", "IfcColumn": "Pset_ColumnCommon"}  # hold Status, from IFC4 on
DEMOLISH, NEW = "DEMOLISH", "NEW"
_ENUMERATION = "PEnum_ElementStatus"
_STATUSES = ("NEW", "EXISTING", "DEMOLISH", "TEMPORARY", "OTHER", "NOTKNOWN", "UNSET")
_BASIS_ENUMERATION, MEASUREMENT = "PEnum_UncertaintyBasis", "MEASUREMENT"
_BASES = (
    "ASSESSMENT", "ESTIMATE", "INTERPRETATION", MEASUREMENT, "OBSERVATION", "NOTKNOWN", "USERDEFINED", "NOTDEFINED",
)  # fmt: skip


class Measure(NamedTuple):
    """A number of a kind, like IfcLengthMeasure, in the file's unit of that kind."""

    kind: str
    value: float


def mark(draft: Draft, element: Any, values: dict[str, Any], name: str = OWN_SET) -> None:
    """Give an element a property set of ours; one of an earlier update is replaced.

    Args:
        draft: the model.
        element: one of its products.
        values: by name of the property: text, a number, a Measure, a tuple of texts; None and () are left out.
        name: of the set.
    """
    properties = [_property(draft, name, value) for name, value in values.items() if value not in (None, ())]
    _set_properties(draft, element, name, properties, keep=False)


def set_uncertainty(draft: Draft, element: Any, width: Measure, words: str) -> bool:
    """Say in the standard's set how wide the interval of an element's place is, and how that is known.

    Returns:
        Whether the schema has such a set; otherwise nothing is changed.
    """
    if draft.model.schema != "IFC4X3":
        return False
    basis = _enumerated(draft, "UncertaintyBasis", MEASUREMENT, (_BASIS_ENUMERATION, _BASES))
    told = {"UncertaintyDescription": words, "LinearUncertainty": width}
    properties = [basis, *(_property(draft, name, value) for name, value in told.items())]
    _set_properties(draft, element, UNCERTAINTY_SET, properties, keep=True)
    return True


def set_status(draft: Draft, element: Any, status: str) -> bool:
    """Set Status in the element's common property set, whose other properties stay.

    Returns:
        Whether the schema has a Status for such elements; otherwise nothing is changed.
    """
    name = next((pset for kind, pset in COMMON_SETS.items() if element.is_a(kind)), None)
    if name is None or draft.model.schema == "IFC2X3":
        return False
    value = _enumerated(draft, "Status", status, (_ENUMERATION, _STATUSES))
    _set_properties(draft, element, name, [value], keep=True)
    return True


def _enumerated(draft: Draft, name: str, value: str, among: tuple[str, tuple[str, ...]]) -> Any:
    """A property whose value is one of an enumeration's, by its name and values."""
    return draft.create(
        "IfcPropertyEnumeratedValue",
        Name=name, EnumerationValues=[draft.create("IfcLabel", value)],
        EnumerationReference=_enumeration(draft, *among, value),
    )  # fmt: skip


def _set_properties(draft: Draft, element: Any, name: str, properties: list[Any], keep: bool) -> None:
    """Write properties into the element's set of that name; other elements with the same set keep what they have."""
    relation, old = next(_sets(element, name), (None, None))
    if old is None:
        _new_set(draft, element, name, properties)
        return
    new = {one.Name for one in properties}
    kept = [one for one in old.HasProperties if keep and one.Name not in new]
    if draft.model.get_total_inverses(old) > 1 or len(relation.RelatedObjects) > 1:
        others = [one for one in relation.RelatedObjects if one != element]
        if others:
            draft.put(relation, "RelatedObjects", others)
            _new_set(draft, element, name, kept + properties)
        else:
            draft.put(relation, "RelatingPropertyDefinition", _bare_set(draft, element, name, kept + properties))
        return
    replaced = [one for one in old.HasProperties if one not in kept]
    draft.put(old, "HasProperties", kept + properties)
    for one in replaced:
        if not draft.model.get_total_inverses(one):
            draft.remove(one)


def _sets(element: Any, name: str) -> Any:
    """Relation and property set of each set of that name."""
    for relation in element.IsDefinedBy:
        if relation.is_a("IfcRelDefinesByProperties"):
            found = relation.RelatingPropertyDefinition
            if found.is_a("IfcPropertySet") and found.Name == name:
                yield relation, found


def _new_set(draft: Draft, element: Any, name: str, properties: list[Any]) -> None:
    made = _bare_set(draft, element, name, properties)
    draft.root(
        "IfcRelDefinesByProperties", f"relation of {name} of {identity_of(element)}",
        RelatedObjects=[element], RelatingPropertyDefinition=made,
    )  # fmt: skip


def _bare_set(draft: Draft, element: Any, name: str, properties: list[Any]) -> Any:
    return draft.root("IfcPropertySet", f"{name} of {identity_of(element)}", Name=name, HasProperties=properties)


def _property(draft: Draft, name: str, value: Any) -> Any:
    if isinstance(value, Measure):
        number = draft.create(value.kind, value.value)
        return draft.create("IfcPropertySingleValue", Name=name, NominalValue=number)
    if isinstance(value, tuple):
        return draft.create(
            "IfcPropertyListValue", Name=name, ListValues=[draft.create("IfcText", one) for one in value]
        )
    kind = "IfcReal" if isinstance(value, float) else "IfcInteger" if isinstance(value, int) else "IfcText"
    return draft.create("IfcPropertySingleValue", Name=name, NominalValue=draft.create(kind, value))


def _enumeration(draft: Draft, name: str, words: tuple[str, ...], used: str) -> Any:
    """The file's own enumeration of that name, as names are unique, or a new one; None where it lacks the word."""
    for found in draft.model.by_type("IfcPropertyEnumeration"):
        if found.Name == name:
            return found if used in {one.wrappedValue for one in found.EnumerationValues} else None
    return draft.create("IfcPropertyEnumeration", name, [draft.create("IfcLabel", one) for one in words])
