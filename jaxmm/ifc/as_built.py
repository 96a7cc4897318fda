"""`as_built.ifc`: the building model with displaced elements where they were measured.

Only placements are edited. Openings and parts of an element go with it, and so does what hangs on it (doors, windows,
coverings), unless that was measured itself. Lengths in the file's unit; 4x4 matrices are rotation and shift.
"""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from jaxmm.ifc.draft import Draft, open_draft
from jaxmm.ifc.placements import new_axes
from jaxmm.ifc.removal import belongings, hanging_on
from jaxmm.ifc.shares import Share
from jaxmm.ifc.text_edits import Edit
from jaxmm.ifc.undo import AS_BUILT, AS_BUILT_UNDO, write_with_undo
from jaxmm.verdicts.results import Detection, Drawing, ElementVerdict
from jaxmm.verdicts.verdicts import DISPLACED
from warp_scanner.buildings.ifc_model import own_matrix, world_matrix

NOT_WRITTEN = f"--as-built: {AS_BUILT} is not written: it is open whether every scan is of this place"
STILL = np.eye(4)
SAME = 1e-9  # by which entries of matrices may differ that are called equal


def write_as_built(prior: Path, detection: Detection | Share, out: Path) -> tuple[str, ...]:
    """Write AS_BUILT and its undo to the folder `out`, both whole or neither; nothing while a scan is in doubt.

    Args:
        prior: the IFC file that the detection was run on.
        detection: what was found.
        out: the folder.

    Returns:
        What could not be moved, or must be known, a sentence each.

    Raises:
        InputError: `prior` cannot be read or edited.
        ImportError: ifcopenshell is not installed.
        OSError: a file cannot be written.
    """
    if detection.doubts:
        return (NOT_WRITTEN,)
    edited, notes = model_as_built(prior, detection)
    write_with_undo(out, *edited, AS_BUILT, AS_BUILT_UNDO)
    return notes


def model_as_built(
    prior: Path, detection: Detection | Share, to_world: np.ndarray = STILL
) -> tuple[tuple[bytes, bytes, list[Edit]], tuple[str, ...]]:
    """What `write_as_built` writes: the text of the file, the same edited, and the edits; and what it returns.

    `to_world` leads from the file's own frame, in metres, to that of the detection.
    """
    from ifcopenshell.util.unit import calculate_unit_scale

    original, draft = open_draft(prior, None, detection.date)
    unit = float(calculate_unit_scale(draft.model))
    moves, notes = _Moves(draft), []
    products: dict[str, list[Any]] = {}
    for entity in draft.model.by_type("IfcProduct"):
        products.setdefault(entity.GlobalId, []).append(entity)
    for one in detection.elements:
        if one.deviation is None:
            continue
        found = products.get(one.guid, [])
        motion = motion_of(detection.drawing, one, unit, to_world) if one.verdict == DISPLACED else STILL
        if len(found) == 1 and motion is not None:
            moves.measured(found[0], motion)
        elif one.verdict == DISPLACED:
            why = "it has no shape" if len(found) == 1 else f"the file has it {len(found)} times"
            notes.append(f"{AS_BUILT}: {one.ifc_class} {one.guid} stays: {why}")
    notes += moves.write()
    return (original, *draft.text(original, prior)), tuple(notes)


def motion_of(drawing: Drawing, one: ElementVerdict, unit: float, to_world: np.ndarray = STILL) -> np.ndarray | None:
    """(4, 4) from where the model has an element to where it stands, file's own frame; None where it has no shape.

    `unit` is the length [m] of the file's unit; `to_world` leads from that frame, in metres, to the drawing's.
    """
    corners = drawing.corners(one.key)
    if corners is None:
        return None
    middle = (corners.min(axis=0) + corners.max(axis=0)) / 2.0 + drawing.origin
    turn = Rotation.from_rotvec(one.deviation.turned).as_matrix()
    motion = np.eye(4)
    motion[:3, :3] = turn
    motion[:3, 3] = middle + one.deviation.offset - turn @ middle
    if to_world is not STILL:
        motion = np.linalg.solve(to_world, motion @ to_world)
    motion[:3, 3] /= unit
    return motion


