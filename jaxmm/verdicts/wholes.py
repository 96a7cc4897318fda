"""Verdicts of any class: by rays that nothing else explains, and of what is put together from elements by its parts.

Such are a stair of flights, a roof of slabs, a facade of plates and members, and one trade's wall that another has in
pieces. E elements. A whole is gone only if all of its parts that can be told of are; where one stands, something of it
does.
"""

from collections.abc import Callable, Sequence

import numpy as np

from jaxmm.classes.selection import is_of
from jaxmm.classes.telling_rays import Telling
from jaxmm.deviations.deviation import Deviation
from jaxmm.learning.element_boxes import UprightBox
from jaxmm.verdicts.as_built import AsBuilt, class_name, is_displaced
from jaxmm.verdicts.behind_removed import filling, gone_of, holders
from jaxmm.verdicts.mismatches import KINDS
from jaxmm.verdicts.priors import Prior
from jaxmm.verdicts.results import ElementVerdict, Key, Pose
from jaxmm.verdicts.settings import DetectSettings
from jaxmm.verdicts.verdicts import (
    DISPLACED,
    OCCLUDED,
    PRESENT,
    REMOVED,
    Verdict,
    keys_of,
    of_parts,
    of_pieced,
    within,
)
from warp_scanner.scenes.building import Pieced, rows_by_key

Ask = Callable[[np.ndarray, np.ndarray], list[Telling]]


def telling_of(prior: Prior, verdicts: list[Verdict] | None, settings: DetectSettings, ask: Ask) -> list[Telling]:
    """What each scan tells of those who are asked for and are neither walls nor columns; nothing where nobody is.

    Args:
        prior: what should be there.
        verdicts: of all elements of a building, as the networks have them.
        settings: who is asked for.
        ask: gives what each scan tells of some elements (E,) bool, without what is gone (E,) bool.
    """
    if verdicts is None or settings.preset == "thesis":
        return []
    table = prior.building.elements
    others = settings.asked(table) & ~np.isin(table.semantic, list(KINDS))
    if not others.any():
        return []
    gone = gone_of(prior.building, verdicts)
    # With a wall go the doors and windows in it: they hide no more than it does.
    return ask(others, gone | filling(prior.building, holders(prior.building, gone)))


def wholes_of(
    prior: Prior,
    verdicts: list[Verdict],
    elements: tuple[ElementVerdict, ...],
    settings: DetectSettings,
    stands: AsBuilt,
) -> tuple[ElementVerdict, ...]:
    """The verdicts of elements that are asked for, those of wholes by their parts, which name each other.

    Args:
        prior: a building.
        verdicts: of all its elements, parts that nobody asks for, too.
        elements: those that are asked for, by themselves.
        settings: who is asked for. Wholes have a class of IFC and none of ours, but for what is in pieces elsewhere.
        stands: of its elements, and of what has them as pieces, where they stand.
    """
    storeys, own = prior.building.storeys, {one.key: one for one in elements}
    told_of = _told_with_pieced(own, prior, verdicts, settings, stands)  # which may be parts, too
    for whole in prior.building.wholes:
        key, *parts = ((whole.file, guid) for guid in (whole.guid, *whole.parts))
        known = [told_of[one] for one in (key, *parts) if one in told_of]
        if not known or not (key in own or is_of(settings.classes, whole.ifc_class)):
            continue
        told = of_parts(known, settings.verdicts.change_prior)
        mine = own.get(key)
        if told.verdict == DISPLACED or (mine and mine.verdict == DISPLACED):
            # Of what has a body itself, that it stands off its place is known of it, and of no part.
            told = told._replace(verdict=DISPLACED if mine and mine.verdict == DISPLACED else PRESENT)
        view = _view(own, (key, *parts)) if told.verdict == OCCLUDED else None
        if mine:
            own[key] = mine._replace(**told._asdict(), next_view=view)
        else:
            storey = storeys.name[whole.storey] if whole.storey >= 0 else ""
            own[key] = ElementVerdict(whole.guid, whole.ifc_class, whole.name, storey, *told, view, file=whole.file)
        _name(own, [key], {one: told_of[one] for one in parts if one in told_of})
    return tuple(own.values())


