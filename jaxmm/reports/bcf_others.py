"""Topics of what is no mismatch and is to be settled all the same: removed elements of other classes, and things that
are not in the model.

World frame of the prior: metres, z up.
"""

import uuid
from functools import partial

import numpy as np

from jaxmm.classes.unexplained import Unexplained
from jaxmm.learning.boxes import MISMATCH_TYPES
from jaxmm.reports.bcf_topics import (
    PRIORITIES,
    UNEXPLAINED,
    Topic,
    doubt_lines,
    element_words,
    evidence_words,
    files_about,
    global_id,
    one_line,
    priority_of,
    project_guid,
)
from jaxmm.reports.markdown import chance, number
from jaxmm.reports.removed_words import removed_others
from jaxmm.reports.snapshots import COLORS, best_scan, camera_at, corners_of, snapshot
from jaxmm.reports.verdict_words import UNEXPLAINED_WORDS
from jaxmm.verdicts.results import Detection, ElementVerdict, Mismatch
from jaxmm.verdicts.verdicts import REMOVED

MOST_THINGS = 20  # with a topic each, those with most points; unexplained.csv has all


def removed_boxes(detection: Detection) -> list[tuple[ElementVerdict, Mismatch]]:
    """Removed elements that are no mismatch, and no part of a removed one, once each, with the box around each."""
    return [
        (one, Mismatch(
            one.ifc_class or "element", REMOVED, np.asarray(one.box.center, np.float64),
            np.asarray(one.box.dimensions, np.float64), one.box.rotation, one.probability, one.guid, file=one.file,
        ))
        for one in removed_others(detection)
        if one.box is not None
    ]  # fmt: skip


def removed_topics(detection: Detection, project: str) -> tuple[Topic, ...]:
    """A topic for each removed element that is no mismatch: a beam, a stair, a window."""
    family, topics = project_guid(project), []
    for one, box in removed_boxes(detection):
        scan = best_scan(detection, box)
        x, y = (number(value) for value in box.center[:2])
        name = f" '{one_line(one.name)}'" if one.name else ""
        kind = one_line(box.object_type)
        lines = [
            f"The {kind}{name} of the model is not there.",
            *doubt_lines(detection),
            f"The probability that it was removed is {chance(one.probability)}.",
            element_words(one),
            evidence_words(one),
            f"Seen best by the scan {one_line(detection.scans[scan].file)}.",
        ]
        camera, element = camera_at(detection.scans[scan].pose, box.center), global_id(box)
        caption = f"{kind} removed, probability {chance(one.probability)}"
        topics.append(Topic(
            str(uuid.uuid5(family, f"{REMOVED}/{one_line(one.file)}/{one_line(one.guid)}")),
            f"Removed {kind}{name} at x {x}, y {y} m", "\n".join(lines), (MISMATCH_TYPES[1],),
            priority_of(one.probability), (), camera, partial(snapshot, mismatch=box, camera=camera, caption=caption),
            selected=(element,) if element else (), painted=((COLORS[REMOVED], element),) if element else (),
            corners=() if element else (corners_of(box),),
            files=files_about(box, detection),
        ))  # fmt: skip
    return tuple(topics)


def thing_box(thing: Unexplained) -> Mismatch:
    """The box around something that is not in the model, as pictures take it."""
    return Mismatch("thing", UNEXPLAINED, thing.center, thing.dimensions, thing.rotation, float("nan"))


def thing_topics(detection: Detection, project: str) -> tuple[Topic, ...]:
    """A topic for each thing that is in no model, those with most points first, of the least priority."""
    family, topics = project_guid(project), []
    seen: dict[str, int] = {}
    for thing in detection.unexplained[:MOST_THINGS]:
        box = thing_box(thing)
        scan = best_scan(detection, box)
        x, y = (number(value) for value in box.center[:2])
        size = " x ".join(map(number, box.dimensions))
        words = f"Not in the model: something of {size} m at x {x}, y {y} m"
        seen[words] = seen.get(words, 0) + 1
        lines = [
            UNEXPLAINED_WORDS,
            *doubt_lines(detection),
            f"Points on it, one for each 0.1 m: {thing.points}.",
            f"Seen best by the scan {one_line(detection.scans[scan].file)}.",
        ]
        camera = camera_at(detection.scans[scan].pose, box.center)
        topics.append(Topic(
            str(uuid.uuid5(family, f"{UNEXPLAINED}/{words}/{seen[words]}")), words, "\n".join(lines), (UNEXPLAINED,),
            PRIORITIES[-1][0], (), camera,
            partial(snapshot, mismatch=box, camera=camera, caption=f"not in the model, {thing.points} points"),
            UNEXPLAINED.capitalize(), corners=(corners_of(box),),
            files=files_about(box, detection),
        ))  # fmt: skip
    return tuple(topics)
