"""How the versions of BCF lay a topic out as XML: what is the same in all of them, and where they differ.

Elements stand in the order that buildingSMART's schemas ask for (github.com/buildingSMART/BCF-XML, release_2_1 and
release_3_0). 3.0 puts lists into elements of their own, 2.1 repeats their items.
"""

import uuid
from collections.abc import Iterable
from datetime import datetime
from typing import NamedTuple
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

from jaxmm.reports.bcf_topics import LABELS, PRIORITIES, TOPIC_TYPES, Topic, is_global_id, legal, one_line, project_guid
from jaxmm.reports.snapshots import ASPECT_RATIO, EDGES, FIELD_OF_VIEW

STATUSES = ("Open", "In Progress", "Closed")  # ours are open; the others are for whoever works on them
AUTHOR = "jaxmm"
_SCHEMA = "http://www.w3.org/2001/XMLSchema"
_USER, _LABEL = "UserIdType", "TopicLabel"  # as 2.1 calls the types of what 3.0 calls User and TopicLabel


class Layout(NamedTuple):
    """Where a version of BCF has what: each path leads from the parent to one item of a list."""

    version: str
    label: tuple[str, ...]
    related: tuple[str, ...]
    file: tuple[str, ...]
    view: tuple[str, ...]
    external: str  # attribute of a file that is not in the archive
    coloring: bool  # readers of 3.0 in JavaScript look for the colours of 2.1, find none, and refuse the file
    aspect_ratio: bool  # of the camera, which 2.1 leaves to the viewer


LAYOUTS = {
    "3.0": Layout(
        "3.0", ("Labels", "Label"), ("RelatedTopics", "RelatedTopic"), ("Header", "Files", "File"),
        ("Topic", "Viewpoints", "ViewPoint"), "IsExternal", coloring=False, aspect_ratio=True,
    ),
    "2.1": Layout(
        "2.1", ("Labels",), ("RelatedTopic",), ("Header", "File"), ("Viewpoints",), "isExternal", coloring=True,
        aspect_ratio=False,
    ),
}  # fmt: skip


def head(layout: Layout, project: str) -> dict[str, bytes]:
    """The files of an archive that are about all topics, by name."""
    version = Element("Version", VersionId=layout.version)
    known = Element("Project", ProjectId=str(project_guid(project)))
    if one_line(project):
        _add(known, "Name", one_line(project))
    if layout.version == "3.0":
        root = Element("ProjectInfo")
        root.append(known)
        words = {"extensions.xml": xml(_extensions())}
    else:
        _add(version, "DetailedVersion", layout.version)
        root = Element("ProjectExtension")
        root.append(known)
        _add(root, "ExtensionSchema", "extensions.xsd")
        words = {"extensions.xsd": xml(_extension_schema())}
    return {"bcf.version": xml(version), "project.bcfp": xml(root), **words}


def markup(layout: Layout, topic: Topic, number: int, when: datetime) -> Element:
    """What is said of a topic, the `number`-th of all."""
    root = Element("Markup")
    for name, project in topic.files:  # that a tool should have open beside the topic; they are not in the archive
        known = {"IfcProject": project} if is_global_id(project) else {}
        _add(_item(root, layout.file, known | {layout.external: "true"}), "Filename", legal(name))
    entry = SubElement(root, "Topic", Guid=topic.guid, TopicType=topic.kind, TopicStatus=STATUSES[0])
    _add(entry, "Title", topic.title)
    _add(entry, "Priority", topic.priority)
    _add(entry, "Index", str(number))
    for label in topic.labels:
        _item(entry, layout.label).text = label
    _add(entry, "CreationDate", when.strftime("%Y-%m-%dT%H:%M:%SZ"))
    _add(entry, "CreationAuthor", AUTHOR)
    _add(entry, "Description", topic.description)
    for guid in topic.related:
        _item(entry, layout.related, {"Guid": guid})
    view = _item(root, layout.view, {"Guid": _view_guid(topic)})
    _add(view, "Viewpoint", "viewpoint.bcfv")
    _add(view, "Snapshot", "snapshot.png")
    _add(view, "Index", "0")
    return root


