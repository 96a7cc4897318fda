import io
import math

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from PIL import Image

from jaxmm.reports.snapshots import (
    ASPECT_RATIO,
    COLORS,
    EDGES,
    FIELD_OF_VIEW,
    best_scan,
    camera_at,
    corners_of,
    project,
    snapshot,
    stepped_back,
)
from jaxmm.verdicts.results import Drawing, Mismatch
from tests.cases.detections import true_case

SIZE = (640, 480)


@pytest.fixture(scope="module")
def cases(tmp_path_factory):
    """The detections of a room where things were removed, and of one where a wall was added."""
    names = (("pillar_and_wall_removed", 0), ("pillar_and_wall_removed", 1), ("wall_added", 1))
    return [true_case(tmp_path_factory.mktemp("case"), *name).detection for name in names]


def some_boxes(count=300):
    """Boxes anywhere around sensors anywhere, some of which stand in the box."""
    rng = np.random.default_rng(5)
    for _ in range(count):
        pose = (*rng.uniform(-5, 5, 3), rng.uniform(-180, 180), rng.uniform(-60, 60))
        center = np.array(pose[:3]) + rng.normal(size=3) * rng.choice([0.1, 1.0, 8.0])
        yield pose, Mismatch("wall", "added", center, rng.uniform(0.05, 6.0, 3), rng.uniform(-180, 180), 0.9)


def pixels_of(points, camera):
    """Column and row (n, 2) where a pinhole sees points (n, 3): the usual matrices, for OpenGL's clip space."""
    side = np.cross(camera.direction, camera.up)
    view = np.eye(4)
    view[:3, :3] = [side, camera.up, -camera.direction]
    view[:3, 3] = -view[:3, :3] @ camera.position
    f = 1 / math.tan(math.radians(FIELD_OF_VIEW) / 2)
    lens = np.array([[f / ASPECT_RATIO, 0, 0, 0], [0, f, 0, 0], [0, 0, -1, -0.1], [0, 0, -1, 0]])
    clip = np.column_stack([points, np.ones(len(points))]) @ (lens @ view).T
    place = clip[:, :2] / clip[:, 3:]
    return (place * [1, -1] + 1) / 2 * SIZE


def image_of(png):
    image = Image.open(io.BytesIO(png))
    assert (image.format, image.size) == ("PNG", SIZE)
    return np.asarray(image.convert("RGB"), float) / 255


def share_colored(image, pixels, color):
    """Of these places (n, 2), how many have the colour in one of the 3 x 3 pixels around them."""
    padded = np.pad(np.abs(image - to_rgb(color)).max(axis=-1) < 0.03, 1)
    column, row = np.floor(pixels).astype(int).T
    return np.mean([padded[row + dy, column + dx] for dy in range(3) for dx in range(3)], axis=0).astype(bool).mean()


def test_camera_stands_at_the_sensor_and_looks_at_the_target():
    for pose, box in some_boxes():
        camera = camera_at(pose, box.center)
        frame = np.stack([camera.direction, camera.up, np.cross(camera.direction, camera.up)])
        np.testing.assert_allclose(frame @ frame.T, np.eye(3), atol=1e-12)
        np.testing.assert_array_equal(camera.position, pose[:3])
        place, depth = project(camera, box.center[None])
        np.testing.assert_allclose(place, 0, atol=1e-9)
        np.testing.assert_allclose(depth, np.linalg.norm(box.center - pose[:3]))
        assert camera.up[2] >= 0


ODD_TARGETS = {  # of a sensor that faces +y, 45 degrees up: offset of the target, line of sight, up
    "above": ((0, 0, 5), (0, 0, 1), (0, -1, 0)),
    "below": ((0, 0, -5), (0, 0, -1), (0, 1, 0)),
    "in the sensor itself": ((0, 0, 0), (0, math.sqrt(0.5), math.sqrt(0.5)), (0, -math.sqrt(0.5), math.sqrt(0.5))),
}


