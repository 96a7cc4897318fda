"""Figures of a detection: the geometry that they draw is right, and every kind of detection can be drawn."""

import io

import matplotlib.image
import numpy as np
import pytest
import trimesh
from matplotlib.text import Text

from jaxmm.reports.detection_figures import MOST_POINTS, panels_of, probability_figure, write_figures
from jaxmm.reports.panorama import box_edges, in_view, seen_from, sensor_frame
from jaxmm.reports.plan_cut import cut_surfaces
from jaxmm.reports.plan_figure import draw_plan, plan_figure
from jaxmm.reports.plan_levels import footprint, level_of_mismatches, levels_of
from jaxmm.verdicts.results import Mismatch
from tests.cases.detections import thinned, true_case
from warp_scanner.sensors.poses import rotation_of

pytestmark = pytest.mark.usefixtures("coarse")
GRID = np.array([192_340.125, 444_123.375, 12.5])  # [m] a place on a national grid
VERMILLION = np.array([213, 94, 0])


@pytest.fixture(scope="module")
def removed(tmp_path_factory):
    """A pillar and a wall are gone."""
    return true_case(tmp_path_factory.mktemp("removed")).detection


@pytest.fixture(scope="module")
def sparse(removed):
    """The same with a tenth of the points, for speed."""
    return thinned(removed)


def moved(detection, by):
    """The same detection elsewhere."""

    def at(pose):
        return (*(float(value) for value in np.array(pose[:3]) + by), *pose[3:])

    return detection._replace(
        mismatches=tuple(one._replace(center=one.center + by) for one in detection.mismatches),
        scans=tuple(one._replace(pose=at(one.pose)) for one in detection.scans),
        drawing=detection.drawing._replace(origin=detection.drawing.origin + by),
    )


def as_cloud(detection):
    """The same, the prior being points without elements."""
    none = dict.fromkeys(("vertices", "faces", "face_element"))
    element = np.full(len(detection.drawing.prior), -1, np.int32)
    drawing = detection.drawing._replace(prior_element=element, guid=(), **none)
    return detection._replace(
        elements=(), mismatches=tuple(one._replace(element=None) for one in detection.mismatches), drawing=drawing
    )


def twice(detection, rise=0.0, corners=None):
    """The same seen by a second scan, higher by `rise` [m] and turned about."""
    drawing, first = detection.drawing, detection.scans[0]
    x, y, z, yaw, pitch = first.pose
    second = first._replace(pose=(x, y, z + rise, yaw + 180.0, pitch))
    lifted = drawing.robot + np.array([0, 0, rise], np.float32)
    names = ("robot_probability", "robot_evidence")
    drawing = drawing._replace(
        robot=np.concatenate([drawing.robot, lifted]),
        robot_scan=np.repeat([0, 1], len(drawing.robot)).astype(np.int32),
        fields_of_view=(drawing.fields_of_view[0], np.zeros((0, 3), np.float32) if corners is None else corners),
        **{name: np.tile(getattr(drawing, name), 2) for name in names},
    )
    return detection._replace(scans=(first, second), drawing=drawing)


def area_of(outlines):
    """Signed area of closed lines."""
    total = 0.0
    for one in outlines:
        x, y = one.points.T
        total += 0.5 * np.sum(x[:-1] * y[1:] - x[1:] * y[:-1])
    return total


def cut(mesh, height):
    return cut_surfaces(np.asarray(mesh.vertices, np.float32), mesh.faces, np.zeros(len(mesh.faces), int), height)


@pytest.mark.parametrize(
    "mesh, area, count",
    [
        pytest.param(trimesh.creation.box((2, 3, 4)), 6.0, 1, id="box"),
        pytest.param(trimesh.creation.cylinder(1.0, 3.0, sections=4), 2.0, 1, id="four-sided cylinder"),
        pytest.param(trimesh.creation.annulus(1.0, 2.0, 3.0, sections=4), 6.0, 2, id="a hole counts against"),
        pytest.param(trimesh.creation.box((2, 3, 0.2)), 0.0, 0, id="below the cut"),
    ],
)
@pytest.mark.parametrize("welded", [True, False])
def test_the_area_of_a_cut(mesh, area, count, welded):
    if not welded:  # every face with corners of its own, as many files have it
        mesh = trimesh.Trimesh(
            mesh.triangles.reshape(-1, 3), np.arange(3 * len(mesh.faces)).reshape(-1, 3), process=False
        )
    outlines = cut(mesh, 0.3)
    assert len(outlines) == count and all(one.closed for one in outlines)
    assert area_of(outlines) == pytest.approx(area, abs=1e-5)


