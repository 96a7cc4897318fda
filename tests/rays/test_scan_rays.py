"""Points as rays: what was measured stays as it is, and holes are where nothing came back."""

import numpy as np
import pytest

from jaxmm.rays import scan_rays
from jaxmm.rays.scan_rays import MOST_PATTERN, MOST_RAYS, PosedScan, drawn, measured_points, rays_of_scan
from warp_scanner.clouds.voxels import thin_clouds
from warp_scanner.sensors.poses import rotation_of
from warp_scanner.sensors.sensors import OAK_D_PRO_SMALL, sensor_named

PLACE = np.array([1.0, -2.0, 0.5])


def turned(yaw, pitch=0.0):
    return rotation_of([yaw], [pitch])[0].astype(float)


def full_scan(sensor=OAK_D_PRO_SMALL, yaw=30.0, reach=4.0, keep=None):
    direction = sensor.directions() @ turned(yaw).T
    points = (PLACE + reach * direction).astype(np.float32)
    return PosedScan(points if keep is None else points[keep], PLACE, turned(yaw), sensor)


def test_every_measured_point_comes_back_from_its_ray():
    scan = full_scan()
    rays = rays_of_scan(scan)
    assert rays.measured == len(scan.points)
    np.testing.assert_allclose(measured_points(rays), scan.points, atol=1e-5)
    np.testing.assert_allclose(np.linalg.norm(rays.direction, axis=1), 1.0, atol=1e-5)


@pytest.mark.parametrize("strays", [0, 1, 30])
def test_holes_far_from_all_rays_are_what_the_nearest_ray_tells_of_them(strays):
    """Everywhere on a sphere about a camera's view; also where single rays lie beside it."""
    rng = np.random.default_rng(strays)
    known = full_scan().points.astype(float)[rng.permutation(64_000)[:4000]] - PLACE
    known = np.concatenate([known, rng.normal(size=(strays, 3)) * [0.1, 1.0, 1.0] + known.mean(axis=0) / 4.0])
    known = (known / np.linalg.norm(known, axis=1, keepdims=True)).astype(np.float32)
    holes = rng.normal(size=(6000, 3))
    holes = (holes / np.linalg.norm(holes, axis=1, keepdims=True)).astype(np.float32)
    surely = scan_rays._surely_wide(holes, known)
    for spacing in (0.003, 0.01):
        told = scan_rays._are_wide(holes, known, spacing)
        assert told[surely].all() and not told.all()
        np.testing.assert_array_equal(scan_rays._wide(holes, known, spacing), holes[told])
    assert strays or surely.mean() > 0.2


def test_a_full_scan_has_no_holes_and_a_lost_block_is_one():
    assert len(rays_of_scan(full_scan()).distance) == len(full_scan().points)
    kept = np.ones((200, 320), bool)
    kept[60:100, 100:200] = False
    rays = rays_of_scan(full_scan(keep=kept.ravel()))
    lost = rays.direction[rays.measured :] @ turned(30.0)
    assert np.isinf(rays.distance[rays.measured :]).all()
    wanted = OAK_D_PRO_SMALL.directions()[~kept.ravel()]
    low, high = (pick(wanted[:, 1:] / wanted[:, :1], axis=0) for pick in (np.min, np.max))
    inside = lost[:, 1:] / lost[:, :1]
    assert (
        0.8 * len(wanted) < len(lost) <= len(wanted) and (inside >= low - 1e-4).all() and (inside <= high + 1e-4).all()
    )


def test_without_a_sensor_the_view_is_what_points_span():
    rays = rays_of_scan(full_scan()._replace(sensor=None))
    toward = rays.pattern @ turned(30.0)
    azimuth = np.degrees(np.arctan2(toward[:, 1], toward[:, 0]))
    assert abs(azimuth).max() == pytest.approx(40.0, abs=2.0)
    # The upper edge of a picture is lowest in its corners, as elevations go.
    top = np.degrees(np.arcsin(toward[:, 2]))
    assert top.max() == pytest.approx(27.5, abs=0.6) and top[abs(azimuth) > 38].max() < 22.9


