"""Where a cloud was scanned from: the pose of the one pinhole camera whose pyramid of view the cloud just fills.

World frame: metres, z up. Sensor frame: x forward, y left, z up; pitch up, then yaw, no roll. N points; M of them lie
at the edges of the view. A pose in here is (5,): x, y, z [m], yaw, pitch [rad].

The pyramid has four planes through the camera. All points lie inside of each, and where the view cuts through floor,
walls and ceiling, points lie along the whole of each edge. Four planes that are merely touched leave a few poses for
every pitch; these are ranked by how much of the edges the points touch, and by how many points would be hidden behind
others. The best are refined by a linear programme that would rather leave a gap than a point outside.
"""

from typing import NamedTuple

import numpy as np

from jaxmm.inputs import InputError
from jaxmm.rays.camera_fit import (
    REACH,
    Cloud,
    deviation_of,
    edge_normals,
    misplaced,
    refined,
    rotation_at,
    touched_edges,
    with_spacing,
)
from jaxmm.rays.scan_rays import overtaken
from warp_scanner.lengths import length_in_words

LEAST_POINTS = 200  # below, the edges of the view are guesswork
LEAST_TOUCHED = 0.6  # of all edges; right poses have 0.64 and more, wrong ones rarely half
LEAST_TOUCHED_EDGE = 0.15  # of each; with a wrong field of view, an edge has none
WELL_TOUCHED = 0.8  # of all edges; with less, another field of view may fit better
HOPELESS = 0.4  # of all edges; with less, no other field of view is asked for
MOST_HIDDEN = 0.2  # of thinned points; right poses of rooms have up to 0.15, among many small things up to 0.3
MOST_OVERTAKEN = 0.05  # of all points, beside that; whole scans have up to 0.02 in their right place
LEAST_AHEAD = 0.01  # of the points of any sensor
MOST_STRAYS = 0.2  # of the points, out of view as a given pose has it
# From a right place, points of a whole scan touch most of the edges after a move of up to 0.04 m. In 60 views of
# validation rooms no right place is doubted for that, whole or without margins; 57 of those that are 0.3 m off are.
LEAST_MOVED, LEAST_MORE = 0.25, 0.15  # [m], and share of all edges
NARROWER = (0.95, 0.9, 0.85, 0.8)  # times as wide a view, of which files without the margin of an image are
LEAST_LEAD = 0.15  # in score over any other pose; the mirror image of a wall that is nearly alone comes close
FAR_BETTER = 0.15  # in score: with this lead, another field of view casts doubt on the given one
# Of a scan in the view of another one from the same place; 0.25 m ahead of it 0.34 of the edges are touched at most.
LEAST_TOUCHED_SHARED, MOST_STRAYS_SHARED = 0.3, 0.02
SHARED_UNSURE = (0.2, 0.2, 0.2, 3.0, 3.0)  # [m, deg] by which scans that pass for being from one place may differ
MOST_UNSURE = (0.5, 5.0)  # [m, deg] standard deviation of a coordinate, beyond which it is no estimate

_STRAYS = 2  # of the points that poses are searched with, so many may lie outside of a plane
_THIN = 3000  # points that poses are searched with
_PITCHES = np.radians(np.arange(-45.0, 45.1, 3.0))  # tried where it is unknown


class Viewpoint(NamedTuple):
    """The estimated pose of a camera, and how sure it is."""

    position: np.ndarray  # (3,) float64 [m] world frame
    yaw: float  # [deg] counter-clockwise from world x, -180 to 180
    pitch: float  # [deg] upwards
    deviation: np.ndarray  # (5,) float64 standard deviations of x, y, z [m], yaw, pitch [deg]; 0 for a given pitch
    touched: float  # share of the view's edges that points touch
    hidden: float  # share of points that lie behind others, as seen from here


class _Fit(NamedTuple):
    score: float
    touched: np.ndarray  # (4,) by edge
    hidden: float
    pose: np.ndarray  # (5,)


