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

from jaxmm.deviations.fits import Fit
from jaxmm.rays.open_directions import GIVEN

LEAST_PLACE, USUAL_PLACE, MOST_PLACE = 0.0003, 0.003, 0.01  # [m] by which faces in their place scatter
ENOUGH = 10  # faces that tell how much they scatter
SOFT = 2.0  # standard deviations, from where on a face loses its vote
# A pose that fits as it was given hardly does so by chance: one wall would have to have moved by just what it is off.
AS_GIVEN, MARKED = (0.003, 0.003, 0.003, 0.001, 0.001, 0.001), 4.0  # [m, rad], and of the log likelihood
AS_GOOD = 2.0  # of the log likelihood: poses worse by no more are kept
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
        off, rows, sigma = _told_by(fits, sensor, self.place)
        own = _normal(off, rows, sigma, _weights(off, rows, sigma, self.correction))[0]
        # Nothing is known worse than before any face was seen; rounding must not say so either.
        square, axes = np.linalg.eigh((self.told - own) * np.outer(GIVEN, GIVEN))
        return (axes / np.maximum(square, 1.0)) @ axes.T * np.outer(GIVEN, GIVEN)


EXACTLY = PoseError(np.full((6, 6), np.inf), np.zeros(6), USUAL_PLACE)  # of a pose that is believed


def rows_of(fit: Fit, about: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Level and slopes (3,) of a face, and how they change (3, 6) with a shift and a turn about a place."""
    arm = fit.middle - about
    rows = np.zeros((3, 6))
    rows[0] = [*fit.normal, *np.cross(arm, fit.normal)]
    rows[1:, 3:] = np.cross(fit.axes, fit.normal)
    return np.array([fit.level, *fit.slope]), rows


def scatter(fit: Fit, place: float) -> np.ndarray:
    """(3,) standard deviations of level and slopes, of a face that may stand off its place by so much [m]."""
    wide = np.maximum(2.0 * fit.extent, 0.1)
    return np.sqrt(np.diag(fit.variance) + np.square([place, *(place / wide)]))


def pose_errors(fits: list[Fit], sensor: np.ndarray, trust: str = REGISTERED) -> list[PoseError]:
    """Corrections that explain the faces of a scan, the likeliest first; never empty.

    Args:
        fits: of one scan.
        sensor: (3,) [m].
        trust: one of TRUSTS, in its pose.
    """
    if trust == EXACT:
        return [EXACTLY._replace(place=_place_of(fits, np.array([fit.level for fit in fits]), 0))]
    known = [(BY_OTHERS if trust == HELD else GIVEN, 0.0)]
    if trust == KEPT:
        known = [(AS_GIVEN, 0.0), (GIVEN, MARKED)]
    if not fits:
        return [PoseError(np.diag(1.0 / np.square(known[0][0])), np.zeros(6), USUAL_PLACE)]
    new = USUAL_PLACE
    for _ in range(3):
        place = new
        off, rows, sigma = _told_by(fits, sensor, place)
        found = [one for given, cost in known for one in _solutions(off, rows, sigma, given, cost)]
        found.sort(key=lambda one: one[0])
        new = _place_of(fits, off[:, 0] + rows[:, 0] @ found[0][1], 6)
    return [PoseError(told, right, place) for cost, _, told, right in found if cost < found[0][0] + AS_GOOD]


def _place_of(fits: list[Fit], level: np.ndarray, free: int) -> float:
    """[m] how much faces in their place scatter about it, by what is left (G,) of them."""
    if len(fits) < 3:
        return USUAL_PLACE
    seen = 1.4826 * float(np.median(np.abs(level))) * np.sqrt(len(fits) / max(len(fits) - free / 2, 1.0))
    if len(fits) < ENOUGH and seen > LEAST_PLACE:  # few tell little of it
        share = len(fits) / ENOUGH
        seen = np.sqrt(share * seen**2 + (1.0 - share) * USUAL_PLACE**2)
    return float(np.clip(seen, LEAST_PLACE, MOST_PLACE))


def _told_by(fits: list[Fit], sensor: np.ndarray, place: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Levels and slopes (G, 3) of faces, how they change (G, 3, 6), and their standard deviations (G, 3)."""
    off, rows = (np.stack(part) for part in zip(*(rows_of(fit, sensor) for fit in fits), strict=True))
    return off, rows, np.stack([scatter(fit, place) for fit in fits])


def _solutions(
    off: np.ndarray, rows: np.ndarray, sigma: np.ndarray, given: tuple[float, ...], cost: float
) -> list[tuple[float, np.ndarray, np.ndarray, np.ndarray]]:
    """Cost, correction and normal equations of each pose that faces agree on."""
    prior = np.diag(1.0 / np.square(given))
    surest = np.argsort(sigma[:, 0])[:ANCHORS]
    starts = [np.zeros(6)]
    for one in surest:
        told, right = _normal(off[[one]], rows[[one]], sigma[[one]], np.ones(1))
        starts.append(-np.linalg.solve(told + prior, right))
    found: list[tuple[float, np.ndarray, np.ndarray, np.ndarray]] = []
    for step in starts:
        for _ in range(ROUNDS):
            told, right = _normal(off, rows, sigma, _weights(off, rows, sigma, step))
            last, step = step, -np.linalg.solve(told + prior, right)
            if np.abs(step - last).max() < 1e-7:
                break
        square = np.square((off + rows @ step) / sigma).max(axis=1)
        total = cost + SOFT**2 / 2 * np.log1p(square / SOFT**2).sum() + 0.5 * float(step @ prior @ step)
        if all(np.abs(step - other[1]).max() > 1e-4 for other in found):
            found.append((float(total), step, told + prior, right))
    return found


def _weights(off: np.ndarray, rows: np.ndarray, sigma: np.ndarray, step: np.ndarray) -> np.ndarray:
    """(G,) votes of faces after a correction: by their level, or their slopes, whichever is farther off."""
    return 1.0 / (1.0 + np.square((off + rows @ step) / sigma).max(axis=1) / SOFT**2)


def _normal(off: np.ndarray, rows: np.ndarray, sigma: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Normal equations (6, 6) and (6,) of weighted faces."""
    scaled = rows / sigma[..., None]
    return np.einsum("g,gij,gik->jk", weight, scaled, scaled), np.einsum("g,gij,gi->j", weight, scaled, off / sigma)
