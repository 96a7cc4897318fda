"""Flats that the judge of objects learns from: what their models lack, and trees that go on from others."""

import numpy as np
import pytest

from jaxmm.learning.boxes import Box
from jaxmm.learning.prediction import read_judges
from jaxmm.objects.clues import CLUES
from jaxmm.objects.judge import KINDS, LOW, default_judge, judge_objects
from jaxmm.runs import object_training
from jaxmm.runs.flat_scans import LEAST_SEEN, SHORTEST, flat_case
from jaxmm.runs.flat_training import LEARNT, examples_of_flat, kind_among, low_ones, low_rooms_of_draw
from jaxmm.runs.object_training import Examples, fit, joined
from jaxmm.weights import DEFAULT
from warp_scanner.scenes.scenes import PILLAR, WALL


def test_a_model_lacks_what_the_scan_sees_and_nothing_that_it_is_not_told_to():
    whole = flat_case(6, 4, "tilting", lacks=0)
    assert not whole.lacking
    for number in range(8):
        case = flat_case(6, number, lacks=2)
        assert 1 <= len(case.lacking) <= 2
        for box, seen in zip(case.lacking, case.seen, strict=True):
            assert len(seen) >= LEAST_SEEN and box.dimensions[2] > 0.9 * case.flat.height
            assert box.object_type == "pillar" or box.dimensions[0] >= SHORTEST
            there = [np.linalg.norm(triangle.mean(0) - box.center) < 0.05 for triangle in corners_of(case.prior)]
            assert not any(there)  # no element of the model has its middle there
        again = flat_case(6, number, lacks=2)
        np.testing.assert_array_equal(case.scan.points, again.scan.points)
        semantic = case.prior.building.elements.semantic
        kept = np.isin(case.flat.primitives.semantic[0], (WALL, PILLAR)).sum() - len(case.lacking)
        assert np.isin(semantic, (WALL, PILLAR)).sum() <= kept


def corners_of(prior):
    """The corners of each element."""
    triangles = prior.building.triangles
    return [
        triangles.vertices[triangles.faces[triangles.element == one].ravel()] for one in np.unique(triangles.element)
    ]


@pytest.mark.parametrize("share, kind", [(1.0, "wall"), (0.6, "wall"), (0.4, "nothing")])
def test_stretches_of_one_wall_count_together(share, kind):
    """Neither of two stretches in line holds more than half of the points."""
    rng = np.random.default_rng(0)
    on = np.stack([rng.uniform(-1.0, 1.0, 200), np.full(200, 0.05), rng.uniform(0.0, 2.0, 200)], axis=1)
    on[int(200 * share) :, 1] = 1.5
    boxes = [Box("wall", np.array([x, 0.0, 1.0]), np.array([1.0, 0.1, 2.0])) for x in (-0.5, 0.5)]
    assert KINDS[kind_among(on, boxes)] == kind
    assert KINDS[kind_among(on, [])] == "nothing"
    pillars = [one._replace(object_type="pillar") for one in boxes]
    assert KINDS[kind_among(on, pillars)] == kind.replace("wall", "pillar")


def test_candidates_of_flats_are_of_all_kinds_that_there_are():
    judges = read_judges(DEFAULT)
    made = [examples_of_flat(flat_case(6, number), judges) for number in range(6)]
    kinds = np.concatenate([one.kind for one in made])
    assert KINDS.index("wall") in kinds and all(one.clues.shape == (len(one.kind), len(CLUES)) for one in made)
    assert all(np.isfinite(one.clues).all() for one in made)


@pytest.mark.parametrize("band, low, high", [(1, 2.0, LOW[0]), (2, LOW[0], LOW[1])])
def test_trees_that_go_on_from_others_learn_what_these_were_wrong_about_and_count_in_their_band_alone(band, low, high):
    """What is nothing by a clue that the judge has learnt nothing of; which type anything is stays as it was."""
    rng, judge = np.random.default_rng(1), default_judge()
    judge = judge._replace(**{field: getattr(judge, field)[:100] for field in ("clue", "limit", "leaf", "low")})
    assert not judge.low.any()
    clues = rng.normal(size=(600, len(CLUES)))
    top, left = CLUES.index("top"), CLUES.index("left")
    clues[:, top] = rng.uniform(1.0, low, 600)
    clues[:, left] = rng.uniform(low + 0.01, high, 600) - clues[:, top]
    kind = np.where(clues[:, 5] > 0.0, 0, 1 + (clues[:, 9] > 0.0))
    examples = Examples(clues, kind)
    other = judge._replace(low=np.where(np.arange(100) < 90, 0, 3 - band).astype(np.uint8))  # of the other band
    grown = fit(examples, other, rounds=40, band=band)
    np.testing.assert_array_equal(grown.leaf[:100], judge.leaf)
    assert grown.low.tolist() == 90 * [0] + 10 * [3 - band] + 40 * [band] and len(low_ones(examples).kind) == 600
    with pytest.raises(ValueError, match="further rounds count in a band of low rooms"):
        fit(examples, other, rounds=40)
    again = fit(examples, grown, rounds=40, band=band)  # in place of those of the same band
    np.testing.assert_array_equal(again.leaf, grown.leaf)
    before, after = judge_objects(other, clues), judge_objects(grown, clues)
    right = [np.mean((one[:, 0] > 0.5) == (kind == 0)) for one in (before, after)]
    assert right[0] < 0.7 and right[1] > 0.85
    np.testing.assert_allclose(after[:, 1] / after[:, 2], before[:, 1] / before[:, 2], rtol=1e-9)
    for outside in (LOW[0] + 0.01,) if band == 1 else (LOW[0] - 0.01, LOW[1] + 0.01):
        clues[:, left] = outside - clues[:, top]
        np.testing.assert_array_equal(judge_objects(grown, clues), judge_objects(other, clues))
    clues[:, left] = LEARNT + 0.01 - clues[:, top]
    assert len(low_ones(Examples(clues, kind)).kind) == 0


def test_rooms_to_go_on_from_are_low(monkeypatch):
    monkeypatch.setattr(object_training, "AT_ONCE", 2)
    made = joined([low_rooms_of_draw(number) for number in range(3)])
    assert len(made.kind) and len(low_ones(made).kind) == len(made.kind)
