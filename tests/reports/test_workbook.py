"""elements.xlsx, read back by another reader: every element, numbers as numbers, and no formula."""

import sys

import pytest

from jaxmm.reports.workbook import write_workbook
from tests.cases.detections import HOSTILE, named
from tests.cases.displaced import with_displaced
from tests.verdicts.test_results import random_detection


@pytest.fixture
def openpyxl():
    return pytest.importorskip("openpyxl")


def test_a_workbook_has_all_elements_the_worst_first(openpyxl, removed, tmp_path):
    told = with_displaced(removed)
    assert write_workbook(tmp_path / "a.xlsx", told)
    book = openpyxl.load_workbook(tmp_path / "a.xlsx")
    assert book.sheetnames == ["Displaced", "Measured", "Elements", "Not in the model"]
    for sheet in book:
        assert sheet.freeze_panes == "D2" and sheet.auto_filter.ref == sheet.dimensions
        head = [cell.value for cell in sheet[1]]
        assert all(cell.font.bold for cell in sheet[1])
        assert "off its place [mm]" in head or sheet.title == "Not in the model"
    (worst,) = book["Displaced"].iter_rows(min_row=2, values_only=True)
    row = dict(zip([cell.value for cell in book["Displaced"][1]], worst, strict=True))
    assert [row[name] for name in ("off its place [mm]", "at least [mm]", "at most [mm]")] == [23.0, 21.0, 25.0]
    assert row["sentence"] == "The wall 'W-102' stands 23 mm (21 to 25) to the east of its place."
    assert row["x (east) [mm]"] == 23.0 and row["y (north) [mm]"] is None  # that nothing fixes
    guids = [cells[4] for cells in book["Elements"].iter_rows(min_row=2, values_only=True)]
    assert guids == [one.guid for one in told.elements]
    heads = [cell.value for cell in book["Elements"][1]]
    assert heads[-2:] == ["the same as", "removed parts"]
    assert book["Measured"].max_row - 1 == sum(one.deviation is not None for one in told.elements)


def test_a_whole_without_a_part_says_so(openpyxl, removed, tmp_path):
    first, *rest = removed.elements
    first = first._replace(same_as=(("a.ifc", "twin"),), parts_gone=(("b.ifc", "one"), ("b.ifc", "two")))
    assert write_workbook(tmp_path / "a.xlsx", removed._replace(elements=(first, *rest)))
    rows = list(openpyxl.load_workbook(tmp_path / "a.xlsx")["Elements"].iter_rows(min_row=2, values_only=True))
    assert rows[0][-2:] == ("twin of a.ifc", "one of b.ifc; two of b.ifc") and rows[1][-2:] == (None, None)


def test_names_stay_text(openpyxl, removed, tmp_path):
    names = (*HOSTILE, "=1+1", "#N/A", "a\x00b\udcff")
    write_workbook(tmp_path / "a.xlsx", removed._replace(elements=named(names)))
    sheet = openpyxl.load_workbook(tmp_path / "a.xlsx")["Elements"]
    assert {cell.data_type for row in sheet.iter_rows(min_row=2, max_col=5) for cell in row} == {"s"}
    told = [row[2] for row in sheet.iter_rows(min_row=2, values_only=True)]
    assert told[-3:] == ["=1+1", "#N/A", "a\ufffdb\ufffd"]
    assert all(" ".join(a.split()) == " ".join(b.split()) for a, b in zip(told, HOSTILE, strict=False))


def test_whatever_was_found_can_be_written_and_twice_the_same(openpyxl, tmp_path):
    for seed in range(20):
        first, second = tmp_path / "a.xlsx", tmp_path / "b.xlsx"
        for path in (first, second):
            assert write_workbook(path, random_detection(seed))
        assert first.read_bytes() == second.read_bytes()
        openpyxl.load_workbook(first)


def test_without_openpyxl_nothing_is_written(removed, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "openpyxl", None)
    assert not write_workbook(tmp_path / "a.xlsx", removed) and not list(tmp_path.iterdir())
