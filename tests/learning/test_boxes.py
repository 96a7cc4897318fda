"""Boxes on clouds whose answer is known, and on seeded random ones."""

import numpy as np
import pytest

from jaxmm.learning.box_match import match_boxes
from jaxmm.learning.boxes import Box, BoxSettings, distinct, fit_boxes, merge_walls

STEP = 0.09  # [m] between sampled points at most: near that of downsampled scans, and no divisor of DBSCAN's radius
FLOOR, CEILING = -1.5, 1.5


def spaced(low, high):
    """Evenly spaced numbers with both ends."""
    return np.linspace(low, high, int(np.ceil((high - low) / STEP - 1e-9)) + 1)


def lattice(*sides):
    """(n, 3) points of a grid; each side is a number or a (low, high) range."""
    axes = [spaced(*side) if isinstance(side, tuple) else np.array([side]) for side in sides]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


ROOM = np.concatenate([lattice((-5, 5), (-5, 5), FLOOR), lattice((-5, 5), (-5, 5), CEILING)])
HEIGHT = (-1.4, 1.4)  # what a changed object shows between floor and ceiling


def pillar_faces(x, y, width=0.4):
    """The two faces of a square pillar that a sensor at -x, -y sees; (x, y) is its near corner."""
    return np.concatenate([lattice((x, x + width), y, HEIGHT), lattice(x, (y + STEP, y + width), HEIGHT)])


def round_pillar(x, y, radius):
    """The half of a cylinder that faces -x."""
    arc = spaced(-np.pi / 2 * radius, np.pi / 2 * radius)
    angle, z = (array.ravel() for array in np.meshgrid(np.pi + arc / radius, spaced(*HEIGHT)))
    return np.column_stack([x + radius * np.cos(angle), y + radius * np.sin(angle), z])


def boxes_of(object_type, *changed, settings=None, extent=None):
    """Boxes of a room in which exactly the points of `changed` are certain to be changed."""
    points = np.concatenate([ROOM, *changed])
    probability = (np.arange(len(points)) >= len(ROOM)).astype(float)
    return fit_boxes(points, probability, object_type, settings, extent)


def assert_box(box, center, dimensions):
    np.testing.assert_allclose(box.center, center, atol=1e-9)
    np.testing.assert_allclose(box.dimensions, dimensions, atol=1e-9)


@pytest.mark.parametrize(
    "object_type, changed, center, dimensions, shape",
    [
        pytest.param("pillar", pillar_faces(1, 2), [1.2, 2.2, 0], [0.4, 0.4, 3], "rectangular", id="pillar, two faces"),
        pytest.param("pillar", round_pillar(1, 2, 0.28), [0.86, 2, 0], [0.28, 0.56, 3], "round", id="half a cylinder"),
        pytest.param("wall", lattice((0, 4), 1, HEIGHT), [2, 1, 0], [4, 0.15, 3], "rectangular", id="wall along x"),
        pytest.param("wall", lattice(-2, (0, 4), HEIGHT), [-2, 2, 0], [0.15, 4, 3], "rectangular", id="wall along y"),
        pytest.param(
            "wall", lattice((0, 4), (1, 1.1), HEIGHT), [2, 1.05, 0], [4, 0.15, 3], "rectangular", id="both wall faces"
        ),
    ],
)
def test_one_object_gives_its_box(object_type, changed, center, dimensions, shape):
    (box,) = boxes_of(object_type, changed)
    assert_box(box, center, dimensions)
    assert (box.object_type, box.shape, box.rotation) == (object_type, shape, 0.0)
    assert (box.point_count, box.probability) == (len(changed), 1.0)
    other = "wall" if object_type == "pillar" else "pillar"
    assert boxes_of(other, changed) == []


