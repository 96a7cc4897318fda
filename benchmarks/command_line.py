"""The command line that all benchmarks share: sizes, in full and for --smoke, and where results go.

A smoke run takes the same path as a full one at the smallest size, in seconds. It shows that a benchmark still runs;
its numbers say nothing.
"""

import argparse
import atexit
import sys
from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NoReturn


class CommandLine(argparse.ArgumentParser):
    """Parses options; what is asked for holds every size, too, as options say or else as the table of sizes does.

    Args:
        about: the text of --help.
        full: sizes by name. An option of that name takes its default from here.
        smoke: those that are smaller with --smoke.
    """

    def __init__(self, about: str | None, full: Mapping[str, Any], smoke: Mapping[str, Any]):
        # Without abbreviations, for sizes are chosen before anything is parsed.
        how = argparse.RawDescriptionHelpFormatter
        super().__init__(description=about, formatter_class=how, allow_abbrev=False)
        if unknown := smoke.keys() - full.keys():
            raise KeyError(f"no such sizes: {', '.join(sorted(unknown))}")
        self.smoke = "--smoke" in sys.argv[1:]
        self.add_argument("--smoke", action="store_true", help="the smallest size, in seconds: does it still run?")
        self.set_defaults(**full)
        if self.smoke:
            self.set_defaults(**smoke)

    @cached_property
    def scratch(self) -> Path:
        """A folder for what a smoke run makes and nobody keeps; gone when the process ends."""
        folder = TemporaryDirectory(prefix="smoke_")
        atexit.register(folder.cleanup)
        return Path(folder.name)

    def add_places(self, seed: int) -> None:
        """--ifc FOLDER, --rooms N, --seed N and --json FILE, of views in generated rooms and in IFC files."""
        self.add_argument("--ifc", type=Path, metavar="FOLDER", help="also from places in the IFC files of a folder")
        self.add_argument("--rooms", type=int, metavar="N", help="of each kind, and places of each file")
        self.add_argument("--seed", type=int, default=seed, metavar="N")
        self.add_json()

    def add_json(self) -> None:
        """--json FILE."""
        self.add_argument("--json", type=Path, metavar="FILE", help="also write the rows to this file")

    def add_out(self, metavar: str = "DIR", about: str | None = None) -> None:
        """--out, which a smoke run does without: then what it finds is not kept."""
        made = {"default": self.scratch / metavar.lower()} if self.smoke else {"required": True}
        self.add_argument("--out", type=Path, metavar=metavar, help=about, **made)

    def add_input(self, name: str, about: str | None = None) -> None:
        """A path that must be given, but for a smoke run that can make its own: there it is None then."""
        more = {"nargs": "?"} if self.smoke else {}
        self.add_argument(name, type=Path, metavar=name.upper(), help=about, **more)


def end_without(what: str) -> NoReturn:
    """Say in one line what is missing, and end with exit code 2."""
    print(what, file=sys.stderr)
    raise SystemExit(2)
