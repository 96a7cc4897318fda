"""Evidence between two clouds: what it says where the answer is known by construction."""

import dataclasses

import numpy as np
import pytest

from jaxmm.config import Config, Table
from jaxmm.data.evidence_sources import KINDS, gather
from jaxmm.data.labelled_rooms import clouds
from jaxmm.data.preprocessed_pairs import sides_of
from jaxmm.data.simulator_settings import CloudSource, pair_config
from jaxmm.rays.cloud_evidence import CloudPair, frame_of_pair, prior_view, robot_view, side_of
from jaxmm.rays.evidence import BLOCKED, FEATURES, SUPPORT, THROUGH, UNSEEN, features_of, fractions
from jaxmm.rays.pools import normals_of
from jaxmm.rays.rule import rule_scores
from warp_scanner.rooms.pairs import make_pairs

SENSOR = np.array([0.0, 0.0, 0.0])
SMALL = Table.of({"preset": "varied", "width": 160, "height": 100})


def wall(x, low=-2.0, high=2.0):
    """A wall across the view at distance x, sampled every 0.1 m."""
    y, z = np.meshgrid(np.arange(low, high, 0.1), np.arange(-1.0, 1.0, 0.1))
    return np.column_stack([np.full(y.size, x), y.ravel(), z.ravel()])


@pytest.mark.parametrize(
    "robot, side", [(wall(5.0, -6, 6), THROUGH), (wall(3.0), SUPPORT), (wall(1.0), BLOCKED), (wall(3.0, 8, 9), UNSEEN)]
)
def test_a_wall_at_three_metres_is_told_by_what_the_robot_saw(robot, side):
    pair = CloudPair(wall(3.0), robot, SENSOR)
    view = prior_view(pair, np.zeros(len(pair.prior)))
    inner = np.abs(pair.prior[:, 1:]).max(axis=1) < 0.5
    share = fractions(view.count)[inner]
    np.testing.assert_array_equal(share[:, side], 1.0)
    assert view.candidate[inner].all() == (side == THROUGH)


def test_what_stands_before_the_prior_is_a_candidate_and_what_stands_behind_it_is_not():
    for distance, side, new in ((1.0, BLOCKED, True), (5.0, THROUGH, False), (3.0, SUPPORT, False)):
        robot = wall(distance, -1.0, 1.0)
        pair = CloudPair(wall(3.0, -4, 4), robot, SENSOR)
        view = robot_view(pair, np.full(len(robot), abs(distance - 3.0)))
        inner = np.abs(robot[:, 1:]).max(axis=1) < 0.25 * min(distance, 3.0)
        np.testing.assert_array_equal(fractions(view.count)[inner, side], 1.0)
        assert (view.candidate[inner] == new).all()


def test_a_slanting_wall_supports_itself():
    """Within a footprint ranges differ by the slope of the surface; that is no evidence against it."""
    x, z = np.meshgrid(np.arange(1.0, 8.0, 0.1), np.arange(-1.0, 1.0, 0.1))
    along = np.column_stack([x.ravel(), np.full(x.size, 0.8), z.ravel()])
    shifted = np.add(along, (0.05, 0.0, 0.0))  # other samples of the same wall
    view = prior_view(CloudPair(along, shifted, SENSOR), np.zeros(len(along)))
    assert (fractions(view.count)[:, THROUGH] < 0.5).mean() > 0.99 and not view.candidate[x.ravel() < 6].any()


def test_a_viewpoint_among_the_points_and_empty_clouds_are_no_trouble():
    points = np.concatenate([wall(3.0), SENSOR[None]])
    assert np.isfinite(side_of(points, SENSOR).direction).all()
    nothing = np.zeros((0, 3))
    view = prior_view(CloudPair(wall(3.0), nothing, SENSOR), np.zeros(len(wall(3.0))))
    np.testing.assert_array_equal(fractions(view.count)[:, UNSEEN], 1.0)
    assert len(robot_view(CloudPair(wall(3.0), nothing, SENSOR), np.zeros(0)).points) == 0


def test_the_frame_of_a_pair_spans_both_clouds():
    frame = frame_of_pair(CloudPair(wall(3.0), wall(5.0), SENSOR))
    assert frame.floor == pytest.approx(-1.0, abs=0.06) and frame.ceiling == pytest.approx(0.9, abs=0.06)


