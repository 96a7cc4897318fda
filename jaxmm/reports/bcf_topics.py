"""What is said of every mismatch to people who will settle it in their own tools: a topic each.

World frame of the prior: metres, z up.
"""

import re
import uuid
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import NamedTuple

import numpy as np

from jaxmm.learning.boxes import MISMATCH_TYPES, OBJECT_TYPES
from jaxmm.rays.evidence import FRACTIONS
from jaxmm.reports.bcf_request import NewElement
from jaxmm.reports.deviation_words import turned_by
from jaxmm.reports.markdown import chance, number, other_type, sizes
from jaxmm.reports.snapshots import COLORS, Camera, best_scan, camera_at, corners_of, snapshot
from jaxmm.reports.verdict_words import ASSUMED_WORDS
from jaxmm.verdicts.results import Detection, Drawing, ElementVerdict, Mismatch
from jaxmm.verdicts.verdicts import DISPLACED

PRIORITIES = (("High", 0.9), ("Normal", 0.7), ("Low", 0.0))  # by the least probability of each
MOVED = "moved"
UNEXPLAINED = "unexplained"
LABELS = (*OBJECT_TYPES, *MISMATCH_TYPES, MOVED, DISPLACED, UNEXPLAINED)
MISMATCH, DEVIATION, OVERVIEW, _ = TOPIC_TYPES = ("Mismatch", "Deviation", "Overview", UNEXPLAINED.capitalize())

LEAST_TURN = 0.5  # [deg] that is worth a word
SQUARE = 0.005  # [m] by which sides may differ that are called equal
_FAMILY = uuid.UUID("3d0b6f0e-6d52-5f0b-9a55-2b8f4d5c7e11")  # the GUIDs of all projects are names in this family
_GLOBAL_ID = re.compile(r"[0-3][0-9A-Za-z_$]{21}", re.ASCII)
_NOT_XML = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")  # what XML 1.0 cannot hold at all
_LONGEST_NAME = 200  # characters of a file's own names that a reader is asked to look at


class Topic(NamedTuple):
    """What one mismatch becomes, or one displaced element, or all of them together."""

    guid: str  # lower case, hyphenated
    title: str
    description: str
    labels: tuple[str, ...]  # of LABELS
    priority: str  # of PRIORITIES
    related: tuple[str, ...]  # GUIDs of the topics that tell of the same object elsewhere
    camera: Camera
    picture: Callable[[Drawing], bytes]  # PNG
    kind: str = MISMATCH  # of TOPIC_TYPES
    selected: tuple[str, ...] = ()  # GlobalIds
    painted: tuple[tuple[str, str], ...] = ()  # a colour, as #RRGGBB, and a GlobalId of what is painted so
    corners: tuple[np.ndarray, ...] = ()  # (8, 3) [m] of each box that is drawn, in the order of snapshots.EDGES
    cut: float | None = None  # z [m] above which nothing is to be shown
    files: tuple[tuple[str, str | None], ...] = ()  # that it is about, the updated model's too: name, and IfcProject


def topics_of(detection: Detection, project: str, new: Mapping[int, NewElement] | None = None) -> tuple[Topic, ...]:
    """The topics of all mismatches, in their order.

    `new` holds what the updated model has for added objects, by their place among the mismatches.
    """
    new = new or {}
    mismatches, sentences = detection.mismatches, detection.sentences
    guids = tuple(_guids(mismatches, sentences, project))
    links = [(index, one.moved_from) for index, one in enumerate(mismatches) if one.moved_from is not None]
    topics: list[Topic] = []
    for index, (one, words) in enumerate(zip(mismatches, sentences, strict=True)):
        twins = [removed for added, removed in links if added == index]
        twins += [added for added, removed in links if removed == index]
        scan = best_scan(detection, one)
        seen = f"Seen best by the scan {one_line(detection.scans[scan].file)}."
        lines = [words, *doubt_lines(detection), *_facts(one, detection), seen]
        lines += [f"Seems to be the same object, moved: {sentences[twin]}" for twin in twins]
        camera, element = camera_at(detection.scans[scan].pose, one.center), global_id(one)
        files = files_about(one, detection)
        if index in new:
            element = new[index].guid
            files += ((new[index].file, files[0][1]),)
        is_added = one.mismatch_type == "added"
        topics.append(Topic(
            guids[index], title_of(one, detection), "\n".join(lines),
            (one.object_type, one.mismatch_type, *((MOVED,) if twins else ())),
            priority_of(one.probability),
            tuple(guids[twin] for twin in twins), camera, partial(snapshot, mismatch=one, camera=camera),
            selected=(element,) if element else (),
            painted=((COLORS[one.mismatch_type], element),) if element else (),
            # A new one is in the updated model only, so its box is drawn as well.
            corners=(corners_of(one),) if is_added or not element else (), files=files,
        ))  # fmt: skip
    return tuple(topics)


