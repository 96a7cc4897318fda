"""Reads mesh files (OBJ, GLB and GLTF; PLY and STL through trimesh): every node with a surface becomes one element.

Where no node's name tells what it is, the mesh is taken apart at its gaps, and walls, pillars and floors are told by
shape; what is of one piece with everything else stays one element of no class.

Rays meet whatever surface there is, so open ones and edges of more than two triangles are kept; the latter are listed.
"""

from pathlib import Path
from typing import Any

import numpy as np

from warp_scanner.buildings.gltf_files import read_gltf
from warp_scanner.buildings.mesh_pieces import pieces_of
from warp_scanner.buildings.obj_files import MeshNode, read_obj, remarks_on_end
from warp_scanner.quiet import silent
from warp_scanner.scenes.building import AS_IT_IS, NO_STOREYS, Building, Failure, Found, Part, ReadOptions, assemble
from warp_scanner.scenes.scenes import CEILING, DOOR, FLOOR, FURNITURE, OTHER, PILLAR, WALL, WINDOW

SUFFIXES = (".obj", ".ply", ".glb", ".gltf", ".stl")
_GLTF = (".glb", ".gltf")  # their standard has y up
_READERS = {".obj": read_obj, ".glb": read_gltf, ".gltf": read_gltf}
_WORDS = (("wall", WALL), ("column", PILLAR), ("pillar", PILLAR), ("door", DOOR), ("window", WINDOW), ("floor", FLOOR),
          ("slab", FLOOR), ("ceiling", CEILING), ("roof", CEILING), ("furniture", FURNITURE))  # fmt: skip

_SHAPES = (("walls", WALL), ("columns", PILLAR), ("floors", FLOOR))
MOST_PIECES = 5000  # of a node; a mesh of more is of scanned points, not of a model


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
    nodes = _own_nodes(path) if path.suffix.lower() in _READERS else _nodes(path)
    y_up = path.suffix.lower() in _GLTF if options.y_up is None else options.y_up
    parts, names = [], set()
    for name, vertices, faces in nodes:
        semantic = next((semantic for word, semantic in _WORDS if word in name.lower()), OTHER)
        if (semantic == DOOR and options.doors == "open") or (semantic == WINDOW and options.glass == "transparent"):
            continue
        guid = next(g for n in range(len(nodes) + 1) if (g := f"{name}_{n}" if n else name) not in names)
        names.add(guid)
        vertices = vertices * options.unit
        if y_up:
            vertices = vertices @ np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
        parts.append(Part(guid, "", name, -1, semantic, vertices, faces))
    if not parts:
        raise ValueError(f"{path}: expected a mesh with faces, found none")
    parts, notes = _by_shape(parts) if all(part.semantic == OTHER for part in parts) else (parts, ())
    if path.suffix.lower() == ".obj":
        notes = (*notes, *remarks_on_end(path))
    flaws = [
        Failure(part.guid, "", part.name, f"more than two triangles meet in {count} of its edges")
        for part in parts
        if (count := crowded_edges(part.vertices, part.faces))
    ]
    return assemble(str(path), parts, Found(NO_STOREYS, notes=notes, flaws=tuple(flaws), unit=options.unit))


def _by_shape(parts: list[Part]) -> tuple[list[Part], tuple[str, ...]]:
    """The connected pieces of all parts, each of the class that its shape speaks of, and what was done, in words."""
    told: list[Part] = []
    for part in parts:
        sound = np.isfinite(part.vertices).all() and len(part.faces) and 0 <= part.faces.min() <= part.faces.max()
        pieces = pieces_of(part.vertices, part.faces) if sound and part.faces.max() < len(part.vertices) else []
        if not 0 < len(pieces) <= MOST_PIECES:
            told.append(part)
            continue
        for number, piece in enumerate(pieces):
            guid = part.guid if len(pieces) == 1 else f"{part.guid}#{number}"
            told.append(part._replace(guid=guid, name=guid, semantic=piece.semantic, faces=piece.faces))
    if len({part.guid for part in told}) < len(told):  # a file may use such names itself
        return parts, ()
    count = {name: sum(part.semantic == kind for part in told) for name, kind in _SHAPES}
    classes = ", ".join(f"{number} {name}" for name, number in count.items())
    return told, (f"no name in the mesh tells what it is of; by the shape of its {len(told)} pieces: {classes}",)


def crowded_edges(vertices: np.ndarray, faces: np.ndarray) -> int:
    """How many edges more than two triangles share, which no surface of a solid (a manifold) has.

    Args:
        vertices: (V, 3) finite or not; equal ones are one corner, as files often repeat them.
        faces: (T, 3) corners; triangles that use a corner twice, or one that is not there, do not count.
    """
    faces = faces[((faces >= 0) & (faces < len(vertices))).all(axis=1)]
    _, corner = np.unique(vertices + 0.0, axis=0, return_inverse=True)  # 0.0 and -0.0 are one
    faces = np.sort(corner.reshape(-1)[faces], axis=1)
    faces = faces[(faces[:, 0] < faces[:, 1]) & (faces[:, 1] < faces[:, 2])]
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [0, 2]]])
    _, count = np.unique(edges[:, 0] * len(vertices) + edges[:, 1], return_counts=True)
    return int(np.sum(count > 2))


def _own_nodes(path: Path) -> list[MeshNode]:
    """Those of the formats that are read here."""
    try:
        return [node for node in _READERS[path.suffix.lower()](path) if len(node.faces)]
    except OSError as error:
        raise ValueError(f"{path}: cannot be read: {error.strerror}") from error
    except MemoryError as error:
        raise ValueError(f"{path}: promises more than fits into memory") from error


def _nodes(path: Path) -> list[MeshNode]:
    """Names and meshes of all nodes with faces, in world coordinates."""
    import trimesh  # slow to import, and generated rooms do not need it

    try:
        with silent("trimesh"):
            # Unprocessed: merging or dropping vertices would hide what is wrong with the file.
            scene = trimesh.load_scene(path, process=False)
            nodes = []
            for node in scene.graph.nodes_geometry:
                matrix, name = scene.graph[node]
                mesh = scene.geometry[name]
                if isinstance(mesh, trimesh.Trimesh) and len(mesh.faces):
                    _check_shapes(mesh)
                    moved = mesh.copy().apply_transform(matrix)
                    vertices, faces = np.asarray(moved.vertices, np.float64), np.asarray(moved.faces, np.int64)
                    nodes.append(MeshNode(str(node), vertices, faces.reshape(-1, 3)))
    except UnicodeEncodeError as error:
        raise ValueError(f"{path}: expected a name in UTF-8, which the library for meshes needs; rename it") from error
    except Exception as error:  # every format's parser raises classes of its own
        raise ValueError(f"{path}: not a readable mesh file ({type(error).__name__})") from error
    return nodes


def _check_shapes(mesh: Any) -> None:
    """The library takes vertices of two numbers, or none, as they come."""
    vertices, faces = np.shape(mesh.vertices), np.shape(mesh.faces)
    if len(vertices) != 2 or vertices[1] != 3 or len(faces) != 2 or faces[1] != 3:
        raise ValueError(f"vertices of shape {vertices} and faces of shape {faces}")
