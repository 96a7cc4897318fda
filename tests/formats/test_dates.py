"""When a scan was taken, as files, users and clocks say it."""

import os
from datetime import UTC, date, datetime

import numpy as np
import pytest

from jaxmm.formats.dates import Taken, from_day, from_gps, latest, parse_date, taken_of
from jaxmm.formats.readers import read_scans
from jaxmm.inputs import InputError
from tests.cases.e57_files import write_e57

POINTS = np.random.default_rng(0).uniform(0, 5, (50, 3))


@pytest.mark.parametrize(
    "text, told",
    [
        ("2026-03-02", "2026-03-02"),
        ("2026-03-02T14:30", "2026-03-02T14:30:00Z"),
        ("2026-03-02T14:30:59Z", "2026-03-02T14:30:59Z"),
        ("2026-03-02T00:30+02:00", "2026-03-01T22:30:00Z"),
        ("2026-03-02 14:30", "2026-03-02T14:30:00Z"),
    ],
)
def test_dates_as_users_write_them(text, told):
    assert parse_date(text) == told
    assert parse_date(told) == told


@pytest.mark.parametrize("text", ["", "last week", "2026-13-02", "2026-02-30", "02.03.2026", "2026-W10", "9" * 400])
def test_what_is_no_date_is_refused_in_one_line(text):
    with pytest.raises(InputError) as error:
        parse_date(text)
    assert "expected a date as 2026-03-02" in str(error.value) and len(str(error.value)) < 300


def test_gps_seconds_are_those_of_a_known_moment():
    # GPS week 2200 began on 2022-03-06 at 00:00:00 GPS time, 18 s before that in UTC.
    assert from_gps(2200 * 7 * 86400) == "2022-03-05T23:59:42Z"
    assert [from_gps(value) for value in (0.0, -5.0, 1e30, float("nan"), float("inf"))] == [None] * 5


def test_days_of_headers_that_cannot_be_meant_are_none():
    assert [from_day(day) for day in (None, date(1900, 1, 1), date(2026, 3, 2))] == [None, None, "2026-03-02"]


def test_las_and_e57_say_when(tmp_path):
    laspy, pye57 = pytest.importorskip("laspy"), pytest.importorskip("pye57")
    las = laspy.create()
    las.header.scales, las.x, las.y, las.z = [0.001] * 3, *POINTS.T
    las.header.creation_date = date(2026, 3, 2)
    las.write(tmp_path / "a.las")
    columns = {f"cartesian{axis}": column.copy() for axis, column in zip("XYZ", POINTS.T, strict=True)}
    pose = ((1.0, 2.0, 3.0), (1.0, 0.0, 0.0, 0.0))
    write_e57(tmp_path / "a.e57", [(columns, None), (columns, pose)], started=2200.0 * 7 * 86400)
    write_e57(tmp_path / "b.e57", [(columns, None)])
    with pye57.E57(str(tmp_path / "c.e57"), mode="w") as file:
        file.write_scan_raw(columns)  # it writes a zero
    (told,) = read_scans(tmp_path / "a.las")
    assert told.taken == "2026-03-02"
    assert [one.taken for one in read_scans(tmp_path / "a.e57")] == ["2022-03-05T23:59:42Z"] * 2
    assert [one.taken for name in "bc" for one in read_scans(tmp_path / f"{name}.e57")] == [None, None]


def test_a_file_without_a_date_has_that_of_its_last_change(tmp_path):
    np.save(tmp_path / "a.npy", POINTS)
    os.utime(tmp_path / "a.npy", (0, datetime(2026, 3, 2, 14, 30, tzinfo=UTC).timestamp()))
    (scan,) = read_scans(tmp_path / "a.npy")
    assert scan.taken is None
    assert taken_of(tmp_path / "a.npy", scan.taken) == Taken("2026-03-02T14:30:00Z", "modified")
    assert taken_of(tmp_path / "a.npy", "2026-02-27") == Taken("2026-02-27", "header")


def test_a_header_counts_for_more_than_a_change():
    old, new = Taken("2026-03-01", "header"), Taken("2026-03-02", "header")
    copied = Taken("2026-11-28T10:00:00Z", "modified")
    assert latest([new, old, copied, None]) == "2026-03-02"
    assert latest([copied, None]) == copied.date
    assert latest([None]) is latest([]) is None
