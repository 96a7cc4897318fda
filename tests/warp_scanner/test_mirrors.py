"""Mirrors hang on walls of their rooms, before the sensor, and never reach out of them."""

import numpy as np

from warp_scanner import draws
from warp_scanner.rooms.mirrors import GLASS, MIRROR, THICKNESS, hung_mirrors, sheen_of
from warp_scanner.scenes.scenes import BOX, OTHER
from warp_scanner.sensors.poses import Pose, rotation_of
from warp_scanner.sensors.scan import Rays, cast_rays

ROOMS = 500


def test_every_mirror_hangs_inside_on_a_wall_and_before_the_sensor():
    rng = np.random.default_rng(0)
    size = rng.uniform([3, 3, 2.4], [20, 20, 8], (ROOMS, 3))
    place = rng.uniform(-0.45, 0.45, (ROOMS, 3)) * size
    pose = Pose(place.astype(np.float32), rng.uniform(-180, 180, ROOMS).astype(np.float32), np.zeros(ROOMS, np.float32))
    key = draws.keys(4, np.arange(ROOMS))
    mirrors = hung_mirrors(size, pose, key, 40)
    assert (mirrors.kind == BOX).all() and (mirrors.element == 40).all() and (mirrors.semantic == OTHER).all()
    high = np.abs(mirrors.center[:, 0]) + mirrors.half_size[:, 0]
    assert (high <= size / 2 + 1e-5).all()
    axis = np.argmin(mirrors.half_size[:, 0], axis=1)
    rows = np.arange(ROOMS)
    np.testing.assert_allclose(high[rows, axis], size[rows, axis] / 2, atol=1e-5)
    np.testing.assert_allclose(2 * mirrors.half_size[rows, 0, axis], THICKNESS, rtol=1e-5)
    view = np.radians(np.linspace(-31, 31, 400))
    fan = np.stack([np.cos(view), np.sin(view), np.zeros(400)], axis=1).astype(np.float32)
    level = place.copy()
    level[:, 2] = mirrors.center[:, 0, 2]
    seen = cast_rays(mirrors, None, Rays(level, fan, rotation_of(pose.yaw, pose.pitch)))
    assert (seen.element == 40).any(axis=1).all()
    again = hung_mirrors(size[3:4], Pose(*(field[3:4] for field in pose)), key[3:4], 40)
    np.testing.assert_array_equal(again.center[0], mirrors.center[3])


def test_the_table_of_sheen_names_what_it_was_given():
    found = sheen_of(6, {2: GLASS, 5: MIRROR})
    assert found.mirrored.tolist() == [0, 0, 0.3, 0, 0, 0.95] and found.passed.tolist() == [0, 0, 0.5, 0, 0, 0]
