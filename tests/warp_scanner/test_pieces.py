"""One element of a file that another has in pieces: one row, one surface, and all the others named."""

import itertools

import numpy as np
import pytest

from tests.cases.box_building import building_of, shell_of
from tests.warp_scanner.test_projects import ranges, read
from warp_scanner.buildings.arrays import packed
from warp_scanner.buildings.projects import together
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


def groups(building):
    """Keys of all that are the same, the one that is kept first."""
    table = building.elements
    return [
        [(file, guid), *((one.file, one.guid) for one in own)]
        for file, guid, own in zip(table.file, table.guid, table.twins, strict=True)
        if own
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
def test_pieces_of_one_are_the_same_as_it_and_rays_meet_it_once(pieces):
    files = [read("a.ifc", (*SHELL, WHOLE)), read("b.ifc", (*pieces, ((-3.0, 1.0, 1.5), (0.2, 0.2, 1.5), PILLAR)))]
    found = together(files)
    (same,) = groups(found)
    solid = [piece for piece in pieces if np.prod(piece[1]) > 0.02 * HALF.prod()]
    assert same[0][0] == "a.ifc" and [file for file, _ in same[1:]] == ["b.ifc"] * len(solid)
    assert len(found.elements.guid) == len(SHELL) + 2 + len(pieces) - len(solid)
    assert any("1 element of a.ifc is in b.ifc in pieces: one verdict" in note for note in found.notes)
    whole = building_of((*SHELL, WHOLE, ((-3.0, 1.0, 1.5), (0.2, 0.2, 1.5), PILLAR)))
    np.testing.assert_allclose(ranges(found), ranges(whole), atol=1e-5)


def test_pieces_that_leave_an_opening_are_what_rays_meet():
    first, (center, half, kind), last = cut(0, (0.0, 0.3, 0.7, 1.0))
    sill, lintel = (((*center[:2], z), (*half[:2], high), kind) for z, high in ((0.3, 0.3), (2.7, 0.3)))
    boxes = (first, sill, last, lintel)
    one = read("b.ifc", boxes)
    triangles = one.building.triangles
    element = np.where(triangles.element == 3, np.int32(1), triangles.element)  # both are one piece
    one = one._replace(building=without(one.building._replace(triangles=triangles._replace(element=element)), [3]))
    found = together([read("a.ifc", (*SHELL, WHOLE)), one])
    (same,) = groups(found)
    assert len(same) == 4 and same[0][0] == "a.ifc" and len(found.elements.guid) == len(SHELL) + 1
    np.testing.assert_allclose(ranges(found), ranges(building_of((*SHELL, *boxes))), atol=1e-5)


def test_a_third_file_with_the_whole_or_with_a_piece_is_the_same_too():
    pieces = cut(0, (0.0, 0.3, 0.7, 1.0))
    files = [read("a.ifc", (*SHELL, WHOLE)), read("b.ifc", pieces), read("c.ifc", (WHOLE,)), read("d.ifc", pieces[1:2])]
    packs = []
    for order in itertools.permutations(files):
        found = together(order)
        (same,) = groups(found)
        assert len(same) == 6 and same[0][0] in ("a.ifc", "c.ifc")
        packs.append(packed(found))
    assert all(one.words == packs[0].words for one in packs[1:])


@pytest.mark.parametrize(
    "boxes",
    [
        cut(0, (0.0, 0.2, 0.4)),  # they fill less than half of it
        cut(0, (0.0, 0.6)),  # one alone
        (*cut(0, (0.0, 0.5), PILLAR), *cut(0, (0.5, 1.0), PILLAR)),  # of another class
    ],
)
def test_what_does_not_fill_it_together_stays_apart(boxes):
    assert not groups(together([read("a.ifc", (*SHELL, WHOLE)), read("b.ifc", boxes)]))


def test_a_proxy_does_not_swallow_walls():
    proxy = (WHOLE[0], WHOLE[1], OTHER)
    assert not groups(together([read("a.ifc", (*SHELL, proxy)), read("b.ifc", cut(0, (0.0, 0.4, 0.7, 1.0)))]))
