"""Errors by the light that comes back, and gross ones: moments that can be worked out by hand."""

import dataclasses

import numpy as np
import pytest
from scipy import stats

from tests.warp_scanner.test_imperfections import RAYS, ROOMS, erring, flat_scan, line_sensor
from warp_scanner.scenes.scenes import CHAIR, WALL
from warp_scanner.sensors.imperfections import Imperfections, imperfect


def ranges_of(scan, errors, incidence=None):
    return erring(scan, errors, incidence).distance.astype(np.float64)


@pytest.mark.parametrize("distance", [1.0, 8.0])
@pytest.mark.parametrize("degrees", [0.0, 60.0])
@pytest.mark.parametrize(("kind", "share"), [(WALL, 0.8), (CHAIR, 0.3)])
def test_noise_by_light_is_that_of_the_light_that_comes_back(distance, degrees, kind, share):
    """sigma^2 = a^2 + k^2 r^2 / (reflectivity cos(incidence)), by hand."""
    incidence = np.full((ROOMS, RAYS), np.radians(degrees), np.float32)
    noise = ranges_of(
        flat_scan(distance, semantic=kind), Imperfections(noise=0.002, noise_by_light=0.001), incidence
    ) - distance  # fmt: skip
    sigma = np.sqrt(0.002**2 + 0.001**2 * distance**2 / (share * np.cos(np.radians(degrees))))
    assert abs(noise.mean()) < 4 * sigma / np.sqrt(noise.size)
    assert abs(noise.std() / sigma - 1) < 4 / np.sqrt(2 * noise.size) + 1e-3


@pytest.mark.parametrize(("degrees", "slant"), [(0.0, 0.0), (60.0, 1.0), (89.0, 1 / np.cos(np.radians(80)) - 1)])
def test_dark_and_slanting_surfaces_seem_farther(degrees, slant):
    incidence = np.full((ROOMS, RAYS), np.radians(degrees), np.float32)
    errors = Imperfections(dark_bias=0.02, slant_bias=0.004)
    for kind, share in ((WALL, 0.8), (CHAIR, 0.3), (200, 0.5)):
        found = ranges_of(flat_scan(2.0, semantic=kind), errors, incidence) - 2.0
        np.testing.assert_allclose(found, 0.02 * (1 - share) + 0.004 * slant, atol=1e-6)
    missed = ranges_of(flat_scan(np.inf), errors, np.full((ROOMS, RAYS), np.nan, np.float32))
    assert np.all(np.isinf(missed))


def test_elements_differ_in_what_they_send_back_and_each_stays_the_same():
    scan = flat_scan(2.0, semantic=CHAIR)
    scan.element[:] = np.arange(RAYS) % 500
    found = ranges_of(scan, Imperfections(dark_bias=1.0, reflectivity_spread=0.5)) - 2.0
    share = 1.0 - found
    assert np.ptp(share.reshape(ROOMS, -1, 500), axis=1).max() < 1e-6
    each = share[:, :500]
    assert 0.15 - 1e-5 <= each.min() < 0.16 and 0.44 < each.max() <= 0.45 + 1e-5
    assert abs(each.mean() - 0.3) < 4 * 0.3 * 0.5 / np.sqrt(3 * each.size)
    assert len(np.unique(each[:, 0].round(6))) == ROOMS
    # More elements in another room, or in this one, change nothing.
    scan.element[0, 0] = 4000
    again = ranges_of(scan, Imperfections(dark_bias=1.0, reflectivity_spread=0.5)) - 2.0
    np.testing.assert_array_equal(again[:, 1:], found[:, 1:])


@pytest.mark.parametrize(("limits", "reach", "ends"), [((0.5, 6.0), 10.0, (0.5, 6.0)), ((0.0, np.inf), 8.0, (0, 8))])
def test_gross_errors_are_as_frequent_as_stated_and_anywhere(limits, reach, ends):
    scan = flat_scan(4.0)
    scan.distance[:, ::10], scan.element[:, ::10], scan.semantic[:, ::10] = np.inf, -1, 0
    found = erring(scan, Imperfections(gross_chance=0.05, gross_reach=reach), limits=limits).distance
    assert np.all(np.isinf(found[:, ::10]))
    wrong = found[np.isfinite(found) & (found != 4.0)]
    count = int(np.isfinite(scan.distance).sum())
    assert abs(len(wrong) / count - 0.05) < 4 * np.sqrt(0.05 * 0.95 / count)
    assert stats.kstest((wrong - ends[0]) / (ends[1] - ends[0]), "uniform").pvalue > 1e-4


def test_one_effect_more_leaves_the_draws_of_all_others():
    """Switched on with nothing to do, the new effects change no bit of what the others make."""
    sensor, scan = line_sensor(Imperfections()), flat_scan(4.0)
    scan.distance[:, ::7] = 6.0
    incidence = np.full((ROOMS, RAYS), 1.4, np.float32)
    errors = Imperfections(
        noise=0.01, grazing_dropout=0.5, mixed_chance=0.5, quantum=0.002, class_dropout=((WALL, 0.1),)
    )  # fmt: skip
    plain = imperfect(scan, incidence, dataclasses.replace(sensor, imperfections=errors), 3, np.arange(ROOMS))
    for more in ({"gross_chance": 1e-12}, {"reflectivity_spread": 1.0}, {"gross_reach": 2.0}):
        other = dataclasses.replace(sensor, imperfections=dataclasses.replace(errors, **more))
        found = imperfect(scan, incidence, other, 3, np.arange(ROOMS))
        np.testing.assert_array_equal(found.distance, plain.distance)


@pytest.mark.parametrize(
    "wrong", [{"gross_chance": 1.5}, {"dark_bias": -1.0}, {"noise_by_light": np.nan}, {"reflectivity_spread": 2.0}]
)
def test_impossible_errors_are_refused(wrong):
    with pytest.raises(ValueError, match=f"imperfections.{next(iter(wrong))} must be"):
        Imperfections(**wrong)


@pytest.mark.parametrize("errors", [{"noise_by_light": 0.1}, {"slant_bias": 0.1}])
def test_errors_by_incidence_need_it(errors):
    with pytest.raises(ValueError, match="incidence must be"):
        erring(flat_scan(1.0), Imperfections(**errors))
