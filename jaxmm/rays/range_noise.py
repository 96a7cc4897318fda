"""Smooths noisy ranges onto the local planes around them (settling), and leaves out points that hang at edges.

A depth camera errs by centimetres from pixel to pixel, and at the edge of a thing every sensor mixes the ranges of both
sides of the edge. What is near on the sensor is mostly on one plane. N points, K rays closest to one, itself included.
"""

from typing import NamedTuple

import numpy as np
import small_gicp

from jaxmm.rays.evidence import SIGMAS
from jaxmm.rays.near_rays import nearest_rays
from jaxmm.rays.noise_model import noise_of, sigma_at
from jaxmm.rays.scan_rays import PosedScan, drawn
from jaxmm.vectors import lengths
from warp_scanner.clouds.planes import FEW, on_planes
from warp_scanner.launches import thread_count

NEIGHBOURS = 25  # itself included
LEFT = 0.3  # of the noise, after ranges have settled: the fit of so many errs by a fifth of it, at edges by more
OF_NOISE = 13  # and where noise is measured
LEAST_MARGIN = 0.01  # [m] surfaces are no planes
LEAST_GAIN = 0.005  # [m] a range that errs by less is better than that of the plane: a shaft is round
LEFT_TWICE = 0.16  # of the noise, after they have settled twice: with the same neighbours as before
ALIKE, ALIKE_SHARE = 0.05, 0.02  # [m], and of the range: what differs by less than the larger is alike
LEAST_ALIKE, LEAST_AROUND = 7, 16  # of NEIGHBOURS: in a trail fewer ranges are alike, and fewer on one plane
MOST_LEFT = 0.04  # [m] after they have settled once; with more, those of any slanting surface are unlike
MOST_STRAY = 0.2  # share of the points; of a scan with more, planes tell nothing
SAMPLED, BANDS = 6000, 12  # rays that tell of the noise, as many of each band of ranges: few are far, and tell most
MOST_MOVED = 2.5  # times the standard deviation, which is known to a sixth: no range moves by more than three
OWN_SIGMAS = 2.0  # off the plane of others that a ray without one may be
AMID, AMID_SHARE = 40, 0.6  # rays that were kept, closest to one that was not, and the share that must share its plane
AROUND = 0.5  # [m] within which ranges may err
EXACT = 2.5e-5  # [m] from a plane, of a fifth of the rays that tell: as with a normal error of 0.1 mm
LEAST_EXACT = 0.2  # share of these rays, for much of a room may be round
STEPS = 2e-4, 0.02  # [m] of coordinates: in coarser ones walls along the axes are flat, however ranges err; and most
LEAST_STEPS, ODD = 50, 1e-3  # gaps between coordinates that tell a step, and share of them that may be smaller
MOST_EXACT = 1e-3  # [m] noise of an exact scan: ranges in steps, as of a stereo camera, have equal ones too
LEAST_POINTS = 1000  # of a scan that tells what its sensor does
AT_ONCE = 8192  # rays, whose neighbours fit into a core's cache


class Settled(NamedTuple):
    """A scan after its ranges have settled."""

    scan: PosedScan
    sigma: float  # [m] standard deviation of its ranges, at the middle one; 0 of exact ones, and where nothing tells
    stray: float  # share of its points that hang between surfaces, or trail behind edges
    moved: bool = False  # whether any range is another now
    left_out: np.ndarray = np.zeros((0, 3))  # (K, 3) float64 [m] those points, as they were


