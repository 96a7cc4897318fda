"""Files of our own: written whole or not at all, and read with an error that names the one that is damaged."""

import contextlib
import fcntl
import hashlib
import json
import os
import shutil
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from jaxmm.inputs import InputError

LOCK = ".lock"  # of a folder that one process at a time may fill
UNFINISHED = ".unfinished"  # how names of folders end that are being filled
MANIFEST = "manifest.json"  # of a data set: which shards it has


def write_atomically(path: Path, write: Callable[[Path], Any]) -> None:
    """Let `write` fill a temporary file beside `path`, then rename it: readers see the old file or the new one.

    A link is followed, and what it points to is replaced.

    Raises:
        InputError: `path` is a folder or a device.
        OSError: it cannot be written; the error names `path`, which stays as it was.
    """
    path = path.resolve()
    if path.exists() and not path.is_file():
        raise InputError(f"{path}: expected a file to write to, found a {'folder' if path.is_dir() else 'device'}")
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}.tmp")
    try:
        write(temporary)
        with open(temporary, "rb") as file:
            os.fsync(file.fileno())  # a rename may reach the disk before what it renames
        os.replace(temporary, path)
    except OSError as error:
        # A full disk shows up on a file that is already open, and such an error does not say which.
        raise OSError(error.errno, error.strerror or str(error), str(path)) from error
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


def write_folder(path: Path, write: Callable[[Path], Any]) -> None:
    """Let `write` fill a temporary folder, then put that, or what it holds, in place: all files are whole before.

    An empty folder that is there stays and is filled: somebody may stand in it, link to it, or have mounted it.
    Temporary folders that killed processes left of the same are removed.

    Raises:
        OSError: it cannot be written.
    """
    path = path.resolve()
    there = path.exists()
    path.parent.mkdir(parents=True, exist_ok=True)
    _clear_unfinished(path)
    work = Path(tempfile.mkdtemp(prefix=f".{path.name}.", suffix=UNFINISHED, dir=path if there else path.parent))
    try:
        with _locked(work):
            write(work)
            if there:
                for file in sorted(work.iterdir()):
                    file.rename(path / file.name)
            else:
                work.chmod(0o755)
                work.rename(path)
    finally:
        shutil.rmtree(work, ignore_errors=True)


def _clear_unfinished(path: Path) -> None:
    """Remove the temporary folders of `write_folder` that nobody fills any more."""
    for place in (path.parent, path):
        for left in place.iterdir() if place.is_dir() else ():
            if left.name.startswith(f".{path.name}.") and left.name.endswith(UNFINISHED) and left.is_dir():
                with contextlib.suppress(OSError), _locked(left):
                    shutil.rmtree(left, ignore_errors=True)


@contextlib.contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """A folder, locked until this process ends or is done with it; BlockingIOError if another process has it."""
    number = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)
        yield
    finally:
        os.close(number)


@contextlib.contextmanager
def held(folder: Path, busy: str) -> Iterator[None]:
    """A folder, made where it is missing, for this process alone; `busy` is what else to say of it.

    Raises:
        InputError: another process holds it.
        OSError: it cannot be made, or written to.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with open(folder / LOCK, "w") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise InputError(f"{folder}: another process is {busy}") from error
        yield


def sha256_of(path: Path) -> str:
    """The SHA-256 of a file's bytes, in hexadecimal."""
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def load_json(path: Path) -> Any:
    """What `write_json` wrote.

    Raises:
        InputError: the file is missing or damaged.
    """
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: expected a file that a run wrote, found it missing or damaged; {REMEDY}") from error


def load_arrays(path: Path) -> dict[str, np.ndarray]:
    """What `write_arrays` wrote.

    Raises:
        InputError: the file is missing or damaged.
    """
    try:
        with np.load(path, allow_pickle=False) as arrays:
            return {name: arrays[name] for name in arrays.files}
    except Exception as error:  # a damaged archive raises almost anything
        raise InputError(f"{path}: expected a file that a run wrote, found it missing or damaged; {REMEDY}") from error


def check_writable(path: Path, option: str) -> None:
    """Refuse an output file that could not be written, before the work for it is done.

    Raises:
        InputError: its folder is missing or read-only, or it is a folder or a device itself.
    """
    target = path.resolve()
    if not target.parent.is_dir() or (target.exists() and not target.is_file()):
        raise InputError(f"{option}: expected a file in an existing folder, got {path}")
    try:
        with tempfile.TemporaryFile(dir=target.parent):
            pass
    except OSError as error:
        raise InputError(f"{option}: cannot write to {target.parent}: {error.strerror}") from error


def check_empty(path: Path, option: str) -> None:
    """Refuse a folder that holds something: nothing of the user's is overwritten.

    What a killed process left half-written in it by `write_folder` is none of theirs, and is removed.

    Raises:
        InputError: it is a file, or not empty.
    """
    if path.is_dir():
        _clear_unfinished(path.resolve())
    if path.exists() and (not path.is_dir() or any(path.iterdir())):
        raise InputError(f"{option}: expected a new or an empty folder, {path} holds something; choose another")


def check_folder(path: Path, option: str) -> None:
    """Refuse a folder for output that could not be made or written to, before the work for it is done.

    Raises:
        InputError: it is a file, or it or the folder that it would be made in is read-only.
    """
    existing = next(place for place in (path.resolve(), *path.resolve().parents) if place.exists())
    if not existing.is_dir():
        raise InputError(f"{option}: expected a folder, found a file: {existing}")
    try:
        with tempfile.TemporaryFile(dir=existing):
            pass
    except OSError as error:
        raise InputError(f"{option}: cannot write to {existing}: {error.strerror}") from error


REMEDY = "delete it, and the same command makes it again"