def test_cuts_agree_with_trimesh():
    pytest.importorskip("shapely")
    rng = np.random.default_rng(0)
    for _ in range(20):
        mesh = trimesh.creation.icosphere(1).apply_scale(rng.uniform(0.5, 3, 3))
        mesh.apply_transform(trimesh.transformations.random_rotation_matrix(rng.random(3)))
        height = rng.uniform(-0.4, 0.4)
        section = mesh.section([0, 0, 1], [0, 0, height])
        assert area_of(cut(mesh, height)) == pytest.approx(section.to_2D()[0].area, rel=1e-3)


def test_an_open_surface_gives_open_lines_and_no_segment_is_lost():
    box = trimesh.creation.box((2, 3, 4))
    upright = np.abs(box.face_normals[:, 2]) < 0.5
    faces = box.faces[upright][:-2]
    outlines = cut_surfaces(box.vertices, faces, np.zeros(len(faces), int), 0.3)
    assert [one.closed for one in outlines] == [False]
    crossed = sum(len(one.points) - 1 for one in outlines)
    assert crossed == len(faces)


def test_elements_are_cut_apart():
    boxes = [trimesh.creation.box((1, 1, 2)).apply_translation((2 * index, 0, 0)) for index in range(3)]
    vertices = np.concatenate([box.vertices for box in boxes])
    faces = np.concatenate([box.faces + 8 * index for index, box in enumerate(boxes)])
    rng = np.random.default_rng(0)
    order = rng.permutation(len(faces))
    outlines = cut_surfaces(vertices, faces[order], np.repeat([7, 3, 5], 12)[order], 0.0)
    assert sorted((one.element, round(one.points[:, 0].mean())) for one in outlines) == [(3, 2), (5, 4), (7, 0)]


@pytest.mark.parametrize(
    "away, azimuth, elevation",
    [([2, 0, 0], 0, 0), ([0, 3, 0], 90, 0), ([1, -1, 0], -45, 0), ([1, 0, 1], 0, 45), ([-1, 0, 0], -180, 0)],
)
def test_where_a_sensor_sees_what(away, azimuth, elevation):
    seen = seen_from((*GRID, 0.0, 0.0), np.array([away], np.float32), GRID)
    assert seen.azimuth[0] == pytest.approx(azimuth) and seen.elevation[0] == pytest.approx(elevation)
    assert seen.distance[0] == pytest.approx(np.linalg.norm(away))


def test_the_sensor_frame_is_that_of_the_scanner():
    rng = np.random.default_rng(0)
    for _ in range(100):
        yaw, pitch = rng.uniform(-360, 360), rng.uniform(-90, 90)
        away = rng.normal(size=(20, 3))
        turn = rotation_of(np.array([yaw]), np.array([pitch]))[0].astype(float)
        np.testing.assert_allclose(sensor_frame((0, 0, 0, yaw, pitch), away), away @ turn, atol=1e-5)


def test_the_edges_of_a_box_end_at_its_corners():
    rng = np.random.default_rng(0)
    for _ in range(50):
        one = Mismatch(
            "wall", "added", GRID + rng.uniform(-4, 4, 3), rng.uniform(0.2, 3, 3), rng.uniform(-180, 180), 0.9
        )
        pose = (*GRID, rng.uniform(-180, 180), 0.0)
        lines = box_edges(pose, one)
        assert len(lines) >= 12 and all(np.abs(np.diff(line[:, 0])).max(initial=0) <= 180 for line in lines)
        corners = footprint(one, GRID)
        heights = one.center[2] - GRID[2] + one.dimensions[2] / 2 * np.array([-1, 1])
        points = np.array([[*corner, z] for corner in corners for z in heights])
        seen = seen_from(pose, points, GRID)
        drawn = np.concatenate(lines)
        for place in np.column_stack([seen.azimuth, seen.elevation]):
            assert np.abs(drawn - place).max(axis=1).min() < 1e-6


