"""How far off a scan's pose may still be, told by all faces it sees together.

G fitted faces of one scan. World axes: metres, radians. A correction is a shift and a rotation vector (6,) about the
sensor, which moves the points of the scan.

Most of what is built stands where it is drawn, and something stands anywhere: the faces vote for a pose with weights
that fall with how far off they then are (Cauchy), so one wall that moved does not drag the rest, and drift is not laid
at the elements' door (as Bassier, Vincke, De Winter and Vergauwen 2020, "Drift invariant metric quality control of
construction sites using BIM and point cloud data", ISPRS Int. J. Geo-Inf. 9(9), 545). Where two poses explain as much,
as between two walls of which one moved, both stay, and intervals hold both.
"""

from typing import NamedTuple

import numpy as np

from jaxmm.deviations.fits import UNKNOWN_SLOPE, Fit
from jaxmm.rays.open_directions import GIVEN

LEAST_PLACE, USUAL_PLACE, MOST_PLACE = 0.0001, 0.001, 0.01  # [m] by which faces in their place scatter
ENOUGH = 10  # faces that tell how much they scatter
SOFT = 2.0  # standard deviations, from where on a face loses its vote
# A pose that fits as it was given hardly does so by chance: one wall would have to have moved by just what it is off.
AS_GIVEN, MARKED = (0.003, 0.003, 0.003, 0.001, 0.001, 0.001), 6.0  # [m, rad], and of the log likelihood
FAR_OFF = 4.0  # standard deviations, from where on it has moved
MOVED, SIZES = 0.1, 6.0  # share of elements, and the logarithm of the range of what they may be off
AS_GOOD = 3.0  # of the log likelihood: poses worse by no more are kept
ANCHORS = 8  # faces that a solution is begun from, each believed alone
ROUNDS = 30
# What other scans hold, they hold whatever moved: its faces alone would lay it at the pose's door.
BY_OTHERS = (0.005, 0.005, 0.005, 0.002, 0.002, 0.002)  # [m, rad]
# Believed; as given, and fits; moved until it fit; moved until it fit other scans.
EXACT, KEPT, REGISTERED, HELD = TRUSTS = ("exact", "kept", "registered", "held")


class PoseError(NamedTuple):
    """A correction that may be: what tells of it, in the form of normal equations."""

    told: np.ndarray  # (6, 6) information of all faces, and of what was known before
    right: np.ndarray  # (6,)
    place: float  # [m] standard deviation of faces that stand in their place, off it
    tilt: float  # [m] and of their ends off where their middles have them

    @property
    def correction(self) -> np.ndarray:
        """(6,) [m, rad]; 0 of a pose that is believed."""
        if not np.isfinite(self.told).all():
            return np.zeros(6)
        return -np.linalg.solve(self.told, self.right)

    def without(self, fits: list[Fit], sensor: np.ndarray) -> np.ndarray:
        """Covariance (6, 6) by all but some faces: a pose that one wall alone tells is no witness of that wall."""
        if not np.isfinite(self.told).all():
            return np.zeros((6, 6))
        off, rows, sigma = _told_by(fits, sensor, self.place, self.tilt)
        own = _normal(off, rows, sigma, _weights(off, rows, sigma, self.correction))[0]
        # Nothing is known worse than before any face was seen; rounding must not say so either.
        square, axes = np.linalg.eigh((self.told - own) * np.outer(GIVEN, GIVEN))
        return (axes / np.maximum(square, 1.0)) @ axes.T * np.outer(GIVEN, GIVEN)


EXACTLY = PoseError(np.full((6, 6), np.inf), np.zeros(6), USUAL_PLACE, USUAL_PLACE)  # of a pose that is believed


