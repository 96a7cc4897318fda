"""Rays that mirrors throw back and panes let pass: the scanner reports what they meet then as if it lay straight ahead.

A ray that meets an element with sheen goes on along the mirrored direction, or straight on through the element, or
ends there; which of these, is drawn by the element's shares. The scanner knows nothing of it: it reports the length of
the whole way along the direction in which the ray left (a pane's two faces count as one). R rooms, P rays, E elements.
World frame: metres, z up.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from warp_scanner import draws
from warp_scanner.scenes.scenes import Primitives
from warp_scanner.sensors.scan import Rays, Scan, cast_slots, checked_rays
from warp_scanner.sensors.surface import incidence_of, normals_of
from warp_scanner.sensors.triangles import TriangleScene, cast_faces, face_normals

MOST_TURNS = 6  # mirrors and panes that a ray is followed over; then it is lost
OFF = 1e-3  # [m] from a surface, where a ray goes on


class Sheen(NamedTuple):
    """What becomes of rays that meet an element, E of them by number; what is left of 1 ends on it."""

    mirrored: np.ndarray  # (E,) share that is thrown back as by a mirror
    passed: np.ndarray  # (E,) share that goes straight on


class Reflected(NamedTuple):
    """What the scanner reports, and how it came about."""

    scan: Scan  # (R, P), element and class of what the ray met in the end
    incidence: np.ndarray  # (R, P) float32 [rad] there; NaN where nothing was met
    mirrored: np.ndarray  # (R, P) int32 how many mirrors threw the ray back
    passed: np.ndarray  # (R, P) int32 how many panes it went through


# First hits along rays, and the normals (R, P, 3) there, of any length and either side.
Cast = Callable[[Rays], tuple[Scan, np.ndarray]]


def room_caster(primitives: Primitives, present: np.ndarray | None = None, threads: int | None = None) -> Cast:
    """Rays at rooms; see scan.cast_slots."""

    def cast(rays: Rays) -> tuple[Scan, np.ndarray]:
        distance, slot = cast_slots(primitives, present, rays, threads)
        there = np.maximum(slot, 0)
        element, semantic = (np.take_along_axis(field, there, 1) for field in (primitives.element, primitives.semantic))
        scan = Scan(distance, np.where(slot >= 0, element, np.int32(-1)), np.where(slot >= 0, semantic, np.uint8(0)))
        return scan, normals_of(primitives, slot, distance, rays)

    return cast


def building_caster(scene: TriangleScene, present: np.ndarray | None = None, threads: int | None = None) -> Cast:
    """Rays at a building; see triangles.cast_triangles."""

    def cast(rays: Rays) -> tuple[Scan, np.ndarray]:
        scan, face = cast_faces(scene, rays, present, threads)
        return scan, face_normals(scene.triangles, face)

    return cast


def reflected(cast: Cast, rays: Rays, sheen: Sheen, which: tuple[int, np.ndarray]) -> Reflected:
    """What a scanner without errors reports where some elements mirror or let light pass.

    Args:
        cast: of the scene, from `room_caster` or `building_caster`.
        rays: of R rooms.
        sheen: by the scene's element numbers; elements beyond its end have none.
        which: seed and (R,) room numbers: they fix what becomes of every ray.

    Raises:
        ValueError: the shapes disagree, or the shares of an element are negative or more than 1 together.
    """
    sheen, key, rooms = _checked(sheen), draws.keys(*which), len(np.asarray(rays.origin))
    if len(key) != rooms:
        raise ValueError(f"which must name {rooms} rooms, got {len(key)}")
    origin, direction, turn = checked_rays(rays, rooms)
    direction = np.einsum("rij,rpj->rpi", turn, direction)
    shape = (rooms, direction.shape[1])
    origin, direction = (np.broadcast_to(field, (*shape, 3)).copy() for field in (origin, direction))
    scan = Scan(np.full(shape, np.inf, np.float32), np.full(shape, -1, np.int32), np.zeros(shape, np.uint8))
    found = Reflected(scan, np.full(shape, np.nan, np.float32), np.zeros(shape, np.int32), np.zeros(shape, np.int32))
    way, inside, goes_on = np.zeros(shape), np.full(shape, -1), np.ones(shape, bool)
    for turns in range(MOST_TURNS + 1):
        columns = np.flatnonzero(goes_on.any(axis=0))
        if not len(columns):
            break
        part = Rays(origin[:, columns], direction[:, columns])
        hit, normal = cast(part)
        chance = draws.uniform(key, f"sheen {turns}", shape[1])[:, columns]
        ends, thrown, passes, leaves = _what_becomes(hit, sheen, (goes_on[:, columns], inside[:, columns], chance))
        reach = np.where(np.isfinite(hit.distance), hit.distance, 0.0)
        way[:, columns] += reach
        told = (way[:, columns], hit.element, hit.semantic, incidence_of(normal, part))
        for whole, value in zip((*found.scan, found.incidence), told, strict=True):
            whole[:, columns] = np.where(ends, value, whole[:, columns])
        found.mirrored[:, columns] += thrown
        found.passed[:, columns] += passes
        goes_on[:, columns] = moves = thrown | passes | leaves
        ahead = np.where(thrown[..., None], _thrown_back(part.direction, normal), part.direction)
        start = part.origin + part.direction * reach[..., None] + OFF * ahead
        origin[:, columns] = np.where(moves[..., None], start, part.origin)
        direction[:, columns] = np.where(moves[..., None], ahead, part.direction)
        way[:, columns] += OFF
        inside[:, columns] = np.where(passes, hit.element, -1)
    return found


def _checked(sheen: Sheen) -> Sheen:
    """The same with one element more at the end, for all others."""
    sheen = Sheen(*(np.append(np.asarray(share, np.float64), 0.0) for share in sheen))
    if sheen.mirrored.shape != sheen.passed.shape:
        raise ValueError(f"sheen must give two shares for each element, got {[len(share) - 1 for share in sheen]}")
    # Written so that NaN fails too.
    if not (min(share.min() for share in sheen) >= 0.0 and np.all(sheen.mirrored + sheen.passed <= 1.0)):
        raise ValueError("sheen must give shares of at least 0, and of no more than 1 together")
    return sheen


def _what_becomes(hit: Scan, sheen: Sheen, rays: tuple[np.ndarray, ...]) -> tuple[np.ndarray, ...]:
    """Rays (R, P) that end, are thrown back, pass what they meet, or come out again of what they passed."""
    on, inside, chance = rays
    on = on & np.isfinite(hit.distance)
    leaves = on & (hit.element == inside)
    number = np.where((hit.element >= 0) & (hit.element < len(sheen.passed)), hit.element, -1)
    thrown = on & ~leaves & (chance < sheen.mirrored[number])
    passes = on & ~leaves & ~thrown & (chance < (sheen.mirrored + sheen.passed)[number])
    return on & ~leaves & ~thrown & ~passes, thrown, passes, leaves


def _thrown_back(direction: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Unit directions (R, P, 3) after a mirror with such normals, of any length; NaN where there is none."""
    length = np.einsum("rpc,rpc->rp", normal, normal)
    with np.errstate(invalid="ignore", divide="ignore"):
        along = 2.0 * np.einsum("rpc,rpc->rp", direction, normal) / length
    back = direction - along[..., None] * normal
    return back / np.linalg.norm(back, axis=2, keepdims=True)
