"""Scans of sensors that err: ranges settle on the planes around them, and what hangs between surfaces is left out.

A depth camera errs by centimetres from pixel to pixel, and at the edge of a thing every sensor mixes the ranges of both
sides of the edge. What is near on the sensor is mostly on one plane. N points, K rays closest to one, itself included.
"""

from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from jaxmm.evidence import SIGMAS, Noise, noise_of, sigma_at
from jaxmm.scan_rays import PosedScan, drawn
from warp_scanner.planes import on_planes

NEIGHBOURS = 25  # itself included
OF_NOISE = 13  # and where noise is measured
LEAST_SUPPORT = 6  # rays on one plane, itself included; three are always on one
LEAST_MARGIN = 0.01  # [m] surfaces are no planes
SAMPLED = 6000  # rays that tell of the noise
AROUND = 0.5  # [m] within which ranges may err
EXACT = 1e-4  # [m] ranges that err by less are left as they are: nobody measured them
LEAST_POINTS = 1000  # of a scan that tells what its sensor does


class Settled(NamedTuple):
    """A scan after its ranges have settled."""

    scan: PosedScan
    sigma: float  # [m] standard deviation of its ranges, at the middle one of them
    stray: float  # share of its points that were left out


def settled(scan: PosedScan) -> Settled:
    """The scan with every range on the plane that it shares with its neighbours, and without those that share none.

    A scan whose ranges do not err, as a simulated one, is given back as it is.

    Args:
        scan: from where, and what; of a large one as many points as `scan_rays` draws.
    """
    points = drawn(scan.points, scan.position)
    if len(points) < LEAST_POINTS:
        return Settled(scan, 0.0, 0.0)
    offset = points - scan.position
    reach = np.linalg.norm(offset, axis=1)
    direction = offset / reach[:, None]
    tree = cKDTree(direction)
    noise = _noise(tree, direction, reach)
    sigma = float(sigma_at(noise, np.median(reach)))
    if sigma < EXACT:
        return Settled(scan, sigma, 0.0)
    margin = LEAST_MARGIN + SIGMAS * sigma_at(noise, reach)
    near = tree.query(direction, NEIGHBOURS, workers=-1)[1]
    found = on_planes(direction, reach, margin, near)
    kept = found.support >= LEAST_SUPPORT
    places = scan.position + direction[kept] * found.distance[kept, None].astype(np.float64)
    return Settled(scan._replace(points=places.astype(np.float32)), sigma, float(1.0 - kept.mean()))


def _noise(tree: cKDTree, direction: np.ndarray, reach: np.ndarray) -> Noise:
    """How the ranges err about the planes around them."""
    chosen = np.random.default_rng(0).choice(len(reach), min(len(reach), SAMPLED), replace=False)
    near = tree.query(direction[chosen], OF_NOISE, workers=-1)[1]
    settles = on_planes(direction, reach, np.full(len(reach), AROUND), near, chosen).distance
    noise = noise_of(reach[chosen] - settles, np.ones(len(chosen)), reach[chosen])
    own = np.sqrt(1.0 - 1.0 / OF_NOISE)  # the plane gives way to the ray itself
    return Noise(noise.constant / own, noise.growth / own)
