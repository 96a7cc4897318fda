"""Columns that are wider at some heights: boxes are of their shafts, and sections of the building's columns, too."""

import numpy as np
import pytest
import trimesh

from jaxmm.objects.finder import find_objects
from jaxmm.objects.patches import Sight
from jaxmm.objects.shafts import face_of_shaft, shaft_of
from jaxmm.verdicts.priors import shaft_size
from tests.cases.known_rooms import CEILING, FLOOR, judged, pillar, says, slab, wall
from warp_scanner.buildings.changes import Change
from warp_scanner.scenes.scenes import BOX, CYLINDER, PILLAR
from warp_scanner.sensors.triangles import Triangles

ACROSS = np.array([0.0, 1.0])


def around(width, low, high, yaw=0.0, kind=BOX):
    """What is wider than a column at (3, 0.3) from one height to another."""
    return slab((3.0, width), (0.3, width), low, high, yaw, kind)


@pytest.mark.parametrize("yaw", [0.0, 20.0, 45.0])
@pytest.mark.parametrize(
    "wider",
    [
        pytest.param([(1.1, 2.6, CEILING)], id="a drop head"),
        pytest.param([(0.7, 2.3, 2.65), (1.1, 2.65, CEILING)], id="a capital of two steps"),
        pytest.param([(0.9, FLOOR, 0.5)], id="a plinth"),
        pytest.param([(0.9, FLOOR, 0.4), (0.9, 2.5, CEILING)], id="both"),
        pytest.param([(0.9, 1.6, 1.9)], id="a corbel all around"),
    ],
)
def test_a_column_is_as_wide_as_its_shaft(wider, yaw):
    (found,) = find_objects(judged(pillar(3.0, 0.3, 0.4, yaw), *(around(*one, yaw=yaw) for one in wider)))
    assert found.box.object_type == "pillar" and found.box.probability > 0.5
    np.testing.assert_allclose(found.box.center, [3.0, 0.3, 1.5], atol=0.06)
    np.testing.assert_allclose(found.box.dimensions, [0.4, 0.4, 3.0], atol=0.08)


def test_a_round_shaft_under_a_round_capital_is_round():
    capital = around(1.1, 2.5, CEILING, kind=CYLINDER)
    (found,) = find_objects(judged(pillar(3.0, 0.3, 0.5, kind=CYLINDER), capital))
    assert (found.box.object_type, found.box.shape) == ("pillar", "round")
    np.testing.assert_allclose(found.box.center[:2], [3.0, 0.3], atol=0.03)
    np.testing.assert_allclose(found.box.dimensions, [0.5, 0.5, 3.0], atol=0.04)


def test_what_something_hides_may_be_as_wide_as_what_is_seen_of_it():
    """Two cupboards hide both sides of a wall of 1.4 m but for its top: it is no column with a capital."""
    cupboards = [slab((2.0, 0.5), (y, 0.6), FLOOR, 2.0) for y in (-0.55, 0.55)]
    seen = judged(wall(3.0, 0.0, 1.4, 0.2, 90), others=cupboards)
    new = np.flatnonzero(seen.wall > 0.5)
    width = [np.ptp(seen.points[new[high], 1]) for high in (seen.points[new, 2] < 2.0, seen.points[new, 2] > 2.6)]
    sight = Sight(seen.points, seen.sensor[np.zeros(len(seen.points), int)], FLOOR, CEILING)
    assert 0.5 < width[0] < 0.9 and width[1] > 1.2
    assert np.array_equal(shaft_of(sight, new, 0.05), new)
    assert np.array_equal(face_of_shaft(sight, new, ACROSS, 0.05), new)


@pytest.mark.parametrize(
    "wider",
    [
        pytest.param([slab((3.0, 0.4), (0.3, 1.1), 2.6, CEILING)], id="a head flush with it"),
        pytest.param([slab((3.0, 0.4), (0.3, 0.9), FLOOR, 0.2)], id="a flush plinth"),
        pytest.param([slab((3.0, 0.4), (0.3, 1.1), FLOOR, 0.5)], id="a higher one"),
        pytest.param([slab((3.0, 0.4), (0.3, 1.1), 1.8, 2.1)], id="corbels in its plane"),
    ],
)
def test_what_is_wider_in_the_plane_of_a_face_is_left_out(wider):
    (found,) = find_objects(judged(pillar(3.0, 0.3, 0.4), *wider))
    assert found.box.object_type == "pillar"
    np.testing.assert_allclose(found.box.center, [3.0, 0.3, 1.5], atol=0.06)
    np.testing.assert_allclose(found.box.dimensions, [0.4, 0.4, 3.0], atol=0.06)


@pytest.mark.parametrize("probability", [0.95, 0.05], ids=["surely new", "hardly new"])
def test_corbels_in_the_plane_of_a_side_are_left_out(probability):
    """One before the column, one behind. Where they are hardly new, they are added to the side that they continue."""
    seen = judged(pillar(3.0, 1.2, 0.4), slab((3.0, 1.1), (1.2, 0.4), 1.8, 2.1))
    corbel = (seen.apart > 0.0) & (np.abs(seen.points[:, 0] - 3.0) > 0.21)
    assert corbel.sum() > 10
    sides = {side: np.where(corbel, probability, getattr(seen, side)) for side in ("pillar", "wall")}
    (found,) = find_objects(seen._replace(**sides))
    assert found.box.object_type == "pillar"
    np.testing.assert_allclose(found.box.center, [3.0, 1.2, 1.5], atol=0.06)
    np.testing.assert_allclose(found.box.dimensions, [0.4, 0.4, 3.0], atol=0.06)