def estimate(
    points: np.ndarray,
    horizontal_fov: float = 80.0,
    vertical_fov: float = 55.0,
    *,
    pitch: float | None = 0.0,
    seed: int = 0,
) -> Viewpoint:
    """The pose that a cloud was scanned from, from its points alone; the same whatever their order.

    Args:
        points: (N, 3) [m], world frame, of one scan by a camera without roll that saw something nearly everywhere
            along the edges of its view. Voxel thinning does no harm; objects filtered out at the edges do.
        horizontal_fov: of the camera [deg], between the outer edges of its image.
        vertical_fov: [deg].
        pitch: of the camera [deg] upwards; None to estimate it too, from -45 to 45 degrees.
        seed: of the thinning and resampling.

    Raises:
        InputError: too few points, or not finite; no pose from which the cloud fills the view; many that fit alike;
            one that is too unsure. One line that says by how much.
        ValueError: wrong shape, or angles that no camera has.
    """
    points = np.asarray(points, np.float64)
    if points.ndim != 2 or points.shape[1] != 3:
        raise ValueError(f"points must be (N, 3), got {points.shape}")
    if not (0.0 < horizontal_fov < 180.0 and 0.0 < vertical_fov < 180.0):
        raise ValueError(f"fields of view must be between 0 and 180 degrees, got {horizontal_fov} and {vertical_fov}")
    if pitch is not None and not -90.0 < pitch < 90.0:
        raise ValueError(f"pitch must be between -90 and 90 degrees, got {pitch}")
    if bad := int((~np.isfinite(points)).any(axis=1).sum()):
        raise _unknown(f"{bad} of {len(points)} points have NaN or infinite coordinates")
    centre = np.median(points, axis=0) if len(points) else np.zeros(3)
    points = np.unique(points - centre, axis=0)  # copies have no spacing; sorted, the order no longer matters
    if len(points) < LEAST_POINTS:
        raise _unknown(f"expected at least {LEAST_POINTS} different points, got {len(points)}")
    half, rng = np.radians([horizontal_fov, vertical_fov]) / 2, np.random.default_rng(seed)
    cloud, thin = with_spacing(points), with_spacing(_thinned(points, _THIN, rng))
    pitches = _PITCHES if pitch is None else np.radians([pitch])
    free = np.arange(5 if pitch is None else 4)
    fits = _search(cloud, thin, half, pitches, free)
    _check(fits, thin, half, free)
    best = fits[0]
    deviation = deviation_of(cloud, best.pose, half, free, rng)
    _check_deviation(deviation)
    yaw = float(np.degrees((best.pose[3] + np.pi) % (2 * np.pi) - np.pi))
    position = best.pose[:3] + centre
    return Viewpoint(position, yaw, float(np.degrees(best.pose[4])), deviation, float(best.touched.mean()), best.hidden)