def turned(points, degrees):
    angle = np.radians(degrees)
    turn = np.array([[np.cos(angle), np.sin(angle), 0], [-np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    return points @ turn


@pytest.mark.parametrize(
    "object_type, changed",
    [
        pytest.param("pillar", np.zeros((0, 3)), id="nothing changed"),
        pytest.param("pillar", lattice((0, 2), (0, 2), FLOOR), id="shadow on the floor"),
        pytest.param("wall", lattice((0, 4), (0, 0.2), FLOOR), id="long shadow on the floor"),
        pytest.param("pillar", lattice((0, 2), (0, 2), CEILING), id="shadow on the ceiling"),
        pytest.param("pillar", lattice((0, 2), (0, 2), (FLOOR + 0.1, FLOOR + 0.2)), id="flat thing above the floor"),
        pytest.param("pillar", pillar_faces(1, 2, 0.2)[pillar_faces(1, 2, 0.2)[:, 2] < -1.1], id="too few points"),
        pytest.param("wall", lattice((0, 0.4), 0, HEIGHT), id="wall shorter than half a metre"),
        pytest.param("wall", turned(lattice((0, 4), 0, HEIGHT), 6), id="wall more than 5 degrees off the axes"),
        pytest.param("wall", lattice((0, 4), (0, 0.3), HEIGHT), id="too thick for a wall"),
        pytest.param("pillar", pillar_faces(-1, -1, width=3.2), id="too wide for a pillar"),
    ],
)
def test_what_is_no_object_gives_no_box(object_type, changed):
    assert boxes_of(object_type, changed) == []


def test_a_wall_may_lean_up_to_five_degrees():
    (box,) = boxes_of("wall", turned(lattice((0, 4), 0, HEIGHT), 4))
    assert box.dimensions[1] == 0.15


def test_objects_apart_from_each_other_give_one_box_each_and_most_points_first():
    small, large = pillar_faces(1, 2), pillar_faces(-3, -2, width=0.8)
    shadow = lattice((3, 4), (-2, 0), FLOOR)
    first, second = boxes_of("pillar", small, shadow, large)
    assert_box(first, [-2.6, -1.6, 0], [0.8, 0.8, 3])
    assert_box(second, [1.2, 2.2, 0], [0.4, 0.4, 3])


def test_a_pillar_on_its_shadow_keeps_its_width_only_with_trimming():
    shadow = lattice((1.5, 3.0), (2.0, 3.5), FLOOR)
    pillar = np.concatenate([pillar_faces(1, 2), lattice((1, 1.4), 2, FLOOR)])
    (box,) = boxes_of("pillar", pillar, shadow)
    assert_box(box, [1.2, 2.2, 0], [0.4, 0.4, 3])
    assert boxes_of("pillar", pillar, shadow, settings=BoxSettings(trim_z=False)) == []  # over 1 % lie on the floor
    loose = BoxSettings(trim_z=False, max_surface_share_pillar=1.0)
    (wide,) = boxes_of("pillar", pillar, shadow, settings=loose)
    assert wide.dimensions[0] > 1.9


def test_threshold_is_inclusive_and_probability_is_the_mean_over_the_points():
    changed = pillar_faces(1, 2)
    points = np.concatenate([ROOM, changed])
    probability = np.zeros(len(points))
    probability[len(ROOM) :] = 0.6
    assert len(fit_boxes(points, probability, "pillar")) == 1
    assert fit_boxes(points, np.minimum(probability, 0.5999), "pillar") == []
    probability[len(ROOM) :] = np.linspace(0.6, 1.0, len(changed))
    assert fit_boxes(points, probability, "pillar")[0].probability == pytest.approx(0.8)


def test_floor_and_ceiling_ignore_stray_points_and_may_be_given():
    stray = lattice((4, 4.1), (4, 4.1), (-9, -8)), lattice((4, 4.1), (4, 4.1), (8, 9))
    points = np.concatenate([ROOM, *stray, pillar_faces(1, 2)])
    probability = np.zeros(len(points))
    probability[-len(pillar_faces(1, 2)) :] = 1.0
    assert_box(fit_boxes(points, probability, "pillar")[0], [1.2, 2.2, 0], [0.4, 0.4, 3])
    (given,) = fit_boxes(points, probability, "pillar", extent=(-2.0, 2.0))
    assert_box(given, [1.2, 2.2, 0], [0.4, 0.4, 4])


def test_without_stretching_the_box_keeps_the_height_of_its_cluster():
    (box,) = boxes_of("pillar", pillar_faces(1, 2), settings=BoxSettings(stretch=False))
    assert_box(box, [1.2, 2.2, 0], [0.4, 0.4, 2.8])
    half = pillar_faces(1, 2)
    half = half[half[:, 2] < 0]
    assert len(boxes_of("pillar", half)) == 1
    assert boxes_of("pillar", half, settings=BoxSettings(stretch=False)) == []  # lower than 2 m


def wall_box(low, high, y=0.0, points=100, probability=1.0):
    center, dimensions = np.array([(low + high) / 2, y, 0.0]), np.array([high - low, 0.15, 3.0])
    return Box("wall", center, dimensions, probability=probability, point_count=points)


def test_two_pieces_of_one_wall_become_one_box():
    pieces = lattice((0, 2), 1, HEIGHT), lattice((2.3, 4), 1, HEIGHT)
    far, near = BoxSettings(), BoxSettings(merge_gap=0.31)
    assert [len(boxes_of("wall", *pieces, settings=settings)) for settings in (far, near)] == [2, 1]
    (whole,) = boxes_of("wall", *pieces, settings=near)
    assert_box(whole, [2, 1, 0], [4, 0.15, 3])
    assert whole.point_count == sum(map(len, pieces))


def test_merging_chains_weighs_probabilities_and_leaves_other_walls_alone():
    # Out of order on purpose: the outer two only meet through the middle one.
    pieces = [wall_box(0, 1, probability=0.7), wall_box(2.2, 3), wall_box(1.1, 2.1, points=300, probability=0.9)]
    crossing = Box("wall", np.array([1.0, 0.0, 0.0]), np.array([0.15, 4.0, 3.0]), point_count=50)
    beside = wall_box(0, 3, y=0.16)
    merged = merge_walls([*pieces, crossing, beside], BoxSettings())
    assert len(merged) == 3
    assert_box(merged[0], [1.5, 0, 0], [3, 0.15, 3])
    assert merged[0].point_count == 500
    assert merged[0].probability == pytest.approx((0.7 * 100 + 1.0 * 100 + 0.9 * 300) / 500)


def test_a_box_that_grew_is_compared_again_with_those_already_passed():
    # The second lies too far across from the first, and too far along from the third; not so from both together.
    assert len(merge_walls([wall_box(0, 10), wall_box(0, 1, y=0.2), wall_box(10.1, 12, y=0.14)], BoxSettings())) == 1
    assert len(merge_walls([wall_box(0, 10), wall_box(0, 1, y=0.2)], BoxSettings())) == 2


def test_of_two_near_boxes_the_one_with_more_points_stays():
    boxes = [wall_box(0, 1, points=10), wall_box(0.4, 1.4, points=20), wall_box(0.9, 1.9, points=5)]
    assert distinct(boxes, 0.5) == [1, 2]
    assert distinct(boxes, 0.3) == [1, 0, 2]


@pytest.mark.parametrize("seed", range(4))
def test_random_rooms_give_back_their_pillars_in_any_order_of_points(seed):
    rng = np.random.default_rng(seed)
    cells = rng.permutation(16)[:4]
    corners = np.column_stack([cells % 4, cells // 4]) * 2.4 - 4.5 + rng.uniform(0, 0.8, (4, 2))
    widths = rng.uniform(0.3, 1.3, 4)
    faces = [pillar_faces(*corner, width) for corner, width in zip(corners, widths, strict=True)]
    clutter = np.column_stack([rng.uniform(-5, 5, (200, 2)), rng.uniform(*HEIGHT, 200)])  # changed, but scattered
    shift = rng.uniform(-200, 200, 3)
    points = np.concatenate([ROOM, clutter, *faces]) + shift
    probability = (np.arange(len(points)) >= len(ROOM)).astype(float)

    found = fit_boxes(points, probability, "pillar")
    truth = [
        Box("pillar", np.array([*(corner + width / 2), 0.0]) + shift, np.array([width, width, 3.0]))
        for corner, width in zip(corners, widths, strict=True)
    ]
    assert len(found) == len(match_boxes(found, truth)) == 4
    order = rng.permutation(len(points))
    for box, again in zip(found, fit_boxes(points[order], probability[order], "pillar"), strict=True):
        assert_box(again, box.center, box.dimensions)


def test_a_flat_face_is_not_taken_for_a_huge_circle():
    face = lattice((0, 1), 0, HEIGHT)
    face[:, 1] = 0.002 * np.sin(np.pi * face[:, 0])  # 2 mm of bow in 1 m: a circle of 60 m radius
    (box,) = boxes_of("pillar", turned(face, 20))
    assert box.shape == "rectangular"


@pytest.mark.parametrize("seed", range(3))
def test_points_between_two_clusters_never_depend_on_the_order(seed):
    rng = np.random.default_rng(seed)
    points = rng.uniform(0, 2, (1500, 3)) * [1, 1, 0.7]  # so sparse that clusters touch at their rims
    settings = BoxSettings(min_distance=0.0, pillar_width=(0.0, 9.0), pillar_height=(0.0, 9.0))
    found = fit_boxes(points, np.ones(len(points)), "pillar", settings)
    assert len(found) > 1
    for _ in range(5):
        again = fit_boxes(rng.permutation(points), np.ones(len(points)), "pillar", settings)
        assert [box.point_count for box in again] == [box.point_count for box in found]


def corner_of_walls(along_x, along_y):
    """Two walls that meet in an L."""
    return np.concatenate([lattice((0, along_x), 0, HEIGHT), lattice(0, (STEP, along_y), HEIGHT)])


@pytest.mark.parametrize(
    "settings, length",
    [
        pytest.param(BoxSettings(split_by_direction=True), 4.0, id="by direction"),
        pytest.param(BoxSettings(split_by_axes=True), 3.02, id="by principal axes"),  # cuts at the middle of the whole
    ],
)
def test_walls_that_meet_are_separated_only_when_asked(settings, length):
    walls = corner_of_walls(3.0, length)
    assert boxes_of("wall", walls) == []  # as the thesis found: one cluster too wide for any box
    boxes = boxes_of("wall", walls, settings=settings)
    along_x, along_y = sorted(boxes, key=lambda box: -box.dimensions[0])
    np.testing.assert_allclose(along_y.dimensions[:2], [0.15, length], atol=0.11)
    np.testing.assert_allclose(along_x.dimensions[:2], [3.0, 0.15], atol=0.11)
    np.testing.assert_allclose(along_y.center[:2], [0, length / 2], atol=0.1)
    np.testing.assert_allclose(along_x.center[:2], [1.5, 0], atol=0.1)


def test_separating_changes_nothing_where_walls_stand_apart():
    walls = lattice((0, 3), -2, HEIGHT), lattice(-4, (0, 4), HEIGHT)
    plain = boxes_of("wall", *walls)
    for settings in (BoxSettings(split_by_direction=True), BoxSettings(split_by_axes=True)):
        for box, again in zip(plain, boxes_of("wall", *walls, settings=settings), strict=True):
            assert_box(again, box.center, box.dimensions)


def test_a_shadow_joins_two_pillars_unless_it_is_trimmed_before_clustering():
    pillars = pillar_faces(1, 2), pillar_faces(3, 2)
    shadow = (lattice((1, 3.4), (2, 2.4), FLOOR),)
    assert len(boxes_of("pillar", *pillars, *shadow)) == 2
    (both,) = boxes_of("pillar", *pillars, *shadow, settings=BoxSettings(trim_when="after"))
    assert both.dimensions[0] == pytest.approx(2.4)
    assert both.point_count < sum(map(len, (*pillars, *shadow)))  # the shadow itself is trimmed all the same


def test_settings_are_those_released_with_the_thesis():
    released = BoxSettings()
    assert (released.threshold, released.surface_margin, released.trim_z) == (0.6, 0.02, True)
    assert (released.trim_when, released.split_by_axes, released.split_by_direction) == ("before", False, False)
    assert released.split_ratio == 5.0
    assert (released.cluster_radius, released.cluster_neighbours, released.min_points) == (0.2, 10, 30)
    assert (released.wall_thickness, released.merge_gap, released.min_distance) == (0.15, 0.15, 0.5)
    assert (released.wall_width, released.wall_length, released.wall_height) == ((0.05, 0.25), (0.5, 50), (2, 10))
    assert (released.pillar_width, released.pillar_height) == ((0.1, 3), (2, 10))


@pytest.mark.parametrize(
    "change, message",
    [
        ({"points": np.zeros((5, 2))}, r"points must be \(N, 3\), got \(5, 2\)"),
        ({"points": np.full((5, 3), np.nan)}, "points must be finite, got 5"),
        ({"probability": np.zeros(4)}, r"probability must be \(5,\).*got \(4,\)"),
        ({"probability": np.full(5, 1.5)}, r"probability must lie in \[0, 1\]"),
        ({"probability": np.full(5, np.nan)}, r"probability must lie in \[0, 1\]"),
        ({"extent": (1.0, -1.0)}, "extent must be floor and ceiling"),
        ({"object_type": "door"}, "object_type must be one of .*'door'"),
    ],
)
def test_bad_input_is_named(change, message):
    good = {"points": np.zeros((5, 3)), "probability": np.zeros(5), "object_type": "wall"}
    with pytest.raises(ValueError, match=message):
        fit_boxes(**(good | change))


@pytest.mark.parametrize(
    "change, message",
    [
        ({"threshold": 1.2}, "threshold must lie"),
        ({"floor_percentile": 99.5}, "floor_percentile must lie below"),
        ({"trim_when": "during"}, "trim_when must be before or after, got 'during'"),
        ({"cluster_radius": 0.0}, "cluster_radius must be positive"),
        ({"wall_length": (2.0, 1.0)}, r"wall_length must be \(low, high\)"),
    ],
)
def test_bad_settings_are_named(change, message):
    with pytest.raises(ValueError, match=message):
        BoxSettings(**change)


def test_an_empty_cloud_has_no_boxes():
    assert fit_boxes(np.zeros((0, 3)), np.zeros(0), "pillar") == []
