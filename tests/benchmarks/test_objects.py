"""What the benchmark of objects hands to the search for them."""

import numpy as np

from benchmarks.objects import _rays
from jaxmm.runs.room_scans import room_cases


def test_all_rays_end_on_the_points_of_the_scan_that_a_user_would_have():
    for case in room_cases("wall_added", "occluded", 2, range(4)):
        rays = _rays(case.pairs, case.row)
        back = np.isfinite(rays.distance)
        ends = rays.origin + rays.direction[back] * rays.distance[back, None]
        assert len(rays.distance) == 320 * 200
        np.testing.assert_array_equal(rays.origin, case.scan.position)
        np.testing.assert_allclose(ends, case.scan.points, atol=2e-5)


def test_rays_start_where_the_robot_believes_to_be():
    erring = {"sensor_gap": 0.3, "position_error": 0.1, "angle_error": 2.0}
    for case in room_cases("pillar_added", "clean", 2, range(4), **erring):
        rays, believed, true = _rays(case.pairs, case.row), case.pairs.pose, case.pairs.true_pose
        assert not np.array_equal(believed.position[case.row], true.position[case.row])
        np.testing.assert_array_equal(rays.origin, believed.position[case.row])
        assert not np.allclose(believed.yaw[case.row], true.yaw[case.row])
        middle = rays.direction[np.argmax(case.pairs.directions[:, 0])]
        ahead = np.radians([believed.yaw[case.row], believed.pitch[case.row]])
        straight = [np.cos(ahead[0]) * np.cos(ahead[1]), np.sin(ahead[0]) * np.cos(ahead[1]), np.sin(ahead[1])]
        assert np.degrees(np.arccos(np.clip(middle @ straight, -1.0, 1.0))) < 0.5
