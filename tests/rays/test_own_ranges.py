"""Ranges as they were measured, of rays that have settled, and were moved, since."""

import numpy as np
from scipy.spatial.transform import Rotation

from jaxmm.rays.own_ranges import own_ranges
from jaxmm.rays.range_noise import settled
from jaxmm.rays.scan_rays import PosedScan, rays_of_scan
from tests.deviations.test_deviation import PLACE, SENSOR, hall, scan_with_errors


def test_ranges_that_settled_come_back_as_they_were_measured_wherever_the_scan_lies():
    whole = scan_with_errors(hall(), 0.01)
    found = settled(whole)
    turn, shift = Rotation.from_rotvec([0.01, -0.02, 0.3]).as_matrix(), np.array([0.3, -0.2, 0.1])
    there = PosedScan(
        (found.scan.points.astype(np.float64) @ turn.T + shift).astype(np.float32), turn @ PLACE + shift,
        turn @ found.scan.rotation, SENSOR,
    )  # fmt: skip
    rays = rays_of_scan(there)
    own = own_ranges(rays, there.rotation, whole)
    true = np.linalg.norm(whole.points.astype(np.float64) - PLACE, axis=1)
    assert found.moved and own.shape == (rays.measured,)
    assert np.mean(np.abs(own - rays.distance[: rays.measured]) > 1e-3) > 0.5
    # Each of them was measured.
    order = np.sort(true)
    place = np.clip(np.searchsorted(order, own), 1, len(order) - 1)
    apart = np.minimum(np.abs(order[place] - own), np.abs(order[place - 1] - own))
    assert apart.max() < 1e-5


def test_a_ray_that_is_none_of_the_scans_own_keeps_its_range():
    whole = scan_with_errors(hall(), 0.01)
    rays = rays_of_scan(whole)
    away = own_ranges(rays, Rotation.from_rotvec([0.0, 0.0, 0.01]).as_matrix(), whole)
    kept = rays.distance[: rays.measured]
    assert np.mean(away == kept) > 0.9
    assert np.array_equal(own_ranges(rays, np.eye(3), None), kept)
