"""The directions that a building stands along: most walls of it are parallel or at right angles."""

import numpy as np

from warp_scanner.buildings import Triangles

UPRIGHT = 0.1  # most z of a unit normal
NEAR = 10.0  # [m] in plan over which a surface counts e times less: wings of a building have grids of their own
BINS = 90  # over a quarter of a turn


def grid_near(triangles: Triangles, place: np.ndarray) -> float | None:
    """Direction [rad], 0 to a quarter turn, along or across which most upright surface stands; None without any.

    Args:
        triangles: of the building.
        place: (2,) [m] near which surface counts most, in the frame of the vertices.
    """
    corners = triangles.vertices[triangles.faces].astype(np.float64)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(normal, axis=1)
    upright = np.abs(normal[:, 2]) < UPRIGHT * area
    if not upright.any():
        return None
    normal, center = normal[upright], corners[upright, :, :2].mean(axis=1)
    away = np.linalg.norm(center - place, axis=1)
    weight = area[upright] * np.exp(-(away - away.min()) / NEAR)
    turn = np.arctan2(normal[:, 1], normal[:, 0]) % (np.pi / 2)
    step = np.pi / 2 / BINS
    count = np.bincount((turn / step).astype(int) % BINS, weight, BINS)
    best = int(np.argmax(2.0 * count + np.roll(count, 1) + np.roll(count, -1)))  # a direction may be on a border
    off = (turn - (best + 0.5) * step + np.pi / 4) % (np.pi / 2) - np.pi / 4
    near = np.flatnonzero(np.abs(off) <= 1.5 * step)
    near = near[np.argsort(off[near])]
    total = np.cumsum(weight[near])
    middle = near[np.searchsorted(total, total[-1] / 2)]  # a wall that is a degree off does not move it
    return float(((best + 0.5) * step + off[middle]) % (np.pi / 2))
