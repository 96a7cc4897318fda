"""Where a figure comes from: it is drawn of a run of the paper, and its image says of which.

A PNG holds the commit and the day of the run as text beside its pixels, under `run_commit` and `run_date`, as far as
the run tells them. Nothing else of an image depends on them, so the same run gives the same bytes.
"""

from pathlib import Path

from PIL import Image
from PIL.PngImagePlugin import PngInfo

from jaxmm import run_folder
from jaxmm.files import load_json, write_atomically
from jaxmm.inputs import InputError
from paper.results import RUN, date_of

MAKER = "jaxmm reproduce configs/paper.toml makes it"


def origin_of(run: Path) -> dict[str, str]:
    """What images of a run tell: `run_commit` and `run_date`, less what the run does not say.

    Args:
        run: run folder of the paper, finished or not, or what `paper.results` kept of one.

    Raises:
        InputError: it is neither.
    """
    if run_folder.read_config(run).paper.rows != "all":
        raise InputError(f"{run}: expected a run of the paper, found one of another kind; {MAKER}")
    if (run / RUN).is_file():
        told = load_json(run / RUN)
        versions, date = told.get("versions", {}), told.get("date")
    else:
        versions = load_json(run / run_folder.VERSIONS) if (run / run_folder.VERSIONS).is_file() else {}
        date = date_of(run)
    found = {"run_commit": versions.get("git_commit"), "run_date": date}
    return {name: value for name, value in found.items() if value}


def mark(path: Path, origin: dict[str, str]) -> None:
    """Write into a PNG where it comes from; other formats stay as they are."""
    if path.suffix != ".png":
        return
    with Image.open(path) as image:
        told = PngInfo()
        for name, value in (image.text | origin).items():
            told.add_text(name, value)
        image.load()
        write_atomically(path, lambda file: image.save(file, "png", pnginfo=told, dpi=image.info.get("dpi")))


def made(path: Path) -> Path:
    """The path of a file that a run of the paper makes.

    Raises:
        InputError: the run has not come so far.
    """
    if not path.is_file():
        raise InputError(f"{path}: expected a file of a finished run of the paper; {MAKER}")
    return path
