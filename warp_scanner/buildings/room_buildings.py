"""A generated room as a building: triangles with elements and a table of those, without a detour through a file."""

import numpy as np

from warp_scanner.scenes.building import Building, Elements, Storeys, Triangles
from warp_scanner.scenes.scenes import DOOR, FLOOR, PILLAR, WALL, Primitives, scene_mesh

_CLASSES = {WALL: "IfcWall", PILLAR: "IfcColumn", DOOR: "IfcDoor", FLOOR: "IfcSlab"}


def building_of_room(primitives: Primitives, room: int, sections: int = 64) -> tuple[Building, np.ndarray]:
    """One room of the table.

    Args:
        primitives: the table.
        room: its row, which holds something.
        sections: flat faces that stand for a cylinder.

    Returns:
        The building, in the room's own frame, and the element id (E,) of each of its elements.
    """
    vertices, faces, slot = scene_mesh(primitives, room, sections)
    element = primitives.element[room, slot]
    ids, row = np.unique(element, return_inverse=True)
    first = [np.flatnonzero(primitives.element[room] == one)[0] for one in ids]
    semantic = primitives.semantic[room, first].astype(np.uint8)
    kinds = tuple(_CLASSES.get(int(one), "") for one in semantic)
    names = tuple(f"element {one}" for one in ids)
    triangles = Triangles(vertices.astype(np.float32), faces.astype(np.int32), row.ravel().astype(np.int32), semantic)
    elements = Elements(names, kinds, names, np.zeros(len(ids), np.int32), semantic, ("",) * len(ids), ((),) * len(ids))
    storeys = Storeys(("",), ("",), np.array([float(vertices[:, 2].min())]))
    return Building(elements, triangles, np.zeros(3), storeys, (), 0, (), None), ids
