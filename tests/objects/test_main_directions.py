"""The directions that a building stands along, from its upright surfaces."""

import itertools

import numpy as np
import pytest
import trimesh

from jaxmm.objects.main_directions import grid_near, uprights_of, way_to_surface

STOREY = (-1.5, 1.5)
HERE = np.zeros(2)


def boxes(*placed):
    """Upright surface of boxes: full edges (3,) [m], turn [deg], place (2,) or (3,) [m]."""
    meshes = []
    for edges, turn, place in placed:
        pose = trimesh.transformations.rotation_matrix(np.radians(turn), [0, 0, 1])
        pose[: len(place), 3] = place
        meshes.append(trimesh.creation.box(edges, pose))
    return of_mesh(trimesh.util.concatenate(meshes))


def of_mesh(mesh):
    return uprights_of(mesh.vertices.astype(np.float32), mesh.faces.astype(np.int32), np.zeros(len(mesh.faces), int))


def off(found, degrees):
    assert 0.0 <= found < np.pi / 2
    return abs((np.degrees(found) - degrees + 45.0) % 90.0 - 45.0)


@pytest.mark.parametrize("seed", range(40))
def test_most_upright_surface_stands_along_it_whatever_else_is_there(seed):
    """Four walls and a floor, and columns turned at random, which together have less surface."""
    rng = np.random.default_rng(seed)
    turn = rng.uniform(-180.0, 180.0)
    x = np.array([np.cos(np.radians(turn)), np.sin(np.radians(turn))])
    y = np.array([-x[1], x[0]])
    walls = [((8.0, 0.2, 3.0), turn, side * 3 * y) for side in (-1, 1)]
    walls += [((0.2, 6.0, 3.0), turn, side * 4 * x) for side in (-1, 1)]
    columns = [((0.4, 0.4, 3.0), rng.uniform(0, 90), rng.uniform(-2, 2, 2)) for _ in range(5)]
    found = grid_near(boxes(((8.0, 6.0, 0.2), turn + 20.0, (0.0, 0.0)), *walls, *columns), HERE, *STOREY)
    assert off(found, turn) < 1e-3


@pytest.mark.parametrize("turn", [0.0, 1e-6, -1e-6, 0.5, 44.9, 45.0, 89.5, 90.0])
def test_any_direction_is_met_and_lies_below_a_quarter_turn(turn):
    assert off(grid_near(boxes(((5.0, 0.2, 3.0), turn, (0.0, 0.0))), HERE, *STOREY), turn) < 1e-3


def test_walls_half_on_either_side_of_a_border_of_two_steps_count_together():
    """The largest single step is of another direction."""
    pair = [((4.0, 0.2, 3.0), turn, (0.0, 0.0)) for turn in (-0.01, 0.01)]
    assert off(grid_near(boxes(*pair, ((6.0, 0.2, 3.0), 30.5, (0.0, 0.0))), HERE, *STOREY), 0.0) < 0.02


def test_a_wall_that_is_a_degree_off_does_not_move_it():
    walls = boxes(((8.0, 0.2, 3.0), 0.2, (0.0, 1.0)), ((4.0, 0.2, 3.0), 1.3, (0.0, -1.0)))
    assert off(grid_near(walls, HERE, *STOREY), 0.2) < 1e-3


def test_the_facets_of_round_columns_move_no_grid():
    wall = trimesh.creation.box((6.0, 0.2, 3.0))
    column = trimesh.creation.cylinder(1.5, 3.0, sections=64)  # as much surface as the wall has, in 16 directions
    assert off(grid_near(of_mesh(trimesh.util.concatenate([wall, column])), HERE, *STOREY), 0.0) < 1e-3


def test_wings_of_a_building_have_grids_of_their_own():
    wings = boxes(((20.0, 0.3, 3.0), 0.0, (0.0, 0.0)), ((60.0, 0.3, 3.0), 30.0, (80.0, 40.0)))
    assert off(grid_near(wings, HERE, *STOREY), 0.0) < 1e-3
    assert off(grid_near(wings, np.array([80.0, 38.0]), *STOREY), 30.0) < 1e-3
    for far, turn in ((1e5, 30.0), (-1e5, 0.0)):  # from afar, the nearer one
        assert off(grid_near(wings, np.array([far, far]), *STOREY), turn) < 1e-3


def test_a_long_wall_is_as_near_as_its_nearest_place_however_it_is_cut_into_triangles():
    wall, column = trimesh.creation.box((200.0, 0.3, 3.0)), trimesh.creation.box((0.5, 0.5, 3.0))
    turned = column.apply_transform(trimesh.transformations.rotation_matrix(np.radians(37.0), [0, 0, 1], [0, 0, 0]))
    turned.apply_translation([90.0, 2.0, 0.0])
    for mesh in (wall, wall.subdivide_to_size(2.0)):
        found = grid_near(of_mesh(trimesh.util.concatenate([mesh, turned])), np.array([92.0, 1.0]), *STOREY)
        assert off(found, 0.0) < 1e-3


def test_other_storeys_do_not_count():
    storeys = boxes(((8.0, 0.2, 3.0), 0.0, (0.0, 0.0, 0.0)), ((8.0, 0.2, 4.0), 30.0, (0.0, 0.0, 4.0)))
    assert off(grid_near(storeys, HERE, *STOREY), 0.0) < 1e-3
    assert off(grid_near(storeys, HERE, 2.0, 6.0), 30.0) < 1e-3


