"""Verdicts: what scans say of every element of the prior, and where they say nothing.

An element counts as scanned where rays of the pattern reach it in the prior, or in what remains of it without what is
gone (`jaxmm.verdicts.behind_removed`), and any ray counts for it or against it. One that nobody saw is occluded or
unscanned, never a guess. E elements, N points of one scan of the prior.
"""

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from jaxmm.classes.telling_rays import Telling
from jaxmm.config import bounded
from jaxmm.rays.evidence import BLOCKED, SUPPORT, THROUGH, UNSEEN
from warp_scanner.scenes.building import Building, Pieced, rows_by_key

PRESENT, DISPLACED, REMOVED, OCCLUDED, UNSCANNED = VERDICTS = (
    "present", "displaced", "removed", "occluded", "unscanned",
)  # fmt: skip
STANDS = 0.2  # share of the rays that tell of a removed element, that end on it: from here on a part of it may stand
MANY = 500  # rays that tell, from which on those that bring nothing back hide nothing
# Nor do they where so many times the least rays pass, and no larger share of those that tell ends on the element.
SURELY, EMPTY = 3, 0.05
MOST_SURE = 12.0  # logit beyond which one scan is not trusted
# Shares of an element's rays that go through, up to which its points' doubts count as much, and from which not at all.
DOUBTED, UNDOUBTED = 0.8, 0.9
# Shares of the rays that nothing else explains, that go through: up to which an element of any class stands, and from
# which it is gone; with shares between, and not present by all its rays, nobody knows.
MOST_OF_PRESENT, LEAST_OF_REMOVED = 0.5, 0.8


@dataclasses.dataclass(frozen=True)
class VerdictSettings:
    """When an element counts as seen, and as removed."""

    least_rays: int = bounded(20, 1)  # through it or ending on it, of its points' footprints; with fewer it is occluded
    least_share: float = bounded(0.03, 0.0, 1.0)  # the same, of all rays in those footprints
    threshold: float = bounded(0.5, 0.0, 1.0)  # probability from which an element counts as removed
    change_prior: float = bounded(0.02, 1e-6, 1.0 - 1e-6)  # P(removed) of an element without evidence


class Told(NamedTuple):
    """What one scan tells of E elements."""

    scanned: np.ndarray  # (E,) bool, whether any ray of the pattern reaches it in the prior, or past what is gone
    points: np.ndarray  # (E,) int of the prior's scan on it
    rays: np.ndarray  # (E, 4) int in the footprints of those, in the order of evidence.FRACTIONS
    logit: np.ndarray  # (E,) float64 of P(removed), by this scan alone; NaN where no ray tells


class Verdict(NamedTuple):
    """What is known of one element."""

    verdict: str  # one of VERDICTS
    probability: float  # P(removed); the prior's where nothing was seen
    points: int
    rays: tuple[int, int, int, int]


def told_of(scanned: np.ndarray, element: np.ndarray, rays: np.ndarray, probability: np.ndarray) -> Told:
    """What one scan tells of each element.

    Rays that go through an element or end on it tell of it; blocked and unseen ones do not. Its probability is the
    mean of its points', each as often as rays tell of it, half and half with the share of its rays that went through: a
    network may doubt point by point what all of them together leave no doubt of. Where nine in ten rays go through, it
    has no say against it: it learnt in rooms, and behind an outer wall that is gone most rays bring nothing back.

    Args:
        scanned: (E,) bool.
        element: (N,) int row of each point's element.
        rays: (N, 4) int of the robot in the footprint of each point, in the order of evidence.FRACTIONS.
        probability: (N,) that each is gone: the greater of the pillar's and the wall's model, for a wall seen end-on
            looks like a pillar.

    Raises:
        ValueError: the shapes disagree.
    """
    count, element, rays = len(scanned), np.asarray(element), np.asarray(rays)
    if rays.shape != (len(element), 4) or np.shape(probability) != element.shape:
        shapes = f"{element.shape}, {rays.shape}, {np.shape(probability)}"
        raise ValueError(f"element, rays and probability must be (N,), (N, 4), (N,), got {shapes}")
    pooled = np.column_stack([np.bincount(element, rays[:, side], count) for side in range(4)]).astype(np.int64)
    votes = rays[:, [THROUGH, SUPPORT]].sum(axis=1)
    total = np.bincount(element, votes, count)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.bincount(element, votes * probability, count) / total
    share = (pooled[:, THROUGH] + 0.5) / (pooled[:, [THROUGH, SUPPORT]].sum(axis=1) + 1.0)
    by_points, by_rays = _logit(mean), _logit(share)
    heard = np.where(by_points < by_rays, np.clip((UNDOUBTED - share) / (UNDOUBTED - DOUBTED), 0.0, 1.0), 1.0) / 2
    logit = np.where(total > 0, heard * by_points + (1.0 - heard) * by_rays, np.nan)
    return Told(np.asarray(scanned, bool), np.bincount(element, minlength=count), pooled, logit)


