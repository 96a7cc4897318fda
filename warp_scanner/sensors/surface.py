"""What rays meet: the surface's normal, the angle of incidence, and how much light comes back.

R rooms, K slots, P rays. World frame: metres, z up.
"""

import numpy as np
import warp as wp

from warp_scanner.kernels import surface as kernels
from warp_scanner.launches import load, share
from warp_scanner.scenes import scenes
from warp_scanner.scenes.scenes import Primitives
from warp_scanner.sensors.scan import Rays, checked_rays

# Shares of near infrared light that surfaces send back. Round numbers between those of white paint (0.9) and of dark
# cloth (0.1); real rooms differ, and none was measured.
REFLECTIVITY = {
    scenes.FLOOR: 0.4,
    scenes.CEILING: 0.8,
    scenes.WALL: 0.8,
    scenes.PILLAR: 0.6,
    scenes.DOOR: 0.5,
    scenes.TABLE: 0.5,
    scenes.CHAIR: 0.3,
    scenes.WINDOW: 0.1,
    scenes.CABINET: 0.6,
    scenes.CARTON: 0.5,
    scenes.PERSON: 0.3,
}
UNKNOWN_REFLECTIVITY = 0.5  # of a class that the table does not name


def normals_of(primitives: Primitives, slot: np.ndarray, distance: np.ndarray, rays: Rays) -> np.ndarray:
    """Unit normals (R, P, 3) float32, world frame, of the surfaces that rays hit; they point against the ray.

    Args:
        primitives: the scene, R rooms.
        slot: (R, P) int32 which primitive was hit, -1 for none, as scan.cast_slots tells it.
        distance: (R, P) float32 [m] of the noise-free hits.
        rays: the rays that were cast.

    Returns:
        NaN where nothing was hit.

    Raises:
        ValueError: the shapes disagree, or a slot is out of range.
    """
    room_count, slot_count = primitives.kind.shape
    slot, distance = np.asarray(slot, np.int32), np.asarray(distance, np.float32)
    if slot.ndim != 2 or slot.shape[0] != room_count or slot.shape != distance.shape:
        raise ValueError(f"slot and distance must be ({room_count}, P), got {slot.shape} and {distance.shape}")
    if slot.size and (slot.min() < -1 or slot.max() >= slot_count):
        raise ValueError(f"slot must lie within -1 and {slot_count - 1}, got {slot.min()} to {slot.max()}")
    origin, direction, rotation = checked_rays(rays, slot.shape[0])
    normal = np.full((*slot.shape, 3), np.nan, np.float32)
    solids = [(primitives.kind, wp.uint8), (primitives.center, wp.vec3), (primitives.half_size, wp.vec3)]
    turn = np.stack([np.cos(primitives.yaw), np.sin(primitives.yaw)], axis=-1)
    hits = [(turn, wp.vec2), (slot, wp.int32), (distance, wp.float32)]
    lines = [(origin, wp.vec3), (direction, wp.vec3), (rotation, wp.mat33)]
    _launch(kernels.primitive_normals, slot.shape, [*solids, *hits, *lines, (normal, wp.vec3)])
    return normal


def incidence_of(normals: np.ndarray, rays: Rays) -> np.ndarray:
    """Angles (R, P) float32 [rad] between rays and surface normals: 0 head-on, pi/2 along the surface.

    Args:
        normals: (R, P, 3) world frame, of any length and either sign; NaN where there is no surface. Those of
            primitives come from normals_of, those of triangles from their faces.
        rays: the rays that were cast.

    Returns:
        NaN where the normal is NaN or zero.

    Raises:
        ValueError: the shapes disagree.
    """
    normals = np.asarray(normals, np.float32)
    if normals.ndim != 3 or normals.shape[2] != 3:
        raise ValueError(f"normals must be (R, P, 3), got {normals.shape}")
    _, direction, rotation = checked_rays(rays, len(normals))
    incidence = np.full(normals.shape[:2], np.nan, np.float32)
    arrays = [(normals, wp.vec3), (direction, wp.vec3), (rotation, wp.mat33), (incidence, wp.float32)]
    _launch(kernels.angles, incidence.shape, arrays)
    return incidence


def intensity_of(
    distance: np.ndarray, semantic: np.ndarray, incidence: np.ndarray, reflectivity: dict[int, float] = REFLECTIVITY
) -> np.ndarray:
    """How much light comes back, (R, P) float32; 1 is a white matt surface, 1 m away and seen head-on.

    The radar equation for a matt surface wider than the beam: reflectivity * cos(incidence) / distance^2
    (Hoefle and Pfeifer 2007, "Correction of laser scanning intensity data: data and model-driven approaches", ISPRS J.
    62). Air, optics and electronics are left out: indoors the first is nothing, the others differ by device.

    Args:
        distance: (R, P) [m], inf where nothing was hit.
        semantic: (R, P) uint8.
        incidence: (R, P) [rad], NaN where nothing was hit.
        reflectivity: share of light sent back, by semantic class; others send back UNKNOWN_REFLECTIVITY.

    Returns:
        0 where nothing was hit; infinity at the sensor itself.

    Raises:
        ValueError: the shapes disagree, or a reflectivity is not between 0 and 1.
    """
    if not np.shape(distance) == np.shape(semantic) == np.shape(incidence):
        shapes = f"{np.shape(distance)}, {np.shape(semantic)} and {np.shape(incidence)}"
        raise ValueError(f"distance, semantic and incidence must have one shape, got {shapes}")
    if wrong := {kind: share for kind, share in reflectivity.items() if not (0 <= kind <= 255 and 0.0 <= share <= 1.0)}:
        raise ValueError(f"reflectivity must give classes of 0 to 255 shares between 0 and 1, got {wrong}")
    share = np.full(256, UNKNOWN_REFLECTIVITY, np.float32)
    share[list(reflectivity)] = list(reflectivity.values())
    hit = np.isfinite(distance) & np.isfinite(incidence)
    with np.errstate(divide="ignore", invalid="ignore"):  # of misses
        light = share[semantic] * np.cos(incidence) / np.square(distance)
    return np.where(hit, light, 0.0).astype(np.float32)


def _launch(kernel: wp.Kernel, shape: tuple[int, int], arrays: list[tuple[np.ndarray, type]]) -> None:
    """Run a kernel over (R, P) on the given arrays, in their own memory where they allow it; the last is written."""
    if shape[0] * shape[1] == 0:
        return
    load(kernels)
    stored = {wp.int32: np.int32, wp.uint8: np.uint8}
    shared = [share(np.asarray(array, stored.get(dtype, np.float32)), dtype) for array, dtype in arrays]
    packets = (shape[0], -(-shape[1] // kernels.PACKET))
    wp.launch(kernel, dim=packets, inputs=shared, device="cpu")
