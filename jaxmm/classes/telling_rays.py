"""Rays that tell of one element what nothing else explains: they end on it if it stands, and clearly behind it if not.

A ray that ends on a door ends on the wall around it as well, two centimetres behind, where the door is gone: it tells
nothing. Nor does one that glass lets through, or that a small error of the pose leads past a rail. E elements, T
triangles, P rays of one scan, n of them meet an element. Positions are offsets from the prior's origin: metres, z up.
"""

from typing import NamedTuple

import numpy as np

from jaxmm.classes.open_doors import leaf_is_near, opening_of
from jaxmm.rays.hits import hits_of
from jaxmm.rays.noise_model import Noise, sigma_at
from jaxmm.rays.scan_rays import ScanRays
from jaxmm.rays.tilted_ends import noise_met
from warp_scanner.scenes.scenes import DOOR, WINDOW
from warp_scanner.sensors.scan import Rays
from warp_scanner.sensors.triangles import TriangleScene, cast_triangles

ERROR, GROWS = 0.03, 0.005  # [m] of a range across a surface, and more for each metre of it
SIGMAS = 3.0  # standard deviations of ranges, that all toward one thing may err by together
LEAST_COSINE = 0.2  # beyond this incidence an error along the ray grows no further
BESIDE = 0.015  # [m] aside of its place, from where the sensor must still see a ray meet the same element
FRAME = 0.07  # [m] from the outline of what opens or has a pane, and does not show where: its frame
NOISY = 2.0  # times the usual error, up to which many rays together tell of a casing what none tells alone
LEAST_GAP, LEAST_UPON = 0.012, 40  # [m] of a casing before its wall; rays that end on either
POSE = 0.005  # [m] by which a registered scan may be off, across what it is registered to
OPEN = 0.2  # share of the rays that tell of a door, that may end on it where it may be open, or gone
PANELS = ("IfcPlate", "IfcCurtainWall")  # of facades, their frames are other elements


class Telling(NamedTuple):
    """What the rays of a scan did that tell of E elements."""

    through: np.ndarray  # (E,) int that end clearly behind it
    support: np.ndarray  # (E,) int that end on it
    glass: np.ndarray  # (E,) int that end behind its panes, or its leaf: they do not tell


class View(NamedTuple):
    """Rays of one scan, and how they err."""

    position: np.ndarray  # (3,) [m]
    direction: np.ndarray  # (n, 3)
    distance: np.ndarray  # (n,) [m]
    noise: Noise


class Known(NamedTuple):
    """What is known of the elements of a building."""

    scene: TriangleScene
    ifc_class: tuple[str, ...]  # (E,)
    clear: np.ndarray | None  # (T,) bool: triangles of glass; None: nobody knows
    in_facade: np.ndarray  # (E,) bool: parts of curtain walls


def telling_rays(known: Known, rays: ScanRays, asked: np.ndarray, gone: np.ndarray) -> Telling:
    """Count the rays of one scan that tell of each element.

    Args:
        known: the building.
        rays: of the scan.
        asked: (E,) bool, of whom to tell; of all others nothing is counted.
        gone: (E,) bool, what is held for removed: it hides nothing, and nothing else stands in its place.
    """
    count = len(asked)
    found = Telling(*(np.zeros(count, np.int64) for _ in range(3)))
    met = hits_of(known.scene, rays.position, rays.direction[: rays.measured], ~gone)
    view = View(rays.position, rays.direction[: rays.measured], rays.distance[: rays.measured], noise_met(rays, met))
    order = np.argsort(met.element, kind="stable")
    starts = np.searchsorted(met.element[order], np.arange(count + 1))
    for row in np.flatnonzero(asked):
        own = slice(None) if gone[row] else order[starts[row] : starts[row + 1]]
        if gone[row] or len(own):
            some = view._replace(direction=view.direction[own], distance=view.distance[own])
            _count(known, some, int(row), gone, found)
    for row in np.flatnonzero(_is_passed(known, found)):
        if _is_open(known, view[:3], int(row), gone):
            found.glass[row] += found.through[row]
            found.through[row] = 0
    return found


def _is_passed(known: Known, told: Telling) -> np.ndarray:
    """(E,) bool: doors that may be gone: what rays tell of their frames is that they are."""
    passed = told.support <= OPEN * (told.through + told.support)
    return (known.scene.triangles.semantic == DOOR) & (told.through > 0) & passed


def _is_open(known: Known, view: tuple[np.ndarray, np.ndarray, np.ndarray], row: int, gone: np.ndarray) -> bool:
    """Whether the leaf of a door may stand beside it."""
    triangles, there = known.scene.triangles, ~gone
    there[row] = False
    corners = triangles.vertices[np.unique(triangles.faces[triangles.element == row])].astype(np.float64)
    expected = cast_triangles(known.scene, Rays(view[0][None], view[1]), there).distance[0]
    return leaf_is_near(opening_of(corners), view, expected)


