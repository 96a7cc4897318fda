"""`updated.ifc`: the building model with what a detection found written into it.

Removed elements are marked and painted, or deleted when asked; occluded and displaced ones are marked; added objects
become painted walls and columns. Every element whose place was measured is told how far off it is. All others are not
touched, and the file that was read is never written to.
"""

import math
from datetime import datetime
from pathlib import Path
from typing import Any, NamedTuple

from jaxmm.ifc.colours import ADDED as PAINT_ADDED
from jaxmm.ifc.colours import REMOVED as PAINT_REMOVED
from jaxmm.ifc.colours import Painter
from jaxmm.ifc.deviations import told_of, units_of
from jaxmm.ifc.draft import Draft, open_draft
from jaxmm.ifc.marks import DEMOLISH, DEVIATION_SET, NEW, mark, set_status, set_uncertainty
from jaxmm.ifc.new_elements import add_object, contain, flaw_of, ground_of
from jaxmm.ifc.removal import delete, hanging_on
from jaxmm.ifc.shares import Share
from jaxmm.ifc.text_edits import Edit
from jaxmm.ifc.undo import UPDATED, write_with_undo
from jaxmm.inputs import InputError
from jaxmm.learning.boxes import sentence
from jaxmm.verdicts.results import Detection, ElementVerdict, Mismatch, box_of, told_probability
from jaxmm.verdicts.verdicts import DISPLACED, OCCLUDED, REMOVED, STANDS
from warp_scanner.buildings.ifc_model import identity_of

NOT_APPLIED = "--apply: removed elements are marked, not deleted: it is open whether every scan is of this place"


class UpdateSummary(NamedTuple):
    """What was written; GlobalIds."""

    path: Path  # the updated file
    removed: tuple[str, ...]  # elements of removed mismatches: marked, or deleted; the notes name what was not
    occluded: tuple[str, ...]  # elements marked as occluded
    added: tuple[str, ...]  # new elements, in the order of the mismatches
    of_mismatch: dict[int, str]  # the same by their place among the mismatches
    notes: tuple[str, ...]  # what could not be done, or must be known, a sentence each


def write_update(
    prior: Path, detection: Detection | Share, out: Path, *, apply: bool = False, when: datetime | None = None
) -> UpdateSummary:
    """Write `updated.ifc` and `undo.json` to the folder `out`, both whole or neither.

    Args:
        prior: the IFC file that the detection was run on.
        detection: what was found.
        out: the folder; made where it is missing.
        apply: delete removed elements instead of marking them, unless a part of them may stand, or a scan may be of
            another place or pose. Doors, windows and coverings that hung on them stay, are marked, and named in the
            notes.
        when: the date that is written, UTC where it names no zone; None for that of the detection, or else now. With
            a date, the same input gives the same bytes.

    Raises:
        InputError: `prior` cannot be read or edited, or is the very file that would be written.
        ImportError: ifcopenshell is not installed.
        OSError: a file cannot be written.
    """
    if (out / UPDATED).resolve() == prior.resolve():
        raise InputError(f"{out}: expected another folder than that of {prior}, which must stay as it is")
    edited, summary = edited_model(prior, detection, apply=apply, when=when)
    write_with_undo(out, *edited)
    return UpdateSummary(out / UPDATED, *summary)


def edited_model(
    prior: Path, detection: Detection | Share, *, apply: bool = False, when: datetime | None = None
) -> tuple[tuple[bytes, bytes, list[Edit]], tuple]:
    """What `write_update` writes: the text of the file, the same edited, and the edits; and the rest of its summary."""
    original, draft = open_draft(prior, when, detection.date)
    update = _Update(draft, detection)
    if apply and detection.doubts:
        apply = False
        update.notes.append(NOT_APPLIED)
    update.mark_removed(apply)
    update.mark_occluded()
    update.mark_measured()
    update.add()
    if apply:
        update.delete_removed()
    told = (update.removed, update.occluded, update.added.values())
    return (original, *draft.text(original, prior)), (*map(tuple, told), update.added, tuple(update.notes))


