"""What the rays of some scans say about upright rectangles in space: passed through, hit, or hidden.

N points, S scans. World frame: metres, z up. Each point stands for the ray that ended on it; a direction without a
point tells nothing.
"""

from typing import NamedTuple

import numpy as np

from jaxmm.vectors import lengths

HIGHEST = 0.9  # quantile of heights, from which points tell of the ceiling above them; the lowest tell of the floor
LEAST_RAYS = 3  # toward a patch, before it can be called free


class Sight(NamedTuple):
    """The points of some scans, where each was seen from, and the room that they are in."""

    points: np.ndarray  # (N, 3) float64 [m]
    origin: np.ndarray  # (N, 3) float64 [m] the sensor of the scan that the point is of
    floor: float  # [m]
    ceiling: float
    levels: np.ndarray | None = None  # (N, 2) [m] floor and ceiling of each point; None: those above are of all

    def around(self, members: np.ndarray) -> "Sight":
        """The same with floor and ceiling of some points (n,) int: of the lowest and of the highest tenth of them."""
        if self.levels is None:
            return self
        z, (floor, ceiling) = self.points[members, 2], self.levels[members].T
        lowest, highest = np.quantile(z, (1.0 - HIGHEST, HIGHEST))
        return self._replace(
            floor=float(np.median(floor[z <= lowest])), ceiling=float(np.median(ceiling[z >= highest]))
        )


class Patch(NamedTuple):
    """An upright rectangle."""

    start: np.ndarray  # (2,) [m] in plan
    end: np.ndarray  # (2,)
    low: float  # [m]
    high: float


def upright_patch(sight: Sight, start: np.ndarray, end: np.ndarray, rim: float) -> Patch:
    """The patch between two places (2,) [m] in plan, from floor to ceiling but for a rim [m] at both."""
    return Patch(start, end, sight.floor + rim, sight.ceiling - rim)


class Crossings(NamedTuple):
    """How many of the rays that head for a patch end where."""

    beyond: int
    on: int
    before: int

    @property
    def total(self) -> int:
        """All rays that head for the patch."""
        return self.beyond + self.on + self.before

    @property
    def free(self) -> float:
        """Share of the rays that went through; 0 where there are too few to tell."""
        return self.beyond / self.total if self.total >= LEAST_RAYS else 0.0


def sensors_of(points: np.ndarray, sensors: np.ndarray, scan: np.ndarray | None) -> np.ndarray:
    """The sensor (N, 3) [m] that saw each point: that of its scan (N,) int, or, where None, the nearest of (S, 3)."""
    if scan is None:
        apart = [lengths(points - sensor) for sensor in sensors]
        scan = np.argmin(apart, axis=0)
    return sensors[scan]


def crossings(sight: Sight, patch: Patch, margin: float) -> Crossings:
    """Where rays that head for a patch end: more than a margin [m] beyond its plane, before it, or on it."""
    return crossings_along(sight, patch, margin, 1)[0]


def crossings_along(sight: Sight, patch: Patch, margin: float, parts: int) -> list[Crossings]:
    """The same of each of some equal parts of a patch, from its start to its end."""
    place, past = _heading(sight, patch)
    part = np.minimum((place * parts).astype(int), parts - 1)
    ended = (past > margin, np.abs(past) <= margin, past < -margin)
    counts = np.stack([np.bincount(part[one], minlength=parts) for one in ended], axis=1)
    return [Crossings(*map(int, one)) for one in counts]


def _heading(sight: Sight, patch: Patch) -> tuple[np.ndarray, np.ndarray]:
    """Of the rays that head for a patch: where along it, from 0 to 1, and how far [m] beyond its plane they end."""
    length = float(np.linalg.norm(patch.end - patch.start))
    if length < 1e-6 or patch.high <= patch.low:
        return np.zeros(0), np.zeros(0)
    along = (patch.end - patch.start) / length
    across = np.array([-along[1], along[0]])
    offset = sight.points - sight.origin
    height, reach = (patch.start - sight.origin[:, :2]) @ across, offset[:, :2] @ across
    with np.errstate(divide="ignore", invalid="ignore"):  # rays along the plane never meet it
        part = height / reach  # of the way to the point, at which the ray meets the plane
        place = (sight.origin[:, :2] + part[:, None] * offset[:, :2] - patch.start) @ along
        z = sight.origin[:, 2] + part * offset[:, 2]
        heads = (part > 0.0) & (place >= 0.0) & (place <= length) & (z >= patch.low) & (z <= patch.high)
    return place[heads] / length, (np.abs(reach) - np.abs(height))[heads]
