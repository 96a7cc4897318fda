"""Elements that another file of the building has in pieces: one wall of the architect, three of the mason end to end.

Or a wall, and each of its layers. The pieces keep their surfaces, for one of them may be gone by itself. E elements, t
triangles; offsets from the building's origin, metres, z up.
"""

from collections import defaultdict
from collections.abc import Sequence

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
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
CLOSE, SLIVER = 0.01, 1e-5  # [m] ends of pieces nearer than that are one; heights of triangles that count as none
CROSSED = 0.2  # of one of two elements, that lies in the other
SOLID = 0.9  # of an element, that pieces fill which leave no hole between them
_STEPS = 24  # of the places, along each axis of a box, that tell how much of it is filled


def may_be_same(building: Building, one: int, other: int) -> bool:
    """Whether two elements are of different files, and of one class, as far as both have one."""
    table = building.elements
    kinds = {int(table.semantic[one]), int(table.semantic[other])}
    return table.file[one] != table.file[other] and (len(kinds) == 1 or OTHER in kinds)


def pieced_elements(building: Building) -> list[tuple[int, tuple[int, ...]]]:
    """Rows of elements with those, two or more of one other file, that fill the same together; the largest first.

    No piece is of two elements of one file. A piece may have pieces itself, in a third file. Pieces of the class of the
    whole are preferred to such as have none of our classes.
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
    taken: set[tuple[str, int]] = set()  # by which file
    before: set[int] = set()  # what is larger is no piece
    for one in np.argsort(-volume, kind="stable").tolist():
        near = np.array(tree.query_ball_point(middle[one], float(half[one].max()), p=np.inf), int)
        near = near[np.all((low[near] >= low[one] - _SLACK) & (high[near] <= high[one] + _SLACK), axis=1)]
        by_file: dict[str, list[int]] = defaultdict(list)
        own = building.elements.file[one]
        before.add(one)
        for other in near.tolist():
            if other not in before and (own, other) not in taken and may_be_same(building, one, other):
                by_file[building.elements.file[other]].append(other)
        for rows in by_file.values():
            if len(rows) < 2 or volume[rows].sum() < SAME * np.prod(box_of(one).size):
                continue
            pieces = _pieces(building, one, [box_of(row) for row in (one, *rows)], rows)
            if pieces:
                found.append((one, pieces))
                taken.update((own, piece) for piece in pieces)
    return found


def crossing_elements(building: Building, known: set[int]) -> list[tuple[int, tuple[int, ...]]]:
    """Rows of elements with those of another file that they share a row of walls with, cut at other places.

    Each fills the same together with others of its file as those of the other file do, and none lies in one of these.
    The file that has it in more parts has the pieces; one of them may be of two elements of the other file.

    Args:
        building: of several files.
        known: rows of which it is known what they are the same as, and which therefore do not stay.
    """
    low, high = (side.astype(np.float64) for side in element_bounds(building.triangles))
    low[list(known)], high[list(known)] = np.inf, -np.inf
    boxes: dict[int, Change] = {}
    shares: dict[tuple[str, str], dict[tuple[int, int], np.ndarray]] = defaultdict(dict)
    file, semantic = building.elements.file, building.elements.semantic
    for one in np.flatnonzero(np.isfinite(low).all(axis=1)).tolist():
        meets = np.all((low < high[one]) & (high > low[one]), axis=1)
        for other in np.flatnonzero(meets[one + 1 :]) + one + 1:
            pair = one, int(other)
            if may_be_same(building, *pair) and semantic[pair[0]] == semantic[pair[1]]:
                boxes |= {row: of_element(building, row) for row in pair if row not in boxes}
                pair = tuple(sorted(pair, key=lambda row: file[row]))
                filled = [_is_in(boxes[b], _places(boxes[a])) for a, b in (pair, pair[::-1])]
                if max(map(np.mean, filled)) >= CROSSED:
                    shares[file[pair[0]], file[pair[1]]][pair] = filled
    return [found for own in shares.values() for found in _crossing(own)]


def _crossing(filled: dict[tuple[int, int], np.ndarray]) -> list[tuple[int, tuple[int, ...]]]:
    """Of two files: by pair of elements, which places of the one are in the other, and the reverse."""
    while filled:
        of_row: dict[int, list[np.ndarray]] = defaultdict(list)
        for pair, sides in filled.items():
            for row, side in zip(pair, sides, strict=True):
                of_row[row].append(side)
        less = {row for row, sides in of_row.items() if np.mean(np.any(sides, axis=0)) < SAME}
        if not less:
            break
        filled = {pair: sides for pair, sides in filled.items() if less.isdisjoint(pair)}
    found, number = [], {row: n for n, row in enumerate(sorted({row for pair in filled for row in pair}))}
    ends = np.array([[number[row] for row in pair] for pair in filled], int).reshape(-1, 2)
    graph = coo_array((np.ones(len(ends)), tuple(ends.T)), shape=(len(number),) * 2)
    group = connected_components(graph, directed=False)[1] if len(ends) else np.zeros(0, int)
    for one in np.unique(group[ends[:, 0]]):
        pairs = [pair for pair in filled if group[number[pair[0]]] == one]
        sides = [sorted({pair[side] for pair in pairs}) for side in (0, 1)]
        coarse = int(len(sides[0]) > len(sides[1]))
        for row in sides[coarse] if len(sides[coarse]) > 1 else ():
            found.append((row, tuple(pair[1 - coarse] for pair in pairs if pair[coarse] == row)))
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


def lie_behind(whole: Change, boxes: Sequence[Change]) -> bool:
    """Whether pieces, which leave no hole between them, are thinner than the element that they are of."""
    thin = int(np.argmin(whole.size))
    spans = np.array([_span(box, whole) for box in boxes])  # of each, its least and greatest corner
    ends = spans[:, 0, thin].min(), spans[:, 1, thin].max()
    if max(ends[0] + whole.size[thin] / 2.0, whole.size[thin] / 2.0 - ends[1]) <= CLOSE:
        return False
    places = (_places(whole) - whole.center) @ turn_of(whole)
    inside = (places >= spans[:, None, 0]) & (places <= spans[:, None, 1])
    inside[:, :, thin] = True
    return bool(inside.all(axis=2).any(axis=0).mean() >= SOLID)


def shared_out(
    corners: np.ndarray, whole: Change, boxes: Sequence[Change]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The surface of an element, cut where its pieces end, each part for the piece that is nearest.

    Args:
        corners: (t, 3, 3) [m] of its triangles.
        whole: the element.
        boxes: its pieces.

    Returns:
        Corners (n, 3, 3) [m] of the triangles that result, number (n,) int of the piece of each, and number (n,) int of
        the triangle that it was cut from.
    """
    turn = turn_of(whole)
    local, source = (corners - whole.center) @ turn, np.arange(len(corners))
    spans = [_span(box, whole) for box in boxes]
    for axis in range(3):
        ends = np.sort([end for span in spans for end in span[:, axis]])
        for end in ends[np.diff(ends, prepend=-np.inf) > CLOSE]:
            local, source = _cut(local, source, axis, float(end))
    middle = local.mean(axis=1) @ turn.T + whole.center
    away = [_distance(box, middle) for box in boxes]
    return local @ turn.T + whole.center, np.argmin(away, axis=0), source


