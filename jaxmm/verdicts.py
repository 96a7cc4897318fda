"""Verdicts: what one scan says of every element of the prior, and where it says nothing.

E elements, N points of the DT scan. An element that nobody saw is occluded or unscanned, never a guess.
"""

from typing import NamedTuple

import numpy as np

from jaxmm.evidence import BLOCKED, SUPPORT, THROUGH, UNSEEN

PRESENT, REMOVED, OCCLUDED, UNSCANNED = VERDICTS = ("present", "removed", "occluded", "unscanned")


class VerdictSettings(NamedTuple):
    """When an element counts as seen, and as removed."""

    least_rays: int = 20  # through it or ending on it, of all footprints of its points; with fewer it is occluded
    least_share: float = 0.03  # the same, of all rays in those footprints
    threshold: float = 0.5  # probability from which an element counts as removed
    change_prior: float = 0.02  # P(removed) of an element without evidence


class Verdict(NamedTuple):
    """What is known of one element."""

    element: int
    verdict: str  # one of VERDICTS
    probability: float  # P(removed); the prior's where nothing was seen
    points: int  # of the DT scan on it
    rays: tuple[int, int, int, int]  # in the footprints of those, in the order of evidence.FRACTIONS


def verdicts_of(
    elements: np.ndarray,
    scanned: np.ndarray,
    seen: tuple[np.ndarray, np.ndarray, np.ndarray],
    settings: VerdictSettings | None = None,
) -> list[Verdict]:
    """A verdict for each of the given elements, in their order.

    Rays that go through an element or end on it tell of it; blocked and unseen ones do not.

    Args:
        elements: (E,) int, all that a verdict is wanted for, in view or not.
        scanned: (E,) bool, whether any ray of the pattern reaches it in the prior, before filters and thinning.
        seen: of the DT scan's points their element (N,), the robot's rays in their footprints (N, 4) in the order of
            evidence.FRACTIONS, and the probability (N,) that each is gone: the greater of the pillar's and the wall's
            model, for a wall seen end-on looks like a pillar.
        settings: when an element counts as what.

    Raises:
        ValueError: the shapes disagree.
    """
    settings = settings or VerdictSettings()
    owner, count, probability = (np.asarray(field) for field in seen)
    if count.shape != (len(owner), 4) or probability.shape != owner.shape:
        raise ValueError(f"seen must be (N,), (N, 4), (N,), got {owner.shape}, {count.shape}, {probability.shape}")
    columns = count, probability, settings
    return [_verdict(int(one), there, owner == one, *columns) for one, there in zip(elements, scanned, strict=True)]


def _verdict(
    element: int, scanned: bool, own: np.ndarray, count: np.ndarray, probability: np.ndarray, settings: VerdictSettings
) -> Verdict:
    rays = count[own].sum(axis=0).astype(np.int64)
    told = count[own][:, [THROUGH, SUPPORT]].sum(axis=1)
    total, points = int(told.sum()), int(own.sum())
    shape = (points, tuple(int(value) for value in rays))
    if not scanned:
        return Verdict(element, UNSCANNED, settings.change_prior, *shape)
    if total < settings.least_rays or total < settings.least_share * rays[[THROUGH, SUPPORT, BLOCKED, UNSEEN]].sum():
        return Verdict(element, OCCLUDED, settings.change_prior, *shape)
    # Points that no ray tells of have a probability all the same; it counts for nothing here.
    mean = float(np.average(probability[own], weights=told))
    return Verdict(element, REMOVED if mean >= settings.threshold else PRESENT, mean, *shape)
