"""What a detection says, as typed objects and as the content of report.json.

World frame of the prior: metres, z up. N points of all robot scans, M points of all scans of the prior, E elements of
the prior, V vertices, T triangles.
"""

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from typing import Any, NamedTuple, TypeVar

import numpy as np

from jaxmm.classes.unexplained import Unexplained
from jaxmm.deviations.deviation import Deviation
from jaxmm.formats.dates import Taken
from jaxmm.learning.boxes import Box, sentence
from jaxmm.learning.element_boxes import UprightBox
from jaxmm.verdicts.verdicts import DISPLACED, OCCLUDED, PRESENT, REMOVED, STANDS, VERDICTS
from warp_scanner.scenes.building import Building, Source

Key = tuple[str, str]  # file and GlobalId
Element = TypeVar("Element")  # what has `key`, `same_as`, `file` and `parts`
Pose = tuple[float, float, float, float, float]  # x, y, z [m] world, yaw, pitch [deg]
FORMAT = 2  # of report.json: counts up when a reader of the one before would go wrong; the first stated none
MOST_NAMED = 5  # in notes on elements
# Of a present element of which a part may be gone: share of the rays that tell of it, that pass, and how many at least.
# In 1,001 verdicts of unchanged rooms and buildings, scanned as built, 8 elements have more.
GONE, LEAST_THROUGH = 0.2, 100
SEE_THROUGH, LEAST_PASSED = ("IfcDoor", "IfcWindow", "IfcPlate", "IfcCurtainWall"), 20  # rays
PLURAL = {"wall": "walls", "pillar": "pillars"}


class PriorFile(NamedTuple):
    """The file that the scans were compared with."""

    file: str  # name, without folders
    kind: str  # "ifc" | "mesh" | "cloud"; of a model of several files "ifc" where one of them is
    unit: float  # [m] length of its unit: an IFC file says it, for any other --prior-unit does, or how the scans fit
    project: str | None = None  # GlobalId of the IfcProject; None for all but IFC files
    sha256: str | None = None  # of its bytes, in hexadecimal: the same model, or another state of it
    sources: tuple[Source, ...] = ()  # its files, where it is a model of several


class Mismatch(NamedTuple):
    """One changed object."""

    object_type: str  # "pillar" | "wall"
    mismatch_type: str  # "added" | "removed"
    center: np.ndarray  # (3,) float64 [m] of the upright box
    dimensions: np.ndarray  # (3,) float64 [m] full edges along the box's own axes
    rotation: float  # yaw [deg] from world x to the box's first axis
    probability: float  # that it is real
    element: str | None = None  # GlobalId or node of the prior's element, of a removed one
    moved_from: int | None = None  # of an added object: index of the removed one that it seems to be
    observable_fraction: float | None = None  # of what would be seen of it if it stood alone; None where unknown
    shape: str = "rectangular"  # "rectangular" | "round": the footprint
    measured: tuple[bool, bool, bool] = (True, True, True)  # of the dimensions: seen, or the model's, not assumed
    type_probability: float | None = None  # that it is of its type, if it is real; None where nobody asked
    told_by: tuple[int, ...] = ()  # of each scan: rays that show that it is new, or gone; not in report.json
    standing: float = 0.0  # share of the rays that tell of a removed element, that end on it; not in report.json
    shaft: np.ndarray | None = None  # (2,) [m] edges of a removed column halfway up; not in report.json
    file: str | None = None  # that the prior's element is of
    pieces: tuple[Key, ...] = ()  # of a removed one that other files have in pieces: those removed; not in report.json

    @property
    def key(self) -> Key:
        """What tells its element from all others."""
        return self.file or "", self.element or ""


class ElementVerdict(NamedTuple):
    """What the scans say of one element of the prior."""

    guid: str
    ifc_class: str  # empty for meshes
    name: str
    storey: str  # name; empty where the file has none
    verdict: str  # one of verdicts.VERDICTS
    probability: float  # P(removed); the prior's own where nothing was seen
    points: int  # of the prior's scans on it
    rays: tuple[int, int, int, int]  # of the robot in the footprints of those, in the order of evidence.FRACTIONS
    next_view: Pose | None = None  # of an occluded element: the nearest free place that would show it
    deviation: Deviation | None = None  # how far off its place it stands; None where no face of it tells
    box: UprightBox | None = None  # around it, where the model has it; None where nobody asked
    file: str = ""  # that it is of; empty where the prior came as arrays
    same_as: tuple[Key, ...] = ()  # the same in other files: one verdict for all
    parts: tuple[Key, ...] = ()  # that it is put together from, or that another file has it in
    parts_gone: tuple[Key, ...] = ()  # of these, those that are removed
    part_of: tuple[Key, ...] = ()  # what it is a part of, of what is asked for

    @property
    def key(self) -> Key:
        """What tells it from all others: files may share GlobalIds."""
        return self.file, self.guid


