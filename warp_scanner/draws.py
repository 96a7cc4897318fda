"""Counter-based random numbers: a draw is a pure function of its keys, never of what was drawn before.

Whatever the batch, the order or the thread, room i of a seed sees the same numbers. R rooms, N numbers per room.
"""

import zlib
from math import ceil
from typing import NamedTuple

import numpy as np

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)


def keys(seed: int, index: np.ndarray, *counters: int | np.ndarray) -> np.ndarray:
    """One key per room from the seed, the room's index and any further counters (an attempt, a variant).

    Args:
        seed: at least 0.
        index: (R,) room numbers, at least 0.
        counters: integers or (R,) integers, at least 0.

    Returns:
        (R,) uint64.

    Raises:
        ValueError: seed or index is negative or not an integer.
    """
    index = np.asarray(index)
    if index.ndim != 1 or not np.issubdtype(index.dtype, np.integer) or np.any(index < 0):
        raise ValueError(f"index must be (R,) integers of at least 0, got {index.dtype} {index.shape}")
    if seed < 0:
        raise ValueError(f"seed must be at least 0, got {seed}")
    key = _mix(np.full(len(index), seed, dtype=np.uint64) + _GOLDEN)
    for counter in (index, *counters):
        key = _chained(key, np.asarray(counter).astype(np.uint64))
    return key


def uniform(key: np.ndarray, stream: str, count: int) -> np.ndarray:
    """Numbers uniform in [0, 1), (R, count) float64, with 53 random bits each; other streams are independent."""
    bits = _chained(key, np.uint64(zlib.crc32(stream.encode())))
    # Splitmix64 on a hashed start; the second mix takes away what little structure neighbouring counters leave.
    bits = _mix(_mix(bits[:, None] + _GOLDEN * np.arange(1, count + 1, dtype=np.uint64)))
    return (bits >> np.uint64(11)).astype(np.float64) * 2.0**-53


def between(key: np.ndarray, stream: str, limits: tuple[float, float], count: int) -> np.ndarray:
    """Numbers uniform in [low, high), (R, count) float64."""
    low, high = limits
    return low + (high - low) * uniform(key, stream, count)


def normal(key: np.ndarray, stream: str, count: int) -> np.ndarray:
    """Standard normal numbers, (R, count) float32 (Box-Muller: both halves of every pair are used)."""
    half = (count + 1) // 2
    flat = uniform(key, stream, 2 * half).astype(np.float32)
    radius = np.sqrt(-2.0 * np.log1p(-np.minimum(flat[:, :half], np.float32(1.0 - 2.0**-24))))
    angle = np.float32(2.0 * np.pi) * flat[:, half:]
    return np.concatenate([radius * np.cos(angle), radius * np.sin(angle)], axis=1)[:, :count]


class Grid(NamedTuple):
    """Regular places, centred on the room, that are then jittered."""

    size: tuple[float, float]  # [m] of the room; fixes the number of places
    spacing: tuple[float, float]  # [m] range that each room draws its spacing from
    randomness: tuple[float, float]  # range of the offset from the regular place, in spacings, end to end
    own_size: np.ndarray | None = None  # (R, 2) [m] of rooms that are smaller than `size`


def places(key: np.ndarray, name: str, grid: Grid) -> tuple[np.ndarray, np.ndarray]:
    """Places on each room's jittered grid: (R, N, 2) [m], and which of the N exist at its spacing (R, N)."""
    most = [ceil(length / grid.spacing[0]) for length in grid.size]
    step = between(key, f"{name} spacing", grid.spacing, 1)
    randomness = between(key, f"{name} randomness", grid.randomness, 1)
    column, row = (axis.ravel() for axis in np.meshgrid(*(np.arange(count) for count in most), indexing="ij"))
    coordinates, exists = [], np.ones((len(key), column.size), bool)
    for axis, number in enumerate((column, row)):
        length = grid.size[axis] if grid.own_size is None else grid.own_size[:, axis, None]
        count = np.maximum(np.floor(length / step), 1.0)
        jitter = randomness * (uniform(key, f"{name} place {axis}", column.size) - 0.5)
        coordinates.append(step * (number - (count - 1) / 2 + jitter))
        exists &= number < count
    return np.stack(coordinates, axis=-1), exists


def _chained(key: np.ndarray, counter: np.ndarray) -> np.ndarray:
    # The factor keeps equal counters in a row (seed 3, room 3) from cancelling each other out.
    with np.errstate(over="ignore"):
        return _mix(key * _GOLDEN + _mix(counter + _GOLDEN))


def _mix(bits: np.ndarray) -> np.ndarray:
    """The finaliser of splitmix64 (Steele, Lea and Flood 2014): every input bit moves every output bit."""
    with np.errstate(over="ignore"):
        bits = (bits ^ (bits >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        bits = (bits ^ (bits >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return bits ^ (bits >> np.uint64(31))
