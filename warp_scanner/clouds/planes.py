"""Ranges on the planes that rays and their neighbours end on: what errs from ray to ray, settles.

The thin host side of kernels/planes.py. P rays from one place, S of them are chosen, K neighbours. Any frame; metres.
"""

from typing import NamedTuple

import numpy as np
import warp as wp

from warp_scanner.kernels import planes as kernels
from warp_scanner.launches import load, share, share_out, thread_count

FEW = kernels.FEW  # rays that share a plane by chance are fewer


class OnPlanes(NamedTuple):
    """Where the chosen rays meet the planes of their neighbourhoods."""

    distance: np.ndarray  # (S,) float32 [m]
    # (S,) int32 neighbours on the plane, itself included; 0 where the ray itself is none of them. Of a ray that keeps
    # its range, on no plane, those beside it. Less than FEW: it hangs between surfaces, or it did not come back.
    support: np.ndarray


def on_planes(
    direction: np.ndarray,
    distance: np.ndarray,
    margin: np.ndarray,
    neighbour: np.ndarray,
    chosen: np.ndarray | None = None,
    threads: int | None = None,
) -> OnPlanes:
    """Fit a plane to each chosen ray and those of its neighbours that lie on one with it.

    A plane's inverse range is linear in the direction, so the fit is exact at any distance and slant. It begins with
    the neighbours that a surface of up to 75 degrees incidence could reach, and goes on with those on the plane. A
    ray that is on none tries those that are as far away as itself; where these are on none either, but enough of them
    are beside it, as on a shaft, it keeps its range.

    Args:
        direction: (P, 3) unit vectors.
        distance: (P,) [m], positive; inf where nothing came back.
        margin: (P,) [m] within which each range is that of a plane.
        neighbour: (S, K <= 64) int of P: rays close to each chosen one, itself among them.
        chosen: (S,) int of P; None: all.
        threads: how many to use; by default one for each core it may run on.

    Raises:
        ValueError: the shapes disagree, K is too large, a neighbour is no ray, or a range is not positive.
    """
    distance, margin = np.asarray(distance, np.float32), np.asarray(margin, np.float32)
    chosen = np.arange(len(distance)) if chosen is None else np.asarray(chosen)
    neighbour = np.asarray(neighbour)
    if np.shape(direction) != (len(distance), 3) or margin.shape != distance.shape:
        raise ValueError(f"direction must be ({len(distance)}, 3) and margin ({len(distance)},), got "
                         f"{np.shape(direction)} and {margin.shape}")  # fmt: skip
    if neighbour.ndim != 2 or len(neighbour) != len(chosen):
        raise ValueError(f"neighbour must be ({len(chosen)}, K), got {neighbour.shape}")
    if neighbour.shape[1] > kernels.MOST:
        raise ValueError(f"neighbour must hold at most {kernels.MOST} rays a row, got {neighbour.shape[1]}")
    for name, rays in (("neighbour", neighbour), ("chosen", chosen)):
        if rays.size and not (rays.min() >= 0 and rays.max() < len(distance)):
            raise ValueError(f"{name} must be within 0 to {len(distance) - 1}, got {rays.min()} to {rays.max()}")
    if not np.all(distance > 0.0):  # also false for NaN
        least = np.nan if np.isnan(distance).any() else distance.min()
        raise ValueError(f"distance must be positive, got {least}")
    found = OnPlanes(np.empty(len(chosen), np.float32), np.empty(len(chosen), np.int32))
    if len(chosen):
        load(kernels)
        rays = kernels.Rays()
        rays.direction = share(np.asarray(direction, np.float32), wp.vec3)
        rays.distance, rays.margin = share(distance, wp.float32), share(margin, wp.float32)
        rays.chosen = share(chosen.astype(np.int32), wp.int32)
        rays.neighbour = share(neighbour.astype(np.int32, copy=False), wp.int32)
        outputs = [share(found.distance, wp.float32), share(found.support, wp.int32)]

        def launch(first: int, size: int) -> None:
            wp.launch(kernels.settle, dim=size, inputs=[first, rays, *outputs], device="cpu")

        share_out(launch, len(chosen), thread_count(threads))
    return found
