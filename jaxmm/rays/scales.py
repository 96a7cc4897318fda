"""Whether a scan would fit a prior at another size: its units may be others, or its ranges err in proportion.

A motion lays no more than one of two walls that face each other on the prior, where the scan is too large; a scale lays
both, and all others as well. What moved, or is new, fits no better at another size, but for one pair of walls: so only
surfaces of more than one pair count. N points about the sensor, M of the prior. Metres, z up.
"""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from jaxmm.vectors import lengths

FACTORS = np.exp(np.arange(-8, 9) * 0.04)  # 0.73 to 1.38, that are tried
TRIED, KEPT = 500, 3  # points that tell which of them fits best, and how many of these are refined
MOST_WORSE = 1.5  # surfaces by which the best other size may then lie worse than the scan's own, to be refined
WIDE = 0.15  # [m] off a surface, at which a point is no match while factors are tried
REACHES = (0.3, 0.3, 0.3, 0.2, 0.2, 0.12, 0.12, 0.08, 0.08, 0.08)  # [m] within which points are matched, in turns
FINE = 0.05  # [m] off a surface, at which a point counts as no match in the end
NEAR = 0.2  # [m] along a surface to the next point of a prior
ALIKE = 0.8  # cosine of the angle between normals of one surface, at least
SIGMA = 0.02  # [m] of a surface
KNOWN = (0.5, 0.5, 0.2, 0.1, 0.1, 0.1, 0.3)  # [m, rad, 1] standard deviations of shift, turn and scale
LEAST_GAINED = 1.5  # surfaces that must lie on the prior at another size alone: one wall of a pair may have moved
LEAST_OFF = 0.02  # from 1, of a factor that is told


class Scale(NamedTuple):
    """A size at which a scan fits better."""

    factor: float  # times its own
    surfaces: float  # that lie on the prior at that size, and from nowhere at its own


class Surfaces(NamedTuple):
    """What is laid upon what, thinned."""

    points: np.ndarray  # (N, 3) [m] of the scan, about the sensor
    normals: np.ndarray  # (N, 3) unit vectors
    weight: np.ndarray  # (N,) that sum to 1 on each surface
    prior: np.ndarray  # (M, 3) [m] about the same
    facing: np.ndarray  # (M, 3) unit vectors: normals of it
    tree: cKDTree  # of it


class _Placed(NamedTuple):
    """A scan at another size: points x go to linear x + shift."""

    linear: np.ndarray  # (3, 3): a rotation times a factor
    shift: np.ndarray  # (3,) [m]

    @property
    def factor(self) -> float:
        return float(np.cbrt(np.linalg.det(self.linear)))


def scale_of(seen: Surfaces, motions: Iterable[np.ndarray], changed: float, zero: np.ndarray) -> Scale | None:
    """The size at which a scan fits better than at its own; None where it hardly does, or where nothing tells.

    Args:
        seen: the scan, and the prior.
        motions: (4, 4) of it that were tried.
        changed: surfaces that lie on the prior by none of them, see `changed_of`.
        zero: (3,) [m] of the frame that its file is in, about the sensor: it may be larger about that.
    """
    if changed < LEAST_GAINED:
        return None
    some = _some(seen)
    starts = [(_Placed(f * one[:3, :3], one[:3, 3]), f) for one in motions for f in FACTORS]
    starts += [(_Placed(f * np.eye(3), (1.0 - f) * zero), f) for f in FACTORS]
    off = np.array([changed_of(some, *one, WIDE) for one, _ in starts])
    own = np.array([factor == 1.0 for _, factor in starts])
    if off[~own].min() > off[own].min() + MOST_WORSE:
        return None
    found = [_refined(some, starts[row][0]) for row in np.argsort(off, kind="stable")[:KEPT]]
    best = min(found, key=lambda one: changed_of(some, *one, FINE))
    best = _refined(seen, best, REACHES[-2:])
    gained = changed - changed_of(seen, *best, FINE)
    if gained < LEAST_GAINED or abs(best.factor - 1.0) < LEAST_OFF:
        return None
    return Scale(best.factor, gained)


def changed_of(seen: Surfaces, linear: np.ndarray, shift: np.ndarray, cut: float = FINE) -> float:
    """Surfaces that do not lie on the prior after a motion, see `surfaces_off`."""
    off, _, _ = _off(seen, linear, shift)
    return surfaces_off(seen.weight, off, cut)


def surfaces_off(weight: np.ndarray, off: np.ndarray, cut: float) -> float:
    """Surfaces that do not lie on a prior, of points (N,) of a weight, so far off it [m]: up to `cut` as 0 to 1."""
    return float(weight @ np.minimum(np.square(off / cut), 1.0))


def _some(seen: Surfaces) -> Surfaces:
    """The same by fewer points, each of which counts for more."""
    every = max(1, len(seen.points) // TRIED)
    return seen._replace(
        points=seen.points[::every], normals=seen.normals[::every], weight=seen.weight[::every] * every
    )


def _off(seen: Surfaces, linear: np.ndarray, shift: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """How far (N,) [m] moved points lie off the surface next to them, inf where none looks alike; they, and normals."""
    moved = seen.points @ linear.T + shift
    square, place = seen.tree.query(moved, distance_upper_bound=REACHES[0] + NEAR)
    square, place = np.square(square), np.minimum(place, len(seen.prior) - 1)  # beyond, where none is so near
    normal, apart = seen.facing[place], moved - seen.prior[place]
    off = np.einsum("nc,nc->n", apart, normal)
    facing = seen.normals @ linear.T
    alike = np.abs(np.einsum("nc,nc->n", facing, normal)) > ALIKE * lengths(facing)
    aside = square - np.square(off)
    return np.where(alike & (aside < NEAR**2), off, np.inf), moved, normal


def _refined(seen: Surfaces, placed: _Placed, reaches: Iterable[float] = REACHES) -> _Placed:
    """Where it fits best near by, at any size: least squares of what lies near surfaces, again and again."""
    linear, shift = placed
    known = np.diag(1.0 / np.square(KNOWN))
    for reach in reaches:
        off, moved, normal = _off(seen, linear, shift)
        match = np.abs(off) < reach
        if not match.any():
            break
        rows = np.column_stack(
            [normal[match], np.cross(moved[match], normal[match]), np.einsum("nc,nc->n", moved[match], normal[match])]
        )
        weighted = rows.T * (seen.weight[match] * np.square(1.0 - np.square(off[match] / reach)) / SIGMA**2)
        step = -np.linalg.solve(weighted @ rows + known, weighted @ off[match])
        turn = Rotation.from_rotvec(step[3:6]).as_matrix() * np.exp(step[6])
        linear, shift = turn @ linear, turn @ shift + step[:3]
    return _Placed(linear, shift)
