"""Viewpoints of BCF topics: where the camera stands, what is selected, painted and drawn, and the picture beside it."""

import io
from xml.etree import ElementTree

import numpy as np
import pytest
from PIL import Image

from jaxmm.inputs import InputError
from jaxmm.reports.bcf import write_bcf
from jaxmm.reports.bcf_topics import LABELS, TOPIC_TYPES, NewElement, global_id
from jaxmm.reports.snapshots import EDGES, Camera, best_scan, camera_at, corners_of, project, snapshot
from jaxmm.verdicts.results import Mismatch
from tests.cases.bcf_case import NEW, by_index, content_of, only
from tests.cases.bcf_schema import check_schema

pytest_plugins = ["tests.cases.bcf_case"]  # its fixtures: moved, written, opened


def vector(entry):
    return np.array([entry.x, entry.y, entry.z])


def test_camera_stands_at_the_sensor_and_looks_at_the_mismatch(moved, written, opened):
    pose = np.array(moved.scans[0].pose[:3])
    for one, topic in zip(moved.mismatches, by_index(opened(written)), strict=True):
        view = only(topic.viewpoints.values())
        camera = view.visualization_info.perspective_camera
        np.testing.assert_array_equal(vector(camera.camera_view_point), pose)
        ahead = vector(camera.camera_direction)
        np.testing.assert_allclose(pose + ahead * np.linalg.norm(one.center - pose), one.center, atol=1e-9)
        assert abs(ahead @ vector(camera.camera_up_vector)) < 1e-12
        assert (camera.field_of_view, camera.aspect_ratio) == (60.0, 4 / 3)
        assert view.snapshot == snapshot(moved.drawing, one, camera_at(moved.scans[0].pose, one.center))


def test_removed_elements_are_selected_and_added_ones_are_drawn(moved, written, opened):
    for one, topic in zip(moved.mismatches, by_index(opened(written)), strict=True):
        info = only(topic.viewpoints.values()).visualization_info
        assert info.components.visibility.default_visibility
        assert info.components.coloring is None  # which readers in JavaScript would refuse the file for
        if one.mismatch_type == "removed":
            assert info.lines is None
            assert only(info.components.selection.component).ifc_guid == one.element
        else:
            assert info.components.selection is None
            drawn = [(vector(line.start_point), vector(line.end_point)) for line in info.lines.line]
            np.testing.assert_array_equal(drawn, corners_of(one)[EDGES])


def test_an_added_object_selects_the_element_that_the_updated_model_has_for_it(moved, opened, tmp_path):
    path = tmp_path / "new.bcf"
    write_bcf(path, moved, new={2: NewElement(NEW, "updated.ifc")})
    check_schema(content_of(path))
    _, pillar, again = by_index(opened(path))
    info = only(again.viewpoints.values()).visualization_info
    assert only(info.components.selection.component).ifc_guid == NEW and len(info.lines.line) == 12
    assert [file.filename for file in again.header.files.file] == ["room.ifc", "updated.ifc"]
    assert [file.filename for file in pillar.header.files.file] == ["room.ifc"]


def test_overview_selects_and_shows_all_from_above(moved, opened, tmp_path):
    path = tmp_path / "new.bcf"
    write_bcf(path, moved, new={2: NewElement(NEW, "updated.ifc")})
    topic = only(topic for topic in opened(path).topics.values() if topic.topic.topic_type == "Overview")
    assert topic.topic.index == 0 and topic.topic.title == "Overview: 1 added, 2 removed"
    view = only(topic.viewpoints.values())
    info = view.visualization_info
    chosen = {one.ifc_guid for one in info.components.selection.component}
    assert chosen == {*(one.element for one in moved.mismatches[:2]), NEW}
    eye, ahead, up = (
        vector(getattr(info.perspective_camera, f"camera_{name}")) for name in ("view_point", "direction", "up_vector")
    )
    corners = np.concatenate([corners_of(one) for one in moved.mismatches])
    place, depth = project(Camera(eye, ahead, up), corners)
    assert (np.abs(place) < 1.0).all() and (depth > 0.0).all()
    plane = only(info.clipping_planes.clipping_plane)
    cut = vector(plane.location)[2]
    assert tuple(vector(plane.direction)) == (0.0, 0.0, 1.0) and eye[2] > corners[:, 2].max() > cut
    assert all(cut > one.center[2] - one.dimensions[2] / 2 for one in moved.mismatches)
    write_bcf(path, moved._replace(mismatches=moved.mismatches[:1]))
    assert len(opened(path).topics) == 1  # one alone is its own overview