class _Moves:
    """Which products move, and the placements that bring them there."""

    def __init__(self, draft: Draft):
        self.draft = draft
        self._own: dict[int, tuple[Any, np.ndarray]] = {}  # of elements that were measured, by number
        self._now: dict[int, np.ndarray] = {}  # world matrix of a placement after the edits, by number

    def measured(self, element: Any, motion: np.ndarray) -> None:
        """An element that was measured, and how far off it is."""
        self._own[element.id()] = element, motion

    def write(self) -> list[str]:
        """Edit the placements; returns what stays though it should move."""
        motions, notes = self._motions(), []
        queue = []
        for number, motion in motions.items():
            product = self.draft.model.by_id(number)
            place = product.ObjectPlacement
            if motion is STILL:
                continue
            if place is None or place.is_a("IfcLocalPlacement"):
                queue.append(product)
            else:
                what = f"{product.is_a()} {product.GlobalId}"
                notes.append(f"{AS_BUILT}: {what} stays: it is placed by an {place.is_a()}")
        before = {one.id(): world_matrix(one) for one in self._affected(queue)}
        for product in queue:
            if product.ObjectPlacement is None:
                axes = new_axes(self.draft, motions[product.id()])
                self.draft.put(product, "ObjectPlacement", self.draft.create("IfcLocalPlacement", None, axes))
        for number in sorted(before, key=lambda number: _depth(self.draft.model.by_id(number))):
            self._place(self.draft.model.by_id(number), before, motions)
        return notes

    def _motions(self) -> dict[int, np.ndarray]:
        """By number of a product: those that were measured, then what goes with displaced ones."""
        motions = {number: motion for number, (_, motion) in self._own.items()}
        for element, motion in self._own.values():
            if motion is STILL:
                continue
            group, seen = [element], {element.id()}
            while group:
                for one in [*belongings([group.pop()]), *hanging_on([element])]:
                    if one.id() not in seen and one.id() not in self._own and one.is_a("IfcProduct"):
                        seen.add(one.id())
                        motions.setdefault(one.id(), motion)
                        group.append(one)
        return motions

    def _affected(self, products: Iterable[Any]) -> list[Any]:
        """The placements of products, and all that are relative to them."""
        found = {one.ObjectPlacement.id(): one.ObjectPlacement for one in products if one.ObjectPlacement}
        queue = list(found.values())
        while queue:
            for other in self.draft.model.get_inverse(queue.pop()):
                if other.is_a("IfcLocalPlacement") and other.id() not in found:
                    found[other.id()] = other
                    queue.append(other)
        return list(found.values())

    def _place(self, place: Any, before: dict[int, np.ndarray], motions: dict[int, np.ndarray]) -> None:
        """Move a placement as its products move; those that move otherwise get one of their own."""
        above = place.PlacementRelTo
        parent = self._now.get(above.id(), None) if above else STILL
        parent = world_matrix(above) if parent is None else parent
        products = [one for one in self.draft.model.get_inverse(place) if one.is_a("IfcProduct")]
        products.sort(key=lambda one: one.id())
        wanted = [motions.get(one.id(), STILL) for one in products]
        # What places no product goes with what it is relative to.
        motion = wanted[0] if wanted else parent @ np.linalg.inv(world_matrix_before(above, before))
        for product, other in zip(products[1:], wanted[1:], strict=True):
            if not np.allclose(other, motion, rtol=0.0, atol=SAME):
                own = np.linalg.solve(parent, other @ before[place.id()])
                self.draft.put(
                    product, "ObjectPlacement", self.draft.create("IfcLocalPlacement", above, new_axes(self.draft, own))
                )
        now = motion @ before[place.id()]
        self._now[place.id()] = now
        own = np.linalg.solve(parent, now)
        if not np.allclose(own, own_matrix(place), rtol=0.0, atol=SAME):
            old = place.RelativePlacement
            self.draft.put(place, "RelativePlacement", new_axes(self.draft, own))
            self._drop(old)

    def _drop(self, old: Any) -> None:
        """Remove axes that nothing uses any more, with their point and directions."""
        parts = [one for one in (old.Location, getattr(old, "Axis", None), old.RefDirection) if one is not None]
        for one in (old, *parts):
            if self.draft.has(one.id()) and not self.draft.model.get_total_inverses(one):
                self.draft.remove(one)


def world_matrix_before(place: Any, before: dict[int, np.ndarray]) -> np.ndarray:
    """(4, 4) of a placement, or of none, before any edit."""
    if place is None:
        return STILL
    known = before.get(place.id())
    return world_matrix(place) if known is None else known


def _depth(place: Any) -> int:
    depth = 0
    while place.is_a("IfcLocalPlacement") and place.PlacementRelTo is not None:
        place, depth = place.PlacementRelTo, depth + 1
    return depth
