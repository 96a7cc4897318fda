"""Progress as tables: progress.csv, shares.csv, progress.xlsx and progress.json."""

from pathlib import Path
from typing import Any

from jaxmm.files import write_json
from jaxmm.reports.plain_files import as_csv, write_csv
from jaxmm.reports.workbook import add_sheet, write_book
from jaxmm.weeks.history import STATES, Followed, Moment, Progress
from jaxmm.weeks.shares import Share, due_of, shares_of

FORMAT = 1  # of progress.json
CSV, SHARES, WORKBOOK, JSON = "progress.csv", "shares.csv", "progress.xlsx", "progress.json"
_WHO = ("guid", "file", "ifc_class", "name", "storey")
_WHEN = ("first_seen", "not_before", "last_seen", "removed", "displaced")


def write_tables(folder: Path, progress: Progress) -> bool:
    """Write the four; False where there is no workbook among them, as openpyxl is not installed.

    Raises:
        OSError: one cannot be written.
    """
    shares = shares_of(progress)
    write_csv(folder / CSV, elements_csv(progress))
    write_csv(folder / SHARES, shares_csv(progress, shares))
    write_json(folder / JSON, to_json(progress, shares))
    return _write_workbook(folder / WORKBOOK, progress, shares)


def elements_csv(progress: Progress) -> str:
    """A row for each element: RFC 4180, in metres; dates as they are, empty where there is none.

    `since` is when a scan last told of it, so what it was then, it is now as far as anybody knows; for each week the
    state at its end, in brackets where that week's scans did not tell of it, and how far off its place it was.
    """
    columns = [*_WHO, "state", "since", *_WHEN, "moved [m]", "planned_finish", "behind", "days_behind", "tasks"]
    columns += [f"state {label}" for label in progress.labels]
    columns += [f"{name} {label} [m]" for label in progress.labels for name in ("offset_x", "offset_y", "offset_z")]
    return as_csv(columns, [_row(one, progress) for one in progress.elements])


def shares_csv(progress: Progress, shares: list[Share]) -> str:
    """A row for each group and week: elements by state, and the share that is done, at least and at most."""
    columns = ["kind", "name", "week", "elements", *(state.replace(" ", "_") for state in STATES), "done"]
    rows = [
        [one.kind, one.name, progress.labels[one.week], one.elements, *one.counts.values(), one.done, one.at_least,
         one.at_most]
        for one in shares
    ]  # fmt: skip
    return as_csv([*columns, "share_at_least", "share_at_most"], rows)


def to_json(progress: Progress, shares: list[Share]) -> dict[str, Any]:
    """The content of progress.json; valid against progress_schema.json."""
    return {
        "format": FORMAT,
        "weeks": [
            {"report": week.name, "date": week.date, "label": label, "model": week.model._asdict(),
             "doubts": list(week.doubts), "added": [_plain(box) for box in week.added]}
            for week, label in zip(progress.weeks, progress.labels, strict=True)
        ],
        "elements": [_element(one, progress) for one in progress.elements],
        "shares": [
            {"kind": one.kind, "name": one.name, "week": one.week, "elements": one.elements, "counts": one.counts,
             "done": one.done, "at_least": _rounded(one.at_least), "at_most": _rounded(one.at_most)}
            for one in shares
        ],
        "tasks": [task._asdict() for task in progress.plan.tasks],
        "notes": list(progress.notes),
    }  # fmt: skip


def _who(one: Followed) -> list[str]:
    latest = one.latest
    return [latest.guid, latest.file, latest.ifc_class, latest.name, latest.storey]


def _when(one: Followed, labels: list[str]) -> list[str | None]:
    return [None if (week := getattr(one, name)) is None else labels[week] for name in _WHEN]


def _row(one: Followed, progress: Progress) -> list[Any]:
    labels, due = progress.labels, due_of(one, progress)
    since, last = one.moments[-1].since, one.moments[-1]
    offsets = [value for moment in one.moments for value in _offset(moment)]
    return [
        *_who(one), one.state if last.in_model else "no longer in the model", None if since is None else labels[since],
        *_when(one, labels), one.moved[0] if one.moved else None, due.finish, due.behind or None, due.days or None,
        _task_names(due.tasks, progress), *(told_state(moment) for moment in one.moments), *offsets,
    ]  # fmt: skip


def _task_names(numbers: tuple[int, ...], progress: Progress) -> str | None:
    return "; ".join(progress.plan.tasks[n].name or progress.plan.tasks[n].guid for n in numbers) or None


def told_state(moment: Moment) -> str | None:
    """The state in a cell: in brackets where it is kept from an earlier week, nothing where it is not in the model."""
    if not moment.in_model:
        return None
    return moment.state if moment.told or moment.since is None else f"({moment.state})"


