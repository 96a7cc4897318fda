"""How far points are from the surfaces of the primitives of a room: the host side of kernels/surface_distance.py."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import warp as wp

from warp_scanner.kernels import surface_distance as kernels
from warp_scanner.launches import load, share, share_out, starts_of, thread_count
from warp_scanner.scenes.scenes import GAP, Primitives


def surface_distance(
    primitives: Primitives,
    present: np.ndarray | None,
    points: Sequence[np.ndarray],
    threads: int | None = None,
) -> list[np.ndarray]:
    """Distance of each point to the nearest surface of any primitive of its room, from inside or outside.

    Args:
        primitives: of R rooms, K slots.
        present: (R, K) bool, False leaves a primitive out; None = all are there.
        points: (N, 3) [m] world for each room; N differs and may be 0.
        threads: how many to use; by default one for each core it may run on.

    Returns:
        (N,) float32 [m] for each room; infinity in a room without primitives.

    Raises:
        ValueError: not as many clouds as rooms.
    """
    if len(points) != len(primitives.kind):
        raise ValueError(f"points must be {len(primitives.kind)} clouds, one for each room, got {len(points)}")
    start = starts_of([len(cloud) for cloud in points])
    apart = np.empty(start[-1], np.float32)
    if not len(apart):
        return [apart[:0] for _ in points]
    load(kernels)
    solids = kernels.Solids()
    kind = primitives.kind if present is None else np.where(present, primitives.kind, GAP)
    solids.kind = share(kind.astype(np.uint8), wp.uint8)
    solids.center = share(np.asarray(primitives.center, np.float32), wp.vec3)
    solids.half_size = share(np.asarray(primitives.half_size, np.float32), wp.vec3)
    turn = np.stack([np.cos(primitives.yaw), np.sin(primitives.yaw)], axis=-1).astype(np.float32)
    solids.turn = share(turn, wp.vec2)
    room_of = share(np.repeat(np.arange(len(points), dtype=np.int32), np.diff(start)), wp.int32)
    cloud = share(np.concatenate(points).astype(np.float32), wp.vec3)

    def launch(first: int, size: int) -> None:
        inputs = [first, solids, room_of, cloud, share(apart, wp.float32)]
        wp.launch(kernels.measure, dim=size, inputs=inputs, device="cpu")

    share_out(launch, len(apart), thread_count(threads))
    return [apart[a:b] for a, b in pairwise(start)]
