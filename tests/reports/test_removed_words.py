"""Removed elements that are no mismatch are told in sentences, too: each once, a whole for its parts."""

import pytest

from jaxmm.reports.plain_files import sentences_of
from jaxmm.reports.removed_words import removed_in_words, removed_others
from jaxmm.verdicts.results import ElementVerdict


def element(guid, verdict="removed", ifc_class="IfcBeam", name="", **more):
    return ElementVerdict(guid, ifc_class, name, "storey", verdict, 0.999, 3, (9, 0, 0, 0), **more)


@pytest.mark.parametrize(
    "told, words",
    [
        (element("1", name="B-12"), "The beam 'B-12' has been removed."),
        (element("2GUID", ifc_class="IfcStairFlight"), "The stair flight '2GUID' has been removed."),
        (element("3", ifc_class="", name="box"), "The element 'box' has been removed."),
    ],
)
def test_a_sentence_names_what_is_gone(told, words):
    assert removed_in_words(told) == words


def test_what_mismatches_tell_stands_no_second_time(removed):
    assert removed_others(removed) == [] and sentences_of(removed) == removed.sentences
    told = removed._replace(elements=(*removed.elements, element("1", name="B-12"), element("2", "present")))
    assert sentences_of(told) == (*removed.sentences, "The beam 'B-12' has been removed.")


def test_twins_are_told_once_and_parts_by_their_whole(removed):
    twin = element("1", file="a.ifc", same_as=(("b.ifc", "1"),)), element("1", file="b.ifc", same_as=(("a.ifc", "1"),))
    whole = element("2", ifc_class="IfcStair", parts=(("", "3"),)), element("3", part_of=(("", "2"),))
    left = element("4", "present", parts=(("", "5"),)), element("5", part_of=(("", "4"),))
    told = removed._replace(elements=(*removed.elements, *twin, *whole, *left))
    assert [one.guid for one in removed_others(told)] == ["1", "2", "5"]


def test_a_twin_of_what_a_mismatch_tells_is_told_by_it(removed):
    gone = next(one for one in removed.mismatches if one.element)
    twin = element("twin", file="steel.ifc", same_as=(gone.key,))
    assert removed_others(removed._replace(elements=(*removed.elements, twin))) == []
