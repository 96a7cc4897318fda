"""What changed is what the scenario says, it stands free and in view, and nothing depends on the batch."""

import dataclasses

import numpy as np
import pytest

from warp_scanner.rooms import scenarios
from warp_scanner.rooms.scenarios import SCENARIOS, SceneConfig, make_scenes
from warp_scanner.scenes.scenes import CHAIR, CYLINDER, GAP, PILLAR, TABLE, WALL, is_structure
from warp_scanner.sensors.poses import rotation_of
from warp_scanner.sensors.scan import Rays, cast_rays
from warp_scanner.sensors.sensors import OAK_D_PRO_SMALL

COUNT = 250  # of each scenario: 1,000 rooms in all


@pytest.fixture(scope="module", params=SCENARIOS)
def scenario(request):
    return request.param, make_scenes(SceneConfig(request.param, "occluded"), 3, np.arange(COUNT))


def arrays_of(scenes, *left_out):
    """All arrays of a Scenes but those of the fields left out."""
    for name, field in zip(scenes._fields, scenes, strict=True):
        if name not in left_out:
            yield from field if isinstance(field, tuple) else [field]


def corners_of(center, half_size, yaw):
    """(..., 4, 2) corners of turned rectangles, float64."""
    signs = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    local = signs * half_size[..., None, :].astype(float)
    c, s = np.cos(yaw.astype(float))[..., None], np.sin(yaw.astype(float))[..., None]
    turned = np.stack([c * local[..., 0] - s * local[..., 1], s * local[..., 0] + c * local[..., 1]], -1)
    return turned + center[..., None, :]


def distance_to_rectangle(points, center, half_size, yaw):
    """Distance of points (..., 2) to turned rectangles, float64."""
    offset = points - center
    c, s = np.cos(yaw.astype(float)), np.sin(yaw.astype(float))
    local = np.stack([c * offset[..., 0] + s * offset[..., 1], c * offset[..., 1] - s * offset[..., 0]], -1)
    return np.linalg.norm(np.maximum(np.abs(local) - half_size, 0.0), axis=-1)


def test_the_changed_object_stands_free_inside_the_shell(scenario):
    _, scenes = scenario
    table = scenes.primitives
    center, half = scenes.box.center[:, 0], scenes.box.size[:, 0] / 2
    low, high = center - half, center + half
    assert np.all(low >= [-5, -5, -1.5 - 1e-6]) and np.all(high <= [5, 5, 1.5 + 1e-6])
    center, half, yaw = table.center[..., :2], table.half_size[..., :2], table.yaw
    others = (table.kind != GAP) & (table.semantic > 2) & (scenes.change == 0)
    changed = (center[:, -1:], half[:, -1:], yaw[:, -1:])
    corners = distance_to_rectangle(corners_of(center, half, yaw), *(part[:, :, None] for part in changed)).min(axis=2)
    # Corners find the nearest points of rectangles apart, a grid over the changed object those that run through it.
    grid = np.stack(np.meshgrid(np.linspace(-1, 1, 9), np.linspace(-1, 1, 9)), axis=-1).reshape(-1, 2)
    points = center[:, -1:] + grid * half[:, -1:]
    ours = distance_to_rectangle(points[:, None], center[:, :, None], half[:, :, None], yaw[:, :, None]).min(axis=2)
    gap = np.minimum(corners, ours)
    assert gap[others].min() >= 0.3 - 1e-5


def test_the_sensor_keeps_its_distance_from_everything(scenario):
    _, scenes = scenario
    table = scenes.primitives
    standing = (table.kind != GAP) & (table.semantic > 2)
    distance = distance_to_rectangle(scenes.pose.position[:, None, :2].astype(float), table.center[..., :2],
                                     table.half_size[..., :2], table.yaw)  # fmt: skip
    assert distance[standing].min() >= 0.3
    np.testing.assert_allclose(scenes.pose.position[:, 2], -0.5, atol=1e-6)
    assert np.all(scenes.pose.pitch == 0) and np.ptp(scenes.pose.yaw) > 300


def scan_of(scenes, present):
    pose = scenes.pose
    rays = Rays(pose.position, OAK_D_PRO_SMALL.directions(), rotation_of(pose.yaw, pose.pitch))
    return cast_rays(scenes.primitives, present, rays)


def test_at_least_sixty_rays_hit_the_changed_object_without_furniture(scenario):
    _, scenes = scenario
    changed = scenes.primitives.element[:, -1:]
    rays = (scan_of(scenes, is_structure(scenes.primitives)).element == changed).sum(axis=1)
    assert rays.min() >= 60


def test_the_least_number_of_rays_is_kept_to():
    scenes = make_scenes(SceneConfig("pillar_added", minimum_rays=8_000), 3, np.arange(30))
    scan = scan_of(scenes, is_structure(scenes.primitives))
    assert (scan.element == scenes.primitives.element[:, -1:]).sum(axis=1).min() >= 8_000


