"""What the rays of a scan say of upright patches of space: crossed by a ray that went on, hidden, or met.

N points of some scans, S scans. World frame: metres, z up. The points stand for the rays that ended on them; a
direction without a point tells nothing.
"""

from typing import NamedTuple

import numpy as np

LEAST_RAYS = 3  # through a patch, before it is called free


class Sight(NamedTuple):
    """The points of some scans, and where each was seen from."""

    points: np.ndarray  # (N, 3) float64 [m]
    origin: np.ndarray  # (N, 3) float64 [m] the sensor of the scan that the point is of


class Patch(NamedTuple):
    """An upright rectangle."""

    start: np.ndarray  # (2,) [m] in plan
    end: np.ndarray  # (2,)
    low: float  # [m]
    high: float


class Crossings(NamedTuple):
    """How many rays that head for a patch end where."""

    beyond: int
    on: int
    before: int

    @property
    def free(self) -> float:
        """Share of the rays that went through, of all; 0 where there are too few to tell."""
        total = self.beyond + self.on + self.before
        return self.beyond / total if total >= LEAST_RAYS else 0.0


def sight_of(points: np.ndarray, sensors: np.ndarray, scan: np.ndarray | None) -> Sight:
    """The rays of points (N, 3) seen from sensors (S, 3), each from that of its scan (N,), or from the nearest."""
    points, sensors = np.asarray(points, np.float64), np.asarray(sensors, np.float64).reshape(-1, 3)
    if scan is None:
        apart = np.linalg.norm(points[:, None] - sensors, axis=2) if len(sensors) > 1 else np.zeros((len(points), 1))
        scan = np.argmin(apart, axis=1)
    return Sight(points, sensors[scan])


def crossings(sight: Sight, patch: Patch, margin: float) -> Crossings:
    """Where rays that head for a patch end: more than a margin [m] beyond its plane, before it, or on it."""
    length = float(np.linalg.norm(patch.end - patch.start))
    if length < 1e-6 or patch.high <= patch.low:
        return Crossings(0, 0, 0)
    along = (patch.end - patch.start) / length
    across = np.array([-along[1], along[0]])
    offset = sight.points - sight.origin
    height, reach = (patch.start - sight.origin[:, :2]) @ across, offset[:, :2] @ across
    with np.errstate(divide="ignore", invalid="ignore"):
        part = height / reach  # of the way to the point at which its ray meets the plane
        place = ((sight.origin[:, :2] + part[:, None] * offset[:, :2]) - patch.start) @ along
        z = sight.origin[:, 2] + part * offset[:, 2]
        heads = (part > 0.0) & (place >= 0.0) & (place <= length) & (z >= patch.low) & (z <= patch.high)
    past = (np.abs(reach) - np.abs(height))[heads]
    beyond, before = int(np.sum(past > margin)), int(np.sum(past < -margin))
    return Crossings(beyond, int(heads.sum()) - beyond - before, before)