@pytest.mark.parametrize("case", ODD_TARGETS)
def test_camera_has_an_upright_picture_wherever_the_target_is(case):
    offset, direction, up = ODD_TARGETS[case]
    camera = camera_at((1.0, 2.0, 3.0, 90.0, 45.0), np.array([1.0, 2.0, 3.0]) + offset)
    np.testing.assert_allclose(camera.direction, direction, atol=1e-9)
    np.testing.assert_allclose(camera.up, up, atol=1e-9)


def test_corners_and_edges_are_those_of_the_box():
    for _, box in some_boxes():
        corners = corners_of(box)
        np.testing.assert_allclose(corners.mean(axis=0), box.center, atol=1e-9)
        edges = corners[EDGES[:, 1]] - corners[EDGES[:, 0]]
        yaw = math.radians(box.rotation)
        first = np.array([math.cos(yaw), math.sin(yaw), 0.0]) * box.dimensions[0]
        assert sum(np.allclose(edge, first) for edge in edges) == 4  # the first size lies along the box's own axis
        np.testing.assert_allclose(sorted(np.linalg.norm(edges, axis=1)), sorted(np.tile(box.dimensions, 4)))


def test_project_agrees_with_the_matrices_of_a_pinhole():
    for pose, box in some_boxes():
        camera = camera_at(pose, box.center)
        points = camera.position + 3 * camera.direction + np.random.default_rng(1).normal(size=(50, 3))
        place, depth = project(camera, points)
        ahead = depth > 0.1
        expected = pixels_of(points[ahead], camera)
        np.testing.assert_allclose((place[ahead] * [1, -1] + 1) / 2 * SIZE, expected, atol=1e-6)


def test_stepping_back_shows_the_whole_box_and_not_more_than_needed():
    steps = []
    for pose, box in some_boxes():
        camera = camera_at(pose, box.center)
        moved, step = stepped_back(camera, corners_of(box))
        place, depth = project(moved, corners_of(box))
        assert (np.abs(place) <= 0.8 + 1e-9).all() and (depth >= 0.3 - 1e-9).all()
        np.testing.assert_allclose(moved.position, camera.position - step * camera.direction)
        if step:  # a corner is at the limit, so a shorter step would not do
            assert max(np.abs(place).max() - 0.8, 0.3 - depth.min()) == pytest.approx(0.0, abs=1e-9)
        steps.append(step)
    assert min(steps) == 0.0 < max(steps)


def test_snapshot_shows_every_box_where_a_pinhole_sees_it(cases):
    for detection in cases:
        for one in detection.mismatches:
            camera = camera_at(detection.scans[0].pose, one.center)
            png = snapshot(detection.drawing, one, camera)
            assert len(png) < 150_000
            corners = corners_of(one)
            along = np.linspace(0.02, 0.98, 60)[:, None, None]
            edges = (corners[EDGES[:, 0]] * (1 - along) + corners[EDGES[:, 1]] * along).reshape(-1, 3)
            pixels = pixels_of(edges, stepped_back(camera, corners)[0])
            image, color = image_of(png), COLORS[one.mismatch_type]
            assert share_colored(image, pixels, color) > 0.97
            away = pixels + np.array([25, 0])
            other = next(value for value in COLORS.values() if value != color)
            assert share_colored(image, away[away[:, 0] < SIZE[0]], color) < 0.7
            assert share_colored(image, pixels, other) < 0.1


def test_snapshot_colors_points_by_their_probability(cases):
    for detection in cases:
        one, drawing = detection.mismatches[0], detection.drawing
        camera = camera_at(detection.scans[0].pose, one.center)
        counts = []
        for probability in (0.0, 1.0):
            sure = drawing._replace(
                robot_probability=np.full(len(drawing.robot), probability, np.float32),
                prior_probability=np.full(len(drawing.prior), probability, np.float32),
            )
            image = image_of(snapshot(sure, one, camera))
            grey = np.ptp(image, axis=-1) < 0.02
            counts.append((~grey).sum())
        assert counts[1] > counts[0] + 5000