def title_of(mismatch: Mismatch, detection: Detection) -> str:
    """A line that tells it from others in a list: "Removed wall 'W-12' at x 3.20, y -0.35 m"."""
    told = next((one for one in detection.elements if one.key == mismatch.key), None)
    name = f" '{one_line(told.name)}'" if told is not None and told.name else ""
    x, y = (number(value) for value in mismatch.center[:2])
    return f"{mismatch.mismatch_type.capitalize()} {mismatch.object_type}{name} at x {x}, y {y} m"


def priority_of(probability: float) -> str:
    """One of PRIORITIES."""
    return next((name for name, least in PRIORITIES if probability >= least), PRIORITIES[-1][0])


def project_guid(project: str) -> uuid.UUID:
    """What its name makes of a project."""
    return uuid.uuid5(_FAMILY, legal(project))


def global_id(mismatch: Mismatch) -> str | None:
    """The GlobalId of an element of the model that an IFC file can hold; None for all else, like the node of a mesh."""
    return mismatch.element if mismatch.mismatch_type != "added" and is_global_id(mismatch.element) else None


def is_global_id(text: str | None) -> bool:
    """Whether an IFC file can have this GlobalId."""
    return _GLOBAL_ID.fullmatch(text or "") is not None


def one_line(text: str) -> str:
    """A name from a file on one line, of a bearable length."""
    text = " ".join(legal(text).split())
    return text if len(text) <= _LONGEST_NAME else f"{text[: _LONGEST_NAME - 1]}…"


def legal(text: str) -> str:
    """Text with a mark in place of what XML cannot hold."""
    return _NOT_XML.sub("\ufffd", text)


def element_words(told: ElementVerdict) -> str:
    """Which element of the model one is, a sentence."""
    words = [one_line(told.ifc_class), f'"{one_line(told.name)}"' if told.name else "", one_line(told.guid)]
    words.append(f'storey "{one_line(told.storey)}"' if told.storey else "")
    words.append(f"file {one_line(told.file)}" if told.file else "")
    same = "".join(
        f" {what} {one_line(guid)} of {one_line(file)}."
        for what, keys in (("The same as", told.same_as), ("A part of", told.part_of), ("Gone of it:", told.parts_gone))
        for file, guid in keys
    )
    return f"Element of the model: {', '.join(word for word in words if word)}.{same}"


def evidence_words(told: ElementVerdict) -> str:
    """What rays did at an element, a sentence."""
    counts = ", ".join(f"{count} {name}" for name, count in zip(FRACTIONS, told.rays, strict=True))
    return f"Evidence: {told.points} points of the model's scan lie on it; of the robot's rays there, {counts}."


def doubt_lines(detection: Detection) -> list[str]:
    """What speaks against all that a topic says, a line each."""
    return [f"In doubt: {one_line(doubt)}" for doubt in detection.doubts]


def files_about(mismatch: Mismatch, detection: Detection) -> tuple[tuple[str, str | None], ...]:
    """The files of the model that a mismatch is about, with their IfcProject: all that have its element; of what is in
    none of them, as something added, all.
    """
    prior = detection.prior
    if prior is None:
        return ()
    told = next((one for one in detection.elements if one.key == mismatch.key), None)
    of_file = (*told.same_as, *told.parts_gone) if told else ()
    names = {mismatch.file, *(file for file, _ in of_file)}
    files = tuple(one for one in prior.sources if one.file in names) or prior.sources or (prior,)
    return tuple((one.file, one.project) for one in files)


def _guids(mismatches: tuple[Mismatch, ...], sentences: tuple[str, ...], project: str) -> Iterator[str]:
    """By change and place alone: a probability may differ a little from run to run."""
    family = project_guid(project)
    seen: dict[str, int] = {}
    for one, words in zip(mismatches, sentences, strict=True):
        content = f"{words}/{one.rotation:.2f}/{legal(one.element or '')}"
        seen[content] = seen.get(content, 0) + 1
        yield str(uuid.uuid5(family, f"{content}/{seen[content]}"))


def _turn(mismatch: Mismatch) -> float:
    """Its turn [deg]; of a square one the least that makes it look like that."""
    is_square = abs(mismatch.dimensions[0] - mismatch.dimensions[1]) < SQUARE
    return (mismatch.rotation + 45.0) % 90.0 - 45.0 if is_square else mismatch.rotation


def _facts(mismatch: Mismatch, detection: Detection) -> Iterator[str]:
    if not all(mismatch.measured):
        yield f"Of its size {sizes(mismatch)} m: {ASSUMED_WORDS}"
    if abs(turn := _turn(mismatch)) >= LEAST_TURN:
        yield f"It is {turned_by(turn)}."
    yield f"The probability that this is real is {chance(mismatch.probability)}."
    if (other := other_type(mismatch)) is not None:
        yield f"The probability that it is a {other[0]} instead is {chance(other[1])}."
    if mismatch.observable_fraction is not None:
        yield f"Of the object, {mismatch.observable_fraction:.0%} could be observed."
    if mismatch.element is None:
        return
    told = next((one for one in detection.elements if one.key == mismatch.key), None)
    if told is None:
        yield f"Element of the model: {one_line(mismatch.element)}."
        return
    yield element_words(told)
    yield f"Its verdict is {told.verdict}; the probability that it was removed is {chance(told.probability)}."
    yield evidence_words(told)
