"""A scan file's points as rays: what was measured along which direction, and where nothing came back.

N points of a file, P rays, Q directions of a regular pattern. Positions are offsets from the prior's origin, world
axes: metres, z up.
"""

import functools
from typing import NamedTuple

import numpy as np

from jaxmm.rays.evidence import Frame, frame_of
from jaxmm.rays.near_rays import rays_around
from jaxmm.vectors import lengths
from warp_scanner.clouds.sightlines import cells_of
from warp_scanner.sensors.sensors import Sensor

MOST_RAYS = 300_000  # of a scan that has more, so many are drawn: five times what networks learnt from
MOST_PATTERN = 150_000
LEAST_SPACING = np.radians(0.3)  # of a pattern: a voxel of 0.1 m is as wide at 19 m
HOLE = 1.5  # spacings: a cell this large without a measured ray is a hole
AROUND, UNEVEN = 20, 1.5  # rays that tell how far apart they are about a place; so many spacings apart, it is uneven
STRIP = np.radians(1.0)  # of elevations, or azimuths, along which gaps between rays are measured
FAR, FIRST_CELL = np.radians(15.0), 0.02  # from the edge of all rays on, holes may be far; cells to tell that by
WIDEST_GAP = np.radians(4.0)  # between the rings of a spinning sensor; wider ones are holes
RINGED = 1.5  # times as far apart as along them, rays lie in rings
FARTHER, BEHIND = 1.1, 0.1  # times, and [m] more than another ray: well behind it, and no floor
NEAREST = 0.05  # [m] points closer to the sensor are its own housing


class PosedScan(NamedTuple):
    """One robot scan, and where it is believed to be taken from."""

    points: np.ndarray  # (N, 3) float32 [m]
    position: np.ndarray  # (3,) float64 [m]
    rotation: np.ndarray  # (3, 3) float64 sensor frame to world
    sensor: Sensor | None = None  # None: any; its view is then what its points span, and rays that are known without
    unseen: np.ndarray | None = None  # (K, 3) float32 unit vectors of those, in the sensor's frame; None: nobody knows


class ScanRays(NamedTuple):
    """One robot scan as rays from one place: those that were measured, then those of the pattern without a return."""

    position: np.ndarray  # (3,) float64 [m]
    direction: np.ndarray  # (P, 3) float32 unit vectors
    distance: np.ndarray  # (P,) float32 [m], inf = nothing came back
    measured: int  # of P
    pattern: np.ndarray  # (Q, 3) float32 unit vectors: a regular grid over the field of view
    spacing: float  # [rad] of the sensor's rays where they are farthest apart, at least that of the pattern
    limit: float  # [m] beyond which the sensor sees nothing
    fine: int = 0  # how many of the pattern, its last, are as near to each other as the scan's own rays
    fine_spacing: float = 0.0  # [rad] of those


def rays_of_scan(scan: PosedScan, seed: int = 0, *, holes: bool = True) -> ScanRays:
    """The rays of a scan.

    Args:
        scan: from where, and what.
        seed: of the draw, where there are more points than rays are needed.
        holes: whether rays without a return are found, too; to lay a scan on something nobody needs them.

    Raises:
        ValueError: no point is farther than 0.05 m from the sensor.
    """
    offset = drawn(scan.points, scan.position, seed) - scan.position
    if not len(offset):
        raise ValueError(f"no point is farther than {NEAREST} m from the sensor")
    reach = lengths(offset)
    direction, reach = (offset / reach[:, None]).astype(np.float32), reach.astype(np.float32)
    measured, unseen = len(direction), None
    if scan.sensor is None and scan.unseen is not None and len(scan.unseen):
        unseen = (scan.unseen @ scan.rotation.T).astype(np.float32)
    pattern, spacing = _pattern(scan, direction if unseen is None else np.concatenate([direction, unseen]))
    if holes:
        nothing = pattern[_empty(pattern, direction, HOLE * spacing)]
        if unseen is None:
            nothing = _wide(nothing, direction, spacing)
        else:
            nothing = nothing[~_empty(nothing, unseen, HOLE * spacing)]
        direction = np.concatenate([direction, nothing])
        reach = np.concatenate([reach, np.full(len(nothing), np.inf, np.float32)])
    return ScanRays(
        scan.position,
        direction,
        reach,
        measured,
        pattern,
        spacing,
        float(scan.sensor.range_limits[1]) if scan.sensor is not None else np.inf,
    )


