"""Faces fitted to the rays that should meet them: how far off its place each stands, and what of it stands.

K rays of one group. Positions are offsets from the prior's origin, world axes: metres, z up.

An element stands in its place where at least half of the rays that could reach its face end on it; what ends before the
face, as on furniture, says nothing against that. Else it may stand somewhere else: the plane that most of the rays end
on, which may be turned and lean a little, tells where (random samples: Fischler and Bolles 1981; then least squares of
what lies near it).
"""

from typing import NamedTuple

import numpy as np

from jaxmm.deviations.meetings import MOST_OFF, STEEP, Meetings

LEAST_RAYS = 20  # of a group, to be fitted
LEAST_FACING = 0.1  # of a ray to a fitted plane, as to the model's: one that goes along a plane meets it nowhere
IN_PLACE = 0.03  # [m] off its face, up to which a thing is in its place, or hardly off
STANDS = 0.5  # share of the rays that could reach a face, that must end on it
TRIES, TRIED = 80, 400  # samples of three rays, and rays that judge them
MOST_SLOPE = np.tan(np.radians(10.0))  # of a face off its place, against it
SURELY = 2.0  # standard deviations, by which a slope is more
BENT = np.radians(0.5)  # that normals of one face may differ by; of a bent one, slopes tell nothing
LEAST_SIGMA = 0.0001  # [m] of exact rays
CUT = 4.0  # standard deviations, beyond which a ray has no say
ROUNDS, SETTLED = 10, 1e-6  # [m] of level, and of slopes
OF_SIGMA = 0.01  # of what rays err by: less than what the most of them leave open
# [m] before a face, from which on a cupboard's front may be there; of those up to so far below the wall's head, or so
# high above its foot, at least.
FRONT, BELOW, CUPBOARD = 0.1, 0.12, 2.6
LEAST_BESIDE = 0.01  # share of the rays, that must end behind a front to tell of the wall
UNKNOWN_SLOPE = 1.0  # of what tells no slope: far more than any
LEAST_EXTENT = 0.02  # [m] standard deviation of ends along a face: less is an edge
CELL = 0.1  # [m] of a face, within which rays err together
ENOUGH_CELLS = 8  # whose means tell how much they err


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
    before: bool = False  # it may as well be the front of what stands before the face, which nobody saw then
    first: bool = True  # of a round body, all ways but one say the same rays again
    number: int = -1  # of the faces that tell the pose of its scan; -1: none of them

    @property
    def rays(self) -> int:
        """How many end on it; 0 where another fit says so already."""
        return int(self.on.sum()) * self.every if self.first else 0


def fit_of(group: Meetings, foot: float, head: float) -> Fit | None:
    """Where the face of a group stands; None where too little ends on one.

    Args:
        group: of one element.
        foot: [m] where the element begins,
        head: and where it ends.
    """
    if len(group.off) < LEAST_RAYS:
        return None
    normal = group.normal.mean(axis=0)
    normal /= np.linalg.norm(normal)
    axes = axes_of(normal)
    place = group.end @ axes.T
    # A cabinet before a wall hides it, and tells nothing against it.
    met, drift = _met(group, axes)
    cell = np.unique(cells_of(met), return_inverse=True)[1]
    reaches = group.off < IN_PLACE
    near = _patches(np.abs(group.off) < IN_PLACE, ~reaches, cell)
    if near.sum() >= max(LEAST_RAYS, STANDS * reaches.sum()) and _is_wide(place[near]):
        return _fitted(group, (met, drift), (normal, axes), near)
    high = min(head - BELOW, foot + CUPBOARD)
    start = _plane_behind(group, place, cell, high)
    if start is None:
        return None
    found = _fitted(group, (met, drift), (normal, axes), start)
    if found is None or abs(normal[2]) > STEEP or found.level < FRONT:
        return found
    return found._replace(before=bool(group.end[found.on, 2].max() < high))


def _is_wide(place: np.ndarray) -> bool:
    """Whether ends (n, 2) [m] cover a part of a face, and no edge of it, as those on the next face do."""
    return bool(np.all(place.std(axis=0) > LEAST_EXTENT))


def axes_of(normal: np.ndarray) -> np.ndarray:
    """Unit vectors (2, 3) along a face: level first."""
    level = np.cross([0.0, 0.0, 1.0], normal)
    if np.linalg.norm(level) < 0.3:
        level = np.cross(normal, [0.0, 1.0, 0.0])
    level /= np.linalg.norm(level)
    return np.stack([level, np.cross(normal, level)])


