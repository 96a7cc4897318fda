"""The poses of all stations together: surfaces that two of them see hold them to each other, and to the model.

S stations, K patches of each. Positions are offsets from the prior's origin, world axes: metres, z up.

Each station was laid upon the model alone. Where what it sees has moved since, it was drawn along, or fits nowhere.
What two stations see is one surface, wherever the model has it: so pairs of patches weigh more than patches on the
model, which all stations together vote for. All poses are solved in one sparse least squares, point to plane between
stations (Chen and Medioni 1991) and to the model, as in a pose graph (Lu and Milios 1997). Votes fall with how far off
a patch is (Geman and McClure 1985), first slowly, then fast, so that the start need not be right (graduated
non-convexity: Yang, Antonante, Tzoumas and Carlone 2020).
"""

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from scipy.sparse import csc_matrix
from scipy.sparse.linalg import spsolve
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from jaxmm.rays.open_directions import GIVEN
from jaxmm.rays.patches import SIZE, Patches

REACHES = (0.5, 0.35, 0.25, 0.15, 0.1, 0.06)  # [m] within which patches are matched, one after the other
ROUNDS = 4  # at each reach
SIGMA = 0.01  # [m] of a patch off its surface
TOGETHER = 10.0  # times as much as a patch on the model, a pair of patches weighs: it is one surface in any case
ALIKE = 0.9  # cosine of the angle between the normals of one surface, at least
AROUND = 6  # patches of another station that are looked at
STEP = 0.01  # [m] to either side of a patch, where the distance to the model is asked for, too
STEEP = 0.9  # by how much that must change with each metre, for the patch to be parallel to the surface
AT_ODDS, MOST_AT_ODDS = 0.05, 0.1  # [m] by which two stations disagree of a patch, and share of those they may
LEAST_SHARED = 30  # pairs of a station's patches with those of others, to hold it
LEAST_AGREED = 0.6  # share of these that must agree
SAME_SHIFT, SAME_TURN = 0.02, np.radians(0.3)  # [m], [rad] up to which a station stays as it was laid
OTHERS, PLACE = 8, 1.0  # stations that each is compared with: those that see most of the same places of so many [m]
HELD = 0.015  # [m] standard deviation of its place, up to which a station is held

# Points (n, 3) [m] -> (n,) [m] to the model's surface; inf, or beyond its reach, where none is near.
Distance = Callable[[np.ndarray], np.ndarray]


class Station(NamedTuple):
    """One station where it was laid."""

    patches: Patches
    sensor: np.ndarray  # (3,) float64 [m]
    fits: bool  # the model; else it is where it was believed to be


class Held(NamedTuple):
    """A station that others hold elsewhere than the model alone."""

    motion: np.ndarray  # (4, 4) float64: from where it was laid
    others: int  # how many hold it
    shared: int  # pairs of its patches with theirs that agree


class _Net(NamedTuple):
    """Stations, and who is compared with whom."""

    stations: list[Station]
    couples: np.ndarray  # (n, 2) int, the lesser number first
    distance: Distance


class _Rows(NamedTuple):
    """Equations off + rows . step = 0, of one station (first == second) or of two."""

    first: np.ndarray  # (n,) int of the stations that move toward
    second: np.ndarray  # (n,) int
    place: np.ndarray  # (n, 3) [m] of the patch of the first
    normal: np.ndarray  # (n, 3)
    off: np.ndarray  # (n,) [m]
    weight: np.ndarray  # (n,)
    reach: float

    @property
    def votes(self) -> np.ndarray:
        """(n,) weights that fall with how far off each is."""
        return self.weight / np.square(1.0 + np.square(2.0 * self.off / self.reach))


