"""Topics of displaced elements: valid, with the offset in words, the camera at the sensor, and what stands where."""

import re

import numpy as np
import pytest

from jaxmm.reports.bcf import write_bcf
from jaxmm.reports.bcf_displaced import displaced_topics, element_box
from jaxmm.reports.snapshots import EDGES, corners_of
from tests.cases.bcf_case import WHEN, by_index, content_of, only
from tests.cases.bcf_schema import check_schema
from tests.cases.displaced import deviation, with_displaced

pytest_plugins = ["tests.cases.bcf_case"]  # its fixtures: moved, opened


@pytest.fixture(scope="module")
def told(moved):
    return with_displaced(moved, distance=0.06)


@pytest.fixture(scope="module")
def file(told, tmp_path_factory):
    path = tmp_path_factory.mktemp("bcf") / "mismatches.bcf"
    write_bcf(path, told, "Tower", WHEN)
    return path


def vector(entry):
    return np.array([entry.x, entry.y, entry.z])


def test_a_displaced_element_is_a_topic_that_another_reader_reads(told, file, opened):
    check_schema(content_of(file))
    read = opened(file)
    topics = by_index(read)
    assert len(topics) == len(told.mismatches) + 1
    topic, (one,) = topics[-1].topic, [one for one in told.elements if one.verdict == "displaced"]
    assert topic.title == "The wall 'W-102' stands 60 mm (58 to 62) to the east of its place"
    assert topic.topic_type == "Deviation" and topic.topic_type in read.extensions.topic_types.topic_type
    assert topic.labels.label == ["displaced"] and "displaced" in read.extensions.topic_labels.topic_label
    assert topic.priority == "High"
    for part in (one.guid, "W-102", "x 60 mm", "LOA20", "1234 rays", "robot.ply", "North is +y"):
        assert part in topic.description
    assert "y 0 mm" not in topic.description
    (topic,) = displaced_topics(told, "Tower")
    assert [name for name, _ in topic.files] == [told.prior.file]


def test_the_camera_stands_at_the_sensor_and_the_lines_where_it_was_measured(told, file, opened):
    (one,) = [one for one in told.elements if one.verdict == "displaced"]
    info = only(by_index(opened(file))[-1].viewpoints.values()).visualization_info
    box = element_box(told.drawing, one)
    pose = np.array(told.scans[0].pose[:3])
    camera = info.perspective_camera
    np.testing.assert_array_equal(vector(camera.camera_view_point), pose)
    ahead = vector(camera.camera_direction)
    np.testing.assert_allclose(pose + ahead * np.linalg.norm(box.center - pose), box.center, atol=1e-9)
    assert only(info.components.selection.component).ifc_guid == one.guid
    drawn = np.array([(vector(line.start_point), vector(line.end_point)) for line in info.lines.line])
    np.testing.assert_allclose(drawn, corners_of(box)[EDGES] + [0.06, 0.0, 0.0], atol=1e-9)


def test_the_box_about_an_element_is_tight_however_it_is_turned(told):
    (one,) = [one for one in told.elements if one.verdict == "displaced"]
    drawing, row = told.drawing, told.drawing.guid.index(one.guid)
    used = drawing.faces[drawing.face_element == row]
    own = drawing.vertices[used].reshape(-1, 3)
    sizes = np.sort(np.ptp(own, axis=0))
    for angle in np.radians([0.0, 30.0, 77.0, 200.0]):
        cosine, sine = np.cos(angle), np.sin(angle)
        turn = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
        turned = drawing._replace(vertices=(drawing.vertices @ turn.T).astype(np.float32))
        box = element_box(turned, one._replace(deviation=deviation(0.06, turn @ [1.0, 0.0, 0.0])))
        np.testing.assert_allclose(np.sort(box.dimensions), sizes, atol=1e-4)
        yaw = np.radians(box.rotation)
        own_axes = np.array([[np.cos(yaw), -np.sin(yaw), 0.0], [np.sin(yaw), np.cos(yaw), 0.0], [0.0, 0.0, 1.0]])
        local = (turned.vertices[used].reshape(-1, 3) + drawing.origin - box.center) @ own_axes
        assert (np.abs(local) <= box.dimensions / 2.0 + 1e-4).all()


def test_topics_keep_their_guids_whatever_was_measured_and_their_text_stays_legal(told, moved):
    (first,), (again,) = displaced_topics(told, "a"), displaced_topics(with_displaced(moved, distance=0.05), "a")
    assert first.guid == again.guid != displaced_topics(told, "b")[0].guid and first.title != again.title
    name = "a\x00\x0b<b & \"c\" 'd' \ud800\r\n\te " + "x" * 5000
    (hostile,) = displaced_topics(with_displaced(moved, name=name), "a")
    assert len(hostile.title) < 400 and len(hostile.description) < 2000 and not re.search(r"[\x00-\x08]", hostile.title)
    assert [topic.priority for topic in displaced_topics(with_displaced(moved, distance=0.02), "a")] == ["Normal"]
