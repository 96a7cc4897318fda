"""Preprocessing: slow references, properties on random clouds, Open3D as witness where it is installed."""

import numpy as np
import pytest
from scipy.spatial.distance import cdist

from jaxmm.learning.preprocess import (
    augmentations,
    nearest_distance,
    object_filter,
    outlier_mask,
    structural_filter,
    voxel_downsample,
)


def cloud(seed, count=600, extent=2.0):
    return np.random.default_rng(seed).uniform(-extent, extent, (count, 3)).astype(np.float32)


def slow_voxels(points, size):
    """The definition, voxel by voxel."""
    cells = [tuple(cell) for cell in np.floor(points.astype(np.float64) / size + 0.5).astype(int)]
    chosen = []
    for cell in set(cells):
        members = [index for index, other in enumerate(cells) if other == cell]
        inside = points[members].astype(np.float64)
        apart = np.linalg.norm(inside - inside.mean(axis=0), axis=1)
        chosen.append(members[int(np.flatnonzero(apart <= apart.min() + 1e-9)[0])])
    return sorted(chosen)


@pytest.mark.parametrize("seed", range(15))
@pytest.mark.parametrize("size", [0.1, 0.37, 1.0, 20.0])
def test_voxels_agree_with_the_definition(seed, size):
    points = cloud(seed)
    np.testing.assert_array_equal(voxel_downsample(points, size), slow_voxels(points, size))


def test_each_voxel_keeps_one_real_point():
    points = cloud(0, 50_000, 5.0)
    kept = voxel_downsample(points, 0.25)
    cells = np.floor(points / 0.25 + 0.5).astype(int)
    assert len(np.unique(cells[kept], axis=0)) == len(kept) == len(np.unique(cells, axis=0))
    assert np.all(np.diff(kept) > 0)
    np.testing.assert_array_equal(
        voxel_downsample(points[kept], 0.25), np.arange(len(kept))
    )  # a second pass changes nothing


@pytest.mark.parametrize("seed", range(10))
def test_permuted_points_give_the_same_choice_but_among_equals(seed):
    points = cloud(seed, 3000)
    cell = np.unique(np.floor(points / 0.4 + 0.5), axis=0, return_inverse=True)[1].ravel()
    order = np.random.default_rng(seed).permutation(len(points))
    straight, permuted = voxel_downsample(points, 0.4), order[voxel_downsample(points[order], 0.4)]
    straight, permuted = (kept[np.argsort(cell[kept])] for kept in (straight, permuted))
    differ = straight != permuted
    assert differ.any() and np.all(np.bincount(cell)[cell[straight[differ]]] == 2)
    assert np.all(straight[differ] < permuted[differ])


@pytest.mark.parametrize("scale", [(1, 3, 9), (9, 1, 3), (3, 9, 1)])
def test_long_and_flat_clouds_mix_no_voxels(scale):
    points = cloud(5, 400, 0.5) * np.array(scale, np.float32)
    np.testing.assert_array_equal(voxel_downsample(points, 0.8), slow_voxels(points, 0.8))


@pytest.mark.parametrize("origin", [0.0, 4.2e5])
def test_two_points_in_a_voxel_keep_the_first_whatever_rounding_says(origin):
    rng = np.random.default_rng(0)
    corner = np.stack(np.mgrid[:20, :20, :5], axis=-1).reshape(-1, 1, 3) * 0.3 + origin
    pairs = (corner + rng.uniform(-0.14, 0.14, (2000, 2, 3))).reshape(-1, 3)
    np.testing.assert_array_equal(voxel_downsample(pairs, 0.3), np.arange(0, 4000, 2))


def test_equal_points_keep_the_lowest_index():
    points = np.array([[0, 0, 0.02], [0, 0, -0.02], [5, 5, 5], [5, 5, 5]])
    np.testing.assert_array_equal(voxel_downsample(points, 0.1), [0, 2])


@pytest.mark.parametrize("height", [-1.5, 0.0, 1.5, 2.7])
def test_a_surface_on_a_multiple_of_the_size_never_splits(height):
    points = cloud(0, 20_000)
    points[:, 2] = height + np.random.default_rng(1).normal(scale=1e-4, size=len(points))
    kept = voxel_downsample(points, 0.1)
    columns = np.floor(points[:, :2] / 0.1 + 0.5).astype(int)
    assert len(kept) == len(np.unique(columns, axis=0))


def test_voxels_far_from_the_origin_and_degenerate_clouds():
    points = cloud(3).astype(np.float64)
    far = np.array([1e6, -2e6, 300.0])
    np.testing.assert_array_equal(voxel_downsample(points + far, 0.5), voxel_downsample(points, 0.5))
    assert len(voxel_downsample(np.zeros((0, 3)))) == 0
    np.testing.assert_array_equal(voxel_downsample(np.zeros((1, 3))), [0])
    with pytest.raises(ValueError, match="above 0"):
        voxel_downsample(points, 0.0)
    with pytest.raises(ValueError, match="too small"):
        voxel_downsample(points, 1e-9)
    with pytest.raises(ValueError, match=r"\(N, 3\), got \(4, 2\)"):
        voxel_downsample(np.zeros((4, 2)))
    with pytest.raises(ValueError, match="finite, got 1"):
        voxel_downsample(np.array([[0, 0, np.nan]]))


def plate(height, spread=0.0):
    """Ten points about a height."""
    return np.stack([np.arange(10.0), np.zeros(10), height + np.linspace(-spread, spread, 10)], axis=1)


