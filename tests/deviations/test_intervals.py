"""Intervals of as-built places: as wide as errors are, and told by others than the element itself."""

import numpy as np
import pytest

from jaxmm.deviations.deviation import deviations_by, faces_of
from jaxmm.deviations.pose_errors import EXACT, KEPT, REGISTERED
from jaxmm.rays.scan_rays import rays_of_scan
from tests.cases.box_building import building_of
from tests.deviations.test_deviation import COLUMN, FREE, HALL, hall, moved, scan_with_errors, seen, told
from tests.deviations.test_hard_deviations import shaft
from warp_scanner.scenes.building_edits import join
from warp_scanner.sensors.triangles import prepare

SEEDS = range(12)


def test_what_moved_a_little_is_not_drawn_to_its_place():
    """A wall that had a voice in where the scanner stands would say a part of its own offset off."""
    model = real = hall()
    for number, row in enumerate((2, 3, 4, 5)):  # all scatter by 3 mm
        real = moved(real, row, np.where(np.arange(3) == (row > 3), 0.003 * (-1) ** (number > 1), 0.0))
    places = [told(model, seen(moved(real, FREE, (by, 0.0, 0.0))), trust=REGISTERED)[FREE].distance
              for by in (0.0, 0.001)]  # fmt: skip
    assert places[0] - places[1] == pytest.approx(0.001, rel=0.03)


@pytest.mark.parametrize("trust, by", [
    (REGISTERED, 0.004), *(pytest.param(*case, marks=pytest.mark.long) for case in ((REGISTERED, 0.05), (KEPT, 0.0))),
])  # fmt: skip
def test_intervals_are_as_wide_as_errors_are(trust, by):
    """Of ranges that err by 20 mm: most hold, and not by being far too wide."""
    model, z = prepare(hall()), []
    for seed in SEEDS:
        found = told(model, seen(moved(hall(), FREE, (by, 0.0, 0.0)), noise=0.02, seed=seed), trust=trust)
        z += [(one.distance + by * (row == FREE)) / one.half for row, one in found.items()]
    assert 0.92 <= np.mean(np.abs(z) <= 1.0) and 0.33 <= np.std(z) <= 0.6  # 0.51 of a normal


def test_an_axis_and_the_distance_along_it_have_the_same_bounds():
    """One quantity, one interval."""
    one = told(hall(), seen(moved(hall(), FREE, (0.02, 0.0, 0.0)), noise=0.01), trust=REGISTERED)[FREE]
    low, high = one.interval[0]
    assert one.direction == pytest.approx((-1.0, 0.0, 0.0), abs=1e-6)
    assert (-one.distance - one.half, -one.distance + one.half) == pytest.approx((low, high), abs=1e-8)


def test_noise_along_slanting_rays_turns_no_face():
    """A range that errs by 50 mm moves the end along the face, too: taken for places, ends would turn it by degrees."""
    model, exact, slopes = prepare(hall()), seen(hall()), []
    end = exact.position + exact.direction * exact.distance[:, None]
    aside = (np.abs(end[:, 1] - 4.9) < 0.05) & (end[:, 0] > 4.5)  # of the wall at y = 5, which is 4.6 m away
    rays = rays_of_scan(scan_with_errors(hall(), 0.0)._replace(points=end[aside].astype(np.float32)))
    for seed in SEEDS[:8]:
        own = rays.distance[: rays.measured] + np.random.default_rng(seed).normal(0.0, 0.05, rays.measured)
        fits = [one.fit for one in faces_of(model, rays, KEPT, own).seen if one.element == 5]
        slopes += [fit.slope[0] / np.sqrt(fit.variance[1, 1]) for fit in fits]
    assert len(slopes) == 8 and abs(np.mean(slopes)) < 1.0 and np.std(slopes) < 2.0


def test_ranges_that_err_by_much_move_no_round_column():
    """Of a shaft 0.25 m thick, by ranges that err by 80 mm: their ends lie about it, and mostly outside of it."""
    room = building_of(HALL[:COLUMN]).triangles
    whole = join(room, shaft(-2.0, -1.0))
    offsets = []
    for seed in SEEDS[:4]:
        scan = scan_with_errors(whole, 0.08, np.array([2.0, -3.0, 1.4]), seed)
        rays = rays_of_scan(scan)
        ideal = seen(whole, np.array([2.0, -3.0, 1.4]))
        own = rays.distance[: rays.measured].astype(np.float64)
        one = faces_of(prepare(whole), ideal, EXACT, own)
        found = deviations_by(prepare(whole), [one], np.full(COLUMN + 1, 0.03))[COLUMN]
        offsets.append(found.offset[:2])
    assert np.abs(np.mean(offsets, axis=0)).max() < 0.006
