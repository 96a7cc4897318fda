"""Voxel thinning: the same indices as the reference in NumPy, over clouds of every shape."""

import numpy as np
import pytest

from jaxmm.learning.preprocess import voxel_downsample
from warp_scanner.clouds import voxels
from warp_scanner.clouds.points import points_of
from warp_scanner.clouds.voxels import thin_clouds
from warp_scanner.rooms.pairs import PairConfig, make_pairs


def lattice(rng, count):
    """Regular points and pairs of points: ties in most voxels, cells' borders among the coordinates."""
    return rng.integers(-20, 20, (count, 3)) * rng.choice([0.05, 0.1, 0.025]) + rng.choice([0.0, 0.05, 3.7])


def copies(rng, count):
    return rng.uniform(-1, 1, (max(count // 5, 1), 3))[rng.integers(0, max(count // 5, 1), count)]


def flat(rng, count):
    return rng.uniform(-2, 2, (count, 3)) * rng.permutation([1.0, 0.3, 0.0])


def anywhere(rng, count):
    return rng.uniform(-2, 2, (count, 3)).astype(np.float32)


def far_away(rng, count):
    return rng.uniform(-2, 2, (count, 3)) + rng.uniform(-5e6, 5e6, 3)


def with_outlier(rng, count):
    points = rng.uniform(-1, 1, (count, 3))
    points[0] = rng.normal(scale=3e4, size=3)
    return points


@pytest.mark.parametrize("shape", [lattice, copies, flat, anywhere, far_away, with_outlier])
@pytest.mark.parametrize("size", [0.1, 0.37, 1.0])
def test_indices_are_those_of_the_reference(shape, size):
    rng = np.random.default_rng(0)
    clouds = [shape(rng, count) for count in rng.integers(1, 500, 200)]
    for cloud, kept in zip(clouds, thin_clouds(clouds, size), strict=True):
        np.testing.assert_array_equal(kept, voxel_downsample(cloud, size))
        assert kept.dtype == np.int64


def test_scans_give_the_indices_of_the_reference():
    pairs = make_pairs(PairConfig(scenario="pillar_added", condition="occluded", range_noise=0.005), np.arange(6))
    scans = [points_of(pairs.pose, pairs.directions, scan.distance) for scan in (pairs.dt, pairs.robot)]
    clouds = [points[np.isfinite(points[:, 0])] for points in np.concatenate(scans)]
    kept = thin_clouds(clouds)
    for cloud, indices in zip(clouds, kept, strict=True):
        np.testing.assert_array_equal(indices, voxel_downsample(cloud))
        assert 0 < len(indices) < len(cloud) / 4
    for threads in (1, 3):
        for cloud, indices in zip(clouds[:3], kept, strict=False):
            np.testing.assert_array_equal(thin_clouds([cloud], threads=threads)[0], indices)


def test_of_equals_the_first_is_kept_whatever_rounding_says():
    rng = np.random.default_rng(0)
    corner = np.stack(np.mgrid[:20, :20, :5], axis=-1).reshape(-1, 1, 3) * 0.3 + 4.2e5
    pairs = (corner + rng.uniform(-0.14, 0.14, (2000, 2, 3))).reshape(-1, 3)
    np.testing.assert_array_equal(thin_clouds([pairs], 0.3)[0], np.arange(0, 4000, 2))


@pytest.mark.parametrize("height", [-1.5, 0.0, 2.7])
def test_a_surface_on_a_multiple_of_the_size_never_splits(height):
    rng = np.random.default_rng(1)
    points = np.column_stack([rng.uniform(-2, 2, (20_000, 2)), height + rng.normal(scale=1e-4, size=20_000)])
    columns = np.floor(points[:, :2] / 0.1 + 0.5).astype(int)
    assert len(thin_clouds([points])[0]) == len(np.unique(columns, axis=0))


def test_gaps_and_bad_input():
    points = np.random.default_rng(0).uniform(-2, 2, (50, 3))
    none, all_of_them = thin_clouds([np.zeros((0, 3)), points], 1e-3)
    assert none.shape == (0,) and none.dtype == np.int64
    np.testing.assert_array_equal(all_of_them, np.arange(50))
    assert thin_clouds([]) == []
    with pytest.raises(ValueError, match=r"too small for clouds\[1\], which spans"):
        thin_clouds([points, points * 1e9], 1e-3)
    with pytest.raises(ValueError, match="size must be above 0 m and finite, got 0"):
        thin_clouds([points], 0.0)
    with pytest.raises(ValueError, match="size must be above 0 m and finite, got nan"):
        thin_clouds([points], np.nan)
    with pytest.raises(ValueError, match=r"clouds\[0\] must be finite"):
        thin_clouds([np.full((3, 3), np.inf)])
    with pytest.raises(ValueError, match=r"\(N, 3\), got \(3,\)"):
        thin_clouds([np.zeros(3)])


def test_a_cloud_is_thinned_part_by_part_to_one_point_a_voxel(monkeypatch):
    monkeypatch.setattr(voxels, "LARGE", 700)
    points = np.random.default_rng(4).uniform(-1.0, 1.0, (5000, 3)).astype(np.float32)
    whole, parts = voxels.thin_clouds([points], 0.3)[0], voxels.thinned_cloud(points, 0.3)

    def cells(rows):
        return {tuple(cell) for cell in np.floor(points[rows] / 0.3 + 0.5).astype(int)}

    assert len(parts) == len(whole) == len(cells(parts)) and cells(parts) == cells(whole)
    assert (np.diff(parts) > 0).all()
    np.testing.assert_array_equal(voxels.thinned_cloud(points[:700], 0.3), voxels.thin_clouds([points[:700]], 0.3)[0])
    assert len(voxels.thinned_cloud(points[:0])) == 0
