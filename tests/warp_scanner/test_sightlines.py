"""What rays near a point met, against a plain loop over all rays, and against closed forms."""

import numpy as np
import pytest

from warp_scanner.clouds.sightlines import Predicted, Targets, cells_of, look, sort_directions
from warp_scanner.sensors.sensors import Pinhole, sensor_named


def random_directions(rng, count):
    """Unit vectors all over the sphere, some at its poles and at the seam of the azimuth."""
    toward = rng.standard_normal((count, 3))
    toward[: count // 10, :2] *= 0.02
    toward[count // 10 : count // 5] = [-1.0, 0.0, 0.0] + 0.05 * rng.standard_normal((count // 5 - count // 10, 3))
    return (toward / np.linalg.norm(toward, axis=1, keepdims=True)).astype(np.float32)


def targets_of(rng, count):
    return Targets(
        random_directions(rng, count),
        rng.uniform(1.0, 10.0, count).astype(np.float32),
        rng.choice([0.0, 0.01, 0.1, 0.7, 2.0], count).astype(np.float32),
        rng.uniform(0.0, 0.5, count).astype(np.float32),
        rng.choice([0.0, 2.0], count).astype(np.float32),
        rng.integers(-1, 3, count).astype(np.int32),
    )


def looked(directions, distance, target, predicted):
    """The same by a loop over points, in float64; and the chords that are too close to the footprint's edge to tell."""
    counts, residuals, doubtful = [], [], []
    for i in range(len(target.distance)):
        apart = np.linalg.norm(directions.astype(float) - target.direction[i], axis=1)
        reach = 2 * np.sin(min(target.angle[i], np.pi) / 2)
        inside = apart <= reach
        if predicted is None:
            expected, limit = target.distance[i], target.margin[i] + target.slope[i] * apart
        else:
            expected, limit = predicted.distance.astype(float), predicted.margin
            inside &= (target.element[i] < 0) | (predicted.element == target.element[i])
        found = distance[inside].astype(float)
        expected = np.broadcast_to(expected, distance.shape)[inside]
        limit = np.broadcast_to(limit, distance.shape)[inside]
        hit = np.isfinite(found)
        beyond, before = hit & (found > expected + limit), hit & (found < expected - limit)
        counts.append([beyond.sum(), (hit & ~beyond & ~before).sum(), before.sum(), (~hit).sum()])
        residuals.append(np.clip(found - expected, -5, 5)[hit].mean() if hit.any() else np.nan)
        doubtful.append(np.any(np.abs(apart - reach) < 1e-6))
    return np.array(counts), np.array(residuals), np.array(doubtful)


@pytest.mark.parametrize("exact", [False, True])
@pytest.mark.parametrize("cell", [0.005, 0.05, 0.5])
def test_counts_are_those_of_a_loop_over_all_rays(cell, exact):
    rng = np.random.default_rng(5)
    directions, scans = random_directions(rng, 700), 3
    distance = rng.uniform(1.0, 10.0, (scans, 700)).astype(np.float32)
    distance[rng.random(distance.shape) < 0.1] = np.inf
    targets = [targets_of(rng, count) for count in (300, 0, 200)]
    predicted = None
    if exact:
        expected = rng.uniform(1.0, 10.0, distance.shape).astype(np.float32)
        margin = rng.uniform(0.0, 1.0, distance.shape).astype(np.float32)
        predicted = Predicted(expected, rng.integers(0, 3, distance.shape).astype(np.int32), margin)
    grid = sort_directions(directions, cell)
    found = look(grid, distance, targets, predicted, threads=2)
    checked = 0
    for scan, (target, looks) in enumerate(zip(targets, found, strict=True)):
        one = None if predicted is None else Predicted(*(field[scan] for field in predicted))
        counts, residuals, doubtful = looked(directions, distance[scan], target, one) if len(target.distance) else (
            np.zeros((0, 4)), np.zeros(0), np.zeros(0, bool)
        )  # fmt: skip
        np.testing.assert_array_equal(looks.count[~doubtful], counts[~doubtful])
        np.testing.assert_allclose(looks.residual[~doubtful], residuals[~doubtful], atol=1e-4)
        checked += (counts[~doubtful] > 0).sum()
    assert checked > 500
    for alone, together in zip(look(grid, distance, targets, predicted, threads=1), found, strict=True):
        np.testing.assert_array_equal(alone.count, together.count)


def test_a_wall_that_is_gone_is_looked_through_and_a_nearer_one_blocks():
    """A plane at 2 m and one at 3 m along the axis, compared within the margin that the slope of the plane asks for."""
    sensor = Pinhole(160, 100)
    directions = sensor.directions()
    near, far = 2.0 / directions[:, 0], 3.0 / directions[:, 0]
    pixel = np.arange(0, 16000, 37)
    angle = np.full(len(pixel), 0.02)
    for seen, prior, column in ((far, near, 0), (near, near, 1), (near, far, 2), (np.full(16000, np.inf), near, 3)):
        # Ranges of neighbouring rays on a plane differ by its slope: range times the tangent of the incidence.
        slope = prior[pixel] * np.sqrt(1.0 / directions[pixel, 0] ** 2 - 1.0) + 0.1
        target = Targets(directions[pixel], prior[pixel], angle, np.full(len(pixel), 0.01), slope, 0 * pixel - 1)
        (looks,) = look(sort_directions(directions), seen[None], [target])
        assert np.all(looks.count.argmax(axis=1) == column) and np.all(looks.count.sum(axis=1) > 0)
        others = np.delete(looks.count, column, axis=1)
        assert others.sum() == 0


def test_points_of_a_thinned_cloud_hide_what_is_beside_them():
    """Voxels of 0.1 m at 1 m stand for a tenth of a radian each: nothing of a wall behind them shows in between."""
    y, z = np.meshgrid(np.arange(-1.0, 1.01, 0.1), np.arange(-1.0, 1.01, 0.1))
    screen = np.column_stack([np.ones(y.size), y.ravel(), z.ravel()])
    reach = np.linalg.norm(screen, axis=1)
    grid = sort_directions((screen / reach[:, None]).astype(np.float32))
    rng = np.random.default_rng(0)
    behind = np.column_stack([np.full(500, 3.0), rng.uniform(-2.5, 2.5, (500, 2))])
    far = np.linalg.norm(behind, axis=1)
    toward = (behind / far[:, None]).astype(np.float32)
    target = Targets(toward, far, 0.05 / far, np.full(500, 0.1), np.zeros(500), np.full(500, -1))
    (narrow,) = look(grid, reach[None], [target])
    (wide,) = look(grid, reach[None], [target], width=0.08 / reach[None])
    assert np.all(wide.count[:, 2] > 0) and np.mean(narrow.count[:, 2] > 0) < 0.5
    # Beyond their range nothing is hidden, however wide they are.
    nearer = target._replace(distance=np.full(500, 0.5))
    np.testing.assert_array_equal(
        look(grid, reach[None], [nearer], width=0.08 / reach[None])[0].count, look(grid, reach[None], [nearer])[0].count
    )
    with pytest.raises(ValueError, match="width"):
        look(grid, reach[None], [target], width=np.ones((1, 3)))


def test_every_ray_is_in_the_grid_once():
    for name in ("oak-d-pro-small", "velodyne-16", "tls"):
        directions = sensor_named(name).directions()[::7]
        grid = sort_directions(directions)
        assert sorted(grid.ray.tolist()) == list(range(len(directions)))
        np.testing.assert_array_equal(grid.direction, directions[grid.ray])
        assert grid.cell_start[-1] == len(directions) and np.all(np.diff(grid.cell_start) >= 0)


def test_cells_begin_straight_behind_on_either_side_of_zero():
    """There, and straight below, an angle in float32 is a little less than minus pi."""
    for z in np.linspace(-1.0, 1.0, 2001):
        x = -max(np.sqrt(1.0 - z * z), 1e-3)
        directions = (np.array([[x, -0.0, z], [x, -1e-6, z]]) / np.hypot(x, z)).astype(np.float32)
        behind, first, _ = cells_of(directions, 0.015)
        assert behind[0] == behind[1] and behind[0] in first
        assert sort_directions(directions, 0.015).cell_start[-1] == 2


def test_shapes_that_disagree_are_refused():
    directions = Pinhole(4, 3).directions()
    grid = sort_directions(directions)
    for bad in (directions[:, :2], 2 * directions):
        with pytest.raises(ValueError, match="direction"):
            sort_directions(bad)
    with pytest.raises(ValueError, match="cell"):
        sort_directions(directions, 0.0)
    with pytest.raises(ValueError, match=r"distance must be \(1, 12\)"):
        look(grid, np.ones((1, 11)), [targets_of(np.random.default_rng(0), 2)])
    with pytest.raises(ValueError, match="predicted"):
        wrong = Predicted(np.ones((1, 11)), np.ones((1, 12)), np.ones((1, 12)))
        look(grid, np.ones((1, 12)), [targets_of(np.random.default_rng(0), 2)], wrong)
