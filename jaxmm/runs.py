"""The run folder: one writer at a time, every file whole or absent, and enough beside it to make it again."""

import contextlib
import dataclasses
import fcntl
import importlib.metadata
import json
import os
import platform
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import jax
import numpy as np
import safetensors
import safetensors.numpy
import tomli_w
from flax.traverse_util import flatten_dict, unflatten_dict

from jaxmm.config import Config, parse
from jaxmm.inputs import InputError
from jaxmm.train import Model

CONFIG, VERSIONS, METRICS, MODELS = "config.toml", "versions.json", "metrics.jsonl", "models.safetensors"
PACKAGES = (
    "jaxmm",
    "flax",
    "jax",
    "jaxlib",
    "numpy",
    "optax",
    "orbax-checkpoint",
    "scikit-learn",
    "scipy",
    "warp-lang",
)


def write_atomically(path: Path, write: Callable[[Path], Any]) -> None:
    """Let `write` fill a temporary file beside `path`, then rename it: readers see the old file or the new one."""
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}.tmp")
    try:
        write(temporary)
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


def write_text(path: Path, text: str) -> None:
    """Write text, whole or not at all."""
    write_atomically(path, lambda temporary: temporary.write_text(text, encoding="utf-8"))


def write_json(path: Path, value: Any) -> None:
    """Write JSON, whole or not at all; NaN is refused, gaps are null."""
    write_text(path, json.dumps(value, indent=1, allow_nan=False) + "\n")


def write_arrays(path: Path, arrays: dict[str, np.ndarray]) -> None:
    """Write a .npz of plain arrays, whole or not at all."""

    def write(temporary: Path) -> None:
        with open(temporary, "wb") as file:  # a file object: savez would append .npz to a name
            np.savez(file, **arrays)

    write_atomically(path, write)


@contextlib.contextmanager
def open_run(folder: Path, config: Config) -> Iterator[None]:
    """Hold a run folder for writing: made when absent, resumed when it holds the same settings.

    Raises:
        InputError: the folder holds something else, other settings, or a process that is still running.
    """
    if folder.is_dir() and any(folder.iterdir()) and not (folder / CONFIG).exists():
        leftovers = {path.name for path in folder.iterdir()} - {".lock", f".{CONFIG}.tmp"}
        if leftovers:
            raise InputError(f"{folder}: expected a new folder or a run folder with {CONFIG}, found {min(leftovers)}")
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder}: expected a folder to write to, found a file")
    folder.mkdir(parents=True, exist_ok=True)
    with open(folder / ".lock", "w") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise InputError(
                f"{folder}: another process is writing to this run; wait for it or choose --out"
            ) from error
        if (folder / CONFIG).exists():
            if read_config(folder) != config:
                raise InputError(f"{folder}: holds a run with other settings; choose another --out or remove it")
        else:
            write_text(folder / CONFIG, tomli_w.dumps(as_table(config)))
            write_json(folder / VERSIONS, versions())
        yield


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
    return parse(path.read_text(encoding="utf-8"), where=str(path))


def as_table(config: Config) -> dict[str, Any]:
    """A Config as TOML writes it: every setting, defaults too."""
    table = dataclasses.asdict(config)
    return table | {"room": dict(config.room)}


def versions() -> dict[str, Any]:
    """What the bits of a run depend on."""
    return {
        "python": platform.python_version(),
        "machine": platform.machine(),
        "threads": os.cpu_count(),
        "packages": {name: importlib.metadata.version(name) for name in PACKAGES},
        "git_commit": _git_commit(),
    }


def _git_commit() -> str | None:
    """Commit of the source tree, `+` when it has changes, None outside a checkout."""
    tree = Path(__file__).resolve().parents[1]
    if not (tree / ".git").exists():
        return None
    try:
        commit, changes = (
            subprocess.run(["git", "-C", str(tree), *words], capture_output=True, text=True, check=True).stdout.strip()
            for words in (["rev-parse", "HEAD"], ["status", "--porcelain", "--untracked-files=no"])
        )
    except (OSError, subprocess.CalledProcessError):
        return None
    return commit + ("+" if changes else "")


def write_records(folder: Path, records: list[dict[str, Any]]) -> None:
    """Write metrics.jsonl: one line per validation of each method."""
    write_text(folder / METRICS, "".join(json.dumps(record, allow_nan=False) + "\n" for record in records))


def save_models(path: Path, models: dict[str, Model], config: Config) -> None:
    """Export trained models: tensors `<method>/params|batch_stats/<layer>/<name>`, S on axis 0; and the settings."""
    nested = {method: jax.tree.map(np.asarray, model._asdict()) for method, model in models.items()}
    tensors = {"/".join(key): np.ascontiguousarray(value) for key, value in flatten_dict(nested).items()}
    metadata = {"config": tomli_w.dumps(as_table(config))}
    write_atomically(path, lambda temporary: safetensors.numpy.save_file(tensors, temporary, metadata))


def load_models(path: Path) -> tuple[dict[str, Model], Config]:
    """Trained models by method, and the settings they were trained with, from a run folder or a .safetensors file.

    Raises:
        InputError: there is no such file, or it does not hold models of ours.
    """
    if path.is_dir():
        read_config(path)
        path = path / MODELS
    if not path.is_file():
        raise InputError(f"{path}: expected trained models, found no file")
    try:
        with safetensors.safe_open(path, framework="numpy") as file:
            metadata = file.metadata() or {}
            tensors = {tuple(name.split("/")): file.get_tensor(name) for name in file.keys()}
    except (safetensors.SafetensorError, OSError) as error:
        raise InputError(f"{path}: not a whole safetensors file: {str(error).splitlines()[0]}") from error
    if "config" not in metadata:
        raise InputError(f"{path}: expected settings in the metadata under `config`, found {sorted(metadata)}")
    nested = unflatten_dict(tensors)
    try:
        models = {method: Model(parts["params"], parts["batch_stats"]) for method, parts in nested.items()}
    except (KeyError, TypeError) as error:
        raise InputError(f"{path}: expected tensors <method>/params/... and <method>/batch_stats/...") from error
    return models, parse(metadata["config"], where=f"{path}: config")
