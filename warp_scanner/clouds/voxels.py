"""One real point per voxel, for many clouds at once: the thin host side of kernels/voxels.py.

N points of a cloud. Any frame, metres.
"""

from collections.abc import Sequence

import numpy as np
import warp as wp

from warp_scanner.kernels import voxels as kernels
from warp_scanner.launches import check_cloud, joined, load, parts_of, share, share_out, starts_of, thread_count

LARGE = 2**21  # points, from which on a cloud is thinned part by part
_POINTS_AT_ONCE = 2**16  # of one thread: about 8 MB of scratch
_FEWEST_ENTRIES = 16


def thin_clouds(clouds: Sequence[np.ndarray], size: float = 0.1, threads: int | None = None) -> list[np.ndarray]:
    """Choose one real point per voxel: the one nearest to the mean of its voxel, the lowest index among equals.

    Voxels are cubes centred on multiples of `size`, so a wall that stands on a multiple never splits into two layers.
    Distances that differ by less than a millionth of a voxel count as equal. The result depends neither on the threads
    nor on the other clouds of the call. Beyond its results, a thread needs memory for some 65,000 points, or for the
    largest cloud.

    Args:
        clouds: (N, 3) each [m], N differs and may be 0.
        size: edge of a voxel [m].
        threads: how many to use; by default one for each core it may run on.

    Returns:
        (V,) int64 indices into each cloud, ascending, one per occupied voxel.

    Raises:
        ValueError: a cloud is not (N, 3), finite and within 1e15 m, or size is not above zero or too small for the
            extent of a cloud.
    """
    if not 0 < size < np.inf:
        raise ValueError(f"size must be above 0 m and finite, got {size}")
    threads = thread_count(threads)
    clouds = [check_cloud(cloud, f"clouds[{number}]") for number, cloud in enumerate(clouds)]
    load(kernels)
    sizes = np.array([len(cloud) for cloud in clouds], np.int64)
    parts = parts_of(sizes, min(_POINTS_AT_ONCE, -(-int(sizes.sum()) // threads)))
    found = [[]] * len(parts)

    def thin(number: int, _: int) -> None:
        found[number] = _thin(clouds[parts[number]], size)

    share_out(thin, len(parts), threads, at_once=1)
    kept = [indices for part in found for indices in part]
    for number, indices in enumerate(kept):
        if indices is None:
            span = np.ptp(clouds[number], axis=0).max()
            raise ValueError(f"size {size} m is too small for clouds[{number}], which spans {span:.6g} m")
    return kept


def thinned_cloud(points: np.ndarray, size: float = 0.1) -> np.ndarray:
    """One real point per voxel of a cloud of any size, in the memory of a few million points.

    Of up to LARGE points it is what `thin_clouds` chooses. Of more they come part by part, with what was kept of the
    parts before: then the point that is kept may be another of its voxel, somewhat farther from the mean of all.

    Args:
        points: (N, 3) [m].
        size: edge of a voxel [m].

    Returns:
        (V,) int64 indices, ascending, one per occupied voxel.

    Raises:
        ValueError: as `thin_clouds` does.
    """
    kept = np.zeros(0, np.int64)
    for start in range(0, len(points), LARGE):
        kept = np.concatenate([kept, np.arange(start, min(start + LARGE, len(points)))])
        kept = kept[thin_clouds([points.take(kept, axis=0)], size)[0]]
    return kept


def _thin(clouds: list[np.ndarray], size: float) -> list[np.ndarray | None]:
    """The indices of each cloud; None where its cells are too many."""
    table = kernels.Clouds()
    point, start = joined(clouds)
    count = len(point) // 3
    # At most half full, so that cells seldom collide.
    entries = [max(_FEWEST_ENTRIES, 2 ** int(2 * length - 1).bit_length()) for length in np.diff(start)]
    table.point, table.start = share(point, wp.float64), share(start, wp.int32)
    table.table_start = share(starts_of(entries), wp.int32)
    table.table = wp.empty(sum(entries), dtype=int, device="cpu")
    for name, width in (("total", 4), ("apart", 1), ("least", 1)):
        setattr(table, name, wp.empty(width * count, dtype=wp.float64, device="cpu"))
    table.voxel = wp.empty(count, dtype=int, device="cpu")
    table.key = wp.empty(count, dtype=wp.int64, device="cpu")
    kept, kept_count = np.zeros(count, np.int32), np.zeros(len(clouds), np.int32)
    table.kept, table.kept_count = share(kept, wp.int32), share(kept_count, wp.int32)
    wp.launch(kernels.thin_clouds, dim=len(clouds), inputs=[0, size, table], device="cpu")
    return [
        kept[first : first + filled].astype(np.int64) if filled >= 0 else None
        for first, filled in zip(start, kept_count, strict=False)
    ]
