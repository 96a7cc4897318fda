"""Where in a building a scan that looks all around was taken, told by nothing but what it sees.

Tried are all free places of the building at all headings, by coarse panoramas. Those that fit best are laid upon the
surfaces that their rays meet, and compared ray by ray. A place is believed only where it fits clearly better than every
other one; else the scan is refused, and the places that look alike are named.

K places, P rays. Positions are offsets from the building's origin: metres, z up.
"""

from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from jaxmm.inputs import Misfit
from jaxmm.rays.scan_rays import drawn, overtaken
from jaxmm.vectors import lengths
from jaxmm.verdicts.panoramas import AZIMUTHS, LEAST_SPAN, fits_of, panorama_of, span_of_azimuth, upright_of
from jaxmm.verdicts.priors import Prior
from warp_scanner.buildings.free_places import free_places
from warp_scanner.clouds.voxels import thin_clouds
from warp_scanner.sensors.scan import Rays
from warp_scanner.sensors.triangles import TriangleScene, cast_faces, face_normals

MOST_BEHIND = 0.15  # share of points behind others, beyond which the scan was not taken from the zero of its frame
FARTHEST = 60.0  # [m] points farther away tell little of a place
VOXEL = 0.1  # [m] points are drawn from a cloud thinned to it, so that what is far away counts, too
ROUGH_RAYS, FINE_RAYS = 400, 3000  # that places are laid by, and compared by in the end
TRIED, COMPARED = 250, 30  # places that are laid roughly, and finely
APART, TURNED = 0.6, 2  # [m], and headings of the grid: what is nearer than that is laid once
REACHES = (0.8, 0.8, 0.6, 0.5, 0.4, 0.3, 0.2, 0.2)  # [m] within which rays are laid on surfaces, step by step
FINE_REACHES = (0.2, 0.15, 0.1, 0.1, 0.1)
STEP = (0.3, 0.3, 0.2, 0.03, 0.03, 0.1)  # [m, rad] standard deviations of one step: what is open moves little
GRAZING = 0.1  # cosine of the incidence, below which a ray tells no distance
UPON, ALONG = 0.08, 0.4  # [m] off the surface, and along the ray, up to which it ends upon what it should
PASSES = (0.15, 0.02)  # [m], and of the range: a ray that ends so far behind a surface passes through it
MOST_GONE, PASSED = 3, 0.8  # elements that may be gone: of their rays that end on or behind them, the share that passes
LEAST_PASSED, GONE = 0.01, 0.02  # share of all rays that tell it, and what each costs, in shares of rays that fit
SAME, SAME_TURN = 0.25, np.radians(4.0)  # [m, rad] one place
# In views of generated buildings with changes and furniture, right places have 0.77 at least, lead by 0.025, and have
# 0.16 against them at most; places that scans of other buildings fit best have 0.68 at most and 0.6 against them.
LEAST_FIT = 0.5  # share of the rays that must end where the building has a surface
MOST_THROUGH = 0.15  # share that may pass through one
CLEARLY = 0.015  # share of the rays by which it must fit better than elsewhere
MOST_AGAINST = 0.25  # of the rays that tell two places apart, the share that may speak for the other
NAMED = 5  # places that look alike


class Place(NamedTuple):
    """Where a scan may have been taken."""

    position: np.ndarray  # (3,) float64 [m]
    rotation: np.ndarray  # (3, 3) float64 sensor frame to world
    fit: float  # share of the rays that end where the building has a surface
    through: float  # share that pass through one
    gone: int  # elements that must be gone for it: nearly all rays pass them

    def named(self, origin: np.ndarray) -> str:
        """X,Y,Z,YAW as --pose takes them."""
        yaw = np.degrees(np.arctan2(self.rotation[1, 0], self.rotation[0, 0]))
        return ",".join([*(f"{value:.2f}" for value in self.position + origin), f"{yaw:.1f}"])