def drawn(points: np.ndarray, position: np.ndarray, seed: int = 0) -> np.ndarray:
    """(K <= MOST_RAYS, 3) float64 [m]: of points (N, 3) as many as rays are needed, none of the sensor's housing."""
    points = even_draw(points, seed).astype(np.float64)
    reach = lengths(points - position)
    return points.take(np.flatnonzero((reach > NEAREST) & (reach < np.inf)), axis=0)


def even_draw(points: np.ndarray, seed: int = 0) -> np.ndarray:
    """(K <= MOST_RAYS, 3): of points (N, 3) as many as rays are needed, of the sensor's housing as well."""
    if len(points) <= MOST_RAYS:
        return points
    return points.take(_even_rows(len(points), seed), axis=0)


@functools.lru_cache(1)  # a scan is drawn from again and again
def _even_rows(count: int, seed: int) -> np.ndarray:
    part = np.arange(MOST_RAYS + 1) * count // MOST_RAYS  # one of each part of the file: evenly, none twice
    return part[:-1] + np.random.default_rng(seed).integers(0, np.diff(part))


def overtaken(points: np.ndarray, position: np.ndarray) -> float:
    """Share of points (N, 3) [m] of a scan that lie well behind another one of about the same direction; 0 of none.

    From where a scan was taken, that happens at the edges of things: of whole scans in two points of a hundred, with
    ranges that err in eight, and in as many and more where files keep one point a voxel. Two points have about the
    same direction where they share a cell so large that two would lie in each.
    """
    offset = drawn(points, position) - position
    if not len(offset):
        return 0.0
    reach = lengths(offset)
    direction = (offset / reach[:, None]).astype(np.float32)
    wide = np.radians(2.0)
    covered = len(np.unique(cells_of(direction, wide)[0])) * wide**2
    cell = np.unique(cells_of(direction, float(np.sqrt(2.0 * covered / len(direction))))[0], return_inverse=True)[1]
    nearest = np.full(len(reach), np.inf)
    np.minimum.at(nearest, cell, reach)
    return float(np.mean(reach > FARTHER * nearest[cell] + BEHIND))


def measured_points(rays: ScanRays) -> np.ndarray:
    """(K, 3) float32 [m] of the rays that came back, in their order."""
    back = slice(rays.measured)
    return (rays.position + rays.direction[back] * rays.distance[back, None].astype(np.float64)).astype(np.float32)


def frame_of_rays(rays: ScanRays, floor: float, ceiling: float) -> Frame:
    """What heights are judged against."""
    return frame_of(rays.position, rays.pattern.astype(np.float64), floor, ceiling)


def _pattern(scan: PosedScan, direction: np.ndarray) -> tuple[np.ndarray, float]:
    """Directions (Q, 3) over the sensor's view, in the world, and how far apart [rad] its rays are."""
    if scan.sensor is not None:
        rows, columns = scan.sensor.shape
        most = max(1.0, np.sqrt(rows * columns / MOST_PATTERN * 2.0))
        sensor = scan.sensor
        if most > 1.0:
            sensor = sensor.resampled(max(1, round(columns / most)), max(1, round(rows / most)))
        spacing = max(np.radians(max(sensor.spacing)), LEAST_SPACING)
        return (sensor.directions() @ scan.rotation.T).astype(np.float32), float(spacing)
    outline = frame_of(np.zeros(3), direction.astype(np.float64), 0.0, 1.0)
    spacing = LEAST_SPACING
    while len(inside := _within(outline, spacing)) > MOST_PATTERN:
        spacing *= 1.25
    return inside, float(max(spacing, _between_rings(direction)))


def _between_rings(direction: np.ndarray) -> float:
    """How far apart [rad] the rings are that rays (P, 3) of a spinning sensor lie in; 0 where they lie in none.

    What lies between two rings is no hole in the scan: no ray was ever sent there. Half of what a strip of azimuths
    spans lies in gaps at least this wide; along the rings rays lie far closer.
    """
    azimuth = np.arctan2(direction[:, 1], direction[:, 0]).astype(np.float64)
    elevation = np.arcsin(np.clip(direction[:, 2], -1.0, 1.0)).astype(np.float64)
    across = _usual_gap(azimuth, elevation, np.ones(len(direction)))
    along = _usual_gap(elevation, azimuth, np.cos(elevation))
    return across if across > max(LEAST_SPACING, RINGED * along) else 0.0


