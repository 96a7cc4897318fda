"""Far and slender elements, which few of the drawn rays meet: all of a scan's own rays toward them, and directions.

A scan has more points than rays are drawn, and a pattern coarser than itself. Both are even over the whole view, so
that a column 50 m away lies between them though dozens of the scan's rays end on it. E elements, M directions, P rays.
Positions are offsets from the prior's origin, world axes: metres, z up.
"""

import numpy as np

from jaxmm.rays.scan_rays import NEAREST, PosedScan, ScanRays
from jaxmm.vectors import lengths
from jaxmm.verdicts.priors import Prior
from warp_scanner.clouds.sightlines import cells_of
from warp_scanner.scenes.building import faces_by_element
from warp_scanner.sensors.scan import Rays
from warp_scanner.sensors.triangles import cast_triangles

RARELY = 20  # directions of the pattern, or rays that are drawn, that meet an element: with fewer it is asked for
LEAST_MET = 8  # directions that an element is as wide as, at least; narrower ones too few rays meet in any case
MOST_MET = 2000  # directions toward one element: what is wider gets no more
MOST_ADDED = 150_000  # directions toward all of them, the nearest first
COARSER = 1.5  # times as far apart as the scan's own rays: from there on a pattern, or a draw, leaves something out
BESIDE = 4.0  # times as wide as rays are apart, cells of which all are taken: few beside a direction are outside
WIDE = np.radians(2.0)  # of cells, in which the solid angle that a scan covers is measured
AT_ONCE = 1_000_000  # points of a file


def toward_far_elements(prior: Prior, scan: PosedScan, rays: ScanRays, whole: PosedScan | None = None) -> ScanRays:
    """The rays of a scan, with all of its own toward elements that these, or their pattern, meet rarely.

    Elements that the scan cannot meet, because other ones stand before them or they are out of view, get none.

    Args:
        prior: a building; of a cloud the rays come back as they are.
        scan: where it lies, of all its points, or of those that were drawn for its ranges to settle.
        rays: of it, from `rays_of_scan`.
        whole: then the same scan with all points, as its sensor measured them, wherever it was believed to be.
    """
    if not prior.has_elements or not rays.measured:
        return rays
    whole = scan if whole is None else whole
    spacing = spacing_of(rays, len(whole.points))
    every = len(whole.points) / rays.measured
    coarse = _between(rays.pattern, len(rays.pattern))
    if every <= COARSER and coarse <= COARSER * spacing:
        return rays
    met = cast_triangles(prior.scene, Rays(rays.position[None], rays.pattern))
    near = met.distance[0] <= rays.limit
    times = np.bincount(met.element[0][near & (met.element[0] >= 0)], minlength=len(prior.scene.triangles.semantic))
    rare = np.flatnonzero(times * min(1.0, rays.measured / len(rays.pattern)) < RARELY)
    if not len(rare):
        return rays
    drawn = cast_triangles(prior.scene, Rays(rays.position[None], rays.direction[: rays.measured]))
    within = (drawn.element[0] >= 0) & (drawn.distance[0] <= rays.limit)
    times += np.bincount(drawn.element[0][within], minlength=len(times))
    direction, element = _toward(prior, rays.position, (rare, times[rare] > 0), spacing)
    if not len(direction):
        return rays
    found = cast_triangles(prior.scene, Rays(rays.position[None], direction))
    reached = (found.element[0] == element) & (found.distance[0] <= rays.limit)
    direction = direction[reached]
    # Out of the sensor's view there is no direction of its pattern near.
    direction = direction[_shares_cell(direction, rays.pattern, COARSER * max(coarse, spacing))]
    turn = scan.rotation @ whole.rotation.T
    return _with_own((whole, turn), rays, direction, spacing) if len(direction) else rays


def spacing_of(rays: ScanRays, points: int) -> float:
    """How far apart [rad] the rays of a scan of so many points are, as if they lay in squares."""
    return _between(rays.direction[: rays.measured], points)


def _between(direction: np.ndarray, count: int) -> float:
    """How far apart [rad] `count` rays are that lie where directions (M, 3) do."""
    covered = len(np.unique(cells_of(direction, WIDE)[0])) * WIDE**2
    return float(np.sqrt(covered / count))