class Searched(NamedTuple):
    """The place of a scan, and how sure that is."""

    place: Place
    tried: int  # places
    elsewhere: float  # greatest `fit` of any other place


class _Poses(NamedTuple):
    position: np.ndarray  # (K, 3) float64
    rotation: np.ndarray  # (K, 3, 3) float64 sensor frame to world

    def at(self, rows: np.ndarray) -> "_Poses":
        return _Poses(self.position[rows], self.rotation[rows])


class _Met(NamedTuple):
    """What the rays of a scan do from some places, (K, P) each."""

    off: np.ndarray  # float64 [m] beyond the plane of the surface met; NaN where nothing tells it
    normal: np.ndarray  # (K, P, 3) float64 unit, toward where the ray goes
    upon: np.ndarray  # bool: it ends upon the surface
    through: np.ndarray  # bool: it ends clearly behind it
    element: np.ndarray  # int32 of the surface, -1


def search(prior: Prior, points: np.ndarray) -> Searched:
    """The place of a scan in a building.

    Args:
        prior: of elements.
        points: (N, 3) [m] in the sensor's frame, z about up.

    Raises:
        Misfit: it looks at too little, fits nowhere, or fits several places about as well, which are named.
    """
    points, scene = _own_points(points), prior.scene
    upright = upright_of(points)
    level = points @ upright.rotation.T
    panorama = panorama_of(level)
    places = free_places(prior.building, scene, upright.heights)
    if not len(places):
        raise Misfit("the building has no floor that a sensor could stand above")
    fits = fits_of(scene, places, panorama)
    poses = _best_of(places, fits, upright.rotation)
    thin = points[thin_clouds([points.astype(np.float32)], VOXEL)[0]]
    rough, fine = (_some(thin, count) for count in (ROUGH_RAYS, FINE_RAYS))
    poses = _laid(scene, poses, rough, REACHES)
    stands = _standing(scene, poses, rough)
    score = _score(_met(scene, poses, rough, stands), stands)
    poses = poses.at(_distinct(poses, score)[:COMPARED])
    stands = _standing(scene, poses, fine)
    poses = _laid(scene, poses, fine, FINE_REACHES, stands)
    stands = _standing(scene, poses, fine)
    met = _met(scene, poses, fine, stands)
    order = _distinct(poses, _score(met, stands))
    met = _Met(*(field[order] for field in met))
    gone = (~stands[order]).sum(axis=1)
    fits, passed = met.upon.mean(axis=1), met.through.mean(axis=1)
    found = [
        Place(poses.position[row], poses.rotation[row], float(fits[one]), float(passed[one]), int(gone[one]))
        for one, row in enumerate(order)
    ]
    return _decided(found, met, len(places), prior.origin)


def _own_points(points: np.ndarray) -> np.ndarray:
    """Those that can be used; Misfit where they are not of one place, or look at too little."""
    zero = np.zeros(3)
    points = drawn(np.asarray(points, np.float64), zero)
    points = points[lengths(points) < FARTHEST]
    span = span_of_azimuth(points)
    if span < LEAST_SPAN:
        raise Misfit(
            f"too narrow to search its pose: it spans {span:.0f} degrees of azimuth about the zero of its frame; "
            f"expected at least {LEAST_SPAN:.0f}, as of a scanner that looks around; give the pose with --pose"
        )
    if (behind := overtaken(points, zero)) > MOST_BEHIND:
        raise Misfit(
            f"its pose cannot be searched: {behind:.0%} of its points lie behind others as seen from the zero of its "
            f"frame; expected at most {MOST_BEHIND:.0%}, as of points in the frame of the sensor"
        )
    return points


