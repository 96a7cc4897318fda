"""When a scan was taken: what its file says, or else when the file was last changed.

Dates are texts as in ISO 8601, a day or a second of it: 2026-03-02, 2026-03-02T14:30:00Z. Times are UTC.
"""

import re
from datetime import UTC, date, datetime, timedelta
from pathlib import Path
from typing import NamedTuple

from jaxmm.inputs import InputError, clipped

GPS_EPOCH = datetime(1980, 1, 6, tzinfo=UTC)  # E57 counts seconds from here (ASTM E2807-11, 8.4.2)
LEAP_SECONDS = 18  # that GPS time, which knows none, is ahead of UTC since 2017
WRITTEN = re.compile(r"\d{4}-\d\d-\d\d([T ]\d\d:\d\d(:\d\d(\.\d{1,6})?)?(Z|[+-]\d\d:\d\d)?)?", re.ASCII)
PLAUSIBLE = range(1990, 2100)  # years; before, nobody scanned, and zero is how many write that they do not know


class Taken(NamedTuple):
    """When a scan was taken, and who says so."""

    date: str  # ISO 8601: a day, or a second of it
    source: str  # "header" of the file, or "modified": when it was last changed


def parse_date(text: str) -> str:
    """A day or a time as users write it, in the form of this module; a time without a zone is UTC.

    Raises:
        InputError: no date in ISO 8601.
    """
    try:
        if not (found := WRITTEN.fullmatch(text)):
            raise ValueError(text)
        return _told(datetime.fromisoformat(text)) if found[1] else date.fromisoformat(text).isoformat()
    except (ValueError, OverflowError) as error:
        raise InputError(f"expected a date as 2026-03-02 or 2026-03-02T14:30, got {clipped(text)!r}") from error


def from_gps(seconds: float) -> str | None:
    """The time that a number of GPS seconds stands for; None where it cannot be meant."""
    try:
        return _plausible(GPS_EPOCH + timedelta(seconds=seconds - LEAP_SECONDS))
    except (OverflowError, ValueError):
        return None


def from_unix(seconds: float) -> str | None:
    """The time that seconds since 1970 stand for; None where it cannot be meant, as by the clock of a simulator."""
    try:
        return _plausible(datetime.fromtimestamp(seconds, UTC))
    except (OverflowError, ValueError, OSError):
        return None


def from_day(day: date | None) -> str | None:
    """A day of a file's header; None where there is none, or it cannot be meant."""
    return day.isoformat() if day is not None and day.year in PLAUSIBLE else None


def taken_of(path: Path, header: str | None) -> Taken | None:
    """When a scan was taken: by the header of its file where that says so, else when the file or folder was changed."""
    if header is not None:
        return Taken(header, "header")
    told = _plausible(datetime.fromtimestamp(path.stat().st_mtime, UTC))
    return None if told is None else Taken(told, "modified")


def latest(taken: list[Taken | None]) -> str | None:
    """The date of several scans together: the last that a header says, or if none does, that a file was changed."""
    known = [one for one in taken if one is not None]
    known = [one for one in known if one.source != "modified"] or known
    return max((one.date for one in known), default=None)


def _plausible(time: datetime) -> str | None:
    return _told(time) if time.year in PLAUSIBLE else None


def _told(time: datetime) -> str:
    time = time.replace(tzinfo=UTC) if time.tzinfo is None else time.astimezone(UTC)
    return time.replace(microsecond=0, tzinfo=None).isoformat() + "Z"