def test_of_two_scans_each_shows_what_it_could_meet(removed):
    both = twice(removed)
    pose, drawing = both.scans[0].pose, both.drawing
    ahead = sensor_frame((0, 0, 0, -pose[3], 0.0), np.array([[2.0, 0, 0], [6.0, 0, 0], [-2.0, 0, 0], [2.0, 0, 3.0]]))
    seen = seen_from(pose, ahead + np.array(pose[:3]) - drawing.origin, drawing.origin)
    assert in_view(drawing, 0, pose, seen).tolist() == [True, False, False, False]  # hidden, behind, above
    assert in_view(drawing, 1, pose, seen).tolist() == [True, False, True, True]  # all round, but not the hidden one
    assert in_view(removed.drawing, 0, pose, seen).all()


def test_panels_hold_the_points_of_their_scan_and_stay_small(removed):
    panels = panels_of(twice(removed))
    assert [(one.scan, one.change) for one in panels] == [(0, "removed"), (0, "added"), (1, "removed"), (1, "added")]
    assert len(panels[1].probability) == len(panels[3].probability) == len(removed.drawing.robot)
    many = int(2.5 * MOST_POINTS)
    drawing = removed.drawing._replace(
        robot=np.resize(removed.drawing.robot, (many, 3)), robot_scan=np.zeros(many, np.int32),
        robot_probability=np.zeros(many, np.float32), robot_evidence=np.zeros(many, np.uint8),
    )  # fmt: skip
    panel = panels_of(removed._replace(drawing=drawing))[1]
    assert MOST_POINTS / 2 < len(panel.probability) <= MOST_POINTS
    assert (np.diff(panel.seen.distance) <= 0).all()  # what is near is drawn last


def test_scans_of_two_storeys_have_two_plans(removed):
    assert [one.scans for one in levels_of(twice(removed, 0.4))] == [(0, 1)]
    above = twice(removed, 3.2)
    levels = levels_of(above)
    assert [one.scans for one in levels] == [(0,), (1,)]
    assert levels[1].floor - levels[0].floor == pytest.approx(3.2, abs=1e-4)
    lifted = above.mismatches[0]._replace(center=above.mismatches[0].center + np.array([0, 0, 3.2]))
    above = above._replace(mismatches=(*above.mismatches, lifted))
    assert level_of_mismatches(above, levels).tolist() == [0, 0, 1]
    assert len(draw_plan(above).axes) == 2


@pytest.mark.parametrize("by", [np.zeros(3), GRID, -GRID])
def test_a_plan_tells_places_of_the_world(removed, by):
    """The number on an axis and what its label takes off give the sensor's place."""
    detection = moved(removed, by)
    axes = draw_plan(detection).axes[0]
    drawn = next(line.get_xydata()[0] for line in axes.lines if line.get_marker() == "o")
    for axis, label in enumerate((axes.get_xlabel(), axes.get_ylabel())):
        taken = float(label.split(" - ", 1)[1].removesuffix(" [m]")) if " - " in label else 0.0
        assert drawn[axis] + taken == pytest.approx(detection.scans[0].pose[axis], abs=1e-6)


VARIANTS = {
    "as it is": lambda one: one,
    "a cloud as prior": as_cloud,
    "nothing found": lambda one: one._replace(mismatches=()),
    "far from the origin": lambda one: moved(one, GRID),
    "two scans, one of them all round": twice,
    "two storeys": lambda one: twice(one, 3.2),
    "a box that is none": lambda one: one._replace(
        mismatches=tuple(box._replace(center=np.full(3, np.nan)) for box in one.mismatches)
    ),
    "round and turned": lambda one: one._replace(
        mismatches=tuple(box._replace(shape="round", rotation=-30.0) for box in one.mismatches)
    ),
    "no point of the robot": lambda one: one._replace(
        drawing=one.drawing._replace(
            robot=one.drawing.robot[:0], robot_probability=np.zeros(0, np.float32),
            robot_evidence=np.zeros(0, np.uint8), robot_scan=np.zeros(0, np.int32),
        )
    ),
}  # fmt: skip


@pytest.mark.parametrize("variant", VARIANTS)
def test_every_kind_of_detection_can_be_drawn(sparse, variant, tmp_path):
    paths = write_figures(tmp_path, VARIANTS[variant](sparse))
    assert sorted(path.name for path in paths) == ["evidence.png", "plan.png", "probability.png"]
    assert sorted(tmp_path.iterdir()) == sorted(paths)
    for path in paths:
        image = matplotlib.image.imread(path)
        assert min(image.shape[:2]) > 100 and image[..., :3].std() > 0.05


