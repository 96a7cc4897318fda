"""The report that people read: what was found in words and tables, and how to read it, as Markdown.

Lengths in metres, angles in degrees, world frame of the prior.
"""

import math
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from decimal import ROUND_HALF_UP, Decimal
from typing import Any

import numpy as np

from jaxmm.classes.unexplained import Unexplained
from jaxmm.formats.units import UNITS as UNIT_WORDS
from jaxmm.reports.deviation_words import (
    INTERVAL_WORDS,
    NORTH_WORDS,
    displaced,
    millimetres,
    off_in_words,
    place_in_words,
    summary_of,
    tolerance_of,
)
from jaxmm.reports.verdict_words import (
    ASSUMED,
    ASSUMED_WORDS,
    OBSERVABLE_WORDS,
    OTHER_TYPE_WORDS,
    PROBABILITY_OF_MISMATCH,
    PROBABILITY_WORDS,
    SURE_OF_TYPE,
    UNEXPLAINED_WORDS,
    VERDICT_WORDS,
    why_occluded,
)
from jaxmm.verdicts.results import Detection, ElementVerdict, Mismatch, Pose, PriorFile, ScanRecord, counted
from jaxmm.verdicts.verdicts import OCCLUDED, PRESENT, REMOVED, UNSCANNED

MOST_DISPLACED = 50  # elements that are told of in full
NONE_SURELY = "No element surely stands off its place by more than its tolerance."
MOST_FILES = 4  # of a model in several, that are named
MOST_THINGS = 30  # of what is not in the model
GAP = "-"  # shown for what is not known
UNITS = {"shift": " m", "turn": "°", "residual": " m"}  # of the numbers of a registration
# What is markup anywhere (an underscore within a word is not), and what would begin a list or a rule at the start.
_MARKUP = re.compile(r"[\\`*\[\]<>#!|~&$]|(?<![^\W_])_|_(?![^\W_])")
_START = re.compile(r"^(\d+(?=[.)](?:\s|$))|(?=[-+=]))")
_ENTITIES = {"<": "&lt;", ">": "&gt;", "&": "&amp;"}
_PLAIN_NAME = re.compile(r"[\w$]+", re.ASCII)  # every GlobalId
_BLANK = re.compile(r"[\s\x00-\x1f\x7f-\x9f\u2028\u2029]+")


def as_markdown(detection: Detection) -> str:
    """The content of report.md: removed, displaced and occluded elements in full, all others counted."""
    blocks = [
        ["# What the scans say of the building model", "", f"{_capital(detection.summary())}."],
        [f"{_prior(detection.prior)}."] if detection.prior else [],
        [f"- **In doubt:** {escaped(doubt)}" for doubt in detection.doubts],
        _sentences(detection),
        _mismatches(detection.mismatches, detection.prior is not None and len(detection.prior.sources) > 1),
        _displaced(detection),
        _unexplained(detection.unexplained),
        _elements(detection.elements),
        _scans(detection.scans),
        _notes(detection.notes),
        _how_to_read(detection),
        _values("Registration", detection.registration),
        _values("Settings", detection.settings),
        _values("Time [s]", {name: number(value) for name, value in detection.timing.items()}),
    ]
    return "\n\n".join("\n".join(lines) for lines in blocks if lines) + "\n"


def printable(text: str) -> str:
    """Text that can be written as UTF-8: what a file's name holds of other encodings is marked as unreadable."""
    return text.encode("utf-16", "surrogatepass").decode("utf-16", "replace")


def escaped(value: Any) -> str:
    """Text of a user's as one line that Markdown, and HTML within it, shows as it is."""
    text = _BLANK.sub(" ", printable(str(value))).strip()
    text = _MARKUP.sub(lambda found: _ENTITIES.get(found[0], f"\\{found[0]}"), text)
    return _START.sub(r"\1\\", text)


def metres(values: Iterable[float]) -> str:
    """Lengths to the centimetre, "1.20, -0.35, 0.00"; a dash for what is not finite."""
    return ", ".join(number(value) for value in values)


def sizes(mismatch: Mismatch) -> str:
    """Its dimensions, those that are assumed behind a tilde."""
    return ", ".join(told_size(*one) for one in zip(mismatch.dimensions, mismatch.measured, strict=True))


