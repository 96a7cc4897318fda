"""Elements that two files of a building both have: at the same place, and of the same extent.

The architect's wall is the mason's, too. One of both keeps its triangles, or rays that end on the one would speak
against the other. E elements; offsets from the building's origin, metres, z up.
"""

from collections import Counter

import numpy as np
from scipy.spatial import cKDTree

from warp_scanner.buildings.changes import Change, of_element
from warp_scanner.scenes.building import Building, Twin, element_bounds
from warp_scanner.scenes.building_edits import without
from warp_scanner.scenes.scenes import OTHER

# Of the box about both, along the axes of one, that each fills. Trades end walls differently at corners, so that short
# ones differ by a third; two layers of one wall stand side by side and share nothing.
SAME = 0.7
OPEN = 0.1  # share of its box by which one must be emptier than the other to be the one with openings
_REACH = 0.5  # times its longest edge, within which the corners of the other must be


def with_twins(building: Building) -> tuple[Building, tuple[str, ...]]:
    """The building with one of each such pair in its table, which names the other as its twin; and notes.

    Kept is the one with openings that the other lacks, else the larger, else the first by its file's name.
    """
    pairs = _pairs(building)
    if not pairs:
        return building, ()
    group: dict[int, list[int]] = {}
    for one, other, _ in pairs:
        first, second = (group.setdefault(row, [row]) for row in (one, other))
        files = {building.elements.file[row] for row in first}
        if files.isdisjoint(building.elements.file[row] for row in second):  # no two of one file are the same
            first += second
            group |= dict.fromkeys(second, first)
    share = {row: _share(building, row) for pair in pairs for row in pair[:2]}
    gone, twins = [], list(building.elements.twins)
    for rows in {id(rows): rows for rows in group.values() if len(rows) > 1}.values():
        kept = _kept(building, rows, share)
        others = sorted(row for row in rows if row != kept)
        twins[kept] = tuple(_twin(building, row) for row in others)
        gone += others
    told = _said(building, twins)
    building = building._replace(elements=building.elements._replace(twins=tuple(twins)))
    return without(building, np.array(gone, int)), told


def _pairs(building: Building) -> list[tuple[int, int, float]]:
    """Rows of two files that fill the same, the most alike first, and how much of both boxes is common."""
    low, high = (side.astype(np.float64) for side in element_bounds(building.triangles))
    ends, longest = np.hstack([low, high]), (high - low).max(axis=1)
    near = cKDTree(ends).query_ball_point(ends, _REACH * longest, p=np.inf)
    changes: dict[int, Change] = {}
    found = []
    for one, others in enumerate(near):
        for other in others:
            if other > one and _may_be(building, one, other):
                for row in (one, other):
                    changes.setdefault(row, of_element(building, row))
                alike = common(changes[one], changes[other])
                if alike >= SAME:
                    found.append((one, other, alike))
    return sorted(found, key=lambda pair: (-pair[2], pair[:2]))


def _may_be(building: Building, one: int, other: int) -> bool:
    """Whether two elements are of different files, and of one class, as far as both have one."""
    table = building.elements
    kinds = {int(table.semantic[one]), int(table.semantic[other])}
    return table.file[one] != table.file[other] and (len(kinds) == 1 or OTHER in kinds)


def common(one: Change, other: Change) -> float:
    """Volume that two boxes share, over that of both, along the axes of the first."""
    yaw = np.radians(one.yaw)
    turn = np.array([[np.cos(yaw), -np.sin(yaw), 0.0], [np.sin(yaw), np.cos(yaw), 0.0], [0.0, 0.0, 1.0]])
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


def _said(building: Building, twins: list[tuple[Twin, ...]]) -> tuple[str, ...]:
    """Which files have elements in common, and how many."""
    count = Counter(
        tuple(sorted((file, twin.file)))
        for file, own in zip(building.elements.file, twins, strict=True)
        for twin in own
    )
    return tuple(
        f"{times} {'element is' if times == 1 else 'elements are'} in {one} and in {other}, at the same place and of "
        "the same extent: one verdict for both"
        for (one, other), times in sorted(count.items())
    )
