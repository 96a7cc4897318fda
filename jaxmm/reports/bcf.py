"""Mismatches and displaced elements as topics of BCF 3.0 (BIM Collaboration Format), which BIM tools open.

bcf.version, project.bcfp and extensions.xml; then a folder per topic with markup.bcf (what is said), viewpoint.bcfv
(where to look from, and at what) and snapshot.png. Elements stand in the order that buildingSMART's schemas ask for.
Coordinates are those of the prior: metres, z up, at full precision.
"""

import uuid
from collections.abc import Iterable
from datetime import UTC, datetime
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

from jaxmm.files import write_atomically
from jaxmm.reports.archives import write_zip
from jaxmm.reports.bcf_displaced import displaced_topics
from jaxmm.reports.bcf_topics import (
    LABELS,
    PRIORITIES,
    TOPIC_TYPES,
    Topic,
    files_about,
    global_id,
    is_global_id,
    legal,
    one_line,
    project_guid,
    topics_of,
)
from jaxmm.reports.snapshots import ASPECT_RATIO, COLORS, EDGES, FIELD_OF_VIEW, corners_of, snapshot
from jaxmm.verdicts.results import Detection, PriorFile, Source

STATUSES = ("Open", "In Progress", "Closed")  # ours are open; the others are for whoever works on them
AUTHOR = "jaxmm"


def write_bcf(path: Path, detection: Detection, project: str = "jaxmm", when: datetime | None = None) -> None:
    """Write mismatches.bcf, whole or not at all: one topic per mismatch and displaced element, or none.

    The topics' GUIDs follow from the project and from what changed where, so a second run names the same mismatch the
    same, and equal arguments give equal bytes.

    Args:
        path: the file.
        detection: what was found; its scans tell where to look from.
        project: name of the project that the topics belong to.
        when: date of all topics, by default now; one without a time zone is UTC.

    Raises:
        ValueError: there is something to tell of, but no scan.
        OSError: it cannot be written; the path stays as it was.
    """
    when = when or datetime.now(UTC)
    when = when.replace(tzinfo=UTC) if when.tzinfo is None else when.astimezone(UTC)
    topics = (*topics_of(detection, project), *displaced_topics(detection, project))
    files = {
        "bcf.version": _xml(Element("Version", VersionId="3.0")),
        "project.bcfp": _xml(_project(project)),
        "extensions.xml": _xml(_extensions()),
    }
    for number, topic in enumerate(topics):
        files[f"{topic.guid}/"] = b""  # readers rely on folders being listed
        files[f"{topic.guid}/markup.bcf"] = _xml(_markup(topic, number, when, detection))
        files[f"{topic.guid}/viewpoint.bcfv"] = _xml(_viewpoint(topic))
        files[f"{topic.guid}/snapshot.png"] = snapshot(detection.drawing, topic.mismatch, topic.camera, topic.caption)
    write_atomically(Path(path), lambda temporary: write_zip(temporary, files))


def _project(name: str) -> Element:
    root = Element("ProjectInfo")
    project = SubElement(root, "Project", ProjectId=str(project_guid(name)))
    if one_line(name):
        _add(project, "Name", one_line(name))
    return root


def _extensions() -> Element:
    """All words that topics use, and those that whoever works on them may need."""
    root = Element("Extensions")
    for group, item, words in (
        ("TopicTypes", "TopicType", TOPIC_TYPES),
        ("TopicStatuses", "TopicStatus", STATUSES),
        ("Priorities", "Priority", tuple(name for name, _ in PRIORITIES)),
        ("TopicLabels", "TopicLabel", LABELS),
        ("Users", "User", (AUTHOR,)),
    ):
        listed = SubElement(root, group)
        for word in words:
            _add(listed, item, word)
    return root


def _markup(topic: Topic, number: int, when: datetime, detection: Detection) -> Element:
    root = Element("Markup")
    if detection.prior is not None:
        _add_header(root, files_about(topic.mismatch, detection))
    entry = SubElement(root, "Topic", Guid=topic.guid, TopicType=topic.kind, TopicStatus=STATUSES[0])
    _add(entry, "Title", topic.title)
    _add(entry, "Priority", topic.priority)
    _add(entry, "Index", str(number))
    labels = SubElement(entry, "Labels")
    for label in topic.labels:
        _add(labels, "Label", label)
    _add(entry, "CreationDate", when.strftime("%Y-%m-%dT%H:%M:%SZ"))
    _add(entry, "CreationAuthor", AUTHOR)
    _add(entry, "Description", topic.description)
    if topic.related:
        related = SubElement(entry, "RelatedTopics")
        for guid in topic.related:
            SubElement(related, "RelatedTopic", Guid=guid)
    view = SubElement(SubElement(entry, "Viewpoints"), "ViewPoint", Guid=_view_guid(topic))
    _add(view, "Viewpoint", "viewpoint.bcfv")
    _add(view, "Snapshot", "snapshot.png")
    _add(view, "Index", "0")
    return root


def _add_header(parent: Element, files: Iterable[PriorFile | Source]) -> None:
    """The files that a tool should have open beside the topic; they are not in the archive."""
    listed = SubElement(SubElement(parent, "Header"), "Files")
    for one in files:
        known = {"IfcProject": one.project} if is_global_id(one.project) else {}
        _add(SubElement(listed, "File", known, IsExternal="true"), "Filename", legal(one.file))


def _viewpoint(topic: Topic) -> Element:
    root = Element("VisualizationInfo", Guid=_view_guid(topic))
    components, element = SubElement(root, "Components"), global_id(topic.mismatch)
    if element:
        SubElement(SubElement(components, "Selection"), "Component", IfcGuid=element)
    # Without this some viewers hide the whole model.
    SubElement(components, "Visibility", DefaultVisibility="true")
    if element:
        color = COLORS[topic.mismatch.mismatch_type].removeprefix("#")
        painted = SubElement(SubElement(components, "Coloring"), "Color", Color=color)
        SubElement(SubElement(painted, "Components"), "Component", IfcGuid=element)
    camera = SubElement(root, "PerspectiveCamera")
    _add_vector(camera, "CameraViewPoint", topic.camera.position)
    _add_vector(camera, "CameraDirection", topic.camera.direction)
    _add_vector(camera, "CameraUpVector", topic.camera.up)
    _add(camera, "FieldOfView", repr(FIELD_OF_VIEW))
    _add(camera, "AspectRatio", repr(ASPECT_RATIO))
    if topic.offset is not None or not element:  # where it stands, or else nothing could be selected
        lines, corners = SubElement(root, "Lines"), corners_of(topic.mismatch)
        corners = corners if topic.offset is None else corners + topic.offset
        for start, end in EDGES:
            line = SubElement(lines, "Line")
            _add_vector(line, "StartPoint", corners[start])
            _add_vector(line, "EndPoint", corners[end])
    return root


def _view_guid(topic: Topic) -> str:
    return str(uuid.uuid5(uuid.UUID(topic.guid), "viewpoint"))


def _add(parent: Element, tag: str, text: str) -> None:
    SubElement(parent, tag).text = text


def _add_vector(parent: Element, tag: str, vector: Iterable[float]) -> None:
    entry = SubElement(parent, tag)
    for axis, value in zip("XYZ", vector, strict=True):
        _add(entry, axis, repr(float(value)))


def _xml(root: Element) -> bytes:
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="UTF-8", xml_declaration=True) + b"\n"
