"""Writes a folder of scenes that others can run on.

Whatever kills it, every scene is whole, and the same command goes on. The truth of the test split goes to a file of
its own, beside the folder.
"""

import contextlib
import csv
import hashlib
import io
import shutil
from concurrent.futures import Executor
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import tomli_w

from jaxmm.exchange import sheet
from jaxmm.exchange.scene_files import SCENE, write_scene
from jaxmm.exchange.scenes import make_scene, read_once
from jaxmm.exchange.tasks import SPLITS, TEST, ExportSettings, Task, task_of
from jaxmm.files import LOCK, MANIFEST, check_folder, held, load_arrays, load_json, write_arrays, write_json, write_text
from jaxmm.inputs import InputError
from jaxmm.progress import bar_of
from jaxmm.versions import versions
from warp_scanner.cores import worker_pool
from warp_scanner.scenes.scenes import PILLAR, WALL

FORMAT, FORMAT_VERSION = "jaxmm benchmark", 1
BUILDINGS, TABLE = "buildings", "scenes.csv"
OWN_FILES = {*SPLITS, BUILDINGS, TABLE, LOCK, MANIFEST, sheet.README, sheet.SCHEMA, sheet.SETTINGS}


class Request(NamedTuple):
    """What to write, and where the truth of the test split goes."""

    count: int = 1000  # scenes
    buildings: Path | None = None  # folder of IFC files
    truth: Path | None = None  # None: beside the folder
    workers: int | None = None  # processes: 1 is this one, None one a core


def truth_path(folder: Path) -> Path:
    """Where the truth of the test split lies, unless somebody says otherwise."""
    folder = folder.resolve()
    return folder.with_name(f"{folder.name}-test-truth.npz")


def export(settings: ExportSettings, folder: Path, request: Request = Request()) -> dict[str, int]:  # noqa: B008
    """Write the scenes that are missing in `folder`; how many each split has.

    Raises:
        InputError: a count below 1; a folder of something else, of other settings, files or code, or held by another
            process; no IFC file; a building in which nothing that changes can be seen.
        OSError: a file cannot be written; the scenes that are there stay whole.
    """
    truth = (request.truth or truth_path(folder)).resolve()
    for name, value in (("count", request.count), ("workers", request.workers)):
        if value is not None and value < 1:
            raise InputError(f"--{name}: expected at least 1, got {value}")
    if truth.is_relative_to(folder.resolve()):
        raise InputError(f"--truth: expected a file outside of {folder}, which others are given, got {truth}")
    check_folder(folder, "DIR")
    check_folder(truth.parent, "--truth")
    buildings = _building_files(request.buildings)
    with held(folder, "writing to it; wait, or choose another DIR"):
        parts = truth.with_name(f"{truth.name}.parts")
        if not (folder / MANIFEST).exists() and (truth.exists() or parts.exists()):
            raise InputError(f"--truth: expected a new file for a new benchmark, {truth} is there; remove it or choose")
        count = _opened(folder, settings, buildings, request.count)
        tasks = [task_of(settings, index, len(buildings)) for index in range(count)]
        known = {name.partition("/")[0] for name in load_arrays(truth)} if truth.is_file() else set()
        missing = [task for task in tasks if not _is_there(folder, parts, task, known)]
        make = partial(_make, settings, folder, parts, buildings)
        with _pool(request.workers) as pool, bar_of("export scenes", count, "scene", count - len(missing)) as bar:
            for _ in pool.map(make, missing) if pool else map(make, missing):
                bar.update()
        _join(truth, parts, known)
        _finish(folder, settings, tasks, truth)
    return {split: sum(task.split == split for task in tasks) for split in SPLITS}


def _pool(workers: int | None) -> contextlib.AbstractContextManager[Executor | None]:
    return contextlib.nullcontext() if workers == 1 else worker_pool()