class _Poses(NamedTuple):
    """Where stations are: S of them."""

    turn: np.ndarray  # (S, 3, 3)
    place: np.ndarray  # (S, 3) [m] of the sensors

    def moved(self, stations: list[Station]) -> list[Patches]:
        return [
            Patches((one.patches.middle - one.sensor) @ turn.T + place, one.patches.normal @ turn.T)
            for one, turn, place in zip(stations, self.turn, self.place, strict=True)
        ]

    def after(self, step: np.ndarray) -> "_Poses":
        """Moved by shifts [m] and rotation vectors [rad] (S, 6)."""
        turn = Rotation.from_rotvec(step[:, 3:]).as_matrix()
        return _Poses(turn @ self.turn, self.place + step[:, :3])


def held_together(stations: list[Station], distance: Distance) -> list[Held | None]:
    """Where stations are that others hold elsewhere than the model alone; None of those that stay, or fit nowhere.

    The order of the stations changes no bit of it. Where all fit the model and agree with each other, none moves. Only
    those that stay or are held themselves hold others.

    Args:
        stations: of one model.
        distance: to the model.
    """
    order = sorted(range(len(stations)), key=lambda number: stations[number].patches.middle.tobytes())
    found = _held([stations[number] for number in order], distance)
    held: list[Held | None] = [None] * len(stations)
    for number, one in zip(order, found, strict=True):
        held[number] = one
    return held


def _held(stations: list[Station], distance: Distance) -> list[Held | None]:
    count, fits = len(stations), np.array([one.fits for one in stations], bool)
    start = _Poses(np.tile(np.eye(3), (count, 1, 1)), np.array([one.sensor for one in stations]).reshape(-1, 3))
    nothing: list[Held | None] = [None] * count
    net = _Net(stations, _couples(stations), distance)
    pairs = _pairs(net, start, REACHES[1])
    if not fits.any() or not len(pairs.off) or (fits.all() and not _are_at_odds(pairs)):
        return nothing
    poses = _solved(net, start, np.ones(count, bool), REACHES)
    moved = ~_stays(start, poses)
    if 2 * np.sum(moved & fits) >= fits.sum():  # nobody knows who was drawn along, and who was not
        moved &= ~fits
    moved |= ~fits
    if not moved.any():
        return nothing
    # Who stays does so to the bit, and the others hold on to them once more.
    turn, place = (
        np.where(moved.reshape(-1, *[1] * (old.ndim - 1)), new, old) for new, old in zip(poses, start, strict=True)
    )
    poses = _solved(net, _Poses(turn, place), moved, REACHES[-3:])
    pairs, model = _pairs(net, poses, REACHES[-4]), _on_model(net, poses, REACHES[-1])
    # Those that stay hold others, and whoever is held then holds more: two that are lost do not hold each other.
    counts = fits & (~moved | _stays(start, poses))
    while True:
        found = [
            _told(number, net, (start, poses), _with_these(pairs, number, counts), model) if moved[number] else None
            for number in range(count)
        ]
        more = counts | np.array([one is not None for one in found])
        if (more == counts).all():
            return found
        counts = more


def _with_these(pairs: _Rows, number: int, stations: np.ndarray) -> _Rows:
    """Pairs of patches of one station and of some (S,) bool."""
    chosen = (pairs.first == number) & stations[pairs.second] | (pairs.second == number) & stations[pairs.first]
    return _Rows(*(field[chosen] for field in pairs[:-1]), pairs.reach)


def _couples(stations: list[Station]) -> np.ndarray:
    """(n, 2) int: each station with those that see most of the same places, the lesser number first."""
    places = [np.floor(one.patches.middle / PLACE).astype(np.int64) for one in stations]
    number = np.unique(np.concatenate([np.zeros((0, 3), np.int64), *places]), axis=0, return_inverse=True)[1].ravel()
    station = np.repeat(np.arange(len(places)), [len(one) for one in places])
    seen = csc_matrix((np.ones(len(number)), (station, number)), (len(places), max(number, default=0) + 1))
    seen.data[:] = 1.0
    shared = (seen @ seen.T).toarray()
    np.fill_diagonal(shared, 0.0)
    found = {
        (min(one, other), max(one, other))
        for one, row in enumerate(shared)
        for other in np.argsort(-row, kind="stable")[:OTHERS].tolist()
        if row[other]
    }
    return np.array(sorted(found), int).reshape(-1, 2)


