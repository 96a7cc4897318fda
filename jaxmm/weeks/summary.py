"""How it stands, in words: what the command prints and the page opens with."""

from jaxmm.reports.markdown import printable
from jaxmm.weeks.history import ABSENT, GONE, OFF, UNKNOWN, Progress
from jaxmm.weeks.shares import LATE, OPEN, Share, due_of, once_each, shares_of


def headline(progress: Progress) -> str:
    """How it stands at the end of the last week."""
    last = [one for one in shares_of(progress) if one.kind == "all"][-1]
    return printable(f"{progress.labels[-1]}: {told_share(last)}")


def lines_of(progress: Progress) -> list[str]:
    """A line for each week, and one on the schedule where there is one."""
    lines, every = [], once_each(progress.elements)
    for share in [one for one in shares_of(progress) if one.kind == "all"]:
        told = sum(one.moments[share.week].told for one in every)
        lines.append(f"{progress.labels[share.week]}: {told_share(share)}; its scans told of {told} elements")
    behind = [due_of(one, progress) for one in every]
    if progress.plan.tasks:
        late, unseen = (sum(due.behind == kind for due in behind) for kind in (LATE, OPEN))
        lines.append(f"by the schedule, {late} elements are late, and {unseen} that should be done were not seen")
    return [printable(line) for line in lines]


def told_share(share: Share) -> str:
    """How much of a group is done, in words."""
    if not share.elements:
        return "no elements"
    counts = share.counts
    parts = [f"{counts[state]} {state}" for state in (OFF, ABSENT, GONE, UNKNOWN) if counts[state]]
    least, most = (f"{value:.0%}" for value in (share.at_least, share.at_most))
    span = least if least == most else f"{least} to {most}"
    return f"{share.done} of {share.elements} elements stand ({span}){'; ' + ', '.join(parts) if parts else ''}"