@pytest.mark.parametrize("scenario", ["pillar_removed", "wall_added"])
@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_of_evidence_ranks_the_change_first(kind, scenario):
    """Without any learning, testable points of what changed score above nearly all others in every room."""
    preprocess = dataclasses.replace(Config().preprocess, evidence=kind, viewpoint_error=0.0)
    config = Config(scan=SMALL, preprocess=preprocess)
    rooms = [cloud for cloud, _ in clouds(config, CloudSource(scenario, scenario, "occluded", 6), np.arange(10))]
    removed, checked = scenario.endswith("removed"), 0
    for cloud in rooms:
        assert cloud.evidence.shape == (len(cloud.points), len(FEATURES)) and np.isfinite(cloud.evidence).all()
        score = rule_scores(cloud.evidence, removed=removed)
        positive, negative = cloud.true & cloud.testable, ~cloud.true
        if positive.sum() < 50:
            continue
        checked += 1
        order = np.argsort(np.concatenate([score[positive], score[negative]]), kind="stable")
        rank = np.empty(len(order))
        rank[order] = np.arange(len(order))
        area = (rank[: positive.sum()].mean() - (positive.sum() - 1) / 2) / negative.sum()
        assert area > (0.97 if kind == "exact" else 0.9), (kind, scenario, area)
    assert checked > 3


@pytest.mark.long
def test_an_estimated_viewpoint_is_as_good_as_the_true_one_and_a_wrong_one_is_not():
    """Evidence from clouds that tell their own viewpoint, beside the true one and one that is half a metre off."""
    source, told = CloudSource("wall_removed", "wall_removed", "clean", 3), []
    for error, share in ((0.0, 0.0), (0.5, 1.0), (0.5, 0.0)):
        changed = {"evidence": "points", "viewpoint_error": error, "viewpoint_estimated": share}
        config = Config(scan=SMALL, preprocess=dataclasses.replace(Config().preprocess, **changed))
        told.append([cloud.evidence for cloud, _ in clouds(config, source, np.arange(8))])
    true, estimated, wrong = told
    off = [[np.abs(a - b).mean() for a, b in zip(true, other, strict=True)] for other in (estimated, wrong)]
    assert np.median(off[0]) < 0.25 * np.median(off[1])


def test_mixed_evidence_is_one_of_the_three_kinds_room_by_room():
    source = CloudSource("wall_removed", "wall_removed", "occluded", 3)
    base = Config(scan=SMALL, preprocess=dataclasses.replace(Config().preprocess, viewpoint_error=0.0))
    pairs = make_pairs(pair_config(base, source), np.arange(24))
    sides = sides_of(base, pairs)
    apart = [np.zeros(len(kept.pixel), np.float32) for kept in sides.dt]
    found = {
        kind: gather(with_evidence(base, kind), source, pairs, (sides.dt, sides.robot, apart))
        for kind in (*KINDS, "mixed")
    }
    chosen = [[kind for kind in KINDS if np.array_equal(found["mixed"][row], found[kind][row])] for row in range(24)]
    assert all(chosen) and {kind for kinds in chosen for kind in kinds} == set(KINDS)
    again = gather(with_evidence(base, "mixed"), source, pairs, (sides.dt, sides.robot, apart), threads=1)
    for one, other in zip(found["mixed"], again, strict=True):
        np.testing.assert_array_equal(one, other)


def with_evidence(config, kind):
    return dataclasses.replace(config, preprocess=dataclasses.replace(config.preprocess, evidence=kind))


def test_the_mixed_filter_leaves_furniture_in_half_of_the_rooms():
    source = CloudSource("wall_removed", "wall_removed", "occluded", 3)
    pairs = make_pairs(pair_config(Config(scan=SMALL), source), np.arange(30))
    sizes = {}
    for kind in ("height", "none", "mixed"):
        config = Config(scan=SMALL, preprocess=dataclasses.replace(Config().preprocess, object_filter=kind))
        sizes[kind] = [len(kept.pixel) for kept in sides_of(config, pairs).robot]
    filtered = np.equal(sizes["mixed"], sizes["height"]) & np.not_equal(sizes["mixed"], sizes["none"])
    whole = np.equal(sizes["mixed"], sizes["none"])
    assert np.all(filtered | whole) and 5 < filtered.sum() < 25


@pytest.mark.parametrize("view_of, own", [(prior_view, 0), (robot_view, 1)])
def test_surfaces_that_are_known_change_nothing(view_of, own):
    rng = np.random.default_rng(0)
    both = [points + 0.01 * rng.standard_normal(points.shape) for points in (wall(3.0), wall(2.8, -1.0, 1.0))]
    pair, apart = CloudPair(*both, SENSOR), np.full(len(both[own]), 0.2)
    known = normals_of(both[own])
    first, second = view_of(pair, apart), view_of(pair, apart, surfaces=known)
    for a, b in zip(first[:-1], second[:-1], strict=True):
        np.testing.assert_array_equal(a, b)
    frame = frame_of_pair(pair)
    np.testing.assert_array_equal(features_of(first, frame), features_of(second, frame, known))
