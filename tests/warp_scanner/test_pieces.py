"""One element of a file that another has in pieces: its pieces have the surface, and it is told of by them."""

import itertools

import numpy as np
import pytest

from tests.cases.box_building import building_of, shell_of
from tests.warp_scanner.test_projects import ranges, read
from warp_scanner.buildings.arrays import packed, unpacked
from warp_scanner.buildings.projects import together
from warp_scanner.scenes.building import element_bounds, rows_by_key
from warp_scanner.scenes.building_edits import without
from warp_scanner.scenes.scenes import OTHER, PILLAR, WALL

SHELL = shell_of(6.0, 5.0, 3.0)
CENTER, HALF = np.array([1.0, 2.0, 1.5]), np.array([1.5, 0.15, 1.5])
WHOLE = (tuple(CENTER), tuple(HALF), WALL)


def cut(axis, ends, kind=WALL):
    """Pieces of the wall between some shares of its extent."""
    found = []
    for start, end in itertools.pairwise(ends):
        center, half = CENTER.copy(), HALF.copy()
        center[axis] += HALF[axis] * (start + end - 1.0)
        half[axis] *= end - start
        found.append((tuple(center), tuple(half), kind))
    return tuple(found)


def pieced(building):
    """Keys of what is in pieces, with all that are the same, and of its pieces."""
    return [
        ({(one.file, one.guid) for one in (whole.element, *whole.twins)}, sorted(whole.pieces))
        for whole in building.pieced
    ]


@pytest.mark.parametrize(
    "pieces",
    [
        cut(0, (0.0, 0.3, 0.7, 1.0)),  # end to end
        cut(1, (0.0, 0.2, 0.8, 1.0)),  # layers
        cut(2, (0.0, 0.5, 1.0)),  # one upon another
        cut(0, (0.0, 0.5, 1.0), OTHER),  # of proxies
        (*cut(1, (0.0, 0.6)), *cut(1, (0.6, 0.8, 1.0), OTHER)),  # a core with its linings
        cut(0, (0.0, 0.6, 0.99, 1.0)),  # with a strip that is too small to be a piece
    ],
)
def test_pieces_keep_their_surfaces_and_the_whole_has_none(pieces):
    other = ((-3.0, 1.0, 1.5), (0.2, 0.2, 1.5), PILLAR)
    found = together([read("a.ifc", (*SHELL, WHOLE)), read("b.ifc", (*pieces, other))])
    ((whole, parts),) = pieced(found)
    solid = [piece for piece in pieces if np.prod(piece[1]) > 0.02 * HALF.prod()]
    assert {file for file, _ in whole} == {"a.ifc"} and [file for file, _ in parts] == ["b.ifc"] * len(solid)
    keys = list(zip(found.elements.file, found.elements.guid, strict=True))
    assert len(keys) == len(SHELL) + 1 + len(pieces) and set(parts) < set(keys) and whole.isdisjoint(keys)
    (one,) = found.pieced
    np.testing.assert_allclose(one.center, CENTER - found.origin, atol=1e-6)
    np.testing.assert_allclose(one.size, 2.0 * HALF, atol=1e-6)
    assert any(
        "1 element of a.ifc is in b.ifc in pieces: each piece is judged by itself" in note for note in found.notes
    )
    np.testing.assert_allclose(ranges(found), ranges(building_of((*SHELL, *pieces, other))), atol=1e-5)
    back = unpacked(packed(found))
    assert back.pieced == found.pieced


def test_rays_pass_an_opening_of_the_whole_that_its_pieces_lack():
    """Of each piece the part of the wall that is in it; all together are the wall."""
    first, (center, half, kind), last = cut(0, (0.0, 0.3, 0.7, 1.0))
    sill, lintel = (((*center[:2], z), (*half[:2], high), kind) for z, high in ((0.3, 0.3), (2.7, 0.3)))
    boxes = (first, sill, last, lintel)
    whole = one_of(read("a.ifc", (*SHELL, *boxes)), len(SHELL))
    pieces = cut(0, (0.0, 0.5, 1.0))
    found = together([whole, read("b.ifc", pieces)])
    assert len(found.pieced) == 1
    np.testing.assert_allclose(ranges(found), ranges(building_of((*SHELL, *boxes))), atol=1e-5)
    for row in np.flatnonzero(np.array(found.elements.file) == "b.ifc"):
        low, high = (side[row] for side in element_bounds(found.triangles))
        middle, reach = pieces[int(row) - len(SHELL)][:2]
        assert np.all(low >= np.subtract(middle, reach) - 1e-4) and np.all(high <= np.add(middle, reach) + 1e-4)
    areas = [area_of(found.triangles, row) for row in np.flatnonzero(np.array(found.elements.file) == "b.ifc")]
    np.testing.assert_allclose(areas, area_of(whole.building.triangles, len(SHELL)) / 2.0, rtol=1e-4)


def area_of(triangles, row):
    corners = triangles.vertices[triangles.faces[triangles.element == row]].astype(float)
    return np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum() / 2.0


def one_of(file, first):
    """The file with all elements from a row on as one."""
    triangles = file.building.triangles
    element = np.minimum(triangles.element, np.int32(first))
    building = file.building._replace(triangles=triangles._replace(element=element))
    return file._replace(building=without(building, list(range(first + 1, len(building.elements.guid)))))


