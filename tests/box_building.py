"""Buildings out of boxes, to test what needs one that can be seen through in the head."""

import numpy as np

from warp_scanner.room_buildings import building_of_room
from warp_scanner.scenes import BOX, Primitives


def building_of(boxes):
    """Boxes (center, half size, semantic), each an element of that number."""
    center, half, semantic = (np.array(values) for values in zip(*boxes, strict=True))
    count = len(boxes)
    table = Primitives(
        np.full((1, count), BOX, np.uint8), center[None].astype(np.float32), half[None].astype(np.float32),
        np.zeros((1, count), np.float32), np.arange(count, dtype=np.int32)[None], semantic[None].astype(np.uint8),
    )  # fmt: skip
    return building_of_room(table, 0)[0]
