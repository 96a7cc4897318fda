"""A topic for every element that stands off its place: where, by how much, and how surely.

World frame of the prior: metres, z up.
"""

import math
import uuid
from collections.abc import Iterator
from functools import partial

import numpy as np

from jaxmm.reports.bcf_topics import (
    DEVIATION,
    Topic,
    doubt_lines,
    element_words,
    files_about,
    global_id,
    one_line,
    project_guid,
)
from jaxmm.reports.deviation_words import (
    INTERVAL_WORDS,
    NORTH_WORDS,
    displaced,
    kind_of_class,
    millimetres,
    place_in_words,
    turned_by,
)
from jaxmm.reports.markdown import number
from jaxmm.reports.snapshots import COLORS, best_scan, camera_at, corners_of, snapshot
from jaxmm.verdicts.results import Detection, Drawing, ElementVerdict, Mismatch
from jaxmm.verdicts.verdicts import DISPLACED

PRIORITY_FROM = (("High", 0.05), ("Normal", 0.015), ("Low", 0.0))  # [m] surely off: where LOA10 and LOA20 begin

LEAST_ANGLE = 0.05  # [deg] that is worth a word


def displaced_topics(detection: Detection, project: str) -> tuple[Topic, ...]:
    """The topics of all displaced elements, the worst first; of such as are drawn, which elements of a model are."""
    family, topics = project_guid(project), []
    seen: dict[str, int] = {}
    for one in displaced(detection.elements):
        box = element_box(detection.drawing, one)
        if box is None:
            continue
        seen[one.guid] = seen.get(one.guid, 0) + 1
        scan = best_scan(detection, box)
        words = place_in_words(one._replace(name=one_line(one.name), guid=one_line(one.guid)))
        seen_best = f"Seen best by the scan {one_line(detection.scans[scan].file)}."
        lines = [words, *doubt_lines(detection), *_facts(one), seen_best]
        sure = one.deviation.surely
        off = millimetres(one.deviation.most, one.deviation.half)
        caption = f"{kind_of_class(one.ifc_class)} displaced by {off} mm"
        camera, element = camera_at(detection.scans[scan].pose, box.center), (global_id(box),) if global_id(box) else ()
        topics.append(Topic(
            str(uuid.uuid5(family, f"{DISPLACED}/{one_line(one.guid)}/{seen[one.guid]}")), words.removesuffix("."),
            "\n".join(lines), (DISPLACED,), next((name for name, least in PRIORITY_FROM if sure >= least), "Low"), (),
            camera, partial(snapshot, mismatch=box, camera=camera, caption=caption), DEVIATION,
            selected=element, painted=tuple((COLORS[DISPLACED], one) for one in element),
            # Where it stands, as the selected element is where the model has it.
            corners=(corners_of(box) + np.asarray(one.deviation.offset, np.float64),),
            files=files_about(box, detection),
        ))  # fmt: skip
    return tuple(topics)


def element_box(drawing: Drawing, one: ElementVerdict) -> Mismatch | None:
    """The upright box about an element where the model has it, a side of it square to its offset; None if not drawn."""
    corners = drawing.corners(one.key)
    if corners is None:
        return None
    x, y, _ = one.deviation.direction
    yaw = math.atan2(y, x) if math.hypot(x, y) > 0.5 else 0.0
    turn = np.array([[math.cos(yaw), -math.sin(yaw), 0.0], [math.sin(yaw), math.cos(yaw), 0.0], [0.0, 0.0, 1.0]])
    corners = corners @ turn
    low, high = corners.min(axis=0), corners.max(axis=0)
    center = turn @ ((low + high) / 2.0) + drawing.origin
    kind = "pillar" if "Column" in one.ifc_class else "wall"
    return Mismatch(kind, DISPLACED, center, high - low, math.degrees(yaw), one.probability, one.guid, file=one.file)


def _facts(one: ElementVerdict) -> Iterator[str]:
    told = one.deviation
    axes = [
        f"{axis} {millimetres(value, (span[1] - span[0]) / 2.0)} mm"
        for axis, value, span in zip("xyz", told.offset, told.interval, strict=True)
        if span is not None
    ]
    yield f"Offset along the axes of the model: {', '.join(axes)}. What is not named, nothing that was seen fixes."
    if told.turn is not None and abs(told.turn) >= LEAST_ANGLE:
        yield f"It is {turned_by(told.turn, 2)}."
    if told.lean is not None and told.lean >= LEAST_ANGLE:
        yield f"It leans by {number(told.lean, 2)}°."
    yield (
        f"Its faces are flat to {millimetres(told.flatness, 0.0)} mm. Level of accuracy: {told.classes['loa']}; "
        f"DIN 18202: {told.classes['din18202']}."
    )
    yield f"{told.rays} rays end on it."
    yield element_words(one)
    yield f"{NORTH_WORDS} {INTERVAL_WORDS}"