def rows_of(fit: Fit, about: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Level and slopes (3,) of a face, and how they change (3, 6) with a shift and a turn about a place."""
    arm = fit.middle - about
    rows = np.zeros((3, 6))
    rows[0] = [*fit.normal, *np.cross(arm, fit.normal)]
    rows[1:, 3:] = np.cross(fit.axes, fit.normal)
    return np.array([fit.level, *fit.slope]), rows


def scatter(fit: Fit, place: float, tilt: float) -> np.ndarray:
    """(3,) standard deviations of level and slopes of a face that may be so far off its place [m], and its ends."""
    return np.sqrt(np.diag(fit.variance) + np.square([place, *(tilt / _wide(fit))]))


def _wide(fit: Fit) -> np.ndarray:
    """(2,) [m] over which slopes are seen."""
    return np.maximum(2.0 * fit.extent, 0.1)


def pose_errors(fits: list[Fit], sensor: np.ndarray, trust: str = REGISTERED) -> list[PoseError]:
    """Corrections that explain the faces of a scan, the likeliest first; never empty.

    Args:
        fits: of one scan.
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
        return [PoseError(np.diag(1.0 / np.square(known[0][0])), np.zeros(6), USUAL_PLACE, USUAL_PLACE)]
    new = USUAL_PLACE, USUAL_PLACE
    for _ in range(3):
        place, tilt = new
        off, rows, sigma = _told_by(fits, sensor, place, tilt)
        found = [one for given, cost in known for one in _solutions(off, rows, sigma, given, cost)]
        found.sort(key=lambda one: one[0])
        new = _scatters(fits, off, rows, found[0][1], 6)
    return [PoseError(told, right, place, tilt) for cost, _, told, right in found if cost < found[0][0] + AS_GOOD]


def _scatters(fits: list[Fit], off: np.ndarray, rows: np.ndarray, step: np.ndarray, free: int) -> tuple[float, float]:
    """[m] how much faces in their place scatter about it, and their ends, by what a correction leaves of them."""
    left = off + rows @ step
    errors = np.array([np.diag(fit.variance) for fit in fits]).reshape(-1, 3)
    wide = np.array([_wide(fit) for fit in fits]).reshape(-1, 2)
    known = errors[:, 1:] < (UNKNOWN_SLOPE / 2.0) ** 2
    ends, of_ends = left[:, 1:] * wide, errors[:, 1:] * wide**2
    # Walls may be turned where none leans.
    tilt = max(_scatter_of(ends[one, axis], of_ends[one, axis], free / 2) for axis, one in enumerate(known.T))
    return _scatter_of(left[:, 0], errors[:, 0], free / 2), tilt


def _scatter_of(left: np.ndarray, errors: np.ndarray, free: float) -> float:
    """[m] standard deviation of most of what is left (n,), where so many numbers were fitted.

    Beside the errors of the rays, of which the variances (n,) are known: these come to it anyway.
    """
    if len(left) < 3:
        return USUAL_PLACE
    seen = 1.4826 * float(np.median(np.abs(left))) * np.sqrt(len(left) / max(len(left) - free, 1.0))
    seen = np.sqrt(max(seen**2 - float(np.median(errors)), LEAST_PLACE**2))
    if len(left) < ENOUGH:  # few tell little of it
        share = len(left) / ENOUGH
        seen = max(seen, seen**share * USUAL_PLACE ** (1.0 - share))
    return float(np.clip(seen, LEAST_PLACE, MOST_PLACE))


def _told_by(
    fits: list[Fit], sensor: np.ndarray, place: float, tilt: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Levels and slopes (G, 3) of faces, how they change (G, 3, 6), and their standard deviations (G, 3)."""
    return *rows_of_all(fits, sensor), np.stack([scatter(fit, place, tilt) for fit in fits])


def rows_of_all(fits: list[Fit], about: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """`rows_of` each of G faces: (G, 3), (G, 3, 6)."""
    told = [rows_of(fit, about) for fit in fits]
    return np.array([off for off, _ in told]).reshape(-1, 3), np.array([rows for _, rows in told]).reshape(-1, 3, 6)


def _solutions(
    off: np.ndarray, rows: np.ndarray, sigma: np.ndarray, given: tuple[float, ...], cost: float
) -> list[tuple[float, np.ndarray, np.ndarray, np.ndarray]]:
    """Cost, correction and normal equations of each pose that faces agree on, all or all but one."""
    prior = np.diag(1.0 / np.square(given))
    surest = np.argsort(sigma[:, 0])[:ANCHORS]
    starts = [np.zeros(6)]
    for one in surest:
        told, right = _normal(off[[one]], rows[[one]], sigma[[one]], np.ones(1))
        starts.append(-np.linalg.solve(told + prior, right))
    found: list[tuple[float, np.ndarray, np.ndarray, np.ndarray]] = []

    def add(step: np.ndarray, silent: int | None) -> None:
        for _ in range(ROUNDS):
            votes = _weights(off, rows, sigma, step)
            if silent is not None:
                votes[silent] = 0.0
            told, right = _normal(off, rows, sigma, votes)
            last, step = step, -np.linalg.solve(told + prior, right)
            if np.abs(step - last).max() < 1e-7:
                break
        square = np.square((off + rows @ step) / sigma).max(axis=1)
        total = cost + float(_surprise(square).sum()) + 0.5 * float(step @ prior @ step)
        is_other = silent is None or square[silent] > FAR_OFF**2
        if is_other and all(np.abs(step - other[1]).max() > 1e-4 for other in found):
            found.append((total, step, told + prior, right))

    for start in starts:
        add(start, None)
    best = min(found, key=lambda one: one[0])[1]
    for one in surest:  # what if just this one moved?
        add(best, int(one))
    return found


def _surprise(square: np.ndarray) -> np.ndarray:
    """(G,) how unlikely faces are (negative log likelihood), by the squares of their standard deviations off.

    What moved may have by millimetres or by decimetres, one as likely as the other: of two poses that each leave one
    wall off, that which leaves it less far off is hardly the likelier one.
    """
    moved = MOVED / (2.0 * SIZES * np.maximum(np.sqrt(square), 1.0))
    return -np.log((1.0 - MOVED) / np.sqrt(2.0 * np.pi) * np.exp(-square / 2.0) + moved)


def _weights(off: np.ndarray, rows: np.ndarray, sigma: np.ndarray, step: np.ndarray) -> np.ndarray:
    """(G,) votes of faces after a correction: by their level, or their slopes, whichever is farther off."""
    return 1.0 / (1.0 + np.square((off + rows @ step) / sigma).max(axis=1) / SOFT**2)


def _normal(off: np.ndarray, rows: np.ndarray, sigma: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Normal equations (6, 6) and (6,) of weighted faces."""
    scaled = rows / sigma[..., None]
    return np.einsum("g,gij,gik->jk", weight, scaled, scaled), np.einsum("g,gij,gi->j", weight, scaled, off / sigma)