def _count(known: Known, view: View, row: int, gone: np.ndarray, found: Telling) -> None:
    """Add what some rays tell of one element."""
    position, direction, distance, noise = view
    only = np.zeros(len(gone), bool)
    only[row] = True
    meets = np.isfinite(cast_triangles(known.scene, Rays(position[None], direction), only).distance[0])
    if not meets.any():
        return
    direction, distance = direction[meets], distance[meets]
    met = hits_of(known.scene, position, direction, only)  # of these alone: how surfaces lie takes longer than casting
    reach = met.distance
    behind = cast_triangles(known.scene, Rays(position[None], direction), ~(gone | only)).distance[0]
    usual, own = ERROR + GROWS * reach, SIGMAS * sigma_at(noise, reach)
    margin = np.maximum(usual, own) / np.maximum(met.cosine, LEAST_COSINE)
    if known.scene.triangles.semantic[row] in (DOOR, WINDOW):
        sure = own <= NOISY * usual  # else all of them may be off by more than a casing is deep
        _add_casing(row, tuple(one[sure] for one in (distance - reach, behind - reach, margin)), found)
    pane = _is_pane(known, row, position + direction * reach[:, None].astype(np.float64), met.face)
    passed, ends = distance > reach + margin, np.abs(distance - reach) <= margin
    found.glass[row] += int(np.sum(passed & pane))  # whatever is behind, its own frame as well
    tells = behind - reach > 2.0 * margin
    through = tells & passed & ~pane
    if through.any():
        through[through] = _from_beside(known.scene, position, direction[through], only)
    found.through[row] += int(np.sum(through))
    found.support[row] += int(np.sum(tells & ends))


def _add_casing(row: int, told: tuple[np.ndarray, np.ndarray, np.ndarray], found: Telling) -> None:
    """Add the rays at what lies upon something else, a casing on its wall: together they tell what none does alone.

    Args:
        row: of the element.
        told: (n,) [m] of each ray: its range less that to the element, that to what is behind less the same, margin.
        found: what is added to.
    """
    off, gap, margin = told
    upon = (gap > LEAST_GAP) & (gap <= 2.0 * margin) & (np.abs(off) <= gap + margin)
    if upon.sum() < LEAST_UPON:
        return
    share = off[upon] / gap[upon]  # 0 on the element, 1 on what is behind it
    middle = float(np.median(share))
    # The median of n errs by 1.25 times the standard deviation over sqrt(n), that is 1.48 times the median deviation.
    error = 3.0 * 1.25 * 1.48 * float(np.median(np.abs(share - middle))) / np.sqrt(upon.sum())
    error += POSE / float(np.median(gap[upon]))
    if middle + error < 0.5:
        found.support[row] += int(upon.sum())
    elif middle - error > 0.5:
        found.through[row] += int(upon.sum())


def _from_beside(scene: TriangleScene, position: np.ndarray, direction: np.ndarray, only: np.ndarray) -> np.ndarray:
    """(n,) bool: rays that would meet the element from a little to any side of the sensor, too."""
    middle = direction.mean(axis=0, dtype=np.float64)
    aside = np.cross(middle, [0.0, 0.0, 1.0] if abs(middle[2]) < 0.9 * np.linalg.norm(middle) else [1.0, 0.0, 0.0])
    aside /= np.linalg.norm(aside)
    upward = np.cross(aside, middle)
    upward /= np.linalg.norm(upward)
    meets = np.ones(len(direction), bool)
    for step in (aside, -aside, upward, -upward):
        met = cast_triangles(scene, Rays((position + BESIDE * step)[None], direction[meets]), only)
        meets[meets] = np.isfinite(met.distance[0])
    return meets


def _is_pane(known: Known, row: int, places: np.ndarray, face: np.ndarray) -> np.ndarray:
    """(n,) bool: where (n, 3) rays meet an element, it may let them through though it stands.

    That is its glass; of what shows no frame beside it, and of doors, all that is not near the outline. Of a panel in a
    facade all is: what holds it is not its own.
    """
    triangles = known.scene.triangles
    own = triangles.element == row
    clear = np.zeros(len(own), bool) if known.clear is None else known.clear
    glass, semantic = bool(clear[own].any()), int(triangles.semantic[row])
    if (known.in_facade[row] and known.ifc_class[row] in PANELS) and (glass or known.clear is None):
        return np.ones(len(places), bool)
    if glass and not clear[own].all():
        return clear[face]
    if glass and semantic not in (DOOR, WINDOW):
        return np.ones(len(places), bool)
    if semantic in (DOOR, WINDOW):
        return ~_near_outline(triangles.vertices[triangles.faces[own]].reshape(-1, 3).astype(np.float64), places)
    return np.zeros(len(places), bool)


def _near_outline(corners: np.ndarray, places: np.ndarray) -> np.ndarray:
    """(n,) bool: near the sides or the upper edge of what upright corners (v, 3) span."""
    plan = corners[:, :2] - corners[:, :2].mean(axis=0)
    along = np.linalg.svd(plan, full_matrices=False)[2][0]
    at, span = (points[:, :2] @ along for points in (places, corners))
    low, high = span.min(), span.max()
    top = corners[:, 2].max()
    return (at < low + FRAME) | (at > high - FRAME) | (places[:, 2] > top - FRAME)
