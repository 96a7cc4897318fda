"""Buildings out of boxes, to test what needs one that can be seen through in the head."""

import numpy as np

from jaxmm.rays.scan_rays import PosedScan
from jaxmm.verdicts.named_scans import NamedScan
from warp_scanner.buildings.room_buildings import building_of_room
from warp_scanner.scenes.scenes import BOX, CEILING, FLOOR, WALL, Primitives
from warp_scanner.sensors.scan import Rays
from warp_scanner.sensors.triangles import cast_triangles, prepare


def shell_of(x, y, height):
    """Floor, ceiling and walls, 0.2 m thick, of a room from -x to x and from -y to y [m], as boxes for `table_of`."""
    middle = height / 2
    return (
        ((0.0, 0.0, -0.1), (x + 0.2, y + 0.2, 0.1), FLOOR),
        ((0.0, 0.0, height + 0.1), (x + 0.2, y + 0.2, 0.1), CEILING),
        *(((way * (x + 0.1), 0.0, middle), (0.1, y, middle), WALL) for way in (1.0, -1.0)),
        *(((0.0, way * (y + 0.1), middle), (x, 0.1, middle), WALL) for way in (1.0, -1.0)),
    )


def table_of(boxes):
    """Boxes (center, half size, semantic) as the primitives of one room, each an element of that number."""
    center, half, semantic = (np.array(values) for values in zip(*boxes, strict=True))
    count = len(boxes)
    return Primitives(
        np.full((1, count), BOX, np.uint8), center[None].astype(np.float32), half[None].astype(np.float32),
        np.zeros((1, count), np.float32), np.arange(count, dtype=np.int32)[None], semantic[None].astype(np.uint8),
    )  # fmt: skip


def building_of(boxes):
    """The same as a building."""
    return building_of_room(table_of(boxes), 0)[0]


def scan_of(boxes, place, sensor, most=np.inf):
    """An exact scan of boxes from a place (3,), along x, with what is nearer than `most` [m]."""
    direction = sensor.directions()
    distance = cast_triangles(prepare(building_of(boxes).triangles), Rays(place[None], direction)).distance[0]
    back = np.isfinite(distance) & (distance < most)
    points = (place + direction[back] * distance[back, None]).astype(np.float32)
    return NamedScan(PosedScan(points, place, np.eye(3), sensor), "scan", len(points), "given")
