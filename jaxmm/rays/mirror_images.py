"""Tells the points of a scan that a mirror or a pane shows behind itself: they repeat the room in front of it.

A scanner knows nothing of mirrors: a ray that one throws back is reported straight ahead, at the length of its whole
way. Mirrored at the plane of the mirror, such points lie upon surfaces in front of it. What lies on the prior's own
surfaces behind the plane is real, or cannot be told, and what matches nothing in front stays: it is seen through glass.

A real room behind an open wall may look like the one in front. Three things must hold before points count as images:
most of what the prior does not explain matches; it does so at the very plane of a surface, and hardly at planes some
decimetres beside it (two rooms that are laid out as mirror images mirror about the middle of the wall between them);
and it is more than one flat thing, which may stand there by chance. N points of a scan. Positions are offsets from the
prior's origin, world axes: metres, z up.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from jaxmm.rays.pools import BENT, normals_of
from jaxmm.rays.scan_rays import NEAREST, PosedScan
from jaxmm.vectors import lengths
from warp_scanner.clouds.voxels import thin_clouds

VOXEL, FINE = 0.1, 0.05  # [m] of surfaces whose planes are sought, and of points that images are to lie upon
NEAR, NEAR_SHARE = 0.06, 0.01  # [m], and of its range: an image so close to a surface lies upon it
BEHIND, BEHIND_SHARE = 0.15, 0.02  # the same, behind a plane: a ray that ends there has passed it
UNEXPLAINED = 0.15  # [m] from the prior's surface, from which it does not explain a point
LEAST, LEAST_SHARE = 150, 0.005  # unexplained points, and share of all, thinned: with fewer nothing is told
TRIED = 2000  # points that tell of one plane
SEEDS, BESIDE = 1000, 8  # rays that ask for planes which they pass, and surface points closest beside each
ALIKE = 0.97  # cosine between the normal of a plane and those of its points
THICK = 0.04  # [m] of points off their plane
ASIDE = 1.0  # [m] from the points of a plane, up to which it may go on as a mirror: those hardly show themselves
SHIFTS = np.round(np.arange(-0.45, 0.46, 0.03), 2)  # [m] along its normal, at which a plane is tried
AT_PLANE = -0.04, 0.08  # [m] behind and before a surface, of the plane that images are mirrored at: mirrors hang on it
GLANCED, MAY_MATCH = 300, 0.45  # points that tell at a glance, and share of them that must match about the plane
ABOUT = 0.03  # [m] before and behind where images are mirrored, that is about it
APART = 0.2  # [m] from that, from where on what matches does so by chance
TELLS = 0.3  # share of the shifts, up to which a point that matches tells where the plane is: floors match at all
LEAST_MATCH, LEAST_TELLING = 0.6, 0.5  # shares of what is unexplained, and of what of it tells, that match
LEAST_TOLD, MORE_TOLD = 150, 1500  # of what tells, so many must match; and so many more times the share that does not
MOST_CHANCE = 0.4  # of what matches at the plane, what of it may match elsewhere
FLAT, MOST_FLAT = 0.1, 0.85  # [m] of depth behind the plane, and share of the images in any so thin layer
PATCH = 0.3  # [m] about where rays of images cross the plane: there it mirrors
MOSTLY = 0.8  # share of the rays that cross it there, from which it is no pane, unless
AROUND, MIXED = 16, 0.5  # of the rays closest to one, more than this share are images, and it is not: both are there
MOST_PLANES = 12  # that are tried

Distance = Callable[[np.ndarray, float], np.ndarray]  # points (N, 3) [m], reach [m] -> (N,) [m]; inf, or reach: none
# Starts and ends (N, 3) of rays -> (N,) [m] from each end to the plane of the first surface that its ray meets.
Off = Callable[[np.ndarray, np.ndarray], np.ndarray]


class Surfaces(NamedTuple):
    """What the prior knows of the place."""

    points: Callable[[], np.ndarray]  # (M, 3) [m], where planes are sought; only asked where something is unknown
    distance: Distance
    off: Off


class Plane(NamedTuple):
    """A flat surface, with the scanner on its positive side."""

    normal: np.ndarray  # (3,) float64 unit
    offset: float  # [m] of its points along the normal
    points: np.ndarray  # (n, 3) float64 [m] that lie on it


class Mirror(NamedTuple):
    """A plane that shows images."""

    plane: Plane
    places: np.ndarray  # (K, 3) float64 [m] where rays cross it
    images: int  # points of the scan


class Unmirrored(NamedTuple):
    """A scan without mirror images."""

    scan: PosedScan
    mirrors: tuple[Mirror, ...]  # the one with most images first
    share: float  # of the scan's points that were images


class _Crossing(NamedTuple):
    """Rays that pass a plane: (n,) each."""

    row: np.ndarray  # of the points
    place: np.ndarray  # (n, 3) [m] on the plane
    depth: np.ndarray  # [m] of the point behind it


class _Front(NamedTuple):
    """What images may lie upon."""

    tree: cKDTree  # of the scan's own points
    off: Off  # the prior's surfaces
    position: np.ndarray  # (3,) [m] of the scanner


def without_images(scan: PosedScan, prior: Surfaces) -> Unmirrored:
    """The scan without what mirrors show. Where one mirrors, all rays that cross it are said to have met it, too.

    What throws rays back is there, whatever else passes it: with images only left out, a wall of glass would be left
    to the rays that pass, and seem to be gone.

    Args:
        scan: from where, and what.
        prior: what the scan is compared with; mirrors are sought on the scan's own surfaces, too.
    """
    points = scan.points.astype(np.float64)
    points = points[lengths(points - scan.position) > NEAREST]
    own = points[thin_clouds([points], FINE)[0]]
    unknown = prior.distance(own, UNEXPLAINED) >= UNEXPLAINED
    mirrors, met, left = [], [], points
    if unknown.sum() >= max(LEAST, LEAST_SHARE * len(own)):
        for plane in _planes(np.concatenate([prior.points(), own]), scan.position, own[unknown]):
            front = _Front(cKDTree(own), prior.off, scan.position)
            shift = _shift(plane, own[unknown], front, max(LEAST, LEAST_SHARE * len(own)))
            if shift is None:
                continue
            gone, places = _images(plane, shift, left, (front, prior.distance))
            mirrors.append(Mirror(plane, places, int(gone.sum())))
            met.append(places)
            left = left[~gone]
            gone, _ = _images(plane, shift, own, (front, prior.distance))
            own, unknown = own[~gone], unknown[~gone]
    if not mirrors:
        return Unmirrored(scan, (), 0.0)
    kept = np.concatenate([left, *met]).astype(np.float32)
    mirrors = sorted(mirrors, key=lambda one: -one.images)
    return Unmirrored(scan._replace(points=kept), tuple(mirrors), 1.0 - len(left) / len(points))


def _planes(surface: np.ndarray, position: np.ndarray, ends: np.ndarray) -> list[Plane]:
    """Planes of a surface (M, 3) that rays to some ends (K, 3) pass, those that most of them pass first."""
    surface = surface[thin_clouds([surface], VOXEL)[0]].astype(np.float64)
    normal, bent = normals_of(surface)
    surface, normal = surface[bent < BENT], normal[bent < BENT]
    if len(surface) < BESIDE:
        return []
    ends = ends[_some(len(ends), SEEDS)]
    toward, reach = _seen(ends, position)
    ahead, before = _seen(surface, position)
    beside = cKDTree(ahead).query(toward, BESIDE)[1]
    seeds = beside[before[beside] + BEHIND < reach[:, None]]
    found = []
    while len(seeds) and len(found) < MOST_PLANES:
        tried = seeds[_some(len(seeds), SEEDS // 4)]
        scores = [np.count_nonzero(_on(surface[seeds], normal[seeds], surface[one], normal[one])) for one in tried]
        best = tried[np.argmax(scores)]
        rows = _on(surface, normal, surface[best], normal[best])
        center = surface[rows].mean(axis=0)
        spread = surface[rows] - center
        across = np.linalg.eigh(spread.T @ spread)[1][:, 0]
        across *= np.sign((position - center) @ across) or 1.0
        found.append(Plane(across, float(center @ across), surface[rows]))
        seeds = seeds[~_on(surface[seeds], normal[seeds], surface[best], normal[best])]
    return found


def _seen(points: np.ndarray, position: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Unit directions (N, 3) and distances (N,) [m] of points from a place."""
    offset = points - position
    reach = np.maximum(lengths(offset), NEAREST)
    return offset / reach[:, None], reach


