"""Evidence of single points, of pools and of columns, by cases that can be told by hand."""

import dataclasses

import numpy as np
import pytest

from jaxmm.config import TRAINED_METHODS, Config, ConfigError, Table, parse
from jaxmm.data.labelled_rooms import clouds
from jaxmm.data.preprocessed_pairs import sides_of
from jaxmm.data.simulator_settings import CloudSource
from jaxmm.rays import pair_evidence
from jaxmm.rays.evidence import (
    BASE_MARGIN,
    BLOCKED,
    FEATURES,
    SUPPORT,
    THROUGH,
    UNSEEN,
    Frame,
    View,
    features_of,
    fractions,
    frame_of,
    margins,
)
from warp_scanner.rooms.pairs import PRESETS, make_pairs
from warp_scanner.sensors.sensors import Pinhole

COLUMN = {name: number for number, name in enumerate(FEATURES)}
OPEN = Frame(np.zeros(3), -1.5, 1.5, np.full(180, np.inf), np.full(180, -np.inf))  # sees up and down everywhere


def view(points, count=None, element=None, candidate=None):
    number = len(points)
    return View(
        np.asarray(points, float),
        np.full(number, -1) if element is None else np.asarray(element),
        np.tile([0, 1, 0, 0], (number, 1)) if count is None else np.asarray(count),
        np.zeros(number), np.full(number, 0.03), np.zeros(number), np.ones(number),
        np.zeros(number, bool) if candidate is None else np.asarray(candidate),
    )  # fmt: skip


def test_fractions_sum_to_one_and_nothing_seen_is_unseen():
    share = fractions(np.array([[1, 2, 3, 4], [0, 0, 0, 0], [5, 0, 0, 0]]))
    np.testing.assert_allclose(share, [[0.1, 0.2, 0.3, 0.4], [0, 0, 0, 1], [1, 0, 0, 0]], atol=1e-7)


def test_margins_cover_the_errors_of_slanting_rays():
    np.testing.assert_allclose(margins(np.array([1.0, 0.5, 0.01, np.nan]), 0.0), BASE_MARGIN)
    wide = margins(np.array([1.0, 0.5, 0.15, 0.01]), 0.02) - BASE_MARGIN
    np.testing.assert_allclose(wide, [0.06, 0.12, 0.4, 0.4], rtol=1e-5)
    assert margins(np.array([0.1]), 5.0) == 1.0


def test_elements_pool_the_rays_of_their_points():
    points = [[2, 0, -1.5], [2, 0, 0.0], [2, 0.4, 1.5], [3, 0, 0]]
    count = [[8, 2, 0, 0], [0, 0, 10, 0], [0, 0, 0, 0], [0, 6, 0, 0]]
    found = features_of(view(points, count, [7, 7, 7, 9]), OPEN)
    assert found.shape == (4, len(FEATURES)) and found.dtype == np.float32
    np.testing.assert_allclose(found[:3, COLUMN["pool through"]], 0.4)
    np.testing.assert_allclose(found[:3, COLUMN["pool support"]], 0.1)
    np.testing.assert_allclose(found[:3, COLUMN["pool blocked"]], 0.5)
    np.testing.assert_allclose(found[3, [COLUMN["pool through"], COLUMN["pool support"]]], [0, 1])
    np.testing.assert_allclose(found[:, COLUMN["pooled"]], 1)
    np.testing.assert_allclose(found[0, [COLUMN["pool low"], COLUMN["pool high"]]], [0, 1])
    np.testing.assert_allclose(found[0, COLUMN["pool size"]], np.log10(21) / 4, rtol=1e-6)
    np.testing.assert_allclose(found[2, COLUMN["unseen"]], 1)


