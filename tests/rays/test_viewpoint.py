"""Viewpoints: known poses of generated rooms come back, released scans of one pair agree, guesses are refused."""

import dataclasses
import functools
import re

import numpy as np
import pytest

from jaxmm.inputs import InputError
from jaxmm.learning.preprocess import voxel_downsample
from jaxmm.rays.scan_rays import overtaken
from jaxmm.rays.viewpoint import doubts_about, estimate, estimate_by_other, is_turned_away
from jaxmm.runs.room_scans import room_cases
from jaxmm.thesis import repository
from warp_scanner.clouds.points import points_of
from warp_scanner.clouds.voxels import thin_clouds
from warp_scanner.rooms.pairs import PRESETS, make_pairs

RELEASED_VIEW = (80.0, 60.0)  # [deg] what the released scans fill; the text says 80 x 55
ROOM_COUNT = 3


@functools.cache
def scans(preset, noise=0.0, seed=7, first=0, count=ROOM_COUNT):
    """[(points (N, 3) shuffled, pose (5,) in m and degrees)] of the robot scans of a few rooms."""
    config = dataclasses.replace(PRESETS[preset], seed=seed, range_noise=noise)
    pairs = make_pairs(config, np.arange(first, first + count))
    points = points_of(pairs.true_pose, pairs.directions, pairs.robot.distance)
    rng, pose = np.random.default_rng(0), pairs.true_pose
    return [
        (
            rng.permutation(points[room][np.isfinite(points[room]).all(axis=1)]),
            np.array([*pose.position[room], pose.yaw[room], pose.pitch[room]], np.float64),
        )
        for room in range(count)
    ]


def difference(viewpoint, pose):
    """(5,) [m, deg] estimate minus pose, angles in -180 to 180."""
    found = np.array([*viewpoint.position, viewpoint.yaw, viewpoint.pitch])
    apart = found - pose
    apart[3] = (apart[3] + 180.0) % 360.0 - 180.0
    return apart


def pose_of(viewpoint):
    return np.array([*viewpoint.position, viewpoint.yaw, viewpoint.pitch])


@pytest.mark.parametrize("preset, pitch, noise", [("thesis", 0.0, 0.0), ("varied", None, 0.0), ("varied", None, 0.01)])
def test_whole_scans_tell_where_they_were_taken(preset, pitch, noise):
    within = []
    for points, pose in scans(preset, noise):
        found = estimate(points, pitch=pitch)
        apart = difference(found, pose)
        assert np.linalg.norm(apart[:3]) < 0.05 and np.abs(apart[3:]).max() < 0.5
        assert found.touched > 0.9 and found.hidden < 0.05
        assert np.all(found.deviation[:4] > 0.0) and (found.deviation[4] > 0.0) == (pitch is None)
        within.append(np.abs(apart[: 4 + (pitch is None)]) <= 2.0 * found.deviation[: 4 + (pitch is None)])
    assert np.mean(within) > 0.7


@pytest.mark.long
@pytest.mark.parametrize("preset, pitch", [("thesis", 0.0), ("varied", None)])
def test_scans_thinned_to_voxels_tell_it_too(preset, pitch):
    for points, pose in scans(preset):
        found = estimate(points[voxel_downsample(points, 0.1)], pitch=pitch)
        apart = difference(found, pose)
        assert np.linalg.norm(apart[:3]) < 0.1 and np.abs(apart[3:]).max() < 1.0
        assert np.all(np.abs(apart) <= 3.0 * found.deviation + 1e-9)
        assert np.all(found.deviation[:3] < 0.1)


def test_nearly_all_points_lie_inside_of_the_estimated_view():
    for points, _ in scans("thesis"):
        points = points[voxel_downsample(points, 0.1)]
        forward, left, up = local(points, pose_of(estimate(points))).T
        wide, high = np.tan(np.radians([40.0, 27.5])) * 1.001
        assert np.sum((np.abs(left) > wide * forward) | (np.abs(up) > high * forward)) <= 20