def _offset(moment: Moment) -> list[float | None]:
    """(3,) [m]; None along what no face fixes."""
    if moment.offset is None:
        return [None] * 3
    return [
        None if span is None else value
        for value, span in zip(moment.offset.offset, moment.offset.interval, strict=True)
    ]


def _element(one: Followed, progress: Progress) -> dict[str, Any]:
    due = due_of(one, progress)
    told = dict(zip(_WHO, _who(one), strict=True)) | {
        "box": None if one.latest.box is None else _plain(one.latest.box),
        "state": one.state, "in_model": one.moments[-1].in_model, "since": one.moments[-1].since,
    }  # fmt: skip
    moved = None
    if one.moved is not None:
        moved = {"by": _rounded(one.moved[0]), "from": one.moved[1], "to": one.moved[2]}
    return (
        told
        | {name: getattr(one, name) for name in _WHEN}
        | {
            "moved": moved, "tasks": list(due.tasks), "planned_finish": due.finish, "behind": due.behind or None,
            "days_behind": due.days, "weeks": [_moment(moment) for moment in one.moments],
        }
    )  # fmt: skip


def _moment(one: Moment) -> dict[str, Any]:
    off = None
    if one.offset is not None:
        off = {name: _listed(value) for name, value in one.offset._asdict().items()}
    return {
        "verdict": one.verdict, "in_model": one.in_model, "told": one.told, "state": one.state, "since": one.since,
        "probability": one.probability, "deviation": off,
    }  # fmt: skip


def _listed(value: Any) -> Any:
    return [_listed(one) for one in value] if isinstance(value, tuple) else _rounded(value)


def _plain(box: Any) -> dict[str, Any]:
    return {name: _listed(value) for name, value in box._asdict().items()}


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(value, 6)


def _write_workbook(path: Path, progress: Progress, shares: list[Share]) -> bool:
    try:
        from openpyxl import Workbook
    except ImportError:
        return False
    labels, book = progress.labels, Workbook()
    book.remove(book.active)
    who = ("class", "storey", "name", "GlobalId", "file")
    columns = (
        *who, "state", "since", "first seen", "not before", "last seen", "removed", "displaced", "moved [mm]",
        "planned finish", "behind", "days behind", "tasks", *labels, *(f"off {label} [mm]" for label in labels),
    )  # fmt: skip
    rows = []
    for one in progress.elements:
        cells = _row(one, progress)
        guid, file, kind, name, storey, state, since, *when = cells[:12]
        moved, finish, behind, days, tasks = cells[12:17]
        states = cells[17 : 17 + len(labels)]
        rows.append([
            kind, storey, name, guid, file, state, since, *when, None if moved is None else 1000.0 * moved, finish,
            behind, days, tasks, *states, *(_length(moment) for moment in one.moments),
        ])  # fmt: skip
    add_sheet(book, "Elements", columns, rows)
    changes = [
        [labels[week], before, after, *_in_book(one)]
        for week in range(len(labels))
        for one in progress.elements
        for when, before, after in one.told_changes
        if when == week
    ]
    add_sheet(book, "Changes", ("week", "was", "is", *who), changes)
    head = ("by", "name", "week", "elements", *STATES, "done", "done, at least [%]", "done, at most [%]")
    counted = [
        [one.kind, one.name, labels[one.week], one.elements, *one.counts.values(), one.done,
         *(None if value is None else 100.0 * value for value in (one.at_least, one.at_most))]
        for one in shares
    ]  # fmt: skip
    add_sheet(book, "Shares", head, counted)
    offsets = [
        [*_in_book(one), labels[week], *_measured(moment)]
        for one in progress.elements
        for week, moment in enumerate(one.moments)
        if moment.offset is not None
    ]
    axes = [
        f"{axis}{end} [mm]" for axis in ("x (east)", "y (north)", "z (up)") for end in ("", " at least", " at most")
    ]
    add_sheet(book, "Offsets", (*who, "week", *axes, "turn [deg]", "lean [deg]"), offsets)
    write_book(path, book)
    return True


def _in_book(one: Followed) -> list[str]:
    guid, file, kind, name, storey = _who(one)
    return [kind, storey, name, guid, file]


def _length(moment: Moment) -> float | None:
    """How far off it was [mm]."""
    if moment.offset is None:
        return None
    return 1000.0 * sum(value * value for value in moment.offset.offset) ** 0.5


def _measured(moment: Moment) -> list[float | None]:
    cells: list[float | None] = []
    for value, span in zip(_offset(moment), moment.offset.interval, strict=True):
        cells += [None] * 3 if span is None else [1000.0 * value, 1000.0 * span[0], 1000.0 * span[1]]
    return [*cells, moment.offset.turn, moment.offset.lean]
