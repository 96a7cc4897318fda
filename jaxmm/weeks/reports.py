"""The reports of `jaxmm detect`, read: one a week, whatever the days between, in the order of their dates.

World frame of the prior: metres, z up.
"""

import itertools
import json
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from jaxmm.formats.dates import parse_date
from jaxmm.inputs import InputError
from jaxmm.learning.element_boxes import UprightBox
from jaxmm.verdicts.results import FORMAT
from jaxmm.verdicts.verdicts import VERDICTS
from jaxmm.weeks.report_fields import Field

REPORT = "report.json"
DAY = len("2026-03-02")
SAME = 0.5  # share of the elements of the smaller of two reports, from which on both are of states of one model

Key = tuple[str, str]  # file and GlobalId; no file where the GlobalId tells enough


class Offset(NamedTuple):
    """How far off its place an element stood."""

    offset: tuple[float, float, float]  # [m] world axes; 0 along what no face fixes
    interval: tuple[tuple[float, float] | None, ...]  # 3 times 95 % [m]; None along what no face fixes
    turn: float | None  # [deg]
    lean: float | None  # [deg]


class Listed(NamedTuple):
    """An element as one report has it."""

    guid: str
    file: str  # of the model, where the report tells; else empty
    ifc_class: str  # without what IFC2x3 appends to some: IfcWall, not IfcWallStandardCase
    name: str
    storey: str
    verdict: str  # one of verdicts.VERDICTS
    probability: float | None  # that it was removed
    offset: Offset | None
    box: UprightBox | None  # where the model has it
    same_as: tuple[Key, ...] = ()  # in other files; with their names, as the report has them
    parts: tuple[Key, ...] = ()  # that its verdict follows from; likewise

    @property
    def key(self) -> Key:
        """What tells it from all others of the report."""
        return self.file, self.guid


class ModelFile(NamedTuple):
    """What a report says of the model that its scans were compared with."""

    file: str
    kind: str
    project: str | None
    sha256: str | None


class Week(NamedTuple):
    """One report."""

    report: str  # as it was given
    date: str  # of `formats.dates`
    model: ModelFile
    elements: dict[Key, Listed]
    added: tuple[UprightBox, ...]  # what stood there and is not in the model
    doubts: tuple[str, ...]  # what speaks against where its scans were taken from

    @property
    def name(self) -> str:
        """Of its folder, without those that it lies in: pages and tables are passed on."""
        path = Path(self.report)
        folder = path if path.name != REPORT else path.parent
        return folder.resolve().name

    @property
    def classes(self) -> set[str]:
        """Classes of elements that were asked for, as far as the model has any."""
        return {one.ifc_class for one in self.elements.values()}


def read_weeks(reports: Sequence[Path], dates: Mapping[Path, str] | None = None) -> list[Week]:
    """Reports in the order of their dates; the order in which they are given says nothing.

    Args:
        reports: folders that hold a report.json, or such files.
        dates: of some of them, instead of those that they state themselves.

    Raises:
        InputError: one is missing, damaged, of a format to come, without a date, without elements, or given twice; two
            have one date; they are of unlike models.
    """
    dates = dict(dates or {})
    if strange := [path for path in dates if path.resolve() not in {one.resolve() for one in reports}]:
        raise InputError(f"--date: expected one of the reports, got {strange[0]}")
    twice = [path for path, count in Counter(one.resolve() for one in reports).items() if count > 1]
    if twice:
        raise InputError(f"{twice[0]}: expected each report once, got it twice")
    stated = {path.resolve(): date for path, date in dates.items()}
    weeks = sorted((_read(path, stated.get(path.resolve())) for path in reports), key=lambda week: week.date)
    for one, other in itertools.pairwise(weeks):
        _check_order(one, other)
    weeks = _keyed(weeks)
    for one, other in itertools.pairwise(weeks):
        _check_model(one, other)
    return weeks


def labels_of(weeks: Sequence[Week]) -> list[str]:
    """What to call each week: its day, with the time where another has the same."""
    count = Counter(week.date[:DAY] for week in weeks)
    return [
        week.date[:DAY] if count[week.date[:DAY]] == 1 else week.date[:16].replace("T", " ") + week.date[16:19]
        for week in weeks
    ]


def _check_order(one: Week, other: Week) -> None:
    """Two of one day need times that tell which was first."""
    if one.date[:DAY] == other.date[:DAY] and (one.date == other.date or len(one.date) == DAY):
        raise InputError(
            f"{other.report}: expected a time that tells it from {one.report}, which is of the same date, got "
            f"{other.date}; say --date {other.report}={other.date[:DAY]}T14:30, and likewise for the other"
        )


