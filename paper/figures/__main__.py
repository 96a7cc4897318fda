"""Every figure of a run of the paper.

python -m paper.figures runs/paper --out figures
python -m paper.figures runs/paper --out figures --only heatmaps curves

Each is a PNG that holds the commit and the day of the run as text, run_commit and run_date.
"""

import argparse
import importlib
import pkgutil
import sys
from collections.abc import Callable, Iterable
from pathlib import Path

from jaxmm.inputs import InputError
from paper.figures.origin import mark, origin_of

FOLDER = Path(__file__).parent


def main(words: list[str] | None = None) -> int:
    """Draw all that can be drawn; 2 where a figure is missing, with one line that says why."""
    parser = argparse.ArgumentParser(
        prog="python -m paper.figures", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("run", type=Path, metavar="RUN", help="run folder of jaxmm reproduce configs/paper.toml")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder for the images, NAME.png each")
    parser.add_argument("--only", nargs="+", metavar="NAME", default=[], help="figures to draw; all when left out")
    asked = parser.parse_args(words)
    scripts = figure_scripts()
    if unknown := sorted(set(asked.only) - scripts.keys()):
        parser.error(f"--only: expected some of {', '.join(scripts)}, got {', '.join(unknown)}")
    return draw_all({name: scripts[name] for name in asked.only or scripts}.items(), asked.run, asked.out)


def figure_scripts() -> dict[str, Callable]:
    """`draw` of every script of this folder by the script's name; modules without one only serve others."""
    names = sorted(module.name for module in pkgutil.iter_modules([str(FOLDER)]) if module.name != "__main__")
    modules = {name: importlib.import_module(f"paper.figures.{name}") for name in names}
    return {name: module.draw for name, module in modules.items() if hasattr(module, "draw")}


def draw_all(scripts: Iterable[tuple[str, Callable]], run: Path, folder: Path) -> int:
    """Draw one after the other, and go on when one cannot be drawn; the exit code."""
    try:
        origin = origin_of(run)
        if folder.exists() and not folder.is_dir():
            raise InputError(f"--out: expected a folder, found the file {folder}")
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    folder.mkdir(parents=True, exist_ok=True)
    code = 0
    for name, draw in scripts:
        path = folder / f"{name}.png"
        try:
            draw(run, path)
            mark(path, origin)
        except (InputError, ValueError) as error:
            print(f"error: {name}: {error}", file=sys.stderr, flush=True)
            code = 2
        else:
            print(path, flush=True)
    return code


if __name__ == "__main__":
    sys.exit(main())