@pytest.mark.parametrize("name", ["tls", "ouster-64", "velodyne-16"])
def test_a_turning_scanner_has_a_bounded_pattern_that_holds_its_rays(name):
    sensor = sensor_named(name)
    direction = sensor.directions()
    every = max(1, len(direction) // 50_000)
    scan = PosedScan((PLACE + 5.0 * direction[::every]).astype(np.float32), PLACE, np.eye(3), sensor)
    for one in (scan, scan._replace(sensor=None)):
        rays = rays_of_scan(one)
        assert 500 < len(rays.pattern) <= 2 * MOST_PATTERN and np.isfinite(rays.pattern).all()
        # No part of the sphere that the sensor covers is without a direction of the pattern.
        from scipy.spatial import cKDTree

        apart = cKDTree(rays.pattern).query(direction[::997])[0]
        assert np.quantile(apart, 0.99) < max(2.5 * rays.spacing, np.radians(2.5))


@pytest.mark.parametrize("more", [1, 1000, MOST_RAYS // 3, 2 * MOST_RAYS + 10])
def test_of_more_points_than_needed_each_part_of_the_file_gives_one_and_none_twice(more):
    count = MOST_RAYS + more
    points = np.column_stack([np.ones(count), np.zeros(count), np.arange(count)]).astype(np.float32)
    number, again = (drawn(points, np.zeros(3))[:, 2].astype(int) for _ in range(2))
    np.testing.assert_array_equal(number, again)
    assert len(number) == MOST_RAYS and np.all(np.diff(number) > 0)
    assert np.abs(number - np.arange(MOST_RAYS) * count / MOST_RAYS).max() <= count / MOST_RAYS + 1.0
    assert np.any(drawn(points, np.zeros(3), seed=1)[:, 2] != number) == (more > 0)


def test_a_scan_of_the_sensor_itself_is_refused():
    points = np.tile(PLACE, (30, 1)).astype(np.float32)
    with pytest.raises(ValueError, match="no point is farther"):
        rays_of_scan(PosedScan(points, PLACE, np.eye(3)))


@pytest.mark.parametrize(("name", "gap"), [("velodyne-16", 2.0), ("ouster-64", 0.71)])
@pytest.mark.parametrize("pitch", [0.0, 5.0])
def test_what_lies_between_the_rings_of_an_unknown_sensor_is_no_hole(name, gap, pitch):
    """And a lost block is one."""
    own = sensor_named(name).directions()
    direction = own @ turned(20.0, pitch).T
    azimuth = np.degrees(np.arctan2(direction[:, 1], direction[:, 0]))
    lost = (azimuth > 40.0) & (azimuth < 70.0) & (abs(np.degrees(np.arcsin(own[:, 2]))) < 8.0)
    for kept, holes in ((np.ones(len(direction), bool), False), (~lost, True)):
        rays = rays_of_scan(PosedScan((PLACE + 5.0 * direction[kept]).astype(np.float32), PLACE, turned(20.0, pitch)))
        assert np.degrees(rays.spacing) == pytest.approx(gap, rel=0.15)
        without = rays.direction[rays.measured :]
        where = np.degrees(np.arctan2(without[:, 1], without[:, 0]))
        inside = (where > 40.0) & (where < 70.0)
        assert (len(without) - inside.sum()) < 0.005 * len(rays.pattern)
        if holes:
            assert inside.sum() * np.radians(0.3) ** 2 > 0.5 * np.radians(30.0) * np.radians(16.0)


@pytest.mark.parametrize("name", ["oak-d-pro-small", "tls"])
def test_a_sensor_without_rings_has_none(name):
    direction = sensor_named(name).directions()[:: 1 if "oak" in name else 7]
    for pitch in (0.0, 10.0):
        scan = PosedScan((PLACE + 5.0 * direction @ turned(20.0, pitch).T).astype(np.float32), PLACE, np.eye(3))
        assert np.degrees(rays_of_scan(scan).spacing) < 1.0


def in_a_box(half, count=150_000):
    """Directions drawn at random over the sphere, and points (N, 3) on the inside of a box around PLACE."""
    direction = np.random.default_rng(3).normal(size=(count, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    return direction, PLACE + direction * np.min(half / np.abs(direction), axis=1, keepdims=True)


@pytest.mark.parametrize("voxel", [0.03, 0.05, 0.1])
@pytest.mark.parametrize("drawn_from", [1, 5])
def test_what_lies_between_points_that_were_thinned_is_no_hole(voxel, drawn_from):
    """One point a voxel lies far apart on what is near, and densely on what is far; a lost block is one still."""
    direction, points = in_a_box(np.array([5.0, 1.2, 1.1]))
    direction, points = direction[::drawn_from], points[::drawn_from].astype(np.float32)
    kept = thin_clouds([points], voxel)[0]
    whole = rays_of_scan(PosedScan(points[kept], PLACE, np.eye(3)))
    assert len(whole.direction) - whole.measured < 0.1 * len(whole.pattern)
    block = (direction[kept, 0] > 0.5) & (np.abs(direction[kept, 1:]) < 0.4).all(axis=1)
    holed = rays_of_scan(PosedScan(points[kept][~block], PLACE, np.eye(3)))
    lost = holed.direction[holed.measured :]
    inside = (lost[:, 0] > 0.5) & (np.abs(lost[:, 1:]) < 0.4).all(axis=1)
    wanted = (holed.pattern[:, 0] > 0.5) & (np.abs(holed.pattern[:, 1:]) < 0.4).all(axis=1)
    assert inside.sum() > 0.6 * wanted.sum() and (~inside).sum() < 0.1 * len(holed.pattern)
