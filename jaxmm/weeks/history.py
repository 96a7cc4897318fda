"""What became of each element over the weeks: built, displaced, removed; and what no scan showed keeps what it was.

W weeks, in the order of their dates. A week is a number from 0 on, here and in all that is made of it.
"""

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from jaxmm.ifc.tasks import NO_PLAN, TaskPlan
from jaxmm.reports.markdown import printable
from jaxmm.verdicts.verdicts import DISPLACED, PRESENT, REMOVED
from jaxmm.weeks.reports import Key, Listed, Offset, Week, labels_of

BUILT, OFF, GONE, ABSENT, UNKNOWN = "built", "displaced", "removed", "not built", "not seen"
STATES = (BUILT, OFF, ABSENT, GONE, UNKNOWN)
STANDING = (BUILT, OFF)
FIRST_SEEN = "first seen to stand"  # in place of built, where no week before saw that it was not there
STATE_WORDS = {
    BUILT: "It was seen in its place.",
    OFF: "It was seen, off its place by more than its tolerance and than the measurement leaves open.",
    ABSENT: "Its place was seen, and it was never there yet.",
    GONE: "It was there in an earlier week, and its place was seen without it since.",
    UNKNOWN: "No scan has shown its place yet.",
}
MOST_NAMED = 5


class Moment(NamedTuple):
    """An element in one week."""

    verdict: str | None  # of that week's report; None where it is not listed there
    in_model: bool  # whether it is part of the model of that week, as far as the reports tell
    told: bool  # whether that week's scans told of it; else it keeps what it was
    state: str  # one of STATES, at the end of that week
    since: int | None  # the last week that told of it; None before any did
    probability: float | None  # that it was removed, of that week's report
    offset: Offset | None  # as measured in that week


class Followed(NamedTuple):
    """One element over all weeks."""

    key: Key
    latest: Listed  # as the last report that lists it has it
    moments: tuple[Moment, ...]  # (W,)
    first_seen: int | None  # the first week in which it stood
    not_before: int | None  # the last week before that, in which its place was seen without it
    last_seen: int | None  # the last week in which it was seen to stand
    removed: int | None  # the week from which on it is gone; None while it stands, or never did
    displaced: int | None  # the week from which on it is displaced; None where it is not
    moved: tuple[float, int, int] | None  # by how much [m], between which weeks, beyond what both intervals leave open

    @property
    def state(self) -> str:
        """At the end of the last week."""
        return self.moments[-1].state

    @property
    def changes(self) -> list[tuple[int, str, str]]:
        """Week, state before and state after, of every change of state."""
        states = [UNKNOWN, *(one.state for one in self.moments)]
        return [(week, a, b) for week, (a, b) in enumerate(itertools.pairwise(states)) if a != b]

    @property
    def told_changes(self) -> list[tuple[int, str, str]]:
        """The same in words: what nobody saw before was not built in that week as far as anybody knows."""
        return [(week, a, _became(a, b)) for week, a, b in self.changes]


def _became(before: str, after: str) -> str:
    if before != UNKNOWN or after not in STANDING:
        return after
    return FIRST_SEEN if after == BUILT else f"{FIRST_SEEN}, {after}"


class Progress(NamedTuple):
    """All elements over all weeks."""

    weeks: tuple[Week, ...]
    elements: tuple[Followed, ...]  # the union of all reports
    plan: TaskPlan  # of the model, where it was given
    notes: tuple[str, ...]  # what a reader must know, a line each

    @property
    def labels(self) -> list[str]:
        """What to call the weeks."""
        return labels_of(self.weeks)


def follow(weeks: Sequence[Week], plan: TaskPlan = NO_PLAN) -> Progress:
    """Follow every element that a report lists.

    Args:
        weeks: at least one, in order; from reports.read_weeks.
        plan: tasks by GlobalId.
    """
    # In the order of the last report, and then of those before: a model grows.
    keys = list(dict.fromkeys(key for week in reversed(weeks) for key in week.elements))
    elements = tuple(_followed(key, weeks) for key in keys)
    return Progress(tuple(weeks), elements, plan, _notes(weeks, elements))