def _usual_gap(strip: np.ndarray, place: np.ndarray, scale: np.ndarray) -> float:
    """Gap [rad] between neighbours along their strips: half of what they span is in gaps as wide or wider; else 0."""
    number = np.floor(strip / STRIP).astype(np.int64)
    order = np.argsort(number * 2.0 * np.pi + place)  # places span no more than a turn
    gap = np.diff(place[order]) * scale[order][1:]
    gap = np.sort(gap[(np.diff(number[order]) == 0) & (gap <= WIDEST_GAP)])
    return float(gap[np.searchsorted(np.cumsum(gap), gap.sum() / 2)]) if gap.sum() > 0.0 else 0.0


def _within(outline: Frame, spacing: float) -> np.ndarray:
    """Unit vectors (Q, 3) of a grid of azimuths and elevations between an outline's lowest and highest."""
    count = len(outline.top)
    turns = np.arange(-np.pi, np.pi, spacing) + spacing / 2
    cell = np.minimum(((turns + np.pi) / (2 * np.pi) * count).astype(int), count - 1)
    low, high = np.arctan(outline.bottom[cell]), np.arctan(outline.top[cell])
    elevations = np.arange(-np.pi / 2, np.pi / 2, spacing) + spacing / 2
    turn, elevation = np.meshgrid(turns, elevations)
    with np.errstate(invalid="ignore"):  # cells without a ray
        inside = (elevation >= low - spacing / 2) & (elevation <= high + spacing / 2)
    # Towards the poles columns crowd: every so many are as dense as elsewhere.
    every = np.maximum(1, np.round(1.0 / np.maximum(np.cos(elevation), 0.02))).astype(int)
    inside &= np.arange(len(turns))[None] % every == 0
    turn, elevation = turn[inside], elevation[inside]
    level = np.cos(elevation)
    return np.stack([level * np.cos(turn), level * np.sin(turn), np.sin(elevation)], axis=-1).astype(np.float32)


def _empty(wanted: np.ndarray, known: np.ndarray, cell: float) -> np.ndarray:
    """(Q,) bool: directions in whose cell no known one lies."""
    there = np.unique(cells_of(known, cell)[0])
    return ~np.isin(cells_of(wanted, cell)[0], there)


def _wide(holes: np.ndarray, known: np.ndarray, spacing: float) -> np.ndarray:
    """Those of the holes (Q, 3) that are wider than the rays (P, 3) around them are apart.

    Files keep one point a voxel, or a part of the points drawn at random: then rays are farther apart in one place than
    in another, mostly on what is near, and what lies between two of them is no hole.
    """
    if not len(holes) or len(known) < AROUND:
        return holes
    wide = _surely_wide(holes, known)
    if not wide.all():
        wide[~wide] = _are_wide(holes[~wide], known, spacing)
    return holes[wide]


def _are_wide(holes: np.ndarray, known: np.ndarray, spacing: float) -> np.ndarray:
    """(Q,) bool, by the ray that is nearest to each of them."""
    nearest, square = rays_around(known, holes, 1)
    beside, which = np.unique(nearest[:, 0], return_inverse=True)
    around = rays_around(known, known[beside], AROUND)[1]
    # A square grid of as many rays in as large a circle.
    apart = np.sqrt(around * np.pi / AROUND)[which.reshape(-1)]
    return (apart <= UNEVEN * spacing) | (np.sqrt(square) > HOLE * apart)


def _surely_wide(holes: np.ndarray, known: np.ndarray) -> np.ndarray:
    """(Q,) bool: holes that are farther from all rays (P, 3) than any of these can be from those around it.

    As of a camera whose yaw is given the wrong way round: across a sphere nearly all rays are as near as the nearest,
    and a tree finds that in milliseconds each.
    """
    middle = known.mean(axis=0, dtype=np.float64)
    middle /= max(float(np.linalg.norm(middle)), 1e-9)
    widest = np.arccos(np.clip(known @ middle, -1.0, 1.0).min())
    beyond = np.clip(np.arccos(np.clip(holes @ middle, -1.0, 1.0)) - widest, 0.0, None)
    if not (beyond > FAR).any():
        return np.zeros(len(holes), bool)
    cell, few = FIRST_CELL, np.ones(len(known), bool)
    while cell < 4.0 and few.any():  # those that share a cell with enough others are no farther from them than it spans
        key = np.floor(known / cell).astype(np.int64) @ np.array([1 << 40, 1 << 20, 1])
        _, own, count = np.unique(key, return_inverse=True, return_counts=True)
        few, cell = few & (count[own] < AROUND), 2.0 * cell
    most = min(2.0, np.sqrt(3.0) * cell / 2.0)
    return 2.0 * np.sin(beyond / 2.0) > 1.001 * HOLE * most * np.sqrt(np.pi / AROUND)