def verdicts_of(told: list[Told], settings: VerdictSettings | None = None) -> list[Verdict]:
    """The verdict of each of E elements by all scans together: rays are counted together, log-odds add up.

    A scan in which the element does not count as seen adds no odds, but for what many rays of all together tell where
    most of each come back from nowhere.

    Args:
        told: of each scan, at least one.
        settings: when an element counts as what.
    """
    settings = settings or VerdictSettings()
    start = float(_logit(np.array(settings.change_prior)))
    logit = np.full(len(told[0].scanned), start)
    counts = _counts(told, settings)
    for one, seen in zip(told, counts, strict=True):
        logit[seen] += one.logit[seen] - start
    probability = 1.0 / (1.0 + np.exp(-logit))
    rays, points = sum(one.rays for one in told), sum(one.points for one in told)
    scanned, seen = (np.any(fields, axis=0) for fields in ([one.scanned for one in told], counts))
    scanned &= rays.any(axis=1)  # a direction may meet what no ray that is known passes by, or tells from another
    found = []
    for row in range(len(logit)):
        verdict = REMOVED if probability[row] >= settings.threshold else PRESENT
        if not seen[row]:
            verdict = OCCLUDED if scanned[row] else UNSCANNED
        known = float(probability[row]) if seen[row] else settings.change_prior
        found.append(Verdict(verdict, known, int(points[row]), tuple(int(value) for value in rays[row])))
    return found


def retold(verdicts: list[Verdict], telling: list[Telling], settings: VerdictSettings) -> list[Verdict]:
    """The verdicts, those of some elements by the rays of all scans that nothing else explains.

    The networks learnt of walls and columns. Where fewer than the least rays tell, what they say stands, unless rays
    pass where glass, or a door that is open, lets them through: then nobody knows. Nor do they alone take anything
    away where of few rays no more pass than end on it.

    Args:
        verdicts: of E elements.
        telling: of each scan; without any, or of elements of whom nothing is told, the networks alone say.
        settings: when an element counts as what.
    """
    none = Telling(*np.zeros((3, len(verdicts)), int))
    found, told = list(verdicts), Telling(*(np.sum(counts, axis=0) for counts in zip(none, *telling, strict=True)))
    for row, one in enumerate(verdicts):
        if one.verdict not in (PRESENT, REMOVED):
            continue
        tell = int(told.through[row] + told.support[row])
        share, enough = (float(told.through[row]) + 0.5) / (tell + 1.0), tell >= settings.least_rays
        if enough and share >= LEAST_OF_REMOVED:
            found[row] = one._replace(verdict=REMOVED, probability=max(one.probability, share))
        elif one.verdict == REMOVED and enough and share <= MOST_OF_PRESENT:
            found[row] = one._replace(verdict=PRESENT, probability=min(one.probability, share))
        elif one.verdict == REMOVED and (enough or told.glass[row] or _are_few_and_end_on_it(one.rays, settings)):
            found[row] = one._replace(verdict=OCCLUDED, probability=settings.change_prior)
    return found


def _are_few_and_end_on_it(rays: Sequence[int], settings: VerdictSettings) -> bool:
    through, support = rays[THROUGH], rays[SUPPORT]
    # With fewer than the least it is gone by what the rays of others say, as of a piece of a wall that is.
    few = settings.least_rays <= through + support < SURELY * settings.least_rays
    return few and support >= through


def of_parts(parts: Sequence[Verdict], change_prior: float) -> Verdict:
    """The verdict of a whole by those of its parts, at least one; points and rays are of all of them together.

    It stands off its place if all do that can be told. P(removed) is that of the part which stands most surely: were
    another as sure, the whole would be no likelier gone. Where no more than half of the parts are told, all of these
    gone, the rest may stand or not.
    """
    seen = [one for one in parts if one.verdict in (PRESENT, DISPLACED, REMOVED)]
    few = 2 * len(seen) <= len(parts) and all(one.verdict == REMOVED for one in seen)
    if seen and not few:
        verdict = seen[0].verdict if len({one.verdict for one in seen}) == 1 else PRESENT
        probability = min(one.probability for one in seen)
    else:
        verdict = UNSCANNED if all(one.verdict == UNSCANNED for one in parts) else OCCLUDED
        probability = change_prior
    rays = np.sum([one.rays for one in parts], axis=0)
    return Verdict(verdict, probability, sum(one.points for one in parts), tuple(int(value) for value in rays))