def _are_at_odds(pairs: _Rows) -> bool:
    """Whether some station disagrees with others of where surfaces are."""
    apart = np.abs(pairs.off) > AT_ODDS
    both = np.concatenate([pairs.first, pairs.second])
    every, odd = np.bincount(both), np.bincount(both, np.tile(apart, 2))
    return bool(np.any((every >= LEAST_SHARED) & (odd > MOST_AT_ODDS * every)))


def _stays(start: _Poses, poses: _Poses) -> np.ndarray:
    """(S,) bool: stations that are where they were."""
    shift = np.linalg.norm(poses.place - start.place, axis=1)
    turn = Rotation.from_matrix(poses.turn @ start.turn.transpose(0, 2, 1)).magnitude()
    return (shift <= SAME_SHIFT) & (turn <= SAME_TURN)


def _told(number: int, net: _Net, where: tuple[_Poses, _Poses], pairs: _Rows, model: _Rows) -> Held | None:
    """What holds a station, by its pairs of patches with those that may hold it; None where that is too little."""
    start, poses = where
    agree = np.abs(pairs.off) < AT_ODDS
    if agree.sum() < LEAST_SHARED or agree.sum() < LEAST_AGREED * len(agree):
        return None
    both = np.concatenate([pairs.first[agree], pairs.second[agree]])
    on = model.first == number
    slope = np.concatenate([
        _slopes(part.place[chosen], part.normal[chosen], poses.place[[number]])
        for part, chosen in ((pairs, agree), (model, on))
    ])  # fmt: skip
    spread = np.linalg.inv(slope.T @ slope / SIGMA**2 + np.diag(1.0 / np.square(GIVEN)))
    motion = np.eye(4)
    motion[:3, :3] = poses.turn[number] @ start.turn[number].T
    motion[:3, 3] = poses.place[number] - motion[:3, :3] @ start.place[number]
    if net.stations[number].fits and _stays(start, poses)[number]:
        return None
    if np.linalg.eigvalsh(spread[:3, :3])[-1] > HELD**2:
        return None
    return Held(motion, len(np.unique(both)) - 1, int(agree.sum()))


def _solved(net: _Net, poses: _Poses, free: np.ndarray, reaches: tuple[float, ...]) -> _Poses:
    """The poses that patches agree on, of the stations that are free (S,)."""
    total = np.zeros((len(free), 6))
    for reach in reaches:
        for _ in range(ROUNDS):
            parts = [_pairs(net, poses, reach), _on_model(net, poses, reach)]
            step = _step(parts, poses, total, free)
            poses, total = poses.after(step), total + step
            if np.abs(step).max() < 1e-5:
                break
    return poses


def _step(parts: list[_Rows], poses: _Poses, total: np.ndarray, free: np.ndarray) -> np.ndarray:
    """(S, 6) by sparse least squares; what surfaces leave open stays where it was, `total` (S, 6) back."""
    count, rows, right = 6 * len(free), [], []
    for part in parts:
        root = np.sqrt(part.votes) / SIGMA
        blocks = [(part.first, _slopes(part.place, part.normal, poses.place[part.first]))]
        other = part.first != part.second
        # Both patches lie about one place: what moves the second by a step moves the difference back.
        back = -_slopes(part.place, part.normal, poses.place[part.second]) * other[:, None]
        blocks.append((part.second, back))
        rows.append(_sparse(blocks, root, count))
        right.append(-root * part.off)
    keep = 1.0 / np.tile(GIVEN, len(free))
    told = sum((one.T @ one for one in rows), csc_matrix((count, count)))
    towards = sum(one.T @ other for one, other in zip(rows, right, strict=True)) - np.square(keep) * total.ravel()
    told = told + csc_matrix((np.square(keep), (np.arange(count), np.arange(count))), (count, count))
    chosen = np.flatnonzero(np.repeat(free, 6))
    step = np.zeros(count)
    step[chosen] = spsolve(told[chosen][:, chosen].tocsc(), towards[chosen])
    return step.reshape(-1, 6)


