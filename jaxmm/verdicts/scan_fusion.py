"""What several scans say of one place: their log odds are pooled, and one of their points speaks for all.

N points of one side of S scans, K kinds of change, P rays of one scan. Any frame, metres.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from jaxmm.learning.prediction import Side
from jaxmm.objects.face_finish import Rays
from jaxmm.objects.finder import Judged
from jaxmm.rays.scan_rays import ScanRays
from jaxmm.vectors import lengths
from jaxmm.verdicts.verdicts import MOST_SURE
from warp_scanner.clouds.sightlines import cells_of

VOXEL = 0.1  # [m] edge of a place: to that, every scan was thinned
SKY = np.radians(1.0)  # of one direction of which nothing comes back: about a voxel of 0.1 m at 6 m


class Looked(NamedTuple):
    """One scan after all was asked of it."""

    rays: ScanRays
    expected: np.ndarray  # (P,) [m] what its rays should have met, inf = nothing
    added: Side  # the robot's points
    removed: Side  # the prior's
    levels: tuple[float, float]  # heights of floor and ceiling [m]
    notes: tuple[str, ...] = ()  # what is to be said of how it was compared


class Visits(NamedTuple):
    """The points of all scans."""

    points: np.ndarray  # (N, 3) [m]
    scan: np.ndarray  # (N,) int of the scan that saw each
    reach: np.ndarray  # (N,) [m] from where it was seen


def judged_side(looked: Sequence[Looked], change: str, rays: Sequence[Rays] | None = None) -> Judged:
    """One side of all scans together: of a place that several saw, one point has what all say.

    Args:
        looked: the scans.
        change: which side.
        rays: (S,) of each scan, where they are loaded when they are asked for; None: held here.
    """
    parts = [_part(one, change) for one in looked]  # each is looked at once: it may have to be loaded
    points, pillar, wall, apart, own = (
        None if any(part is None for part in fields) else np.concatenate(fields)
        for fields in zip(*(part.fields for part in parts), strict=True)
    )
    scan = np.repeat(np.arange(len(parts)), [len(part.fields[0]) for part in parts])
    sensors = np.array([part.sensor for part in parts])
    visits = Visits(points, scan, lengths(points - sensors[scan]))
    pillar, wall = fused(visits, np.column_stack([pillar, wall])).T
    floor, ceiling = min(part.levels[0] for part in parts), max(part.levels[1] for part in parts)
    judged = Judged(
        points, pillar, wall, apart, sensors, floor, ceiling, scan,
        # What the robot's rays met says nothing of the faces of what is gone.
        (rays if rays is not None else [rays_to_faces(one.rays) for one in looked]) if change == "added" else None, own,
    )  # fmt: skip
    return _with_sky(judged, [part.sky for part in parts]) if change == "added" else judged


class _Part(NamedTuple):
    """What is needed of one side of one scan."""

    fields: tuple[np.ndarray | None, ...]  # points, P(pillar), P(wall), distance to the other side, levels
    sensor: np.ndarray  # (3,) [m]
    sky: np.ndarray  # (n, 3) [m], of `_sky`
    levels: tuple[float, float]


def _part(one: Looked, change: str) -> _Part:
    side = getattr(one, change)
    fields = (side.view.points, side.pillar, side.wall, side.view.apart, side.view.levels)
    return _Part(fields, one.rays.position, _sky(one) if change == "added" else np.zeros((0, 3)), one.levels)


def rays_to_faces(rays: ScanRays) -> Rays:
    """The rays of a scan as faces are asked about."""
    return Rays(rays.position, rays.direction, rays.distance)


def _with_sky(judged: Judged, skies: list[np.ndarray]) -> Judged:
    """The same with points beyond all others, where nothing came back and nothing should: there one looks through."""
    skies = [one.astype(judged.points.dtype) for one in skies]
    scan = np.repeat(np.arange(len(skies)), [len(sky) for sky in skies])
    if not len(scan):
        return judged
    old = np.zeros(len(scan), judged.wall.dtype)
    levels = np.full((len(scan), 2), (judged.floor, judged.ceiling))
    return judged._replace(
        points=np.concatenate([judged.points, *skies]),
        pillar=np.concatenate([judged.pillar, old]),
        wall=np.concatenate([judged.wall, old]),
        apart=np.concatenate([judged.apart, old.astype(judged.apart.dtype)]),
        scan=np.concatenate([judged.scan, scan]),
        levels=None if judged.levels is None else np.concatenate([judged.levels, levels]),
    )


def _sky(one: Looked) -> np.ndarray:
    """(n, 3) [m] a place for each cell of directions, in one of which a scan brings nothing back, and should not.

    A cloud, of which no ray is expected to meet anything, does not tell where nothing should come back. What looks down
    has some ground before it, in the model or not: where nothing comes back from there, it was lost.
    """
    rays = one.rays
    if np.isinf(one.expected).all():
        return np.zeros((0, 3))
    nothing = np.isinf(rays.distance) & (np.isinf(one.expected) | (one.expected > rays.limit))
    none = np.flatnonzero(nothing & (rays.direction[:, 2] > 0.0))
    if not len(none):
        return np.zeros((0, 3))
    chosen = none[np.unique(cells_of(rays.direction[none], SKY)[0], return_index=True)[1]]
    farthest = float(rays.distance[: rays.measured].max()) + 1.0
    return rays.position + rays.direction[chosen].astype(np.float64) * farthest


def fused(visits: Visits, probability: np.ndarray) -> np.ndarray:
    """What all scans together say of each point.

    In a voxel that V scans have points in, it is the sum of their log odds over the root of V: scans that agree are
    surer than each, yet not as sure as strangers would be, for they share the networks, and with those the errors. The
    sum alone would be right of scans from far apart, their mean of scans from one place. Of what is known before any
    scan nothing is taken off: the share of points that change would make two doubts a certainty, as networks do not
    start from it.

    The point nearest to its sensor has what all say, and the others of the voxel have 0: how sure an object is goes by
    how many places speak for it, and none may speak twice. They are kept, since their rays still tell where nothing is.

    Args:
        visits: the points, in any order.
        probability: (N, K) that they changed, by their own scan alone.

    Returns:
        (N, K) of the same dtype; where only one scan was, it is `probability` to the bit.

    Raises:
        ValueError: the shapes disagree.
    """
    points, scan, reach = (np.asarray(field) for field in visits)
    probability, count = np.asarray(probability), len(points)
    if points.shape != (count, 3) or scan.shape != (count,) or reach.shape != (count,) or len(probability) != count:
        shapes = f"{points.shape}, {scan.shape}, {reach.shape}, {probability.shape}"
        raise ValueError(f"points, scan, reach and probability must be (N, 3), (N,), (N,), (N, K), got {shapes}")
    found = probability.copy()
    if not count or (scan == scan[0]).all():
        return found
    place = place_of(points.astype(np.float64))
    visit = place * (scan.max() + 1) + scan
    several = np.bincount(place[np.unique(visit, return_index=True)[1]]) > 1
    rows = np.flatnonzero(several[place])
    # Sums and choices must not depend on the order of points or of scans.
    rows = rows[np.lexsort((*points[rows].T, reach[rows], place[rows]))]
    found[rows] = 0.0
    _, speaker = np.unique(place[rows], return_index=True)
    for kind in range(probability.shape[1]):
        found[rows[speaker], kind] = _pooled(place[rows], visit[rows], probability[rows, kind])
    return found


def place_of(points: np.ndarray) -> np.ndarray:
    """(N,) int: number of the voxel of each point, centred on multiples of its edge as where scans are thinned."""
    cell = np.floor(points / VOXEL + 0.5).astype(np.int64)
    x, y, z = (cell - cell.min(axis=0)).T
    return np.unique((x * (y.max() + 1) + y) * (z.max() + 1) + z, return_inverse=True)[1]


def _pooled(place: np.ndarray, visit: np.ndarray, probability: np.ndarray) -> np.ndarray:
    """By all visits of each place, in the order of the places; points (n,) of one visit speak as their mean."""
    _, first, visit = np.unique(visit, return_index=True, return_inverse=True)
    logit = _logit(np.bincount(visit, probability) / np.bincount(visit))
    _, place = np.unique(place[first], return_inverse=True)
    order = np.lexsort((logit, place))
    total = np.bincount(place[order], logit[order]) / np.sqrt(np.bincount(place))
    return 1.0 / (1.0 + np.exp(-total))


def _logit(probability: np.ndarray) -> np.ndarray:
    with np.errstate(divide="ignore"):
        logit = np.log(probability) - np.log1p(-probability)
    return np.clip(logit, -MOST_SURE, MOST_SURE)
