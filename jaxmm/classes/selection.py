"""Which elements get a verdict: by our names of classes, by any class of IFC with all kinds of it, or all of them.

E elements.
"""

from collections.abc import Sequence

import numpy as np

from warp_scanner.buildings.ifc_classes import kinds_of
from warp_scanner.scenes.building import Elements
from warp_scanner.scenes.scenes import DOOR, FLOOR, PILLAR, WALL, WINDOW

ALL = "all"
# Our names of classes, and what the scanner calls them: meshes have these, too. Adding one: docs/how-to-add.md.
CLASSES = {"wall": WALL, "column": PILLAR, "door": DOOR, "window": WINDOW, "slab": FLOOR}
USUAL = ("wall", "column")  # that get a verdict where nobody says which


def check_classes(names: Sequence[str]) -> None:
    """Refuse names of no class.

    Raises:
        ValueError: one of them is none, or is of IFC, and the library that knows those is not installed.
    """
    unknown = [name for name in names if name not in (ALL, *CLASSES) and not _kinds(name)]
    if unknown:
        raise ValueError(
            f"classes must be {ALL}, some of {', '.join(CLASSES)}, or classes of IFC such as IfcBeam or IfcElement, "
            f"got {', '.join(sorted(unknown))}"
        )


def chosen(names: Sequence[str], elements: Elements) -> np.ndarray:
    """(E,) bool: elements of one of some classes, from `check_classes`."""
    if ALL in names:
        return np.ones(len(elements.guid), bool)
    found = np.isin(elements.semantic, [CLASSES[name] for name in names if name in CLASSES])
    of_ifc = {one for one in set(elements.ifc_class) if is_of(names, one)}
    return found | np.array([one in of_ifc for one in elements.ifc_class], bool)


def is_chosen(names: Sequence[str], ifc_class: str, semantic: int) -> bool:
    """Whether one element would be among those of `chosen`."""
    ours = [CLASSES[name] for name in names if name in CLASSES]
    return semantic in ours or is_of(names, ifc_class)


def is_of(names: Sequence[str], ifc_class: str) -> bool:
    """Whether a class of IFC is one of some, or a kind of one; all others are asked for by what the scanner calls."""
    return ALL in names or any(ifc_class in _kinds(name) for name in names if name not in CLASSES)


def _kinds(name: str) -> frozenset[str]:
    if not name.lower().startswith("ifc"):
        return frozenset()
    try:
        return kinds_of(name)
    except ImportError as error:
        raise ValueError(f"classes: {name} is of IFC, and {error}") from error