def _slopes(place: np.ndarray, normal: np.ndarray, about: np.ndarray) -> np.ndarray:
    """(n, 6) how far patches move along their normals with a shift and a turn about places (n, 3)."""
    return np.concatenate([normal, np.cross(place - about, normal)], axis=1)


def _sparse(blocks: list[tuple[np.ndarray, np.ndarray]], root: np.ndarray, count: int) -> csc_matrix:
    row = np.repeat(np.arange(len(root)), 6)
    values = [(slope * root[:, None]).ravel() for _, slope in blocks]
    columns = [(6 * station[:, None] + np.arange(6)).ravel() for station, _ in blocks]
    return csc_matrix(
        (np.concatenate(values), (np.tile(row, len(blocks)), np.concatenate(columns))), (len(root), count)
    )


def _on_model(net: _Net, poses: _Poses, reach: float) -> _Rows:
    """Patches that lie about a surface of the model which is parallel to them."""
    moved = poses.moved(net.stations)
    number = np.repeat(np.arange(len(moved)), [len(one.middle) for one in moved])
    place, normal = (np.concatenate(field).reshape(-1, 3) for field in zip(*moved, strict=True))
    at, before, behind = (net.distance(place + way * normal) for way in (0.0, STEP, -STEP))
    with np.errstate(invalid="ignore"):
        slope = (before - behind) / (2.0 * STEP)
        near = at < STEP
        off = np.where(near, slope * STEP, np.sign(slope) * at)
        there = (at < reach) & np.where(near, np.abs(before + behind - 2.0 * STEP) < 0.2 * STEP, np.abs(slope) > STEEP)
    return _Rows(
        number[there], number[there], place[there], normal[there], off[there], np.ones(int(there.sum())), reach
    )


def _pairs(net: _Net, poses: _Poses, reach: float) -> _Rows:
    """Patches of two stations that lie about one plane."""
    found = list(_matches(poses.moved(net.stations), net.couples, reach))
    if not found:
        return _Rows(*np.zeros((2, 0), int), *np.zeros((2, 0, 3)), *np.zeros((2, 0)), reach)
    fields = [np.concatenate(field) for field in zip(*found, strict=True)]
    return _Rows(*fields, np.full(len(fields[0]), TOGETHER), reach)


def _matches(moved: list[Patches], couples: np.ndarray, reach: float) -> Iterator[tuple[np.ndarray, ...]]:
    """Of each two stations: their numbers, place and normal of what the first sees, and how far before the second's."""
    trees = {second: cKDTree(moved[second].middle) for second in couples[:, 1].tolist()}
    around = reach + SIZE
    for first, second in couples.tolist():
        one, other = moved[first], moved[second]
        low, high = other.middle.min(axis=0) - around, other.middle.max(axis=0) + around
        rows = np.flatnonzero(np.all((one.middle > low) & (one.middle < high), axis=1))
        apart, nearest = trees[second].query(one.middle[rows], AROUND, distance_upper_bound=around)
        nearest = np.minimum(nearest, len(other.middle) - 1)  # of none, which is infinitely far
        offset = one.middle[rows, None] - other.middle[nearest]
        off = np.einsum("nkc,nkc->nk", offset, other.normal[nearest])
        alike = np.einsum("nc,nkc->nk", one.normal[rows], other.normal[nearest]) > ALIKE
        aside = np.sqrt(np.maximum(np.square(apart) - np.square(off), 0.0))
        fits = np.isfinite(apart) & alike & (np.abs(off) < reach) & (aside < SIZE)
        best = np.argmin(np.where(fits, np.abs(off) + aside, np.inf), axis=1)
        row = np.flatnonzero(fits.any(axis=1))
        if len(row):
            best = best[row]
            yield (
                np.full(len(row), first), np.full(len(row), second), one.middle[rows[row]],
                other.normal[nearest[row, best]], off[row, best],
            )  # fmt: skip