def test_without_upright_surface_there_is_none():
    level = trimesh.creation.box((4.0, 4.0, 1.0))
    level.update_faces(np.abs(level.face_normals[:, 2]) > 0.5)
    assert grid_near(of_mesh(level), HERE, *STOREY) is None
    nothing = uprights_of(np.zeros((0, 3), np.float32), np.zeros((0, 3), int), np.zeros(0, int))
    assert grid_near(nothing, HERE, *STOREY) is None
    assert way_to_surface(nothing, HERE, np.array([1.0, 0.0]), 0.0) == np.inf


def test_the_way_to_a_surface_is_as_long_as_a_level_ray_of_embree_s_or_of_trimesh_s():
    rng = np.random.default_rng(3)
    for _ in range(30):
        placed = [(rng.uniform(0.2, 4.0, 3), rng.uniform(0, 90), rng.uniform(-4, 4, 3)) for _ in range(12)]
        meshes = []
        for edges, turn, place in placed:
            pose = trimesh.transformations.rotation_matrix(np.radians(turn), [0, 0, 1])
            pose[:3, 3] = place
            meshes.append(trimesh.creation.box(edges, pose))
        mesh = trimesh.util.concatenate(meshes)
        uprights = of_mesh(mesh)
        angle = rng.uniform(-np.pi, np.pi, 40)
        start, along = rng.uniform(-5, 5, (40, 3)), np.column_stack([np.cos(angle), np.sin(angle), np.zeros(40)])
        place, ray, _ = mesh.ray.intersects_location(start, along, multiple_hits=False)
        expected = np.full(40, np.inf)
        expected[ray] = np.linalg.norm(place - start[ray], axis=1)
        assert 5 < np.isfinite(expected).sum() < 40
        found = [way_to_surface(uprights, *one) for one in zip(start[:, :2], along[:, :2], start[:, 2], strict=True)]
        np.testing.assert_allclose(found, expected, atol=1e-4)


@pytest.mark.parametrize(
    "height, way",
    [(-1.5, np.inf), (-1.4999, 2.0), (0.0, 2.0), (1.4999, 2.0), (1.5, 2.0), (1.5001, np.inf), (-1.5001, np.inf)],
)
def test_a_surface_is_met_above_its_foot_up_to_its_top(height, way):
    wall = boxes(((0.2, 4.0, 3.0), 0.0, (2.1, 0.0)))
    assert way_to_surface(wall, HERE, np.array([1.0, 0.0]), height) == pytest.approx(way, abs=1e-6)
    assert way_to_surface(wall, HERE, np.array([-1.0, 0.0]), height) == np.inf
    assert way_to_surface(wall, np.array([0.0, 2.1]), np.array([1.0, 0.0]), 0.0) == np.inf  # it passes by


@pytest.mark.parametrize("start, way", [(0.0, 1.0), (2.0, 0.0), (3.5, np.inf)])
@pytest.mark.parametrize("order", list(itertools.permutations(range(3))))
def test_a_sheet_in_the_line_of_the_way_is_met_at_its_nearer_end_or_right_here(start, way, order):
    sheet = np.array(
        [[1.0, 0.0, -1.0], [3.0, 0.0, -1.0], [2.0, 0.0, 1.0], [1.0, 0.0, 1.0], [3.0, 0.0, 1.0]], np.float32
    )
    faces = np.array([[0, 1, 2], [0, 2, 3], [1, 4, 2]])[:, order]
    uprights = uprights_of(sheet, faces, np.zeros(3, int))
    assert way_to_surface(uprights, np.array([start, 0.0]), np.array([1.0, 0.0]), 0.1) == pytest.approx(way, abs=1e-6)


def test_a_height_that_float32_would_round_to_that_of_a_top_is_above_it():
    """And nothing is divided by nothing, as where corners are told from triangles by another height."""
    wall = boxes(((0.2, 4.0, 2.6), 0.0, (2.1, 0.0)))
    assert float(np.float32(1.3)) < 1.3
    with np.errstate(all="raise"):
        for height, way in ((1.3, np.inf), (float(np.float32(1.3)), 2.0)):
            assert way_to_surface(wall, HERE, np.array([1.0, 0.0]), height) == pytest.approx(way, abs=1e-6)


def test_what_is_gone_is_passed_through():
    near, far = (trimesh.creation.box((0.2, 4.0, 3.0)).apply_translation([x, 0.0, 0.0]) for x in (1.1, 3.1))
    mesh = trimesh.util.concatenate([near, far])
    element = np.repeat([4, 2], [len(near.faces), len(far.faces)])
    uprights = uprights_of(mesh.vertices.astype(np.float32), mesh.faces, element)
    for gone, way in ((None, 1.0), ((), 1.0), ((2,), 1.0), ((4,), 3.0), ((2, 4), np.inf)):
        gone = None if gone is None else np.isin(np.arange(5), gone)
        assert way_to_surface(uprights, HERE, np.array([1.0, 0.0]), 0.0, gone) == pytest.approx(way, abs=1e-6)