@pytest.mark.parametrize(
    "points, stays",
    [
        pytest.param(plate(-1.5), True, id="floor"),
        pytest.param(plate(1.42), True, id="just under the ceiling"),
        pytest.param(plate(-1.42), True, id="just over the floor"),
        pytest.param(plate(-0.5), False, id="table top"),
        pytest.param(plate(-0.5, 0.9), False, id="up to 1.9 m"),
        pytest.param(plate(-0.5, 1.0), True, id="up to 2.0 m"),
        pytest.param(plate(0.7, 0.1), True, id="high shelf"),
        pytest.param(plate(-1.0, 0.49), False, id="chair"),
    ],
)
def test_object_filter_judges_height(points, stays):
    rng = np.random.default_rng(0)
    everything = np.concatenate([points, plate(-1.5), plate(0.0)])
    element = np.repeat([7, -3, 7_000_000], 10)
    order = rng.permutation(30)
    kept = object_filter(everything[order], element[order], floor=-1.5, ceiling=1.5)
    expected = np.repeat([stays, True, False], 10)
    np.testing.assert_array_equal(kept, expected[order])


@pytest.mark.parametrize("seed", range(10))
def test_object_filter_agrees_with_the_definition(seed):
    rng = np.random.default_rng(seed)
    points, element = cloud(seed, 300, 1.5), rng.integers(0, 60, 300)
    expected = np.zeros(300, bool)
    for number in range(60):
        z = points[element == number, 2].astype(float)
        if len(z) and (z.max() >= 0.5 or min(abs(np.median(z) + 1.5), abs(np.median(z) - 1.5)) <= 0.3):
            expected[element == number] = True
    np.testing.assert_array_equal(object_filter(points, element, -1.5, 1.5, 2.0, 0.3), expected)
    assert 0 < expected.sum() < 300


def test_filters_on_few_points():
    assert object_filter(np.zeros((0, 3)), np.zeros(0, int), 0, 3).shape == (0,)
    with pytest.raises(ValueError, match="element"):
        object_filter(np.zeros((3, 3)), np.zeros(2, int), 0, 3)
    np.testing.assert_array_equal(
        structural_filter(np.array([0, 1, 4, 6, 1]), (1, 4)), [False, True, True, False, True]
    )


@pytest.mark.parametrize("seed", range(5))
def test_distances_agree_with_all_pairs(seed):
    points, other = cloud(seed, 200), cloud(seed + 100, 300)
    distance = nearest_distance(points, other)
    assert distance.dtype == np.float32
    np.testing.assert_allclose(distance, cdist(points, other).min(axis=1), rtol=1e-6)
    assert not nearest_distance(points, np.concatenate([other, points])).any()
    with pytest.raises(ValueError, match="other must have"):
        nearest_distance(points, np.zeros((0, 3)))


def test_outliers_are_the_points_that_stand_alone():
    points = np.concatenate([cloud(0, 2000, 0.5), [[3, 3, 3], [-4, 0, 0]]]).astype(np.float32)
    mask = outlier_mask(points)
    assert mask[-2:].all() and mask[:-2].mean() < 0.1
    assert not outlier_mask(np.zeros((1, 3))).any()
    assert outlier_mask(np.concatenate([points, np.full((20, 3), 0.1)]))[-20:].all()  # twenty copies of one point
    with pytest.raises(ValueError, match="neighbours"):
        outlier_mask(points, neighbours=1)


@pytest.mark.parametrize("neighbours, std", [(20, 2.0), (5, 1.0), (50, 0.5)])
def test_outliers_agree_with_open3d(neighbours, std):
    open3d = pytest.importorskip("open3d", reason="the witness, Open3D, is not installed", exc_type=ImportError)
    points = np.random.default_rng(4).normal(size=(1500, 3))
    witness = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points))
    _, kept = witness.remove_statistical_outlier(neighbours, std)
    np.testing.assert_array_equal(np.flatnonzero(~outlier_mask(points, neighbours, std)), kept)


@pytest.mark.parametrize("seed", range(50))
def test_augmented_copies_are_moved_as_one_body(seed):
    points_a, points_b = cloud(seed, 60), cloud(seed + 1000, 50)
    moves = augmentations(np.random.default_rng(seed))
    copies = [(move.apply(points_a), move.apply(points_b)) for move in moves]
    assert len(copies) == 3
    for a, b in copies:
        assert a.dtype == b.dtype == np.float32
        np.testing.assert_allclose(cdist(a, b), cdist(points_a, points_b), atol=5e-6)
        assert not np.allclose(a, points_a, atol=1e-3)


def test_moves_keep_to_their_ranges_and_reach_them():
    moves = [augmentations(np.random.default_rng(seed)) for seed in range(3000)]
    turns = np.array([turn.rotation for turn, _, _ in moves])
    shifts = np.array([shift.translation for _, shift, _ in moves])
    np.testing.assert_allclose(np.linalg.det(turns), 1)
    np.testing.assert_allclose(turns @ turns.transpose(0, 2, 1), np.broadcast_to(np.eye(3), turns.shape), atol=1e-12)
    axes = np.isclose(np.diagonal(turns, axis1=1, axis2=2), 1).argmax(axis=1)
    assert np.all(np.bincount(axes, minlength=3) > 900)
    angle = np.arccos((np.trace(turns, axis1=1, axis2=2) - 1) / 2)
    assert 1.5 < angle.max() <= np.pi / 2 + 1e-12
    sine = turns[axes == 2][:, 1, 0]
    assert sine.min() < -0.9 and sine.max() > 0.9  # both ways
    assert np.abs(shifts).max() <= 5 and np.all(shifts.max(axis=0) > 4.9) and np.all(shifts.min(axis=0) < -4.9)
    for turn, shift, both in moves[:20]:
        assert not turn.translation.any()
        np.testing.assert_array_equal(shift.rotation, np.eye(3))
        np.testing.assert_allclose(both.apply(cloud(0)), shift.apply(turn.apply(cloud(0))), atol=1e-5)
