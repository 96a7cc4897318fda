"""Verdicts of any class: by rays that nothing else explains, and of what is put together from elements by its parts.

Such are a stair of flights, a roof of slabs, a facade of plates and members. E elements. A whole is gone only if all of
its parts that can be told of are; where one stands, something of it does.
"""

from collections.abc import Callable, Sequence

import numpy as np

from jaxmm.classes.selection import is_of
from jaxmm.classes.telling_rays import Telling
from jaxmm.verdicts.behind_removed import gone_of
from jaxmm.verdicts.mismatches import KINDS
from jaxmm.verdicts.priors import Prior
from jaxmm.verdicts.results import ElementVerdict
from jaxmm.verdicts.settings import DetectSettings
from jaxmm.verdicts.verdicts import DISPLACED, OCCLUDED, PRESENT, REMOVED, UNSCANNED, Verdict

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
    return ask(others, gone_of(prior.building, verdicts)) if others.any() else []


def wholes_of(
    prior: Prior, verdicts: list[Verdict], elements: tuple[ElementVerdict, ...], settings: DetectSettings
) -> tuple[ElementVerdict, ...]:
    """The verdicts of elements that are asked for, those of wholes by their parts.

    Args:
        prior: a building.
        verdicts: of all its elements, parts that nobody asks for, too.
        elements: those that are asked for, by themselves.
        settings: who is asked for. Wholes have a class of IFC and none of ours.
    """
    table, storeys = prior.building.elements, prior.building.storeys
    row_of = {key: row for row, key in enumerate(zip(table.file, table.guid, strict=True))}
    own = {one.key: one for one in elements}
    for whole in prior.building.wholes:
        key, *parts = ((whole.file, guid) for guid in (whole.guid, *whole.parts))
        rows = [row_of[one] for one in (key, *parts) if one in row_of]
        if not rows or not (key in own or is_of(settings.classes, whole.ifc_class)):
            continue
        told = of_parts([verdicts[row] for row in rows], settings.verdicts.change_prior)
        views = [own[one].next_view for one in parts if one in own and own[one].next_view is not None]
        view = views[0] if told.verdict == OCCLUDED and views else None
        if key in own:
            # Of what has a body itself, that it stands off its place is known of it, and of no part.
            mine = own[key]
            told = told._replace(verdict=DISPLACED) if mine.verdict == DISPLACED else told
            view = mine.next_view if mine.next_view and told.verdict == OCCLUDED else view
            own[key] = mine._replace(**told._asdict(), next_view=view)
            continue
        storey = storeys.name[whole.storey] if whole.storey >= 0 else ""
        own[key] = ElementVerdict(whole.guid, whole.ifc_class, whole.name, storey, *told, view, file=whole.file)
    return tuple(own.values())


def of_parts(parts: Sequence[Verdict], change_prior: float) -> Verdict:
    """The verdict of a whole by those of its parts, at least one; points and rays are of all of them together.

    P(removed) is that of the part which stands most surely: were another as sure, the whole would be no likelier gone.
    """
    seen = [one for one in parts if one.verdict in (PRESENT, DISPLACED, REMOVED)]
    if seen:
        verdict = REMOVED if all(one.verdict == REMOVED for one in seen) else PRESENT
        probability = min(one.probability for one in seen)
    else:
        verdict = OCCLUDED if any(one.verdict == OCCLUDED for one in parts) else UNSCANNED
        probability = change_prior
    rays = np.sum([one.rays for one in parts], axis=0)
    return Verdict(verdict, probability, sum(one.points for one in parts), tuple(int(value) for value in rays))