def _read(path: Path, stated: str | None) -> Week:
    file = path / REPORT if path.is_dir() else path
    if not file.is_file():
        what = f"a folder with {REPORT}" if path.is_dir() else "a report of jaxmm detect"
        raise InputError(f"{path}: expected {what}, found none")
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"{file}: cannot be read: {error.strerror}") from error
    except (ValueError, RecursionError) as error:
        raise InputError(f"{file}: expected JSON that jaxmm detect wrote, found it damaged") from error
    report = Field(content, str(file))
    number = 1 if report.get("format") is None else report["format"].whole()
    if number > FORMAT:
        raise InputError(f"{file}: expected a report of format {FORMAT} or below, got {number}, of a newer jaxmm")
    return Week(
        str(path), stated or _date(report, path), _model(report, path), _elements(report, path),
        tuple(_box(one) for one in report["mismatches"].items() if one["mismatch_type"].text() == "added"),
        tuple(told.text() for scan in report["scans"].items() for told in scan["doubts"].items()),
    )  # fmt: skip


def _date(report: Field, path: Path) -> str:
    date = report.get("date")
    if date is None:
        raise InputError(f"{path}: expected a date, its report states none; say --date {path}=2026-03-02")
    return date.read(parse_date)


def _model(report: Field, path: Path) -> ModelFile:
    prior = report.get("prior")
    if prior is None:
        return ModelFile("", "ifc", None, None)
    kind = prior["kind"].text()
    if kind == "cloud":
        raise InputError(f"{path}: expected a report on a building model, got one on a point cloud: it has no elements")
    project, digest = prior.get("project"), prior.get("sha256")
    return ModelFile(prior["file"].text(), kind, project and project.text(), digest and digest.text())


def _elements(report: Field, path: Path) -> dict[Key, Listed]:
    found: dict[Key, Listed] = {}
    for field in report["elements"].items():
        one = _element(field)
        if (one.file, one.guid) in found:
            field["guid"].refuse("each element once")
        found[one.file, one.guid] = one
    if not found:
        raise InputError(f"{path}: expected a report with elements to follow, got none")
    return found


def _element(field: Field) -> Listed:
    file, box, deviation = field.get("file"), field.get("box"), field.get("deviation")
    return Listed(
        field["guid"].text(), file.text() if file else "", field["ifc_class"].text().removesuffix("StandardCase"),
        field["name"].text(), field["storey"].text(), field["verdict"].one_of(VERDICTS),
        field["probability"].number_or_none(), _offset(deviation) if deviation else None, _box(box) if box else None,
        *(_keys(field.get(name)) for name in ("same_as", "parts")),
    )  # fmt: skip


def _keys(field: Field | None) -> tuple[Key, ...]:
    """Other elements; none where a report of an older version does not say."""
    return tuple((one["file"].text(), one["guid"].text()) for one in field.items()) if field else ()


def _offset(field: Field) -> Offset | None:
    """None where a number of it is null, as where it was not finite."""
    parts = field["offset"].three(Field.number_or_none)
    if None in parts:
        return None
    return Offset(parts, field["interval"].three(_span), field["turn"].number_or_none(), field["lean"].number_or_none())


def _span(field: Field) -> tuple[float, float] | None:
    if field.value is None:
        return None
    ends = [one.number_or_none() for one in field.items()]
    if len(ends) != 2:
        field.refuse("two numbers")
    return None if None in ends else (ends[0], ends[1])


def _box(field: Field) -> UprightBox:
    return UprightBox(
        field["center"].three(Field.number), field["dimensions"].three(Field.number), field["rotation"].number()
    )


def _keyed(weeks: list[Week]) -> list[Week]:
    """By GlobalId alone, but for those that several files of one model hold: files are renamed from week to week."""
    several = set()
    for week in weeks:
        count = Counter(guid for _, guid in week.elements)
        several |= {guid for guid, often in count.items() if often > 1}
    return [
        week._replace(
            elements={(file if guid in several else "", guid): one for (file, guid), one in week.elements.items()}
        )
        for week in weeks
    ]


def _check_model(one: Week, other: Week) -> None:
    a, b = one.model, other.model
    if a.sha256 is not None and a.sha256 == b.sha256:
        return
    asked = one.classes & other.classes
    mine, others = (
        {key for key, element in week.elements.items() if element.ifc_class in asked} for week in (one, other)
    )
    least, both = min(len(mine), len(others)), len(mine & others)
    is_same = both >= SAME * least if least else a.project is not None and a.project == b.project
    # Nodes of meshes have names that others have, too: wall_1.
    if is_same and (a.kind == b.kind == "ifc" or a.file == b.file):
        return
    raise InputError(
        f"{other.report}: expected a report on the model of {one.report} ({a.file or 'unnamed'}), got one on "
        f"{b.file or 'another'}, which has {both} of its {least} elements"
    )
