"""Topics of removed elements that are no mismatch, and of things that no model has; and the other outputs of both."""

import zipfile

import numpy as np
import pytest

from jaxmm.classes.unexplained import Unexplained
from jaxmm.learning.element_boxes import UprightBox
from jaxmm.reports.bcf import write_bcf
from jaxmm.reports.bcf_others import MOST_THINGS
from jaxmm.reports.notebook import detection_html
from jaxmm.reports.snapshots import EDGES, corners_of
from jaxmm.reports.workbook import write_workbook
from tests.cases.bcf_case import WHEN, by_index, content_of, only
from tests.cases.bcf_schema import check_schema

pytest_plugins = ["tests.cases.bcf_case"]  # its fixtures: moved, opened
THING = Unexplained(np.array([0.5, -0.25, 0.6]), np.array([1.2, 0.6, 1.1]), 25.0, 140)


@pytest.fixture(scope="module")
def told(moved):
    """A beam is gone as well, which two files have, and something stands there that no model has."""
    keep = {one.element for one in moved.mismatches}
    beam = next(one for one in moved.elements if one.guid not in keep)
    box = UprightBox((1.0, 0.5, 2.5), (2.0, 0.2, 0.3), 10.0)
    gone = beam._replace(verdict="removed", probability=0.96, ifc_class="IfcBeam", name="B & 7", box=box)
    twin = gone._replace(guid="3O2Fr$t4X7Zf8NOew3FNr2", file="steel.ifc", same_as=(gone.key,))
    gone = gone._replace(same_as=(twin.key,))
    others = [one for one in moved.elements if one is not beam]
    return moved._replace(elements=(*others, gone, twin), unexplained=(THING,))


@pytest.fixture(scope="module")
def file(told, tmp_path_factory):
    path = tmp_path_factory.mktemp("bcf") / "mismatches.bcf"
    write_bcf(path, told, "Tower", WHEN)
    return path


def test_each_has_a_topic_once_that_another_reader_reads(told, file, opened, tmp_path):
    check_schema(content_of(file))
    write_bcf(tmp_path / "older.bcf", told, "Tower", WHEN, version="2.1")
    check_schema(content_of(tmp_path / "older.bcf"), "2.1")
    read = opened(file)
    topics = by_index(read)
    assert len(topics) == len(told.mismatches) + 2
    beam, thing = topics[-2:]
    gone = next(one for one in told.elements if one.ifc_class == "IfcBeam")
    assert beam.topic.title.startswith("Removed IfcBeam 'B & 7' at x ") and beam.topic.labels.label == ["removed"]
    assert all(words in beam.topic.description for words in (gone.guid, "0.960", "The same as 3O2F", "of steel.ifc"))
    info = only(beam.viewpoints.values()).visualization_info
    assert only(info.components.selection.component).ifc_guid == gone.guid and info.lines is None
    assert thing.topic.topic_type in read.extensions.topic_types.topic_type
    assert thing.topic.labels.label == ["unexplained"] and thing.topic.priority == "Low"
    assert set(thing.topic.labels.label) <= set(read.extensions.topic_labels.topic_label)
    overview = next(one for one in read.topics.values() if one.topic.topic_type == "Overview").topic
    assert overview.title == "Overview: 1 added, 3 removed, 1 else not in the model"
    assert beam.topic.title in overview.description and thing.topic.title in overview.description


def test_a_thing_is_drawn_where_it_stands_and_seen_from_the_sensor(told, file, opened):
    info = only(by_index(opened(file))[-1].viewpoints.values()).visualization_info
    drawn = np.array([
        [[end.x, end.y, end.z] for end in (line.start_point, line.end_point)] for line in info.lines.line
    ])  # fmt: skip
    np.testing.assert_allclose(drawn, corners_of(THING)[EDGES], atol=1e-9)
    camera = info.perspective_camera
    place = np.array([camera.camera_view_point.x, camera.camera_view_point.y, camera.camera_view_point.z])
    ahead = np.array([camera.camera_direction.x, camera.camera_direction.y, camera.camera_direction.z])
    np.testing.assert_array_equal(place, told.scans[0].pose[:3])
    np.testing.assert_allclose(place + ahead * np.linalg.norm(THING.center - place), THING.center, atol=1e-9)


def test_topics_of_things_are_bounded_and_their_names_never_clash(moved, tmp_path):
    write_bcf(tmp_path / "many.bcf", moved._replace(unexplained=(THING,) * (MOST_THINGS + 5)), "Tower", WHEN)
    content = content_of(tmp_path / "many.bcf")
    check_schema(content)
    count = sum(name.endswith("markup.bcf") for name in content)
    assert count == len(moved.mismatches) + MOST_THINGS + 1


def test_workbook_and_notebook_list_things(told, tmp_path):
    openpyxl = pytest.importorskip("openpyxl")
    write_workbook(tmp_path / "a.xlsx", told)
    (row,) = openpyxl.load_workbook(tmp_path / "a.xlsx")["Not in the model"].iter_rows(min_row=2, values_only=True)
    assert row == (1, 500, -250, 600, 1200, 600, 1100, 25, 140)
    html = detection_html(told)
    assert "1 not in the model" in html and "1.20, 0.60, 1.10" in html
    assert "not in the model" not in detection_html(told._replace(unexplained=()))


def test_snapshot_of_a_thing_shows_its_box(file):
    content = content_of(file)
    assert zipfile.is_zipfile(file)
    assert sum(name.endswith("snapshot.png") for name in content) == 6
