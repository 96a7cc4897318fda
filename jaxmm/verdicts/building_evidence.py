"""Joins scanner and evidence where the prior is a building: what a robot scan's rays say of its elements.

N points of one side, P rays, E elements, S storeys. Positions are offsets from the building's origin, world axes:
metres, z up.
"""

from typing import NamedTuple

import numpy as np

from jaxmm.rays.evidence import Frame, View, margins
from jaxmm.rays.hits import Hits, hits_of
from jaxmm.rays.noise_model import Noise, sigma_at
from jaxmm.rays.pair_evidence import FOOTPRINT, MOST_ANGLE
from jaxmm.rays.scan_rays import PosedScan, ScanRays, frame_of_rays, measured_points, rays_of_scan
from jaxmm.rays.shared_ends import shared_ends
from jaxmm.rays.tilted_ends import Met, met_of, tilted_ends
from jaxmm.rays.views import Along, view_of_prior, view_of_robot
from jaxmm.vectors import lengths
from jaxmm.verdicts.floor_levels import levels_at, levels_of
from jaxmm.verdicts.placement import Passed
from jaxmm.verdicts.priors import Prior
from warp_scanner.clouds.neighbours import nearest
from warp_scanner.clouds.sightlines import Predicted, Targets, cells_of, look, sort_directions
from warp_scanner.clouds.voxels import thin_clouds
from warp_scanner.sensors.scan import Rays
from warp_scanner.sensors.triangles import TriangleScene, cast_triangles, clearance

VOXEL = 0.1  # [m]
FILLED = np.radians(0.6)  # between directions along which a prior is known; a scanner's rings may be farther apart
LAYERS = 6  # of surfaces along a ray, those where it leaves something included
BEYOND = 0.005  # [m] behind a surface, from where the next is looked for
PASSES = (0.15, 0.02)  # [m], and of the range: a ray that ends so far behind a surface passes through it
NOBODY = -2  # the element of which a ray tells that should meet one, and tells nothing of it
FARTHEST = 2.0  # [m] beyond which the distance to the prior's surface is not looked for


class Sighting(NamedTuple):
    """Both sides of one scan, as evidence has them."""

    prior: View
    robot: View
    frame: Frame
    expected: Hits  # of the scan's rays
    margin: np.ndarray  # (P,) float32 [m]
    noise: Noise
    shown: np.ndarray  # (Q, 3) float32 [m] where the rays of the pattern meet the prior; NaN: nowhere
    reached: np.ndarray  # (E,) bool: elements that some ray of the pattern meets


class Places(NamedTuple):
    """Where rays meet the prior, K of them."""

    points: np.ndarray  # (K, 3) float32 [m]
    reach: np.ndarray  # (K,) float32 [m] from the sensor
    element: np.ndarray  # (K,) int32
    spacing: np.ndarray  # (K,) [rad] how far apart rays are around


def passes(distance: np.ndarray, expected: np.ndarray) -> np.ndarray:
    """(P,) bool: rays that end clearly behind a surface, of those that end and meet one (P,) [m]; false for inf."""
    return distance > expected + PASSES[0] + PASSES[1] * distance


def passed_by(scene: TriangleScene, rays: ScanRays) -> Passed:
    """How many of a scan's rays pass through a building, and how many through none of it."""
    direction, distance = rays.direction[: rays.measured], rays.distance[: rays.measured]
    expected = cast_triangles(scene, Rays(rays.position[None], direction)).distance[0]
    through = passes(distance, expected)
    return Passed(float(through.mean()), float(np.isinf(expected).mean()))


