"""Rays that end where an element should be, on what another element has there as well: they are no support.

Where two walls overlap at a corner, or a column stands in a wall, one surface is of both. Is one of them gone, that
surface still ends rays, and were it to speak for what is gone, nothing could: behind an outer wall most rays bring
nothing back. So where an element's own surface, that nothing else has, ends hardly any ray, neither does what it shares
tell that it stands. Of elements without a surface of their own nobody knows better. P rays, n of one element. World
frame: metres.
"""

import numpy as np

from jaxmm.rays.hits import Hits
from jaxmm.rays.scan_rays import ScanRays
from jaxmm.rays.tilted_ends import Met, met_of
from warp_scanner.sensors.scan import Rays
from warp_scanner.sensors.triangles import TriangleScene, cast_triangles

LEAST_OWN = 20  # rays that should end on what is an element's alone
EMPTY = 0.1  # share of them that may end there though it is gone
MISSED = 0.03  # share of an element's rays that bring nothing back, or end behind it: with fewer it is not asked


def shared_rays(scene: TriangleScene, rays: ScanRays, expected: Hits) -> np.ndarray:
    """(P,) bool: `shared_ends` of the rays of a scan, with what they should meet."""
    return shared_ends(scene, rays.position, rays.direction, met_of(rays, expected)[0], rays.limit)


def shared_ends(
    scene: TriangleScene, position: np.ndarray, direction: np.ndarray, met: Met, limit: float = np.inf
) -> np.ndarray:
    """Rays that end where they should, but tell nothing of the element that they should meet.

    Args:
        scene: all elements.
        position: (3,) [m] of the sensor.
        direction: (P, 3) unit vectors.
        met: what they should meet, and where they end.
        limit: [m] beyond which nothing comes back in any case.

    Returns:
        (P,) bool.
    """
    shared = np.zeros(len(direction), bool)
    with np.errstate(invalid="ignore"):  # no return where none was expected
        apart = met.distance - met.expected
    should = (met.element >= 0) & (met.expected <= limit)
    ends, missed = should & (np.abs(apart) <= met.margin), should & (apart > met.margin)
    count = len(scene.triangles.semantic)
    on, off = (np.bincount(met.element[chosen], minlength=count) for chosen in (ends, missed))
    for row in np.flatnonzero((on > 0) & (off >= LEAST_OWN * (1.0 - EMPTY)) & (off >= MISSED * (on + off))):
        rays = np.flatnonzero((met.element == row) & (ends | missed))
        only = np.arange(count) == row
        behind = cast_triangles(scene, Rays(position[None], direction[rays]), ~only).distance[0]
        own = behind - met.expected[rays] > 2.0 * met.margin[rays]
        if own.sum() >= LEAST_OWN and ends[rays[own]].sum() <= EMPTY * own.sum():
            shared[rays[~own]] = ends[rays[~own]]
    return shared
