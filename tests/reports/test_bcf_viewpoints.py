"""Viewpoints of BCF topics: where the camera stands, what is selected, painted and drawn, and the picture beside it."""

import io

import numpy as np
import pytest
from PIL import Image

from jaxmm.reports.bcf import write_bcf
from jaxmm.reports.bcf_topics import global_id
from jaxmm.reports.snapshots import EDGES, best_scan, camera_at, corners_of, snapshot
from jaxmm.verdicts.results import Mismatch
from tests.cases.bcf_case import by_index, content_of, only

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


def test_removed_elements_are_selected_and_painted_and_added_ones_are_drawn(moved, written, opened):
    for one, topic in zip(moved.mismatches, by_index(opened(written)), strict=True):
        info = only(topic.viewpoints.values()).visualization_info
        assert info.components.visibility.default_visibility
        if one.mismatch_type == "removed":
            assert info.lines is None
            assert only(info.components.selection.component).ifc_guid == one.element
            painted = only(info.components.coloring.color)
            assert (painted.color, only(painted.components.component).ifc_guid) == ("D55E00", one.element)
        else:
            assert info.components.selection is None and info.components.coloring is None
            drawn = [(vector(line.start_point), vector(line.end_point)) for line in info.lines.line]
            np.testing.assert_array_equal(drawn, corners_of(one)[EDGES])


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
    assert len(pictures) == 3 == len(set(pictures))
    for data in pictures:
        assert len(data) < 150_000
        image = Image.open(io.BytesIO(data))
        image.load()
        assert (image.format, image.size) == ("PNG", (640, 480))
