"""`jaxmm progress` on the command line: its options, and what is printed."""

import argparse
from pathlib import Path

from jaxmm.inputs import InputError

EXAMPLE = "jaxmm progress week1 week2 week3 --date week2=2026-03-09 --model house.ifc --out progress"
REPORTS = "folders that jaxmm detect wrote, of one model, in any order: their dates put them in order"
DATES = (
    "of a report, as 2026-03-09 or 2026-03-09T14:30 (UTC); once for each; default: what the report says, which has it "
    "from its scans or from detect --date"
)
MODEL = (
    "the model of the reports, a file or a folder, for true outlines on the plans and for its schedule (IfcTask, in "
    "any of its files); once for each file or folder of it; default: boxes that the reports hold, and no schedule"
)


def add_progress(command: argparse.ArgumentParser) -> None:
    """The options of `jaxmm progress`."""
    command.add_argument("reports", type=Path, nargs="+", metavar="REPORT", help=REPORTS)
    command.add_argument("--date", action="append", default=[], metavar="REPORT=DATE", help=DATES)
    command.add_argument("--model", type=Path, action="append", default=[], metavar="FILE_OR_FOLDER", help=MODEL)
    command.add_argument("--out", type=Path, required=True, metavar="DIR", help="new folder of the tables and plans")


# The imports below wait until they are needed: --help should load as little as it can.


def progress(options: argparse.Namespace) -> None:
    """Read, follow, write, and print how it stands."""
    from jaxmm.files import check_empty, check_folder

    check_folder(options.out, "--out")
    check_empty(options.out, "--out")
    dates = dict(_dated(text) for text in options.date)

    from jaxmm.weeks import history, model, outputs, reports
    from jaxmm.weeks.summary import lines_of

    weeks = reports.read_weeks(options.reports, dates)
    read = model.read_model(options.model, weeks) if options.model else None
    if read is not None:
        weeks = model.with_boxes(weeks, read)
    found = history.follow(weeks, read.plan if read is not None else history.NO_PLAN)
    said = outputs.write_progress(found, options.out, read)
    for line in (*found.notes, *said, *lines_of(found)):
        print(line)
    print(f"progress: {options.out}")


def _dated(text: str) -> tuple[Path, str]:
    from jaxmm.formats.dates import parse_date

    report, equals, date = text.rpartition("=")
    if not (equals and report):
        raise InputError(f"--date: expected REPORT=DATE, as week1=2026-03-02, got {text!r}")
    try:
        return Path(report), parse_date(date)
    except InputError as error:
        raise InputError(f"--date {report}: {error}") from error
