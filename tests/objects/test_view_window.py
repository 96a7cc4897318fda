"""The window that a scan looks through, and how far it is to its edge."""

import numpy as np
import pytest

from jaxmm.objects.view_window import edge_beyond, view_of
from warp_scanner.sensors.sensors import OAK_D_PRO_SMALL

SENSOR = np.array([1.0, -2.0, 1.4])
AHEAD = np.array([3.0, -2.0])  # two metres along x


def camera(yaw, left=40.0, right=35.0, up=25.0, down=30.0, seed=0):
    """Points at all distances within a window of these angles [deg], its corners among them."""
    rng = np.random.default_rng(seed)
    x = np.append(rng.uniform(-np.tan(np.radians(right)), np.tan(np.radians(left)), 4000), [0.0] * 16)
    z = np.append(rng.uniform(-np.tan(np.radians(down)), np.tan(np.radians(up)), 4000), [0.0] * 16)
    x[-16:] = np.tan(np.radians(np.tile([left, left, -right, -right], 4)))
    z[-16:] = np.tan(np.radians(np.tile([up, -down, up, -down], 4)))
    turn = np.radians(yaw)
    ahead, side = np.array([np.cos(turn), np.sin(turn), 0.0]), np.array([-np.sin(turn), np.cos(turn), 0.0])
    lines = ahead + x[:, None] * side + z[:, None] * np.array([0.0, 0.0, 1.0])
    return SENSOR + rng.uniform(0.5, 8.0, (len(x), 1)) * lines


@pytest.mark.parametrize("yaw", [0.0, 77.0, 180.0, -120.0])
@pytest.mark.parametrize("distance", [0.8, 2.0, 5.0])
def test_the_edge_is_where_the_window_ends(yaw, distance):
    """On a line across the line of sight, whichever way the camera looks."""
    view, turn = view_of(camera(yaw), SENSOR), np.radians(yaw)
    start = SENSOR[:2] + distance * np.array([np.cos(turn), np.sin(turn)])
    left = np.array([-np.sin(turn), np.cos(turn)])
    heights = np.full(5, SENSOR[2])
    for toward, angle in ((left, 40.0), (-left, 35.0)):
        found = edge_beyond(view, start, toward, heights, 9.0)
        assert found == pytest.approx(distance * np.tan(np.radians(angle)), abs=0.051)
        assert edge_beyond(view, start, toward, heights, 0.3) == 0.3


def test_what_is_behind_or_above_the_window_is_out_of_view():
    view = view_of(camera(0.0), SENSOR)
    back = SENSOR[:2] - [2.0, 0.0]
    level = np.full(3, SENSOR[2])
    assert edge_beyond(view, back, np.array([0.0, 1.0]), level, 3.0) == 0.0
    assert edge_beyond(view, AHEAD, np.array([0.0, 1.0]), level + 1.2, 3.0) == 0.0  # 31 degrees up
    # Toward the camera a height that is in view at first leaves it where it is steep enough.
    found = edge_beyond(view, AHEAD, np.array([-1.0, 0.0]), level + 0.5, 3.0)
    assert found == pytest.approx(2.0 - 0.5 / np.tan(np.radians(25.0)), abs=0.051)


def test_half_of_the_heights_must_be_in_view():
    view = view_of(camera(0.0), SENSOR)
    above, within = SENSOR[2] + 1.5, SENSOR[2]
    toward = np.array([0.0, 1.0])
    assert edge_beyond(view, AHEAD, toward, np.array([above, above, within]), 3.0) == 0.0
    assert edge_beyond(view, AHEAD, toward, np.array([above, within]), 3.0) > 1.5
    assert edge_beyond(view, AHEAD, toward, np.array([above, within, within]), 3.0) > 1.5


@pytest.mark.parametrize(
    "stray", [[0.0, 0.0, 0.0], [-0.02, 0.0, 0.0], [-1.0, 0.3, 0.0], [0.4, 1.5, 0.1], [1.0, 0.0, 4.0]]
)
def test_single_errors_of_a_sensor_move_no_edge(stray):
    """At the lens, behind it, far to the side and far above."""
    points, level = camera(0.0), np.full(3, SENSOR[2])
    views = view_of(points, SENSOR), view_of(np.vstack([points, SENSOR + stray]), SENSOR)
    for toward in ([0.0, 1.0], [0.0, -1.0]):
        edges = [edge_beyond(view, AHEAD, np.array(toward), level, 9.0) for view in views]
        assert edges[0] == edges[1] < 2.0


def test_a_scan_of_all_around_or_of_hardly_anything_has_no_edges():
    turn = np.linspace(0.0, 2.0 * np.pi, 200, endpoint=False)
    around = SENSOR + np.column_stack([np.cos(turn), np.sin(turn), np.zeros(200)])
    half = around[turn < np.pi * 1.05]
    line = SENSOR + np.column_stack([np.ones(50), np.linspace(-0.5, 0.5, 50), np.zeros(50)])
    y, z = np.meshgrid([-1.5, -0.5, 0.5, 1.5], [-1.0, 0.0, 1.0])
    apart = SENSOR + np.column_stack([np.ones(12), y.ravel(), z.ravel()])  # every one alone
    for points in (around, half, line, line[:3], line[:0], apart):
        assert view_of(points, SENSOR) is None
    assert edge_beyond(None, SENSOR[:2], np.array([1.0, 0.0]), np.array([1.0]), 3.0) == 3.0


def test_the_window_of_a_camera_is_its_field_of_view():
    """Of the preset that most of the judge's rooms are seen with: what its outermost pixels see is in, no more."""
    directions = OAK_D_PRO_SMALL.directions().reshape(-1, 3).astype(np.float64)
    view = view_of(SENSOR + 4.0 * directions, SENSOR)
    level = directions[np.abs(directions[:, 2]) < 0.02]
    widest = np.degrees(np.abs(np.arctan2(level[:, 1], level[:, 0])).max())
    found = edge_beyond(view, AHEAD, np.array([0.0, 1.0]), np.array([SENSOR[2]]), 9.0)
    assert np.degrees(np.arctan2(found, 2.0)) == pytest.approx(widest, abs=1.5)