def test_prior_and_reality_differ_in_the_changed_object_and_furniture_only(scenario):
    name, scenes = scenario
    table = scenes.primitives
    structure, there = is_structure(table), table.kind != GAP
    added = name.endswith("added")
    assert np.array_equal(
        scenes.change != 0, np.arange(table.kind.shape[1]) == np.full((COUNT, 1), table.kind.shape[1] - 1)
    )
    assert np.all(scenes.change[:, -1] == (1 if added else -1))
    same = scenes.change == 0
    assert np.array_equal(scenes.in_prior & same, structure & same)
    assert np.array_equal(scenes.in_real & same, there & same)
    assert np.all(scenes.in_prior[:, -1] != added) and np.all(scenes.in_real[:, -1] == added)
    assert np.all(scenes.box.object_type == (PILLAR if name.startswith("pillar") else WALL))
    assert not np.any(table.element[:, :-1] == table.element[:, -1:])


def test_sizes_of_changed_objects_follow_the_ranges(scenario):
    name, scenes = scenario
    size = np.sort(scenes.box.size[:, 0, :2], axis=1)
    np.testing.assert_allclose(scenes.box.size[:, 0, 2], 3.0, atol=1e-6)
    assert np.all(scenes.box.yaw == 0)
    if name.startswith("pillar"):
        np.testing.assert_array_equal(size[:, 0], size[:, 1])
        assert size.min() >= 0.3 - 1e-6 and size.max() <= 1.3 + 1e-6 and np.ptp(size) > 0.8
        assert 0.3 < np.mean(scenes.primitives.kind[:, -1] == CYLINDER) < 0.7
    else:
        assert size[:, 0].min() >= 0.1 - 1e-6 and size[:, 0].max() <= 0.3 + 1e-6
        assert size[:, 1].min() >= 1.5 - 1e-6 and size[:, 1].max() <= 4.5 + 1e-6 and np.ptp(size[:, 1]) > 2.0


def test_furniture_is_in_view_when_occluded(scenario):
    _, scenes = scenario
    semantic = scan_of(scenes, scenes.in_real).semantic
    share = np.isin(semantic, (TABLE, CHAIR)).mean(axis=1)
    assert share.min() > 0.03 and np.median(share) > 0.08


def test_clean_and_occluded_share_room_pose_and_change(scenario):
    name, occluded = scenario
    clean = make_scenes(SceneConfig(name, "clean"), 3, np.arange(20))
    for a, b in zip(arrays_of(clean, "in_real"), arrays_of(occluded, "in_real"), strict=True):
        np.testing.assert_array_equal(a, b[:20])
    furniture = np.isin(clean.primitives.semantic, (TABLE, CHAIR))
    assert np.array_equal(clean.in_real, occluded.in_real[:20] & ~furniture)


def test_a_scene_is_the_same_alone_and_in_any_batch(scenario):
    name, scenes = scenario
    chosen = np.array([200, 7, 41])
    few = make_scenes(SceneConfig(name, "occluded"), 3, chosen, threads=1)
    for a, b in zip(arrays_of(few), arrays_of(scenes), strict=True):
        np.testing.assert_array_equal(a, b[chosen])


def test_scenarios_of_one_room_draw_their_own_changes():
    first, second = (make_scenes(SceneConfig(name), 3, np.arange(20)).pose.yaw for name in SCENARIOS[:2])
    assert not np.any(first == second)


def test_unchanged_scenes_change_nothing():
    scenes = make_scenes(SceneConfig("unchanged", "clean"), 3, np.arange(50))
    assert not np.any(scenes.change) and np.array_equal(scenes.in_prior, scenes.in_real)
    assert scenes.box.center.shape == (50, 0, 3) and scenes.box.object_type.shape == (50, 0)


def test_no_rooms_give_no_scenes():
    scenes = make_scenes(SceneConfig(), 0, np.zeros(0, int))
    assert scenes.change.shape[0] == scenes.pose.yaw.shape[0] == 0 and scenes.in_prior.shape == scenes.change.shape


def test_a_room_without_space_is_reported(monkeypatch):
    monkeypatch.setattr(scenarios, "_ATTEMPT_LIMIT", 30)
    config = SceneConfig("wall_added", mismatch_gap=6.0, places=2, attempts_per_layout=5_000)
    with pytest.raises(RuntimeError, match="wall_added scene for index 4"):
        make_scenes(config, 0, np.array([4]))


@pytest.mark.parametrize(
    "settings",
    [{"scenario": "door_added"}, {"condition": "messy"}, {"furniture_share": 0.9}, {"furniture_share": np.nan}],
)
def test_rejects_unknown_settings(settings):
    with pytest.raises(ValueError, match=next(iter(settings))):
        dataclasses.replace(SceneConfig(), **settings)
