"""A scene is a padded table of primitives, each with the element it belongs to and what that element is.

R rooms, K slots per room. World frame: metres, z up.
"""

from typing import NamedTuple

import numpy as np

GAP, BOX, CYLINDER = 0, 1, 2  # kinds of primitives; a gap is an empty slot

# Semantic classes, and their names by number.
NOTHING, FLOOR, CEILING, WALL, PILLAR, DOOR, TABLE, CHAIR, WINDOW, FURNITURE, OTHER, CABINET, CARTON, PERSON = range(14)
CLASS_NAMES = (
    "nothing", "floor", "ceiling", "wall", "pillar", "door", "table", "chair", "window", "furniture", "other",
    "cabinet", "carton", "person",
)  # fmt: skip
STRUCTURE = (FLOOR, CEILING, WALL, PILLAR, DOOR)
_IS_STRUCTURE = np.isin(np.arange(256), STRUCTURE)


class Primitives(NamedTuple):
    """Upright boxes and cylinders of R rooms, K slots each; empty slots are gaps anywhere in the row."""

    kind: np.ndarray  # (R, K) uint8: GAP, BOX or CYLINDER (axis along z)
    center: np.ndarray  # (R, K, 3) float32 [m] world
    half_size: np.ndarray  # (R, K, 3) float32 [m] along the own axes; of a cylinder radius, radius, half height
    yaw: np.ndarray  # (R, K) float32 [rad] turn about z, counter-clockwise from world x
    element: np.ndarray  # (R, K) int32 id of the object the primitive is a part of; -1 in gaps
    semantic: np.ndarray  # (R, K) uint8; NOTHING in gaps


class Tags(NamedTuple):
    """What the primitives of a group are; numbers or arrays that broadcast to (R, N)."""

    kind: int | np.ndarray
    element: int | np.ndarray
    semantic: int


def solids(valid: np.ndarray, center: list, half_size: list, yaw: np.ndarray | float, tags: Tags) -> Primitives:
    """A table of (R, N) primitives from coordinates that broadcast to that shape; gaps are wiped clean."""
    shape = valid.shape

    def masked(value, dtype, gap):
        return np.where(valid, value, gap).astype(dtype)

    def stacked(values):
        return np.stack([masked(np.broadcast_to(value, shape), np.float32, 0.0) for value in values], axis=-1)

    return Primitives(
        masked(tags.kind, np.uint8, GAP), stacked(center), stacked(half_size), masked(yaw, np.float32, 0.0),
        masked(tags.element, np.int32, -1), masked(tags.semantic, np.uint8, 0),
    )  # fmt: skip


def is_structure(primitives: Primitives) -> np.ndarray:
    """(R, K) bool: True for what a building model holds, False for furniture and gaps."""
    return _IS_STRUCTURE[primitives.semantic] & (primitives.kind != GAP)


def take(primitives: Primitives, rooms: np.ndarray) -> Primitives:
    """The given rooms (indices or a mask) of a table."""
    return Primitives(*(field[rooms] for field in primitives))


def take_slots(primitives: Primitives, slots: slice) -> Primitives:
    """The given slots of all rooms."""
    return Primitives(*(field[:, slots] for field in primitives))


def join(*tables: Primitives) -> Primitives:
    """Tables of the same rooms side by side; slots keep their order."""
    return Primitives(*(np.concatenate(fields, axis=1) for fields in zip(*tables, strict=True)))


def scene_mesh(primitives: Primitives, room: int, sections: int = 64) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Triangles of one room, for viewers and for other ray casters.

    Args:
        primitives: the table.
        room: its row.
        sections: corners of the polygon that stands for a circle.

    Returns:
        vertices (V, 3) float64 [m] world, triangles (T, 3) int64, and the slot (T,) int64 each triangle comes from.
    """
    import trimesh  # slow to import, and casting rays does not need it

    meshes = []
    slots = np.flatnonzero(primitives.kind[room] != GAP)
    for slot in slots:
        size = 2.0 * primitives.half_size[room, slot].astype(np.float64)
        if primitives.kind[room, slot] == BOX:
            mesh = trimesh.creation.box(extents=size)
        else:
            mesh = trimesh.creation.cylinder(radius=size[0] / 2.0, height=size[2], sections=sections)
        turn = trimesh.transformations.rotation_matrix(float(primitives.yaw[room, slot]), [0, 0, 1])
        turn[:3, 3] = primitives.center[room, slot]
        meshes.append(mesh.apply_transform(turn))
    if not meshes:
        return np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64), np.zeros(0, dtype=np.int64)
    start = np.cumsum([0] + [len(mesh.vertices) for mesh in meshes[:-1]])
    vertices = np.concatenate([mesh.vertices for mesh in meshes])
    triangles = np.concatenate([mesh.faces + first for mesh, first in zip(meshes, start, strict=True)])
    return vertices, triangles, np.repeat(slots, [len(mesh.faces) for mesh in meshes])
