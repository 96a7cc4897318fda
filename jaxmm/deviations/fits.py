"""Faces fitted to the rays that should meet them: how far off its place each stands, and what of it stands.

K rays of one group. Positions are offsets from the prior's origin, world axes: metres, z up.

An element stands in its place where at least half of the rays that could reach its face end on it; what ends before the
face, as on furniture, says nothing against that. Else it may stand somewhere else: the plane that most of the rays end
on, which may be turned and lean a little, tells where (random samples: Fischler and Bolles 1981; then least squares of
what lies near it).
"""

from typing import NamedTuple

import numpy as np

from jaxmm.deviations.meetings import MOST_OFF, Meetings

LEAST_RAYS = 20  # of a group, to be fitted
IN_PLACE = 0.03  # [m] off its face, up to which a thing is in its place, or hardly off
STANDS = 0.5  # share of the rays that could reach a face, that must end on it
TRIES, TRIED = 80, 400  # samples of three rays, and rays that judge them
MOST_SLOPE = np.tan(np.radians(5.0))  # of a face off its place, against it
LEAST_SIGMA = 0.0001  # [m] of exact rays
CUT = 4.0  # standard deviations, beyond which a ray has no say
ROUNDS = 10
LEAST_TOLD = 0.05  # of what a round body tells of its surest way, that it must tell of another
LEAST_EXTENT = 0.02  # [m] standard deviation of ends along a face: less is an edge
CELL = 0.1  # [m] of a face, within which rays err together


class Fit(NamedTuple):
    """A face where it stands: off = level + slope . place, about the middle of what is seen.

    What a curved body tells along one way is told as a face across that way, whose slopes nobody knows.
    """

    middle: np.ndarray  # (3,) [m] of what is seen, on the face as it stands
    normal: np.ndarray  # (3,) unit vector of the model's face, toward the sensor
    axes: np.ndarray  # (2, 3) unit vectors along the face
    level: float  # [m] off the model's face at the middle, before it positive
    slope: np.ndarray  # (2,) along the axes
    variance: np.ndarray  # (3, 3) of level and slope
    sigma: float  # [m] of the rays about it
    extent: np.ndarray  # (2,) [m] standard deviation of what is seen along the axes
    on: np.ndarray  # (K,) bool: rays that end on it
    left: np.ndarray  # (K,) [m] of all rays off it
    through: int  # rays that end clearly behind it
    every: int  # rays that each of these stands for

    @property
    def rays(self) -> int:
        """How many end on it."""
        return int(self.on.sum()) * self.every


def fit_of(group: Meetings) -> Fit | None:
    """Where the face of a group stands; None where too little ends on one."""
    if len(group.off) < LEAST_RAYS:
        return None
    normal = group.normal.mean(axis=0)
    normal /= np.linalg.norm(normal)
    axes = _axes(normal)
    place = group.end @ axes.T
    # A cabinet before a wall hides it, and tells nothing against it.
    near = np.abs(group.off) < IN_PLACE
    reaches = group.off < IN_PLACE
    if near.sum() >= max(LEAST_RAYS, STANDS * reaches.sum()) and _is_wide(place[near]):
        return _fitted(group, place, (normal, axes), near)
    start = _plane_of_most(group, place)
    if start is None:
        return None
    return _fitted(group, place, (normal, axes), start)


def fits_of_curved(body: Meetings) -> list[Fit]:
    """What all rays of a round body tell of its shift, along each way that they fix; none where it stands elsewhere.

    Every ray has its own normal, so off = normal . shift.
    """
    if len(body.off) < LEAST_RAYS:
        return []
    flat = body.normal[:, :2]
    on, reaches = np.abs(body.off) < IN_PLACE, body.off < IN_PLACE
    if on.sum() < max(LEAST_RAYS, STANDS * reaches.sum()):
        on = _shift_of_most(body.off, flat)
        if on is None:
            return []
    for _ in range(ROUNDS):
        shift = np.linalg.lstsq(flat[on], body.off[on], rcond=None)[0]
        left = body.off - flat @ shift
        sigma = max(LEAST_SIGMA, 1.4826 * float(np.median(np.abs(left[on]))))
        width = min(max(CUT * sigma, 2.0 * LEAST_SIGMA), IN_PLACE)
        new = np.abs(left) < width
        if new.sum() < max(LEAST_RAYS, STANDS * np.sum(left < width)):
            return []
        if np.array_equal(new, on):
            break
        on = new
    cells = count_cells(body.end[on])
    worth = max(4.0, min(float(cells), float(on.sum()))) / on.sum()
    square, ways = np.linalg.eigh(flat[on].T @ flat[on] * worth)
    middle = body.end[on].mean(axis=0)
    through = int(np.sum(left < -width)) * body.every
    found = []
    for told, way in zip(square, ways.T, strict=True):
        if told < LEAST_TOLD * square[-1]:
            continue
        normal = np.array([*way, 0.0]) * (1.0 if flat[on].sum(axis=0) @ way >= 0.0 else -1.0)
        axes = _axes(normal)
        variance = np.diag([sigma**2 / told, *np.full(2, MOST_SLOPE**2)])
        found.append(Fit(
            middle, normal, axes, float(np.array([*shift, 0.0]) @ normal), np.zeros(2), variance, sigma,
            (body.end[on] @ axes.T).std(axis=0), on, left, through, body.every,
        ))  # fmt: skip
    return found


