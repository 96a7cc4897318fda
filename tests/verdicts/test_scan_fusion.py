"""Scans that saw the same place speak of it together; what one alone saw stays as it is."""

import math

import numpy as np
import pytest

from jaxmm.verdicts.scan_fusion import VOXEL, Visits, fused
from jaxmm.verdicts.verdicts import MOST_SURE


def drawn(seed, scans=3, size=1.0, dtype=np.float32):
    """Scans of the same cube, thin enough for several points of one scan to share a voxel now and then."""
    rng = np.random.default_rng(seed)
    count = rng.integers(50, 400, scans)
    points = rng.uniform(-size / 2, size / 2, (count.sum(), 3))
    visits = Visits(points, np.repeat(np.arange(scans), count), rng.uniform(0.5, 10.0, len(points)))
    return visits, rng.uniform(0.0, 1.0, (len(points), 2)).astype(dtype)


def logit(probability):
    return math.log(probability / (1.0 - probability))


def at(*visits):
    """What is said of points at one place: each a pair of probabilities and a reach, of a scan of its own."""
    chances, reach = [np.atleast_2d(one[0]) for one in visits], [one[1] for one in visits]
    seen = Visits(np.full((len(visits), 3), 0.3), np.arange(len(visits)), np.array(reach, float))
    return fused(seen, np.concatenate(chances))


@pytest.mark.parametrize("seed", range(3))
def test_one_scan_is_as_it_was(seed):
    visits, probability = drawn(seed, scans=1)
    found = fused(visits, probability)
    assert found.dtype == probability.dtype
    np.testing.assert_array_equal(found, probability)


@pytest.mark.parametrize("seed", range(3))
def test_scans_of_different_places_leave_each_other_alone(seed):
    visits, probability = drawn(seed)
    apart = visits._replace(points=visits.points + 5.0 * visits.scan[:, None])
    np.testing.assert_array_equal(fused(apart, probability), probability)
    nothing = Visits(np.zeros((0, 3)), np.zeros(0, int), np.zeros(0))
    assert fused(nothing, np.zeros((0, 2))).shape == (0, 2)


def test_by_hand():
    """Odds of 16 and 1/4 make (16 * 1/4) ** (1/root 2); four times odds of 3 make 3 ** 2. The nearest point has it."""
    found = at(([16 / 17, 1 / 2], 4.0), ([1 / 5, 1 / 2], 2.0))
    odds = 4.0 ** (1 / math.sqrt(2))
    np.testing.assert_allclose(found, [[0.0, 0.0], [odds / (1 + odds), 1 / 2]], atol=1e-12)
    np.testing.assert_allclose(at(*(([3 / 4], reach) for reach in (2, 1, 3, 4)))[:, 0], [0, 9 / 10, 0, 0], atol=1e-12)


@pytest.mark.parametrize("one", [0.001, 0.3, 0.499, 0.501, 0.7, 0.999])
def test_agreement_makes_surer_and_contradiction_less_sure(one):
    (both,) = at(([one], 1.0), ([one], 2.0))[0]
    assert abs(both - 0.5) > abs(one - 0.5) and (both > 0.5) == (one > 0.5)
    for other in (1.0 - one, 0.5, 0.25 + one / 2):  # of the other mind, of none, and of the same but less so
        (doubted,) = at(([one], 1.0), ([other], 2.0))[0]
        assert abs(doubted - 0.5) < abs(both - 0.5)
    assert at(([one], 1.0), ([1.0 - one], 2.0))[0] == pytest.approx(0.5)
    for more in (0.2, 0.6, 0.9):
        assert at(([one], 1.0), ([more], 2.0))[0] < at(([one], 1.0), ([more + 0.01], 2.0))[0]


def test_no_scan_is_trusted_beyond_all_others():
    assert at(([1.0], 1.0), ([0.0], 2.0))[0] == pytest.approx(0.5)
    (sure,) = at(([1.0], 1.0), ([0.5], 2.0))[0]
    assert logit(sure) == pytest.approx(MOST_SURE / math.sqrt(2))


@pytest.mark.parametrize("seed", range(5))
def test_neither_the_order_of_points_nor_that_of_scans_counts(seed):
    """To the bit, even where several points of a voxel are equally near to their sensors."""
    visits, probability = drawn(seed, scans=6, dtype=np.float64)
    visits = visits._replace(reach=np.round(visits.reach / 4.0))
    found = fused(visits, probability)
    rng = np.random.default_rng(seed)
    order, name = rng.permutation(len(probability)), rng.permutation(6)
    turned = Visits(visits.points[order], name[visits.scan[order]], visits.reach[order])
    np.testing.assert_array_equal(fused(turned, probability[order]), found[order])


@pytest.mark.parametrize("seed", range(5))
def test_it_is_what_a_dictionary_of_voxels_gives(seed):
    visits, probability = drawn(seed, dtype=np.float64)
    voxels = {}
    for row, point in enumerate(visits.points):
        voxels.setdefault(tuple(math.floor(value / VOXEL + 0.5) for value in point), []).append(row)
    expected, shared = probability.copy(), 0
    for rows in voxels.values():
        scans = {visits.scan[row] for row in rows}
        if len(scans) == 1:
            continue
        shared += 1
        speaker = min(rows, key=lambda row: visits.reach[row])
        expected[rows] = 0.0
        for kind in (0, 1):
            says = [np.mean([probability[row, kind] for row in rows if visits.scan[row] == scan]) for scan in scans]
            odds = sum(map(logit, says)) / math.sqrt(len(says))
            expected[speaker, kind] = 1.0 / (1.0 + math.exp(-odds))
    assert shared > 20
    np.testing.assert_allclose(fused(visits, probability), expected, rtol=1e-9)


@pytest.mark.parametrize("seed", range(3))
def test_each_place_speaks_once_and_every_kind_by_the_same_point(seed):
    visits, probability = drawn(seed)
    said = (fused(visits, probability) > 0.0).all(axis=1)
    assert ((fused(visits, probability) == 0.0).all(axis=1) == ~said).all()
    cell = np.floor(visits.points / VOXEL + 0.5).astype(int)
    _, place = np.unique(cell, axis=0, return_inverse=True)
    scans = [len(set(visits.scan[place.ravel() == one])) for one in range(place.max() + 1)]
    speakers = np.bincount(place.ravel()[said], minlength=len(scans))
    assert (speakers[np.array(scans) > 1] == 1).all() and (speakers >= 1).all()


@pytest.mark.parametrize(
    "changed, words",
    [
        pytest.param({"scan": np.zeros(3, int)}, "scan, reach and probability", id="scan"),
        pytest.param({"points": np.zeros((4, 2))}, r"\(4, 2\)", id="points"),
    ],
)
def test_what_does_not_fit_is_refused(changed, words):
    given = {"points": np.zeros((4, 3)), "scan": np.arange(4), "reach": np.ones(4)} | changed
    with pytest.raises(ValueError, match=words):
        fused(Visits(**given), np.full((4, 2), 0.5))
