"""Only what the sensor could see of a cloud counts."""

import numpy as np
import pytest

from jaxmm.inputs import InputError
from jaxmm.rays.scan_rays import PosedScan, rays_of_scan
from jaxmm.verdicts.cloud_comparison import compare, on_surfaces, visible
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


def veil(count=60):
    """What a scanner beside PLACE mixes at an edge 2 m ahead of it with the wall 5 m ahead: a thin sheet of points."""
    rng = np.random.default_rng(4)
    share, z = rng.uniform(0.2, 0.9, count), rng.uniform(0.4, 2.2, count)
    return np.column_stack([2.0 + 3.0 * share, -0.8 + 1.6 * share, z]).astype(np.float32)


def test_points_that_hang_behind_an_edge_are_of_no_surface_and_all_of_sparse_walls_are():
    rings = wall(8.0)[np.abs(np.mod(wall(8.0)[:, 2], 0.3)) < 0.05]  # of a spinning sensor, 0.3 m apart
    for surface in (wall(3.0), wall(3.0, 0.14), rings):
        assert on_surfaces(surface).mean() > 0.94
        both = on_surfaces(np.concatenate([surface, veil()]))
        assert both[: len(surface)].mean() > 0.94 and both[len(surface) :].mean() < 0.3


@pytest.mark.parametrize("step", [0.2, 0.25, 0.4])
def test_of_a_prior_that_is_sparse_everywhere_all_points_are_judged(step):
    far = wall(5.0, 0.02)
    sparse = np.concatenate([wall(3.0, step), wall(5.0, step)])
    found = compare(sparse, scan_of(far)).prior
    assert len(found.points) == len(visible(sparse, scan_of(far)))
    x, y, z = found.points.T
    gone = (x < 4) & (abs(y) < 2.2) & (z < 2.2) & (z > 0.6)  # beyond, nothing is behind
    assert gone.sum() > 30 and found.candidate[gone].mean() > 0.9


def test_what_hangs_in_a_prior_is_not_judged_and_what_stands_there_is():
    far = wall(5.0, 0.02)
    found = compare(np.concatenate([veil(), wall(5.0)]), scan_of(far))
    assert np.mean(found.prior.points[:, 0] < 4.7) < 0.01 and len(found.prior.points) > 0.9 * len(
        visible(wall(5.0), scan_of(far))
    )
    stands = compare(np.concatenate([veil(), wall(3.0), wall(5.0)]), scan_of(far))
    assert np.sum(stands.prior.points[:, 0] < 4.0) > 0.9 * len(visible(wall(3.0), scan_of(far)))