def settled(scan: PosedScan) -> Settled:
    """The scan with every range on the plane that it shares with its neighbours, without what hangs at edges.

    A scan whose ranges do not err, as a simulated one, is given back as it is; so is one of which too much would be
    left out, as of leaves.

    Args:
        scan: from where, and what; of a large one as many points as `scan_rays` draws.
    """
    points = drawn(scan.points, scan.position)
    if len(points) < LEAST_POINTS:
        return Settled(scan, 0.0, 0.0)
    offset = points - scan.position
    reach = lengths(offset)
    direction = offset / reach[:, None]
    tree = small_gicp.KdTree(direction, num_threads=thread_count(None))
    off, of = _off_planes(tree, direction, reach)
    noise = noise_of(off, np.ones(len(off)), of)
    sigma, rounding = float(sigma_at(noise, np.median(reach))), 0.0
    if not len(off):
        return Settled(scan, 0.0, 0.0)
    if sigma < MOST_EXACT and np.quantile(np.abs(off), LEAST_EXACT) < EXACT:
        # Steps are those of the file, whose frame may be the sensor's own.
        rounding = max(step_of(points), step_of(offset @ scan.rotation)) / np.sqrt(12.0)
        if rounding == 0.0:
            return Settled(scan, 0.0, 0.0)
        sigma = float(np.hypot(sigma, rounding))
    near = nearest_rays(tree, direction, NEIGHBOURS)
    own = np.hypot(sigma_at(noise, reach), rounding)
    distance = _amid_a_plane(direction, reach, own, _distances(direction, reach, own, near))
    distance = np.where(
        np.isfinite(distance), np.clip(distance, reach - MOST_MOVED * own, reach + MOST_MOVED * own), np.inf
    )
    kept = np.isfinite(distance)
    stray = float(1.0 - kept.mean())
    if stray > MOST_STRAY:
        return Settled(scan, sigma, stray)
    places = scan.position + direction[kept] * distance[kept, None]
    moved = bool(np.any(distance[kept] != reach[kept]))
    return Settled(scan._replace(points=places.astype(np.float32)), sigma, stray, moved, points[~kept])


def _distances(direction: np.ndarray, reach: np.ndarray, sigma: np.ndarray, near: np.ndarray) -> np.ndarray:
    """Ranges (N,) [m] on planes, inf of what hangs between surfaces.

    Margins are as wide as the noise, and where that is wide, much fits at edges that does not belong. What has settled
    errs less: where that is still too much, it settles once more, within narrower margins, and what hangs about shows.
    What still trails behind edges is left out last.
    """
    found = on_planes(direction, reach, LEAST_MARGIN + SIGMAS * sigma, near)
    distance = np.where(found.support >= FEW, np.where(sigma > LEAST_GAIN, found.distance, reach), np.inf)
    left = LEFT * sigma
    rows = np.flatnonzero(left > LEAST_GAIN)
    if len(rows):
        found = on_planes(direction, distance, LEAST_MARGIN + SIGMAS * left, near[rows], rows)
        distance[rows] = np.where(found.support >= FEW, found.distance, np.inf)
        rows = rows[(left[rows] < MOST_LEFT) & np.isfinite(distance[rows])]
        trail = _trailing(rows, direction, distance, LEAST_MARGIN + SIGMAS * LEFT_TWICE * sigma, near)
        distance[trail] = np.inf
    return distance


def _amid_a_plane(direction: np.ndarray, reach: np.ndarray, sigma: np.ndarray, distance: np.ndarray) -> np.ndarray:
    """The ranges (N,) [m], inf of what was left out, with those of it that lie on the plane of kept rays around them.

    Between leaves only a few rays meet a wall, and none has enough of its own beside it. What hangs between surfaces
    lies on neither.
    """
    kept, rows = np.flatnonzero(np.isfinite(distance)), np.flatnonzero(np.isinf(distance))
    if len(kept) < AMID or not len(rows):
        return distance
    tree = small_gicp.KdTree(direction[kept], num_threads=thread_count(None))
    near = np.column_stack([rows.astype(np.int32), kept[nearest_rays(tree, direction[rows], AMID)].astype(np.int32)])
    margin = LEAST_MARGIN + np.where(np.isfinite(distance), SIGMAS * LEFT, OWN_SIGMAS) * sigma
    found = on_planes(direction, np.where(np.isfinite(distance), distance, reach), margin, near, rows)
    # A ray on no plane comes back as it was, whatever stands beside it.
    there = (found.support >= AMID_SHARE * AMID) & (found.distance != reach[rows].astype(np.float32))
    distance = distance.copy()
    distance[rows[there]] = np.where(sigma[rows] > LEAST_GAIN, found.distance, reach[rows])[there]
    return distance


