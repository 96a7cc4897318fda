"""Reads mesh files (OBJ, PLY, GLB, GLTF, STL) through trimesh: every node with a surface becomes one element."""

from pathlib import Path
from typing import Any

import numpy as np

from warp_scanner.buildings import AS_IT_IS, NO_STOREYS, Building, Found, Part, ReadOptions, assemble
from warp_scanner.scenes import CEILING, DOOR, FLOOR, FURNITURE, OTHER, PILLAR, WALL, WINDOW

SUFFIXES = (".obj", ".ply", ".glb", ".gltf", ".stl")
_WORDS = (("wall", WALL), ("column", PILLAR), ("pillar", PILLAR), ("door", DOOR), ("window", WINDOW), ("floor", FLOOR),
          ("slab", FLOOR), ("ceiling", CEILING), ("roof", CEILING), ("furniture", FURNITURE))  # fmt: skip


def read_mesh(path: Path | str, options: ReadOptions = AS_IT_IS) -> Building:
    """The building that a mesh file describes; a node is of the class that its name speaks of, if it does.

    Args:
        path: the file.
        options: unit and axes of the file, and whether doors and windows (by their names) are there.

    Raises:
        ValueError: missing; not readable; no faces; NaN vertices.
    """
    path = Path(path)
    if not path.is_file():
        raise ValueError(f"{path}: expected a file, found {'a folder' if path.is_dir() else 'nothing there'}")
    nodes = _nodes(path)
    parts, names = [], set()
    for name, mesh in nodes:
        semantic = next((semantic for word, semantic in _WORDS if word in name.lower()), OTHER)
        if (semantic == DOOR and options.doors == "open") or (semantic == WINDOW and options.glass == "transparent"):
            continue
        guid = next(g for n in range(len(nodes) + 1) if (g := f"{name}_{n}" if n else name) not in names)
        names.add(guid)
        vertices = np.asarray(mesh.vertices, np.float64) * options.unit
        if options.y_up:
            vertices = vertices @ np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
        parts.append(Part(guid, "", name, -1, semantic, vertices, np.asarray(mesh.faces, np.int64).reshape(-1, 3)))
    if not parts:
        raise ValueError(f"{path}: expected a mesh with faces, found none")
    return assemble(str(path), parts, Found(NO_STOREYS))


def _nodes(path: Path) -> list[tuple[str, Any]]:
    """Names and meshes of all nodes with faces, in world coordinates."""
    import trimesh  # slow to import, and generated rooms do not need it

    try:
        # Unprocessed: merging or dropping vertices would hide what is wrong with the file.
        scene = trimesh.load_scene(path, process=False, split_objects=True, group_material=False)
        nodes = []
        for node in scene.graph.nodes_geometry:
            matrix, name = scene.graph[node]
            mesh = scene.geometry[name]
            if isinstance(mesh, trimesh.Trimesh) and len(mesh.faces):
                nodes.append((str(node), mesh.copy().apply_transform(matrix)))
    except Exception as error:  # every format's parser raises classes of its own
        raise ValueError(f"{path}: not a readable mesh file: {' '.join(str(error).split())[:150]}") from error
    return nodes
