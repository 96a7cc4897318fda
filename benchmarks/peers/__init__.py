"""Peers that may be missing: what cannot be loaded is left out, and one line says which and why."""

import importlib
import importlib.util
import sys
from contextlib import chdir
from tempfile import TemporaryDirectory

NAMES = {"open3d": "Open3D", "torch": "PyTorch"}  # those that call themselves otherwise than their packages


def why_missing(module: str) -> str | None:
    """Why a peer cannot be compared with, in one line; None where it can.

    Not being installed is one thing, and not being loadable another: Open3D, say, needs libraries of the system.
    """
    package = module.partition(".")[0]
    name = NAMES.get(package, package)
    if importlib.util.find_spec(package) is None:
        return f"{name} left out: it is not installed (`make setup-peers` installs it)"
    try:
        with TemporaryDirectory() as folder, chdir(folder):  # py4dgeo begins a log where it is imported
            importlib.import_module(module)
    except Exception as error:  # an OSError names the library that is missing; what else goes wrong ends nothing, too
        said = " ".join(str(error).split()) or type(error).__name__
        return f"{name} left out: it is installed, but cannot be loaded: {said}"
    return None


def has(module: str) -> bool:
    """Whether a peer can be compared with; says why not."""
    why = why_missing(module)
    if why:
        print(why, file=sys.stderr)
    return why is None
