"""Verdicts by hand, and in generated rooms against the simulator's truth."""

import dataclasses

import numpy as np
import pytest

from jaxmm import runs, sighting
from jaxmm.config import Config, Table
from jaxmm.evaluate import pick_model, predict
from jaxmm.evidence import features_of
from jaxmm.preprocess import nearest_distance
from jaxmm.sides import sides_of
from jaxmm.verdicts import OCCLUDED, PRESENT, REMOVED, UNSCANNED, VerdictSettings, verdicts_of
from jaxmm.weights import DEFAULT
from warp_scanner.pairs import PRESETS, make_pairs
from warp_scanner.scenes import WALL
from warp_scanner.sensors import OAK_D_PRO_SMALL

UNSEEN_SEED = 78  # that no training, validation or test of ours uses


def seen(rays, probability, element=None):
    count = np.array(rays)
    owner = np.zeros(len(count), int) if element is None else np.array(element)
    return owner, count, np.full(len(count), probability)


@pytest.mark.parametrize(
    "rays, probability, expected",
    [
        pytest.param([[30, 0, 0, 0]], 0.99, REMOVED, id="all rays went through"),
        pytest.param([[0, 30, 0, 0]], 0.01, PRESENT, id="all rays ended on it"),
        pytest.param([[0, 0, 500, 0]], 0.99, OCCLUDED, id="all rays ended before it"),
        pytest.param([[0, 0, 0, 500]], 0.99, OCCLUDED, id="no ray came back"),
        pytest.param([[10, 9, 0, 0]], 0.99, OCCLUDED, id="too few rays to tell"),
        pytest.param([[25, 0, 975, 0]], 0.99, OCCLUDED, id="too small a share to tell"),
        pytest.param([[40, 0, 960, 0]], 0.99, REMOVED, id="a share that is enough"),
    ],
)
def test_what_rays_tell(rays, probability, expected):
    (found,) = verdicts_of(np.array([0]), [True], seen(rays, probability))
    assert found.verdict == expected and found.rays == tuple(rays[0]) and found.points == 1
    prior = VerdictSettings().change_prior
    assert found.probability == (pytest.approx(probability) if expected in (PRESENT, REMOVED) else prior)


def test_what_is_not_in_the_scan_is_unscanned():
    found = verdicts_of(np.array([5, 6, 0]), [False, True, True], seen([[0, 30, 0, 0]], 0.1))
    assert [one.verdict for one in found] == [UNSCANNED, OCCLUDED, PRESENT] and found[0].rays == (0, 0, 0, 0)


def test_points_that_no_ray_tells_of_do_not_vote():
    rays, probability = np.array([[30, 0, 0, 0], [0, 0, 500, 0]]), np.array([1, 0])
    (found,) = verdicts_of(np.array([0]), [True], (np.zeros(2, int), rays, probability))
    assert found.verdict == REMOVED and found.probability == 1.0


def test_verdicts_agree_with_the_truth():
    """Of walls in occluded rooms, one of which is gone: none is called what it is not, whatever hides it."""
    models, trained = runs.load_models(DEFAULT)
    judges = [pick_model(models["evidence"], f"{kind}_removed") for kind in ("pillar", "wall")]
    settings = dataclasses.replace(
        PRESETS["varied"], scenario="wall_removed", condition="occluded", sensor=OAK_D_PRO_SMALL, seed=UNSEEN_SEED
    )
    config = Config(scan=Table.of({"preset": "varied"}))
    config = dataclasses.replace(config, preprocess=dataclasses.replace(config.preprocess, object_filter="none"))
    pairs = make_pairs(settings, np.arange(24))
    sides, expected = sides_of(config, pairs), sighting.expected_of(pairs, settings.sensor)
    apart = [nearest_distance(dt.points, robot.points) for dt, robot in zip(*sides, strict=True)]
    views = sighting.prior_views(pairs, settings.sensor, expected, (sides.dt, apart))
    found = dict.fromkeys((PRESENT, REMOVED, OCCLUDED, UNSCANNED), 0)
    for row, (view, frame) in enumerate(zip(views, sighting.frames_of(pairs, settings.sensor), strict=True)):
        features = features_of(view, frame)
        probability = np.max([predict(judge, features, trained.network) for judge in judges], axis=0)
        walls = np.unique(pairs.prior.element[row][pairs.prior.semantic[row] == WALL])
        scanned = np.isin(walls, pairs.dt.element[row])
        found_here = verdicts_of(walls, scanned, (view.element, view.count, probability))
        for one, reached in zip(found_here, scanned, strict=True):
            gone = one.element == pairs.box.element[row, 0]
            assert one.verdict != (PRESENT if gone else REMOVED), (row, one)
            assert (one.verdict == UNSCANNED) == (not reached)
            found[one.verdict] += 1
    assert found[REMOVED] >= 18 and found[PRESENT] >= 18 and found[UNSCANNED] > 0