def test_surfaces_without_support_are_pools_where_elements_are_unknown():
    z = np.arange(-1.5, 1.51, 0.1)
    pillar = np.array([(3.0, y, height) for y in (0.0, 0.1, 0.2) for height in z])
    table = np.array([(1.0 + 0.1 * i, 1.0 + 0.1 * j, -0.8) for i in range(4) for j in range(4)])
    wall = np.array([(5.0, 0.1 * i, 0.1 * j) for i in range(4) for j in range(4)])
    points = np.concatenate([pillar, table, wall])
    candidate = np.arange(len(points)) < len(points) - len(wall)
    count = np.where(candidate[:, None], [0, 0, 1, 0], [0, 1, 0, 0])
    found = features_of(view(points, count, candidate=candidate), OPEN)
    first, second = slice(0, len(pillar)), len(pillar)
    np.testing.assert_allclose(found[first, [COLUMN["pool high"]]], 1, atol=1e-6)
    np.testing.assert_allclose(found[first, COLUMN["column ceiling gap"]], 0, atol=1e-6)
    np.testing.assert_allclose(found[second, COLUMN["pool ceiling gap"]], 2.3 / 3, rtol=1e-5)
    np.testing.assert_allclose(found[second, COLUMN["column high"]], 0.7 / 3, rtol=1e-5)
    assert not found[-len(wall) :, COLUMN["pooled"] : COLUMN["surface through"]].any()


def test_surfaces_pool_what_is_explained_too():
    y, z = (axis.ravel() for axis in np.meshgrid(np.arange(10) * 0.1, np.arange(10) * 0.1))
    new = np.column_stack([np.full(100, 3.0), y, z])
    old = np.column_stack([np.full(100, 4.0), y, z])
    count = np.concatenate([np.where(y[:, None] > 0.05, [0, 0, 1, 0], [0, 1, 0, 0]), np.tile([0, 1, 0, 0], (100, 1))])
    found = features_of(view(np.concatenate([new, old]), count), OPEN)
    np.testing.assert_allclose(found[:100, COLUMN["surface blocked"]], 0.9, rtol=1e-6)
    np.testing.assert_allclose(found[100:, COLUMN["surface support"]], 1.0)
    beside = found[:100][y < 0.05]
    assert not beside[:, COLUMN["pooled"]].any() and len(beside) == 10


def test_surprise_is_the_residual_in_margins():
    told = view([[2, 0, 0.0]] * 4)._replace(
        residual=np.array([0.06, -0.06, 3.0, np.nan]), margin=np.array([0.04, 0.02, 0.5, 0.03])
    )
    np.testing.assert_allclose(features_of(told, OPEN)[:, COLUMN["surprise"]], [0.5, -1, 1, 0], rtol=1e-6)


def test_heights_are_judged_against_the_field_of_view():
    """A pillar 1.2 m away shows 1.25 m of itself to a level camera of 55 degrees, and leaves the picture."""
    sensor = Pinhole(320, 200)
    frame = frame_of(np.zeros(3), sensor.directions(), -1.5, 1.5)
    shown = 1.2 * np.tan(np.radians(27.5))
    assert 2 * shown == pytest.approx(1.25, abs=0.01)
    z = np.linspace(-shown, shown, 30)
    near = np.column_stack([np.full(30, 1.2), np.zeros(30), z])
    seen = np.tile([0, 0, 1, 0], (30, 1))
    found = features_of(view(near, seen, candidate=np.ones(30, bool)), frame)
    assert found[0, COLUMN["pool ceiling gap"]] < 0.01 and found[0, COLUMN["pool floor gap"]] < 0.01
    low = near[:20]
    found = features_of(view(low, seen[:20], candidate=np.ones(20, bool)), frame)
    assert found[0, COLUMN["pool ceiling gap"]] == pytest.approx((shown - z[19]) / 3, abs=0.01)


def test_extents_of_a_pool_are_those_of_its_rectangle():
    x, y = np.meshgrid(np.linspace(-1.5, 1.5, 61), np.linspace(-0.2, 0.2, 21))
    turn = np.array([[np.cos(0.5), -np.sin(0.5)], [np.sin(0.5), np.cos(0.5)]])
    flat = np.column_stack([x.ravel(), y.ravel()]) @ turn.T + [4, 2]
    points = np.column_stack([flat, np.zeros(len(flat))])
    found = features_of(view(points, element=np.zeros(len(points), int)), OPEN)
    assert found[0, COLUMN["pool length"]] == pytest.approx(3.0 / 5, rel=0.03)
    assert found[0, COLUMN["pool width"]] == pytest.approx(0.4, rel=0.06)


