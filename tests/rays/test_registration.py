"""Registration: known motions of generated scans are found, though reality differs from the prior."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jaxmm.rays.registration import CUT, LEAST_WALLS, _Fit, register
from warp_scanner.clouds.points import points_of
from warp_scanner.rooms.pairs import PRESETS, make_pairs

SETTINGS = dataclasses.replace(
    PRESETS["varied"], scenario="wall_removed", condition="occluded", position_error=0.05, angle_error=1.0,
    range_noise=0.01, seed=9,
)  # fmt: skip


@pytest.fixture(scope="module")
def scans():
    """Of 24 rooms: robot points as believed and as they are, and what the prior shows."""
    pairs = make_pairs(SETTINGS, np.arange(24))
    believed, true, prior = (
        points_of(pose, pairs.directions, scan.distance)
        for pose, scan in ((pairs.pose, pairs.robot), (pairs.true_pose, pairs.robot), (pairs.pose, pairs.dt))
    )
    there, shown = np.isfinite(pairs.robot.distance), np.isfinite(pairs.dt.distance)
    rows = range(24)
    return [(believed[r][there[r]], true[r][there[r]], prior[r][shown[r]], pairs.pose.position[r]) for r in rows]


def moved(points, motion):
    return points @ motion[:3, :3].T + motion[:3, 3]


def test_scans_come_to_lie_where_they_were_taken(scans):
    before, after = [], []
    for believed, true, prior, sensor in scans:
        found = register(believed, prior, sensor)
        before.append(np.linalg.norm(believed - true, axis=1).mean())
        after.append(np.linalg.norm(moved(believed, found.motion) - true, axis=1).mean())
        assert found.overlap >= found.overlap_before - 0.05
    assert np.median(before) > 0.08 and np.median(after) < 0.01
    assert np.mean(np.less(after, before)) > 0.9 and np.max(after) < 0.5


def test_a_scan_that_fits_stays(scans):
    off = []
    for _, true, prior, sensor in scans:
        found = register(true, prior, sensor)
        off.append(np.linalg.norm(moved(true, found.motion) - true, axis=1).mean())
    assert np.median(off) < 0.005 and np.max(off) < 0.2


@pytest.mark.parametrize("scenario, row", [("wall_removed", 7), ("pillar_removed", 4), ("pillar_removed", 32)])
def test_what_stands_behind_a_gone_wall_is_not_drawn_to_its_place(scenario, row):
    """Rooms in which a motion of 0.1 to 0.5 m would make more points match than the true pose does."""
    exact = dataclasses.replace(SETTINGS, scenario=scenario, position_error=0.0, angle_error=0.0, seed=2)
    pairs = make_pairs(exact, np.array([row]))
    seen, shown = (
        points_of(pairs.pose, pairs.directions, scan.distance)[0][np.isfinite(scan.distance[0])]
        for scan in (pairs.robot, pairs.dt)
    )
    found = register(seen, shown, pairs.pose.position[0])
    np.testing.assert_allclose(moved(seen, found.motion), seen, atol=0.03)


def test_moving_all_moves_the_answer(scans):
    believed, _, prior, sensor = scans[0]
    turn, shift = Rotation.from_euler("z", 0.7).as_matrix(), np.array([4e5, -3e5, 50.0])
    here, there = (
        register(believed, prior, sensor),
        register(believed @ turn.T + shift, prior @ turn.T + shift, turn @ sensor + shift),
    )
    np.testing.assert_allclose(
        moved(believed @ turn.T + shift, there.motion), moved(believed, here.motion) @ turn.T + shift, atol=0.02
    )


def test_one_bare_wall_tells_nothing_of_the_way_along_it():
    y, z = np.meshgrid(np.linspace(-6, 6, 200), np.linspace(-1, 1, 40))
    wall = np.column_stack([np.full(y.size, 4.0), y.ravel(), z.ravel()])
    found = register(wall + np.array([0.1, 0.15, 0.1]), wall, np.zeros(3))
    np.testing.assert_allclose(found.motion[0, 3], -0.1, atol=0.01)
    assert np.abs(found.motion[1:3, 3]).max() < 0.03


def test_clouds_of_few_points_stay():
    found = register(np.zeros((5, 3)), np.zeros((5, 3)), np.zeros(3))
    np.testing.assert_array_equal(found.motion, np.eye(4))
    assert found.overlap == 0.0 and np.isnan(found.residual)


def plane(x, width, step=0.05):
    """A wall across x, 2.5 m high, about the sensor."""
    y, z = np.meshgrid(np.arange(-width / 2, width / 2, step), np.arange(-1.2, 1.3, step))
    return np.column_stack([np.full(y.size, x), y.ravel(), z.ravel()])


@pytest.mark.parametrize(
    "new, all_of_it, that_could_show",
    [
        pytest.param(plane(6.0, 4.0), 0.5, 1.0, id="behind a wall that is gone"),
        pytest.param(plane(2.0, 2.0) - [0.0, 4.0, 0.0], 0.67, 1.0, id="beside the prior"),
        pytest.param(plane(1.0, 1.0), 0.8, 0.92, id="before a wall, a third of it"),
        pytest.param(np.zeros((0, 3)), 1.0, 1.0, id="nothing new"),
    ],
)
def test_what_a_prior_could_not_show_is_no_sign_of_another_place(new, all_of_it, that_could_show):
    """Two thirds of the prior's wall at 3 m, or all of it, are still there; one looks past it, or at something new."""
    prior = plane(3.0, 6.0)
    still_there = prior[np.abs(prior[:, 1]) > 1.0] if len(new) else prior
    scan = np.concatenate([still_there, new])
    for in_sight_only, expected in ((False, all_of_it), (True, that_could_show)):
        found = register(scan, prior, np.zeros(3), in_sight_only=in_sight_only)
        assert found.upright == pytest.approx(expected, abs=0.06)
        np.testing.assert_allclose(found.motion, np.eye(4), atol=0.02)
    away = np.array([10.0, 5.0, 0.0])
    moved_away = register(scan + away, prior + away, away, in_sight_only=True)
    assert moved_away.upright == pytest.approx(that_could_show, abs=0.06)


