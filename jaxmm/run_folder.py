"""The run folder: one writer at a time, every file whole or absent, and enough beside it to make it again."""

import contextlib
import dataclasses
import errno
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import tomli_w

from jaxmm.config import Config, PaperConfig, load
from jaxmm.files import MANIFEST, held, load_json, write_json, write_text
from jaxmm.inputs import InputError
from jaxmm.versions import TOLD, versions

CONFIG, VERSIONS, METRICS, MODELS = "config.toml", "versions.json", "metrics.jsonl", "models.safetensors"


@contextlib.contextmanager
def open_run(folder: Path, config: Config, *, threads_matter: bool = True, staged: bool = False) -> Iterator[None]:
    """Hold a run folder for writing: made when absent, resumed when it holds the same settings.

    Args:
        folder: the run folder.
        config: its settings.
        threads_matter: whether the bits of what it holds depend on how many cores made them.
        staged: whether each stage itself tells what it was made of (stages.py); then settings and code may be others.

    Raises:
        InputError: the folder holds something else, other settings, or a process that is still running.
    """
    if folder.is_dir() and any(folder.iterdir()) and not (folder / CONFIG).exists():
        begun = {".lock", VERSIONS, f".{VERSIONS}.tmp", f".{CONFIG}.tmp"}  # by a process that was killed at once
        leftovers = {path.name for path in folder.iterdir()} - begun
        if leftovers:
            raise InputError(f"{folder}: expected a new folder or a run folder with {CONFIG}, found {min(leftovers)}")
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder}: expected a folder to write to, found a file")
    with contextlib.ExitStack() as stack:
        try:
            stack.enter_context(held(folder, "writing to this run; wait for it or choose --out"))
        except OSError as error:
            if error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EIO):
                raise  # nothing is wrong with what the user asked for
            raise InputError(f"{folder}: expected a folder to write to: {error.strerror}") from error
        if (folder / CONFIG).exists() and staged:
            if read_config(folder).paper.rows != config.paper.rows:
                raise InputError(f"{folder}: holds a run of another kind; choose another --out or remove it")
            write_json(folder / VERSIONS, versions())
            write_text(folder / CONFIG, tomli_w.dumps(as_table(config)))
        elif (folder / CONFIG).exists():
            if read_config(folder) != config:
                raise InputError(f"{folder}: holds a run with other settings; choose another --out or remove it")
            _check_versions(folder, TOLD if threads_matter else (*TOLD, "threads"))
        else:
            # The settings come last: they make the folder a run folder, with all that one begins with.
            write_json(folder / VERSIONS, versions())
            write_text(folder / CONFIG, tomli_w.dumps(as_table(config)))
        for temporary in folder.rglob(".*.tmp"):  # of a process that was killed
            temporary.unlink()
        try:
            yield
        except (InputError, RuntimeError):
            _forget_unbegun(folder)  # so that the same command with the mistake put right is not another run
            raise


def _forget_unbegun(folder: Path) -> None:
    """Take the settings out of a folder that holds no work yet."""
    if {path.name for path in folder.iterdir()} <= {".lock", CONFIG, VERSIONS, MANIFEST}:
        for name in (CONFIG, VERSIONS, MANIFEST):
            (folder / name).unlink(missing_ok=True)


def _check_versions(folder: Path, free: tuple[str, ...]) -> None:
    """Refuse to go on with a run that other code began: one table would hold the results of both.

    Versions in `free` may differ.
    """
    begun, now = load_json(folder / VERSIONS), versions()
    other = [name for name in now if name not in free and begun.get(name) != now[name]]
    if other:
        raise InputError(
            f"{folder}: holds a run made with other {', '.join(other)} ({VERSIONS}); go back to them or start anew"
        )


def read_config(folder: Path) -> Config:
    """Settings of the run in `folder`.

    Raises:
        InputError: it is no run folder, or its settings cannot be read.
    """
    path = folder / CONFIG
    if not path.is_file():
        raise InputError(
            f"{folder}: expected a run folder with {CONFIG}, found {'none' if folder.is_dir() else 'no folder'}"
        )
    return load(path)


def as_table(config: Config) -> dict[str, Any]:
    """A Config as TOML writes it: every setting, defaults too, but for what only few runs have."""
    table = dataclasses.asdict(config)
    if config.paper == PaperConfig():
        del table["paper"]
    if not config.data.thesis:
        del table["data"]["thesis"]
    return table | {"scan": config.scan.thawed(), "room": config.room.thawed()}


def write_records(folder: Path, records: list[dict[str, Any]]) -> None:
    """Write metrics.jsonl: one line per validation of each method."""
    write_text(folder / METRICS, "".join(json.dumps(record, allow_nan=False) + "\n" for record in records))


def read_records(folder: Path) -> list[dict[str, Any]]:
    """What `write_records` wrote.

    Raises:
        InputError: the file is missing or damaged; it is written with the models.
    """
    path = folder / METRICS
    try:
        return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]
    except (OSError, ValueError) as error:
        remedy = f"delete {MODELS}, and the same command makes both again"
        raise InputError(f"{path}: expected records of the training, found none or damaged ones; {remedy}") from error