def surfaces_along(scene: TriangleScene, rays: ScanRays) -> np.ndarray:
    """(M, 3) float32 [m] where the rays of the pattern enter elements of the prior, hidden ones too.

    It is what a scan is registered to: were it only what is in sight, a wall that is gone would draw what is seen
    behind it to its place.
    """
    direction, found = _between_rings_too(rays), []
    origin, last = np.tile(rays.position, (len(direction), 1)), np.full(len(direction), -1)
    start = rays.position[None]  # of all rays of the first layer, which are ten times as fast for it
    for _ in range(LAYERS):
        scan = cast_triangles(scene, Rays(start, direction[None]))
        reach, element = scan.distance[0].astype(np.float64), scan.element[0]
        hit = np.isfinite(reach) & (lengths(origin - rays.position) + reach <= rays.limit)
        if not hit.any():
            break
        places = origin[hit] + direction[hit] * reach[hit, None]
        entered = element[hit] != last[hit]  # else it is where the ray leaves what it had entered
        found.append(places[entered].astype(np.float32))
        direction, last = direction[hit], element[hit]
        origin = places + direction * BEYOND
        start = origin[None]
    return np.concatenate(found) if found else np.zeros((0, 3), np.float32)


def surfaces_for(scene: TriangleScene, scan: PosedScan) -> np.ndarray:
    """`surfaces_along` the rays of a scan: what it is laid on."""
    return surfaces_along(scene, rays_of_scan(scan, holes=False))


def _between_rings_too(rays: ScanRays) -> np.ndarray:
    """The pattern (n, 3), and where its rays are far apart the directions above and below each of them, too.

    Were the prior known along a scanner's few rings alone, neither it nor the scan would show how a floor lies on which
    they are a step apart.
    """
    many = int(np.ceil(rays.spacing / FILLED))
    if many <= 1:
        return rays.pattern
    azimuth = np.arctan2(rays.pattern[:, 1], rays.pattern[:, 0])
    elevation = np.arcsin(np.clip(rays.pattern[:, 2], -1.0, 1.0))
    steps = np.arange(-many, many + 1) * (rays.spacing / many)
    up = np.clip(elevation + steps[:, None], -np.pi / 2, np.pi / 2).ravel()
    level, turn = np.cos(up), np.tile(azimuth, len(steps))
    filled = np.stack([level * np.cos(turn), level * np.sin(turn), np.sin(up)], axis=1).astype(np.float32)
    return np.concatenate([rays.pattern, filled[np.unique(cells_of(filled, FILLED)[0], return_index=True)[1]]])


def sight(prior: Prior, rays: ScanRays) -> Sighting:
    """Compare a scan with a building, ray by ray."""
    scene = prior.scene
    expected = hits_of(scene, rays.position, rays.direction)
    met, noise = met_of(rays, expected)
    shown = cast_triangles(scene, Rays(rays.position[None], rays.pattern))
    reach, element = shown.distance[0].copy(), shown.element[0]
    reach[reach > rays.limit] = np.inf
    with np.errstate(invalid="ignore"):
        places = (rays.position + rays.pattern * reach[:, None].astype(np.float64)).astype(np.float32)
    places[np.isinf(reach)] = np.nan
    hit = np.flatnonzero(np.isfinite(reach))
    seen = Places(places[hit], reach[hit], element[hit], _spacing_at(rays, hit))
    seen = _with_all_met(scene, rays, expected, seen)
    reached = np.bincount(seen.element, minlength=len(scene.triangles.semantic)) > 0
    measured = measured_points(rays)
    own = thin_clouds([measured], VOXEL)[0]
    of_prior = _prior_view(prior, rays, (met, noise), seen, measured[own])
    of_robot = _robot_view(scene, rays, (expected, met.margin, noise), (measured[own], own))
    frame = frame_of_rays(rays, *levels_of(scene, rays, measured, prior.building.storeys.elevation))
    return Sighting(
        *(view._replace(levels=levels_at(scene, view.points, frame)) for view in (of_prior, of_robot)),
        frame,
        expected, met.margin, noise, places, reached,
    )  # fmt: skip