def test_snapshot_hides_what_is_farther(cases):
    """Surely added points on a sheet before the camera hide the room; on one behind the room they are hidden."""
    drawing, one = cases[2].drawing, cases[2].mismatches[0]
    one = one._replace(mismatch_type="removed")  # the box must not have the sheet's colour
    camera = camera_at(cases[2].scans[0].pose, one.center)
    side = np.cross(camera.direction, camera.up)
    grid = np.stack(np.meshgrid(np.linspace(-1, 1, 200), np.linspace(-1, 1, 200)), axis=-1).reshape(-1, 2)
    counts = []
    for depth in (1.0, 40.0):
        sheet = camera.position + depth * (camera.direction + grid[:, :1] * side + grid[:, 1:] * camera.up)
        points = np.concatenate([drawing.robot, (sheet - drawing.origin).astype(np.float32)])
        probability = np.r_[np.zeros(len(drawing.robot)), np.ones(len(sheet))].astype(np.float32)
        image = image_of(snapshot(drawing._replace(robot=points, robot_probability=probability), one, camera))
        counts.append((np.abs(image - to_rgb(COLORS["added"])).max(axis=-1) < 0.03).mean())
    assert counts[0] > 0.7 > 0.5 > counts[1]


def test_snapshot_of_many_points_stays_small_and_of_none_still_shows_the_box(cases):
    one, scan = cases[0].mismatches[0], cases[0].scans[0]
    camera, rng = camera_at(scan.pose, one.center), np.random.default_rng(3)
    for count in (0, 300_000):
        points = rng.uniform(-6, 6, (count, 3)).astype(np.float32)
        axis = rng.integers(0, 3, count)  # onto the six sides of a room
        points[np.arange(count), axis] = rng.choice([-6, 6], count) + rng.normal(0, 0.01, count)
        chance, zero, gap = (
            (rng.random(count) ** 8).astype(np.float32),
            np.zeros(count, np.uint8),
            np.full(count, -1, np.int32),
        )
        cloud = points, chance, zero
        drawing = Drawing(np.zeros(3), *cloud, gap + 1, *cloud, gap, (), None, None, None, (np.zeros((0, 3)),))
        png = snapshot(drawing, one, camera)
        assert len(png) < 150_000
        pixels = pixels_of(corners_of(one), stepped_back(camera, corners_of(one))[0])
        assert share_colored(image_of(png), pixels, COLORS["removed"]) == 1.0


def test_best_scan_is_the_one_whose_rays_reach_the_box(cases):
    """Of three scans one was cut off before the box, one looked the other way, and one reached it: in any order."""
    detection = cases[0]
    one, scan, drawing = detection.mismatches[0], detection.scans[0], detection.drawing
    sensor = np.array(scan.pose[:3]) - drawing.origin
    reach = np.linalg.norm(drawing.robot - sensor, axis=1, keepdims=True)
    least = np.linalg.norm(corners_of(one) - np.array(scan.pose[:3]), axis=1).min()
    short = sensor + (drawing.robot - sensor) * np.minimum(1.0, (least - 0.5) / reach)
    clouds = [drawing.robot, short, 2 * sensor - drawing.robot]
    for order in ([0, 1, 2], [1, 0, 2], [2, 1, 0], [1, 2]):
        robot = np.concatenate([clouds[number] for number in order]).astype(np.float32)
        number = np.repeat(np.arange(len(order)), len(drawing.robot)).astype(np.int32)
        told = detection._replace(scans=(scan,) * len(order), drawing=drawing._replace(robot=robot, robot_scan=number))
        assert best_scan(told, one) == (order.index(0) if 0 in order else 0)
    with pytest.raises(ValueError, match="at least one scan"):
        best_scan(detection._replace(scans=()), one)


def test_snapshot_is_the_same_at_national_grid_coordinates(cases):
    detection, shift = cases[0], np.array([2_600_000.0, 1_200_000.0, 400.0])
    one, pose = detection.mismatches[0], detection.scans[0].pose
    near = snapshot(detection.drawing, one, camera_at(pose, one.center))
    far = one._replace(center=one.center + shift)
    moved = detection.drawing._replace(origin=detection.drawing.origin + shift)
    pose = (*(np.array(pose[:3]) + shift), *pose[3:])
    difference = np.abs(image_of(snapshot(moved, far, camera_at(pose, far.center))) - image_of(near))
    assert (difference.max(axis=-1) > 0.1).mean() < 0.002
