"""The first rows: every method reads what others are given, and says what others may say."""

import numpy as np
import pytest

from benchmarks.rivals import TOLERANCE, gap_of
from benchmarks.rows import METHODS, best_threshold, predict
from jaxmm.exchange.export import truth_path
from jaxmm.exchange.predictions import read_prediction
from jaxmm.exchange.scene_files import read_scene, read_truth, scene_names
from jaxmm.exchange.scenes import SAME, UNOBSERVABLE
from jaxmm.exchange.tasks import TRAIN
from jaxmm.files import write_arrays


@pytest.mark.parametrize("method", [name for name in METHODS if name != "M3C2"])
def test_a_wall_or_pillar_that_is_gone_is_told_before_all_that_stand(exported, tmp_path, method):
    names = scene_names(exported, TRAIN)
    truth = read_truth(exported, TRAIN, names, truth_path(exported))
    gone = [name for name in names if set(truth[name].elements) & {3, 4} and int(truth[name].hurdles) == 0]
    name = gone[0]
    scene, told = read_scene(exported, TRAIN, name), truth[name]
    said = predict(method, scene)
    kept = said | {"elements": np.minimum(said["elements"], 1.0)}  # C2M tells distances
    write_arrays(tmp_path / f"{name}.npz", kept)
    counts = {"scan": len(scene.scan), "reference": len(scene.reference), "elements": len(told.elements)}
    read_prediction(tmp_path, name, counts)
    probability, stands = np.nan_to_num(said["elements"], nan=0.0), told.elements == SAME
    removed = ~stands & (told.elements != UNOBSERVABLE)
    assert probability[removed].min() > probability[stands].max()
    if "reference" in said:
        changed = (told.reference != SAME) & (told.reference != UNOBSERVABLE)
        assert np.median(said["reference"][changed]) > np.median(said["reference"][told.reference == SAME])


@pytest.mark.parametrize("seed", range(5))
def test_the_threshold_is_the_one_of_the_best_f1(seed):
    rng = np.random.default_rng(seed)
    gone = rng.random(80) < 0.3
    score = np.round(rng.random(80) + 0.4 * gone, 2)

    def f1(level):
        called = score >= level
        return 2 * np.sum(called & gone) / (called.sum() + gone.sum())

    assert f1(best_threshold(score, gone)) == pytest.approx(max(map(f1, np.unique(score))))


def test_half_of_the_points_covered_is_a_median_within_the_tolerance():
    rng = np.random.default_rng(0)
    for _ in range(200):
        apart = rng.exponential(TOLERANCE, 31)
        assert (gap_of(apart) < 0.5) == (np.median(apart) <= TOLERANCE)
    assert gap_of(np.array([0.0, 0.01, 2 * TOLERANCE, 1.0])) == 0.5
