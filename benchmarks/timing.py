"""Timing that is fair to compiled code: the first call is reported apart, then the median of many."""

import platform
import statistics
import time
from collections.abc import Callable
from importlib import metadata
from pathlib import Path
from typing import Any, NamedTuple

from jaxmm.files import write_json
from jaxmm.versions import processor
from warp_scanner.cores import core_count

try:
    import jax
except ImportError:  # only what returns JAX arrays has to be waited for
    jax = None


class Timing(NamedTuple):
    first: float  # [s] includes compilation
    median: float  # [s] of `repeat` later calls


def measure_in_turns(functions: list[Callable[[], Any]], repeat: int = 20) -> list[Timing]:
    """Time several functions round by round, so that a machine that slows down slows all contestants alike."""
    firsts = [_once(function) for function in functions]
    rounds = [[_once(function) for function in functions] for _ in range(repeat)]
    medians = [statistics.median(times) for times in zip(*rounds, strict=True)]
    return [Timing(first, median) for first, median in zip(firsts, medians, strict=True)]


def _once(function: Callable[[], Any]) -> float:
    start = time.perf_counter()
    result = function()
    if jax is not None:
        jax.block_until_ready(result)
    return time.perf_counter() - start


def machine(*packages: str) -> dict[str, Any]:
    """What the numbers were measured on: processor, cores, Python and the versions of `packages`."""
    return {
        "processor": processor(),
        "cores": core_count(),
        "python": platform.python_version(),
        "packages": {name: _version(name) for name in packages},
    }


def _version(package: str) -> str | None:
    """None of a peer that is not installed."""
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None


def write_report(path: Path, rows: list[dict[str, Any]], *packages: str, **more: Any) -> None:
    """Write what was measured as JSON: the rows, the machine, and whatever else a benchmark has to say."""
    write_json(path, {"rows": rows, **more, "machine": machine(*packages)})