def test_benches_beside_a_column_make_it_no_shorter():
    benches = [slab((3.0, 0.4), (0.3 + side * 0.55, 0.7), FLOOR, 0.5) for side in (-1.0, 1.0)]
    (found,) = find_objects(judged(pillar(3.0, 0.3, 0.4), *benches), judge=says(0.02, 0.96, 0.02))
    assert (found.box.center[2], found.box.dimensions[2]) == pytest.approx((1.5, 3.0), abs=1e-6)


@pytest.mark.parametrize("pier", [0.6, 0.8, 1.0])
def test_a_pier_between_two_doors_is_of_their_wall(pier):
    lintel = slab((3.5, 0.2), (0.0, 2.4), 2.1, CEILING)
    (found,) = find_objects(judged(wall(3.5, 0.0, pier, 0.2, 90), lintel))
    assert found.box.object_type == "wall"
    np.testing.assert_allclose(found.box.dimensions[[0, 2]], [2.4, 3.0], atol=0.1)


def test_a_pier_between_two_windows_is_of_their_wall():
    bands = [slab((3.5, 0.2), (0.0, 2.4), *ends) for ends in ((FLOOR, 0.4), (2.4, CEILING))]
    (found,) = find_objects(judged(wall(3.5, 0.0, 0.8, 0.2, 90), *bands))
    assert found.box.object_type == "wall"
    np.testing.assert_allclose(found.box.dimensions[[0, 2]], [2.4, 3.0], atol=0.1)


def test_a_wall_with_a_door_at_its_end_is_whole():
    lintel = slab((3.0, 0.2), (0.95, 0.9), 2.1, CEILING)
    (found,) = find_objects(judged(wall(3.0, 0.0, 1.0, 0.2, 90), lintel), judge=says(0.02, 0.02, 0.96))
    assert found.box.object_type == "wall" and found.box.dimensions[0] == pytest.approx(1.9, abs=0.08)


def test_what_one_looks_past_above_and_below_is_no_wall_however_high_it_is():
    """A lorry on its wheels, in a hall; what hangs from the ceiling may be a wall, and what stands on the floor."""
    sure = says(0.02, 0.02, 0.96)

    def is_wall(low, high, others=()):
        seen = judged(slab((4.0, 0.2), (0.0, 2.5), low, high), others=others)
        return bool(find_objects(seen, judge=sure))

    assert not is_wall(0.28, 2.72)
    assert is_wall(0.2, 2.72) and is_wall(0.28, CEILING) and is_wall(FLOOR, 2.72)
    assert is_wall(0.28, 2.72, [slab((3.5, 0.2), (0.0, 2.0), FLOOR, 0.5)])  # a crate hides what is below


def change_of(mesh, yaw, size):
    """A column as a building has it, whose box is as large as it is at its widest."""
    mesh.apply_transform(trimesh.transformations.rotation_matrix(np.radians(yaw), [0, 0, 1]))
    mesh.apply_translation([7.0, -2.0, 1.5])
    faces = np.asarray(mesh.faces, np.int32)
    triangles = Triangles(np.asarray(mesh.vertices, np.float32), faces, np.zeros(len(faces), np.int32), PILLAR)
    return Change(triangles, np.array([7.0, -2.0, 1.5]), np.array(size), yaw, PILLAR)


@pytest.mark.parametrize("yaw", [0.0, 33.0, -70.0])
def test_the_section_of_a_column_is_that_halfway_up(yaw):
    shaft = trimesh.creation.box(extents=[0.5, 0.3, 3.0])
    head = trimesh.creation.box(extents=[1.2, 0.9, 0.4])
    head.apply_translation([0.0, 0.0, 1.3])
    whole = change_of(trimesh.util.concatenate([shaft, head]), yaw, [1.2, 0.9, 3.0])
    np.testing.assert_allclose(shaft_size(whole), [0.5, 0.3], atol=1e-6)
    plain = change_of(trimesh.creation.box(extents=[0.5, 0.3, 3.0]), yaw, [0.5, 0.3, 3.0])
    np.testing.assert_allclose(shaft_size(plain), plain.size[:2], atol=1e-6)
    split = [trimesh.creation.box(extents=[0.5, 0.3, 1.0]) for _ in range(2)]
    for part, z in zip(split, (-1.0, 1.0), strict=True):  # open halfway up
        part.apply_translation([0.0, 0.0, z])
    assert shaft_size(change_of(trimesh.util.concatenate(split), yaw, [0.5, 0.3, 3.0])).tolist() == [0.5, 0.3]
    bolt = trimesh.creation.box(extents=[0.02, 0.1, 1.0])
    bolted = change_of(trimesh.util.concatenate([*split, bolt]), yaw, [0.5, 0.3, 3.0])
    assert shaft_size(bolted).tolist() == [0.5, 0.3]
