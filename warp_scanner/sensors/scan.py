"""Casts rays at the primitives of many rooms at once: the thin host side of kernels/rays.py.

R rooms, K slots of primitives, P rays per room. World frame: metres, z up.
"""

from typing import NamedTuple

import numpy as np
import warp as wp

from warp_scanner.kernels import rays as kernels
from warp_scanner.launches import load, share, share_out, thread_count
from warp_scanner.scenes.scenes import GAP, Primitives

_PACKETS_PER_LAUNCH = 512  # small enough to share out evenly, large enough to hide the cost of a launch


class Scan(NamedTuple):
    """First hits of P rays in each of R rooms. Always (R, P): misses are marked, never dropped."""

    distance: np.ndarray  # (R, P) float32 [m] along the unit ray; inf where nothing was hit
    element: np.ndarray  # (R, P) int32 id of the element hit; -1 where nothing was hit
    semantic: np.ndarray  # (R, P) uint8 class of the element hit; 0 where nothing was hit


class Rays(NamedTuple):
    """Rays of R rooms; what rooms or rays share is stored once."""

    origin: np.ndarray  # (R, 3) or (R, P, 3) [m] world
    direction: np.ndarray  # (P, 3) or (R, P, 3), unit length
    rotation: np.ndarray | None = None  # (R, 3, 3) turns the directions into the world frame; None = they are in it


def cast_rays(primitives: Primitives, present: np.ndarray | None, rays: Rays, threads: int | None = None) -> Scan:
    """The first surface along every ray. Rays may start anywhere and point anywhere.

    A ray that starts inside a solid reports the surface where it leaves that solid. Of two surfaces at the same
    distance the one in the lower slot is reported. The result depends neither on the threads nor on the other rooms
    and rays of the call.

    Args:
        primitives: the scene, R rooms.
        present: (R, K) bool, which primitives are there; None means all of them.
        rays: origins, directions and, if the directions are in a sensor's frame, its rotation.
        threads: how many to use; by default one for each core it may run on.

    Raises:
        ValueError: the shapes disagree, or a direction is not of unit length.
    """
    return _cast(primitives, present, rays, threads)[0]


def cast_slots(
    primitives: Primitives, present: np.ndarray | None, rays: Rays, threads: int | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """As cast_rays, but tells which slot was hit: distance (R, P) float32, slot (R, P) int32, -1 on a miss."""
    scan, slot = _cast(primitives, present, rays, threads)
    return scan.distance, slot


def _cast(
    primitives: Primitives, present: np.ndarray | None, rays: Rays, threads: int | None
) -> tuple[Scan, np.ndarray]:
    room_count, slot_count = primitives.kind.shape
    origin, direction, rotation = checked_rays(rays, room_count)
    present = np.ones((room_count, slot_count), bool) if present is None else np.asarray(present, bool)
    if present.shape != (room_count, slot_count):
        raise ValueError(f"present must be {(room_count, slot_count)}, got {present.shape}")
    shape = (room_count, direction.shape[1])
    # The kernel writes every entry.
    scan = Scan(np.empty(shape, np.float32), np.empty(shape, np.int32), np.empty(shape, np.uint8))
    slot = np.empty(shape, np.int32)
    packet_count = room_count * -(-direction.shape[1] // kernels.PACKET)
    if packet_count == 0:
        return scan, slot

    scene = _prepare(primitives, present & (primitives.kind != GAP))
    inputs = [scene, share(origin, wp.vec3), share(direction, wp.vec3), share(rotation, wp.mat33)]
    outputs = [share(scan.distance, wp.float32), share(slot, wp.int32)]
    outputs += [share(scan.element, wp.int32), share(scan.semantic, wp.uint8)]

    def launch(first: int, count: int) -> None:
        wp.launch(kernels.cast_packets, dim=count, inputs=[first, *inputs], outputs=outputs, device="cpu")

    share_out(launch, packet_count, thread_count(threads), _PACKETS_PER_LAUNCH)
    return scan, slot


def _prepare(primitives: Primitives, present: np.ndarray) -> kernels.Scene:
    """The scene as the kernel wants it."""
    shape = present.shape
    load(kernels)
    scene = kernels.Scene()
    scene.kind = share(primitives.kind.astype(np.uint8, copy=False), wp.uint8)
    scene.element = share(primitives.element.astype(np.int32, copy=False), wp.int32)
    scene.semantic = share(primitives.semantic.astype(np.uint8, copy=False), wp.uint8)
    scene.shape = wp.empty(shape, dtype=kernels.Shape, device="cpu")
    scene.low = wp.empty(shape, dtype=wp.vec3, device="cpu")
    scene.high = wp.empty(shape, dtype=wp.vec3, device="cpu")
    scene.count = wp.empty(shape[0], dtype=int, device="cpu")
    solids = [np.asarray(field, np.float32) for field in (primitives.center, primitives.half_size, primitives.yaw)]
    shared = [share(field, dtype) for field, dtype in zip(solids, (wp.vec3, wp.vec3, wp.float32), strict=True)]
    wp.launch(
        kernels.prepare_shapes, dim=shape[0], inputs=[share(present, wp.bool), *shared], outputs=[scene], device="cpu"
    )
    return scene


def checked_rays(rays: Rays, room_count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Origins (R, 1|P, 3), directions (1|R, P, 3) and rotations (1|R, 3, 3), float32, once their shapes agree."""
    origin, direction = (np.asarray(array, dtype=np.float32) for array in rays[:2])
    origin = origin[:, None] if origin.ndim == 2 else origin
    direction = direction[None] if direction.ndim == 2 else direction
    if direction.ndim != 3 or direction.shape[2] != 3 or direction.shape[0] not in (1, room_count):
        raise ValueError(f"direction must be (P, 3) or ({room_count}, P, 3), got {np.shape(rays.direction)}")
    allowed = {(room_count, 1, 3), (room_count, direction.shape[1], 3)}
    if origin.shape not in allowed:
        raise ValueError(f"origin must be ({room_count}, 3) or one per direction, got {np.shape(rays.origin)}")
    rotation = np.eye(3, dtype=np.float32)[None] if rays.rotation is None else np.asarray(rays.rotation, np.float32)
    if rays.rotation is not None and rotation.shape != (room_count, 3, 3):
        raise ValueError(f"rotation must be ({room_count}, 3, 3), got {rotation.shape}")
    if not np.all(np.abs(np.einsum("rpc,rpc->rp", direction, direction) - 1.0) < 1e-3):
        raise ValueError("direction must hold unit vectors: distances are measured along them")
    if not np.all(np.isfinite(origin)):
        raise ValueError("origin must be finite, got NaN or infinity")
    return origin, direction, rotation
