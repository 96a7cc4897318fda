"""Gives memory that a process has freed back to the system; of glibc only, elsewhere all of this does nothing.

By default every thread allocates from a heap of its own, and a heap gives back only what is free at its end. Long work
in pools of threads leaves other holes in other heaps each time, and a process grows though it holds no more.
"""

import contextlib
import ctypes

_ARENA_MAX = -8  # M_ARENA_MAX of glibc's malloc.h


def share() -> None:
    """Let the threads of this process allocate from one heap; for processes that compute in one thread at a time."""
    with contextlib.suppress(AttributeError):
        ctypes.CDLL(None).mallopt(_ARENA_MAX, 1)


def give_back() -> None:
    """Return all pages that hold nothing to the system."""
    with contextlib.suppress(AttributeError):
        ctypes.CDLL(None).malloc_trim(ctypes.c_size_t(0))
