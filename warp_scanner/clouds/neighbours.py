"""Nearest neighbours between many pairs of clouds at once: the thin host side of kernels/neighbours.py.

N points of a cloud, M of the other cloud of its pair. Any frame, metres.
"""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import warp as wp

from warp_scanner.kernels import neighbours as kernels
from warp_scanner.launches import check_cloud, joined, load, parts_of, share, share_out, starts_of, thread_count

_POINTS_AT_ONCE = 2**17  # of one thread: about 12 MB of scratch
_CHUNKS_AT_ONCE = 64  # of one search, so that few large clouds can be shared out as well


class Neighbours(NamedTuple):
    """For every point of one cloud, the nearest point of another."""

    distance: np.ndarray  # (N,) float64 [m]; inf where the other cloud is empty
    index: np.ndarray  # (N,) int32 point of the other cloud, the lowest of equally near ones; -1 where it is empty


def nearest(clouds: Sequence[np.ndarray], others: Sequence[np.ndarray], threads: int | None = None) -> list[Neighbours]:
    """The nearest point of others[i] to every point of clouds[i].

    Exact: searched and measured in float64 as sqrt(dx^2 + dy^2 + dz^2), whatever the extents. The result depends
    neither on the threads nor on the other pairs of the call. Beyond its results, a thread needs memory for some
    131,000 points, or for the largest pair.

    Args:
        clouds: (N, 3) each [m], N differs and may be 0.
        others: as many, (M, 3) each [m], M differs and may be 0.
        threads: how many to use; by default one for each core it may run on.

    Raises:
        ValueError: the numbers of clouds differ, or a cloud is not (N, 3), finite and within 1e15 m.
    """
    return [there for there, _ in _nearest(clouds, others, threads, both_ways=False)]


def nearest_both_ways(
    clouds: Sequence[np.ndarray], others: Sequence[np.ndarray], threads: int | None = None
) -> list[tuple[Neighbours, Neighbours]]:
    """As `nearest`, from clouds[i] to others[i] and back; cheaper than two calls, as each cloud is sorted once."""
    return _nearest(clouds, others, threads, both_ways=True)


def _nearest(
    clouds: Sequence[np.ndarray], others: Sequence[np.ndarray], threads: int | None, both_ways: bool
) -> list[tuple[Neighbours, Neighbours]]:
    if len(clouds) != len(others):
        raise ValueError(f"others must be as many as clouds, {len(clouds)}, got {len(others)}")
    threads = thread_count(threads)
    pairs = [
        (check_cloud(cloud, f"clouds[{number}]"), check_cloud(other, f"others[{number}]"))
        for number, (cloud, other) in enumerate(zip(clouds, others, strict=True))
    ]
    load(kernels)
    sizes = np.array([len(cloud) + len(other) for cloud, other in pairs], np.int64)
    parts = parts_of(sizes, min(_POINTS_AT_ONCE, -(-int(sizes.sum()) // threads)))
    # Pairs are shared out first; only a lone part leaves threads for its clouds and chunks.
    inner = threads if len(parts) == 1 else 1
    with ThreadPoolExecutor(threads) as pool:
        found = pool.map(lambda part: _search(pairs[part], both_ways, inner), parts)
        return [pair for part in found for pair in part]


def _search(
    pairs: list[tuple[np.ndarray, np.ndarray]], both_ways: bool, threads: int
) -> list[tuple[Neighbours, Neighbours]]:
    """Both sides of every pair; where one way is asked for, the way back holds no results."""
    table, start = _table([cloud for pair in pairs for cloud in pair])
    point_count, cloud_count = int(start[-1]), len(start) - 1
    distance, index = np.full(point_count, np.inf), np.full(point_count, -1, np.int32)
    search = _searches(start, table.group_start.numpy(), both_ways)
    table.distance, table.nearest = share(distance, wp.float64), share(index, wp.int32)
    task = share(search, wp.int32)

    def arrange(first: int, size: int) -> None:
        wp.launch(kernels.arrange_clouds, dim=size, inputs=[first, table], device="cpu")

    def look(first: int, size: int) -> None:
        wp.launch(kernels.search_clouds, dim=size, inputs=[first, table, task], device="cpu")

    share_out(arrange, cloud_count, threads)
    share_out(look, len(search), threads)
    sides = [Neighbours(distance[a:b], index[a:b]) for a, b in pairwise(start)]
    return list(zip(sides[::2], sides[1::2], strict=True))


def _searches(start: np.ndarray, group_start: np.ndarray, both_ways: bool) -> np.ndarray:
    """(S, 4) int32: cloud that searches, cloud that is searched, first chunk, chunk after the last."""
    rows = []
    for cloud in range(0, len(start) - 1, 1 if both_ways else 2):
        other = cloud ^ 1
        if start[other + 1] == start[other]:
            continue
        first = int(group_start[cloud]) * kernels.GROUP
        end = first - (int(start[cloud] - start[cloud + 1]) // kernels.CHUNK)
        rows += [(cloud, other, a, min(a + _CHUNKS_AT_ONCE, end)) for a in range(first, end, _CHUNKS_AT_ONCE)]
    return np.array(rows, np.int32).reshape(-1, 4)


def _table(clouds: list[np.ndarray]) -> tuple[kernels.Clouds, np.ndarray]:
    """The clouds as the kernels want them, and where each begins."""
    point, start = joined(clouds)
    group_start = starts_of(-(-np.diff(start) // (kernels.CHUNK * kernels.GROUP)))
    groups = int(group_start[-1])
    table = kernels.Clouds()
    table.point, table.start = share(point, wp.float64), share(start, wp.int32)
    table.group_start = share(group_start, wp.int32)
    for name in ("order", "spare", "cell", "crowd_end"):
        setattr(table, name, wp.empty(len(point) // 3, dtype=int, device="cpu"))
    table.index = wp.empty(groups * kernels.GROUP * kernels.CHUNK, dtype=wp.int64, device="cpu")
    sizes = {
        "chunk": groups * kernels.GROUP * 3 * kernels.CHUNK,
        "chunk_bounds": groups * 6 * kernels.GROUP,
        "group_bounds": 6 * groups,
    }
    for name, size in sizes.items():
        setattr(table, name, wp.empty(size, dtype=wp.float64, device="cpu"))
    return table, start
