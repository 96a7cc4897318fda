"""Runs a reader in a process of its own: a library that a damaged file crashes or stalls then costs one line, not all.

For libraries in C++ that check little of what they are given. Starting such a process takes about as long as importing
the library, half a second. What goes between the two is JSON and an .npz archive without pickles: whatever a damaged
file makes of the reader, its answer carries no code.
"""

import contextlib
import importlib
import io
import json
import os
import resource
import signal
import subprocess
import sys
import time
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np
import psutil

_WORDS = "/words"  # where the archive holds the JSON; no array has such a name
_IDLE = 60.0  # [s] by the clock, after which a reader that has computed for less than _LEAST waits for what never comes
_LEAST = 0.5  # [s]; some wake now and then to look whether it has come
_LOOK = 2.0  # [s] between two looks at it


class Plain(NamedTuple):
    """What may be answered."""

    words: Any  # what JSON knows; tuples come back as lists
    arrays: dict[str, np.ndarray]  # by name; of numbers, truth values or text


class Limits(NamedTuple):
    """What a reader may take before it counts as stalled."""

    seconds: int  # of computing, in all its threads: a busy machine must not refuse what is well
    memory: int  # [bytes] of address space


def limits_for(path: Path) -> Limits:
    """Generous for any honest file: a minute, and another for each megabyte; 4 GiB, and 200 bytes for each byte."""
    size = path.stat().st_size
    return Limits(60 + 60 * size // 1_000_000, (4 << 30) + 200 * size)


def read_guarded(read: Callable[[Path, Any], Plain], path: Path, options: Any, limits: Limits) -> Plain:
    """read(path, options), made in a process of its own.

    Args:
        read: a function at the top of a module.
        path: the file.
        options: whatever `read` takes besides, of what JSON knows.
        limits: what it may take.

    Raises:
        ValueError: `read` raised it, with the same words; or its process crashed, exceeded the limits, or answered
            anything but a whole `Plain`.
    """
    return answer_of(begin(read, path, options, limits), path, limits)


def begin(read: Callable[[Path, Any], Plain], path: Path, options: Any, limits: Limits) -> subprocess.Popen:
    """Start the process that reads, as `read_guarded` does, and go on: `answer_of` waits for it, `drop` ends it."""
    request = json.dumps([read.__module__, read.__name__, str(path), options, limits])
    # The same modules must be found there as here, and none by the chance of the folder that it starts in (-P).
    paths = os.pathsep.join(place for place in sys.path if place)
    process = subprocess.Popen(
        [sys.executable, "-P", "-c", f"from {__name__} import answer; answer()"],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
        env=os.environ | {"PYTHONPATH": paths},
    )  # fmt: skip
    with contextlib.suppress(BrokenPipeError):  # it has ended already, and its exit code tells
        process.stdin.write(request.encode())
        process.stdin.close()
    process.stdin = None
    return process


def drop(process: subprocess.Popen) -> None:
    """End a process whose answer nobody waits for any more."""
    process.kill()
    process.communicate()


def answer_of(process: subprocess.Popen, path: Path, limits: Limits) -> Plain:
    """What a process that `begin` started makes of its file; raises what `read_guarded` does."""
    with process:
        try:
            reply = _reply(process)
        except BaseException:  # such as being interrupted: leaving would wait for the process
            process.kill()
            raise
    if reply is None:
        raise ValueError(f"{path}: expected a whole file: the reader computed nothing for {_IDLE:g} s and was not done")
    if process.returncode == -signal.SIGXCPU:
        raise ValueError(
            f"{path}: expected a file that is read within {limits.seconds} s of computing, the reader was not done by "
            "then"
        )
    if process.returncode:
        how = f"was killed by {signal.Signals(-process.returncode).name}" if process.returncode < 0 else "ended"
        raise ValueError(f"{path}: expected a whole file: the reader {how} within it")
    try:
        made, plain = from_bytes(reply)
    except (ValueError, TypeError, KeyError, OSError, EOFError, MemoryError, zipfile.BadZipFile) as error:
        raise ValueError(f"{path}: expected a whole file: the reader's answer cannot be read") from error
    if not made:
        raise ValueError(plain.words)
    return plain


def _reply(process: subprocess.Popen) -> bytes | None:
    """What a process says in the end; None of one that hardly computes, which is killed.

    Nobody is told by the clock alone: a busy machine must not refuse what is well.
    """
    own = psutil.Process(process.pid)
    looked, computed = time.monotonic(), 0.0
    while True:
        try:
            return process.communicate(timeout=_LOOK)[0]
        except subprocess.TimeoutExpired:
            pass
        try:
            now = sum(own.cpu_times()[:2])  # of the process itself, user and system
        except psutil.NoSuchProcess:
            continue  # it has just ended
        if now - computed >= _LEAST:
            looked, computed = time.monotonic(), now
        elif time.monotonic() - looked > _IDLE:
            process.kill()
            process.communicate()
            return None


def answer() -> None:
    """The other side: what standard input asks for, read, goes to standard output."""
    with os.fdopen(os.dup(1), "wb") as out:
        silence = os.open(os.devnull, os.O_WRONLY)
        os.dup2(silence, 1)  # libraries may say what they like there
        module, name, path, options, limits = json.load(sys.stdin.buffer)
        read = getattr(importlib.import_module(module), name)
        limits = Limits(*limits)
        _limit(resource.RLIMIT_AS, limits.memory)
        _limit(resource.RLIMIT_CPU, limits.seconds)
        _limit(resource.RLIMIT_CORE, 0)
        try:
            made, plain = True, read(Path(path), options)
        except ValueError as error:
            made, plain = False, Plain(str(error), {})
        save(out, made, plain)


def save(out: BinaryIO, made: bool, plain: Plain) -> None:
    """Write an answer to a stream: whether the file was read, and what of it; else what is wrong with it."""
    words = np.frombuffer(json.dumps([made, plain.words]).encode(), np.uint8)
    np.savez(out, allow_pickle=False, **{_WORDS: words}, **plain.arrays)


def from_bytes(reply: bytes) -> tuple[bool, Plain]:
    """What `save` wrote; damaged bytes raise almost anything but harm."""
    with np.load(io.BytesIO(reply), allow_pickle=False) as archive:
        arrays = {name: archive[name] for name in archive.files}
    made, words = json.loads(arrays.pop(_WORDS).tobytes())
    return made, Plain(words, arrays)


def _limit(what: int, most: int) -> None:
    """Lower a limit of this process; one that it came with may be lower still."""
    hard = resource.getrlimit(what)[1]
    resource.setrlimit(what, (most if hard == resource.RLIM_INFINITY else min(most, hard), hard))
