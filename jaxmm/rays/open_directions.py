"""Along which directions nothing that a scan sees holds its place: along a corridor, or before one bare wall.

N points of the scan that lie on the prior, with the normals of their surfaces, world frame: metres, z up.
"""

import numpy as np

WORTH = 0.02  # neighbouring points err alike: so many independent ones is each worth
LEAST_SIGMA = 0.01  # [m] of a point off its surface: what is built is never where it is drawn
GIVEN = (0.2, 0.2, 0.2, 0.04, 0.04, 0.1)  # [m, rad] standard deviations of poses that are given
MOST_SIGMA = 0.015  # [m] of a place, up to which it is held


def open_directions(points: np.ndarray, normals: np.ndarray, residual: float) -> tuple[tuple[float, float, float], ...]:
    """Unit vectors of the directions that are open: at most one in plan, or both axes of it, and up.

    A direction is open where the least squares of the fit (point to plane, all six degrees of freedom) leave the place
    of the sensor along it uncertain by more than MOST_SIGMA.

    Args:
        points: (N, 3) [m] about the sensor.
        normals: (N, 3) unit vectors, of either sign.
        residual: [m] standard deviation of the points about the surfaces; NaN where there is none.
    """
    sigma = max(LEAST_SIGMA, residual if np.isfinite(residual) else 0.0)
    spread = np.linalg.inv(information(points, normals, sigma) + np.diag(1.0 / np.square(GIVEN)))[:3, :3]
    square, ways = np.linalg.eigh(spread[:2, :2])
    found: list[tuple[float, float, float]] = []
    if square[0] > MOST_SIGMA**2:
        found += [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0)]
    elif square[1] > MOST_SIGMA**2:
        along = ways[:, 1] * (1.0 if ways[1, 1] >= 0.0 else -1.0)
        found.append((float(along[0]), float(along[1]), 0.0))
    if spread[2, 2] > MOST_SIGMA**2:
        found.append((0.0, 0.0, 1.0))
    return tuple(found)


def information(points: np.ndarray, normals: np.ndarray, sigma: float) -> np.ndarray:
    """(6, 6) what surfaces tell of a shift [m] and a turn [rad] (rotation vector).

    Args:
        points: (N, 3) [m] about where it turns.
        normals: (N, 3) unit vectors, of either sign.
        sigma: [m] standard deviation of the points off the surfaces.
    """
    slope = np.column_stack([normals, np.cross(points, normals)])
    return slope.T @ slope * (WORTH / sigma**2)


def in_words(direction: tuple[float, float, float]) -> str:
    """A direction as reports name it: by its angle to x, or as up and down."""
    if direction[2]:
        return "up and down"
    angle = float(np.degrees(np.arctan2(direction[1], direction[0])) % 180.0)
    return f"along {angle:.0f}° from x" if 2.5 < angle < 177.5 else "along x"
