"""elements.xlsx: the elements and how far off their places they stand, as a workbook to filter and sort.

One sheet per table; a frozen head that names the units, filters on every column. The same detection gives the same
bytes: a workbook holds no date.
"""

import io
import math
import re
import zipfile
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from jaxmm.files import write_atomically
from jaxmm.reports.archives import write_zip
from jaxmm.reports.deviation_words import displaced, measured, off_in_words, place_in_words, span_of
from jaxmm.reports.markdown import printable
from jaxmm.reports.plain_files import listed_keys
from jaxmm.verdicts.results import Detection, ElementVerdict, told_probability

WORKBOOK = "elements.xlsx"
MISSING = f"{WORKBOOK} was not written: openpyxl is not installed (pip install 'jaxmm[xlsx]')"
_WHO = ("verdict", "class", "name", "storey", "GlobalId", "file")
_OFF = (
    "off its place [mm]", "at least [mm]", "at most [mm]", "in words", "x (east) [mm]", "y (north) [mm]", "z (up) [mm]",
    "turn [deg]", "lean [deg]", "flatness [mm]", "seen in tolerance [%]", "rays on it", "LOA", "DIN 18202",
)  # fmt: skip
_RAYS = ("P(removed) [%]", "rays through", "rays on its place", "rays blocked", "rays unseen")
_MANY = ("the same as", "removed parts")
_THING = (
    "number", "centre x [mm]", "centre y [mm]", "centre z [mm]", "length [mm]", "width [mm]", "height [mm]",
    "rotation [deg]", "points",
)  # fmt: skip
_WIDTHS = {
    "name": 34, "in words": 46, "GlobalId": 26, "storey": 18, "class": 18, "file": 22, "the same as": 34,
    "removed parts": 34,
}  # fmt: skip
_DATES = re.compile(rb"<dcterms:(created|modified)[^>]*>[^<]*</dcterms:\1>")
_NOT_XML = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\ufffe\uffff]")  # what a cell cannot hold


def write_workbook(path: Path, detection: Detection) -> bool:
    """Write the workbook, whole or not at all; False, and nothing is written, where openpyxl is not installed.

    Lengths are in millimetres, to a tenth. The sheet "Displaced" has a row for each displaced element, "Measured" for
    each whose place was measured, both the worst first, "Elements" one for each that has a verdict, and "Not in the
    model" one for each thing that is neither a new wall nor a new column.

    Raises:
        OSError: it cannot be written.
    """
    try:
        from openpyxl import Workbook
    except ImportError:
        return False
    book = Workbook()
    book.remove(book.active)
    elements = detection.elements
    off = [[*_who(one), *_off(one), place_in_words(one)] for one in displaced(elements)]
    add_sheet(book, "Displaced", (*_WHO, *_OFF, "sentence"), off)
    add_sheet(book, "Measured", (*_WHO, *_OFF), [[*_who(one), *_off(one)] for one in measured(elements)])
    add_sheet(book, "Elements", (*_WHO, *_OFF, *_RAYS, *_MANY), [
        [*_who(one), *_off(one), *_rays(one), listed_keys(one.same_as), listed_keys(one.parts_gone)] for one in elements
    ])  # fmt: skip
    add_sheet(book, "Not in the model", _THING, [
        [number, *map(_millimetres, (*one.center, *one.dimensions)), float(one.rotation), one.points]
        for number, one in enumerate(detection.unexplained, 1)
    ])  # fmt: skip
    write_book(path, book)
    return True


def write_book(path: Path, book: Any) -> None:
    """Write a workbook of openpyxl, undated, whole or not at all."""
    content = io.BytesIO()
    book.save(content)
    write_atomically(path, lambda temporary: write_zip(temporary, _undated(content.getvalue())))


def _who(one: ElementVerdict) -> list[Any]:
    return [one.verdict, one.ifc_class, one.name, one.storey, one.guid, one.file]


def _off(one: ElementVerdict) -> list[Any]:
    told = one.deviation
    if told is None:
        return [None] * len(_OFF)
    lengths = [1000.0 * value for value in (told.distance, *span_of(told))]
    offset = [None if span is None else 1000.0 * value for value, span in zip(told.offset, told.interval, strict=True)]
    return [
        *lengths, off_in_words(told), *offset, told.turn, told.lean, 1000.0 * told.flatness, 100.0 * told.coverage,
        told.rays, told.classes["loa"], told.classes["din18202"],
    ]  # fmt: skip


def _millimetres(metres: float) -> float:
    return 1000.0 * float(metres)


def _rays(one: ElementVerdict) -> list[Any]:
    return [100.0 * told_probability(one.probability), *one.rays]


def add_sheet(book: Any, title: str, columns: tuple[str, ...], rows: Iterable[list[Any]]) -> None:
    """One more table in a workbook of openpyxl; the columns up to the third, and the head, stay in view."""
    from openpyxl.styles import Alignment, Font
    from openpyxl.utils import get_column_letter

    sheet = book.create_sheet(title)
    sheet.append(columns)
    last = 1
    for last, row in enumerate(rows, 2):
        for number, value in enumerate(row, 1):
            _fill(sheet.cell(last, number), value)
    for number, name in enumerate(columns, 1):
        head = sheet.cell(1, number)
        head.font, head.alignment = Font(bold=True), Alignment(wrap_text=True, vertical="top")
        sheet.column_dimensions[get_column_letter(number)].width = _WIDTHS.get(name, 90 if name == "sentence" else 13)
    sheet.freeze_panes = "D2"  # the head, and the columns up to the name
    sheet.auto_filter.ref = f"A1:{get_column_letter(len(columns))}{last}"


def _fill(cell: Any, value: Any) -> None:
    """Text stays text, whatever it begins with: a formula of a foreign file never runs."""
    if isinstance(value, str):
        cell.value = _NOT_XML.sub("\ufffd", printable(value))[:32_767]
        cell.data_type = "s"
    elif value is not None and math.isfinite(value):
        cell.value = round(float(value), 1) if isinstance(value, float) else int(value)


def _undated(content: bytes) -> dict[str, bytes]:
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        return {name: _DATES.sub(b"", archive.read(name)) for name in sorted(archive.namelist())}
