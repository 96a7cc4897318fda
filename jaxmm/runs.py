"""The run folder: one writer at a time, every file whole or absent, and enough beside it to make it again."""

import contextlib
import dataclasses
import errno
import fcntl
import hashlib
import importlib.metadata
import json
import platform
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jax
import numpy as np
import safetensors
import safetensors.numpy
import tomli_w
from flax.traverse_util import flatten_dict, unflatten_dict

from jaxmm.calibration import KNOTS, Calibration
from jaxmm.config import SCENARIOS, TRAINED_METHODS, Config, PaperConfig, load, parse
from jaxmm.files import load_json, write_atomically, write_json, write_text
from jaxmm.inputs import InputError, clipped, one_line
from jaxmm.shards import MANIFEST
from jaxmm.train import Model, init_all
from warp_scanner.cores import core_count

CONFIG, VERSIONS, METRICS, MODELS = "config.toml", "versions.json", "metrics.jsonl", "models.safetensors"
PACKAGES = (
    "jaxmm",
    "flax",
    "jax",
    "jaxlib",
    "numpy",
    "optax",
    "orbax-checkpoint",
    "safetensors",
    "scikit-learn",
    "scipy",
    "small-gicp",
    "warp-lang",
)


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
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock = open(folder / ".lock", "w")
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EIO):
            raise  # nothing is wrong with what the user asked for
        raise InputError(f"{folder}: expected a folder to write to: {error.strerror}") from error
    with lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise InputError(
                f"{folder}: another process is writing to this run; wait for it or choose --out"
            ) from error
        if (folder / CONFIG).exists() and staged:
            if read_config(folder).paper.rows != config.paper.rows:
                raise InputError(f"{folder}: holds a run of another kind; choose another --out or remove it")
            write_json(folder / VERSIONS, versions())
            write_text(folder / CONFIG, tomli_w.dumps(as_table(config)))
        elif (folder / CONFIG).exists():
            if read_config(folder) != config:
                raise InputError(f"{folder}: holds a run with other settings; choose another --out or remove it")
            _check_versions(folder, ("git_commit",) if threads_matter else ("git_commit", "threads"))
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


def versions() -> dict[str, Any]:
    """What the bits of a run depend on."""
    return {
        "python": platform.python_version(),
        "machine": platform.machine(),
        "threads": core_count(),
        "packages": {name: importlib.metadata.version(name) for name in PACKAGES},
        "code": _code_hash(),
        "git_commit": _git_commit(),
    }


def _code_hash() -> str:
    """sha256 over the sources of both packages; unlike the commit it tells code from prose."""
    tree = Path(__file__).resolve().parents[1]
    digest = hashlib.sha256()
    for path in sorted(path for name in ("jaxmm", "warp_scanner") for path in (tree / name).rglob("*.py")):
        digest.update(path.relative_to(tree).as_posix().encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()


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


def save_models(path: Path, models: dict[str, Model], config: Config) -> None:
    """Export trained models: tensors `<method>/params|batch_stats/<layer>/<name>`, S on axis 0; and the settings.

    Calibrated ones also have `<method>/calibration/logit|calibrated`.
    """
    nested = {method: jax.tree.map(np.asarray, _as_dict(model)) for method, model in models.items()}
    tensors = {"/".join(key): np.ascontiguousarray(value) for key, value in flatten_dict(nested).items()}
    metadata = {"config": tomli_w.dumps(as_table(config))}
    write_atomically(path, lambda temporary: temporary.write_bytes(safetensors.numpy.save(tensors, metadata)))


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
        raise InputError(f"{path}: not a whole safetensors file: {one_line(error)}") from error
    if "config" not in metadata:
        raise InputError(
            f"{path}: expected settings in the metadata under `config`, found {clipped(str(sorted(metadata)))}"
        )
    config = parse(metadata["config"], where=f"{path}: config")
    for method in config.train.methods:
        kernel = tensors.get((method, "params", "conv1", "kernel"))
        if kernel is not None and kernel.ndim == 3 and kernel.shape[1] != TRAINED_METHODS[method]:
            wanted = f"{TRAINED_METHODS[method]} features for {method}, got {kernel.shape[1]}"
            raise InputError(f"{path}: expected {wanted}; it was trained by another version, train it again")
    expected = {
        method: jax.eval_shape(lambda size=size: _as_dict(init_all(jax.random.key(0), size, config).model))
        for method, size in TRAINED_METHODS.items()
        if method in config.train.methods
    }
    for method in expected.keys() & set(config.train.calibrate):
        knots = jax.ShapeDtypeStruct((len(SCENARIOS), KNOTS), np.float32)
        expected[method] |= {"calibration": Calibration(knots, knots)._asdict()}
    found = {name: (value.shape, value.dtype) for name, value in tensors.items()}
    if found != {name: (leaf.shape, leaf.dtype) for name, leaf in flatten_dict(expected).items()}:
        raise InputError(f"{path}: expected the tensors of {', '.join(expected)} as its settings say, found others")
    if not all(np.isfinite(value).all() for value in tensors.values()):
        raise InputError(f"{path}: expected finite numbers, got NaN or infinity")
    models = {}
    for method, parts in unflatten_dict(tensors).items():
        knots = parts.pop("calibration", None)
        models[method] = Model(**parts, calibration=knots and Calibration(**knots))
    return models, config


def _as_dict(model: Model) -> dict[str, Any]:
    """Its parts, without a calibration that is not there."""
    parts = {"params": model.params, "batch_stats": model.batch_stats}
    return parts if model.calibration is None else parts | {"calibration": model.calibration._asdict()}