def _trailing(
    rows: np.ndarray, direction: np.ndarray, distance: np.ndarray, margin: np.ndarray, near: np.ndarray
) -> np.ndarray:
    """Those of some rows of the ranges (N,) [m] that may hang in the line of sight behind, or before, an edge.

    Mixed ranges along an edge share a plane through the sensor by chance. Unlike those of a wall that is seen at such
    an angle they are few: neither are most rays around on that plane, nor do those along the edge end beside them. At
    the rim of a slanting surface a few right ones go with them, about one ray in a thousand.
    """

    def few_alike(part: np.ndarray) -> np.ndarray:
        own = distance[part, None]
        alike = np.abs(distance[near[part]] - own) < np.maximum(ALIKE, ALIKE_SHARE * own)
        return np.count_nonzero(alike, axis=1) < LEAST_ALIKE

    # In parts: fresh memory for the neighbours of all rows costs more than the counting.
    rows = np.concatenate([part[few_alike(part)] for part in np.array_split(rows, len(rows) // AT_ONCE + 1)])
    found = on_planes(direction, distance, margin, near[rows], rows)
    return rows[found.support < LEAST_AROUND]


def step_of(points: np.ndarray) -> float:
    """The step [m] that coordinates (N, 3) [m] are rounded to, as in a file of millimetres: of the coarsest axis.

    0 where they are not, or in steps outside of STEPS: finer ones hide nothing, and coarser ones are no rounding. Told
    from how close they come to each other, but for the error of float32.
    """
    coarsest = 0.0
    for values in points.T:
        gaps = np.diff(np.sort(values))
        gaps = gaps[gaps > 8.0 * np.spacing(np.float32(np.abs(values).max(initial=0.0)))]
        step = float(np.quantile(gaps, ODD)) if len(gaps) >= LEAST_STEPS else 0.0
        if STEPS[0] < step <= STEPS[1]:
            times = gaps[gaps < 10.0 * step] / step
            if len(times) >= LEAST_STEPS and np.mean(np.abs(times - np.rint(times)) < 0.1) > 0.9:
                coarsest = max(coarsest, step)
    return coarsest


def _off_planes(tree: small_gicp.KdTree, direction: np.ndarray, reach: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """By how much some ranges are off the planes around them (n,) [m], and those ranges (n,) [m]."""
    chosen = _of_all_ranges(reach)
    near = nearest_rays(tree, direction[chosen], OF_NOISE)
    found = on_planes(direction, reach, np.full(len(reach), AROUND), near, chosen)
    told = found.support >= FEW
    # The plane gives way to the ray itself: in their middle, by its share of them.
    off = (reach[chosen] - found.distance)[told] / np.sqrt(1.0 - 1.0 / found.support[told])
    return off, reach[chosen][told]


def _of_all_ranges(reach: np.ndarray) -> np.ndarray:
    """Some of the ranges (N,) [m]: half of any, half as many of each band as of any other."""
    rng = np.random.default_rng(0)
    chosen = rng.permutation(len(reach))
    if len(reach) <= SAMPLED:
        return chosen
    far, rest = np.log(reach), chosen[SAMPLED // 2 :]
    band = np.digitize(far[rest], np.linspace(far.min(), far.max(), BANDS + 1)[1:-1])
    of_each = [rest[band == one][: SAMPLED // (2 * BANDS)] for one in range(BANDS)]
    return np.concatenate([chosen[: SAMPLED // 2], *of_each])
