"""How ranges err is told, whatever grows, however much of them is gross."""

import itertools

import numpy as np
import pytest
from scipy.special import erf

from jaxmm.rays import noise_model
from jaxmm.rays.noise_model import EXACT, MOST_OFF, WHOLE, noise_of, sigma_at

# Constant [m], linear and quadratic [1/m] part, of a terrestrial scanner, cheap ones, and a stereo camera.
SHAPES = [(0.002, 0.0, 0.0), (0.02, 0.0, 0.0), (0.05, 0.0, 0.0), (0.003, 0.001, 0.0), (0.0, 0.003, 0.0),
          (0.0, 0.0, 0.0044), (0.001, 0.0, 3e-5)]  # fmt: skip


def ranges(shape, gross, farthest, count=6000, seed=0):
    """Residuals and ranges [m] of which some are gross, all over; and the true deviation (N,) [m]."""
    rng = np.random.default_rng(seed)
    reach = np.exp(rng.uniform(0.0, np.log(farthest), count))
    sigma = shape[0] + shape[1] * reach + shape[2] * reach**2
    off = sigma * rng.standard_normal(count)
    wrong = rng.random(count) < gross
    off[wrong] = rng.uniform(-MOST_OFF, MOST_OFF, np.count_nonzero(wrong))
    return off, reach, sigma


@pytest.mark.parametrize("shape, gross", list(itertools.product(SHAPES, (0.0, 0.1, 0.3, 0.5))))
def test_the_deviation_is_told_near_and_far_whatever_share_is_gross(shape, gross):
    off, reach, sigma = ranges(shape, gross, 8.0 if shape[2] > 0.001 else 40.0)
    found = noise_of(off, np.ones(len(off)), reach)
    ratio = sigma_at(found, reach) / sigma
    # Of a few shapes one is taken: where both parts count, it errs most at the ends.
    assert 0.65 < np.quantile(ratio, 0.01) and np.quantile(ratio, 0.99) < 1.65 and 0.8 < np.median(ratio) < 1.25
    assert found.gross == pytest.approx(gross, abs=0.08)


def test_clutter_far_away_makes_no_near_range_err_and_no_far_one():
    """Beyond 15 m nine in ten points are leaves, before it none: the walls between them err as all others do."""
    rng = np.random.default_rng(4)
    reach = rng.uniform(1.0, 45.0, 8000)
    off = 0.01 * rng.standard_normal(8000)
    leaves = (reach > 15.0) & (rng.random(8000) < 0.9)
    off[leaves] = rng.uniform(-MOST_OFF, MOST_OFF, np.count_nonzero(leaves))
    assert np.all(np.abs(sigma_at(noise_of(off, np.ones(8000), reach), np.array([2.0, 10.0, 40.0])) - 0.01) < 0.002)


@pytest.mark.parametrize("constant, growth", [(0.0, 0.0), (0.01, 0.0), (0.1, 0.0), (0.0, 0.004), (0.02, 0.001)])
def test_noise_is_told_though_much_has_changed(constant, growth):
    rng = np.random.default_rng(1)
    reach = rng.uniform(1.0, 8.0, 40_000)
    sigma = constant + growth * reach**2
    residual = sigma * rng.standard_normal(40_000)
    residual[:4000] = rng.uniform(0.6, 4.0, 4000)  # what was removed
    residual[4000:6000] = np.nan
    found = sigma_at(noise_of(residual, np.ones(40_000), reach), np.array([2.0, 4.0, 7.0]))
    expected = constant + growth * np.array([2.0, 4.0, 7.0]) ** 2
    np.testing.assert_allclose(found, expected, rtol=0.25)


def test_a_wall_that_moved_is_no_noise_and_a_pose_that_is_a_little_off_is():
    rng = np.random.default_rng(0)
    reach, ones = rng.uniform(1.0, 5.0, 20_000), np.ones(20_000)
    errors = rng.normal(0.0, 0.01, 20_000)
    for part in (0.52, 0.6, 0.8, 1.0):  # of the view, that it fills
        moved = errors + np.where(rng.random(20_000) < part, 0.3, 0.0)
        for shifted in (moved, -moved):
            assert 0.005 < sigma_at(noise_of(shifted, ones, reach), np.array([3.0]))[0] < 0.02, part
    assert sigma_at(noise_of(errors + 0.06, ones, reach), np.array([3.0]))[0] > 0.05
    coarse = 0.11 + rng.normal(0.0, 0.1, 20_000)  # of one heap, which the expected ranges are in
    assert sigma_at(noise_of(coarse, ones, reach), np.array([3.0]))[0] == pytest.approx(0.1, rel=0.15)


def test_how_it_grows_is_asked_of_ranges_that_are_there():
    """Ranges up to 5 m that grow do not tell what is at 500; where little grows, a constant is enough."""
    off, reach, _ = ranges((0.0, 0.0, 0.0044), 0.0, 5.0)
    found = noise_of(off, np.ones(len(off)), reach)
    assert sigma_at(found, np.array([500.0]))[0] == sigma_at(found, np.array([50.0]))[0] < 1.1 * 0.0044 * 15.0**2
    off, reach, _ = ranges((0.01, 0.0, 0.0), 0.0, 30.0)
    found = noise_of(off, np.ones(len(off)), reach)
    assert found.linear == found.quadratic == 0.0
    assert sigma_at(found, np.array([np.inf, np.nan]))[0] == found.constant


def test_exact_ranges_do_not_err():
    assert noise_of(np.full(4, np.inf), np.ones(4), np.ones(4)) == EXACT
    assert sigma_at(noise_of(np.zeros(100), np.ones(100), np.ones(100)), np.ones(2)).max() < 1e-5


def test_beyond_whole_nothing_is_left_out_to_the_last_bit(monkeypatch):
    cut = np.linspace(WHOLE, 60.0, 1000)
    assert np.all(erf(cut / np.sqrt(2.0)) == 1.0)
    assert np.all(1.0 - cut * np.sqrt(2.0 / np.pi) * np.exp(-0.5 * np.square(cut)) == 1.0)
    for shape, gross in itertools.product(SHAPES, (0.0, 0.3)):
        residual, reach, _ = ranges(shape, gross, 20.0)
        found = noise_of(residual, np.ones(len(reach)), reach)
        monkeypatch.setattr(noise_model, "WHOLE", np.inf)
        assert noise_of(residual, np.ones(len(reach)), reach) == found
        monkeypatch.undo()
