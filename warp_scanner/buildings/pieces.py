"""Elements that another file of the building has in pieces: one wall of the architect, three of the mason end to end.

Or a wall, and each of its layers. E elements; offsets from the building's origin, metres, z up.
"""

from collections import defaultdict

import numpy as np
from scipy.spatial import cKDTree

from warp_scanner.buildings.changes import Change, of_element
from warp_scanner.scenes.building import Building, element_bounds
from warp_scanner.scenes.scenes import OTHER

# Of the box about both, along the axes of one, that each fills. Trades end walls differently at corners, so that short
# ones differ by a third; two layers of one wall stand side by side and share nothing.
SAME = 0.7
WITHIN = 0.8  # of a piece's box, that lies in that of the whole
_LEAST = 0.02  # of the whole's box, by a piece: less is an anchor, a strip, a lintel in it
_SLACK = 0.1  # [m] by which a piece may stand out of the whole
_STEPS = 24  # of the places, along each axis of a box, that tell how much of it is filled


def may_be_same(building: Building, one: int, other: int) -> bool:
    """Whether two elements are of different files, and of one class, as far as both have one."""
    table = building.elements
    kinds = {int(table.semantic[one]), int(table.semantic[other])}
    return table.file[one] != table.file[other] and (len(kinds) == 1 or OTHER in kinds)


def pieced_elements(building: Building) -> list[tuple[int, tuple[int, ...]]]:
    """Rows of elements with those, two or more of one other file, that fill the same together; no piece twice.

    Pieces of the class of the whole are preferred to such as have none of our classes.
    """
    low, high = (side.astype(np.float64) for side in element_bounds(building.triangles))
    middle, half = (low + high) / 2.0, (high - low) / 2.0
    volume, tree = np.prod(high - low, axis=1), cKDTree(middle)
    changes: dict[int, Change] = {}

    def box_of(row: int) -> Change:
        if row not in changes:
            changes[row] = of_element(building, row)
        return changes[row]

    found: list[tuple[int, tuple[int, ...]]] = []
    taken: set[int] = set()
    for one in np.argsort(-volume, kind="stable").tolist():
        near = np.array(tree.query_ball_point(middle[one], float(half[one].max()), p=np.inf), int)
        near = near[np.all((low[near] >= low[one] - _SLACK) & (high[near] <= high[one] + _SLACK), axis=1)]
        by_file: dict[str, list[int]] = defaultdict(list)
        for other in near.tolist():
            if other != one and other not in taken and may_be_same(building, one, other):
                by_file[building.elements.file[other]].append(other)
        for rows in by_file.values():
            if len(rows) < 2 or one in taken or volume[rows].sum() < SAME * np.prod(box_of(one).size):
                continue
            pieces = _pieces(building, one, [box_of(row) for row in (one, *rows)], rows)
            if pieces:
                found.append((one, pieces))
                taken.update(pieces)
    return found


def _pieces(building: Building, one: int, boxes: list[Change], rows: list[int]) -> tuple[int, ...]:
    """Those of some rows that fill an element's box together; none where they do not."""
    whole = boxes[0]
    size = float(np.prod(whole.size))
    shares = [_common(piece, whole) for piece in boxes[1:]]
    within = {
        row: box
        for row, box, share in zip(rows, boxes[1:], shares, strict=True)
        if share >= WITHIN and np.prod(box.size) >= _LEAST * size
    }
    own, semantic = building.elements.semantic[one], building.elements.semantic
    # What has none of our classes would take theirs from its pieces.
    for chosen in ([row for row in within if semantic[row] == own], list(within) if own != OTHER else []):
        if len(chosen) < 2:
            continue
        inside = [within[row] for row in chosen]
        places = _places(whole)
        filled = np.mean(np.any([_is_in(box, places) for box in inside], axis=0))
        beside = sum(np.prod(box.size) * (1.0 - _common(box, whole)) for box in inside)
        if filled * size >= SAME * (size + beside):
            return tuple(chosen)
    return ()


def _common(one: Change, other: Change) -> float:
    """Share of one box that lies in another."""
    return float(np.mean(_is_in(other, _places(one))))


def _places(box: Change) -> np.ndarray:
    """(n, 3) spread evenly in a box."""
    steps = (np.arange(_STEPS) + 0.5) / _STEPS - 0.5
    grid = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), axis=-1).reshape(-1, 3)
    return box.center + (grid * box.size) @ turn_of(box).T


def _is_in(box: Change, places: np.ndarray) -> np.ndarray:
    """(n,) bool: places (n, 3) in a box."""
    return np.all(np.abs((places - box.center) @ turn_of(box)) <= box.size / 2.0, axis=1)


def turn_of(box: Change) -> np.ndarray:
    """(3, 3) from a box's own axes to the building's."""
    yaw = np.radians(box.yaw)
    return np.array([[np.cos(yaw), -np.sin(yaw), 0.0], [np.sin(yaw), np.cos(yaw), 0.0], [0.0, 0.0, 1.0]])
