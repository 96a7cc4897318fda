"""Rays that end where an element should be, but on a surface that lies otherwise: they are no support.

The side of a cabinet, the top of a table or the floor cuts through the place of a wall that is gone: rays that end on
it within the margin would speak for the wall. The ends of the rays around tell how the surface lies (H. Hoppe et al.,
"Surface reconstruction from unorganized points", SIGGRAPH 1992: the plane of least squares through neighbours). P
rays, n of them asked. World frame: metres.
"""

from typing import NamedTuple

import numpy as np

from jaxmm.rays.evidence import margins
from jaxmm.rays.hits import Hits
from jaxmm.rays.near_rays import rays_around
from jaxmm.rays.noise_model import Noise, noise_of, sigma_at
from jaxmm.rays.pair_evidence import EVERY
from jaxmm.rays.scan_rays import ScanRays
from warp_scanner.clouds.sightlines import cells_of

CELL = np.radians(1.0)  # of one element in a cell of directions so wide nearly all ends lie as it does: none is asked
ALIKE_SHARE, FEW = 0.97, 8  # and those of cells with fewer rays
NEIGHBOURS = 20  # itself included
AROUND, SPACINGS = 0.06, 6.0  # [m], and times as far as rays are apart there: what ends farther off is something else
ON, SIGMAS = 0.01, 2.0  # [m], and of the standard deviations of ranges: ends this near to a plane lie on it
LEAST_AROUND = 0.6  # share of the neighbours that must tell of the surface
ONE_FACE = 0.9  # least cosine between surfaces of an element that are one face
MOST_ALIKE = 0.5  # share of the neighbours that should meet that face too: fewer may lie as it does
TILTED = np.cos(np.radians(40.0))  # most cosine between the surface and the element
FLAT = 0.25  # most thickness of the neighbours, in widths: else they lie on an edge, or noise hides how they lie
WIDE = 3.0  # least of these widths, in standard deviations of ranges
LEAST_WIDTH = 0.1  # and in lengths: what lies in one line, as along the ring of a spinning sensor, tells of no plane
AT_ONCE = 16_384  # rays


class Met(NamedTuple):
    """What rays should meet, and where they end."""

    distance: np.ndarray  # (P,) float32 [m] measured; inf: nothing came back
    expected: np.ndarray  # (P,) float32 [m]; inf: nothing
    element: np.ndarray  # (P,) int32, -1: none
    normal: np.ndarray  # (P, 3) unit normals of the surfaces that they should meet; of either sign
    margin: np.ndarray  # (P,) [m] within which ranges are taken for equal
    sigma: np.ndarray  # (P,) [m] standard deviation of the ranges


def noise_met(rays: ScanRays, expected: Hits) -> Noise:
    """How the ranges of a scan err, by those of its rays (P,) that should meet something and come back."""
    thin = slice(None, rays.measured, EVERY)
    with np.errstate(invalid="ignore"):  # no return where none was expected
        residual = rays.distance[thin] - expected.distance[thin]
    return noise_of(residual, expected.cosine[thin], expected.distance[thin])


def met_of(rays: ScanRays, expected: Hits) -> tuple[Met, Noise]:
    """What the rays of a scan meet, and how their ranges err."""
    noise = noise_met(rays, expected)
    sigma = sigma_at(noise, expected.distance)
    margin = margins(expected.cosine, sigma)
    return Met(rays.distance, expected.distance, expected.element, expected.normal, margin, sigma), noise


def tilted_ends(direction: np.ndarray, met: Met) -> np.ndarray:
    """Rays that end where they should, on a surface that surely lies otherwise.

    Where neighbours lie on an edge, in one line, or no farther apart than ranges err, nothing is sure.

    Args:
        direction: (P, 3) unit vectors, all from one place.
        met: what they meet.

    Returns:
        (P,) bool.
    """
    tilted = np.zeros(len(direction), bool)
    measured = np.flatnonzero(np.isfinite(met.distance))
    asked = _asked(direction, met)
    if len(measured) < NEIGHBOURS or not len(asked):
        return tilted
    near, _ = rays_around(direction[measured], direction[asked], NEIGHBOURS)
    for start in range(0, len(asked), AT_ONCE):
        part = slice(start, start + AT_ONCE)
        tilted[asked[part]] = _lie_otherwise(direction, met, asked[part], measured[near[part]])
    return tilted


