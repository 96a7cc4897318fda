"""How far off a scan's pose may still be, told by all faces it sees together.

G fitted faces of one scan. World axes: metres, radians. A correction is a shift and a rotation vector (6,) about the
sensor, which moves the points of the scan.

Most of what is built stands where it is drawn, and something stands anywhere: the faces vote for a pose with weights
that fall with how far off they then are (Cauchy), so one wall that moved does not drag the rest, and drift is not laid
at the elements' door (as Bassier, Vincke, De Winter and Vergauwen 2020, "Drift invariant metric quality control of
construction sites using BIM and point cloud data", ISPRS Int. J. Geo-Inf. 9(9), 545). From there each counts by how
likely it stands in its place: what is left of a vote that falls softly would make the pose less sure than it is. Where
two poses explain about as much, as between two walls of which one moved, both stay, each by how likely it is.
"""

from typing import NamedTuple

import numpy as np

from jaxmm.deviations.fits import UNKNOWN_SLOPE, Fit
from jaxmm.rays.open_directions import GIVEN

LEAST_PLACE, USUAL_PLACE, MOST_PLACE = 0.0001, 0.001, 0.01  # [m] by which faces in their place scatter
USUAL_TILT = np.full(2, USUAL_PLACE)
USUAL_RANGE = np.log(5.0)  # standard deviation of the logarithm of that, before any face was seen
SCATTERS = np.geomspace(LEAST_PLACE, MOST_PLACE, 24)  # [m] that are tried
SOFT = 2.0  # standard deviations, from where on a face loses its vote
# A pose that fits as it was given hardly does so by chance: one wall would have to have moved by just what it is off.
AS_GIVEN, MARKED = (0.003, 0.003, 0.003, 0.001, 0.001, 0.001), 6.0  # [m, rad], and of the log likelihood
FAR_OFF = 4.0  # standard deviations, from where on it has moved
# Share of elements that moved, the logarithm of the range of what they may be off, and the least of it [m].
MOVED, SIZES, LEAST_MOVED = 0.1, 6.0, 0.001
AS_GOOD = 5.0  # of the log likelihood: poses worse by no more are kept
WORSE = 40.0  # and those that other scans may tell to be right all the same
ANCHORS = 8  # faces that a solution is begun from, each believed alone
ROUNDS = 30
# What other scans hold, they hold whatever moved: its faces alone would lay it at the pose's door.
BY_OTHERS = (0.005, 0.005, 0.005, 0.002, 0.002, 0.002)  # [m, rad]
# Believed; as given, and fits; moved until it fit; moved until it fit other scans.
EXACT, KEPT, REGISTERED, HELD = TRUSTS = ("exact", "kept", "registered", "held")


class _Solution(NamedTuple):
    """A correction that faces agree on."""

    cost: float  # negative log likelihood
    step: np.ndarray  # (6,)
    told: np.ndarray  # (6, 6) normal equations, of faces and of what was known before
    right: np.ndarray  # (6,)
    votes: np.ndarray  # (G,) of the faces in these