def _told_with_pieced(
    own: dict[Key, ElementVerdict],
    prior: Prior,
    verdicts: list[Verdict],
    settings: DetectSettings,
    stands: AsBuilt,
) -> dict[Key, Verdict]:
    """Verdicts of all elements; those of what is in pieces elsewhere, by these, come among those asked for, too."""
    storeys, row_of = prior.building.storeys, rows_by_key(prior.building.elements)
    told_of = {key: verdicts[row] for key, row in row_of.items()}
    for whole, rows, told in of_pieced(prior.building, verdicts, settings.verdicts.change_prior):
        told_of |= dict.fromkeys(keys_of(whole), told)
        each = [one for one in (whole.element, *whole.twins) if settings.asks_for(one.ifc_class, one.semantic)]
        keys = [(one.file, one.guid) for one in each]
        off = _deviation(whole, told, [(verdicts[row], stands.deviation(row)) for row in rows], stands)
        if told.verdict in (PRESENT, DISPLACED):
            limit = settings.deviations.of(class_name(whole.element.semantic))
            is_off = off is not None and is_displaced(off, limit, settings.verdicts.least_rays)
            told = told._replace(verdict=DISPLACED if is_off else PRESENT)
        view = _view(own, whole.pieces) if told.verdict == OCCLUDED else None
        box = UprightBox(whole.center, whole.size, (whole.yaw + 90.0) % 180.0 - 90.0).shifted(prior.origin)
        for number, (one, key) in enumerate(zip(each, keys, strict=True)):
            storey = storeys.name[one.storey] if one.storey >= 0 else ""
            own[key] = ElementVerdict(
                one.guid, one.ifc_class, one.name, storey, *told, view, off, box, one.file,
                (*keys[:number], *keys[number + 1 :]),
            )  # fmt: skip
        here = [key for key in whole.pieces if key in row_of]
        _name(own, keys, {key: verdicts[row] for key, row in zip(here, rows, strict=True)})
    for whole in prior.building.pieced:
        for key in (key for other in within(whole, prior.building.pieced) for key in keys_of(other) if key in own):
            own[key] = own[key]._replace(part_of=(*own[key].part_of, *(one for one in keys_of(whole) if one in own)))
    return told_of


def _deviation(
    whole: Pieced, told: Verdict, parts: Sequence[tuple[Verdict, Deviation | None]], stands: AsBuilt
) -> Deviation | None:
    """Of what is in pieces, by the faces of all of them; where none shows a face, of that on which most rays end.

    None where some are gone and others are not, or where they do not move as one.
    """
    if told.verdict != REMOVED and any(one.verdict == REMOVED for one, _ in parts):
        return None
    if (key := keys_of(whole)[0]) in stands.wholes:
        return stands.wholes[key]
    return max((off for _, off in parts if off is not None), key=lambda one: one.rays, default=None)


def _view(own: dict[Key, ElementVerdict], keys: Sequence[Key]) -> Pose | None:
    """The first view to take next, of some elements."""
    return next((own[key].next_view for key in keys if key in own and own[key].next_view is not None), None)


def _name(own: dict[Key, ElementVerdict], wholes: Sequence[Key], parts: dict[Key, Verdict]) -> None:
    """Write what is of what into the verdicts of wholes and of their parts, as far as they are asked for."""
    gone = tuple(key for key, one in parts.items() if one.verdict == REMOVED)
    for key in wholes:
        mine = own[key]
        own[key] = mine._replace(parts=(*mine.parts, *parts), parts_gone=(*mine.parts_gone, *gone))
    for key in (same for part in parts if part in own for same in (part, *own[part].same_as)):
        own[key] = own[key]._replace(part_of=(*own[key].part_of, *wholes))
