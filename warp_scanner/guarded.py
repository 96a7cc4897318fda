"""Runs a reader in a process of its own: a library that a damaged file crashes or stalls then costs one line, not all.

For libraries in C++ that check little of what they are given. Starting such a process takes about as long as importing
the library, half a second.
"""

import importlib
import os
import pickle
import resource
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

_SLEEP = 20  # times as long by the clock, for a reader that waits for what never comes


class Limits(NamedTuple):
    """What a reader may take before it counts as stalled."""

    seconds: int  # of computing, in all its threads: a busy machine must not refuse what is well
    memory: int  # [bytes] of address space


def limits_for(path: Path) -> Limits:
    """Generous for any honest file: a minute, and another for each megabyte; 4 GiB, and 200 bytes for each byte."""
    size = path.stat().st_size
    return Limits(60 + 60 * size // 1_000_000, (4 << 30) + 200 * size)


def read_guarded(read: Callable[[Path, Any], Any], path: Path, options: Any, limits: Limits) -> Any:
    """read(path, options), made in a process of its own.

    Args:
        read: a function at the top of a module, whose result can be pickled.
        path: the file.
        options: whatever `read` takes besides, which can be pickled.
        limits: what it may take.

    Raises:
        ValueError: `read` raised it, with the same words; or its process crashed, or exceeded the limits.
    """
    request = pickle.dumps((read.__module__, read.__name__, path, options, limits))
    # The same modules must be found there as here, and none by the chance of the folder that it starts in (-P).
    paths = os.pathsep.join(place for place in sys.path if place)
    try:
        done = subprocess.run(
            [sys.executable, "-P", "-c", f"from {__name__} import answer; answer()"],
            input=request, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, timeout=_SLEEP * limits.seconds,
            env=os.environ | {"PYTHONPATH": paths}, check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired as error:
        raise ValueError(f"{path}: {_stalled(limits)}") from error
    if done.returncode == -signal.SIGXCPU:
        raise ValueError(f"{path}: {_stalled(limits)}")
    if done.returncode:
        how = f"was killed by {signal.Signals(-done.returncode).name}" if done.returncode < 0 else "ended"
        raise ValueError(f"{path}: expected a whole file: the reader {how} within it")
    made, value = pickle.loads(done.stdout)
    if not made:
        raise ValueError(value)
    return value


def _stalled(limits: Limits) -> str:
    return f"expected a file that is read within {limits.seconds} s of computing, the reader was not done by then"


def answer() -> None:
    """The other side: what standard input asks for, read, goes to standard output."""
    with os.fdopen(os.dup(1), "wb") as out:
        silence = os.open(os.devnull, os.O_WRONLY)
        os.dup2(silence, 1)  # libraries may say what they like there
        module, name, path, options, limits = pickle.load(sys.stdin.buffer)
        read = getattr(importlib.import_module(module), name)
        _limit(resource.RLIMIT_AS, limits.memory)
        _limit(resource.RLIMIT_CPU, limits.seconds)
        _limit(resource.RLIMIT_CORE, 0)
        try:
            reply = True, read(path, options)
        except ValueError as error:
            reply = False, str(error)
        pickle.dump(reply, out, pickle.HIGHEST_PROTOCOL)


def _limit(what: int, most: int) -> None:
    """Lower a limit of this process; one that it came with may be lower still."""
    hard = resource.getrlimit(what)[1]
    resource.setrlimit(what, (most if hard == resource.RLIM_INFINITY else min(most, hard), hard))