def _on(points: np.ndarray, normals: np.ndarray, center: np.ndarray, across: np.ndarray) -> np.ndarray:
    """(N,) bool: points that lie on the plane through one, and whose surface is that of the plane."""
    return (np.abs((points - center) @ across) < THICK) & (np.abs(normals @ across) > ALIKE)


def _crossing(plane: Plane, points: np.ndarray, position: np.ndarray) -> _Crossing:
    """The rays to points (N, 3) that end behind a plane, within its extent."""
    above = position @ plane.normal - plane.offset
    depth = plane.offset - points @ plane.normal
    if above <= NEAREST:
        return _Crossing(np.zeros(0, int), np.zeros((0, 3)), np.zeros(0))
    reach = lengths(points - position)
    part = above / (above + np.maximum(depth, 0.0))
    row = np.flatnonzero((depth > 0.0) & ((1.0 - part) * reach > BEHIND + BEHIND_SHARE * reach))
    place = position + (points[row] - position) * part[row, None]
    near = cKDTree(plane.points).query(place, distance_upper_bound=ASIDE)[0] <= ASIDE
    return _Crossing(row[near], place[near], depth[row[near]])


def _matches(plane: Plane, shift: float, points: np.ndarray, front: _Front) -> np.ndarray:
    """(N,) bool: points behind a plane that lie upon something before it once they are mirrored at it.

    Args:
        plane: as it was found.
        shift: [m] of it along its normal.
        points: (N, 3) [m].
        front: what is before it, as seen from the plane.
    """
    depth = plane.offset + shift - points @ plane.normal
    above = front.position @ plane.normal - plane.offset - shift
    images = points + 2.0 * depth[:, None] * plane.normal
    starts = front.position + (points - front.position) * (above / np.maximum(above + depth, NEAREST))[:, None]
    near = NEAR + NEAR_SHARE * lengths(points - front.position)
    found = front.tree.query(images, distance_upper_bound=float(near.max(initial=0.0)))[0] < near
    rest = np.flatnonzero((depth > NEAREST) & (above > 0.0) & ~found)
    found[rest] = front.off(starts[rest], images[rest]) < near[rest]
    return found & (depth > 0.0)