class _Update:
    """One detection on its way into one model."""

    def __init__(self, draft: Draft, detection: Detection | Share):
        self.draft, self.detection = draft, detection
        self.removed: dict[str, Any] = {}
        self.kept: set[str] = set()  # of those, what is never deleted
        self.occluded: dict[str, Any] = {}
        self.added: dict[int, str] = {}  # GlobalIds by place among the mismatches
        self.notes: list[str] = []
        self._doubts, self._painter = detection.doubts, Painter(draft)
        self._verdicts = {one.guid: one for one in detection.elements}
        # Not by the library's index: that finds no GlobalId that is malformed.
        self._entities: dict[str, list[Any]] = {}
        for one in draft.model.by_type("IfcRoot"):
            self._entities.setdefault(identity_of(one), []).append(one)

    def mark_removed(self, apply: bool) -> None:
        """Our set on every element that a mismatch or a verdict calls removed; Status for those of a mismatch.

        Nothing is marked that is going to be deleted; what stands in part is marked and never deleted.
        """
        for number, one in enumerate(self.detection.mismatches, 1):
            if one.mismatch_type != "removed":
                continue
            for guid in (one.element, *(guid for _, guid in one.pieces)):
                element = self._find(guid, f"mismatch {number}, a removed {one.object_type},")
                if element is None or guid in self.removed:
                    continue
                self.removed[guid] = element
                if apply and one.standing >= STANDS:
                    self.kept.add(guid)
                    what = f"{_named(element)} was marked, not deleted"
                    self.notes.append(f"{what}: {one.standing:.0%} of its rays end on it, a part may stand")
                if guid in self.kept or not apply:
                    self._mark(element, REMOVED, one.probability, ObservableFraction=_known(one.observable_fraction))
                    set_status(self.draft, element, DEMOLISH)
                    self._paint(element, PAINT_REMOVED)
        for one in self.detection.elements:
            if one.verdict == REMOVED and one.guid not in self.removed:
                self._mark_verdict(one)

    def mark_occluded(self) -> None:
        """Our set on every occluded element."""
        for one in self.detection.elements:
            if one.verdict == OCCLUDED and one.guid not in self.removed and self._mark_verdict(one):
                self.occluded[one.guid] = one

    def mark_measured(self) -> None:
        """How far off its place every element stands that was measured; displaced ones get our verdict, too."""
        units, words = units_of(self.draft.model), f"95 % interval of its place, measured by {self.draft.software}"
        for one in self.detection.elements:
            if one.deviation is None or one.guid in self.removed:
                continue
            element = self._find(one.guid, "an element that was measured")
            if element is None:
                continue
            if one.verdict == DISPLACED:
                self._mark(element, one.verdict, one.probability)
            files = tuple(self.detection.scans[scan].file for scan in one.deviation.scans)
            values = told_of(one.deviation, units) | {"Scans": files} | self._source()
            mark(self.draft, element, values, DEVIATION_SET)
            width = units.of_length(2.0 * one.deviation.half)
            if width is not None and width.value > 0.0:
                set_uncertainty(self.draft, element, width, words)

    def add(self) -> None:
        """A wall or column for every added mismatch, on its storey."""
        ground, contents = ground_of(self.draft.model), {}
        for number, one in enumerate(self.detection.mismatches, 1):
            if one.mismatch_type != "added":
                continue
            what = f"mismatch {number}, an added {one.object_type},"
            if flaw := flaw_of(one, ground):
                self.notes.append(f"{what} was not written: {flaw}")
                continue
            name = f"added {one.object_type} {number}"
            element, storey = add_object(self.draft, ground, one, name, sentence(box_of(one), one.mismatch_type))
            self._mark(
                element, "added", one.probability,
                TypeProbability=_known(one.type_probability), ObservableFraction=_known(one.observable_fraction),
                MovedFrom=self._origin(one),
            )  # fmt: skip
            set_status(self.draft, element, NEW)
            self._paint(element, PAINT_ADDED)
            self.added[number - 1] = element.GlobalId
            if storey is None:
                self.notes.append(f"{what} is on no storey: the file has none, no building and no site")
            else:
                contents.setdefault(storey.id(), (storey, []))[1].append(element)
        for storey, elements in contents.values():
            contain(self.draft, storey, elements)

    def delete_removed(self) -> None:
        """Delete the elements of removed mismatches; what hangs on them is marked and stays."""
        going = [element for guid, element in self.removed.items() if guid not in self.kept]
        for element in hanging_on(going):
            guid = identity_of(element)
            what = f"{_named(element)} hung on a deleted element; it was kept"
            if len(self._entities[guid]) == 1:
                verdict = self._verdicts.get(guid)
                known = (verdict.verdict, verdict.probability) if verdict else (None, math.nan)
                self._mark(element, *known, Note="its host was removed")
                what += " and marked"
            self.notes.append(what)
        delete(self.draft, going)

    def _paint(self, element: Any, name: str) -> None:
        if not self._painter.paint(element, name):
            self.notes.append(f"{_named(element)} keeps its colour: its shape is that of other elements, too")

    def _mark_verdict(self, one: ElementVerdict) -> bool:
        element = self._find(one.guid, f"an element called {one.verdict}")
        if element is not None:
            self._mark(element, one.verdict, one.probability)
        return element is not None

    def _mark(self, element: Any, verdict: str | None, probability: float, **more: Any) -> None:
        values = {
            "Verdict": verdict,
            "Probability": _known(told_probability(probability)),
            **more,
            "Scans": tuple(one.file for one in self.detection.scans),
        }
        mark(self.draft, element, values | self._source())

    def _source(self) -> dict[str, Any]:
        """What every mark says of where it comes from."""
        date = self.draft.when.isoformat(timespec="seconds")
        return {"Doubts": self._doubts, "Date": date, "Software": self.draft.software}

    def _find(self, guid: str | None, what: str) -> Any:
        """The one product of that GlobalId; None, with a note, where there is not exactly one."""
        if guid is None:
            self.notes.append(f"{what} is no element of the file: nothing was changed for it")
        elif len(found := self._entities.get(guid, [])) != 1:
            count = f"{len(found)} entities" if found else "none"
            self.notes.append(f"{what} has the GlobalId {guid}, of which the file has {count}: nothing was changed")
        elif not found[0].is_a("IfcProduct"):
            self.notes.append(f"{what} has the GlobalId of an {found[0].is_a()}, {guid}: nothing was changed for it")
        else:
            return found[0]
        return None

    def _origin(self, one: Mismatch) -> str | None:
        """GlobalId of the element that an added one seems to have been."""
        return None if one.moved_from is None else self.detection.mismatches[one.moved_from].element


def _named(element: Any) -> str:
    return f"{element.is_a()} {identity_of(element)} ({element.Name or 'without a name'})"


def _known(value: float | None) -> float | None:
    """To a millionth; None for NaN."""
    return None if value is None or value != value else round(float(value), 6)
