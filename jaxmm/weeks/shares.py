"""How much is built, by class, by storey and by task, at the end of each week; and what is behind its schedule."""

from collections.abc import Iterator, Sequence
from datetime import date
from typing import NamedTuple

from jaxmm.ifc.tasks import with_parents
from jaxmm.verdicts.results import once, pieces_of
from jaxmm.weeks.history import ABSENT, GONE, STANDING, STATES, UNKNOWN, Followed, Progress
from jaxmm.weeks.reports import DAY

KINDS = ("all", "class", "storey", "task")
NO_STOREY, NO_CLASS = "without a storey", "without a class"
LATE, OPEN = "late", "not seen"  # of what should be done: it is not, as far as was seen; or nobody has seen it


class Share(NamedTuple):
    """One group of elements in one week; only those that are in the model of that week count."""

    kind: str  # one of KINDS
    name: str
    week: int
    counts: dict[str, int]  # elements by state, in the order of STATES
    done: int  # of these, as they should be in the end: standing, or of a task that takes them away, gone

    @property
    def elements(self) -> int:
        """How many there are."""
        return sum(self.counts.values())

    @property
    def at_least(self) -> float | None:
        """Share that is done, of all; None without elements."""
        return self.done / self.elements if self.elements else None

    @property
    def at_most(self) -> float | None:
        """The same, if all that nobody has seen is done, too."""
        return (self.done + self.counts[UNKNOWN]) / self.elements if self.elements else None


def shares_of(progress: Progress) -> list[Share]:
    """All shares, kind by kind in the order of KINDS; within, as the groups first come up among the elements."""
    every = once_each(progress.elements)
    found = [_share(progress, ("all", "all"), every, week) for week in _weeks(progress)]
    for kind, groups in (("class", _by_class(progress)), ("storey", _by_storey(progress))):
        for name, members in groups.items():
            own = once_each(members)
            found += [_share(progress, (kind, name), own, week) for week in _weeks(progress)]
    for number, members in by_task(progress).items():
        task, members = progress.plan.tasks[number], once_each(members)
        name = task.name or task.guid
        found += [_share(progress, ("task", name), members, week, number) for week in _weeks(progress)]
    return found


def once_each(elements: Sequence[Followed]) -> list[Followed]:
    """Elements without those that are others of them again, in another file: the same, or whole what these are of."""
    listed = [one.latest for one in elements]
    keys = {one.key for one in listed}
    kept = {one.key for one in once(listed) if not pieces_of(one, keys)}
    return [one for one in elements if one.latest.key in kept]


def storey_of(one: Followed) -> str:
    """The name of its storey, or that it has none."""
    return one.latest.storey or NO_STOREY


def by_task(progress: Progress) -> dict[int, list[Followed]]:
    """Elements by the number of the task that they, or a part of it, are assigned to; no task without elements."""
    groups: dict[int, list[Followed]] = {number: [] for number in range(len(progress.plan.tasks))}
    for one in progress.elements:
        for number in with_parents(progress.plan, progress.plan.of_element.get(one.latest.guid, ())):
            groups[number].append(one)
    return {number: members for number, members in groups.items() if members}


class Due(NamedTuple):
    """What the schedule says of an element."""

    tasks: tuple[int, ...]  # that it is assigned to itself
    finish: str | None  # day on which the last of them that should be done, or else the first of all, ends
    behind: str  # LATE, OPEN, or empty: it is as it should be, or nothing is due yet
    days: int  # since then, at the last week; 0 where nothing is behind


def due_of(one: Followed, progress: Progress) -> Due:
    """Whether an element is, at the last week, as its tasks say that it should be."""
    numbers = progress.plan.of_element.get(one.latest.guid, ())
    today = progress.weeks[-1].date[:DAY]
    dated = sorted(
        (progress.plan.tasks[number].finish, number) for number in numbers if progress.plan.tasks[number].finish
    )
    ended = [(finish, number) for finish, number in dated if finish <= today]
    if not dated or not ended:
        return Due(numbers, dated[0][0] if dated else None, "", 0)
    finish, number = ended[-1]
    if not one.moments[-1].in_model or one.state in done_states(one, progress, number):
        return Due(numbers, finish, "", 0)
    days = (date.fromisoformat(today) - date.fromisoformat(finish)).days
    return Due(numbers, finish, OPEN if one.state == UNKNOWN else LATE, days)


def done_states(one: Followed, progress: Progress, task: int | None) -> tuple[str, ...]:
    """The states in which a task has done what it should with an element; without a task, those in which it stands.

    What another task takes away again, such as what only shores the rest up, was built when it is gone.
    """
    if task is None:
        return STANDING
    tasks = progress.plan.tasks
    if tasks[task].removes:
        return (ABSENT, GONE)
    own = progress.plan.of_element.get(one.latest.guid, ())
    return (*STANDING, GONE) if any(tasks[number].removes for number in own) else STANDING


def _share(
    progress: Progress, group: tuple[str, str], members: Sequence[Followed], week: int, task: int | None = None
) -> Share:
    there = [one for one in members if one.moments[week].in_model]
    states = [one.moments[week].state for one in there]
    done = sum(one.moments[week].state in done_states(one, progress, task) for one in there)
    return Share(*group, week, {state: states.count(state) for state in STATES}, done)


def _weeks(progress: Progress) -> Iterator[int]:
    yield from range(len(progress.weeks))


def _by_class(progress: Progress) -> dict[str, list[Followed]]:
    groups: dict[str, list[Followed]] = {}
    for one in progress.elements:
        groups.setdefault(one.latest.ifc_class or NO_CLASS, []).append(one)
    return dict(sorted(groups.items()))


def _by_storey(progress: Progress) -> dict[str, list[Followed]]:
    groups: dict[str, list[Followed]] = {name: [] for name in storeys_of(progress)}
    for one in progress.elements:
        groups[storey_of(one)].append(one)
    return groups


def storeys_of(progress: Progress) -> list[str]:
    """Names of the storeys, from the lowest up by where their elements begin; those of unknown height last, by name."""
    bottoms: dict[str, list[float]] = {}
    for one in progress.elements:
        box = one.latest.box
        bottoms.setdefault(storey_of(one), []).extend([] if box is None else [box.center[2] - box.dimensions[2] / 2])
    middle = {
        name: sorted(heights)[len(heights) // 2] if heights else float("inf") for name, heights in bottoms.items()
    }
    return sorted(bottoms, key=lambda name: (middle[name], name))
