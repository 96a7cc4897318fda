"""All files of `jaxmm progress`, into a new folder, whole or not at all."""

from pathlib import Path

from jaxmm.files import check_empty, write_folder
from jaxmm.inputs import InputError
from jaxmm.weeks.history import Progress
from jaxmm.weeks.model import Model
from jaxmm.weeks.outlines import outlines_of
from jaxmm.weeks.page import write_page
from jaxmm.weeks.tables import WORKBOOK, write_tables

NO_PLAN = "no plan was drawn: these reports do not say where elements have their places; give their model with --model"
NO_BOOK = f"{WORKBOOK} was not written: openpyxl is not installed (pip install 'jaxmm[xlsx]')"


def write_progress(progress: Progress, out: Path, model: Model | None = None) -> list[str]:
    """Write every output; returns what is to be said about it, a line each.

    Args:
        progress: from history.follow.
        out: folder that does not exist yet, or is empty.
        model: for true outlines on the plans.

    Raises:
        InputError: the folder holds something, or cannot be written.
    """
    check_empty(out, "--out")
    said: list[str] = []

    def write(work: Path) -> None:
        outlines = outlines_of(progress, model)
        if outlines.storeys:
            from jaxmm.weeks.plans import write_plans  # loads matplotlib

            write_plans(work, progress, outlines)
        else:
            said.append(NO_PLAN)
        write_page(work / "progress.html", progress, outlines)
        if not write_tables(work, progress):
            said.append(NO_BOOK)

    try:
        write_folder(out, write)
    except OSError as error:
        raise InputError(f"--out: cannot write {out}: {error.strerror}") from error
    return said
