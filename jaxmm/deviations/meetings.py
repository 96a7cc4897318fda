"""Where rays end near the face that they should meet: what as-built places are measured from.

P rays of one scan, K of them that meet some face of the model, T triangles, G groups. Positions are offsets from the
prior's origin, world axes: metres, z up.

A group is what one scan shows of the faces of one element that look one way: of a wall one side, of a round column a
sixth of its shaft. Faces are told by the ray itself, not by what is nearest: of a wall that moved by its own thickness,
the nearest face is its back, which no ray of this side ends on.
"""

import itertools
from typing import NamedTuple

import numpy as np

from jaxmm.rays.hits import Hits, hits_of
from jaxmm.rays.scan_rays import ScanRays
from jaxmm.rays.shared_ends import shared_rays
from jaxmm.vectors import lengths
from warp_scanner.sensors.triangles import TriangleScene

MOST_OFF = 0.45  # [m] off a face, beyond which a ray does not tell where it stands
LEAST_COSINE = 0.15  # of the incidence: flatter rays end anywhere
WAYS = 24  # of normals in plan, that are told apart
MOST = 5000  # rays that tell of one face
STEEP = 0.7  # a normal that rises by more is of a floor, or a ceiling


class Meetings(NamedTuple):
    """K rays of one scan that should meet a face, those of one group after another."""

    element: np.ndarray  # (K,) int32
    group: np.ndarray  # (K,) int64: element and way that the face looks
    normal: np.ndarray  # (K, 3) float64 unit vectors toward the sensor
    end: np.ndarray  # (K, 3) float64 [m] where the ray ended
    off: np.ndarray  # (K,) float64 [m] off the face: before it positive, behind it negative
    reach: np.ndarray  # (K,) float64 [m] from the sensor
    own: np.ndarray  # (K,) float64 [m] the same as the sensor measured it: `reach` may have settled since
    sensor: np.ndarray  # (3,) float64 [m]
    every: int = 1  # rays that each stands for, of a group of many

    def of(self, chosen: np.ndarray | slice) -> "Meetings":
        """Some of them: a mask, places (k,), or a slice."""
        return Meetings(*(field[chosen] for field in self[:-2]), self.sensor, self.every)

    def as_measured(self) -> "Meetings":
        """The same where the sensor measured them: what settles is smooth, but cuts corners, and bends at edges."""
        if np.array_equal(self.own, self.reach):
            return self
        way = (self.end - self.sensor) / self.reach[:, None]
        more = self.own - self.reach
        off = self.off + np.einsum("kc,kc->k", self.normal, way) * more
        return self._replace(end=self.end + way * more[:, None], off=off, reach=self.own)

    def thinned(self) -> "Meetings":
        """At most MOST of them: more tell a face no better, for neighbours err alike."""
        every = -(-len(self.off) // MOST)
        return self if every <= 1 else self.of(slice(None, None, every))._replace(every=every)


def meetings_of(
    scene: TriangleScene, rays: ScanRays, own: np.ndarray | None = None, clear: np.ndarray | None = None
) -> Meetings:
    """All rays of a scan that come back, and should meet a face at no flat angle, which is not of another, too.

    Args:
        scene: the model.
        rays: of the scan.
        own: (rays.measured,) [m] ranges as the sensor measured them, as of `own_ranges`; None: those of the rays.
        clear: (T,) bool, triangles that let rays pass: what ends behind them tells nothing of them; None: none does.
    """
    expected = hits_of(scene, rays.position, rays.direction)
    shared = shared_rays(scene, rays, expected)[: rays.measured]
    expected = Hits(*(field[: rays.measured] for field in expected))
    direction, distance = rays.direction[: rays.measured], rays.distance[: rays.measured].astype(np.float64)
    with np.errstate(invalid="ignore"):  # rays that meet nothing have no cosine
        tells = np.isfinite(distance) & (np.abs(expected.cosine) > LEAST_COSINE) & ~shared
    if clear is not None:
        tells &= ~clear[expected.face]
    hit = np.flatnonzero(tells)
    way, normal = direction[hit].astype(np.float64), expected.normal[hit].astype(np.float64)
    way /= lengths(way)[:, None]
    cosine = -np.einsum("kc,kc->k", normal, way)
    normal, cosine = normal * np.sign(cosine)[:, None], np.abs(cosine)
    element, distance, reach = expected.element[hit], distance[hit], expected.distance[hit].astype(np.float64)
    found = Meetings(
        element, element * np.int64(WAYS + 2) + _ways(normal), normal, rays.position + way * distance[:, None],
        (reach - distance) * cosine, distance, distance if own is None else own[hit].astype(np.float64),
        np.asarray(rays.position, np.float64),
    )  # fmt: skip
    return found.of(np.argsort(found.group, kind="stable"))


def _ways(normal: np.ndarray) -> np.ndarray:
    """(K,) int below WAYS + 2: which way normals (K, 3) look; up, down, or by their angle in plan."""
    turn = np.arctan2(normal[:, 1], normal[:, 0])
    # Drawn walls run along axes: no border between two ways may lie there, for rounding would part one face.
    around = np.round(turn * (WAYS / (2.0 * np.pi))).astype(np.int64) % WAYS
    return np.where(normal[:, 2] > STEEP, WAYS, np.where(normal[:, 2] < -STEEP, WAYS + 1, around))


def groups_of(found: Meetings) -> list[slice]:
    """The rays of each group, in the order that `meetings_of` gives."""
    edges = [*np.flatnonzero(np.diff(found.group, prepend=-1)).tolist(), len(found.group)]
    return [slice(a, b) for a, b in itertools.pairwise(edges)]
