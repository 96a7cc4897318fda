"""Shapes of upright things seen from above: straight faces and circles, fitted to the places of their points.

N points of one cluster. Plan: x and y of the world frame, metres.
"""

from typing import NamedTuple

import numpy as np
from scipy.spatial import ConvexHull

from jaxmm.vectors import lengths

ANGLES = 90  # directions that a face is sought in, over half a turn
INSIDE = 0.05  # [m] from the sides of a rectangle, beyond which nothing lies on them
REFINEMENTS = 5  # fits of a line to what lies on the line before
ROUND_CORNERS = 8  # of a polygon that stands for a circle, at least
ROUND_SPREAD = 0.02  # of its radius, by which they may differ from it, rounding included
MOST_RADIUS = 50.0  # [m] a circle wider than this is a line


class Face(NamedTuple):
    """A straight run of points: what a wall or one side of a pillar looks like from above."""

    members: np.ndarray  # (n,) int of the points that lie on it
    center: np.ndarray  # (2,) [m] on the line, halfway between its ends
    along: np.ndarray  # (2,) unit vector
    length: float  # [m]

    @property
    def across(self) -> np.ndarray:
        """(2,) unit normal, a quarter turn counter-clockwise from `along`."""
        return np.array([-self.along[1], self.along[0]])

    @property
    def ends(self) -> np.ndarray:
        """(2, 2) both ends [m], the one that `along` points to last."""
        half = self.along * (self.length / 2)
        return np.stack([self.center - half, self.center + half])


class Circle(NamedTuple):
    """A circle through points, and how well it fits."""

    center: np.ndarray  # (2,) [m]
    radius: float  # [m]
    on: np.ndarray  # (N,) bool: the points that lie on it
    arc: float  # [rad] of the circle that those points cover


def faces_of(places: np.ndarray, tolerance: float, gap: float, least: int) -> list[Face]:
    """Straight runs of points, the one with most points first; a point is of one run at most.

    The line that most points lie on is taken first, then the best among the rest, and so on.

    Args:
        places: (N, 2) [m].
        tolerance: how far a point may be off its line [m].
        gap: runs of one line are further apart than this [m].
        least: points of a run.
    """
    faces, left = [], np.arange(len(places))
    while len(left) >= least:
        on = _best_line(places[left], tolerance)
        if on.sum() < least:
            break
        members = left[on]
        runs = _runs(places, members, gap)
        kept = [face_through(places, run) for run in runs if len(run) >= least]
        faces += kept
        # What is in no run is not tried again with this line, or the search would not end.
        left = left[~on]
    return sorted(faces, key=lambda face: -len(face.members))


def face_through(places: np.ndarray, members: np.ndarray) -> Face:
    """The face of some of the points (N, 2): the line of least squares, from the first of them to the last."""
    return _spanned(places, members, *line_through(places[members]))


def face_along(places: np.ndarray, members: np.ndarray, line: Face) -> Face:
    """The face on the line of another one, that reaches as far as some of the points (N, 2)."""
    return _spanned(places, members, line.center, line.along)


def _spanned(places: np.ndarray, members: np.ndarray, center: np.ndarray, along: np.ndarray) -> Face:
    place = (places[members] - center) @ along
    low, high = float(place.min()), float(place.max())
    return Face(members, center + along * (low + high) / 2, along, high - low)


