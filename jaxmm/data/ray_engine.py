"""Runs a pure function over many tasks on a Ray cluster: a thin layer with the contract of local_engine.results.

The cluster is the one that RAY_ADDRESS names, else one of this machine's cores, made for the purpose. Ray runs a task
again when its worker dies; tasks are pure, so that changes nothing.
"""

import functools
import itertools
import logging
import os
import re
import socket
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator
from typing import Any

from jaxmm import versions
from jaxmm.inputs import InputError

PATIENCE = 5.0  # [s] for the first answer of an address
DEADLINE = 20.0  # [s] for a cluster to take a first visitor; Ray itself would try for minutes
RETRIES = 10  # of one task whose worker died
# Connects as `connect` does, in a process that can be ended: Ray waits without a limit, and then ends its process.
VISIT = """
import logging, sys, ray
try:
    ray.init(address=sys.argv[1], log_to_driver=False, logging_level=logging.CRITICAL)
except Exception as error:
    sys.exit("jaxmm: " + (str(error).strip().splitlines() or [type(error).__name__])[0])
"""
OWN = ("threads", *versions.TOLD)  # versions that may differ between machines whose bits agree


def connect(workers: int | None = None) -> None:
    """Connect to the cluster that RAY_ADDRESS names, or start one of `workers` processes here.

    Raises:
        InputError: Ray is not installed, or the cluster cannot be reached.
    """
    try:
        import ray
    except ImportError as error:
        raise InputError("--engine: ray needs the package ray (pip install 'jaxmm[ray]'), which is not here") from error
    if ray.is_initialized():
        return
    address = os.environ.get("RAY_ADDRESS")
    if address and address != "local":
        _knock(address)
        _visit(address)
    # RAY_BACKEND_LOG_LEVEL stays as it is: when it is set, Ray's libraries print that it is.
    local = {} if address else {"num_cpus": workers, "include_dashboard": False}
    try:
        ray.init(address=address or "local", log_to_driver=False, logging_level=logging.CRITICAL, **local)
    except Exception as error:  # Ray raises many kinds, all of which mean this
        reason = (str(error).strip().splitlines() or [type(error).__name__])[0]
        raise _unreachable(address, reason) from error


def _knock(address: str) -> None:
    """Refuse an address at which nobody answers."""
    place = re.fullmatch(r"(?:ray://)?\[?([^/\]]+)\]?:(\d{1,5})", address)
    if place is None:  # auto, local, or a name that Ray resolves
        return
    try:
        socket.create_connection((place[1], int(place[2])), PATIENCE).close()
    except (OSError, OverflowError, UnicodeError) as error:
        raise _unreachable(address, getattr(error, "strerror", None) or str(error)) from error


def _visit(address: str) -> None:
    """Refuse an address at which something other than a cluster answers, or one that takes nobody in."""
    try:
        done = subprocess.run(
            [sys.executable, "-c", VISIT, address], capture_output=True, text=True, errors="replace", timeout=DEADLINE
        )
    except subprocess.TimeoutExpired as error:
        raise _unreachable(address, f"it did not let us in within {DEADLINE:.0f} s") from error
    if done.returncode:
        lines = [line.removeprefix("jaxmm: ") for line in done.stderr.splitlines() if line.startswith("jaxmm: ")]
        raise _unreachable(address, lines[0] if lines else "Ray gave up on it")


def _unreachable(address: str | None, reason: str) -> InputError:
    return InputError(f"--engine: no Ray cluster to be reached at {address or 'this machine'}: {reason}")


def results(function: Callable[..., Any], tasks: Iterable[tuple], workers: int | None = None) -> Iterator[tuple]:
    """Yield (task, function(*task)) in whatever order they finish, with few tasks under way at once.

    Raises:
        InputError: a machine of the cluster has other code or packages than this one.
        RuntimeError: a task's worker died too often.
        Exception: whatever the function raised.
    """
    import ray

    remote = ray.remote(num_cpus=1, max_retries=RETRIES)(_run)
    workers = workers or max(1, int(ray.cluster_resources().get("CPU", 1)))
    waiting, running = iter(tasks), {}
    here = ground()
    try:
        # One more than can run, so that no worker waits for this process.
        for task in itertools.islice(waiting, workers + 1):
            running[remote.remote(function, here, task)] = task
        while running:
            (done,), _ = ray.wait(list(running), num_returns=1)
            task = running.pop(done)
            result = _fetched(done)
            for following in itertools.islice(waiting, 1):
                running[remote.remote(function, here, following)] = following
            yield task, result
    finally:
        for reference in running:
            ray.cancel(reference, force=True)


def _run(function: Callable[..., Any], expected: dict[str, Any], task: tuple) -> Any:
    """One task on a worker, if its bits would be those of the machine that asked."""
    here = ground()
    if other := [name for name in expected if here.get(name) != expected[name]]:
        raise InputError(f"--engine: machine {os.uname().nodename} of the cluster has other {', '.join(other)}")
    return function(*task)


@functools.cache
def ground() -> dict[str, Any]:
    """What the bits of a task depend on."""
    return {name: value for name, value in versions.versions().items() if name not in OWN}


def _fetched(reference: Any) -> Any:
    import ray

    try:
        return ray.get(reference)
    except ray.exceptions.RayTaskError as error:
        raise (error.cause if isinstance(error.cause, Exception) else error) from None
    except ray.exceptions.RayError as error:
        raise RuntimeError(f"the cluster lost a task: {str(error).splitlines()[0]}") from error