def estimate_by_other(thin: np.ndarray, other: np.ndarray, horizontal_fov: float, vertical_fov: float) -> Viewpoint:
    """The pose of a scan as another scan from the same place tells it.

    What stands right before a camera, or was filtered out there, leaves a scan without a part of its view's edges. Both
    pass for being of one place where the scan keeps within the other's view, touches much of its edges and hides little
    of itself; standard deviations say by how much they may still differ.

    Args:
        thin: (N, 3) [m] of the scan, thinned to about 0.1 m.
        other: (M, 3) [m] of the other one, in the same frame, thinned alike.
        horizontal_fov: of the camera [deg].
        vertical_fov: [deg].

    Raises:
        InputError: the other one does not tell its own, or they need not be of one place; one line.
    """
    found = estimate(other, horizontal_fov, vertical_fov, pitch=None)
    if len(thin) < LEAST_POINTS:
        raise _unknown(f"expected at least {LEAST_POINTS} points, got {len(thin)}")
    half = np.radians([horizontal_fov, vertical_fov]) / 2
    cloud = with_spacing(np.asarray(thin, np.float64) - found.position)
    pose = np.array([0.0, 0.0, 0.0, *np.radians([found.yaw, found.pitch])])
    touched, (hidden, strays) = float(touched_edges(cloud, pose, half, REACH).mean()), misplaced(cloud, pose, half)
    if touched < LEAST_TOUCHED_SHARED or strays > MOST_STRAYS_SHARED or hidden > MOST_HIDDEN:
        raise _unknown(
            f"in the view of the other scan its points touch {touched:.0%} of the edges, {strays:.0%} lie out of it "
            f"and {hidden:.0%} behind others; expected at least {LEAST_TOUCHED_SHARED:.0%}, at most "
            f"{MOST_STRAYS_SHARED:.0%} and {MOST_HIDDEN:.0%}"
        )
    # The limit of what is an estimate holds for the other scan's own pose; what is added is told, and no more.
    return found._replace(touched=touched, hidden=hidden, deviation=np.hypot(found.deviation, SHARED_UNSURE))


def _unknown(reason: str) -> InputError:
    return InputError(f"the viewpoint cannot be estimated: {reason}; give it with --pose")


