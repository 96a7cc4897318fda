"""A scan that looks all around as a panorama of ranges, and how it lies on those of a building at every heading.

N points of a scan in its sensor's frame (z about up), C places, A azimuths by E elevations of a panorama; metres.
"""

from typing import NamedTuple

import numpy as np
import small_gicp
from scipy.spatial import cKDTree

from jaxmm.inputs import Misfit
from jaxmm.vectors import lengths
from warp_scanner.sensors.scan import Rays
from warp_scanner.sensors.triangles import TriangleScene, cast_triangles

LEAST_SPAN = 150.0  # [deg] of azimuth that a scan must look around by
AZIMUTHS, MOST_ELEVATIONS = 72, 10
STEEPEST = np.radians(45.0)  # elevations beyond it see floor and ceiling alone
OUTERMOST = (0.02, 0.98)  # quantiles of the elevations that the rows lie between
BESIDE, RAYS_A_CELL = np.radians(1.5), 5  # from a cell's direction, and rays there whose median range counts
LEAST_CELLS = 0.2  # share of the panorama with a return
OFF, OFF_PER_METRE = 0.4, 0.06  # [m] and share of the range, by which a place and heading of the grid may be off
THROUGH = 1.0
TOGETHER = 48  # places whose panoramas are compared at once: what fits into the fast memory
CELLS_AT_ONCE = 4_000_000  # rays of one cast

SPACING, NEIGHBOURS = 0.1, 15  # [m] of the points that tell what is level, and how many around each tell its normal
MOST_TILT, LEVEL = np.radians(12.0), np.radians(6.0)  # of the sensor, and of a level surface once it is upright
LEAST_LEVEL = 100  # points on level surfaces that tell what is up, and on a floor that tell the height
LOWEST, HIGHEST = 0.2, 3.5  # [m] of a sensor above the floor
BIN = 0.05  # [m]
AS_MUCH = 0.3  # share of the points of the most seen level below, with which a lower one may be the floor
UNKNOWN_HEIGHTS = (0.4, 0.8, 1.2, 1.6, 2.0)  # [m] that are tried where no floor is in view


class Upright(NamedTuple):
    """How a sensor stood."""

    rotation: np.ndarray  # (3, 3) float64 sensor frame to one with z up, without a turn about it
    heights: tuple[float, ...]  # [m] that it may have above its floor
    floor_seen: bool  # whether the scan tells them


class Panorama(NamedTuple):
    """Ranges of a scan on a grid of directions, in the upright frame."""

    elevation: np.ndarray  # (E,) float64 [rad]
    distance: np.ndarray  # (A, E) float32 [m]; NaN where nothing came back

    @property
    def directions(self) -> np.ndarray:
        """Unit vectors (A * E, 3) float32, azimuth by azimuth, counter-clockwise from +x."""
        return _directions(self.elevation)


def span_of_azimuth(points: np.ndarray) -> float:
    """How far around [deg] points (N, 3) about the sensor reach: all but the widest gap."""
    azimuth = np.sort(np.degrees(np.arctan2(points[:, 1], points[:, 0])))
    if len(azimuth) < 2:
        return 0.0
    gap = max(float(np.diff(azimuth).max()), float(azimuth[0] + 360.0 - azimuth[-1]))
    return 360.0 - gap


def upright_of(points: np.ndarray) -> Upright:
    """What of the points (N, 3) is level tells what is up, and the lowest of it the height of the sensor."""
    cloud, _ = small_gicp.preprocess_points(
        points.astype(np.float64), downsampling_resolution=SPACING, num_neighbors=NEIGHBOURS
    )
    places, normals = cloud.points()[:, :3], cloud.normals()[:, :3]
    normals = normals * np.where(normals[:, 2:] < 0.0, -1.0, 1.0)
    up, within = np.array([0.0, 0.0, 1.0]), MOST_TILT
    for _ in range(3):
        level = normals @ up > np.cos(within)
        if level.sum() < LEAST_LEVEL:
            return Upright(np.eye(3), UNKNOWN_HEIGHTS, False)
        up = np.median(normals[level], axis=0)
        up, within = up / np.linalg.norm(up), max(within / 2, LEVEL)
    rotation = _turn_to_z(up)
    heights = _heights(-(places[normals @ up > np.cos(LEVEL)] @ rotation.T)[:, 2])
    return Upright(rotation, heights or UNKNOWN_HEIGHTS, bool(heights))