def test_pieces_that_leave_an_opening_are_what_rays_meet():
    first, (center, half, kind), last = cut(0, (0.0, 0.3, 0.7, 1.0))
    sill, lintel = (((*center[:2], z), (*half[:2], high), kind) for z, high in ((0.3, 0.3), (2.7, 0.3)))
    boxes = (first, last, sill, lintel)
    found = together([read("a.ifc", (*SHELL, WHOLE)), one_of(read("b.ifc", boxes), 2)])
    ((_, parts),) = pieced(found)
    assert len(parts) == 3
    np.testing.assert_allclose(ranges(found), ranges(building_of((*SHELL, *boxes))), atol=1e-5)


def test_a_third_file_with_the_whole_or_with_a_piece_is_the_same_too():
    pieces = cut(0, (0.0, 0.3, 0.7, 1.0))
    files = [read("a.ifc", (*SHELL, WHOLE)), read("b.ifc", pieces), read("c.ifc", (WHOLE,)), read("d.ifc", pieces[1:2])]
    packs = []
    for order in itertools.permutations(files):
        found = together(order)
        ((whole, parts),) = pieced(found)
        assert {file for file, _ in whole} == {"a.ifc", "c.ifc"} and {file for file, _ in parts} == {"b.ifc"}
        (piece,) = [own for own in found.elements.twins if own]
        assert {one.file for one in piece} | set(found.elements.file) == {"a.ifc", "b.ifc", "d.ifc"}
        assert len(found.elements.guid) == len(SHELL) + 3
        assert rows_by_key(found.elements).keys() >= set(parts)
        packs.append(packed(found))
    assert all(one.words == packs[0].words for one in packs[1:])


@pytest.mark.parametrize("ends", [(0.0, 1 / 3, 2 / 3, 1.0), (0.0, 0.5, 1.0), (0.0, 1 / 3, 1.0)])
def test_of_what_three_files_have_the_smallest_pieces_have_the_surface(ends):
    """Cut at the same places by the third, at others, or in parts that the second has in pieces again."""
    pieces, others = cut(0, (0.0, 1 / 3, 2 / 3, 1.0)), cut(0, ends)
    files = [read("a.ifc", (*SHELL, WHOLE)), read("b.ifc", pieces), read("c.ifc", others)]
    found = together(files)
    assert len(found.elements.guid) == len(SHELL) + 3
    rows = rows_by_key(found.elements)
    parts = {guids.pop(): own for guids, own in pieced(found)}
    assert all(len(own) == len(set(own)) == len({rows[key] for key in own}) for own in parts.values())
    (whole,) = [own for (file, _), own in parts.items() if file == "a.ifc"]
    assert len(whole) == 3
    cuts = [sum(a < high - 0.01 and b > low + 0.01 for a, b in itertools.pairwise((0.0, 1 / 3, 2 / 3, 1.0)))
            for low, high in itertools.pairwise(ends)]  # fmt: skip
    told = sorted(len(own) for (file, _), own in parts.items() if file == "c.ifc")
    assert told == sorted(count for count in cuts if count > 1)
    np.testing.assert_allclose(ranges(found), ranges(building_of((*SHELL, *pieces))), atol=1e-5)
    packs = [packed(together(order)).words for order in itertools.permutations(files)]
    assert all(one == packs[0] for one in packs[1:])


def test_pieces_behind_the_faces_of_the_whole_have_these():
    """The mason's wall lacks the plaster of the architect's: as of twins, the larger one is what rays meet."""
    core = [(center, (half[0], 0.85 * half[1], half[2]), kind) for center, half, kind in cut(0, (0.0, 0.4, 1.0))]
    found = together([read("a.ifc", (*SHELL, WHOLE)), read("b.ifc", core)])
    assert len(found.pieced) == 1 and len(found.elements.guid) == len(SHELL) + 2
    np.testing.assert_allclose(ranges(found), ranges(building_of((*SHELL, WHOLE))), atol=1e-5)
    open_ones = [core[0], (core[1][0], core[1][1] * np.array([0.75, 1.0, 1.0]), WALL)]  # rays pass between them
    found = together([read("a.ifc", (*SHELL, WHOLE)), read("b.ifc", open_ones)])
    assert len(found.pieced) == 1
    np.testing.assert_allclose(ranges(found), ranges(building_of((*SHELL, *open_ones))), atol=1e-5)


@pytest.mark.parametrize(
    "boxes",
    [
        cut(0, (0.0, 0.2, 0.4)),  # they fill less than half of it
        cut(0, (0.0, 0.6)),  # one alone
        (*cut(0, (0.0, 0.5), PILLAR), *cut(0, (0.5, 1.0), PILLAR)),  # of another class
    ],
)
def test_what_does_not_fill_it_together_stays_apart(boxes):
    assert not together([read("a.ifc", (*SHELL, WHOLE)), read("b.ifc", boxes)]).pieced


def test_a_proxy_does_not_swallow_walls():
    proxy = (WHOLE[0], WHOLE[1], OTHER)
    assert not together([read("a.ifc", (*SHELL, proxy)), read("b.ifc", cut(0, (0.0, 0.4, 0.7, 1.0)))]).pieced