def test_the_older_version_is_valid_and_says_the_same(moved, written, older, opened):
    content = content_of(older)
    check_schema(content, "2.1")
    read, newer = opened(older, "bcf.v2.bcfxml"), opened(written)
    assert (read.version.version_id, read.project.name) == ("2.1", "Tower & annex")
    for topic, other in zip(by_index(read), by_index(newer), strict=True):
        assert (topic.guid, topic.topic.title, topic.topic.description) == (
            other.guid, other.topic.title, other.topic.description,
        )  # fmt: skip
        assert topic.topic.labels == other.topic.labels.label
        view, seen = (only(one.viewpoints.values()) for one in (topic, other))
        assert view.snapshot == seen.snapshot and view.visualization_info.guid == seen.visualization_info.guid
        for name in ("camera_view_point", "camera_direction", "camera_up_vector"):
            cameras = (one.visualization_info.perspective_camera for one in (view, seen))
            np.testing.assert_array_equal(*(vector(getattr(camera, name)) for camera in cameras))
    wall, pillar, again = by_index(read)
    assert only(pillar.topic.related_topic).guid == again.guid and not wall.topic.related_topic
    for one, topic, color in zip(moved.mismatches, (wall, pillar, again), ("D55E00", "D55E00", "0072B2"), strict=True):
        parts = only(topic.viewpoints.values()).visualization_info.components
        painted = only(parts.coloring.color)
        chosen = one.element or NEW
        assert only(parts.selection.component).ifc_guid == only(painted.component).ifc_guid == chosen
        assert painted.color == color


def test_the_words_of_the_older_version_are_types_of_its_schema(older):
    root = ElementTree.fromstring(content_of(older)["extensions.xsd"])
    space = "{http://www.w3.org/2001/XMLSchema}"
    assert root.tag == f"{space}schema"
    told = {one.get("name"): [word.get("value") for word in one.iter(f"{space}enumeration")]
            for one in root.iter(f"{space}simpleType")}  # fmt: skip
    assert told["TopicType"] == list(TOPIC_TYPES) and told["TopicLabel"] == list(LABELS)
    assert told["UserIdType"] == ["jaxmm"] and {"Priority", "TopicStatus"} < told.keys()


def test_a_version_that_nobody_writes_is_refused(moved, tmp_path):
    with pytest.raises(InputError, match=r"expected version 3\.0 or 2\.1, got '2\.0'"):
        write_bcf(tmp_path / "mismatches.bcf", moved, version="2.0")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "element, expected",
    [
        ("2O2Fr$t4X7Zf8NOew3FNr2", True),
        ("0___$$$$aaaaZZZZ000099", True),
        ("4O2Fr$t4X7Zf8NOew3FNr2", False),  # more than 128 bits
        ("2O2Fr$t4X7Zf8NOew3FNr", False),
        ("2O2Fr$t4X7Zf8NOew3FNr22", False),
        ("2O2Fr$t4X7Zf8NOew3FNr2\n", False),
        ("2O2Fr-t4X7Zf8NOew3FNr2", False),
        ("\uff12O2Fr$t4X7Zf8NOew3FNr2", False),
        ("wall_12", False),
        ("", False),
        (None, False),
    ],
)
def test_only_global_ids_of_removed_elements_are_selected(element, expected):
    removed = Mismatch("wall", "removed", np.zeros(3), np.ones(3), 0.0, 0.9, element)
    assert global_id(removed) == (element if expected else None)
    assert global_id(removed._replace(mismatch_type="added")) is None


def test_coordinates_of_a_national_grid_lose_nothing(moved, opened, tmp_path):
    shift = np.array([2_600_123.456, 1_200_987.654, 431.0])
    pose = tuple(float(value) for value in np.array(moved.scans[0].pose[:3]) + shift) + moved.scans[0].pose[3:]
    far = moved._replace(
        mismatches=tuple(one._replace(center=one.center + shift) for one in moved.mismatches),
        scans=(moved.scans[0]._replace(pose=pose),),
        drawing=moved.drawing._replace(origin=moved.drawing.origin + shift),
    )
    write_bcf(tmp_path / "far.bcf", far)
    added = only(by_index(opened(tmp_path / "far.bcf"))[2].viewpoints.values()).visualization_info
    assert tuple(vector(added.perspective_camera.camera_view_point)) == pose[:3]
    ends = np.array([(vector(line.start_point), vector(line.end_point)) for line in added.lines.line])
    np.testing.assert_allclose(ends - shift, corners_of(moved.mismatches[2])[EDGES], atol=2e-9)
    assert best_scan(far, far.mismatches[0]) == best_scan(moved, moved.mismatches[0])


def test_snapshot_of_every_topic_is_a_picture(written):
    pictures = [data for name, data in content_of(written).items() if name.endswith(".png")]
    assert len(pictures) == 4 == len(set(pictures))
    for data in pictures:
        assert len(data) < 150_000
        image = Image.open(io.BytesIO(data))
        image.load()
        assert (image.format, image.size) == ("PNG", (640, 480))