class ScanRecord(NamedTuple):
    """One robot scan, and what it added."""

    file: str
    points: int  # in the file
    pose: Pose  # as used, after registration
    pose_source: str  # "given", "file", "estimated" or "searched"
    deviation: Pose | None  # standard deviations of an estimated pose
    registration: dict[str, float]  # shift [m], turn [deg], residual [m], overlap, overlap_before
    told: dict[str, int]  # by verdict: elements whose verdict this scan changed, in the order of the scans
    notes: tuple[str, ...] = ()
    shows: int = 0  # mismatches that some of its rays tell of
    alone: int = 0  # of those: all other scans together have too few rays to tell of so many
    doubts: tuple[str, ...] = ()  # those of its notes that say that it may be of another place, or pose
    taken: Taken | None = None  # when; None where the scan came as arrays

    @property
    def doubted(self) -> bool:
        """Whether anything speaks against it."""
        return bool(self.doubts)


class Drawing(NamedTuple):
    """The points and surfaces behind a detection, for whoever draws it; thinned to about one point a voxel."""

    origin: np.ndarray  # (3,) float64 [m] world position that all offsets count from
    robot: np.ndarray  # (N, 3) float32 [m] offsets
    robot_probability: np.ndarray  # (N,) float32 that the point is of an added object
    robot_evidence: np.ndarray  # (N,) uint8 index into evidence.FRACTIONS of what most of its rays did
    robot_scan: np.ndarray  # (N,) int32 number of the scan
    prior: np.ndarray  # (M, 3) float32 [m] offsets
    prior_probability: np.ndarray  # (M,) float32 that the point is gone
    prior_evidence: np.ndarray  # (M,) uint8
    prior_element: np.ndarray  # (M,) int32 index into `guid`; -1 where the prior has no elements
    guid: tuple[str, ...]  # (E,) of every element of the prior, of whatever class
    vertices: np.ndarray | None  # (V, 3) float32 [m] offsets of the prior's surface; None for a cloud
    faces: np.ndarray | None  # (T, 3) int32
    face_element: np.ndarray | None  # (T,) int32 index into `guid`
    fields_of_view: tuple[np.ndarray, ...]  # of each scan: (4, 3) or (0, 3) float32, unit vectors of a camera's corners
    file: tuple[str, ...] = ()  # (E,) of every element; empty where the prior came as arrays
    twins: tuple[tuple[Key, ...], ...] = ()  # (E,) the same elements in other files, which have no surface of their own
    pieced: tuple[tuple[tuple[Key, ...], tuple[Key, ...]], ...] = ()  # the same of what has pieces, and these

    def corners(self, key: Key) -> np.ndarray | None:
        """(n, 3) float64 [m] offsets of the corners of an element's triangles; None of one without any."""
        rows = self.rows_of(key)
        if self.faces is None or not rows:
            return None
        used = self.faces[np.isin(self.face_element, rows)]
        return self.vertices[used].reshape(-1, 3).astype(np.float64) if len(used) else None

    def rows_of(self, key: Key) -> list[int]:
        """Indices into `guid` of all that shows an element: itself, what is the same elsewhere, or its pieces."""
        rows = self.rows()
        keys = next((pieces for wholes, pieces in self.pieced if key in wholes), (key,))
        return [rows[one] for one in keys if one in rows]

    def rows(self) -> dict[Key, int]:
        """Index into `guid` of every element, and of what is the same in other files."""
        own = zip(self.file or ("",) * len(self.guid), self.guid, strict=True)
        return {key: row for row, keys in enumerate(self.twins) for key in keys} | {k: row for row, k in enumerate(own)}


