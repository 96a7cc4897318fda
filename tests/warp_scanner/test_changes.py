"""Scenes with several changed objects: each is what its scenario says, free or touching as asked, and in view."""

import dataclasses

import numpy as np
import pytest
from scipy.stats import ks_2samp

from warp_scanner.rooms.changes import PARTS
from warp_scanner.rooms.rooms import VARIED, RoomConfig
from warp_scanner.rooms.scenarios import CROWDED, MULTI_SCENARIOS, SceneConfig, make_scenes
from warp_scanner.rooms.standing import Standing
from warp_scanner.scenes.scenes import BOX, CYLINDER, DOOR, FLOOR, GAP, PILLAR, STRUCTURE, WALL, is_structure
from warp_scanner.sensors.poses import rotation_of
from warp_scanner.sensors.scan import Rays, cast_slots
from warp_scanner.sensors.sensors import OAK_D_PRO_SMALL

COUNT = 24
STANDING = Standing((0.4, 2.2), 0.3, pitch=(-15.0, 15.0))
TURNED = dataclasses.replace(RoomConfig(), wall_rotation=(0.0, 0.3), pillar_rotation=(0.0, 0.3))


def corners_of(center, half_size, yaw):
    signs = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    local = signs * half_size[..., None, :].astype(float)
    c, s = np.cos(yaw.astype(float))[..., None], np.sin(yaw.astype(float))[..., None]
    turned = np.stack([c * local[..., 0] - s * local[..., 1], s * local[..., 0] + c * local[..., 1]], -1)
    return turned + center[..., None, :]


def gaps_to(table, slot):
    """(R, K) gap over the best face normal of the solid in one slot to all others; inf for gaps, floors, ceilings."""
    corners = corners_of(table.center[..., :2], table.half_size[..., :2], table.yaw)
    own = corners[:, slot : slot + 1]
    best = np.full(table.kind.shape, -np.inf)
    for shape in (corners, np.broadcast_to(own, corners.shape)):
        for edge in (shape[:, :, 1] - shape[:, :, 0], shape[:, :, 2] - shape[:, :, 1]):
            axis = edge / np.maximum(np.linalg.norm(edge, axis=-1, keepdims=True), 1e-12)
            u, v = (np.sum(points * axis[:, :, None], axis=-1) for points in (corners, own))
            gap = np.maximum(u.min(axis=-1) - v.max(axis=-1), v.min(axis=-1) - u.max(axis=-1))
            best = np.maximum(best, gap)
    best[:, slot] = np.inf
    there = (table.kind != GAP) & (table.semantic > FLOOR + 1) & (table.kind[:, slot, None] != GAP)
    return np.where(there, best, np.inf)


@pytest.fixture(scope="module", params=(*MULTI_SCENARIOS, CROWDED))
def scenario(request):
    config = SceneConfig(request.param, "occluded", room=VARIED, standing=STANDING)
    return config, make_scenes(config, 6, np.arange(COUNT))


def test_each_changed_object_is_what_the_scenario_says(scenario):
    config, scenes = scenario
    count = len(config.parts)
    there = scenes.primitives.kind[:, -count:] != GAP
    for number, part in enumerate(config.parts):
        assert np.all(there[:, number]) or part.optional
        here = there[:, number]
        assert np.all(scenes.box.object_type[here, number] == part.semantic)
        assert np.all(scenes.box.change[here, number] == part.change)
        assert np.all(scenes.box.moved_from[here, number] == part.moved_from)
        assert np.all(scenes.in_prior[here, number - count] == (part.change < 0))
        assert np.all(scenes.in_real[here, number - count] == (part.change > 0))
    assert np.all(np.isnan(scenes.box.center[~there])) and np.all(scenes.box.element[~there] == -1)
    assert np.all(scenes.box.change[~there] == 0) and not np.any(scenes.change[:, :-count])
    assert len(set(np.unique(scenes.box.element[there]))) == count  # one id each


def test_each_changed_object_stands_free_and_in_view(scenario):
    config, scenes = scenario
    count, table = len(config.parts), scenes.primitives
    rays = Rays(scenes.pose.position, OAK_D_PRO_SMALL.directions(), rotation_of(scenes.pose.yaw, scenes.pose.pitch))
    _, hit = cast_slots(table, is_structure(table), rays)
    for slot in range(table.kind.shape[1] - count, table.kind.shape[1]):
        assert gaps_to(table, slot).min() >= 0.3
        here = table.kind[:, slot] != GAP
        assert np.sum(hit == slot, axis=1)[here].min() >= 60
        corners = np.abs(corners_of(table.center[:, slot, :2], table.half_size[:, slot, :2], table.yaw[:, slot]))
        assert np.all(corners <= scenes.size[:, None, :2] / 2 + 1e-5)
        np.testing.assert_allclose(2 * table.half_size[here, slot, 2], scenes.size[here, 2], atol=1e-5)


def test_what_moved_keeps_its_shape():
    for name in ("pillar_moved", "wall_moved"):
        scenes = make_scenes(SceneConfig(name), 2, np.arange(COUNT))
        np.testing.assert_array_equal(scenes.box.size[:, 0], scenes.box.size[:, 1])
        assert np.all(scenes.primitives.kind[:, -2] == scenes.primitives.kind[:, -1])
        assert np.linalg.norm(scenes.box.center[:, 0] - scenes.box.center[:, 1], axis=1).min() > 0.5
        assert np.any(scenes.primitives.kind[:, -1] == CYLINDER) == (name == "pillar_moved")


