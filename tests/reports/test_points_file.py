"""points.ply: signed distances of points to the model, against what they must be before and behind a wall."""

import numpy as np
import trimesh

from jaxmm.reports.plain_files import distance_colors, write_points
from jaxmm.verdicts.mismatch_points import signed_distances
from jaxmm.verdicts.results import Detection, Drawing, ScanRecord
from tests.cases.box_building import building_of
from warp_scanner.scenes.scenes import WALL

ORIGIN = np.array([155_000.25, 463_000.5, 12.0])


def detection_of(points, scans=((0.0, 0.0, 0.0), (9.0, 0.0, 0.0))):
    """Points (N, 3) [m], the first half of each from one of two sensors, and a wall from x = 3 to x = 3.4."""
    triangles = building_of((((3.2, 0.0, 0.0), (0.2, 5.0, 5.0), WALL),)).triangles
    points, count = np.asarray(points, np.float32), len(points)
    some, none = np.zeros(count, np.float32), np.zeros((0, 3), np.float32)
    drawing = Drawing(
        ORIGIN, points, some, some.astype(np.uint8), (np.arange(count) * 2 // max(count, 1)).astype(np.int32),
        none, none[:, 0], none[:, 0].astype(np.uint8), none[:, 0].astype(np.int32),
        ("wall",), triangles.vertices, triangles.faces, triangles.element, (none, none),
    )  # fmt: skip
    records = tuple(
        ScanRecord("a", count, (*(ORIGIN + place), 0.0, 0.0), "given", None, {}, {}) for place in np.array(scans)
    )
    return Detection((), (), records, {}, {}, {}, (), drawing)


def test_points_before_the_wall_are_positive_and_behind_its_face_negative_from_either_side():
    off = np.array([0.5, 0.023, -0.023, -0.15])
    near = [(3.0 - value, 0.3, 0.2) for value in off]  # seen from x = 0: before the face at 3.0, and behind it
    far = [(3.4 + value, 0.3, 0.2) for value in off]  # seen from x = 9: the same of the face at 3.4
    np.testing.assert_allclose(signed_distances(detection_of(near + far)), [*off, *off], atol=2e-6)


def test_the_file_is_read_back_with_all_digits(tmp_path):
    rng = np.random.default_rng(0)
    detection = detection_of(rng.uniform(-4, 4, (400, 3)))
    write_points(tmp_path / "points.ply", detection)
    data = trimesh.load(tmp_path / "points.ply").metadata["_ply_raw"]["vertex"]["data"]
    points = detection.drawing.robot.astype(np.float64) + ORIGIN
    np.testing.assert_array_equal(np.stack([data[axis] for axis in "xyz"], axis=1), points)
    told = signed_distances(detection)
    np.testing.assert_array_equal(data["scalar_distance"], told)
    box = trimesh.creation.box(bounds=[[3.0, -5.0, -5.0], [3.4, 5.0, 5.0]])
    expected = trimesh.proximity.closest_point(box, detection.drawing.robot)[1]
    np.testing.assert_allclose(np.abs(told), expected, atol=1e-5)
    assert set(data["scalar_scan"]) == {1, 2} and (told < 0).any() and (told > 0).any()
    np.testing.assert_array_equal(np.stack([data[name] for name in ("red", "green", "blue")], 1), distance_colors(told))


def test_colours_tell_before_from_behind_and_how_far():
    grey, brown, teal, pink = (163, 170, 177), (140, 81, 10), (1, 102, 94), (204, 121, 167)
    ends = distance_colors(np.array([0.0, -0.1, 0.1, -0.11, 4.0]))
    np.testing.assert_array_equal(ends, [grey, brown, teal, pink, pink])
    off = np.linspace(0.0, 0.1, 101)
    for way in (-1.0, 1.0):  # evenly from one to the other
        found = distance_colors(way * off).astype(float)
        expected = np.add.outer(1.0 - off / 0.1, np.zeros(3)) * grey + np.outer(off / 0.1, teal if way > 0 else brown)
        np.testing.assert_allclose(found, expected, atol=0.5)


def test_without_a_surface_nothing_is_written(tmp_path):
    detection = detection_of(np.zeros((3, 3)))
    cloud = detection.drawing._replace(vertices=None, faces=None, face_element=None)
    write_points(tmp_path / "points.ply", detection._replace(drawing=cloud))
    assert not list(tmp_path.iterdir())
    assert len(signed_distances(detection_of(np.zeros((0, 3))))) == 0