def kind_in_words(mismatch: Mismatch) -> str:
    """Its type: "wall", "round pillar"; "wall, or pillar (22 %)" where what is seen of it leaves that open."""
    kind = f"round {mismatch.object_type}" if mismatch.shape == "round" else mismatch.object_type
    other = other_type(mismatch)
    return kind if other is None else f"{kind}, or {other[0]} ({percent(other[1])})"


def other_type(mismatch: Mismatch) -> tuple[str, float] | None:
    """The other type, and the probability that a real object is of it; None where nobody asked, or it is improbable."""
    if mismatch.type_probability is None or not mismatch.type_probability < SURE_OF_TYPE:  # NaN tells nothing either
        return None
    return "pillar" if mismatch.object_type == "wall" else "wall", 1.0 - mismatch.type_probability


def words_of_table(mismatches: Sequence[Mismatch]) -> list[str]:
    """What the signs in a table of mismatches mean, a sentence each."""
    either = any(other_type(one) is not None for one in mismatches)
    return [ASSUMED_WORDS, *([OTHER_TYPE_WORDS] if either else [])]


def told_size(value: float, seen: bool) -> str:
    """One length [m], behind a tilde unless it is seen."""
    return f"{'' if seen else ASSUMED}{number(value)}"


def number(value: float | None, digits: int = 2) -> str:
    """A number with fixed digits, as the page has it; a dash where there is none."""
    if value is None or not math.isfinite(value):
        return GAP
    # The page reads six digits from report.json, and rounds halves up.
    told = Decimal(round(float(value), 6)).quantize(Decimal(1).scaleb(-digits), ROUND_HALF_UP)
    return str(told if told else abs(told))  # zero has no sign


def percent(share: float | None) -> str:
    """A share or probability; what is nearly sure is not rounded to sure."""
    if share is None or not math.isfinite(share):
        return GAP
    if 0.0 < share < 0.01 or 0.99 < share < 1.0:
        return "< 1 %" if share < 0.5 else "> 99 %"
    return f"{number(100.0 * share, 0)} %"


def chance(probability: float) -> str:
    """A probability with three digits; what is nearly sure is not rounded to sure."""
    if 0.0 < probability < 0.0005:
        return "less than 0.001"
    if 0.9995 <= probability < 1.0:
        return "more than 0.999"
    return f"{probability:.3f}"


def pose_in_words(pose: Pose) -> str:
    """A place and where to look from it."""
    return f"({metres(pose[:3])}), yaw {number(pose[3], 0)}°, pitch {number(pose[4], 0)}°"


def prior_in_words(prior: PriorFile) -> str:
    """Its name and what is known of it: "building model a.ifc, in millimetres, IfcProject 2O2Fr$t4X7Zf8NOew3FNr2".

    Neither escaped nor fit to be written as it is: a file may have any name.
    """
    kind = {"ifc": "building model", "mesh": "mesh", "cloud": "point cloud"}.get(prior.kind, prior.kind)
    known = [word for length, word in {1.0: "metres", **UNIT_WORDS}.items() if math.isclose(length, prior.unit)]
    unit = known[0] if known else f"units of {prior.unit:.7g} m"
    if prior.sources:
        more = len(prior.sources) - MOST_FILES
        names = [*(one.file for one in prior.sources[:MOST_FILES]), *([f"and {more} more"] if more > 0 else [])]
        count = "1 file" if len(prior.sources) == 1 else f"{len(prior.sources)} files"
        return f"{kind} {prior.file}, of {count}: {', '.join(names)}"
    project = f", IfcProject {prior.project}" if prior.project else ""
    return f"{kind} {prior.file}, in {unit}{project}"


def _unexplained(things: Sequence[Unexplained]) -> list[str]:
    if not things:
        return []
    rows = (
        (str(index), metres(one.center), metres(one.dimensions), number(one.rotation, 0), str(one.points))
        for index, one in enumerate(things[:MOST_THINGS], 1)
    )
    more = [f"And {len(things) - MOST_THINGS} more: unexplained.csv."] if len(things) > MOST_THINGS else []
    columns = ("", "centre x, y, z [m]", "dimensions [m]", "rotation [°]", "points, one for each 0.1 m")
    return ["## Not in the model", "", UNEXPLAINED_WORDS, "", *_table(columns, rows), *([""] if more else []), *more]


