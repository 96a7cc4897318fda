"""Hole interpolation: what the thesis proposed against shadows, as a control. N points of a scan, world frame, metres.

Where objects were filtered out of a scan, or hid what is behind them, rays have no return. The thesis (section on
shadows, future work) suggests to fill such holes from what surrounds them before distances are taken.
"""

import numpy as np
from scipy.interpolate import LinearNDInterpolator
from scipy.spatial import cKDTree

from jaxmm.vectors import lengths

SPACING = 0.02  # [rad] of the directions that are filled
OPEN = 2.0  # spacings to the nearest known direction, from which a direction counts as a hole


def fill_holes(points: np.ndarray, sensor: np.ndarray, inside: np.ndarray) -> np.ndarray:
    """The scan with its holes filled: inverse ranges are interpolated linearly between the directions around a hole.

    Args:
        points: (N, 3) of the scan.
        sensor: (3,) where it was taken from.
        inside: (M, 3) points whose directions span the field of view, such as the DT scan's.

    Returns:
        (N + K, 3) float32: the points, and one for every direction of a regular pattern that lies in a hole.
    """
    if len(points) < 4 or not len(inside):
        return np.asarray(points, np.float32)
    known, reach = _angles(points, sensor)
    wanted, _ = _angles(inside, sensor)
    # Azimuths are counted from their mean on the circle, so that none jumps by a turn.
    middle = np.arctan2(np.sin(wanted[:, 0]).mean(), np.cos(wanted[:, 0]).mean())
    for angles in (known, wanted):
        angles[:, 0] = (angles[:, 0] - middle + np.pi) % (2 * np.pi) - np.pi
    cells = np.unique(np.round(wanted / SPACING), axis=0) * SPACING
    hole = cells[cKDTree(known).query(cells)[0] > OPEN * SPACING]
    # Of directions that are known twice the first counts: a triangulation cannot hold both.
    first = np.unique(np.round(known / 1e-6), axis=0, return_index=True)[1]
    if not len(hole) or np.linalg.matrix_rank(known[first] - known[first].mean(axis=0), 1e-6) < 2:
        return np.asarray(points, np.float32)  # directions on one line surround nothing
    inverse = LinearNDInterpolator(known[first], 1.0 / np.maximum(reach[first], 1e-3))(hole)
    hole, inverse = hole[np.isfinite(inverse)], inverse[np.isfinite(inverse)]
    azimuth, elevation = hole[:, 0] + middle, hole[:, 1]
    level = np.cos(elevation)
    ray = np.column_stack([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)])
    return np.concatenate([points, sensor + ray / inverse[:, None]]).astype(np.float32)


def _angles(points: np.ndarray, sensor: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Azimuth and elevation (N, 2) [rad] and range (N,) [m] of points as seen from a place."""
    offset = np.asarray(points, np.float64) - sensor
    reach = lengths(offset)
    elevation = np.arcsin(np.clip(offset[:, 2] / np.maximum(reach, 1e-9), -1.0, 1.0))
    return np.column_stack([np.arctan2(offset[:, 1], offset[:, 0]), elevation]), reach
