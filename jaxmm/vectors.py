"""Vectors as arrays."""

import functools
import operator
from collections.abc import Callable

import numpy as np

BLOCK = 1 << 16  # rows at once


def lengths(vectors: np.ndarray) -> np.ndarray:
    """Length (N,) of each of some vectors (N, D), in their dtype; D from 1 to 7.

    A fifth of the time of `np.linalg.norm` along rows, which adds so few numbers at a time; the same to the last bit.
    """
    return np.sqrt(functools.reduce(operator.add, (part * part for part in vectors.T)))


def directions(vectors: np.ndarray) -> np.ndarray:
    """Unit vectors (n, 3) of those of some vectors (N, 3) that have a length, in their dtype."""
    length = lengths(vectors)
    return vectors[length > 0.0] / length[length > 0.0, None]


def by_blocks(function: Callable[[np.ndarray], np.ndarray], rows: np.ndarray) -> np.ndarray:
    """What a function of rows (N, ...) gives, (N, ...), asked for some of them at a time.

    So what it needs on the way does not grow with N. It is called at least once, and gives as many rows as it is given.
    """
    first = function(rows[:BLOCK])
    if len(rows) <= BLOCK:
        return first
    found = np.zeros((len(rows), *first.shape[1:]), first.dtype)
    found[:BLOCK] = first
    for start in range(BLOCK, len(rows), BLOCK):
        found[start : start + BLOCK] = function(rows[start : start + BLOCK])
    return found
