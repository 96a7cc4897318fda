"""Classes that a model has no element of: they are named, and refused where nothing else was asked for."""

import pytest

from jaxmm.classes.lacking import check_asked, lacking_notes, without_elements
from jaxmm.classes.selection import ALL, USUAL
from jaxmm.inputs import InputError
from tests.cases.box_building import building_of, shell_of
from warp_scanner.scenes.building import Twin, Whole
from warp_scanner.scenes.scenes import FLOOR, PILLAR

BUILDING = building_of(shell_of(2.0, 2.0, 2.5))  # walls and slabs, no column
TABLE = BUILDING.elements


def test_classes_without_an_element_are_named_in_their_order():
    asked = ["IfcBeam", "wall", "door", "IfcBeam", "IfcWall"]
    assert without_elements(asked, BUILDING) == ["IfcBeam", "door"]
    (note,) = lacking_notes(asked, BUILDING)
    assert note.startswith("note: the model has no element of the classes IfcBeam, door with a shape")
    assert not lacking_notes(["wall", ALL], BUILDING)
    check_asked(asked, BUILDING)


@pytest.mark.parametrize("names", [["IfcBeam"], ["door", "IfcBeam"], ["door", "door"]])
def test_what_looks_for_nothing_is_refused_in_one_line_that_names_what_there_is(names):
    words = f"no element of the class.* {names[-1]} with a shape; it has .*IfcWall"
    with pytest.raises(InputError, match=words) as told:
        check_asked(names, BUILDING)
    assert "\n" not in str(told.value)


def test_the_usual_classes_are_never_refused_and_told_of_only_where_there_is_none():
    check_asked(USUAL, BUILDING)
    assert not lacking_notes(USUAL, BUILDING)
    slabs = BUILDING._replace(
        elements=TABLE._replace(semantic=TABLE.semantic * 0 + FLOOR, ifc_class=("IfcSlab",) * len(TABLE.guid))
    )
    check_asked(USUAL, slabs)
    (note,) = lacking_notes(USUAL, slabs)
    assert "wall, column" in note


def test_a_whole_and_a_twin_are_elements_of_their_classes():
    twin = Twin("twin", "IfcBeam", "", -1, PILLAR, "b.ifc")
    same = BUILDING._replace(elements=TABLE._replace(twins=((twin,), *TABLE.twins[1:])))
    assert without_elements(["IfcBeam", "column", "door"], same) == ["door"]
    stair = Whole("stair", "IfcStair", "", -1, (TABLE.guid[0],))
    assert not without_elements(["IfcStair"], BUILDING._replace(wholes=(stair,)))
    assert without_elements(["IfcStair"], BUILDING._replace(wholes=(stair._replace(parts=("gone",)),)))