def _prior(prior: PriorFile) -> str:
    project = f", IfcProject {_identifier(prior.project)}" if prior.project else ""
    return escaped(_capital(prior_in_words(prior._replace(project=None)))) + project


def _identifier(text: str) -> str:
    """A GlobalId as code, so that it can be searched for as it is; a mesh's node may have any name."""
    return f"`{text}`" if _PLAIN_NAME.fullmatch(text) else escaped(text) or GAP


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


def _table(columns: Iterable[str], rows: Iterable[Iterable[Any]]) -> Iterator[str]:
    columns = list(columns)
    yield f"| {' | '.join(columns)} |"
    yield f"|{' --- |' * len(columns)}"
    for row in rows:
        yield f"| {' | '.join(str(cell) for cell in row)} |"


def _sentences(detection: Detection) -> list[str]:
    return [f"{index}. {line}" for index, line in enumerate(detection.sentences, 1)]


def _mismatches(mismatches: Sequence[Mismatch], several: bool) -> list[str]:
    rows = []
    for index, one in enumerate(mismatches, 1):
        moved = GAP if one.moved_from is None else f"moved here from no. {one.moved_from + 1}"
        rows.append([
            index, one.mismatch_type, kind_in_words(one), metres(one.center), escaped(sizes(one)),
            number(one.rotation, 1), percent(one.probability), percent(one.observable_fraction),
            f"{_identifier(one.element)}{f' of {escaped(one.file)}' if several else ''}" if one.element else moved,
        ])  # fmt: skip
    if not rows:
        return ["## Mismatches", "", "None was found. What the scan could not see is told below."]
    columns = (
        "no.", "change", "type", "centre x, y, z [m]", "size [m]", "rotation [°]", "probability", "observable share",
        "element",
    )  # fmt: skip
    words = "  \n".join(escaped(one) for one in words_of_table(mismatches))
    return ["## Mismatches", "", *_table(columns, rows), "", words]


def _displaced(detection: Detection) -> list[str]:
    """What stands off its place, the worst first, and how near the others stand."""
    lines, found, rows = ["## Displaced", ""], displaced(detection.elements), []
    summary = escaped(summary_of(detection.elements, tolerance_of(detection)))
    if not found:
        return [*lines, NONE_SURELY, "", summary] if summary else []
    for index, one in enumerate(found[:MOST_DISPLACED], 1):
        told = one.deviation
        lines.append(f"{index}. {escaped(place_in_words(one))}")
        rows.append([
            index, _identifier(one.guid), *(escaped(text) or GAP for text in (one.ifc_class, one.name, one.storey)),
            escaped(off_in_words(told)), escaped(number(told.turn, 1)), number(told.lean, 1),
            millimetres(told.flatness), told.rays, told.classes["loa"], told.classes["din18202"],
        ])  # fmt: skip
    columns = (
        "no.", "element", "class", "name", "storey", "off its place (95 %)", "turn [°]", "lean [°]", "flatness [mm]",
        "rays on it", "LOA", "DIN 18202",
    )  # fmt: skip
    more = len(found) - MOST_DISPLACED
    lines += ["", *_table(columns, rows), "", *([f"And {more} more: deviations.csv.", ""] if more > 0 else [])]
    return [*lines, summary, "", f"{NORTH_WORDS} {INTERVAL_WORDS}"]


def _elements(elements: tuple[ElementVerdict, ...]) -> list[str]:
    if not elements:
        return ["## Elements", "", "The prior has no elements that a verdict could be given for."]
    count, several = Counter(one.verdict for one in elements), len({one.file for one in elements}) > 1
    lines = ["## Elements", "", *_table(("verdict", "elements"), ((name, count[name]) for name in VERDICT_WORDS))]
    if again := len(elements) - len(counted(elements)):
        lines += ["", f"{again} of them are others of these again, in another file. Above, each is counted once."]
    for verdict in (REMOVED, OCCLUDED):
        chosen = [one for one in elements if one.verdict == verdict]
        if chosen:
            lines += ["", f"### {_capital(verdict)}", "", *_named(chosen, verdict, several)]
    rest = Counter((one.verdict, one.ifc_class, one.storey) for one in elements if one.verdict in (PRESENT, UNSCANNED))
    if rest:
        rows = ((*(escaped(name) or GAP for name in key), rest[key]) for key in sorted(rest))
        lines += ["", "### Present and unscanned", "", "Each by name: elements.csv.", ""]
        lines += _table(("verdict", "class", "storey", "elements"), rows)
    return lines


