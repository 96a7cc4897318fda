"""Along which directions nothing that a scan sees holds its place: along a corridor, or before one bare wall.

N points of the scan that lie on the prior, with the normals of their surfaces, world frame: metres, z up.
"""

import numpy as np

FACING = 0.25  # least cosine between a normal and a direction that its surface holds
LEAST_HOLDING = 30  # points, each of a voxel of 0.1 m, that hold a direction
STEP = 5.0  # [deg] between the directions in plan that are tried


def open_directions(normals: np.ndarray) -> tuple[tuple[float, float, float], ...]:
    """Unit vectors of the directions that are open: at most one in plan, or both axes of it, and up.

    Args:
        normals: (N, 3) unit vectors, of either sign.
    """
    angles = np.radians(np.arange(0.0, 180.0, STEP))
    ways = np.column_stack([np.cos(angles), np.sin(angles)])
    holding = np.count_nonzero(np.abs(normals[:, :2] @ ways.T) > FACING, axis=0)
    found: list[tuple[float, float, float]] = []
    if holding.max(initial=0) < LEAST_HOLDING:
        found += [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0)]
    elif holding.min() < LEAST_HOLDING:
        # The middle of what is open: at right angles to what holds, within what noise leaves of it.
        least = np.flatnonzero(holding == holding.min())
        doubled = np.exp(2j * angles[least]).mean()  # a direction and its opposite are one
        middle = np.angle(doubled) / 2.0 % np.pi
        found.append((float(np.cos(middle)), float(np.sin(middle)), 0.0))
    if np.count_nonzero(np.abs(normals[:, 2]) > FACING) < LEAST_HOLDING:
        found.append((0.0, 0.0, 1.0))
    return tuple(found)


def in_words(direction: tuple[float, float, float]) -> str:
    """A direction as reports name it: by its angle to x, or as up and down."""
    if direction[2]:
        return "up and down"
    angle = float(np.degrees(np.arctan2(direction[1], direction[0])) % 180.0)
    return f"along {angle:.0f}° from x" if 2.5 < angle < 177.5 else "along x"