def _met(group: Meetings, axes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Places (K, 2) [m] along the model's face where rays should meet it, and how they change (K, 2) with `off`.

    A range that errs moves the end along the face, too, where the ray is not square to it: so places are told by rays,
    and not by where they ended, or noise would turn every face that is seen at a slant.
    """
    way = (group.end - group.sensor) / group.reach[:, None]
    cosine = -np.einsum("kc,kc->k", group.normal, way)
    drift = (way @ axes.T) / cosine[:, None]
    return group.end @ axes.T + drift * group.off[:, None], drift


def _patches(chosen: np.ndarray, before: np.ndarray, cell: np.ndarray) -> np.ndarray:
    """(K,) bool: of chosen rays those in cells (K,) where no more end before: of a reveal few show beside its wall."""
    return chosen & (np.bincount(cell, chosen) >= np.bincount(cell, before))[cell]


def _plane_behind(group: Meetings, place: np.ndarray, cell: np.ndarray, high: float) -> np.ndarray | None:
    """(K,) bool: rays about the plane that most of them end on, or about one behind it that shows beside it.

    A cupboard may hide nearly all of a wall, but does not reach up to its head [m]: what does is the wall. So is what
    lies behind the wall's place: no cupboard is so flat that its front does.
    """
    found, among = None, np.arange(len(group.off))
    while len(among) >= max(LEAST_RAYS, LEAST_BESIDE * len(group.off)):
        on = _plane_of_most(group.of(among), place[among], high)
        if on is None or not _is_wide(place[among[on]]):
            break
        found = among[on]
        if group.end[found, 2].max() >= high or np.median(group.off[found]) < 0.0:
            break
        plane = np.linalg.lstsq(np.column_stack([np.ones(len(found)), place[found]]), group.off[found], rcond=None)[0]
        behind = np.zeros(len(cell), bool)
        behind[among] = group.off[among] < plane[0] + place[among] @ plane[1:] - IN_PLACE
        among = np.flatnonzero(_patches(behind, np.isin(np.arange(len(cell)), found), cell))
    return None if found is None else np.isin(np.arange(len(group.off)), found)


def _plane_of_most(group: Meetings, place: np.ndarray, high: float) -> np.ndarray | None:
    """(K,) bool: rays about the plane that most of them end on; None where no plane has as many as pass behind it."""
    rng, place = np.random.default_rng(0), place - place.mean(axis=0)
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
    # Nothing may be seen through what stands; and what hides less than half of a face, and does not reach up to its
    # head, is furniture before it.
    least = max(LEAST_RAYS, STANDS * np.sum(off < width))
    if best[0] > 0.0 and not np.any(group.end[on, 2] >= high):
        least = max(least, STANDS * len(off))
    if on.sum() < least:
        return None
    return np.abs(off) < max(CUT * 1.4826 * float(np.median(np.abs(off[on]))), 2.0 * LEAST_SIGMA)


def _fitted(
    group: Meetings, met: tuple[np.ndarray, np.ndarray], frame: tuple[np.ndarray, np.ndarray], start: np.ndarray
) -> Fit | None:
    """Least squares about the rays of a start (K,) bool: settled ranges tell which end on it, measured ones where."""
    normal, axes = frame
    on, plane = start, None
    for _ in range(ROUNDS):
        place, found, left, sigma = _least_squares(group.off, met, on, plane)
        plane = group.off - left
        width = min(max(CUT * sigma, 2.0 * LEAST_SIGMA), IN_PLACE)
        new = np.abs(left) < width
        if new.sum() < LEAST_RAYS or not _is_wide(place[new]):
            return None
        if np.array_equal(new, on):
            break
        on = new
    measured = group.as_measured()
    place, found, apart, sigma = _least_squares(measured.off, met, on, plane)
    if abs(normal[2]) > STEEP and found[0] > IN_PLACE:
        return None  # a screed, or a ceiling that hangs below a slab, hides where the slab is
    variance = _variance(place[on], apart[on], sigma)
    # Settled ranges cut corners: of a narrow face they, and few rays that err, tell slopes that it does not have.
    if np.any(np.abs(found[1:]) - SURELY * np.sqrt(np.diag(variance)[1:]) > MOST_SLOPE):
        return None
    if np.max(np.arccos(np.clip(group.normal @ normal, -1.0, 1.0))) > BENT:
        variance = np.diag([variance[0, 0], *np.full(2, UNKNOWN_SLOPE**2)])
    behind = int(np.sum(left < -max(width, IN_PLACE)))
    middle, face = place[on].mean(axis=0), float(np.median((group.end[on] @ normal) - group.off[on]))
    left = group.off - found[0] - (place - middle) @ found[1:]
    return Fit(
        middle @ axes + (face + found[0]) * normal, normal, axes, float(found[0]), found[1:], variance, sigma,
        place[on].std(axis=0), on, left, behind * group.every, group.every,
    )  # fmt: skip


def _least_squares(
    off: np.ndarray, met: tuple[np.ndarray, np.ndarray], on: np.ndarray, start: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """Of a plane by rays of a mask (K,): places (K, 2) on it, level and slopes (3,), what is left (K,), and sigma.

    Slopes are about the mean of the places of the mask. At edges ranges are mixed with what is before or behind: many
    of them lie a little off, all to one side. So rays have the less weight, the farther off they lie (biweight: Beaton
    and Tukey 1974). They begin alike, or as they are off a plane that is near already, `start` (K,) [m] of each ray.
    """
    weight, last, offs = np.ones(on.sum()), np.full(3, np.inf), off[on]
    (places, drift), fitted = (one[on] for one in met), np.median(offs)
    if start is not None:
        fitted = start[on]
        apart = np.abs(offs - fitted)
        weight = _weight(apart, _sigma(apart))
    for _ in range(ROUNDS):
        there = places - drift * np.reshape(fitted, (-1, 1))
        middle = there.mean(axis=0)
        tell = np.column_stack([np.ones(len(there)), there - middle])
        weighted = (tell * weight[:, None]).T
        # Of the normal equations, which are three: of all rays it takes ten times as long.
        found = np.linalg.lstsq(weighted @ tell, weighted @ offs, rcond=None)[0]
        fitted = tell @ found
        apart = np.abs(offs - fitted)
        sigma = _sigma(apart)
        if np.abs(found - last).max() < max(SETTLED, OF_SIGMA * sigma):
            break
        weight, last = _weight(apart, sigma), found
    places, drift = met
    # Where each ray meets the plane: off = level + slope . (place - drift * off - middle).
    plane = found[0] + (places - middle) @ found[1:]
    fitted = plane / np.maximum(1.0 + drift @ found[1:], LEAST_FACING)
    return places - drift * fitted[:, None], found, off - fitted, sigma


def _sigma(apart: np.ndarray) -> float:
    """[m] standard deviation of rays so far (n,) [m] off a plane, whatever some of them are off."""
    middle = len(apart) // 2
    return max(LEAST_SIGMA, 1.4826 * float(np.partition(apart, middle)[middle]))


def _weight(apart: np.ndarray, sigma: float) -> np.ndarray:
    """(n,) of the same rays: 0 from CUT standard deviations on."""
    return np.square(1.0 - np.square(np.minimum(apart / (CUT * sigma), 1.0)))


def _variance(place: np.ndarray, left: np.ndarray, sigma: float) -> np.ndarray:
    """(3, 3) of level and slopes of rays that end at places (n, 2) [m], so far (n,) [m] off the plane.

    Neighbours err alike, and no face is flat: what a cell has in common errs as its mean does, whatever other cells do
    (as Liang and Zeger 1986, "Longitudinal data analysis using generalized linear models", Biometrika 73(1), 13).
    """
    number, count = np.unique(cells_of(place), return_inverse=True, return_counts=True)[1:]
    rows = np.column_stack([np.ones(len(place)), place - place.mean(axis=0)])
    told = rows.T @ rows
    if len(count) >= ENOUGH_CELLS:
        clipped = np.clip(left, -CUT * sigma, CUT * sigma)[:, None] * rows
        sums = np.stack([np.bincount(number, one) for one in clipped.T], axis=1)
        # The plane was fitted to them: they lie too near to it.
        spread = sums.T @ sums * (len(count) / (len(count) - 3.0))
    else:
        spread = told * (sigma**2 * len(place) / max(4.0, min(float(len(count)), float(len(place)))))
    least = np.diag([LEAST_SIGMA**2 * len(place), 0.0, 0.0])
    known = np.linalg.inv(told)
    return known @ (spread + least) @ known


def count_cells(places: np.ndarray) -> int:
    """How many cells of CELL hold places (n, 2 or 3) [m]."""
    return len(np.unique(cells_of(places)))


def cells_of(places: np.ndarray) -> np.ndarray:
    """(n,) int64 the cell of each place (n, 2 or 3) [m]; of such within a kilometre of another no two share one."""
    where = np.floor(places / CELL).astype(np.int64)
    return where @ (np.int64(1) << np.array([42, 21, 0])[3 - places.shape[1] :])