def _followed(key: Key, weeks: Sequence[Week]) -> Followed:
    listed = [week.elements.get(key) for week in weeks]
    latest = next(one for one in reversed(listed) if one is not None)
    moments: list[Moment] = []
    stood, state, since = False, UNKNOWN, None
    for number, (week, one) in enumerate(zip(weeks, listed, strict=True)):
        told = one is not None and one.verdict in (PRESENT, DISPLACED, REMOVED)
        if told:
            state = {PRESENT: BUILT, DISPLACED: OFF, REMOVED: GONE if stood else ABSENT}[one.verdict]
            stood, since = stood or state in STANDING, number
        # A report lists no class that nobody asked for; only of those that it lists does a gap say something.
        in_model = one is not None or latest.ifc_class not in week.classes
        found = (None, None, None) if one is None else (one.verdict, one.probability, one.offset)
        moments.append(Moment(found[0], in_model, told, state, since, found[1], found[2]))
    seen = [number for number, one in enumerate(moments) if one.told and one.state in STANDING]
    empty = [n for n, one in enumerate(moments) if one.told and one.state == ABSENT]  # what stood once is no more so
    return Followed(
        key, latest, tuple(moments), seen[0] if seen else None, empty[-1] if seen and empty else None,
        seen[-1] if seen else None, _run(moments, GONE), _run(moments, OFF), _moved(moments),
    )  # fmt: skip


def _run(moments: Sequence[Moment], state: str) -> int | None:
    """Where the last moments that all have a state begin; None where the last does not."""
    first = None
    for number in range(len(moments) - 1, -1, -1):
        if moments[number].state != state:
            break
        first = number
    return first


def _moved(moments: Sequence[Moment]) -> tuple[float, int, int] | None:
    """The largest move since it was first measured, along axes on which the two intervals have nothing in common."""
    measured = [number for number, one in enumerate(moments) if one.offset is not None and one.state in STANDING]
    best = None
    for number in measured[1:]:
        before, after = moments[measured[0]].offset, moments[number].offset
        apart = [
            a is not None and b is not None and (a[1] < b[0] or b[1] < a[0])
            for a, b in zip(before.interval, after.interval, strict=True)
        ]
        by = float(np.linalg.norm(np.subtract(after.offset, before.offset)[apart])) if any(apart) else 0.0
        if by > 0.0 and (best is None or by > best[0]):
            best = by, measured[0], number
    return best


def _notes(weeks: Sequence[Week], elements: Sequence[Followed]) -> tuple[str, ...]:
    labels = labels_of(weeks)
    notes = [f"{label} ({week.name}): in doubt: {one}" for label, week in zip(labels, weeks, strict=True)
             for one in week.doubts]  # fmt: skip
    for number in range(1, len(weeks)):
        one, other = weeks[number - 1], weeks[number]
        asked = one.classes & other.classes
        old, new = ({k for k, e in week.elements.items() if e.ifc_class in asked} for week in (one, other))
        if old != new:
            notes.append(
                f"{labels[number]}: the model has changed since {labels[number - 1]}: {len(new - old)} elements are "
                f"new, {len(old - new)} are no longer in it, {len(old & new)} are in both"
            )
    notes += _without_parts(labels, elements)
    back = [one for one in elements if any(a == GONE and b in STANDING for _, a, b in one.changes)]
    if back:
        names = _first([repr(one.latest.name or one.latest.guid) for one in back], ", ")
        notes.append(f"told to be removed in one week, and seen again in a later one: {names}")
    return tuple(_shown(note) for note in notes)


def _without_parts(labels: Sequence[str], elements: Sequence[Followed]) -> list[str]:
    """A note for each week on what stands though parts of it do not: a whole stands as long as any of them does."""
    known = {(one.latest.file, one.latest.guid): one for one in elements}
    notes = []
    for week, label in enumerate(labels):
        named = []
        for one in elements:
            parts = [known[key] for key in one.latest.parts if key in known]
            gone = [part for part in parts if part.moments[week].state in (ABSENT, GONE)]
            if gone and one.moments[week].state in STANDING:
                told = _first([f"{_called(part)} {part.moments[week].state}" for part in gone], ", ")
                named.append(f"{_called(one)}: {told}")
        if named:
            notes.append(f"{label}: stands as a whole, but not in all its parts: {_first(named, '; ')}")
    return notes


def _called(one: Followed) -> str:
    return f"{one.latest.name!r} ({one.latest.guid})"


def _first(names: Sequence[str], between: str) -> str:
    more = f" and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else ""
    return between.join(names[:MOST_NAMED]) + more


def _shown(text: str) -> str:
    """One line without what a terminal would obey: reports come from elsewhere."""
    return "".join(letter if letter.isprintable() else " " for letter in printable(text))