def _toward(
    prior: Prior, position: np.ndarray, asked: tuple[np.ndarray, np.ndarray], spacing: float
) -> tuple[np.ndarray, np.ndarray]:
    """Unit vectors (M, 3) float32 over the view of some elements, and the element (M,) of each.

    `asked` are their rows (n,) int, and whether each is surely in sight (n,) bool: these come first, for of a large
    model the near ones that are hidden would alone be too many.
    """
    triangles, (rows, in_sight) = prior.scene.triangles, asked
    order, starts = faces_by_element(triangles)
    views = []
    for row, is_first in zip(rows, in_sight, strict=True):
        faces = order[starts[row] : starts[row + 1]]
        if not len(faces):
            continue
        offset = triangles.vertices[np.unique(triangles.faces[faces])].astype(np.float64) - position
        views.append((not is_first, float(lengths(offset).min()), int(row), offset))
    found, element, count = [np.zeros((0, 3), np.float32)], [np.zeros(0, int)], 0
    for _, _, row, offset in sorted(views, key=lambda view: view[:3]):
        own = _grid(offset, spacing)
        count += len(own)
        if count > MOST_ADDED:
            break
        found.append(own)
        element.append(np.full(len(own), row))
    return np.concatenate(found), np.concatenate(element)


def _grid(offset: np.ndarray, spacing: float) -> np.ndarray:
    """Unit vectors (M, 3) float32 over the azimuths and elevations of corners (n, 3) [m] from the sensor; few: none."""
    middle = offset.mean(axis=0)
    turn = np.arctan2(middle[1], middle[0])
    azimuth = (np.arctan2(offset[:, 1], offset[:, 0]) - turn + np.pi) % (2.0 * np.pi) - np.pi
    elevation = np.arctan2(offset[:, 2], np.hypot(offset[:, 0], offset[:, 1]))
    wide = np.ptp(azimuth) * np.cos(np.abs(elevation).min())
    size = np.array([wide, np.ptp(elevation)]) / spacing
    if size.prod() < LEAST_MET or np.ptp(azimuth) > np.pi:  # around the sensor nothing is far
        return np.zeros((0, 3), np.float32)
    columns, lines = np.maximum(1, np.round(size / max(1.0, np.sqrt(size.prod() / MOST_MET)))).astype(int)
    at = [
        low + (np.arange(count) + 0.5) / count * span
        for low, count, span in (
            (turn + azimuth.min(), columns, np.ptp(azimuth)), (elevation.min(), lines, np.ptp(elevation)),
        )
    ]  # fmt: skip
    around, up = (one.ravel() for one in np.meshgrid(*at))
    level = np.cos(up)
    return np.stack([level * np.cos(around), level * np.sin(around), np.sin(up)], axis=1).astype(np.float32)


def _shares_cell(direction: np.ndarray, others: np.ndarray, cell: float) -> np.ndarray:
    """(M,) bool: directions in whose cell one of the others lies."""
    return np.isin(cells_of(direction, cell)[0], np.unique(cells_of(others, cell)[0]))


def _with_own(whole: tuple[PosedScan, np.ndarray], rays: ScanRays, direction: np.ndarray, spacing: float) -> ScanRays:
    """The rays with all points in the cells of some directions (M, 3), in place of those drawn there.

    They are those of a scan, which a turn (3, 3) takes to where the rays lie.
    """
    (scan, turn), cell = whole, BESIDE * spacing
    own = [np.zeros((0, 3))]
    for start in range(0, len(scan.points), AT_ONCE):
        offset = (scan.points[start : start + AT_ONCE].astype(np.float64) - scan.position) @ turn.T
        reach = lengths(offset)
        there = (reach > NEAREST) & (reach < np.inf)
        offset = offset[there]
        unit = offset / reach[there, None]
        own.append(offset[_shares_cell(unit, direction, cell)])
    offset = np.concatenate(own)
    reach = lengths(offset)
    drawn = slice(rays.measured)
    kept = np.flatnonzero(~_shares_cell(rays.direction[drawn], direction, cell))
    parts = (kept, slice(rays.measured, None))
    return rays._replace(
        direction=np.concatenate([
            rays.direction[parts[0]], (offset / reach[:, None]).astype(np.float32), rays.direction[parts[1]],
        ]),
        distance=np.concatenate([rays.distance[parts[0]], reach.astype(np.float32), rays.distance[parts[1]]]),
        measured=len(kept) + len(reach),
        pattern=np.concatenate([rays.pattern, direction]),
        fine=len(direction),
        fine_spacing=spacing,
    )  # fmt: skip