def test_edges_of_coarse_clouds_count_as_touched():
    for points, pose in scans("thesis", first=3, count=1):
        found = estimate(points[voxel_downsample(points, 0.2)])
        assert found.touched > 0.8 and np.linalg.norm(found.position - pose[:3]) < 0.2


def test_a_wall_close_to_one_edge_does_not_let_the_background_pull():
    ((points, pose),) = scans("thesis", seed=2, first=4, count=1)  # few voxels of the near wall lie on its edge
    apart = difference(estimate(points[voxel_downsample(points, 0.1)], seed=2), pose)
    assert np.linalg.norm(apart[:3]) < 0.1 and np.abs(apart[3]) < 1.0


def test_other_fields_of_view_are_found_too():
    config = dataclasses.replace(
        PRESETS["thesis"], sensor=dataclasses.replace(PRESETS["thesis"].sensor, horizontal_fov=60.0, vertical_fov=45.0)
    )
    pairs = make_pairs(config, np.arange(1))
    points = points_of(pairs.true_pose, pairs.directions, pairs.robot.distance)[0]
    pose = np.array([*pairs.true_pose.position[0], pairs.true_pose.yaw[0], 0.0])
    apart = difference(estimate(points, 60.0, 45.0), pose)
    assert np.linalg.norm(apart[:3]) < 0.05 and np.abs(apart[3]) < 0.5


@pytest.mark.long
def test_both_released_scans_of_a_pair_have_one_viewpoint(data_root):
    if not (data_root / "thesis" / "datasets").is_dir():
        pytest.skip(f"needs the thesis's scans: no folder {data_root / 'thesis' / 'datasets'}")
    pairs = [pair for pair in repository.find_pairs(data_root / "thesis") if pair.condition == "clean"][:6]
    assert [pair.source for pair in pairs] == 4 * ["synthetic"] + 2 * ["atlas"]
    for pair in pairs:
        scored, other = (estimate(np.load(path), *RELEASED_VIEW) for path in (pair.scored, pair.other))
        apart = difference(scored, pose_of(other))
        assert np.linalg.norm(apart[:3]) < 0.1 and np.abs(apart[3]) < 1.0, pair
        # The text's sensor stands 1 m high: floors lie at -1.5 m in the rooms, at 0 m in the building.
        assert abs(scored.position[2] - (1.0 if pair.source == "atlas" else -0.5)) < 0.03, pair


def test_a_wrong_field_of_view_is_noticed():
    """Every cloud is refused; where the edges tell enough, the reason names what fits better."""
    reasons = []
    for points, _ in scans("thesis"):
        with pytest.raises(InputError, match="80 x 45 degrees") as caught:
            estimate(points, 80.0, 45.0)
        reasons.append(str(caught.value))
    assert any("others fit far better" in reason for reason in reasons), reasons


def test_moving_and_turning_a_cloud_moves_and_turns_its_viewpoint():
    points, _ = scans("varied")[0]
    points = points.astype(np.float64)
    here = estimate(points, pitch=None)
    turn, shift = np.radians(137.0), np.array([40.0, -7.0, 3.0])
    rotation = np.array([[np.cos(turn), -np.sin(turn), 0.0], [np.sin(turn), np.cos(turn), 0.0], [0.0, 0.0, 1.0]])
    there = estimate(points @ rotation.T + shift, pitch=None)
    expected = np.array([*(rotation @ here.position + shift), here.yaw + 137.0, here.pitch])
    assert np.abs(difference(there, expected)).max() < 2e-3
    np.testing.assert_allclose(there.touched, here.touched, atol=0.02)


def test_coordinates_of_a_national_grid_lose_nothing():
    points, _ = scans("thesis")[1]
    shift = np.array([1e6, 5e6, 400.0])
    near, far = estimate(points.astype(np.float64)), estimate(points.astype(np.float64) + shift)
    np.testing.assert_allclose(far.position - shift, near.position, atol=1e-3)
    np.testing.assert_allclose(far.yaw, near.yaw, atol=1e-2)