def _thinned(points: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    return points if len(points) <= count else points[np.sort(rng.choice(len(points), count, replace=False))]


def doubts_about(
    points: np.ndarray,
    thin: np.ndarray,
    position: np.ndarray,
    rotation: np.ndarray,
    view: tuple[float, float] | None,
) -> list[str]:
    """What speaks against a pose that a scan is said to be taken from; nothing where all fits.

    Args:
        points: (M, 3) [m] of the scan.
        thin: (N, 3) [m] the same, thinned to about 0.1 m.
        position: (3,) [m] of the sensor, in the frame of the points.
        rotation: (3, 3) sensor to world.
        view: horizontal and vertical field of view [deg] that the points must lie in; None: any.
    """
    if len(thin) < LEAST_POINTS:
        return []
    forward = rotation[:, 0]
    turned = [np.arctan2(forward[1], forward[0]), np.arcsin(np.clip(forward[2], -1.0, 1.0))]
    cloud, pose = with_spacing(np.asarray(thin, np.float64) - position), np.array([0.0, 0.0, 0.0, *turned])
    half = np.radians(view or (90.0, 90.0)) / 2
    hidden, strays = misplaced(cloud, pose, half)
    doubts = []
    # Thinned points are as wide as they are apart: among many small things, some lie behind others from anywhere.
    if hidden > MOST_HIDDEN and overtaken(points, position) > MOST_OVERTAKEN:
        doubts.append(
            f"{hidden:.0%} of its points would lie hidden behind others, seen from its pose: is the place right?"
        )
    if view and strays > MOST_STRAYS:
        doubts.append(f"{strays:.0%} of its points lie outside the sensor's view, as it is turned: is it right?")
    elif view and (moved := _better_place(cloud, pose, half)) is not None:
        where = ", ".join(f"{value:.2f}" for value in position + moved)
        doubts.append(
            f"its points fill the sensor's view from {where} m, {length_in_words(np.linalg.norm(moved))} from its "
            "pose: are place and sensor right?"
        )
    return doubts


def _better_place(cloud: Cloud, pose: np.ndarray, half: np.ndarray) -> np.ndarray | None:
    """How far (3,) [m] from a pose a camera stood, as the edges of its view tell; None where they tell nothing else."""
    fit = refined(cloud, pose, half, np.arange(5), 8)
    before, after = (float(touched_edges(cloud, one, half, REACH).mean()) for one in (pose, fit))
    moved = fit[:3] - pose[:3]
    if after < WELL_TOUCHED or after < before + LEAST_MORE or np.linalg.norm(moved) < LEAST_MOVED:
        return None
    narrower = (np.arctan(share * np.tan(half)) for share in NARROWER)
    cropped = max(float(touched_edges(cloud, pose, one, REACH).mean()) for one in narrower)
    return None if cropped > after - LEAST_MORE else moved


def is_turned_away(points: np.ndarray, position: np.ndarray, rotation: np.ndarray) -> bool:
    """Whether hardly any of the points (N, 3) [m] of a scan lies before its sensor, as its pose turns that."""
    return len(points) >= LEAST_POINTS and bool(np.mean((points - position) @ rotation[:, 0] > 0.0) < LEAST_AHEAD)


def _search(cloud: Cloud, thin: Cloud, half: np.ndarray, pitches: np.ndarray, free: np.ndarray) -> list[_Fit]:
    """Different poses that fit at all, the best first."""
    rough = _rough_search(thin, half, pitches, free)
    return _ranked([_fit(cloud, thin, refined(cloud, fit.pose, half, free, 8), half) for fit in rough[:3]])


def _rough_search(thin: Cloud, half: np.ndarray, pitches: np.ndarray, free: np.ndarray) -> list[_Fit]:
    poses = _tight_poses(thin.points, half, pitches)
    touched = [touched_edges(thin, pose, half, 2 * REACH).mean() for pose in poses]
    order = np.argsort(touched, kind="stable")[::-1]
    rough = [refined(thin, pose, half, free, 3) for pose in _different(poses[order], 8)]
    return _ranked([_fit(thin, thin, pose, half) for pose in rough])


def _better_view(thin: Cloud, best: _Fit, half: np.ndarray, free: np.ndarray) -> str:
    """What to say of another field of view that the cloud fills far better; nothing if there is none."""
    pitches = best.pose[4] + np.radians(np.arange(-6.0, 6.1, 3.0) if len(free) == 5 else [0.0])
    score, view = best.score + FAR_BETTER, ""
    for axis, change in ((axis, change) for axis in (1, 0) for change in (-10.0, -5.0, 5.0, 10.0)):
        other = half + np.radians(change) / 2 * (np.arange(2) == axis)
        fits = _rough_search(thin, other, pitches, free) if other.min() > 0.0 and other.max() < np.pi / 2 else []
        if fits and fits[0].touched.mean() >= LEAST_TOUCHED and fits[0].score > score:
            score, view = fits[0].score, f", while others fit far better, such as {_named(other)}"
    return view


def _tight_poses(points: np.ndarray, half: np.ndarray, pitches: np.ndarray) -> np.ndarray:
    """(K, 5) poses whose four planes all touch the points, from grids of yaw and pitch.

    For any rotation, two planes touch left and right along one line of apexes, two above and below along another. They
    meet where both are equally far behind the points: at the zeros of a function of yaw.
    """
    step = np.radians(1.0 if len(pitches) == 1 else 3.0)
    yaw = np.arange(0.0, 2 * np.pi - step / 2, step)
    points = _outer(points)
    poses = []
    for pitch in pitches:
        normals = (rotation_at(yaw, pitch + 0.0 * yaw) @ edge_normals(half).T).swapaxes(1, 2).reshape(-1, 3)
        height = np.partition(normals @ points.T, _STRAYS, axis=1)[:, _STRAYS].reshape(-1, 4)
        behind = (height[:, ::2] + height[:, 1::2]) / (2 * np.sin(half))  # (Y, 2) by the sides, by above and below
        gap = behind[:, 0] - behind[:, 1]
        size, after = np.abs(gap), np.roll(gap, -1)
        zero = gap * after <= 0.0
        low = (size <= np.roll(size, 1)) & (size <= np.roll(size, -1))  # zeros that outermost points only just miss
        for at in np.flatnonzero(zero | low):
            share = gap[at] / (gap[at] - after[at]) if zero[at] and gap[at] != after[at] else 0.0
            touch = (1 - share) * height[at] + share * height[(at + 1) % len(yaw)]
            turn = yaw[at] + share * step
            forward = min((touch[:2].sum(), touch[2:].sum()) / (2 * np.sin(half)))
            aside = (touch[1] - touch[0], touch[3] - touch[2]) / (2 * np.cos(half))
            poses.append([*(rotation_at(turn, pitch) @ [forward, *aside]), turn, pitch])
    return np.array(poses)


def _outer(points: np.ndarray) -> np.ndarray:
    """The points that lie outermost in some of many directions: only these can touch a plane."""
    directions = np.random.default_rng(0).normal(size=(300, 3))
    count = 2 * _STRAYS + 2
    return points[np.unique(np.argpartition(directions @ points.T, count, axis=1)[:, :count])]


def _different(poses: np.ndarray, count: int) -> list[np.ndarray]:
    """The first `count` poses, without those that lie next to an earlier one."""
    chosen: list[np.ndarray] = []
    for pose in poses:
        if len(chosen) == count:
            break
        if not any(_alike(pose, other) for other in chosen):
            chosen.append(pose)
    return chosen


def _alike(pose: np.ndarray, other: np.ndarray) -> bool:
    turn = np.abs((pose[3:] - other[3:] + np.pi) % (2 * np.pi) - np.pi).max()
    return np.linalg.norm(pose[:3] - other[:3]) < 0.3 and turn < np.radians(3.0)


def _ranked(fits: list[_Fit]) -> list[_Fit]:
    fits = sorted(fits, key=lambda fit: -fit.score)
    kept: list[_Fit] = []
    for fit in fits:
        if not any(_alike(fit.pose, other.pose) for other in kept):
            kept.append(fit)
    return kept


def _fit(cloud: Cloud, thin: Cloud, pose: np.ndarray, half: np.ndarray) -> _Fit:
    touched, (hidden, strays) = touched_edges(cloud, pose, half, REACH), misplaced(thin, pose, half)
    return _Fit(touched.mean() - 2.0 * (hidden + strays), touched, hidden, pose)


def _check(fits: list[_Fit], thin: Cloud, half: np.ndarray, free: np.ndarray) -> None:
    best = fits[0]
    touched, least = best.touched.mean(), best.touched.min()
    too_little = touched < LEAST_TOUCHED or least < LEAST_TOUCHED_EDGE
    doubtful = HOPELESS < touched and (too_little or touched < WELL_TOUCHED)
    better = _better_view(thin, best, half, free) if doubtful else ""
    if too_little or better:
        raise _unknown(
            f"at best its points touch {touched:.0%} of the edges of a view of {_named(half)} degrees, and {least:.0%}"
            f" of one edge (expected {LEAST_TOUCHED:.0%} and {LEAST_TOUCHED_EDGE:.0%}){better}"
        )
    if best.hidden > MOST_HIDDEN:
        raise _unknown(
            f"from the best place {best.hidden:.0%} of the points lie hidden behind others,"
            f" expected at most {MOST_HIDDEN:.0%}"
        )
    if len(fits) > 1 and best.score - fits[1].score < LEAST_LEAD:
        apart = length_in_words(np.linalg.norm(best.pose[:3] - fits[1].pose[:3]))
        raise _unknown(f"two places, {apart} apart, fit alike with scores {best.score:.2f} and {fits[1].score:.2f}")


def _named(half: np.ndarray) -> str:
    return " x ".join(f"{np.degrees(2 * angle):.4g}" for angle in half)


def _check_deviation(deviation: np.ndarray) -> None:
    metres, degrees = deviation[:3].max(), deviation[3:].max()
    if metres > MOST_UNSURE[0] or degrees > MOST_UNSURE[1]:
        raise _unknown(
            f"it is known only within {metres:.2g} m and {degrees:.2g} degrees,"
            f" expected {MOST_UNSURE[0]} m and {MOST_UNSURE[1]} degrees"
        )
