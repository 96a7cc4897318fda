"""Stages of a long run, cached by content: a stage is made anew when its settings, its code or its inputs are others.

Each stage has a folder `stages/<name>/` with `stage.json`: the key, what it was made of, and when. What the key covers
is the stage's to say: the part of the settings that matters to it, the modules whose code does (with all that they
import, comments and docstrings left out), and the keys of the stages that it reads. So a changed figure or table
retrains nothing. Within a stage every file is whole or absent, and a stage that was killed goes on where it was.
"""

import ast
import datetime
import functools
import hashlib
import json
import shutil
from pathlib import Path
from typing import Any, NamedTuple

from jaxmm.caches import TREE
from jaxmm.files import load_json, write_json
from jaxmm.inputs import InputError
from jaxmm.versions import versions

STAGES, STAGE = "stages", "stage.json"
PACKAGES = ("jaxmm", "warp_scanner")
MATTERS = ("python", "machine", "threads", "packages")  # of versions(), to the bits of a stage


class Stage(NamedTuple):
    """What a stage is made of."""

    name: str  # of its folder
    settings: Any  # as JSON: all that its results depend on beside code
    modules: tuple[str, ...]  # dotted names of what runs
    apart: tuple[str, ...] = ()  # modules that those import, and whose code does not reach the results
    inputs: tuple[str, ...] = ()  # keys of the stages whose results it reads


def key_of(stage: Stage) -> str:
    """sha256 of all that a stage's results depend on."""
    versions = _versions()
    parts = [stage.settings, code_of(stage.modules, stage.apart), [versions[name] for name in MATTERS], stage.inputs]
    return hashlib.sha256(json.dumps(parts, sort_keys=True, default=list).encode()).hexdigest()


def open_stage(run: Path, stage: Stage) -> Path:
    """The folder of a stage: as it was left when its key is the same, else empty."""
    folder, key = run / STAGES / stage.name, key_of(stage)
    if _key_in(folder) != key:
        # The key goes first: a kill in between leaves a folder without one, which nothing takes for a stage.
        (folder / STAGE).unlink(missing_ok=True)
        shutil.rmtree(folder, ignore_errors=True)
        told = stage._asdict() | {"key": key, "code": code_of(stage.modules, stage.apart), "versions": _versions()}
        told["date"] = datetime.datetime.now(datetime.UTC).date().isoformat()  # a file's own time is lost in copies
        write_json(folder / STAGE, json.loads(json.dumps(told, default=list)))
    return folder


def stage_folder(run: Path, name: str) -> Path:
    """Where a stage's results lie, for those who only read them.

    Raises:
        InputError: the run has no such stage.
    """
    folder = run / STAGES / name
    if not (folder / STAGE).is_file():
        raise InputError(f"{run}: expected a run with the stage {name}, found none; jaxmm reproduce makes it")
    return folder


@functools.cache
def _versions() -> dict[str, Any]:
    """Of this process: there are many stages, and asking git takes its time."""
    return versions()


def _key_in(folder: Path) -> str | None:
    try:
        return load_json(folder / STAGE).get("key")
    except InputError:
        return None


@functools.lru_cache
def code_of(modules: tuple[str, ...], apart: tuple[str, ...] = ()) -> str:
    """sha256 over the code of modules and all that they import from the two packages, but for those in `apart`.

    Raises:
        ValueError: there is no module of such a name.
    """
    paths = _paths()
    if unknown := [name for name in (*modules, *apart) if name not in paths]:
        raise ValueError(f"modules must be of {PACKAGES}, got {unknown}")
    waiting, found = list(modules), {}
    while waiting:
        name = waiting.pop()
        if name in found or name in apart:
            continue
        found[name], imported = _parsed(paths[name])
        # The face of a room only names what users may call.
        waiting += [other for other in imported if other in paths and paths[other].name != "__init__.py"]
    text = "\n".join(f"{name} {code}" for name, code in sorted(found.items()))
    return hashlib.sha256(text.encode()).hexdigest()


def _paths() -> dict[str, Path]:
    """Dotted names of all modules of the two packages."""
    return {
        ".".join(path.relative_to(TREE).with_suffix("").parts).removesuffix(".__init__"): path
        for package in PACKAGES
        for path in (TREE / package).rglob("*.py")
    }


def _parsed(path: Path) -> tuple[str, list[str]]:
    """The code of a file without its prose, and the dotted names that it imports anywhere."""
    tree, imported = ast.parse(path.read_text(encoding="utf-8")), []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            imported += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            imported += [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
        elif isinstance(node, ast.ClassDef | ast.FunctionDef) and ast.get_docstring(node) is not None:
            del node.body[0]
    if ast.get_docstring(tree) is not None:
        del tree.body[0]
    return ast.dump(tree), imported
