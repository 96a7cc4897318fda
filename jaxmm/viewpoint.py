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
from scipy.optimize import linprog
from scipy.spatial import cKDTree

from jaxmm.inputs import InputError

LEAST_POINTS = 200  # below, the edges of the view are guesswork
LEAST_TOUCHED = 0.6  # of all edges; right poses have 0.64 and more, wrong ones rarely half
LEAST_TOUCHED_EDGE = 0.15  # of each; with a wrong field of view, an edge has none
WELL_TOUCHED = 0.8  # of all edges; with less, another field of view may fit better
HOPELESS = 0.4  # of all edges; with less, no other field of view is asked for
MOST_HIDDEN = 0.2  # of the points; right poses have up to 0.15 in clouds of few points, a third of it in large ones
LEAST_LEAD = 0.15  # in score over any other pose; the mirror image of a wall that is nearly alone comes close
FAR_BETTER = 0.15  # in score: with this lead, another field of view casts doubt on the given one
MOST_UNSURE = (0.5, 5.0)  # [m, deg] standard deviation of a coordinate, beyond which it is no estimate

_BINS = 24  # stretches that an edge is cut into: each counts once, however many points it holds
_SLACK = 0.1  # of half the view: points farther outside are strays
_REACH = 3.0  # [spacings] from an edge within which a stretch counts as touched, the less the farther
_OUTSIDE = 8.0  # what a point outside costs, as a multiple of one as far inside
_INSET = 0.4  # [spacings] by which the outermost points may lie inside of the edge: half a pixel, part of a voxel
_STRAYS = 2  # of the points that poses are searched with, so many may lie outside of a plane
_THIN = 3000  # points that poses are searched with
_PITCHES = np.radians(np.arange(-45.0, 45.1, 3.0))  # tried where it is unknown
_RESAMPLES = 24


class Viewpoint(NamedTuple):
    """The estimated pose of a camera, and how sure it is."""

    position: np.ndarray  # (3,) float64 [m] world frame
    yaw: float  # [deg] counter-clockwise from world x, -180 to 180
    pitch: float  # [deg] upwards
    deviation: np.ndarray  # (5,) float64 standard deviations of x, y, z [m], yaw, pitch [deg]; 0 for a given pitch
    touched: float  # share of the view's edges that points touch
    hidden: float  # share of points that lie behind others, as seen from here


class _Cloud(NamedTuple):
    points: np.ndarray  # (N, 3) float64 [m] about the centre
    spacing: np.ndarray  # (N,) [m] to the nearest other point
    patch: np.ndarray  # (N,) [m] radius of the surface that the point stands for


class _Edges(NamedTuple):
    """The outermost points of the stretches of all edges."""

    edge: np.ndarray  # (M,) 0 to 3: left, right, upper, lower
    inside: np.ndarray  # (M,) [spacings] from the edge inwards
    slope: np.ndarray  # (M, 5) its derivative by the pose
    room: np.ndarray  # (M,) number of points, at most 1, that the stretch has room for


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
    cloud, thin = _with_spacing(points), _with_spacing(_thinned(points, _THIN, rng))
    pitches = _PITCHES if pitch is None else np.radians([pitch])
    free = np.arange(5 if pitch is None else 4)
    fits = _search(cloud, thin, half, pitches, free)
    _check(fits, thin, half, free)
    best = fits[0]
    deviation = _deviation(cloud, best.pose, half, free, rng)
    _check_deviation(deviation)
    yaw = float(np.degrees((best.pose[3] + np.pi) % (2 * np.pi) - np.pi))
    position = best.pose[:3] + centre
    return Viewpoint(position, yaw, float(np.degrees(best.pose[4])), deviation, float(best.touched.mean()), best.hidden)


def _unknown(reason: str) -> InputError:
    return InputError(f"the viewpoint cannot be estimated: {reason}; give it with --pose")


