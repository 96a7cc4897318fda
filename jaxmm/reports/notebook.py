"""A detection as a notebook shows it: the plan, what was found, and the verdicts with their meaning."""

import base64
import io
from collections.abc import Iterable
from html import escape
from typing import Any

from jaxmm.reports.deviation_words import (
    INTERVAL_WORDS,
    NORTH_WORDS,
    displaced,
    place_in_words,
    summary_of,
    tolerance_of,
)
from jaxmm.reports.markdown import (
    kind_in_words,
    metres,
    number,
    percent,
    pose_in_words,
    printable,
    sizes,
    words_of_table,
)
from jaxmm.reports.verdict_words import UNEXPLAINED_WORDS, VERDICT_WORDS, why_occluded
from jaxmm.verdicts.results import Detection
from jaxmm.verdicts.verdicts import OCCLUDED, REMOVED

DPI = 72  # of the plan: about the width of a notebook
MOST_LISTED = 50  # elements of a verdict; the others are counted


def detection_html(detection: Detection) -> str:
    """HTML for `Detection._repr_html_`: nothing is loaded or run, and names of users' files are shown as text."""
    parts = [
        f"<p><strong>{_text(detection.summary())}</strong></p>",
        "".join(f"<p>In doubt: {_text(doubt)}</p>" for doubt in detection.doubts),
        _plan(detection),
        _mismatches(detection),
        _displaced(detection),
        _unexplained(detection),
        _verdicts(detection),
        *(_elements(detection, verdict) for verdict in (REMOVED, OCCLUDED)),
        "".join(f"<p>{_text(note)}</p>" for note in detection.notes),
    ]
    return f'<div class="jaxmm-detection">{"".join(parts)}</div>'


def _text(value: Any) -> str:
    return escape(printable(str(value)))


def _plan(detection: Detection) -> str:
    from jaxmm.reports.figures import UNDATED  # only who looks waits for Matplotlib
    from jaxmm.reports.plan_figure import draw_plan

    image = io.BytesIO()
    draw_plan(detection).savefig(image, format="png", dpi=DPI, metadata=UNDATED[".png"])
    data = base64.b64encode(image.getvalue()).decode()
    words = escape(" ".join(detection.sentences) or "Floor plan; no mismatch.")
    return f'<img alt="{words}" style="max-width: 100%; background: white" src="data:image/png;base64,{data}">'


def _table(columns: Iterable[str], rows: Iterable[Iterable[Any]]) -> str:
    head = "".join(f"<th>{_text(name)}</th>" for name in columns)
    body = "".join(f"<tr>{''.join(f'<td>{_text(cell)}</td>' for cell in row)}</tr>" for row in rows)
    return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def _mismatches(detection: Detection) -> str:
    columns = ("", "change", "type", "centre [m]", "size [m]", "rotation [°]", "probability", "observable", "element")
    rows = []
    for index, one in enumerate(detection.mismatches, 1):
        moved = "" if one.moved_from is None else f"moved here from {one.moved_from + 1}"
        rows.append((
            index, one.mismatch_type, kind_in_words(one), metres(one.center), sizes(one),
            number(one.rotation, 1), percent(one.probability), percent(one.observable_fraction), one.element or moved,
        ))  # fmt: skip
    words = " ".join(words_of_table(detection.mismatches))
    return f"{_table(columns, rows)}<p>{_text(words)}</p>" if rows else ""


def _displaced(detection: Detection) -> str:
    """What stands off its place, the worst first."""
    found = displaced(detection.elements)
    if not found:
        return ""
    listed = "".join(f"<li>{_text(place_in_words(one))}</li>" for one in found[:MOST_LISTED])
    more = f"<p>and {len(found) - MOST_LISTED} more</p>" if len(found) > MOST_LISTED else ""
    words = f"{summary_of(detection.elements, tolerance_of(detection))} {NORTH_WORDS} {INTERVAL_WORDS}"
    return f"<p>{len(found)} displaced:</p><ol>{listed}</ol>{more}<p>{_text(words)}</p>"


def _unexplained(detection: Detection) -> str:
    """What else is not in the model, those with most points first."""
    things = detection.unexplained
    if not things:
        return ""
    rows = (
        (index, metres(one.center), metres(one.dimensions), number(one.rotation, 0), one.points)
        for index, one in enumerate(things[:MOST_LISTED], 1)
    )
    table = _table(("", "centre [m]", "size [m]", "rotation [°]", "points"), rows)
    more = f"<p>and {len(things) - MOST_LISTED} more</p>" if len(things) > MOST_LISTED else ""
    summary = f"{len(things)} not in the model"
    return f"<details><summary>{summary}</summary><p>{_text(UNEXPLAINED_WORDS)}</p>{table}{more}</details>"


def _verdicts(detection: Detection) -> str:
    if not detection.elements:
        return ""
    rows = ((name, detection.count(name), words) for name, words in VERDICT_WORDS.items())
    return _table(("verdict", "elements", "what it means"), rows)


def _elements(detection: Detection, verdict: str) -> str:
    chosen = [one for one in detection.elements if one.verdict == verdict]
    if not chosen:
        return ""
    views = verdict == OCCLUDED
    rows = [
        (one.guid, one.file, one.ifc_class, one.name, one.storey, percent(one.probability))
        + ((why_occluded(one.rays), pose_in_words(one.next_view) if one.next_view else "none found") if views else ())
        for one in chosen[:MOST_LISTED]
    ]
    columns = ("element", "file", "class", "name", "storey", "P(removed)")
    more = f"<p>and {len(chosen) - MOST_LISTED} more</p>" if len(chosen) > MOST_LISTED else ""
    table = _table((*columns, "why", "next viewpoint x, y, z [m]") if views else columns, rows)
    return f"<details><summary>{len(chosen)} {verdict}</summary>{table}{more}</details>"


# Notebooks ask the object itself; the type stays free of what draws.
Detection._repr_html_ = detection_html