@pytest.mark.long
def test_a_seed_fixes_the_estimate_and_order_and_copies_of_points_do_not_matter():
    points, _ = scans("thesis")[2]
    first = estimate(points, seed=3)
    for again in (points, points[::-1], np.vstack([points, points[:500]])):
        # The median of copied points is another centre, so rounding differs.
        for one, other in zip(first, estimate(again, seed=3), strict=True):
            np.testing.assert_allclose(other, one, rtol=0, atol=1e-6)
    assert all(np.array_equal(one, other) for one, other in zip(first, estimate(points, seed=3), strict=True))
    assert np.abs(difference(estimate(points, seed=4), pose_of(first))).max() < 0.1


def test_a_few_strays_do_not_move_it():
    points, pose = scans("thesis")[0]
    rng = np.random.default_rng(0)
    # Beside the view, in pairs: lone ones have a wide spacing, which alone makes them count for little.
    yaw = np.radians(pose[3] + rng.uniform(50.0, 75.0, 20) * rng.choice([-1.0, 1.0], 20))
    strays = pose[:3] + 2.0 * np.column_stack([np.cos(yaw), np.sin(yaw), rng.uniform(-0.2, 0.2, 20)])
    for cloud in (
        np.vstack([points, strays, strays + 0.01]),
        np.vstack([points[voxel_downsample(points, 0.1)], pose[:3] + 5.0 * (strays[:2] - pose[:3])]),
    ):
        found = estimate(cloud)
        apart = difference(found, pose)
        assert np.linalg.norm(apart[:3]) < 0.1 and np.abs(apart[3]) < 0.5 and found.touched > 0.9


def test_part_of_an_edge_may_be_missing():
    points, pose = scans("thesis")[0]
    forward, left, up = local(points, pose).T
    missing = (up < -0.3 * forward) & (np.abs(left) < 0.6 * forward)  # as where low furniture was filtered out
    assert missing.mean() > 0.1
    apart = difference(estimate(points[~missing]), pose)
    assert np.linalg.norm(apart[:3]) < 0.05 and np.abs(apart[3]) < 0.5


def test_what_stands_right_before_a_camera_is_made_up_for_by_another_scan_from_there_and_from_nowhere_else():
    """A third of the view is gone, with a whole edge: as where a pillar next to the camera was filtered out."""
    points, pose = scans("thesis")[0]
    forward, left, _ = local(points, pose).T
    part = points[left > -0.25 * forward]
    thin, other = (cloud[voxel_downsample(cloud, 0.1)] for cloud in (part, points))
    assert "of the edges" in refusal(lambda: estimate(thin))
    found = estimate_by_other(thin, other, 80.0, 55.0)
    apart = difference(found, pose)
    assert np.linalg.norm(apart[:3]) < 0.1 and np.abs(apart[3:]).max() < 1.0 and 0.3 < found.touched < 0.8
    ahead = np.array([np.cos(np.radians(pose[3])), np.sin(np.radians(pose[3])), 0.0])
    for shift in (0.5 * ahead, -0.5 * ahead, 0.7 * np.array([-ahead[1], ahead[0], 0.0])):
        said = refusal(lambda shift=shift: estimate_by_other(thin + shift, other, 80.0, 55.0))
        assert "in the view of the other scan its points touch" in said
    assert "of the edges of a view" in refusal(lambda: estimate_by_other(other, thin, 80.0, 55.0))


def local(points, pose):
    """(N, 3) points in the frame of a level sensor."""
    yaw = np.radians(pose[3])
    rotation = np.array([[np.cos(yaw), -np.sin(yaw), 0.0], [np.sin(yaw), np.cos(yaw), 0.0], [0.0, 0.0, 1.0]])
    return (points - pose[:3]) @ rotation


def refusal(call):
    """What is said of a cloud that is refused: one line, which names the way out."""
    with pytest.raises(InputError) as caught:
        call()
    message = str(caught.value)
    assert "\n" not in message and "--pose" in message
    return message


