"""Elements that two files of a building both have: at the same place, and of the same extent, whole or in pieces.

The architect's wall is the mason's, too. One of all keeps its triangles, or its pieces do: rays that end on the one
would speak against the other. E elements; offsets from the building's origin, metres, z up.
"""

from collections import Counter
from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from warp_scanner.buildings.changes import Change, of_element
from warp_scanner.buildings.pieces import (
    SAME,
    crossing_elements,
    lie_behind,
    may_be_same,
    pieced_elements,
    shared_out,
    turn_of,
)
from warp_scanner.scenes.building import Building, Pieced, Twin, element_bounds
from warp_scanner.scenes.building_edits import without
from warp_scanner.scenes.scenes import OTHER

OPEN = 0.1  # share of its box by which one must be emptier than the other to be the one with openings
_REACH = 0.5  # times its longest edge, within which the corners of the other must be


def with_twins(building: Building) -> tuple[Building, tuple[str, ...]]:
    """The building with one of all that are the same in its table, which names the others as its twins; and notes.

    Kept is the one with openings that the others lack, else the larger, else the first by its file's name. What another
    file has in pieces leaves the table: its pieces stay, the smallest where files have it in several ways, and `pieced`
    tells of it. They have its surface where it has openings that they lack, or stands out before them.
    """
    in_pieces, group = pieced_elements(building), {}
    related = {(one, piece) for one, pieces in in_pieces for piece in pieces}
    for one, other, _ in _pairs(building):
        _join(building, group, (one, other), related)
    share = {row: _share(building, row) for row in {*group, *(row for pair in related for row in pair)}}
    kept_of = {row: _kept(building, group.get(row, [row]), share) for row in share}
    pieced = _without_circles(in_pieces, kept_of)
    gone = {row for row, kept in kept_of.items() if row != kept} | {kept_of[one] for one, _ in pieced}
    pieced = _without_circles([*pieced, *crossing_elements(building, gone)], kept_of)
    if not gone and not pieced:
        return building, ()
    gone |= {one for one, _ in pieced}
    twins, pieces_of = list(building.elements.twins), _pieces_of(pieced, kept_of)
    for kept in sorted(set(kept_of.values())):
        twins[kept] = tuple(_twin(building, row) for row in sorted(group.get(kept, ())) if row != kept)
    found = []
    for kept in sorted(pieces_of):
        named = {kept_of.get(row, row): row for row in sorted(_smallest(pieces_of, kept, kept_of), reverse=True)}
        found.append(_pieced(building, kept, twins[kept], sorted(named.values())))
        for pieces in (pieces for one, pieces in in_pieces if kept_of[one] == kept):
            if _lacks_openings(kept, pieces, share) or _stands_out(building, kept, pieces, share):
                own = {kept_of.get(row, row) for row in _smallest({kept: pieces} | pieces_of, kept, kept_of)}
                building = _with_openings(building, kept, sorted(own))
    told = _said(building, {row: own for row, own in enumerate(twins) if own}, pieced)
    building = building._replace(elements=building.elements._replace(twins=tuple(twins)), pieced=tuple(found))
    return without(building, np.array(sorted(gone), int)), told


def _join(
    building: Building, group: dict[int, list[int]], pair: tuple[int, int], related: set[tuple[int, int]]
) -> None:
    """Put two elements and all that are the same as either into one group.

    Not where that would be two of one file, or a whole and a piece of it: what is in pieces is known by them.
    """
    first, second = (group.get(row, [row]) for row in pair)
    both = [*first, *second]
    if len({building.elements.file[row] for row in both}) < len(both):
        return
    if any((one, other) in related or (other, one) in related for one in first for other in second):
        return
    group |= dict.fromkeys(both, both)


def _without_circles(
    pieced: list[tuple[int, tuple[int, ...]]], kept_of: dict[int, int]
) -> list[tuple[int, tuple[int, ...]]]:
    """What is in pieces, but for what would be a piece of its own pieces: no surface would be left of either."""
    found: list[tuple[int, tuple[int, ...]]] = []
    for one, pieces in pieced:
        below, whole = _pieces_of([*found, (one, pieces)], kept_of), kept_of.get(one, one)
        waiting, seen = [whole], set()
        while waiting:
            parts = {kept_of.get(row, row) for row in below.get(waiting.pop(), ())} - seen
            seen |= parts
            waiting += parts
        if whole not in seen:
            found.append((one, pieces))
    return found


def _pieces_of(pieced: list[tuple[int, tuple[int, ...]]], kept_of: dict[int, int]) -> dict[int, list[int]]:
    """Rows of the pieces of each that is kept of some that are the same."""
    found: dict[int, list[int]] = {}
    for one, pieces in pieced:
        found.setdefault(kept_of.get(one, one), []).extend(pieces)
    return found


def _smallest(pieces_of: dict[int, list[int]], whole: int, kept_of: dict[int, int]) -> list[int]:
    """Rows of the pieces of an element, or of those that a third file has in pieces again, their pieces."""
    found = []
    for row in pieces_of[whole]:
        kept = kept_of.get(row, row)
        found += _smallest(pieces_of, kept, kept_of) if kept in pieces_of else [row]
    return found


def _pieced(building: Building, row: int, twins: tuple[Twin, ...], pieces: list[int]) -> Pieced:
    table, change = building.elements, of_element(building, row)
    keys = tuple((table.file[piece], table.guid[piece]) for piece in pieces)
    center, size = (tuple(map(float, side)) for side in (change.center, change.size))
    return Pieced(_twin(building, row), twins, keys, center, size, float(change.yaw))


