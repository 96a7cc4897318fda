"""Wholes by their parts, and elements of any class by the rays that nothing else explains."""

import itertools

import numpy as np
import pytest

from jaxmm.classes.telling_rays import Telling
from jaxmm.verdicts.as_built import AsBuilt
from jaxmm.verdicts.priors import prior_of_building
from jaxmm.verdicts.results import ElementVerdict
from jaxmm.verdicts.settings import DetectSettings
from jaxmm.verdicts.verdicts import (
    DISPLACED,
    OCCLUDED,
    PRESENT,
    REMOVED,
    UNSCANNED,
    VERDICTS,
    Verdict,
    VerdictSettings,
    retold,
)
from jaxmm.verdicts.wholes import of_parts, telling_of, wholes_of
from tests.cases.box_building import building_of
from warp_scanner.scenes.building import Pieced, Twin, Whole
from warp_scanner.scenes.scenes import DOOR, FLOOR, WALL

PROBABILITY = {PRESENT: 0.1, DISPLACED: 0.05, REMOVED: 0.9, OCCLUDED: 0.02, UNSCANNED: 0.02}


def verdict(name):
    return Verdict(name, PROBABILITY[name], 3, (5, 6, 7, 8))


def test_a_whole_is_gone_only_if_all_parts_that_tell_are():
    for names in itertools.chain.from_iterable(itertools.product(VERDICTS, repeat=count) for count in (1, 2, 3, 4)):
        whole = of_parts([verdict(name) for name in names], 0.02)
        tell = set(names) & {PRESENT, DISPLACED, REMOVED}
        told = sum(name in tell for name in names)
        assert (whole.verdict == REMOVED) == (tell == {REMOVED} and 2 * told > len(names)), names
        assert (whole.verdict == DISPLACED) == (tell == {DISPLACED}), names
        assert (whole.verdict == PRESENT) == (PRESENT in tell or len(tell) == 2), names
        assert (whole.verdict == UNSCANNED) == (set(names) == {UNSCANNED})
        assert (whole.probability >= 0.5) == (whole.verdict == REMOVED)
        assert whole.points == 3 * len(names) and whole.rays == tuple(n * len(names) for n in (5, 6, 7, 8))


@pytest.mark.parametrize("standing", [PRESENT, REMOVED, OCCLUDED])
def test_a_part_that_another_file_has_in_pieces_tells_of_its_whole(standing):
    """A roof of two slabs, one of which is in pieces elsewhere: while these stand, something of it does."""
    building = building_of([((x, 0.0, 3.0), (1.0, 2.0, 0.1), FLOOR) for x in (-2.0, 1.0, 3.0)])
    slab, *pieces = (("b.ifc", guid) for guid in building.elements.guid)
    table = building.elements._replace(file=("a.ifc", "b.ifc", "b.ifc"))
    other = Twin("other", "IfcSlab", "", -1, FLOOR, "a.ifc")
    building = building._replace(
        elements=table,
        wholes=(Whole("roof", "IfcRoof", "", -1, (slab[1], "other"), "a.ifc"),),
        pieced=(Pieced(other, (), tuple(pieces), (2.0, 0.0, 3.0), (4.0, 4.0, 0.2), 0.0),),
    )
    verdicts = [verdict(REMOVED), verdict(standing), verdict(standing)]
    settings = DetectSettings(classes=("all",))
    elements = tuple(
        ElementVerdict(guid, "IfcSlab", "", "", *one, file=file)
        for guid, file, one in zip(table.guid, table.file, verdicts, strict=True)
    )
    prior = prior_of_building(building)
    stands = AsBuilt(prior, {}, np.zeros(0), {})
    found = {one.guid: one for one in wholes_of(prior, verdicts, elements, settings, stands)}
    assert found["roof"].verdict == standing
    assert found["roof"].parts == (("a.ifc", slab[1]), ("a.ifc", "other"))
    assert found["other"].part_of == (("a.ifc", "roof"),) and found["other"].verdict == standing


@pytest.mark.parametrize(
    "before, through, support, glass, after",
    [
        pytest.param(REMOVED, 100, 0, 0, REMOVED, id="gone"),
        pytest.param(PRESENT, 100, 2, 0, REMOVED, id="the networks missed it"),
        pytest.param(REMOVED, 2, 100, 0, PRESENT, id="it stands"),
        pytest.param(REMOVED, 65, 35, 0, OCCLUDED, id="nobody knows"),
        pytest.param(PRESENT, 65, 35, 0, PRESENT, id="it stands in part"),
        pytest.param(REMOVED, 3, 0, 900, OCCLUDED, id="rays pass glass"),
        pytest.param(PRESENT, 0, 3, 900, PRESENT, id="present through glass"),
        pytest.param(REMOVED, 3, 0, 0, REMOVED, id="the networks alone"),
        pytest.param(OCCLUDED, 100, 0, 0, OCCLUDED, id="too little of it"),
        pytest.param(DISPLACED, 100, 0, 0, DISPLACED, id="off its place"),
        pytest.param(UNSCANNED, 100, 0, 0, UNSCANNED, id="out of reach"),
    ],
)
def test_rays_that_nothing_else_explains_decide(before, through, support, glass, after):
    some, rest = (
        [Telling(*(np.array([part(value), 0]) for value in (through, support, glass)))]
        for part in (lambda value: value // 3, lambda value: value - value // 3)
    )
    found = retold([verdict(before)] * 2, some + rest, VerdictSettings())  # of two scans
    assert found[0].verdict == after and found[1] == verdict(before)
    assert (found[0].probability >= 0.5) == (after == REMOVED)
    assert (found[0].probability == 0.02) == (after in (OCCLUDED, UNSCANNED))


def test_what_is_in_a_wall_that_is_gone_hides_nothing():
    """Its door is asked about all the same; that of a wall that stands hides what is behind it."""
    there, gone = ((0.0, 3.0, 1.5), (2.0, 0.1, 1.5), WALL), ((0.0, -3.0, 1.5), (2.0, 0.1, 1.5), WALL)
    doors = [((x, y, 1.0), (0.5, 0.1, 1.0), DOOR) for (x, y, _), _, _ in (there, gone)]
    prior = prior_of_building(building_of((there, gone, *doors)))
    told = []
    verdicts = [verdict(name) for name in (PRESENT, REMOVED, PRESENT, PRESENT)]
    telling_of(prior, verdicts, DetectSettings(classes=("all",)), lambda *asked: told.append(asked) or [])
    ((asked, hides_nothing),) = told
    assert asked.tolist() == [False, False, True, True] and hides_nothing.tolist() == [False, True, False, True]