@pytest.mark.parametrize("lying, by_chance", [(0.0, 0.0), (0.0, 0.6), (0.08, 0.0), (0.3, 0.5), (1.0, 0.0)])
def test_walls_that_match_by_chance_do_not_lie_closely(lying, by_chance):
    """Of 20,000 points on walls some lie upon the prior's, some anywhere about them, the rest nowhere."""
    rng, wall = np.random.default_rng(3), np.arange(40_000) % 2 == 0
    kind, off = rng.random(40_000), rng.uniform(-CUT, CUT, 40_000)
    off[kind < lying] = rng.normal(0.0, 0.005, np.sum(kind < lying))
    for asked in (wall, wall & (np.arange(40_000) % 4 == 0)):  # all walls, or those that a cloud could show
        fit = _Fit(np.eye(4), np.ones(40_000), off, asked, wall & (kind < lying + by_chance), asked)
        assert fit.closely == pytest.approx(lying, abs=0.02)
        assert fit.upright == pytest.approx(lying + by_chance, abs=0.02)


def test_few_points_on_walls_or_none_tell_nothing():
    for count in (0, LEAST_WALLS - 1, LEAST_WALLS):
        wall = np.arange(1000) < count
        assert _Fit(np.eye(4), np.ones(1000), np.zeros(1000), wall, wall, wall).closely == float(count >= LEAST_WALLS)


def before_a_wall(off):
    """A wall, that far off its place at 3 m [m], the floor, and a square column at 2 m, of which two sides show."""
    front = plane(2.0, 0.5)
    side = np.column_stack([front[:, 1] + 2.25, np.full(len(front), 0.25), front[:, 2]])
    x, y = np.meshgrid(np.arange(0.5, 3.0, 0.05), np.arange(-3.0, 3.0, 0.05))
    floor = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, -1.25)])
    return np.concatenate([plane(3.0 + off, 6.0), front, side, floor])


@pytest.mark.parametrize("off", [-0.4, -0.25, 0.2, 0.25, 0.3])
def test_a_wall_that_moved_moves_no_scan_off_a_column_that_did_not(off):
    found = register(before_a_wall(off), before_a_wall(0.0), np.zeros(3))
    np.testing.assert_allclose(found.motion, np.eye(4), atol=0.02)
    assert found.left < 0.1


@pytest.mark.parametrize("off", [[0.25, 0.1, 0.0], [-0.3, 0.0, 0.02], [0.02, 0.01, 0.0], [0.0, 0.06, 0.0]])
def test_where_all_is_off_it_is_the_pose(off):
    found = register(before_a_wall(0.0) + off, before_a_wall(0.0), np.zeros(3))
    np.testing.assert_allclose(found.motion[:3, 3], -np.array(off), atol=0.03)
    assert found.left < 0.5


@pytest.mark.parametrize("off", [0.06, 0.08, 0.1, 0.12])
def test_a_lining_before_a_wall_moves_no_scan_half_the_way(off):
    """What lies exactly where it is believed to be does not lie between two places afterwards."""
    wall, lining = plane(3.0, 6.0), plane(3.0 - off, 6.0)
    behind, few = plane(-3.0, 6.0), wall[np.abs(wall[:, 1]) > 2.0]
    aside = behind[:, [1, 0, 2]]
    prior = np.concatenate([wall, aside, behind])
    scan = np.concatenate([few, lining[np.abs(lining[:, 1]) < 2.0], aside, behind])
    np.testing.assert_allclose(register(scan, prior, np.zeros(3)).motion, np.eye(4), atol=0.01)


@pytest.mark.parametrize("raised", [-0.06, 0.04])
def test_a_scan_that_is_raised_comes_down_though_its_walls_fit_as_they_are(scans, raised):
    """Walls fit at any height; floor and ceiling tell it."""
    for _, true, prior, sensor in scans[:8]:
        lifted = true + np.array([0.0, 0.0, raised])
        found = register(lifted, prior, sensor)
        if not any(way[2] for way in found.open):
            assert abs(np.median(moved(lifted, found.motion)[:, 2] - true[:, 2])) < 0.01


def test_a_corridor_is_told_by_its_direction_and_a_room_tells_none():
    """Planes of points, 12 m long: two walls, a floor and a ceiling; and the same with both ends."""
    rng, turn = np.random.default_rng(4), np.radians(30.0)
    along, beside, up = rng.uniform(-6, 6, 40_000), rng.uniform(-1.2, 1.2, 40_000), rng.uniform(0, 3, 40_000)
    side, end = rng.choice([-1.0, 1.0], (2, 40_000))
    corridor = np.concatenate(
        [np.column_stack([along, 1.2 * side, up]), np.column_stack([along, beside, 1.5 + 1.5 * end])]
    )
    room = np.concatenate([corridor, np.column_stack([6.0 * end, beside, up])])
    rotation = np.array([[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]])
    eye = np.array([0.3, 0.2, 1.4])
    (way,) = register(corridor @ rotation.T, corridor @ rotation.T, rotation @ eye).open
    assert abs(np.dot(way, rotation[:, 0])) > np.cos(np.radians(6.0))
    assert register(room @ rotation.T, room @ rotation.T, rotation @ eye).open == ()