class Detection(NamedTuple):
    """All that `jaxmm detect` found."""

    mismatches: tuple[Mismatch, ...]
    elements: tuple[ElementVerdict, ...]
    scans: tuple[ScanRecord, ...]
    registration: dict[str, Any]
    settings: dict[str, Any]
    timing: dict[str, float]  # [s] by stage
    notes: tuple[str, ...]  # what a user must know of how files were read and of what was found, a line each
    drawing: Drawing
    prior: PriorFile | None = None  # None where the prior came as arrays
    date: str | None = None  # of what was found, as of `formats.dates`; None where nobody knows
    unexplained: tuple[Unexplained, ...] = ()  # what is in no model, and neither a wall nor a column

    @property
    def sentences(self) -> tuple[str, ...]:
        """The mismatches in words, one each."""
        return tuple(sentence(box_of(one), one.mismatch_type) for one in self.mismatches)

    @property
    def doubts(self) -> tuple[str, ...]:
        """What speaks against where the scans were taken from, and so against all that they tell: a line each."""
        of_scans = (f"{one.file}: {doubt}" for one in self.scans for doubt in one.doubts)
        return (*of_scans, *nothing_present(self.elements))

    def __repr__(self) -> str:
        """The summary: the arrays behind it fill screens."""
        return f"<Detection: {self.summary()}>"

    def count(self, verdict: str) -> int:
        """How many elements have a verdict; one that several files hold, whole or in pieces, counts once."""
        return sum(one.verdict == verdict for one in counted(self.elements))

    def summary(self) -> str:
        """One line: how many mismatches, how many elements of which verdict, and what else is in no model."""
        kinds = [(change, kind) for change in ("added", "removed") for kind in ("pillar", "wall")]
        found = []
        for change, kind in kinds:
            count = sum(one.mismatch_type == change and one.object_type == kind for one in self.mismatches)
            if count:
                found.append(f"{count} {kind if count == 1 else PLURAL[kind]} {change}")
        each = [one.verdict for one in counted(self.elements)]
        named = [name for name in VERDICTS if name != DISPLACED or name in each]
        verdicts = ", ".join(f"{each.count(name)} {name}" for name in named)
        others = len(self.elements) - len(each)
        again = f", {others} more being the same in other files:" if others else ""
        told = f"; of {len(each)} elements{again} {verdicts}" if self.elements else ""
        count = len(self.unexplained)
        more = f"; {count} other thing{'s are' if count > 1 else ' is'} not in the model" if count else ""
        return f"{', '.join(found) or 'no mismatch'}{told}{more}"


def once(elements: Iterable[Element]) -> Iterator[Element]:
    """Elements, of a detection or as a report lists them, without those that are the same as one before."""
    seen: set[Key] = set()
    for one in elements:
        if seen.isdisjoint(one.same_as):
            yield one
        seen.add(one.key)


def pieces_of(one: Any, keys: Collection[Key]) -> set[Key]:
    """Which of some elements are parts that another file has of one, which is as for `once`."""
    return {part for part in one.parts if part[0] != one.file and part in keys}


def counted(elements: Sequence[ElementVerdict]) -> list[ElementVerdict]:
    """Elements without those that are others of them again: the same, or the whole of parts that another file has.

    Of a whole that moved as one body, by too little to tell it of any of its parts, these are left out instead.
    """
    verdict_of, again = {one.key: one.verdict for one in elements}, set()
    for one in elements:
        parts = pieces_of(one, verdict_of)
        moved = one.verdict == DISPLACED and all(verdict_of[part] != DISPLACED for part in parts)
        again |= parts if moved or not parts else {one.key}
    return [one for one in once(elements) if one.key not in again]


def with_twins(
    one: ElementVerdict, building: Building, row: int, asks_for: Callable[[str, int], bool]
) -> Iterator[ElementVerdict]:
    """The verdict of an element of a building, by its row, and of the same in other files, if of classes asked for."""
    twins = [twin for twin in building.elements.twins[row] if asks_for(twin.ifc_class, twin.semantic)]
    keys = [one.key, *((twin.file, twin.guid) for twin in twins)]
    yield one._replace(same_as=tuple(keys[1:]))
    for number, twin in enumerate(twins, 1):
        yield one._replace(
            guid=twin.guid, ifc_class=twin.ifc_class, name=twin.name,
            storey=building.storeys.name[twin.storey] if twin.storey >= 0 else "",
            file=twin.file, same_as=(*keys[:number], *keys[number + 1 :]),
        )  # fmt: skip