def test_the_same_detection_gives_the_same_bytes(sparse, tmp_path):
    first = [path.read_bytes() for path in write_figures(tmp_path, sparse)]
    assert [path.read_bytes() for path in write_figures(tmp_path, sparse)] == first


def test_a_plan_shows_what_is_gone_in_its_colour(removed, tmp_path):
    def vermillion(detection):
        plan_figure(detection, tmp_path / "plan.png")
        image = matplotlib.image.imread(io.BytesIO((tmp_path / "plan.png").read_bytes()), format="png")[..., :3]
        return int((np.abs(255 * image - VERMILLION).max(axis=2) < 30).sum())

    whole = removed._replace(mismatches=(), elements=tuple(one._replace(verdict="present") for one in removed.elements))
    assert vermillion(whole) == 0
    assert vermillion(removed) > 200


def test_a_number_in_the_plan_stands_away_from_the_sensor(sparse):
    """The name of a scan stands below its sensor."""
    one = sparse.mismatches[0]
    for way in ([1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]):
        at = (*(np.asarray(one.center)[:2] - way), *sparse.scans[0].pose[2:])
        scans = (sparse.scans[0]._replace(pose=tuple(map(float, at))),)
        axes = draw_plan(sparse._replace(mismatches=(one,), scans=scans)).axes[0]
        (number,) = (text for text in axes.texts if text.get_text() == "1")
        np.testing.assert_array_equal(np.sign(number.xyann), way)


def test_numbers_in_the_plan_do_not_cover_each_other_nor_the_sensor(sparse):
    one, (x, y, *_) = sparse.mismatches[0], sparse.scans[0].pose
    near = [one._replace(center=np.add(one.center, [0.1 * step, 0.05 * step, 0.0])) for step in range(6)]
    near.append(one._replace(center=np.array([x + 0.2, y - 0.3, one.center[2]])))
    figure = draw_plan(sparse._replace(mismatches=tuple(near)))
    figure.draw_without_rendering()
    words = [text for text in figure.axes[0].texts if text.get_text()]
    boxes = [Text.get_window_extent(text) for text in words]  # without the lines from them to their boxes
    assert {text.get_text() for text in words} >= {"1", "7", "scan 1"}
    for number, box in enumerate(boxes):
        assert not any(box.overlaps(other) for other in boxes[number + 1 :])


@pytest.mark.parametrize("seed", range(4))
def test_names_of_scans_cover_no_other_name_and_no_sensor(sparse, seed):
    """Of 11 stations some stand a stride apart."""
    x, y, *rest = sparse.scans[0].pose
    strides = np.random.default_rng(seed).uniform(-1.2, 1.2, (11, 2))
    scans = tuple(sparse.scans[0]._replace(pose=(x + right, y + ahead, *rest)) for right, ahead in strides.tolist())
    figure = draw_plan(sparse._replace(mismatches=(), scans=scans))
    figure.draw_without_rendering()
    axes = figure.axes[0]
    names = [text for text in axes.texts if text.get_text().startswith("scan ")]
    assert len(names) == 11
    boxes = [Text.get_window_extent(text) for text in names]
    marks = [axes.transData.transform(text.xy) for text in names]
    assert all(axes.bbox.contains(box.x0, box.y0) and axes.bbox.contains(box.x1, box.y1) for box in boxes)
    for number, box in enumerate(boxes):
        assert not any(box.overlaps(other) for other in boxes[number + 1 :])
        assert not any(box.contains(*mark) for mark in marks)


def test_a_number_in_a_panorama_stands_on_its_box_behind_the_sensor_too(sparse, tmp_path):
    x, y, z, _, _ = sparse.scans[0].pose
    one = next(one for one in sparse.mismatches if one.object_type == "pillar")
    toward = np.degrees(np.arctan2(one.center[1] - y, one.center[0] - x))
    for aside in (-3.0, 2.0):
        scans = (sparse.scans[0]._replace(pose=(x, y, z, float(toward) + 180.0 + aside, 0.0)),)
        figure = probability_figure(sparse._replace(scans=scans, mismatches=(one,)), tmp_path / "p.png")
        texts = [text for axes in figure.axes for text in axes.texts if text.get_text() == "1"]
        assert texts and all(abs(text.get_position()[0]) > 150.0 for text in texts)
