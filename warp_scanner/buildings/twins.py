"""Elements that two files of a building both have: at the same place, and of the same extent, whole or in pieces.

The architect's wall is the mason's, too. One of all keeps its triangles, or rays that end on the one would speak
against the other. E elements; offsets from the building's origin, metres, z up.
"""

from collections import Counter

import numpy as np
from scipy.spatial import cKDTree

from warp_scanner.buildings.changes import Change, of_element
from warp_scanner.buildings.pieces import SAME, may_be_same, pieced_elements, turn_of
from warp_scanner.scenes.building import Building, Twin, element_bounds
from warp_scanner.scenes.building_edits import without
from warp_scanner.scenes.scenes import OTHER

OPEN = 0.1  # share of its box by which one must be emptier than the other to be the one with openings
_REACH = 0.5  # times its longest edge, within which the corners of the other must be


def with_twins(building: Building) -> tuple[Building, tuple[str, ...]]:
    """The building with one of all that are the same in its table, which names the others as its twins; and notes.

    Kept is, of what is whole in its file, the one with openings that the others lack, else the larger, else the first
    by its file's name. It has the surface of the pieces where these have openings that it lacks.
    """
    pairs, pieced = _pairs(building), pieced_elements(building)
    if not pairs and not pieced:
        return building, ()
    group: dict[int, list[int]] = {}
    pieced = [(one, pieces) for one, pieces in pieced if _join(building, group, one, pieces)]
    parts = {row for _, pieces in pieced for row in pieces}
    for one, other, _ in pairs:
        if _join(building, group, one, (other,)) and not parts.isdisjoint((one, other)):
            parts.update((one, other))  # what is the same as a piece is one
    share = {row: _share(building, row) for row in group}
    gone, twins = [], list(building.elements.twins)
    for rows in {id(rows): rows for rows in group.values() if len(rows) > 1}.values():
        kept = _kept(building, [row for row in rows if row not in parts], share)
        others = sorted(row for row in rows if row != kept)
        twins[kept] = tuple(_twin(building, row) for row in others)
        gone += others
        building = _with_openings(building, kept, [pieces for one, pieces in pieced if one in rows], share)
    told = _said(building, {row: own for row, own in enumerate(twins) if own}, pieced)
    building = building._replace(elements=building.elements._replace(twins=tuple(twins)))
    return without(building, np.array(gone, int)), told


def _join(building: Building, group: dict[int, list[int]], one: int, others: tuple[int, ...]) -> bool:
    """Put an element and others, of one file, into one group; False where that would be two wholes of one file."""
    first = group.setdefault(one, [one])
    joined = {row: None for other in others for row in group.setdefault(other, [other])}
    files = {building.elements.file[row] for row in first}
    if not files.isdisjoint(building.elements.file[row] for row in joined):
        return False
    first += joined
    group |= dict.fromkeys(joined, first)
    return True


def _with_openings(
    building: Building, kept: int, pieced: list[tuple[int, ...]], share: dict[int, tuple[float, float]]
) -> Building:
    """The building in which an element has the surfaces of pieces that leave more of its box open than it does."""
    filled = share[kept][1]
    for pieces in pieced:
        volume = sum(share[row][0] for row in pieces)
        if sum(np.prod(share[row]) for row in pieces) < (filled - OPEN) * volume:
            triangles = building.triangles
            taken = np.isin(triangles.element, pieces)
            left = taken | (triangles.element != kept)
            element = np.where(taken, np.int32(kept), triangles.element)[left]
            clear = None if building.clear is None else building.clear[left]
            triangles = triangles._replace(faces=triangles.faces[left], element=element)
            return building._replace(triangles=triangles, clear=clear)
    return building


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
    part = {(table.file[row], table.guid[row]) for _, pieces in pieced for row in pieces}
    same = Counter(
        tuple(sorted((table.file[row], twin.file)))
        for row, own in twins.items()
        for twin in own
        if (twin.file, twin.guid) not in part
    )
    cut = Counter((table.file[one], table.file[pieces[0]]) for one, pieces in pieced)
    return (
        *(f"{times} {'element is' if times == 1 else 'elements are'} in {one} and in {other}, at the same place and of "
          "the same extent: one verdict for both" for (one, other), times in sorted(same.items())),
        *(f"{times} {'element' if times == 1 else 'elements'} of {one} {'is' if times == 1 else 'are'} in {other} in "
          "pieces: one verdict for all of them" for (one, other), times in sorted(cut.items())),
    )  # fmt: skip