def _with_all_met(scene: TriangleScene, rays: ScanRays, expected: Hits, seen: Places) -> Places:
    """Places that the pattern shows, one a voxel, and as well a voxel at least of each element that any ray meets.

    Of what is small the pattern's directions may meet nothing, and next to something else a voxel shows that alone.
    """
    count = len(scene.triangles.semantic)
    met = np.flatnonzero((expected.element >= 0) & (expected.distance <= rays.limit))
    met = met[np.bincount(seen.element, minlength=count)[expected.element[met]] == 0]
    reach = expected.distance[met]
    ends = (rays.position + rays.direction[met] * reach[:, None].astype(np.float64)).astype(np.float32)
    every = Places(
        np.concatenate([seen.points, ends]), np.concatenate([seen.reach, reach]),
        np.concatenate([seen.element, expected.element[met]]),
        np.concatenate([seen.spacing, np.full(len(met), rays.spacing)]),
    )  # fmt: skip
    kept = np.zeros(len(every.reach), bool)
    kept[thin_clouds([seen.points], VOXEL)[0]] = True
    lost = np.flatnonzero(np.bincount(every.element[kept], minlength=count)[every.element] == 0)
    voxel = np.column_stack([every.element[lost], np.floor(every.points[lost] / VOXEL).astype(np.int64)])
    kept[lost[np.unique(voxel, axis=0, return_index=True)[1]]] = True
    return Places(*(field[kept] for field in every))


def _spacing_at(rays: ScanRays, chosen: np.ndarray) -> np.ndarray:
    """How far apart [rad] the rays are around some (n,) int of the directions of the pattern."""
    return np.where(chosen < len(rays.pattern) - rays.fine, rays.spacing, rays.fine_spacing)


def _in_vacant_places(prior: Prior, met: Met) -> np.ndarray:
    """(P,) bool: rays that end where they should, on what stands in the place of an element that does not."""
    if prior.vacant is None:
        return np.zeros(len(met.distance), bool)
    with np.errstate(invalid="ignore"):  # no return where none was expected
        ends = np.abs(met.distance - met.expected) <= met.margin
    return ends & (met.element >= 0) & prior.vacant[met.element]


def _prior_view(
    prior: Prior,
    rays: ScanRays,
    told: tuple[Met, Noise],
    seen: Places,
    robot: np.ndarray,
) -> View:
    """What the robot's rays say of points that the pattern shows of the prior."""
    scene, (met, noise), (points, reach, element, spacing) = prior.scene, told, seen
    direction = ((points - rays.position) / reach[:, None]).astype(np.float32)
    angle = np.clip(FOOTPRINT / reach, 0.75 * spacing, np.maximum(MOST_ANGLE, 0.75 * spacing)).astype(np.float32)
    unused = np.zeros(len(reach), np.float32)
    targets = Targets(direction, reach, angle, unused, unused, element)
    # What ends on another surface where the prior's should be stands before it, if but by a little.
    tilted = tilted_ends(rays.direction, met)
    other = tilted | _in_vacant_places(prior, met)
    distance = np.where(other, met.expected - 2.0 * met.margin, rays.distance).astype(np.float32)
    shared = shared_ends(scene, rays.position, rays.direction, met._replace(distance=distance), rays.limit)
    predicted = Predicted(met.expected[None], np.where(shared, NOBODY, met.element)[None], met.margin[None])
    found = look(sort_directions(rays.direction), distance[None], [targets], predicted)[0]
    cosine = hits_of(scene, rays.position, direction).cosine
    own = margins(cosine, sigma_at(noise, reach))
    apart = nearest([points], [robot])[0].distance.astype(np.float32)
    return view_of_prior(points, element, (found.count, found.residual), own, apart, cosine)


def _robot_view(
    scene: TriangleScene,
    rays: ScanRays,
    told: tuple[Hits, np.ndarray, Noise],
    kept: tuple[np.ndarray, np.ndarray],
) -> View:
    """What the prior says of the robot's points, along their own rays and all around."""
    (expected, margin, noise), (points, own) = told, kept
    fields = (rays.distance, expected.distance, margin, expected.cosine)
    return view_of_robot(points, Along(*(field[own] for field in fields)), clearance(scene, points, FARTHEST), noise)
