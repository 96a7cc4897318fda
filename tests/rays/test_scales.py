"""A scan at another size is told by what lies opposite each other, and what moved is no other size."""

import numpy as np
import pytest

from jaxmm.rays.registration import register
from jaxmm.rays.scan_rays import rays_of_scan
from jaxmm.verdicts.building_evidence import surfaces_along
from tests.cases.box_building import building_of, scan_of
from tests.deviations.test_deviation import COLUMN, FREE, HALL, PLACE, moved, scan_with_errors
from warp_scanner.sensors.sensors import OAK_D_PRO_SMALL
from warp_scanner.sensors.triangles import prepare

ZERO = np.array([20.0, -8.0, 0.5])  # [m] of the file's frame, away from the hall


def some(triangles, noise):
    """A scan of few points."""
    scan = scan_with_errors(triangles, noise)
    return scan._replace(points=scan.points[::8])


def scale_of(scan, points, shift=(0.0, 0.0, 0.0)):
    """What is told of points of a scan of the hall, where its pose is off by a shift [m]."""
    shift = np.asarray(shift)
    prior = surfaces_along(prepare(building_of(HALL).triangles), rays_of_scan(scan))
    return register(points + shift, prior, scan.position + shift, zero=ZERO).scale


@pytest.mark.parametrize(
    "factor, about, off",
    [
        (0.9144, "sensor", 0.0),
        (1.0 / 0.9144, "zero", 0.0),
        (0.97, "sensor", 0.2),
        (1.03, "zero", 0.2),
        (0.8, "zero", 0),
    ],
)
def test_another_size_is_told(factor, about, off):
    """Though a wall moved, and whatever the frame's zero is; a size that is hardly another is that of a sensor."""
    scan = some(moved(building_of(HALL).triangles, FREE, (0.2, 0.0, 0.0)), 0.005)
    middle = ZERO if about == "zero" else scan.position
    points = middle + (scan.points - middle) / factor
    found = scale_of(scan, points, np.array([off, -off / 2, 0.0]))
    assert found is not None and found.factor == pytest.approx(factor, abs=0.005) and found.surfaces > 1.5


@pytest.mark.long
@pytest.mark.parametrize("noise, off", [(0.0, 0.0), (0.01, 0.3)])
def test_what_moved_is_no_other_size(noise, off):
    """A third of what stands, toward the middle or away from it, by as much as one size would have it."""
    rng = np.random.default_rng(3)
    for _ in range(4):
        built = building_of(HALL).triangles
        for row in rng.permutation(np.arange(2, len(HALL)))[:2]:
            built = moved(built, row, (*rng.uniform(-0.3, 0.3, 2), 0.0))
        scan = some(built, noise)
        assert scale_of(scan, scan.points, rng.uniform(-off, off, 3)) is None
    for way in (-0.05, 0.05):  # of one pair both, and the column, as all would stand at another size
        built = building_of(HALL).triangles
        for row in (2, 3, COLUMN):
            built = moved(built, row, (way * (HALL[row][0][0] - PLACE[0]), 0.0, 0.0))
        scan = some(built, noise)
        assert scale_of(scan, scan.points) is None


def test_a_view_without_anything_opposite_tells_no_size():
    """Of a wall and a floor: what is nearer may as well have been scanned from nearer."""
    boxes = [HALL[number] for number in (0, 3)]
    scan = scan_of(boxes, PLACE, OAK_D_PRO_SMALL).scan
    prior = surfaces_along(prepare(building_of(boxes).triangles), rays_of_scan(scan))
    points = scan.position + (scan.points - scan.position) / 0.9144
    assert register(points, prior, scan.position, zero=ZERO).scale is None