def of_pieced(
    building: Building, verdicts: Sequence[Verdict], change_prior: float
) -> list[tuple[Pieced, list[int], Verdict]]:
    """Each element that another file has in pieces, with rows of these and its verdict by theirs (E of them)."""
    row_of, found = rows_by_key(building.elements), []
    for whole in building.pieced:
        rows = [row_of[key] for key in whole.pieces if key in row_of]
        if rows:
            found.append((whole, rows, of_parts([verdicts[row] for row in rows], change_prior)))
    return found


def pieces_together(building: Building, verdicts: Sequence[Verdict], settings: VerdictSettings) -> list[Verdict]:
    """The verdicts, those of pieces of one element by the rays of all of them where none shows enough by itself.

    A column in a dozen pieces, far away, is as surely there, or gone, as in one.
    """
    found = list(verdicts)
    for _, rows, whole in of_pieced(building, verdicts, settings.change_prior):
        through, support = whole.rays[THROUGH], whole.rays[SUPPORT]
        share = (through + 0.5) / (through + support + 1.0)
        is_gone = share >= LEAST_OF_REMOVED
        known = is_gone or share <= MOST_OF_PRESENT
        if not known or any(found[row].verdict not in (OCCLUDED, UNSCANNED) for row in rows):
            continue
        if not is_seen(np.array([whole.rays]), settings)[0]:
            continue
        for row in rows:
            if found[row].rays[THROUGH] + found[row].rays[SUPPORT]:
                found[row] = found[row]._replace(verdict=REMOVED if is_gone else PRESENT, probability=share)
    return found


def keys_of(whole: Pieced) -> tuple[tuple[str, str], ...]:
    """File and GlobalId of an element that another file has in pieces, and of the same in other files."""
    return tuple((one.file, one.guid) for one in (whole.element, *whole.twins))


def within(whole: Pieced, others: Sequence[Pieced]) -> list[Pieced]:
    """Those of some elements that are in pieces, whose pieces are some of another's: a third file has it in these."""
    return [other for other in others if set(other.pieces) < set(whole.pieces)]


def is_seen(rays: np.ndarray, settings: VerdictSettings) -> np.ndarray:
    """(E,) bool: whether enough of the rays (E, 4) went through an element or ended on it to tell.

    Where an outer wall is gone most rays come back from nowhere: where many tell, or all say that nothing is there,
    those are not asked for a share.
    """
    tells, back = _told_and_back(rays)
    alone = _needs_no_share(rays, settings) & is_enough(tells, back, settings)
    return alone | is_enough(tells, back + rays[:, UNSEEN], settings)


def _needs_no_share(rays: np.ndarray, settings: VerdictSettings) -> np.ndarray:
    """(E,) bool: of the rays (E, 4) so many tell, or all of them the same, that those without a return hide nothing."""
    tells, _ = _told_and_back(rays)
    is_empty = (rays[:, THROUGH] >= SURELY * settings.least_rays) & (rays[:, SUPPORT] <= EMPTY * tells)
    return (tells >= MANY) | is_empty


def is_enough(tells: np.ndarray, meant: np.ndarray, settings: VerdictSettings) -> np.ndarray:
    """(E,) bool: whether so many rays (E,) tell, of all that are meant to meet an element (E,)."""
    return (tells >= settings.least_rays) & (tells >= settings.least_share * meant)


def _counts(told: list[Told], settings: VerdictSettings) -> list[np.ndarray]:
    """Of each scan (E,) bool: whether what it tells of an element counts."""
    alone = [is_seen(one.rays, settings) for one in told]
    none, total = ~np.any(alone, axis=0), sum(one.rays for one in told)
    together = none & _needs_no_share(total, settings) & is_seen(total, settings)
    if not together.any():
        return alone
    enough = [is_enough(*_told_and_back(one.rays), settings) for one in told]
    return [seen | (together & own) for seen, own in zip(alone, enough, strict=True)]


def _told_and_back(rays: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(E,) rays (E, 4) that tell, and those that come back."""
    return rays[:, [THROUGH, SUPPORT]].sum(axis=1), rays[:, [THROUGH, SUPPORT, BLOCKED]].sum(axis=1)


def _logit(probability: np.ndarray) -> np.ndarray:
    clipped = np.clip(probability, 1e-7, 1.0 - 1e-7)
    return np.clip(np.log(clipped / (1.0 - clipped)), -MOST_SURE, MOST_SURE)
