"""Sentences on removed elements that are no mismatch: a beam, a stair, a window, where such classes are asked for."""

from jaxmm.reports.deviation_words import kind_of_class
from jaxmm.verdicts.results import Detection, ElementVerdict, once
from jaxmm.verdicts.verdicts import REMOVED


def removed_others(detection: Detection) -> list[ElementVerdict]:
    """Removed elements that no mismatch tells of, and that are no part of a removed whole; once each."""
    told = {one.key for one in detection.mismatches}
    removed = [one for one in once(detection.elements) if one.verdict == REMOVED]
    wholes = {one.key for one in removed if one.parts}
    return [
        one for one in removed if told.isdisjoint((one.key, *one.same_as)) and wholes.isdisjoint(one.part_of)
    ]  # fmt: skip


def removed_in_words(one: ElementVerdict) -> str:
    """A sentence on a removed element: "The beam 'B-12' has been removed".

    Names are as the file has them: whoever shows the sentence must escape it.
    """
    return f"The {kind_of_class(one.ifc_class)} {(one.name or one.guid)!r} has been removed."