def _named(elements: list[ElementVerdict], verdict: str, several: bool) -> Iterator[str]:
    views = verdict == OCCLUDED
    rows = []
    for one in elements:
        row = [_identifier(one.guid), *(escaped(text) or GAP for text in (one.ifc_class, one.name, one.storey))]
        row += [percent(one.probability), " / ".join(str(count) for count in one.rays)]
        if views:
            row += [why_occluded(one.rays), "none found" if one.next_view is None else pose_in_words(one.next_view)]
        rows.append([*row, escaped(one.file)] if several else row)
    columns = ["element", "class", "name", "storey", "P(removed)", "rays through / support / blocked / unseen"]
    return _table([*columns, *(["why", "next viewpoint x, y, z [m]"] if views else []), *(["file"] * several)], rows)


def _scans(scans: Sequence[ScanRecord]) -> list[str]:
    lines = ["## Scans"]
    for index, one in enumerate(scans, 1):
        lines += ["", f"{index}. **{escaped(one.file)}**: {one.points} points, taken from {pose_in_words(one.pose)}."]
        source = {
            "given": "was given", "file": "is the file's own", "estimated": "was estimated", "searched": "was searched",
        }  # fmt: skip
        told = f"The pose {source.get(one.pose_source, escaped(one.pose_source))}"
        if one.deviation is not None:
            told += f" (standard deviations {pose_in_words(one.deviation)})"
        fitted = ", ".join(
            f"{escaped(name.replace('_', ' '))} {number(value, 3)}{UNITS.get(name, '')}"
            for name, value in one.registration.items()
        )
        lines.append(f"   - {told}. Registration: {fitted or 'none'}.")
        changed = ", ".join(f"{count} {name}" for name, count in one.told.items() if count)
        what = "Elements that have another verdict by it than before" if index > 1 else "Verdicts by it"
        lines.append(f"   - {what}: {changed or 'none'}.")
        told_alone = len(scans) > 1 and one.alone
        alone = f", {one.alone} of them alone: of these the other scans show too little" if told_alone else ""
        lines.append(f"   - Mismatches that it shows: {one.shows}{alone}.")
        lines += [f"   - {escaped(note)}" for note in one.notes]
    return lines


def _notes(notes: Iterable[str]) -> list[str]:
    listed = [f"- {escaped(note)}" for note in notes]
    return ["## Notes", "", *listed] if listed else []


def _how_to_read(detection: Detection) -> list[str]:
    title = ["## How to read this", ""]
    if not detection.elements:  # of a point cloud, say: there is nothing that a verdict could be of
        return [*title, PROBABILITY_OF_MISMATCH, "", OBSERVABLE_WORDS]
    prior = detection.settings.get("change_prior")
    kept = f" ({percent(prior)} here)" if isinstance(prior, (int, float)) else ""
    return [
        *title, *(f"- **{name}**: {words}" for name, words in VERDICT_WORDS.items()), "", PROBABILITY_WORDS,
        f"An element of which nothing was seen keeps the probability that the settings give it before any scan{kept}: "
        "`change_prior`. Its verdict, not this number, says that it was not seen.",
        "", OBSERVABLE_WORDS,
    ]  # fmt: skip


def _values(title: str, values: dict[str, Any]) -> list[str]:
    rows = [(escaped(name), escaped(_shown(value)) or GAP) for name, value in _flat(values)]
    return [f"## {title}", "", *_table(("name", "value"), rows)] if rows else []


def _flat(values: dict[str, Any], above: str = "") -> Iterator[tuple[str, Any]]:
    """Settings within settings by their dotted names, those in lists by their number."""
    for name, value in values.items():
        if isinstance(value, (list, tuple)) and any(isinstance(one, dict) for one in value):
            value = {str(index): one for index, one in enumerate(value, 1)}
        if isinstance(value, dict):
            yield from _flat(value, f"{above}{name}.")
        else:
            yield f"{above}{name}", value


def _shown(value: Any) -> str:
    if isinstance(value, (list, tuple, np.ndarray)):
        return ", ".join(map(_shown, value))
    if isinstance(value, (float, np.floating)) and np.isnan(value):
        return GAP
    return f"{value:.6g}" if isinstance(value, (float, np.floating)) else str(value)
