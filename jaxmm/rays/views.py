"""Views from rays that were compared one by one with what the prior says they should meet.

N points of one scan. World frame: metres, z up.
"""

from typing import NamedTuple

import numpy as np

from jaxmm.rays.evidence import BLOCKED, SUPPORT, THROUGH, View, margins
from jaxmm.rays.noise_model import Noise, sigma_at

OPEN = 5.0  # [m] beyond the robot's point, where the prior has nothing at all


class Along(NamedTuple):
    """What is known along the ray of each of the robot's points."""

    measured: np.ndarray  # (N,) [m] ranges
    expected: np.ndarray  # (N,) [m], inf = the prior has nothing there
    margin: np.ndarray  # (N,) [m] within which both are taken for equal
    cosine: np.ndarray  # (N,) of the incidence on the prior, NaN = nothing


def view_of_prior(
    points: np.ndarray,
    element: np.ndarray,
    looks: tuple[np.ndarray, np.ndarray],
    margin: np.ndarray,
    apart: np.ndarray,
    cosine: np.ndarray,
) -> View:
    """Points of the prior, with the rays (N, 4) in their footprints and the mean residual (N,) of those."""
    count, residual = looks
    through, support, blocked, _ = count.T
    candidate = (through > support) & (through > blocked)
    return View(points, element, count, residual, margin, apart, cosine, candidate)


def view_of_robot(points: np.ndarray, along: Along, apart: np.ndarray, noise: Noise) -> View:
    """Points of the robot, each with its own ray; `apart` (N,) [m] from the prior's whole surface.

    Where the prior has nothing along the ray, its surface is as far beyond the point as can be told.
    """
    residual = np.where(np.isinf(along.expected), -OPEN, along.measured - along.expected)
    side = np.where(residual > along.margin, THROUGH, np.where(residual < -along.margin, BLOCKED, SUPPORT))
    count = np.zeros((len(points), 4), np.int64)
    count[np.arange(len(points)), side] = 1
    own = margins(np.ones(len(points)), sigma_at(noise, along.measured))
    candidate = (side == BLOCKED) & (apart > own)
    return View(points, np.full(len(points), -1), count, residual, along.margin, apart, along.cosine, candidate)