def _shift_of_most(off: np.ndarray, flat: np.ndarray) -> np.ndarray | None:
    """(K,) bool: rays that end where they would on the body after the shift that most of them tell."""
    rng = np.random.default_rng(0)
    near = np.flatnonzero(np.abs(off) < MOST_OFF)
    if len(near) < LEAST_RAYS:
        return None
    picked = near[rng.integers(0, len(near), (TRIES, 2))]
    rows = flat[picked]
    right = np.abs(np.linalg.det(rows)) > 0.1
    if not right.any():
        return None
    shifts = np.linalg.solve(rows[right], off[picked][right][..., None])[..., 0]
    some = rng.permutation(near)[:TRIED]
    best = shifts[np.argmax(np.sum(np.abs(off[some] - shifts @ flat[some].T) < IN_PLACE / 2, axis=1))]
    on = np.abs(off - flat @ best) < IN_PLACE / 2
    # As of a face: less than half of it is something that stands before it.
    return on if on.sum() >= max(LEAST_RAYS, STANDS * np.sum(off < MOST_OFF)) else None


def _is_wide(place: np.ndarray) -> bool:
    """Whether ends (n, 2) [m] cover a part of a face, and no edge of it, as those on the next face do."""
    return bool(np.all(place.std(axis=0) > LEAST_EXTENT))


def _axes(normal: np.ndarray) -> np.ndarray:
    """Unit vectors (2, 3) along a face: level first."""
    level = np.cross([0.0, 0.0, 1.0], normal)
    if np.linalg.norm(level) < 0.3:
        level = np.cross(normal, [0.0, 1.0, 0.0])
    level /= np.linalg.norm(level)
    return np.stack([level, np.cross(normal, level)])


def _plane_of_most(group: Meetings, place: np.ndarray) -> np.ndarray | None:
    """(K,) bool: rays about the plane that most of them end on; None where no plane has as many as pass behind it."""
    rng = np.random.default_rng(0)
    some = rng.permutation(len(group.off))[:TRIED]
    some = some[np.abs(group.off[some]) < MOST_OFF]
    if len(some) < LEAST_RAYS:
        return None
    picked = some[rng.integers(0, len(some), (TRIES, 3))]
    rows = np.concatenate([np.ones((TRIES, 3, 1)), place[picked]], axis=2)
    right = np.abs(np.linalg.det(rows)) > 1e-3
    if not right.any():
        return None
    planes = np.linalg.solve(rows[right], group.off[picked][right][..., None])[..., 0]
    planes = planes[np.all(np.abs(planes[:, 1:]) < MOST_SLOPE, axis=1)]
    if not len(planes):
        return None
    width = IN_PLACE / 2
    apart = group.off[some] - planes[:, :1] - planes[:, 1:] @ place[some].T
    best = planes[np.argmax(np.sum(np.abs(apart) < width, axis=1))]
    off = group.off - best[0] - place @ best[1:]
    on = np.abs(off) < width
    # Nothing may be seen through what stands; and what hides less than half of a face is furniture before it.
    if on.sum() < max(LEAST_RAYS, STANDS * np.sum(off < width), STANDS * len(off) if best[0] > 0.0 else 0.0):
        return None
    return np.abs(off) < max(CUT * 1.4826 * float(np.median(np.abs(off[on]))), 2.0 * LEAST_SIGMA)


def _fitted(group: Meetings, place: np.ndarray, frame: tuple[np.ndarray, np.ndarray], start: np.ndarray) -> Fit | None:
    """Least squares about the rays of a start (K,) bool."""
    normal, axes = frame
    on = start
    for _ in range(ROUNDS):
        middle = place[on].mean(axis=0)
        rows = np.column_stack([np.ones(on.sum()), place[on] - middle])
        found = np.linalg.lstsq(rows, group.off[on], rcond=None)[0]
        left = group.off - found[0] - (place - middle) @ found[1:]
        sigma = max(LEAST_SIGMA, 1.4826 * float(np.median(np.abs(left[on]))))
        width = max(CUT * sigma, 2.0 * LEAST_SIGMA)
        new = np.abs(left) < min(width, IN_PLACE)
        if new.sum() < LEAST_RAYS or not _is_wide(place[new]) or np.abs(found[1:]).max() > MOST_SLOPE:
            return None
        if np.array_equal(new, on):
            break
        on = new
    # Neighbours err alike: a cell counts as one.
    cells = count_cells(place[on])
    worth = max(4.0, min(float(cells), float(on.sum())))
    rows = np.column_stack([np.ones(on.sum()), place[on] - middle])
    told = rows.T @ rows * (worth / on.sum())
    scale = np.diag([0.0, *(1.0 / np.square(np.full(2, MOST_SLOPE)))]) * sigma**2
    variance = np.linalg.inv(told + scale) * sigma**2
    behind = int(np.sum(left < -max(width, IN_PLACE)))
    return Fit(
        group.end[on].mean(axis=0), normal, axes, float(found[0]), found[1:], variance, sigma, place[on].std(axis=0),
        on, left, behind * group.every, group.every,
    )  # fmt: skip


def count_cells(places: np.ndarray) -> int:
    """How many cells of CELL hold places (n, 2 or 3) [m]."""
    return len(np.unique(cells_of(places)))


def cells_of(places: np.ndarray) -> np.ndarray:
    """(n,) int64 the cell of each place (n, 2 or 3) [m]; of such within a kilometre of another no two share one."""
    where = np.floor(places / CELL).astype(np.int64)
    return where @ (np.int64(1) << np.array([42, 21, 0])[3 - places.shape[1] :])