def _some(points: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Directions (P, 3) and ranges (P,) of so many points, in the order of their azimuths, which rays are fast in."""
    points = np.random.default_rng(0).permutation(points)[:count]
    points = points[np.argsort(np.arctan2(points[:, 1], points[:, 0]))]
    reach = lengths(points)
    return points / reach[:, None], reach


def _best_of(places: np.ndarray, fits: np.ndarray, upright: np.ndarray) -> _Poses:
    """The places and headings that fit best, each the best one around it."""
    tree, taken = cKDTree(places), np.zeros(fits.shape, bool)
    around = np.arange(-TURNED, TURNED + 1)
    kept: list[tuple[int, int]] = []
    for place, turn in zip(*np.unravel_index(np.argsort(-fits, axis=None), fits.shape), strict=True):
        if taken[place, turn]:
            continue
        kept.append((place, turn))
        if len(kept) == TRIED:
            break
        taken[np.ix_(tree.query_ball_point(places[place], APART), (turn + around) % AZIMUTHS)] = True
    place, turn = np.array(kept).T
    rotation = Rotation.from_euler("z", 2.0 * np.pi * turn[:, None] / AZIMUTHS).as_matrix() @ upright
    return _Poses(places[place], rotation)


def _standing(scene: TriangleScene, poses: _Poses, rays: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """(K, E) bool: the elements without those few that look gone from a place, as nearly all rays pass them."""
    stands = np.ones((len(poses.position), len(scene.triangles.semantic)), bool)
    for _ in range(MOST_GONE):
        met = _met(scene, poses, rays, stands)
        passed, ended = (_count(met.element, which, stands.shape[1]) for which in (met.through, met.upon))
        passed = np.where(passed > PASSED * (passed + ended), passed, 0)
        most = passed.argmax(axis=1)
        gone = passed.max(axis=1) >= LEAST_PASSED * len(rays[1])
        stands[np.flatnonzero(gone), most[gone]] = False
    return stands


def _count(element: np.ndarray, which: np.ndarray, count: int) -> np.ndarray:
    """(K, E) how many of the chosen rays (K, P) bool meet each element; `element` (K, P) int32."""
    row = np.nonzero(which)[0]
    return np.bincount(row * count + element[which], minlength=len(which) * count).reshape(len(which), count)


def _met(
    scene: TriangleScene, poses: _Poses, rays: tuple[np.ndarray, np.ndarray], stands: np.ndarray | None = None
) -> _Met:
    direction, reach = rays
    scan, face = cast_faces(scene, Rays(poses.position, direction, poses.rotation), stands)
    ways = np.einsum("kij,pj->kpi", poses.rotation, direction)
    normal = face_normals(scene.triangles, face).astype(np.float64)
    normal /= np.maximum(np.linalg.norm(normal, axis=2, keepdims=True), 1e-12)
    cosine = np.einsum("kpi,kpi->kp", normal, ways)
    normal, cosine = normal * np.where(cosine < 0.0, -1.0, 1.0)[..., None], np.abs(cosine)
    beyond = reach - scan.distance.astype(np.float64)  # -inf where nothing is met
    with np.errstate(invalid="ignore"):
        off = np.where((cosine > GRAZING) & np.isfinite(beyond), beyond * cosine, np.nan)
        upon = (np.abs(beyond * np.maximum(cosine, GRAZING)) < UPON) & (np.abs(beyond) < ALONG)
    return _Met(off, normal, upon, ~upon & (beyond > PASSES[0] + PASSES[1] * reach), scan.element)


def _laid(
    scene: TriangleScene,
    poses: _Poses,
    rays: tuple[np.ndarray, np.ndarray],
    reaches: tuple[float, ...],
    stands: np.ndarray | None = None,
) -> _Poses:
    """Poses moved so that rays end upon the surfaces that they meet, point to plane (Chen and Medioni 1992).

    Each ray belongs to the surface that it meets first (Blais and Levine 1995); what is off by more than the reach of a
    step counts for nothing in it, and less the farther it is off (Tukey's weights).
    """
    direction, reach = rays
    for within in reaches:
        met = _met(scene, poses, rays, stands)
        share = np.nan_to_num(met.off / within, nan=1.0)
        weight = np.square(np.maximum(1.0 - np.square(share), 0.0))
        off = np.nan_to_num(met.off)
        arm = np.einsum("kij,pj->kpi", poses.rotation, direction * reach[:, None])
        slope = np.concatenate([met.normal, np.cross(arm, met.normal)], axis=2)
        slope = np.nan_to_num(slope)
        told = np.einsum("kpi,kp,kpj->kij", slope, weight, slope)
        wanted = -np.einsum("kpi,kp->ki", slope, weight * off)
        step = np.linalg.solve(told + np.diag((0.1 / np.array(STEP)) ** 2), wanted[..., None])[..., 0]
        turn = Rotation.from_rotvec(step[:, 3:]).as_matrix()
        poses = _Poses(poses.position + step[:, :3], turn @ poses.rotation)
    return poses


def _score(met: _Met, stands: np.ndarray) -> np.ndarray:
    """(K,) share of the rays that end upon surfaces, less what passes through them and what must be gone for it."""
    return met.upon.mean(axis=1) - met.through.mean(axis=1) - GONE * (~stands).sum(axis=1)


def _distinct(poses: _Poses, score: np.ndarray) -> np.ndarray:
    """Rows of different places, the best first."""
    left, kept = np.argsort(-score, kind="stable"), []
    while len(left):
        kept.append(int(left[0]))
        left = left[~_are_same(poses, kept[-1], left)]
    return np.array(kept)


def _are_same(poses: _Poses, one: int, others: np.ndarray) -> np.ndarray:
    """Whether others (n,) are one place with it; each is with itself."""
    cosine = (np.einsum("ij,nij->n", poses.rotation[one], poses.rotation[others]) - 1.0) / 2.0
    apart = lengths(poses.position[others] - poses.position[one])
    return (apart < SAME) & (cosine > np.cos(SAME_TURN))


def _decided(found: list[Place], met: _Met, tried: int, origin: np.ndarray) -> Searched:
    """The first place (K of them, the best first), if it fits, and clearly better than all others; else Misfit."""
    best, named = found[0], [one.named(origin) for one in found]
    if best.fit < LEAST_FIT or best.through > MOST_THROUGH:
        raise Misfit(
            f"its pose was searched and not found: of {tried} places the best is {named[0]}, where {best.fit:.0%} of "
            f"its rays end on the building and {best.through:.0%} pass through it; expected at least {LEAST_FIT:.0%} "
            f"and at most {MOST_THROUGH:.0%}; check that it is of this building, and its unit (--unit), or give its "
            "pose with --pose"
        )
    leads = [_lead(met, other) for other in range(1, len(found))]
    alike = [0] + [
        other for other, (ahead, against) in enumerate(leads, 1) if ahead < CLEARLY or against > MOST_AGAINST
    ]
    if len(alike) > 1:
        told = "; ".join(f"{named[one]} ({found[one].fit:.0%})" for one in alike[:NAMED])
        more = f"; and {len(alike) - NAMED} more" if len(alike) > NAMED else ""
        raise Misfit(
            f"its pose was searched, and {len(alike)} places look alike (X,Y,Z,YAW, and the share of its rays that end "
            f"on the building there): {told}{more}; give the right one with --pose and --frame sensor"
        )
    return Searched(best, tried, max((one.fit for one in found[1:]), default=0.0))


def _lead(met: _Met, other: int) -> tuple[float, float]:
    """By which share of the rays the first place fits better than another, and how many of those that differ do not.

    The element that tells most for the first place is left out: one such may have been put up at the other.
    """
    mine, theirs = met.upon[0] & ~met.upon[other], met.upon[other] & ~met.upon[0]
    by_element = np.bincount(met.element[0, mine])
    mine, theirs = int(mine.sum() - by_element.max(initial=0)), int(theirs.sum())
    return (mine - theirs) / met.upon.shape[1], theirs / max(1, mine + theirs)
