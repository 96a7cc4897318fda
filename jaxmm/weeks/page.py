"""progress.html: one file with a slider over the weeks, from disk and without any network.

The parts stand in viewer/. The document allows its own script and style and no other, by their hashes, and nothing may
be loaded: names out of foreign files are shown as text, whatever they hold.
"""

import html
import re
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from jaxmm.files import write_text
from jaxmm.learning.element_boxes import UprightBox
from jaxmm.reports.markdown import printable
from jaxmm.reports.page import allowed_hash
from jaxmm.reports.page_data import as_script
from jaxmm.weeks.colours import colour_of
from jaxmm.weeks.history import STATES, Followed, Moment, Progress
from jaxmm.weeks.outlines import Outlines
from jaxmm.weeks.shares import Share, due_of, once_each, shares_of, storey_of
from jaxmm.weeks.summary import headline


def write_page(path: Path, progress: Progress, outlines: Outlines) -> None:
    """Write the page, whole or not at all.

    Raises:
        OSError: it cannot be written; the path stays as it was.
    """
    write_text(path, page_text(progress, outlines))


def page_text(progress: Progress, outlines: Outlines) -> str:
    """The page as HTML."""
    style, script = _part("progress.css"), "\n".join(["(() => {", '"use strict";', _part("progress.js"), "})();"])
    models = list(dict.fromkeys(week.model.file for week in progress.weeks if week.model.file))
    allowed = f"script-src {allowed_hash(script)}; style-src {allowed_hash(style)}"
    values = {
        "policy": f"default-src 'none'; img-src data:; {allowed}",
        "title": html.escape(headline(progress)),
        "model": html.escape(printable(f"Compared with: {', '.join(models)}" if models else "")),
        "notes": "\n".join(f'<p class="note">{html.escape(printable(note))}</p>' for note in progress.notes),
        "style": style,
        "data": as_script(page_data(progress, outlines)),
        "script": script,
    }
    return re.sub(r"\{\{(\w+)\}\}", lambda found: values[found[1]], _part("progress.html"))


def page_data(progress: Progress, outlines: Outlines) -> dict[str, Any]:
    """All that the page shows, as plain values for JSON; lengths on the plan in metres, offsets in millimetres."""
    row = {one.key: number for number, one in enumerate(progress.elements)}
    return {
        "states": list(STATES),
        "weeks": [
            {"label": label, "date": week.date, "report": printable(week.name),
             "added": [_added(box, outlines.base) for box in week.added]}
            for week, label in zip(progress.weeks, progress.labels, strict=True)
        ],
        "colours": [colour_of(week, len(progress.weeks)) for week in range(len(progress.weeks))],
        "elements": [_element(one, progress) for one in progress.elements],
        # What two files have is drawn and listed for each, and counted once, as in shares.
        "counted": [row[one.key] for one in once_each(progress.elements)],
        "tasks": [printable(task.name or task.guid) for task in progress.plan.tasks],
        "shares": _shares(shares_of(progress)),
        "bounds": [corner.tolist() for corner in outlines.bounds] if outlines.storeys else None,
        "storeys": [
            {"name": printable(one.name), "floor": one.floor, "others": _rings(one.others),
             "elements": [[row[key], _rings(rings)] for key, rings in one.elements.items()]}
            for one in outlines.storeys
        ],
    }  # fmt: skip


def _element(one: Followed, progress: Progress) -> dict[str, Any]:
    due = due_of(one, progress)
    return {
        "guid": printable(one.latest.guid), "name": printable(one.latest.name), "file": printable(one.latest.file),
        "class": printable(one.latest.ifc_class), "storey": printable(storey_of(one)),
        "states": [STATES.index(moment.state) for moment in one.moments],
        "became": {week: became for week, _, became in one.told_changes},
        "told": "".join(str(int(moment.told)) for moment in one.moments),
        "model": "".join(str(int(moment.in_model)) for moment in one.moments),
        "off": [_millimetres(moment) for moment in one.moments],
        "first": one.first_seen, "not_before": one.not_before, "last": one.last_seen, "removed": one.removed,
        "displaced": one.displaced, "moved": one.moved, "tasks": list(due.tasks), "finish": due.finish,
        "behind": due.behind or None, "days": due.days,
    }  # fmt: skip


def _millimetres(moment: Moment) -> float | None:
    if moment.offset is None:
        return None
    return round(1000.0 * float(np.linalg.norm(moment.offset.offset)), 1)


def _shares(shares: list[Share]) -> list[dict[str, Any]]:
    """One entry for each group, its weeks in order."""
    groups: list[dict[str, Any]] = []
    for one in shares:
        if one.week == 0:
            groups.append({"kind": one.kind, "name": printable(one.name), "weeks": []})
        groups[-1]["weeks"].append([one.elements, one.done, one.at_least, one.at_most])
    return groups


def _added(box: UprightBox, base: np.ndarray) -> dict[str, Any]:
    return {"corners": _rings([box.corners - base])[0], "middle": box.center[2]}


def _rings(rings: list[np.ndarray]) -> list[list[list[float]]]:
    return [np.round(ring, 3).tolist() for ring in rings]


def _part(name: str) -> str:
    return (resources.files("jaxmm.weeks") / "viewer" / name).read_text(encoding="utf-8")