def test_some_scenes_of_several_have_two_and_some_three():
    scenes = make_scenes(SceneConfig("pillars_added"), 2, np.arange(COUNT))
    assert set(np.sum(scenes.box.change, axis=1)) == {2, 3}


def test_walls_touch_each_other_when_asked_to():
    config = SceneConfig("walls_added", touching="walls", room=TURNED)
    table = make_scenes(config, 5, np.arange(COUNT)).primitives
    gap = gaps_to(table, table.kind.shape[1] - 3)  # of the first to all else
    second = gap[:, -2]
    assert second.min() > 0 and second.max() < 5e-4
    assert np.delete(gap, [-1, -2], axis=1).min() >= 0.3
    corner = gaps_to(table, table.kind.shape[1] - 2)
    assert np.delete(corner, [-3, -2], axis=1).min() >= 0.3


@pytest.mark.parametrize("room", [SceneConfig().room, VARIED], ids=["thesis", "varied"])
def test_walls_touch_structure_when_asked_to_and_furniture_never(room):
    scenes = make_scenes(SceneConfig("wall_added", room=room, touching="structure"), 5, np.arange(COUNT))
    table = scenes.primitives
    gap = gaps_to(table, table.kind.shape[1] - 1)
    solid = np.isin(table.semantic, (WALL, PILLAR, DOOR))
    nearest = np.where(solid, gap, np.inf).min(axis=1)
    assert nearest.min() > 0 and np.mean(nearest < 5e-4) > 0.7
    assert np.where(solid, np.inf, gap).min() >= 0.3
    assert np.all(np.isin(table.semantic[solid], STRUCTURE))


def test_moved_furniture_stands_elsewhere_in_the_prior():
    config = SceneConfig("pillar_removed", "occluded", prior_furniture="moved")
    scenes = make_scenes(config, 4, np.arange(COUNT))
    table, structure = scenes.primitives, is_structure(scenes.primitives)
    slots = config.prior_slots
    real, prior = slice(-1 - 2 * slots, -1 - slots), slice(-1 - slots, -1)
    there = table.kind != GAP
    assert not np.any(scenes.in_prior[:, real]) and np.array_equal(scenes.in_prior[:, prior], there[:, prior])
    assert not np.any(scenes.in_real[:, prior]) and np.array_equal(scenes.in_real[:, real], there[:, real])
    assert np.array_equal((scenes.in_prior & structure)[:, :-1], structure[:, :-1])
    both = there[:, real] & there[:, prior]
    assert both.sum() > 50 * COUNT / 4
    for field in ("kind", "element", "semantic", "half_size"):
        values = getattr(table, field)
        np.testing.assert_array_equal(values[:, real][both], values[:, prior][both])
    assert not np.any(np.all(table.center[:, real][both] == table.center[:, prior][both], axis=-1))
    clean = make_scenes(SceneConfig("pillar_removed", "clean", prior_furniture="moved"), 4, np.arange(4))
    assert np.array_equal(clean.in_prior | clean.in_real, is_structure(clean.primitives))


def test_many_changes_are_the_same_alone_and_in_any_batch():
    config = SceneConfig("all_four", "occluded", room=VARIED, standing=STANDING)
    scenes = make_scenes(config, 6, np.arange(12))
    alone = make_scenes(config, 6, np.array([9, 2]), threads=1)
    for a, b in zip(
        (*alone.primitives, *alone.box, *alone.pose), (*scenes.primitives, *scenes.box, *scenes.pose), strict=True
    ):
        np.testing.assert_array_equal(a, b[[9, 2]])


def test_numbers_of_scenarios_never_change():
    """They enter the keys of the draws: a change would redraw published scenes."""
    first = ["pillar_added", "wall_added", "pillar_removed", "wall_removed", "unchanged"]
    several = [
        "pillars_added", "walls_added", "pillars_removed", "walls_removed", "pillar_and_wall_added",
        "pillar_and_wall_removed", "pillar_added_and_removed", "wall_added_and_removed", "all_four", "pillar_moved",
        "wall_moved",
    ]  # fmt: skip
    assert list(PARTS)[:17] == [*first, *several, "many_added"] and list(MULTI_SCENARIOS) == several


@pytest.mark.parametrize("settings", [{"touching": "always"}, {"prior_furniture": "some"}])
def test_rejects_unknown_words(settings):
    with pytest.raises(ValueError, match=next(iter(settings))):
        SceneConfig(**settings)


def test_nothing_tells_a_changed_pillar_by_its_turn_or_size():
    """Those that were removed are drawn as those that stay."""
    scenes = make_scenes(SceneConfig("pillar_removed", room=VARIED), 5, np.arange(300))
    primitives, first = scenes.primitives, scenes.change.shape[1] - 1
    square = (primitives.semantic == PILLAR) & (primitives.kind == BOX)
    turns, widths = np.mod(primitives.yaw, np.pi / 2), primitives.half_size[..., 0]
    removed, staying = square[:, first], square[:, :first]
    for values in (turns, widths):
        assert ks_2samp(values[:, first][removed], values[:, :first][staying]).pvalue > 1e-3
    assert turns[:, first][removed].max() > 1.3