def nothing_present(elements: tuple[ElementVerdict, ...]) -> tuple[str, ...]:
    """What speaks against all that was found: that elements are gone, and none is there."""
    count = {verdict: sum(one.verdict == verdict for one in elements) for verdict in VERDICTS}
    if count[PRESENT] or count[DISPLACED] or not count[REMOVED]:
        return ()
    gone = "1 is" if count[REMOVED] == 1 else f"{count[REMOVED]} are"
    return (f"{gone} told to be removed, and nothing to be present: is the scan of this building, and in this place?",)


def notes_on(mismatches: tuple[Mismatch, ...], elements: tuple[ElementVerdict, ...]) -> tuple[str, ...]:
    """What a reader must know: that no element is present, and what may stand, or be gone, in part."""
    known = {one.key: one for one in elements}
    stands = [
        f"{_named(known.get(one.key))} ({one.element}) is told to be removed, but {one.standing:.0%} of the rays "
        "that tell of it end on it: a part of it may stand"
        for one in mismatches
        if one.mismatch_type == "removed" and one.standing >= STANDS
    ]
    holes = [
        f"{_named(one)} ({one.guid}) is told to be present, but {_passed(one):.0%} of the rays that tell of it pass "
        "through its place: a part of it may be gone"
        for one in once(elements)
        if one.verdict == PRESENT and one.rays[0] >= LEAST_THROUGH and _passed(one) >= GONE and not one.parts_gone
    ]
    parts = [
        f"{_named(one)} ({one.guid}): a part of it is gone: "
        + "; ".join(_first([f"{_named(known.get(key))} ({key[1]})" for key in one.parts_gone], "parts"))
        for one in once(elements)
        if one.parts_gone and one.verdict != REMOVED
    ]
    passed = [
        f"{_named(one)} ({one.guid}) is told to be occluded: rays pass through its place, as through glass or where a "
        "door is open, and too little of its frame is seen to tell whether it stands"
        for one in once(elements)
        if one.verdict == OCCLUDED
        and one.ifc_class.startswith(SEE_THROUGH)
        and one.rays[0] > max(one.rays[1], LEAST_PASSED)
    ]
    return (
        *nothing_present(elements),
        *_first(stands, "removed elements a part may stand, too"),
        *_first(parts, "elements a part is gone, too"),
        *_first(holes, "present elements a part may be gone, too"),
        *_first(passed, "occluded elements rays pass, too"),
    )


def open_doors(names: list[str]) -> tuple[str, ...]:
    """That doors of these names are no barrier; nothing without any."""
    if not names:
        return ()
    which = ", ".join(names[:MOST_NAMED]) + (", ..." if len(names) > MOST_NAMED else "")
    are, they = ("1 door lets", "it") if len(names) == 1 else (f"{len(names)} doors let", "they")
    return (
        f"{are} rays pass, as open ones do: {which}; what stands behind passes for out of reach, unless {they} "
        f"{'is' if len(names) == 1 else 'are'} left out of the model (--open-doors)",
    )


def _named(one: ElementVerdict | None) -> str:
    """Class and name of an element; None: of one that is told of without a verdict."""
    return f"{one.ifc_class or 'element'} {one.name!r}" if one else "element"


def _passed(one: ElementVerdict) -> float:
    """Share of the rays that tell of an element, that pass through its place."""
    through, support = one.rays[:2]
    return through / max(through + support, 1)


def _first(lines: list[str], others: str) -> list[str]:
    """As many of some lines as are named, and how many others there are."""
    more = len(lines) - MOST_NAMED
    return lines if more <= 0 else [*lines[:MOST_NAMED], f"of {more} more {others}"]


def box_of(mismatch: Mismatch) -> Box:
    """The box that a mismatch fills."""
    return Box(
        mismatch.object_type, mismatch.center, mismatch.dimensions, mismatch.rotation, mismatch.shape,
        mismatch.probability,
    )  # fmt: skip


def told_probability(value: float) -> float:
    """A probability to six digits; what is nearly sure, or nearly excluded, is not rounded to it. NaN stays NaN."""
    value = float(value)
    return min(max(round(value, 6), 1e-6), 1.0 - 1e-6) if 0.0 < value < 1.0 else value
