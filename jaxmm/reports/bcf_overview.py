"""One topic about all that changed: everything selected, and seen from above with the ceiling cut away.

World frame of the prior: metres, z up.
"""

import uuid
from collections import Counter
from collections.abc import Iterable
from functools import partial

import numpy as np

from jaxmm.reports.bcf_displaced import element_box
from jaxmm.reports.bcf_others import MOST_THINGS, removed_boxes, thing_box
from jaxmm.reports.bcf_topics import OVERVIEW, PRIORITIES, UNEXPLAINED, Topic, doubt_lines, project_guid
from jaxmm.reports.deviation_words import displaced
from jaxmm.reports.snapshots import Camera, corners_of, picture_of_all, stepped_back
from jaxmm.verdicts.results import Detection, Mismatch

LEAST_TOPICS = 2  # one alone is its own overview
DOWN = np.array([0.0, 0.5, -0.866])  # of the line of sight: north is at the top of the picture
LEAST_REACH = 4.0  # [m] about the middle that is shown, so that one knows the place
CUT_HEIGHT, CUT_SHARE = 2.0, 0.75  # [m] above its foot, and share of its height: the lower one keeps the ceiling out
MOST_LISTED = 50
WORDS = {"added": "added", "removed": "removed", "displaced": "displaced", UNEXPLAINED: "else not in the model"}


def overview_topic(detection: Detection, project: str, topics: tuple[Topic, ...]) -> tuple[Topic, ...]:
    """The topic of all topics, or none where they are fewer than two."""
    if len(topics) < LEAST_TOPICS:
        return ()
    drawing = detection.drawing
    places = [element_box(drawing, one) for one in displaced(detection.elements)]
    removed, things = [box for _, box in removed_boxes(detection)], list(map(thing_box, detection.unexplained))
    boxes = [*detection.mismatches, *removed, *(box for box in places if box is not None)]
    cut = cut_of(boxes or things)  # what hangs from a ceiling is none to keep it for
    boxes += things[:MOST_THINGS]
    camera = camera_above(boxes)
    count = Counter(one.mismatch_type for one in boxes)
    count[UNEXPLAINED] = len(things)
    words = ", ".join(f"{count[change]} {word}" for change, word in WORDS.items() if count[change])
    lines = [*doubt_lines(detection), *(f"- {topic.title}" for topic in topics[:MOST_LISTED])]
    if len(topics) > MOST_LISTED:
        lines.append(f"And {len(topics) - MOST_LISTED} more.")
    return (Topic(
        str(uuid.uuid5(project_guid(project), OVERVIEW)), f"Overview: {words}", "\n".join(lines),
        tuple(dict.fromkeys(_all(topic.labels for topic in topics))), PRIORITIES[0][0], (), camera,
        partial(picture_of_all, boxes=boxes, camera=camera, caption=words, top=cut),
        OVERVIEW, selected=tuple(dict.fromkeys(_all(topic.selected for topic in topics))),
        painted=tuple(dict.fromkeys(_all(topic.painted for topic in topics))),
        corners=tuple(_all(topic.corners for topic in topics)), cut=cut,
        files=tuple(dict.fromkeys(_all(topic.files for topic in topics))),
    ),)  # fmt: skip


def camera_above(boxes: list[Mismatch]) -> Camera:
    """A camera in the south of all boxes and above them that has them in its picture, and the place about them."""
    corners = np.concatenate([corners_of(one) for one in boxes])
    middle = (corners.min(axis=0) + corners.max(axis=0)) / 2.0
    around = middle + LEAST_REACH * np.array([[-1, -1, 0], [-1, 1, 0], [1, -1, 0], [1, 1, 0]])
    direction = DOWN / np.linalg.norm(DOWN)
    up = np.array([0.0, -direction[2], direction[1]])
    return stepped_back(Camera(middle, direction, up), np.concatenate([corners, around]))[0]


def cut_of(boxes: list[Mismatch]) -> float:
    """z [m] at which to cut the building, so that the highest of the boxes still shows."""
    return max(
        float(one.center[2] - one.dimensions[2] / 2.0 + min(CUT_HEIGHT, CUT_SHARE * one.dimensions[2])) for one in boxes
    )


def _all(groups: Iterable[tuple]) -> Iterable:
    return (one for group in groups for one in group)