def _cut(corners: np.ndarray, source: np.ndarray, axis: int, at: float) -> tuple[np.ndarray, np.ndarray]:
    """Triangles (t, 3, 3), and what each was before, cut in three where the plane crosses them."""
    side = corners[:, :, axis] - at
    crosses = (side.min(axis=1) < -SLIVER) & (side.max(axis=1) > SLIVER)
    if not crosses.any():
        return corners, source
    own, side = corners[crosses], side[crosses]
    lone = np.where((side > 0.0).sum(axis=1) == 1, side.argmax(axis=1), side.argmin(axis=1))  # by itself on its side
    order, rows = (lone[:, None] + np.arange(3)) % 3, np.arange(len(own))[:, None]
    (a, b, c), (u, v, w) = np.moveaxis(own[rows, order], 1, 0), side[rows, order].T
    ab, ac = (a + (u / (u - far))[:, None] * (end - a) for end, far in ((b, v), (c, w)))
    parts = np.stack([np.stack(each, axis=1) for each in ((a, ab, ac), (ab, b, c), (ab, c, ac))], axis=1)
    # A corner that lies in the plane leaves a part without area.
    area = np.linalg.norm(np.cross(parts[:, :, 1] - parts[:, :, 0], parts[:, :, 2] - parts[:, :, 0]), axis=2)
    kept = area > SLIVER**2
    return (
        np.concatenate([corners[~crosses], parts[kept]]),
        np.concatenate([source[~crosses], np.repeat(source[crosses], kept.sum(axis=1))]),
    )


def _corners_of(box: Change) -> np.ndarray:
    """(8, 3) [m]."""
    signs = np.stack(np.meshgrid(*[(-0.5, 0.5)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    return box.center + (signs * box.size) @ turn_of(box).T


def _span(box: Change, whole: Change) -> np.ndarray:
    """(2, 3) [m] least and greatest corner of a box along the axes of another, from the middle of that."""
    corners = (_corners_of(box) - whole.center) @ turn_of(whole)
    return np.array([corners.min(axis=0), corners.max(axis=0)])


def _distance(box: Change, places: np.ndarray) -> np.ndarray:
    """(n,) [m] from places (n, 3) to a box; 0 in it."""
    beyond = np.abs((places - box.center) @ turn_of(box)) - box.size / 2.0
    return np.linalg.norm(np.maximum(beyond, 0.0), axis=1)


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