def test_points_that_no_single_scan_can_see_are_refused():
    points, pose = scans("thesis")[0]
    behind = pose[:3] + 1.6 * (points[::2] - pose[:3])
    assert re.search(r"\d%.*hidden behind others", refusal(lambda: estimate(np.vstack([points, behind]))))


def test_a_wall_alone_is_refused_for_it_looks_alike_from_behind():
    rng = np.random.default_rng(0)
    wide, high = 3.0 * np.tan(np.radians([40.0, 27.5]))
    wall = np.column_stack([np.full(5000, 3.0), rng.uniform(-wide, wide, 5000), rng.uniform(-high, high, 5000)])
    assert re.search(r"two places, 6.0 m apart, fit alike", refusal(lambda: estimate(wall)))


def test_clouds_that_fill_no_view_are_refused():
    rng = np.random.default_rng(0)
    sphere = rng.normal(size=(2000, 3))
    sphere /= np.linalg.norm(sphere, axis=1, keepdims=True)
    # The shell of a room, as a scanner that turns all round sees it.
    shell = rng.uniform(-0.5, 0.5, (8000, 3))
    shell[np.arange(8000), rng.integers(0, 3, 8000)] = rng.choice([-0.5, 0.5], 8000)
    points, pose = scans("thesis")[0]
    left = local(points, pose)[:, 1]
    half = points[left > 0.0]
    for cloud in (sphere, shell * [10.0, 8.0, 3.0], half, np.linspace([0, 0, 0], [1, 2, 3], 500)):
        said = refusal(lambda cloud=cloud: estimate(cloud))
        assert "edges of a view of 80 x 55 degrees" in said and "%" in said


def test_unusable_points_are_refused():
    points = np.random.default_rng(0).uniform(size=(1000, 3))
    assert re.search("at least 200.*got 10", refusal(lambda: estimate(points[:10])))
    assert re.search("at least 200.*got 0", refusal(lambda: estimate(points[:0])))
    assert re.search("different points.*got 1", refusal(lambda: estimate(np.ones((1000, 3)))))
    points[7] = np.nan
    points[8, 0] = np.inf
    assert re.search("2 of 1000 points.*NaN", refusal(lambda: estimate(points)))


def test_impossible_arguments_are_refused():
    points = np.zeros((300, 3))
    for arguments, word in (((0.0, 55.0), "fields of view"), ((80.0, 180.0), "fields of view")):
        with pytest.raises(ValueError, match=word):
            estimate(points, *arguments)
    with pytest.raises(ValueError, match="pitch"):
        estimate(points, pitch=90.0)
    with pytest.raises(ValueError, match=r"\(N, 3\)"):
        estimate(points[:, :2])


def test_a_pose_that_the_points_contradict_is_doubted_and_the_true_one_is_not():
    turned = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    doubted = 0
    for case in room_cases("all_four", "occluded", 23, range(12)):
        scan = case.scan
        thin = scan.points[thin_clouds([scan.points], 0.1)[0]]
        view = scan.sensor.horizontal_fov, scan.sensor.vertical_fov
        assert doubts_about(scan.points, thin, scan.position, scan.rotation, view) == []
        (doubt,) = doubts_about(scan.points, thin, scan.position, turned @ scan.rotation, view)
        assert "outside the sensor's view" in doubt and "\n" not in doubt
        assert doubts_about(scan.points, thin, scan.position, turned @ scan.rotation, None) == []
        doubted += bool(
            doubts_about(scan.points, thin, scan.position + np.array([1.5, -1.5, 0.0]), scan.rotation, view)
        )
    assert doubted > 8