class PoseError(NamedTuple):
    """A correction that may be: what tells of it, in the form of normal equations."""

    told: np.ndarray  # (6, 6) information of all faces, and of what was known before
    right: np.ndarray  # (6,)
    place: float  # [m] standard deviation of faces that stand in their place, off it
    tilt: np.ndarray  # (2,) [m] and of their ends off where their middles have them, along their axes
    votes: np.ndarray = np.zeros(0)  # (G,) with which faces told of it, by their numbers
    share: float = 1.0  # how likely it is, of all that may be
    among: int = -1  # scans of one number have the poses at one place of their lists at once; -1: none goes with it
    instead: tuple["PoseError", ...] = ()  # poses of its scan that are as likely by it alone, and others ruled out

    @property
    def correction(self) -> np.ndarray:
        """(6,) [m, rad]; 0 of a pose that is believed."""
        if not np.isfinite(self.told).all():
            return np.zeros(6)
        return -np.linalg.solve(self.told, self.right)

    @property
    def covariance(self) -> np.ndarray:
        """(6, 6) of the correction; 0 of a pose that is believed."""
        return np.linalg.inv(self.told) if np.isfinite(self.told).all() else np.zeros((6, 6))

    def without(self, fits: list[Fit], sensor: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Correction (6,) and its covariance (6, 6) by all but some faces.

        A wall is no witness of where it stands itself: a pose that it helped to tell would draw it to its place, by
        more than what the others leave open.
        """
        if not np.isfinite(self.told).all():
            return np.zeros(6), np.zeros((6, 6))
        told, right = self.told_without(fits, sensor)
        # Nothing is known worse than before any face was seen; rounding must not say so either.
        square, axes = np.linalg.eigh(told * np.outer(GIVEN, GIVEN))
        spread = (axes / np.maximum(square, 1.0)) @ axes.T * np.outer(GIVEN, GIVEN)
        return -spread @ right, spread

    def told_without(self, fits: list[Fit], sensor: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """`told` and `right` without the votes of some faces."""
        voters = [fit for fit in fits if 0 <= fit.number < len(self.votes)]
        if not voters:
            return self.told, self.right
        votes = self.votes[[fit.number for fit in voters]]
        own, right = _normal(*_told_by(voters, sensor, self.place, self.tilt), votes)
        return self.told - own, self.right - right


EXACTLY = PoseError(np.full((6, 6), np.inf), np.zeros(6), USUAL_PLACE, USUAL_TILT)  # of a pose that is believed


def rows_of(fit: Fit, about: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Level and slopes (3,) of a face, and how they change (3, 6) with a shift and a turn about a place."""
    rows, (x, y, z) = np.zeros((3, 6)), fit.normal
    rows[0, :3] = fit.normal
    # Products across the normal, written out: of three vectors `np.cross` takes ten times as long.
    across = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    rows[0, 3:], rows[1:, 3:] = (fit.middle - about) @ across, fit.axes @ across
    return np.array([fit.level, *fit.slope]), rows


def scatter(fit: Fit, place: float, tilt: np.ndarray) -> np.ndarray:
    """(3,) standard deviations of level and slopes of a face that may be so far off its place, and its ends (2,)."""
    return np.sqrt(np.diag(fit.variance) + np.square([place, *(tilt / _wide(fit))]))


def _wide(fit: Fit) -> np.ndarray:
    """(2,) [m] over which slopes are seen."""
    return np.maximum(2.0 * fit.extent, 0.1)


def likely_poses(found: list[PoseError]) -> tuple[list[PoseError], list[PoseError]]:
    """Of `pose_errors` those that are about as likely as the best, and the others."""
    least = found[0].share * np.exp(-AS_GOOD)
    likely = [one for one in found if one.share >= least]
    every = sum(one.share for one in likely)
    return [one._replace(share=one.share / every) for one in likely], found[len(likely) :]


def pose_errors(fits: list[Fit], sensor: np.ndarray, trust: str = REGISTERED) -> list[PoseError]:
    """Corrections that explain the faces of a scan, the likeliest first; never empty.

    Beside those that one scan may believe (`likely_poses`) stand others that only other scans can tell to be right.

    Args:
        fits: of one scan, each with its number in this list.
        sensor: (3,) [m].
        trust: one of TRUSTS, in its pose.
    """
    if trust == EXACT:
        place, tilt = _scatters(fits, *rows_of_all(fits, sensor), EXACTLY.correction, 0)
        return [EXACTLY._replace(place=place, tilt=tilt)]
    known = [(BY_OTHERS if trust == HELD else GIVEN, 0.0)]
    if trust == KEPT:
        known = [(AS_GIVEN, 0.0), (GIVEN, MARKED)]
    if not fits:
        return [PoseError(np.diag(1.0 / np.square(known[0][0])), np.zeros(6), USUAL_PLACE, USUAL_TILT)]
    new = USUAL_PLACE, USUAL_TILT
    for _ in range(3):
        place, tilt = new
        off, rows, sigma = _told_by(fits, sensor, place, tilt)
        found = [one for given, cost in known for one in _solutions(off, rows, sigma, given, cost)]
        found.sort(key=lambda one: one.cost)
        new = _scatters(fits, off, rows, found[0].step, 6)
    apart: list[PoseError] = []
    for cost, step, told, right, votes in found:
        if cost > found[0].cost + WORSE:
            break
        # One that is within what a likelier one leaves open says nothing else.
        if all((lag := step - one.correction) @ one.told @ lag > 1.0 for one in apart):
            apart.append(PoseError(told, right, place, tilt, votes, float(np.exp(found[0].cost - cost))))
    every = sum(one.share for one in apart)
    return [one._replace(share=one.share / every) for one in apart]


def _scatters(
    fits: list[Fit], off: np.ndarray, rows: np.ndarray, step: np.ndarray, free: int
) -> tuple[float, np.ndarray]:
    """[m] how much faces in their place scatter about it, and their ends, by what a correction leaves of them."""
    left = off + rows @ step
    errors = np.array([np.diag(fit.variance) for fit in fits]).reshape(-1, 3)
    wide = np.array([_wide(fit) for fit in fits]).reshape(-1, 2)
    known = errors[:, 1:] < (UNKNOWN_SLOPE / 2.0) ** 2
    ends, of_ends = left[:, 1:] * wide, errors[:, 1:] * wide**2
    # Walls may be turned where none leans.
    tilt = [_scatter_of(ends[one, axis], of_ends[one, axis], free / 2) for axis, one in enumerate(known.T)]
    return _scatter_of(left[:, 0], errors[:, 0], free / 2), np.array(tilt)


def _scatter_of(left: np.ndarray, errors: np.ndarray, free: float) -> float:
    """[m] standard deviation of what stands in its place, by what is left (n,), where so many numbers were fitted.

    Beside the errors of the rays, of which the variances (n,) are known: these come to it anyway. The mean of what may
    be: of few faces, or of rays that err by more, one knows little more than what is usual.
    """
    known, count = len(left), max(len(left) - free, 0.0)
    if known < 3 or count == 0.0:
        return USUAL_PLACE
    variance = errors + np.square(SCATTERS)[:, None]
    square = np.square(left) * (known / count)
    moved = MOVED / (2.0 * SIZES * np.maximum(np.abs(left), LEAST_MOVED))
    likely = np.log((1.0 - MOVED) * np.exp(-square / variance / 2.0) / np.sqrt(2.0 * np.pi * variance) + moved)
    likely = likely.sum(axis=1) * (count / known) - np.square(np.log(SCATTERS / USUAL_PLACE) / USUAL_RANGE) / 2.0
    share = np.exp(likely - likely.max())
    return float(np.sqrt(share @ np.square(SCATTERS) / share.sum()))


def _told_by(
    fits: list[Fit], sensor: np.ndarray, place: float, tilt: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Levels and slopes (G, 3) of faces, how they change (G, 3, 6), and their standard deviations (G, 3)."""
    return *rows_of_all(fits, sensor), np.stack([scatter(fit, place, tilt) for fit in fits])


def rows_of_all(fits: list[Fit], about: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """`rows_of` each of G faces: (G, 3), (G, 3, 6)."""
    told = [rows_of(fit, about) for fit in fits]
    return np.array([off for off, _ in told]).reshape(-1, 3), np.array([rows for _, rows in told]).reshape(-1, 3, 6)


def _solutions(
    off: np.ndarray, rows: np.ndarray, sigma: np.ndarray, given: tuple[float, ...], cost: float
) -> list[_Solution]:
    """Each pose that faces agree on, all or all but one."""
    prior = np.diag(1.0 / np.square(given))
    surest = np.argsort(sigma[:, 0])[:ANCHORS]
    starts = [np.zeros(6)]
    for one in surest:
        told, right = _normal(off[[one]], rows[[one]], sigma[[one]], np.ones(1))
        starts.append(-np.linalg.solve(told + prior, right))
    found: list[_Solution] = []

    def add(step: np.ndarray, silent: int | None) -> None:
        for weigh in (_weights, _votes):  # from afar softly, then each face by how likely it stands in its place
            for _ in range(ROUNDS):
                votes = weigh(off, rows, sigma, step)
                if silent is not None:
                    votes[silent] = 0.0
                told, right = _normal(off, rows, sigma, votes)
                last, step = step, -np.linalg.solve(told + prior, right)
                if np.abs(step - last).max() < 1e-7:
                    break
        square = np.square((off + rows @ step) / sigma).max(axis=1)
        total = cost + float(surprise(square).sum()) + 0.5 * float(step @ prior @ step)
        is_other = silent is None or square[silent] > FAR_OFF**2
        if is_other and all(np.abs(step - other.step).max() > 1e-4 for other in found):
            found.append(_Solution(total, step, told + prior, right, votes))

    for start in starts:
        add(start, None)
    best = min(found, key=lambda one: one.cost).step
    for one in surest:  # what if just this one moved?
        add(best, int(one))
    return found


def surprise(square: np.ndarray) -> np.ndarray:
    """(...) how unlikely faces are (negative log likelihood), by the squares of their standard deviations off.

    What moved may have by millimetres or by decimetres, one as likely as the other: of two poses that each leave one
    wall off, that which leaves it less far off is hardly the likelier one.
    """
    stands, moved = _likely(square)
    return -np.log(stands + moved)


def _likely(square: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(G,) densities of what stands in its place, and of what moved, by the squares of standard deviations off."""
    stands = (1.0 - MOVED) / np.sqrt(2.0 * np.pi) * np.exp(-square / 2.0)
    return stands, MOVED / (2.0 * SIZES * np.maximum(np.sqrt(square), 1.0))


def _votes(off: np.ndarray, rows: np.ndarray, sigma: np.ndarray, step: np.ndarray) -> np.ndarray:
    """(G,) how likely faces stand in their place after a correction: what each then tells of it."""
    return votes_of(np.square((off + rows @ step) / sigma).max(axis=1))


def votes_of(square: np.ndarray) -> np.ndarray:
    """(...) the same, by the squares of the standard deviations that they are off."""
    stands, moved = _likely(square)
    return stands / (stands + moved)


def _weights(off: np.ndarray, rows: np.ndarray, sigma: np.ndarray, step: np.ndarray) -> np.ndarray:
    """(G,) votes of faces after a correction: by their level, or their slopes, whichever is farther off."""
    return 1.0 / (1.0 + np.square((off + rows @ step) / sigma).max(axis=1) / SOFT**2)


def _normal(off: np.ndarray, rows: np.ndarray, sigma: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Normal equations (6, 6) and (6,) of weighted faces."""
    scaled = rows / sigma[..., None]
    return np.einsum("g,gij,gik->jk", weight, scaled, scaled), np.einsum("g,gij,gi->j", weight, scaled, off / sigma)
