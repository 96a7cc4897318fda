"""How kernels are fetched, fed and shared out on the CPU, where a launch runs on one core."""

import functools
import importlib
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from types import ModuleType

import numpy as np
import warp as wp

from warp_scanner.cores import core_count
from warp_scanner.quiet import start_quietly

wp.config.log_level = wp.LOG_WARNING

_loaded: set[ModuleType] = set()
_PIECES_PER_THREAD = 8  # enough to even out pieces that take longer

FARTHEST = 1e15  # [m] coordinates beyond this are taken for mistakes; squares of differences stay finite


def load(kernels: ModuleType) -> None:
    """Compile (or fetch) a file of kernels once, before threads could try to do so at the same time."""
    if kernels not in _loaded:
        _compiler().submit(_load, kernels).result()


def _load(kernels: ModuleType) -> None:
    if kernels not in _loaded:
        start_quietly()
        wp.load_module(kernels, device="cpu")
        _loaded.add(kernels)


@functools.cache
def _compiler() -> ThreadPoolExecutor:
    """One thread that compiles all: what Warp makes of its headers, in a second, is for one thread."""
    return ThreadPoolExecutor(1, "compiler")


def load_all(names: Sequence[str]) -> None:
    """Load files of kernels by name, in this order; whoever needs one meanwhile, in another thread, waits for it."""
    for name in names:
        load(importlib.import_module(f"warp_scanner.kernels.{name}"))


def share(array: np.ndarray, dtype: type) -> wp.array:
    """The array as Warp sees it, in the same memory if it is contiguous; vectors and matrices take the last axes."""
    array = np.ascontiguousarray(array)
    trailing = {wp.vec2: 1, wp.vec3: 1, wp.mat33: 2}.get(dtype, 0)
    return wp.array(array, dtype=dtype, ndim=array.ndim - trailing, device="cpu", copy=False)


def share_out(launch: Callable[[int, int], None], count: int, threads: int, at_once: int | None = None) -> None:
    """Call launch(first, size) for pieces of `count`, each of `at_once` or as many as even out the threads.

    A launch on the CPU runs on one core and releases the interpreter lock, so threads share the pieces out.
    """
    size = at_once or (count if threads == 1 else max(1, count // (_PIECES_PER_THREAD * threads)))
    pieces = [(first, min(size, count - first)) for first in range(0, count, size)] if count else []
    if threads == 1 or len(pieces) == 1:
        for piece in pieces:
            launch(*piece)
        return
    list(_pool(threads).map(lambda piece: launch(*piece), pieces))


@functools.cache
def _pool(threads: int) -> ThreadPoolExecutor:
    """Threads that stay: a scan takes a hundred calls, and starting threads for each costs more than some of them."""
    return ThreadPoolExecutor(threads)


if hasattr(os, "register_at_fork"):  # a copy of this process has none of its threads
    os.register_at_fork(after_in_child=_pool.cache_clear)
    os.register_at_fork(after_in_child=_compiler.cache_clear)


def thread_count(threads: int | None) -> int:
    """How many threads to use; by default as many as there are cores that this process may run on."""
    if threads is not None and threads < 1:
        raise ValueError(f"threads must be at least 1, got {threads}")
    return threads or core_count()


def parts_of(sizes: np.ndarray, most: int) -> list[slice]:
    """Consecutive items in parts whose sizes add up to at most `most`, but where one item alone is larger."""
    parts, begin, total = [], 0, 0
    for item, size in enumerate(sizes):
        if item > begin and total + size > most:
            parts.append(slice(begin, item))
            begin, total = item, 0
        total += size
    return [*parts, slice(begin, len(sizes))] if len(sizes) else []


def check_cloud(points: np.ndarray, name: str) -> np.ndarray:
    """The points as an array, once they are (N, 3) and finite.

    Raises:
        ValueError: they are not, or a coordinate is beyond 1e15 m.
    """
    points = np.asarray(points)
    if points.ndim != 2 or points.shape[1] != 3:
        raise ValueError(f"{name} must be (N, 3), got {points.shape}")
    if len(points) and not (points.min() > -FARTHEST and points.max() < FARTHEST):  # no comparison with NaN holds
        raise ValueError(f"{name} must be finite and within {FARTHEST:g} m, got {points.min()} to {points.max()}")
    return points


def joined(clouds: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Points of all clouds one after the other, (3 N,) float64, and where each begins, (clouds + 1,) int32."""
    start = starts_of([len(cloud) for cloud in clouds])
    return np.concatenate([np.zeros((0, 3)), *clouds], dtype=np.float64).ravel(), start


def starts_of(counts: list[int] | np.ndarray) -> np.ndarray:
    """Where each of several runs begins, and the end of the last: (runs + 1,) int32."""
    return np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)