@pytest.mark.long
@pytest.mark.parametrize("preset", ["varied", "thesis"])
def test_a_place_half_a_metre_off_is_doubted_and_the_true_one_is_told(preset):
    rng, doubted, off = np.random.default_rng(0), 0, []
    for case in room_cases("pillar_added", "occluded", 23, range(24), preset=preset):
        scan = case.scan
        thin = scan.points[thin_clouds([scan.points], 0.1)[0]]
        view = scan.sensor.horizontal_fov, scan.sensor.vertical_fov
        angle = rng.uniform(0.0, 2.0 * np.pi)
        aside = np.array([np.cos(angle), np.sin(angle), 0.0])
        assert doubts_about(scan.points, thin, scan.position + 0.05 * aside, scan.rotation, view) == []
        # Nor is it the place that is wrong where the margin of the image is missing.
        offset = (thin - scan.position) @ scan.rotation
        inside = np.abs(offset[:, 1:] / offset[:, :1]) < 0.87 * np.tan(np.radians(view) / 2)
        assert doubts_about(scan.points, thin[inside.all(axis=1)], scan.position, scan.rotation, view) == []
        doubts = doubts_about(scan.points, thin, scan.position + 0.6 * aside, scan.rotation, view)
        doubted += bool(doubts)
        if told := re.search(r"view from (.+) m, (\d\.\d\d) m from its pose", " ".join(doubts)):
            place = np.array([float(value) for value in told[1].split(",")])
            off.append(np.linalg.norm(place - scan.position))
            assert float(told[2]) == pytest.approx(np.linalg.norm(place - scan.position - 0.6 * aside), abs=0.02)
    assert doubted >= 20 and len(off) >= 15 and np.median(off) < 0.05


def test_a_scan_is_turned_away_where_nothing_of_it_lies_ahead():
    rng = np.random.default_rng(0)
    around = rng.normal(size=(500, 3))
    ahead, place = np.abs(around) + np.eye(3)[0], np.array([3.0, -2.0, 1.0])
    few, more = (np.concatenate([ahead[:count], -ahead[count:]]) for count in (2, 10))
    assert is_turned_away(few + place, place, np.eye(3)) and not is_turned_away(more + place, place, np.eye(3))
    back = np.diag([-1.0, -1.0, 1.0])
    assert is_turned_away(ahead + place, place, back) and not is_turned_away(ahead + place, place, np.eye(3))
    assert not is_turned_away(around + place, place, back)  # a sensor that looks around
    assert not is_turned_away(ahead[:50] + place, place, back)  # too few to tell


def behind_bars(rays, seed):
    """Points of a sensor between many narrow bars 2 m away, a wall 6 m away behind them."""
    draw = np.random.default_rng(seed)
    turn, climb = draw.uniform(-np.pi, np.pi, rays), draw.uniform(-0.4, 0.4, rays)
    reach = np.where(np.floor(np.degrees(turn) / 3.0) % 2 == 0, 2.0, 6.0)
    return reach[:, None] * np.stack([np.cos(turn), np.sin(turn), np.tan(climb)], axis=1)


@pytest.mark.parametrize("rays", [100_000, 900_000])
def test_a_place_among_many_small_things_is_not_doubted_and_another_is(rays):
    points, place, other = behind_bars(rays, rays), np.array([3.0, -2.0, 1.0]), np.array([3.7, -1.6, 1.0])
    scan = (points + place).astype(np.float32)
    thin = scan[thin_clouds([scan], 0.1)[0]]
    assert overtaken(scan, place) < 0.05 < overtaken(scan, other)
    assert doubts_about(scan, thin, place, np.eye(3), None) == []
    (doubt,) = doubts_about(scan, thin, other, np.eye(3), None)
    assert "hidden behind others" in doubt
    assert "hidden behind others" in doubts_about(thin, thin, other, np.eye(3), None)[0]


def test_what_one_direction_overtakes_is_counted():
    """A wall at 2 m hides as much of one at 4 m as there are rays to both; a floor's slant counts not."""
    points = behind_bars(40_000, 7)
    near = 2.0 * points / np.linalg.norm(points, axis=1, keepdims=True)
    for ratio, share in ((2.0, 0.5), (1.13, 0.0)):
        found = overtaken(np.concatenate([near, ratio * near[::-1]]), np.zeros(3))
        assert abs(found - share) < 0.01
    assert overtaken(np.concatenate([near, 0.01 * near]), np.zeros(3)) == 0.0  # the sensor's own housing