def _make(settings: ExportSettings, folder: Path, parts: Path, buildings: list[Path], task: Task) -> None:
    """One scene. Its truth is written first: a scene without one could not be scored."""
    scene = make_scene(settings, task, buildings)
    if task.split == TEST:
        write_arrays(parts / f"{task.name}.npz", scene.truth._asdict())
    write_scene(folder / task.split / task.name, scene, task)


def _is_there(folder: Path, parts: Path, task: Task, known: set[str]) -> bool:
    """Whether a scene is whole, and its truth; where somebody took that away, both are made again, as they were."""
    told = task.split != TEST or task.name in known or (parts / f"{task.name}.npz").is_file()
    return told and (folder / task.split / task.name / SCENE).is_file()


def _join(truth: Path, parts: Path, known: set[str]) -> None:
    """One file out of the truth of many scenes; the parts go when it is whole."""
    made = {path.stem: path for path in sorted(parts.glob("*.npz")) if not path.name.startswith(".")}
    if set(made) - known:
        arrays = load_arrays(truth) if truth.is_file() else {}
        for name, path in made.items():
            arrays |= {f"{name}/{field}": value for field, value in load_arrays(path).items()}
        write_arrays(truth, dict(sorted(arrays.items())))
    shutil.rmtree(parts, ignore_errors=True)


def _finish(folder: Path, settings: ExportSettings, tasks: list[Task], truth: Path) -> None:
    """What stands beside the scenes."""
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(["name", "split", "sensor"])
    rows.writerows([task.name, task.split, task.sensor] for task in tasks)
    write_text(folder / TABLE, text.getvalue())
    write_json(folder / sheet.SCHEMA, sheet.schema())
    write_text(folder / sheet.README, sheet.text(settings, tasks, truth.name))


def _opened(folder: Path, settings: ExportSettings, buildings: list[Path], count: int) -> int:
    """Begin a folder, or check that it is of the same settings, files and code; how many scenes it is to have."""
    wanted = {
        "format": FORMAT, "format_version": FORMAT_VERSION, "settings": _as_table(settings),
        "buildings": {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in buildings},
        "code": versions()["code"],
    }  # fmt: skip
    path = folder / MANIFEST
    if path.exists():
        held = load_json(path)
        other = [name for name in wanted if not isinstance(held, dict) or held.get(name) != wanted[name]]
        if other:
            raise InputError(f"{path}: holds a benchmark of other {', '.join(other)}; choose another DIR or remove it")
        count = max(count, int(held["count"]))
    elif foreign := {one.name for one in folder.iterdir()} - OWN_FILES:
        raise InputError(f"{folder}: expected a new folder or one of jaxmm benchmark export, found {min(foreign)}")
    for split in SPLITS:  # of a process that was killed
        for stale in (folder / split).glob(".*"):
            shutil.rmtree(stale, ignore_errors=True)
    for building in buildings:
        (folder / BUILDINGS).mkdir(exist_ok=True)
        shutil.copyfile(building, folder / BUILDINGS / building.name)
    write_text(folder / sheet.SETTINGS, tomli_w.dumps(_as_table(settings)))
    write_json(path, wanted | {"count": count})
    return count


def _as_table(settings: ExportSettings) -> dict[str, Any]:
    return {name: list(value) if isinstance(value, tuple) else value for name, value in vars(settings).items()}


def _building_files(folder: Path | None) -> list[Path]:
    if folder is None:
        return []
    paths = sorted(path.resolve() for path in folder.rglob("*.ifc"))
    if not paths:
        raise InputError(f"--ifc {folder}: expected IFC files, found {'none' if folder.is_dir() else 'no folder'}")
    if len({path.name for path in paths}) < len(paths):
        raise InputError(f"--ifc {folder}: expected files of different names, found one twice")
    for path in paths:
        if not np.isin(read_once(path).building.elements.semantic, (WALL, PILLAR)).any():
            raise InputError(f"{path}: expected walls or columns, found none")
    return paths
