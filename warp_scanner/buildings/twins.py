"""Elements that two files of a building both have: at the same place, and of the same extent, whole or in pieces.

The architect's wall is the mason's, too. One of all keeps its triangles, or its pieces do: rays that end on the one
would speak against the other. E elements; offsets from the building's origin, metres, z up.
"""

from collections import Counter

import numpy as np
from scipy.spatial import cKDTree

from warp_scanner.buildings.changes import Change, of_element
from warp_scanner.buildings.pieces import SAME, crossing_elements, may_be_same, pieced_elements, shared_out, turn_of
from warp_scanner.scenes.building import Building, Pieced, Twin, element_bounds
from warp_scanner.scenes.building_edits import without
from warp_scanner.scenes.scenes import OTHER

OPEN = 0.1  # share of its box by which one must be emptier than the other to be the one with openings
_REACH = 0.5  # times its longest edge, within which the corners of the other must be


def with_twins(building: Building) -> tuple[Building, tuple[str, ...]]:
    """The building with one of all that are the same in its table, which names the others as its twins; and notes.

    Kept is the one with openings that the others lack, else the larger, else the first by its file's name. What another
    file has in pieces leaves the table: its pieces stay, and `pieced` tells of it. They have its surface where it has
    openings that they lack.
    """
    pairs, in_pieces = _pairs(building), pieced_elements(building)
    known = {row for one, other, _ in pairs for row in (one, other)} | {
        row for one, pieces in in_pieces for row in (one, *pieces)
    }
    pieced = [*in_pieces, *crossing_elements(building, known)]
    if not pairs and not pieced:
        return building, ()
    group: dict[int, list[int]] = {row: [row] for one, pieces in pieced for row in (one, *pieces)}
    wholes, parts = {one for one, _ in pieced}, {row for _, pieces in pieced for row in pieces}
    for one, other, _ in pairs:
        _join(building, group, (one, other), (wholes, parts))
    share = {row: _share(building, row) for row in group}
    gone, twins, kept_of = [], list(building.elements.twins), {}
    groups = {id(rows): rows for rows in group.values()}.values()
    for rows in groups:
        kept = _kept(building, rows, share)
        kept_of |= dict.fromkeys(rows, kept)
        twins[kept] = tuple(_twin(building, row) for row in sorted(rows) if row != kept)
        gone += [row for row in rows if row != kept or row in wholes]
    found = []
    for kept in sorted({kept_of[one] for one in wholes}):
        of_all = [pieces for one, pieces in pieced if kept_of[one] == kept]
        found.append(_pieced(building, kept, twins[kept], of_all))
        for pieces in (pieces for one, pieces in in_pieces if kept_of[one] == kept):
            if _lacks_openings(kept, pieces, share):
                building = _with_openings(building, kept, sorted({kept_of[row] for row in pieces}))
    told = _said(building, {row: own for row, own in enumerate(twins) if own}, pieced)
    building = building._replace(elements=building.elements._replace(twins=tuple(twins)), pieced=tuple(found))
    return without(building, np.array(gone, int)), told


def _join(
    building: Building, group: dict[int, list[int]], pair: tuple[int, int], roles: tuple[set[int], set[int]]
) -> None:
    """Put two elements and all that are the same as either into one group.

    Not where that would be two of one file, or a whole and a piece: what is in pieces is known by them.
    """
    first, second = (group.setdefault(row, [row]) for row in pair)
    both = [*first, *second]
    if len({building.elements.file[row] for row in both}) < len(both):
        return
    if not any(role.isdisjoint(both) for role in roles):
        return
    first += second
    group |= dict.fromkeys(second, first)


def _pieced(building: Building, row: int, twins: tuple[Twin, ...], of_all: list[tuple[int, ...]]) -> Pieced:
    table, change = building.elements, of_element(building, row)
    keys = tuple((table.file[piece], table.guid[piece]) for pieces in of_all for piece in pieces)
    center, size = (tuple(map(float, side)) for side in (change.center, change.size))
    return Pieced(_twin(building, row), twins, keys, center, size, float(change.yaw))


def _lacks_openings(row: int, pieces: tuple[int, ...], share: dict[int, tuple[float, float]]) -> bool:
    """Whether pieces fill more than the element that they are of: where it is open, rays pass."""
    (box, filled), own = share[row], sum(np.prod(share[piece]) for piece in pieces)
    return bool(box * filled < own - OPEN * box)


def _with_openings(building: Building, whole: int, pieces: list[int]) -> Building:
    """The building in which some elements have the surface of the one that they are pieces of."""
    triangles = building.triangles
    own, stays = triangles.element == whole, ~np.isin(triangles.element, pieces)
    corners = triangles.vertices[triangles.faces[own]].astype(np.float64)
    corners, piece, source = shared_out(
        corners, of_element(building, whole), [of_element(building, row) for row in pieces]
    )
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