def _heights(below: np.ndarray) -> tuple[float, ...]:
    """[m] that level points lie below the sensor: the most seen, and the lowest one that is seen nearly as much."""
    below = below[(below > LOWEST) & (below < HIGHEST)]
    count = np.histogram(below, np.arange(LOWEST, HIGHEST + 2 * BIN, BIN))[0]
    count = count[:-1] + count[1:]
    if count.max() < LEAST_LEVEL:
        return ()
    # The lowest level that is seen nearly as much, at its own peak.
    deepest = int(np.flatnonzero(count >= max(LEAST_LEVEL, AS_MUCH * count.max()))[-1])
    around = np.arange(max(0, deepest - 3), deepest + 1)
    found: list[float] = []
    for one in sorted({int(count.argmax()), int(around[count[around].argmax()])}):
        height = float(np.median(below[np.abs(below - (LOWEST + BIN * (one + 1))) <= BIN]))
        if not found or height - found[-1] > 2 * BIN:
            found.append(height)
    return tuple(found)


def _turn_to_z(up: np.ndarray) -> np.ndarray:
    """The least rotation (3, 3) that takes a unit vector near z to z."""
    x, y, z = up
    along = 1.0 / (1.0 + z)
    return np.array([[1.0 - x * x * along, -x * y * along, -x], [-x * y * along, 1.0 - y * y * along, -y], [x, y, z]])


def panorama_of(points: np.ndarray) -> Panorama:
    """The panorama of points (N, 3) [m] about the sensor, in the upright frame.

    Raises:
        Misfit: too little of it shows anything.
    """
    reach = lengths(points)
    direction = points / reach[:, None]
    elevation = np.arcsin(np.clip(direction[:, 2], -1.0, 1.0))
    low, high = np.clip(np.quantile(elevation, OUTERMOST), -STEEPEST, STEEPEST)
    rows = int(np.clip(np.ceil((high - low) / (2.0 * np.pi / AZIMUTHS)), 1, MOST_ELEVATIONS))
    rows = low + (high - low) * (np.arange(rows) + 0.5) / rows
    apart, ray = cKDTree(direction).query(_directions(rows), k=RAYS_A_CELL, distance_upper_bound=BESIDE)
    ranges = np.append(reach, np.nan)[ray]
    seen = np.isfinite(apart).any(axis=1)
    middle = np.full(len(ranges), np.nan)
    middle[seen] = np.nanmedian(ranges[seen], axis=1)
    if seen.mean() < LEAST_CELLS:
        raise Misfit(f"only {seen.mean():.0%} of what it looks at came back; expected at least {LEAST_CELLS:.0%}")
    return Panorama(rows, middle.reshape(AZIMUTHS, len(rows)).astype(np.float32))


def fits_of(scene: TriangleScene, places: np.ndarray, panorama: Panorama) -> np.ndarray:
    """(C, A) float32: how well a scan fits at each place (C, 3), turned by each azimuth; 1 where all ranges agree.

    Ranges that are off by more than a place and a heading of the grid can be count as none. Those of furniture end
    before a surface; what ends beyond one speaks against it more.
    """
    directions = panorama.directions
    at_once = max(1, CELLS_AT_ONCE // len(directions))
    seen = np.isfinite(panorama.distance)
    own, weight = np.where(seen, _stretched(panorama.distance), 0.0), seen / seen.sum()
    twice = [np.concatenate([one, one]).astype(np.float32) for one in (own, weight)]
    found = np.empty((len(places), AZIMUTHS), np.float32)
    for first in range(0, len(places), at_once):
        part = slice(first, first + at_once)
        ranges = cast_triangles(scene, Rays(places[part], directions)).distance
        found[part] = _fits(_stretched(ranges), twice)
    return found


def _fits(expected: np.ndarray, twice: list[np.ndarray]) -> np.ndarray:
    """(C, A) of expected stretched ranges (C, A * E), against those of the scan and their weights (2 A, E)."""
    found = np.empty((len(expected), AZIMUTHS), np.float32)
    for first in range(0, len(expected), TOGETHER):
        part = expected[first : first + TOGETHER]
        off = np.empty_like(part)
        for turn in range(AZIMUTHS):
            # Turned counter-clockwise by `turn` cells, the scan's cell 0 lies at the building's cell `turn`.
            own, weight = (one[AZIMUTHS - turn : 2 * AZIMUTHS - turn].ravel() for one in twice)
            np.subtract(own, part, out=off)
            np.clip(off, -1.0, THROUGH, out=off)
            np.abs(off, out=off)
            found[first : first + TOGETHER, turn] = 1.0 - off @ weight
    return found


def _stretched(distance: np.ndarray) -> np.ndarray:
    """Ranges on a scale where 1 is how far they may be off; what nothing comes back from is beyond all."""
    return np.log1p(np.minimum(distance, 1e6) * (OFF_PER_METRE / OFF)) / OFF_PER_METRE


def _directions(elevation: np.ndarray) -> np.ndarray:
    azimuth = 2.0 * np.pi * np.arange(AZIMUTHS) / AZIMUTHS
    azimuth, elevation = (grid.ravel() for grid in np.meshgrid(azimuth, elevation, indexing="ij"))
    level = np.cos(elevation)
    return np.stack([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)], axis=-1).astype(np.float32)