def _asked(direction: np.ndarray, met: Met) -> np.ndarray:
    """The rays (n,) int that end where they should, but for those of cells in which nearly all lie as they should."""
    with np.errstate(invalid="ignore"):
        apart = np.abs(met.distance - met.expected)
        support = apart <= met.margin
        slope = np.abs(np.einsum("pc,pc->p", direction, met.normal))
        alike = apart * slope <= ON + SIGMAS * met.sigma
    should = np.flatnonzero(np.isfinite(met.expected) & np.isfinite(met.distance))
    cell = cells_of(direction[should], CELL)[0] * (int(met.element.max(initial=0)) + 1) + met.element[should]
    _, group, count = np.unique(cell, return_inverse=True, return_counts=True)
    share = np.bincount(group, alike[should]) / count
    return should[support[should] & ((share < ALIKE_SHARE) | (count < FEW))[group]]


def _lie_otherwise(direction: np.ndarray, met: Met, part: np.ndarray, near: np.ndarray) -> np.ndarray:
    """(n,) bool of the rays (n,) int with their neighbours (n, K) int."""
    tolerance = ON + SIGMAS * met.sigma[part]
    offset = _offsets(direction, met, part, near)
    beside = np.abs(np.einsum("nkc,nc->nk", offset, met.normal[part])) <= tolerance[:, None]
    faces = np.einsum("nkc,nc->nk", np.nan_to_num(met.normal[near]), met.normal[part])
    same = (met.element[near] == met.element[part, None]) & (np.abs(faces) >= ONE_FACE)
    alike, others = (same & beside).sum(axis=1) - 1, same.sum(axis=1) - 1  # all but itself
    found = alike < MOST_ALIKE * others  # of most rays more lie as they should: nobody needs to know how those lie
    found[found] = _on_tilted(direction, met, (part[found], near[found]), offset[found], tolerance[found])
    return found


def _offsets(direction: np.ndarray, met: Met, part: np.ndarray, near: np.ndarray) -> np.ndarray:
    """(n, K, 3) float64 [m] from the ends of rays to those of their neighbours."""
    ends = direction[near].astype(np.float64) * met.distance[near, None].astype(np.float64)
    own = direction[part].astype(np.float64) * met.distance[part, None].astype(np.float64)
    return ends - own[:, None]


def _on_tilted(
    direction: np.ndarray,
    met: Met,
    rays: tuple[np.ndarray, np.ndarray],
    offset: np.ndarray,
    tolerance: np.ndarray,
) -> np.ndarray:
    """(m,) bool: the ends of rays, and of their neighbours around, lie on a plane that is tilted to their element."""
    part, near = rays
    apart = np.linalg.norm(direction[near] - direction[part, None], axis=2)
    spacing = np.quantile(apart, 0.5, axis=1) * met.distance[part]
    reach = np.maximum(AROUND, SPACINGS * spacing)
    around = np.linalg.norm(offset, axis=2) <= reach[:, None]
    weight, count = around.astype(np.float64), around.sum(axis=1)
    middle = np.einsum("nk,nkc->nc", weight, offset) / count[:, None]
    centred = (offset - middle[:, None]) * weight[..., None]
    values, vectors = np.linalg.eigh(np.einsum("nka,nkb->nab", centred, centred) / count[:, None, None])
    thick, width, length = np.sqrt(np.maximum(values, 0.0)).T
    normal = vectors[:, :, 0]
    on_it = np.abs(np.einsum("nc,nc->n", middle, normal)) <= tolerance
    cosine = np.abs(np.einsum("nc,nc->n", normal, met.normal[part]))
    flat = (thick <= FLAT * width) & (width >= np.maximum(WIDE * met.sigma[part], LEAST_WIDTH * length))
    return (count >= LEAST_AROUND * NEIGHBOURS) & flat & on_it & (cosine < TILTED)