@pytest.fixture(scope="module", params=["wall_removed", "pillar_added"])
def seen(request):
    """Pairs of varied rooms with furniture, and what is told of the changed side."""
    config = Config(scan=Table.of({"preset": "varied", "width": 160, "height": 100}))
    settings = dataclasses.replace(
        PRESETS["varied"], scenario=request.param, condition="occluded", sensor=Pinhole(160, 100), seed=4
    )
    pairs = make_pairs(settings, np.arange(8))
    sides = sides_of(config, pairs)
    expected = pair_evidence.expected_of(pairs, settings.sensor)
    if request.param == "wall_removed":
        apart = [np.zeros(len(kept.pixel)) for kept in sides.dt]
        views, kept = pair_evidence.prior_views(pairs, settings.sensor, expected, (sides.dt, apart)), sides.dt
    else:
        views, kept = pair_evidence.robot_views(pairs, expected, sides.robot), sides.robot
    return request.param, pairs, views, kept


def test_evidence_without_errors_is_the_truth(seen):
    """Where every ray of a footprint agrees, they say what the simulator knows of the point."""
    scenario, pairs, views, kept = seen
    side = THROUGH if scenario == "wall_removed" else BLOCKED
    positives = 0
    for row, (told, (_, pixel)) in enumerate(zip(views, kept, strict=True)):
        share = fractions(told.count)
        testable = (pairs.testable_dt if scenario == "wall_removed" else pairs.testable_robot)[row, pixel]
        changed = (pairs.changed_dt if scenario == "wall_removed" else pairs.changed_robot)[row, pixel]
        sure = share.max(axis=1) == 1.0
        np.testing.assert_array_equal(share[sure & testable, side], 1.0)
        # What is not testable differs by less than the truth's margin, 0.1 m, or stands behind something.
        reverse = sure & (share[:, side] == 1.0) & ~testable
        own = pairs.robot.distance[row, pixel] - pairs.dt.distance[row, pixel]
        assert np.all(np.abs(own[reverse]) <= 0.1 + 1e-5)
        positives += (changed & testable & sure).sum()
        assert told.candidate[changed & testable & sure].all()
    assert positives > 100


def test_a_shadow_is_blocked_or_unseen_and_never_a_candidate(seen):
    scenario, pairs, views, kept = seen
    if scenario != "wall_removed":
        pytest.skip("shadows are of points of the prior")
    hidden = 0
    for row, (told, (_, pixel)) in enumerate(zip(views, kept, strict=True)):
        shadow = pairs.robot.distance[row, pixel] < pairs.dt.distance[row, pixel] - 0.1
        sure = shadow & (fractions(told.count)[:, BLOCKED] == 1.0)
        assert not told.candidate[sure].any()
        hidden += sure.sum()
    assert hidden > 100


def test_unchanged_rooms_support_what_is_there():
    config = Config(preprocess=dataclasses.replace(Config().preprocess, evidence="exact"))
    source = CloudSource("wall_removed", "unchanged", "clean", 3)
    for cloud, _ in clouds(config, source, np.arange(3)):
        assert cloud.evidence.shape == (len(cloud.points), len(FEATURES))
        np.testing.assert_allclose(cloud.evidence[:, COLUMN["support"]], 1.0)
        np.testing.assert_allclose(cloud.evidence[:, COLUMN["pool support"]], 1.0)
        assert not cloud.evidence[:, [COLUMN["through"], COLUMN["blocked"], COLUMN["column high"]]].any()


def test_evidence_must_be_asked_for_where_it_is_trained_on():
    assert TRAINED_METHODS["evidence"] == len(FEATURES)
    with pytest.raises(ConfigError, match="some evidence"):
        parse("[train]\nmethods = ['evidence']", "some.toml")
    with pytest.raises(ConfigError, match="augment: evidence"):
        parse("[train]\naugment = ['evidence']", "some.toml")
    assert (
        parse("[train]\nmethods = ['evidence']\n[preprocess]\nevidence = 'mixed'", "some.toml").preprocess.evidence
        == "mixed"
    )


def test_the_sides_have_one_order_everywhere():
    from warp_scanner.clouds import sightlines

    names = ("THROUGH", "SUPPORT", "BLOCKED", "UNSEEN")
    assert [getattr(sightlines, name) for name in names] == [THROUGH, SUPPORT, BLOCKED, UNSEEN]
