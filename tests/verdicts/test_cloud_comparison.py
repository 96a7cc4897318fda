"""Only what the sensor could see of a cloud counts."""

import numpy as np
import pytest

from jaxmm.inputs import InputError
from jaxmm.rays.scan_rays import PosedScan, rays_of_scan
from jaxmm.verdicts.cloud_comparison import compare, visible
from warp_scanner.sensors.sensors import OAK_D_PRO_SMALL

PLACE = np.array([0.0, 0.0, 1.2])


def wall(x, step=0.1, low=0.0):
    y, z = np.meshgrid(np.arange(-4, 4, step), np.arange(low, 3, step))
    return np.column_stack([np.full(y.size, x), y.ravel(), z.ravel()]).astype(np.float32)


def scan_of(points):
    return rays_of_scan(PosedScan(points, PLACE, np.eye(3), OAK_D_PRO_SMALL))


def test_what_stands_behind_other_points_is_not_seen_and_what_is_out_of_view_neither():
    near, far, behind = wall(3.0), wall(5.0), wall(-3.0)
    seen = visible(np.concatenate([near, far, behind]), scan_of(wall(3.0, 0.02)))
    assert (seen[:, 0] > 0).all() and np.mean(seen[:, 0] > 4) < 0.02
    inside = OAK_D_PRO_SMALL.sees(near - PLACE)
    assert np.sum(seen[:, 0] < 4) == pytest.approx(inside.sum(), rel=0.06)


def test_what_slants_away_does_not_hide_itself():
    floor = wall(0.0, 0.1, -4.0)[:, [2, 1, 0]] + np.array([5, 0, 0], np.float32)  # level, at the height 0
    seen = visible(floor, scan_of(floor))
    inside = OAK_D_PRO_SMALL.sees(floor - PLACE)
    assert len(seen) > 0.9 * inside.sum()


def test_a_wall_that_is_gone_is_looked_through():
    far = wall(5.0, 0.02)
    found = compare(np.concatenate([wall(3.0), wall(5.0)]), scan_of(far))
    share = found.prior.count / np.maximum(found.prior.count.sum(axis=1, keepdims=True), 1)
    x, y, z = found.prior.points.T
    before = (x < 4) & (abs(y) < 2.2) & (z < 2.2) & (z > 0.6)  # beyond, nothing is behind
    assert before.sum() > 300 and share[before, 0].mean() > 0.95


def test_a_prior_out_of_view_is_refused():
    with pytest.raises(InputError, match="points in view"):
        compare(wall(-3.0), scan_of(wall(3.0)))