def line_through(places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A point (2,) [m] and the direction (2,) of the line of least squared distances to points (n, 2)."""
    center = places.mean(axis=0)
    offset = places - center
    return center, np.linalg.eigh(offset.T @ offset)[1][:, 1]


def circle_through(places: np.ndarray, tolerance: float) -> Circle | None:
    """The circle that points (N, 2) lie on, those further off than the tolerance [m] left out; None where none fits.

    Begins with the algebraic circle (I. Kasa, IEEE Trans. Instrum. Meas. 25, 1976) and ends with the geometric one.
    """
    on = np.ones(len(places), bool)
    for cut in (4.0, 2.0, 1.0):
        if on.sum() < 6:
            return None
        fitted = _geometric(places[on], _algebraic(places[on]))
        if fitted is None:
            return None
        center, radius = fitted
        on = np.abs(lengths(places - center) - radius) <= cut * tolerance
    if on.sum() < 6:
        return None
    return Circle(center, radius, on, _covered(places[on] - center))


def turn_of(along: np.ndarray) -> float:
    """The angle [rad] of a direction (2,), counter-clockwise from x."""
    return float(np.arctan2(along[1], along[0]))


def rectangle_along(places: np.ndarray, along: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Centre (2,) and edges (2,) [m], along a unit vector and across it, of the rectangle around points (n, 2)."""
    axes = np.stack([along, [-along[1], along[0]]])
    turned = places @ axes.T
    low, high = turned.min(axis=0), turned.max(axis=0)
    return (low + high) / 2 @ axes, high - low


def outside(places: np.ndarray, center: np.ndarray, edges: np.ndarray, along: np.ndarray) -> np.ndarray:
    """How far (n,) [m] places (n, 2) are outside of a rectangle, along the axis on which they are furthest; < 0 inside.

    Args:
        places: [m].
        center: (2,) [m].
        edges: (2,) [m] along `along` and across it.
        along: (2,) unit vector.
    """
    axes = np.stack([along, [-along[1], along[0]]])
    return (np.abs((places - center) @ axes.T) - edges / 2).max(axis=1)


def inside_hull(places: np.ndarray) -> np.ndarray:
    """How far (n,) [m] places (n, 2), not all in one line, lie inside of the convex hull of them all."""
    sides = ConvexHull(places).equations
    return -(places @ sides[:, :2].T + sides[:, 2]).max(axis=1)


def is_round(vertices: np.ndarray) -> bool:
    """Whether the footprint of an upright solid is a circle, as the corners of its hull in plan tell: eight or more.

    Args:
        vertices: (V, 2) or (V, 3) [m] of its surface.
    """
    places = np.unique(np.round(np.asarray(vertices, np.float64)[:, :2], 3), axis=0)
    if len(places) < ROUND_CORNERS or np.linalg.matrix_rank(places - places[0]) < 2:
        return False
    corners = places[ConvexHull(places).vertices]
    if len(corners) < ROUND_CORNERS:
        return False
    reach = lengths(corners - _algebraic(corners)[0])
    return bool(np.ptp(reach) <= ROUND_SPREAD * reach.max())


def upright_along(places: np.ndarray) -> np.ndarray:
    """Unit vector (2,) along one side of the rectangle whose outline points (n, 2) lie on best.

    Of all directions the one with the least squared distances to the nearest side of the rectangle around the points
    (X. Zhang et al., "Efficient L-shape fitting for vehicle detection using laser scanners", IEEE IV 2017). Where two
    faces are short, a line across their corner can hold more points than either.
    """
    step = np.pi / 2 / ANGLES
    rough = _least_off(places, step * np.arange(ANGLES))
    fine = _least_off(places, rough + step * np.linspace(-1.0, 1.0, 21))
    return np.array([np.cos(fine), np.sin(fine)])


def _least_off(places: np.ndarray, angle: np.ndarray) -> float:
    """Of angles (A,) [rad] that of the rectangle to whose sides points (n, 2) lie nearest.

    What is farther from them than INSIDE is no part of the outline, and counts as that far: a web, say.
    """
    along = np.stack([np.cos(angle), np.sin(angle)])
    sides = []
    for axis in (along, np.stack([-along[1], along[0]])):
        place = places @ axis  # (n, A)
        sides.append(np.minimum(place - place.min(axis=0), place.max(axis=0) - place))
    off = np.minimum(np.minimum(*sides), INSIDE)
    return float(angle[(off**2).sum(axis=0).argmin()])


def _best_line(places: np.ndarray, tolerance: float) -> np.ndarray:
    """(N,) bool: the points on the line that most of them lie on."""
    angle = np.pi * np.arange(ANGLES) / ANGLES
    normal = np.stack([np.cos(angle), np.sin(angle)])
    middle = places.mean(axis=0)
    off = (places - middle) @ normal  # (N, ANGLES)
    place = np.floor((off - off.min()) / tolerance).astype(np.int64)
    cells = int(place.max()) + 2
    votes = np.bincount((place + cells * np.arange(ANGLES)).ravel(), minlength=cells * ANGLES).reshape(ANGLES, cells)
    votes = votes + np.roll(votes, -1, axis=1)  # a line on the border of two cells is as good as any
    best, cell = np.unravel_index(np.argmax(votes), votes.shape)
    on = (place[:, best] == cell) | (place[:, best] == cell + 1)
    for _ in range(REFINEMENTS):
        center, along = line_through(places[on])
        now = np.abs((places - center) @ [-along[1], along[0]]) <= tolerance
        if now.sum() < 2 or np.array_equal(now, on):
            break
        on = now
    return on


def _runs(places: np.ndarray, members: np.ndarray, gap: float) -> list[np.ndarray]:
    """The members, cut where more than a gap [m] lies between neighbours on their line."""
    center, along = line_through(places[members])
    place = (places[members] - center) @ along
    order = np.argsort(place, kind="stable")
    return np.split(members[order], np.flatnonzero(np.diff(place[order]) > gap) + 1)


def _algebraic(places: np.ndarray) -> tuple[np.ndarray, float]:
    middle = places.mean(axis=0)
    offset = places - middle
    columns = np.column_stack([2.0 * offset, np.ones(len(offset))])
    *center, k = np.linalg.lstsq(columns, (offset**2).sum(axis=1), rcond=None)[0]
    return middle + center, float(np.sqrt(max(k + center[0] ** 2 + center[1] ** 2, 0.0)))


def _geometric(places: np.ndarray, start: tuple[np.ndarray, float]) -> tuple[np.ndarray, float] | None:
    """Gauss-Newton from the algebraic circle, which is too small where little of it is seen."""
    center, radius = start
    for _ in range(REFINEMENTS):
        offset = places - center
        reach = lengths(offset)
        if not 0.0 < radius < MOST_RADIUS or reach.min() < 1e-6:
            return None
        columns = np.column_stack([offset / reach[:, None], np.ones(len(reach))])
        step = np.linalg.lstsq(columns, reach - radius, rcond=None)[0]
        center, radius = center + step[:2], radius + float(step[2])
    return (center, radius) if 0.0 < radius < MOST_RADIUS else None


def _covered(offset: np.ndarray) -> float:
    """Angle [rad] that directions (n, 2) span: a whole turn less the largest part of it without any."""
    turn = np.sort(np.arctan2(offset[:, 1], offset[:, 0]))
    between = np.diff(np.concatenate([turn, turn[:1] + 2 * np.pi]))
    return float(2 * np.pi - between.max())