def _shift(plane: Plane, unknown: np.ndarray, front: _Front, least: float) -> float | None:
    """By how much [m] a plane mirrors beside itself, told by points (N, 3) that the prior does not explain; or None."""
    crossing = _crossing(plane, unknown, front.position)
    if len(crossing.row) < least:
        return None
    few = _some(len(crossing.row), TRIED)
    points, depth = unknown[crossing.row[few]], crossing.depth[few]
    # Nearly all planes are no mirrors: a few points tell so.
    glance = points[_some(len(points), GLANCED)]
    about = SHIFTS[(SHIFTS >= AT_PLANE[0] - ABOUT) & (SHIFTS <= AT_PLANE[1] + ABOUT)]
    if max(_matches(plane, shift, glance, front).mean() for shift in about) < MAY_MATCH:
        return None
    match = np.array([_matches(plane, shift, points, front) for shift in SHIFTS])
    tells = match.mean(axis=0) <= TELLS
    count = (match & tells).sum(axis=1)
    best = int(np.argmax(count))
    shift = _middle(count, best)
    chance = count[np.abs(SHIFTS - shift) >= APART].max()
    images = np.sort(depth[match[best]])
    layer = np.searchsorted(images, images + FLAT) - np.arange(len(images))
    share = count[best] / max(tells.sum(), 1)
    holds = (
        AT_PLANE[0] <= shift <= AT_PLANE[1]
        and share >= LEAST_TELLING
        and count[best] * len(crossing.row) / len(few) >= LEAST_TOLD + MORE_TOLD * (1.0 - share)
        and match[best].mean() >= LEAST_MATCH
        and chance <= MOST_CHANCE * count[best]
        and layer.max() <= MOST_FLAT * len(images)
    )
    return shift if holds else None


def _some(count: int, most: int) -> np.ndarray:
    """Evenly as many int of `count` as are wanted, or all."""
    return np.linspace(0, count - 1, min(count, most)).astype(int)


def _middle(count: np.ndarray, best: int) -> float:
    """The middle [m] of the shifts about the best one at which at least half as many points match (S,)."""
    low = high = best
    while low > 0 and 2 * count[low - 1] >= count[best]:
        low -= 1
    while high < len(count) - 1 and 2 * count[high + 1] >= count[best]:
        high += 1

    def edge(inner: int, outer: int) -> float:
        if not 0 <= outer < len(count):
            return SHIFTS[inner]
        part = (count[inner] - count[best] / 2) / (count[inner] - count[outer])
        return SHIFTS[inner] + part * (SHIFTS[outer] - SHIFTS[inner])

    return float(edge(low, low - 1) + edge(high, high + 1)) / 2


def _images(
    plane: Plane, shift: float, points: np.ndarray, known: tuple[_Front, Distance]
) -> tuple[np.ndarray, np.ndarray]:
    """Points (N, 3) that are images, or may be: (N,) bool; and where rays cross the mirror, (K, 3) [m].

    Where it mirrors, what the prior explains and what matches cannot be told apart. If nearly all that is seen there
    is images, a whole part of it that matches nothing is one, too, of a side of things that only the mirror shows.
    """
    front, distance = known
    crossing = _crossing(plane, points, front.position)
    behind = points[crossing.row]
    match = _matches(plane, shift, behind, front)
    unknown = distance(behind, UNEXPLAINED) >= UNEXPLAINED
    sure = crossing.place[match & unknown]
    here = cKDTree(sure).query(crossing.place, distance_upper_bound=PATCH)[0] <= PATCH
    if here.any() and match[here].mean() >= MOSTLY:
        around = cKDTree(crossing.place).query(crossing.place, min(AROUND, len(behind)))[1].reshape(len(behind), -1)
        match |= match[around].mean(axis=1) <= MIXED
    gone = np.zeros(len(points), bool)
    gone[crossing.row] = here & match
    return gone, crossing.place[here]