def _lacks_openings(row: int, pieces: tuple[int, ...], share: dict[int, tuple[float, float]]) -> bool:
    """Whether pieces fill more than the element that they are of: where it is open, rays pass."""
    (box, filled), own = share[row], sum(np.prod(share[piece]) for piece in pieces)
    return bool(box * filled < own - OPEN * box)


def _stands_out(building: Building, row: int, pieces: Sequence[int], share: dict[int, tuple[float, float]]) -> bool:
    """Whether an element stands out before its pieces, as a plastered wall does, and is no less open than they are."""
    boxes, filled = sum(share[piece][0] for piece in pieces), sum(np.prod(share[piece]) for piece in pieces)
    is_open = share[row][1] <= filled / max(boxes, 1e-9) + OPEN
    return bool(is_open and lie_behind(of_element(building, row), [of_element(building, piece) for piece in pieces]))


def _with_openings(building: Building, whole: int, pieces: list[int]) -> Building:
    """The building in which some elements have the surface of the one that they are pieces of, each what is near it."""
    triangles = building.triangles
    own = triangles.element == whole
    corners = triangles.vertices[triangles.faces[own]].astype(np.float64)
    corners, piece, source = shared_out(
        corners, of_element(building, whole), [of_element(building, row) for row in pieces]
    )
    stays = ~np.isin(triangles.element, np.array(pieces)[np.unique(piece)])  # what lies deep in it keeps its own
    new = np.arange(3 * len(corners), dtype=np.int32).reshape(-1, 3) + np.int32(len(triangles.vertices))
    triangles = triangles._replace(
        vertices=np.concatenate([triangles.vertices, corners.reshape(-1, 3).astype(np.float32)]),
        faces=np.concatenate([triangles.faces[stays], new]),
        element=np.concatenate([triangles.element[stays], np.array(pieces, np.int32)[piece]]),
    )
    clear = building.clear
    if clear is not None:
        clear = np.concatenate([clear[stays], clear[own][source]])
    return building._replace(triangles=triangles, clear=clear)


def _pairs(building: Building) -> list[tuple[int, int, float]]:
    """Rows of two files that fill the same, the most alike first, and how much of both boxes is common."""
    low, high = (side.astype(np.float64) for side in element_bounds(building.triangles))
    ends, longest = np.hstack([low, high]), (high - low).max(axis=1)
    near = cKDTree(ends).query_ball_point(ends, _REACH * longest, p=np.inf)
    changes: dict[int, Change] = {}
    found = []
    for one, others in enumerate(near):
        for other in others:
            if other > one and may_be_same(building, one, other):
                for row in (one, other):
                    changes.setdefault(row, of_element(building, row))
                alike = common(changes[one], changes[other])
                if alike >= SAME:
                    found.append((one, other, alike))
    return sorted(found, key=lambda pair: (-pair[2], pair[:2]))


def common(one: Change, other: Change) -> float:
    """Volume that two boxes share, over that of both, along the axes of the first."""
    turn = turn_of(one)
    (low, high), (least, most) = (
        ((points := each.triangles.vertices.astype(np.float64) @ turn).min(axis=0), points.max(axis=0))
        for each in (one, other)
    )
    both = np.clip(np.minimum(high, most) - np.maximum(low, least), 0.0, None).prod()
    of_both = (high - low).prod() + (most - least).prod() - both
    return float(both / of_both) if of_both > 0.0 else 0.0


def _share(building: Building, row: int) -> tuple[float, float]:
    """Volume [m3] of an element's box, and how much of it the element fills."""
    change = of_element(building, row)
    a, b, c = (
        change.triangles.vertices[corner].astype(np.float64) - change.center for corner in change.triangles.faces.T
    )
    box = float(change.size.prod())
    return box, abs(float(np.einsum("ti,ti->", a, np.cross(b, c)))) / 6.0 / max(box, 1e-9)


def _kept(building: Building, rows: list[int], share: dict[int, tuple[float, float]]) -> int:
    table = building.elements
    known = [row for row in rows if table.semantic[row] != OTHER] or rows
    emptiest = min(share[row][1] for row in known)
    open_ones = [row for row in known if share[row][1] <= emptiest + OPEN]
    return min(open_ones, key=lambda row: (-round(share[row][0], 3), table.file[row], table.guid[row]))


def _twin(building: Building, row: int) -> Twin:
    table = building.elements
    return Twin(
        table.guid[row], table.ifc_class[row], table.name[row], int(table.storey[row]), int(table.semantic[row]),
        table.file[row],
    )  # fmt: skip


def _said(
    building: Building, twins: dict[int, tuple[Twin, ...]], pieced: list[tuple[int, tuple[int, ...]]]
) -> tuple[str, ...]:
    """Which files have elements in common, how many, and which of them in pieces."""
    table = building.elements
    same = Counter(tuple(sorted((table.file[row], twin.file))) for row, own in twins.items() for twin in own)
    cut = Counter((table.file[one], table.file[pieces[0]]) for one, pieces in pieced)
    return (
        *(f"{times} {'element is' if times == 1 else 'elements are'} in {one} and in {other}, at the same place and of "
          "the same extent: one verdict for both" for (one, other), times in sorted(same.items())),
        *(f"{times} {'element' if times == 1 else 'elements'} of {one} {'is' if times == 1 else 'are'} in {other} in "
          "pieces: each piece is judged by itself, and the whole by them"
          for (one, other), times in sorted(cut.items())),
    )  # fmt: skip
