"""Settling moves no range by more than its own error allows, and keeps what is flat, also between leaves."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from jaxmm.rays.range_noise import settled
from jaxmm.rays.scan_rays import PosedScan

EYE = np.array([3.0, 6.0, 1.6])


def hall(leaves, rings=240):
    """Directions, ranges [m], and surfaces, -1 of leaves: a hall of 45 x 14 x 5 m, eight partitions, and plants."""
    rng, size, eye = np.random.default_rng(0), np.array([45.0, 14.0, 5.0]), EYE
    azimuth, elevation = np.meshgrid(np.radians(np.arange(0, 360, 0.36)), np.radians(np.linspace(-60, 60, rings)))
    level = np.cos(elevation)
    direction = np.stack([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)], axis=-1).reshape(-1, 3)
    reach, surface = np.full(len(direction), np.inf), np.zeros(len(direction), int)
    walls = [(axis, at, np.zeros(3), size) for axis in range(3) for at in (0.0, size[axis])]
    for at, side in zip(rng.uniform(6, 40, 8), rng.uniform(0, 11, 8), strict=True):
        walls.append((0, at, np.array([0.0, side, 0.0]), np.array([0.0, side + rng.uniform(1, 3), rng.uniform(1, 3)])))
    for number, (axis, at, low, high) in enumerate(walls):
        with np.errstate(divide="ignore", invalid="ignore"):
            away = (at - eye[axis]) / direction[:, axis]
            places = np.delete(eye + direction * away[:, None], axis, axis=1)
        meets = (away > 0.05) & (away < reach)
        meets &= np.all((places >= np.delete(low, axis)) & (places <= np.delete(high, axis)), axis=1)
        reach[meets], surface[meets] = away[meets], number
    for _ in range(leaves):  # one plant: a ray that enters it mostly ends within
        middle, radius = rng.uniform([4, 1, 0.3], [42, 13, 1.5]), rng.uniform(0.2, 0.8)
        along = direction @ (middle - eye)
        half = np.sqrt(np.maximum(along**2 - (middle - eye) @ (middle - eye) + radius**2, 0.0))
        away = along + half * rng.uniform(-1, 1, len(reach))
        meets = (half > 0.0) & (away > 0.05) & (away < reach) & (rng.random(len(reach)) < 0.8)
        reach[meets], surface[meets] = away[meets], -1
    return direction, reach, surface


@pytest.mark.parametrize("leaves, rings", [(0, 240), (40, 240), (60, 64)])
@pytest.mark.parametrize("sigma", [(0.002, 0.0), (0.02, 0.0), (0.05, 0.0), (0.003, 0.001)])
def test_no_range_moves_by_three_deviations_and_no_plane_loses_a_tenth(leaves, rings, sigma):
    """Of a deviation [m] that is constant, or grows with the range; surfaces of few rays, between leaves, may."""
    direction, reach, surface = hall(leaves, rings)
    own = sigma[0] + sigma[1] * reach
    noisy = reach + own * np.random.default_rng(7).standard_normal(len(reach))
    points = (EYE + direction * noisy[:, None]).astype(np.float32)
    found = settled(PosedScan(points, EYE, np.eye(3)))
    offset = found.scan.points - EYE
    length = np.linalg.norm(offset, axis=1)
    apart, which = cKDTree(offset / length[:, None]).query(direction)
    kept = apart < 1e-4
    assert np.max(np.abs(length[which] - noisy)[kept] / own[kept]) < 3.0 + 1e-4 / own.min()
    for number in np.unique(surface[surface >= 0]):
        rays = surface == number
        assert rays.sum() < 60 or np.mean(kept[rays]) > (0.9 if rays.sum() > 500 else 0.85), number