def _thinned(points: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    return points if len(points) <= count else points[np.sort(rng.choice(len(points), count, replace=False))]


def _with_spacing(points: np.ndarray) -> _Cloud:
    distance, _ = cKDTree(points).query(points, k=5)
    # On a square grid all four are equal; where points were drawn at random, the nearest says too little.
    return _Cloud(points, distance[:, 1], distance[:, 4] / 2)


def _rotation(yaw: np.ndarray, pitch: np.ndarray) -> np.ndarray:
    """(..., 3, 3) sensor frame to world."""
    cy, sy, cp, sp = np.cos(yaw), np.sin(yaw), np.cos(pitch), np.sin(pitch)
    rows = [[cy * cp, -sy, -cy * sp], [sy * cp, cy, -sy * sp], [sp, 0.0 * cy, cp]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def _edge_normals(half: np.ndarray) -> np.ndarray:
    """(4, 3) unit normals, inwards, of the left, right, upper and lower plane in the sensor frame."""
    (sa, sb), (ca, cb) = np.sin(half), np.cos(half)
    return np.array([[sa, -ca, 0.0], [sa, ca, 0.0], [sb, 0.0, -cb], [sb, 0.0, cb]])


def _search(cloud: _Cloud, thin: _Cloud, half: np.ndarray, pitches: np.ndarray, free: np.ndarray) -> list[_Fit]:
    """Different poses that fit at all, the best first."""
    rough = _rough_search(thin, half, pitches, free)
    return _ranked([_fit(cloud, thin, _refined(cloud, fit.pose, half, free, 8), half) for fit in rough[:3]])


def _rough_search(thin: _Cloud, half: np.ndarray, pitches: np.ndarray, free: np.ndarray) -> list[_Fit]:
    poses = _tight_poses(thin.points, half, pitches)
    touched = [_touched(thin, pose, half, 2 * _REACH).mean() for pose in poses]
    order = np.argsort(touched, kind="stable")[::-1]
    rough = [_refined(thin, pose, half, free, 3) for pose in _different(poses[order], 8)]
    return _ranked([_fit(thin, thin, pose, half) for pose in rough])


def _better_view(thin: _Cloud, best: _Fit, half: np.ndarray, free: np.ndarray) -> str:
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
        normals = (_rotation(yaw, pitch + 0.0 * yaw) @ _edge_normals(half).T).swapaxes(1, 2).reshape(-1, 3)
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
            poses.append([*(_rotation(turn, pitch) @ [forward, *aside]), turn, pitch])
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


def _fit(cloud: _Cloud, thin: _Cloud, pose: np.ndarray, half: np.ndarray) -> _Fit:
    touched, (hidden, strays) = _touched(cloud, pose, half, _REACH), _misplaced(thin, pose, half)
    return _Fit(touched.mean() - 2.0 * (hidden + strays), touched, hidden, pose)


def _extremes(cloud: _Cloud, pose: np.ndarray, half: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The outermost point of each stretch of each edge, but for strays: (M,) edge 0 to 3, (M,) index of the point."""
    forward, *aside = _rotation(*pose[3:]).T @ (cloud.points - pose[:3]).T
    side = np.array(aside) / (np.maximum(forward, 1e-9) * np.tan(half)[:, None])  # (2, N) -1 to 1 in view
    outer = np.abs(side).max(axis=0)
    near = np.flatnonzero((outer > 0.5) & (outer < 1.0 + _SLACK))
    side = side[:, near]
    stretch = np.clip(((side + 1.0) / 2 * _BINS).astype(int), 0, _BINS - 1)
    edges, indices = [], []
    for edge, (axis, sign) in enumerate(((0, 1), (0, -1), (1, 1), (1, -1))):
        toward, place = sign * side[axis], stretch[1 - axis]
        peak = np.full(_BINS, 0.5)  # an edge cannot be told by points of the other half of the view
        np.maximum.at(peak, place, toward)
        outermost = np.full(_BINS, -1)
        found = np.flatnonzero((toward == peak[place]) & (toward > 0.5))
        outermost[place[found]] = near[found]
        indices.append(outermost[outermost >= 0])
        edges.append(np.full(len(indices[-1]), edge))
    return np.concatenate(edges), np.concatenate(indices)


def _residuals(cloud: _Cloud, pose: np.ndarray, half: np.ndarray) -> _Edges:
    edge, index = _extremes(cloud, pose, half)
    rotation = _rotation(*pose[3:])
    normal = (_edge_normals(half) @ rotation.T)[edge]
    offset, spacing = cloud.points[index] - pose[:3], cloud.spacing[index]
    turned = np.cross([0.0, 0.0, 1.0], normal), np.cross(-rotation[:, 1], normal)
    turning = np.stack([np.sum(turn * offset, axis=1) for turn in turned], axis=1)
    slope = np.column_stack([-normal, turning]) / spacing[:, None]
    length = 2 * np.tan(half[1 - edge // 2]) / _BINS * (offset @ rotation[:, 0])
    return _Edges(edge, np.sum(normal * offset, axis=1) / spacing, slope, np.clip(length / spacing, 0.05, 1.0))


def _touched(cloud: _Cloud, pose: np.ndarray, half: np.ndarray, reach: float) -> np.ndarray:
    """(4,) share of each edge that points touch; one on the edge counts 1, falling to 0 at `reach` spacings."""
    edges = _residuals(cloud, pose, half)
    touch = np.bincount(edges.edge, np.maximum(0.0, 1.0 - np.abs(edges.inside) / reach), 4)
    # Near walls are thinned to fewer points than an edge has stretches.
    room = np.bincount(edges.edge, edges.room, 4) / np.maximum(np.bincount(edges.edge, minlength=4), 1)
    return np.minimum(1.0, touch / np.maximum(_BINS * room, 1.0))


def _misplaced(cloud: _Cloud, pose: np.ndarray, half: np.ndarray) -> tuple[float, float]:
    """Shares of points that lie behind others, as no single scan can measure them, and of strays out of view."""
    offset = cloud.points - pose[:3]
    distance = np.maximum(np.linalg.norm(offset, axis=1), 1e-9)
    toward = offset / distance[:, None]
    angle, other = cKDTree(toward).query(toward, k=min(8, len(toward)))
    covered = angle < cloud.patch[other] / distance[other]
    # The margin spares floors that are seen at a grazing angle.
    behind = distance[:, None] > 1.1 * distance[other] + 6.0 * cloud.patch[other]
    forward, *aside = (toward @ _rotation(*pose[3:])).T
    out = (np.abs(aside) > (1.0 + _SLACK) * np.tan(half)[:, None] * forward).any(axis=0)
    return float((covered & behind).any(axis=1).mean()), float(out.mean())


def _refined(cloud: _Cloud, pose: np.ndarray, half: np.ndarray, free: np.ndarray, rounds: int) -> np.ndarray:
    """The pose after some rounds of choosing the outermost points and laying the edges along them."""
    for _ in range(rounds):
        edges = _residuals(cloud, pose, half)
        if len(edges.edge) <= len(free):
            break
        step = _step(edges, free, _trust(edges))
        pose = pose + step
        if np.abs(step).max() < 1e-5:
            break
    return pose


def _trust(edges: _Edges) -> np.ndarray:
    """(M,) 1 near an edge, less where its points are missing: what shows in the gap may be far away and pull hard."""
    return 1.0 / np.maximum(1.0, np.abs(edges.inside) / _REACH)


def _step(edges: _Edges, free: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """(5,) change of pose that lays the edges along the outermost points, most of them inside: a linear programme.

    Least weighted sum of |distances|, those outwards counted _OUTSIDE times.
    """
    count = len(edges.edge)
    equal = np.hstack([edges.slope[:, free], -np.eye(count), np.eye(count)])
    cost = np.concatenate([np.zeros(len(free)), weight, _OUTSIDE * weight])
    limits = [(-limit, limit) for limit in np.array([0.5, 0.5, 0.5, 0.1, 0.1])[free]]
    solved = linprog(cost, A_eq=equal, b_eq=-edges.inside, bounds=limits + [(0.0, None)] * (2 * count), method="highs")
    step = np.zeros(5)
    if solved.x is not None:
        step[free] = solved.x[: len(free)]
    return step


def _deviation(
    cloud: _Cloud, pose: np.ndarray, half: np.ndarray, free: np.ndarray, rng: np.random.Generator
) -> np.ndarray:
    """(5,) standard deviations [m, deg]: of the choice of edge points, and of how far inside the edges they lie."""
    edges = _residuals(cloud, pose, half)
    count = len(edges.edge)
    drawn = rng.multinomial(count, np.full(count, 1.0 / count), size=_RESAMPLES)
    steps = np.array([_step(edges, free, times * _trust(edges)) for times in drawn])
    shifts = np.zeros((4, 5))
    shifts[:, free] = (np.linalg.pinv(edges.slope[:, free]) @ (_INSET * (edges.edge[:, None] == np.arange(4)))).T
    deviation = np.sqrt(steps.var(axis=0) + np.sum(shifts**2, axis=0))
    return deviation * [1.0, 1.0, 1.0, np.degrees(1.0), np.degrees(1.0)]


def _check(fits: list[_Fit], thin: _Cloud, half: np.ndarray, free: np.ndarray) -> None:
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
        apart = np.linalg.norm(best.pose[:3] - fits[1].pose[:3])
        raise _unknown(
            f"two places, {apart:.3g} m apart, fit alike with scores {best.score:.2f} and {fits[1].score:.2f}"
        )


def _named(half: np.ndarray) -> str:
    return " x ".join(f"{np.degrees(2 * angle):.4g}" for angle in half)


def _check_deviation(deviation: np.ndarray) -> None:
    metres, degrees = deviation[:3].max(), deviation[3:].max()
    if metres > MOST_UNSURE[0] or degrees > MOST_UNSURE[1]:
        raise _unknown(
            f"it is known only within {metres:.2g} m and {degrees:.2g} degrees,"
            f" expected {MOST_UNSURE[0]} m and {MOST_UNSURE[1]} degrees"
        )
