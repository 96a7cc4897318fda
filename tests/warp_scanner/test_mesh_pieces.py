"""A mesh without names: connected pieces, told by shape; exact by construction."""

import numpy as np
import pytest
import trimesh

from warp_scanner.buildings.mesh_files import read_mesh
from warp_scanner.buildings.mesh_pieces import class_of, pieces_of
from warp_scanner.scenes.scenes import FLOOR, OTHER, PILLAR, WALL

SOLIDS = {  # edges [m], class
    "wall": ((4.0, 0.2, 2.8), WALL), "short wall": ((0.9, 0.15, 2.6), WALL), "column": ((0.4, 0.4, 3.0), PILLAR),
    "slab": ((8.0, 6.0, 0.3), FLOOR), "cabinet": ((1.2, 0.5, 2.0), OTHER), "beam": ((5.0, 0.3, 0.5), OTHER),
    "room": ((5.0, 4.0, 3.0), OTHER),
}  # fmt: skip


def solid(edges, place=(0.0, 0.0, 0.0), degrees=0.0):
    turn = trimesh.transformations.rotation_matrix(np.radians(degrees), [0, 0, 1])
    turn[:3, 3] = place
    return trimesh.creation.box(edges, transform=turn)


@pytest.mark.parametrize("name", SOLIDS)
@pytest.mark.parametrize("degrees", [0, 33, 90])
def test_a_solid_is_told_by_its_shape_however_it_is_turned(name, degrees):
    edges, semantic = SOLIDS[name]
    assert class_of(solid(edges, (150_000.0, 470_000.0, 12.0), degrees).vertices) == semantic


def test_a_round_column_is_a_column():
    assert class_of(trimesh.creation.cylinder(0.25, 3.0).vertices) == PILLAR


def test_pieces_are_those_of_trimesh_and_hold_every_triangle_once():
    rng = np.random.default_rng(0)
    parts = [solid(rng.uniform(0.1, 2.0, 3), rng.uniform(-50, 50, 3), rng.uniform(0, 360)) for _ in range(40)]
    mesh = trimesh.util.concatenate(parts)
    soup = mesh.vertices[mesh.faces].reshape(-1, 3), np.arange(len(mesh.faces) * 3).reshape(-1, 3)  # as in an STL
    for vertices, faces in ((mesh.vertices, mesh.faces), soup):
        pieces = pieces_of(np.asarray(vertices), np.asarray(faces))
        assert len(pieces) == len(mesh.split(only_watertight=False)) == 40
        np.testing.assert_array_equal(
            np.sort(np.concatenate([p.faces for p in pieces]), axis=0), np.sort(faces, axis=0)
        )


@pytest.mark.parametrize("suffix", [".stl", ".obj", ".ply"])
def test_a_building_that_is_one_mesh_is_taken_apart_and_says_so(tmp_path, suffix):
    places = {"slab": (0, 0, -0.2), "wall": (0, 3.0, 1.5), "column": (2.0, 0.0, 1.6), "cabinet": (-3.0, -2.0, 1.1)}
    mesh = trimesh.util.concatenate([solid(SOLIDS[name][0], place) for name, place in places.items()])
    path = tmp_path / f"model{suffix}"
    mesh.export(path)
    building = read_mesh(path)
    assert sorted(building.elements.semantic.tolist()) == sorted(SOLIDS[name][1] for name in places)
    assert len(set(building.elements.guid)) == 4
    assert any("4 pieces: 1 walls, 1 columns, 1 floors" in note for note in building.notes)


def test_names_that_tell_are_believed(tmp_path):
    scene = trimesh.Scene()
    scene.add_geometry(solid(SOLIDS["column"][0]), node_name="Wall 1", geom_name="Wall 1")
    scene.add_geometry(solid(SOLIDS["wall"][0], (3, 3, 0)), node_name="thing", geom_name="thing")
    scene.export(tmp_path / "named.glb")
    building = read_mesh(tmp_path / "named.glb")
    assert dict(zip(building.elements.guid, building.elements.semantic, strict=True)) == {
        "Wall 1": WALL,
        "thing": OTHER,
    }