def viewpoint(layout: Layout, topic: Topic) -> Element:
    """Where to look from, and at what."""
    root = Element("VisualizationInfo", Guid=_view_guid(topic))
    components = SubElement(root, "Components")
    for element in topic.selected:
        _item(components, ("Selection", "Component"), {"IfcGuid": element})
    # Without this some viewers hide the whole model.
    SubElement(components, "Visibility", DefaultVisibility="true")
    if layout.coloring and topic.painted:
        coloring = SubElement(components, "Coloring")
        for color in dict.fromkeys(color for color, _ in topic.painted):
            painted = SubElement(coloring, "Color", Color=color.removeprefix("#"))
            for element in (element for other, element in topic.painted if other == color):
                SubElement(painted, "Component", IfcGuid=element)
    camera = SubElement(root, "PerspectiveCamera")
    _add_vector(camera, "CameraViewPoint", topic.camera.position)
    _add_vector(camera, "CameraDirection", topic.camera.direction)
    _add_vector(camera, "CameraUpVector", topic.camera.up)
    _add(camera, "FieldOfView", repr(FIELD_OF_VIEW))
    if layout.aspect_ratio:
        _add(camera, "AspectRatio", repr(ASPECT_RATIO))
    for corners in topic.corners:
        for start, end in EDGES:
            line = _item(root, ("Lines", "Line"))
            _add_vector(line, "StartPoint", corners[start])
            _add_vector(line, "EndPoint", corners[end])
    if topic.cut is not None:
        position, ahead = topic.camera.position, topic.camera.direction
        plane = _item(root, ("ClippingPlanes", "ClippingPlane"))
        _add_vector(plane, "Location", position + ahead * (topic.cut - position[2]) / ahead[2])
        _add_vector(plane, "Direction", (0.0, 0.0, 1.0))  # to the side that is not shown
    return root


def xml(root: Element) -> bytes:
    """A document as it is written."""
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="UTF-8", xml_declaration=True) + b"\n"


def _words() -> tuple[tuple[str, str, tuple[str, ...]], ...]:
    """All words that topics use, and those that whoever works on them may need: a list, its items, and the words."""
    return (
        ("TopicTypes", "TopicType", TOPIC_TYPES), ("TopicStatuses", "TopicStatus", STATUSES),
        ("Priorities", "Priority", tuple(name for name, _ in PRIORITIES)), ("TopicLabels", _LABEL, LABELS),
        ("Users", "User", (AUTHOR,)),
    )  # fmt: skip


def _extensions() -> Element:
    root = Element("Extensions")
    for group, item, words in _words():
        for word in words:
            _item(root, (group, item)).text = word
    return root


def _extension_schema() -> Element:
    """The words as 2.1 has them: types of the schema of markup, restricted to these."""
    ElementTree.register_namespace("xs", _SCHEMA)
    root = Element(f"{{{_SCHEMA}}}schema")
    inner = SubElement(root, f"{{{_SCHEMA}}}redefine", schemaLocation="markup.xsd")
    for _, item, words in _words():
        name = _USER if item == "User" else item
        kind = SubElement(inner, f"{{{_SCHEMA}}}simpleType", name=name)
        restriction = SubElement(kind, f"{{{_SCHEMA}}}restriction", base=name)
        for word in words:
            SubElement(restriction, f"{{{_SCHEMA}}}enumeration", value=word)
    return root


def _view_guid(topic: Topic) -> str:
    return str(uuid.uuid5(uuid.UUID(topic.guid), "viewpoint"))


def _item(parent: Element, path: tuple[str, ...], attributes: dict[str, str] | None = None) -> Element:
    """A new element at the end of a path, whose other steps are made where they are missing."""
    *above, last = path
    for step in above:
        found = parent.find(step)
        parent = SubElement(parent, step) if found is None else found
    return SubElement(parent, last, attributes or {})


def _add(parent: Element, tag: str, text: str) -> None:
    SubElement(parent, tag).text = text


def _add_vector(parent: Element, tag: str, vector: Iterable[float]) -> None:
    entry = SubElement(parent, tag)
    for axis, value in zip("XYZ", vector, strict=True):
        _add(entry, axis, repr(float(value) + 0.0))
