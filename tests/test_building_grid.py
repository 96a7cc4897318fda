"""The directions that a building stands along, from its upright surfaces."""

import numpy as np
import pytest
import trimesh

from jaxmm.building_grid import grid_near
from warp_scanner.buildings import Triangles


def boxes(*placed):
    """Triangles of boxes: full edges (3,) [m], turn [deg], place (2,)."""
    meshes = []
    for edges, turn, place in placed:
        pose = trimesh.transformations.rotation_matrix(np.radians(turn), [0, 0, 1])
        pose[:2, 3] = place
        meshes.append(trimesh.creation.box(edges, pose))
    whole = trimesh.util.concatenate(meshes)
    element = np.zeros(len(whole.faces), np.int32)
    return Triangles(whole.vertices.astype(np.float32), whole.faces.astype(np.int32), element, np.zeros(1, np.uint8))


def off(found, degrees):
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
    found = grid_near(boxes(((8.0, 6.0, 0.2), turn + 20.0, (0.0, 0.0)), *walls, *columns), np.zeros(2))
    assert off(found, turn) < 0.3 and 0.0 <= found < np.pi / 2


@pytest.mark.parametrize("turn", [0.0, 0.2, 0.5, 44.9, 89.6, 90.0])
def test_directions_on_the_border_of_two_steps_are_met_too(turn):
    assert off(grid_near(boxes(((5.0, 0.2, 3.0), turn, (0.0, 0.0))), np.zeros(2)), turn) < 0.01


def test_the_facets_of_round_columns_move_no_grid():
    """Directions within a degree of a wall's, as those of a wall itself are after rounding."""
    walls = boxes(((8.0, 0.2, 3.0), 0.0, (0.0, 3.0)), ((0.2, 6.0, 3.0), 1e-5, (4.0, 0.0)))
    column = trimesh.creation.cylinder(1.0, 3.0, sections=64)
    vertices = np.concatenate([walls.vertices, column.vertices.astype(np.float32)])
    faces = np.concatenate([walls.faces, column.faces.astype(np.int32) + len(walls.vertices)])
    both = Triangles(vertices, faces, np.zeros(len(faces), np.int32), walls.semantic)
    assert off(grid_near(both, np.zeros(2)), 0.0) < 0.5


def test_wings_of_a_building_have_grids_of_their_own():
    wings = boxes(((20.0, 0.3, 3.0), 0.0, (0.0, 0.0)), ((60.0, 0.3, 3.0), 30.0, (80.0, 40.0)))
    assert off(grid_near(wings, np.zeros(2)), 0.0) < 0.01
    assert off(grid_near(wings, np.array([80.0, 38.0])), 30.0) < 0.01
    assert off(grid_near(wings, np.array([5000.0, 3000.0])), 30.0) < 0.01  # from afar, the larger one


def test_a_floor_alone_stands_along_nothing():
    floor = boxes(((4.0, 4.0, 1.0), 0.0, (0.0, 0.0)))
    level = np.ptp(floor.vertices[floor.faces][:, :, 2], axis=1) == 0.0
    assert grid_near(floor._replace(faces=floor.faces[level], element=floor.element[level]), np.zeros(2)) is None
