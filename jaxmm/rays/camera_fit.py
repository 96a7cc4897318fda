"""How well a cloud fills the pyramid of a camera at some pose, and how the pose is moved until it fits best.

World frame: metres, z up. Sensor frame: x forward, y left, z up; pitch up, then yaw, no roll. N points; M of them lie
at the edges of the view, each the outermost of one stretch of an edge. A pose is (5,): x, y, z [m], yaw, pitch [rad];
`half` (2,) are half the angles of the view [rad], across and upright.
"""

from typing import NamedTuple

import numpy as np
from scipy.optimize import linprog
from scipy.spatial import cKDTree

from jaxmm.vectors import lengths

_BINS = 24  # stretches that an edge is cut into: each counts once, however many points it holds
_SLACK = 0.1  # of half the view: points farther outside are strays
REACH = 3.0  # [spacings] from an edge within which a stretch counts as touched, the less the farther
_OUTSIDE = 8.0  # what a point outside costs, as a multiple of one as far inside
_INSET = 0.4  # [spacings] by which the outermost points may lie inside of the edge: half a pixel, part of a voxel
_RESAMPLES = 24


class Cloud(NamedTuple):
    """A cloud, and how densely it covers what it shows."""

    points: np.ndarray  # (N, 3) float64 [m] about the centre
    spacing: np.ndarray  # (N,) [m] to the nearest other point
    patch: np.ndarray  # (N,) [m] radius of the surface that the point stands for


class Edges(NamedTuple):
    """The outermost points of the stretches of all edges."""

    edge: np.ndarray  # (M,) 0 to 3: left, right, upper, lower
    inside: np.ndarray  # (M,) [spacings] from the edge inwards
    slope: np.ndarray  # (M, 5) its derivative by the pose
    room: np.ndarray  # (M,) number of points, at most 1, that the stretch has room for


def with_spacing(points: np.ndarray) -> Cloud:
    distance, _ = cKDTree(points).query(points, k=5)
    # On a square grid all four are equal; where points were drawn at random, the nearest says too little.
    return Cloud(points, distance[:, 1], distance[:, 4] / 2)


def rotation_at(yaw: np.ndarray, pitch: np.ndarray) -> np.ndarray:
    """(..., 3, 3) sensor frame to world."""
    cy, sy, cp, sp = np.cos(yaw), np.sin(yaw), np.cos(pitch), np.sin(pitch)
    rows = [[cy * cp, -sy, -cy * sp], [sy * cp, cy, -sy * sp], [sp, 0.0 * cy, cp]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def edge_normals(half: np.ndarray) -> np.ndarray:
    """(4, 3) unit normals, inwards, of the left, right, upper and lower plane in the sensor frame."""
    (sa, sb), (ca, cb) = np.sin(half), np.cos(half)
    return np.array([[sa, -ca, 0.0], [sa, ca, 0.0], [sb, 0.0, -cb], [sb, 0.0, cb]])


def _extremes(cloud: Cloud, pose: np.ndarray, half: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The outermost point of each stretch of each edge, but for strays: (M,) edge 0 to 3, (M,) index of the point."""
    forward, *aside = rotation_at(*pose[3:]).T @ (cloud.points - pose[:3]).T
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


def _residuals(cloud: Cloud, pose: np.ndarray, half: np.ndarray) -> Edges:
    edge, index = _extremes(cloud, pose, half)
    rotation = rotation_at(*pose[3:])
    normal = (edge_normals(half) @ rotation.T)[edge]
    offset, spacing = cloud.points[index] - pose[:3], cloud.spacing[index]
    turned = np.cross([0.0, 0.0, 1.0], normal), np.cross(-rotation[:, 1], normal)
    turning = np.stack([np.sum(turn * offset, axis=1) for turn in turned], axis=1)
    slope = np.column_stack([-normal, turning]) / spacing[:, None]
    length = 2 * np.tan(half[1 - edge // 2]) / _BINS * (offset @ rotation[:, 0])
    return Edges(edge, np.sum(normal * offset, axis=1) / spacing, slope, np.clip(length / spacing, 0.05, 1.0))


def touched_edges(cloud: Cloud, pose: np.ndarray, half: np.ndarray, reach: float) -> np.ndarray:
    """(4,) share of each edge that points touch; one on the edge counts 1, falling to 0 at `reach` spacings."""
    edges = _residuals(cloud, pose, half)
    touch = np.bincount(edges.edge, np.maximum(0.0, 1.0 - np.abs(edges.inside) / reach), 4)
    # Near walls are thinned to fewer points than an edge has stretches.
    room = np.bincount(edges.edge, edges.room, 4) / np.maximum(np.bincount(edges.edge, minlength=4), 1)
    return np.minimum(1.0, touch / np.maximum(_BINS * room, 1.0))


def misplaced(cloud: Cloud, pose: np.ndarray, half: np.ndarray) -> tuple[float, float]:
    """Shares of points that lie behind others, as no single scan can measure them, and of strays out of view."""
    offset = cloud.points - pose[:3]
    distance = np.maximum(lengths(offset), 1e-9)
    toward = offset / distance[:, None]
    angle, other = cKDTree(toward).query(toward, k=min(8, len(toward)))
    covered = angle < cloud.patch[other] / distance[other]
    # The margin spares floors that are seen at a grazing angle.
    behind = distance[:, None] > 1.1 * distance[other] + 6.0 * cloud.patch[other]
    forward, *aside = (toward @ rotation_at(*pose[3:])).T
    out = (np.abs(aside) > (1.0 + _SLACK) * np.tan(half)[:, None] * forward).any(axis=0)
    return float((covered & behind).any(axis=1).mean()), float(out.mean())


def refined(cloud: Cloud, pose: np.ndarray, half: np.ndarray, free: np.ndarray, rounds: int) -> np.ndarray:
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


def _trust(edges: Edges) -> np.ndarray:
    """(M,) 1 near an edge, less where its points are missing: what shows in the gap may be far away and pull hard."""
    return 1.0 / np.maximum(1.0, np.abs(edges.inside) / REACH)


def _step(edges: Edges, free: np.ndarray, weight: np.ndarray) -> np.ndarray:
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


def deviation_of(
    cloud: Cloud, pose: np.ndarray, half: np.ndarray, free: np.ndarray, rng: np.random.Generator
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
