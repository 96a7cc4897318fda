"""Classes that were asked for and of which a model has no element: a report on nothing reads as if all were well."""

from collections.abc import Sequence

from jaxmm.classes.selection import USUAL, chosen, is_chosen, is_of
from jaxmm.inputs import InputError, clipped
from warp_scanner.scenes.building import Building


def without_elements(names: Sequence[str], building: Building) -> list[str]:
    """Those of some names, from `check_classes`, of which no element has a shape; wholes and twins count."""
    table = building.elements
    twins = {(one.ifc_class, one.semantic) for same in table.twins for one in same}
    twins |= {(one.ifc_class, one.semantic) for whole in building.pieced for one in (whole.element, *whole.twins)}
    has = {*table.guid, *(one.guid for whole in building.pieced for one in (whole.element, *whole.twins))}
    wholes = {one.ifc_class for one in building.wholes if not has.isdisjoint(one.parts)}
    return [
        name
        for name in dict.fromkeys(names)
        if not chosen([name], table).any()
        and not any(is_chosen([name], *one) for one in twins)
        and not any(is_of([name], one) for one in wholes)
    ]


def check_asked(names: Sequence[str], building: Building) -> None:
    """Refuse to look for what is not there.

    Raises:
        InputError: a building has no element of any class that was asked for; the usual ones nobody has to ask for.
    """
    lacking = without_elements(names, building)
    if not lacking or len(lacking) < len(set(names)) or set(names) == set(USUAL):
        return
    has = sorted({one for one in building.elements.ifc_class if one})
    raise InputError(clipped(f"--classes: {_said(lacking)}{'; it has ' if has else ''}{', '.join(has)}"))


def lacking_notes(names: Sequence[str], building: Building) -> list[str]:
    """A note on the classes that were asked for and of which a building has no element; nothing where it has of all.

    Of the usual ones, which nobody has to ask for, only where there is none of any.
    """
    lacking = without_elements(names, building)
    if not lacking or (set(names) == set(USUAL) and len(lacking) < len(USUAL)):
        return []
    return [f"note: {_said(lacking)}: that nothing of it is missing says nothing"]


def _said(names: Sequence[str]) -> str:
    return f"the model has no element of the class{'es' if len(names) > 1 else ''} {', '.join(names)} with a shape"
