"""What several scans tell together of elements that moved, where one of them leaves open which did."""

import numpy as np
import pytest

from jaxmm.deviations.agreed_poses import agreed
from jaxmm.deviations.deviation import deviations_by, faces_of
from jaxmm.deviations.pose_errors import REGISTERED
from jaxmm.rays.scan_rays import rays_of_scan
from tests.cases.box_building import building_of
from tests.deviations.test_deviation import FREE, HALL, moved, scan_with_errors
from warp_scanner.sensors.triangles import prepare

# A wall from side to side: who stands beyond it sees but two walls that tell how far along x.
PARTED = [*HALL[:FREE], ((3, 0, 1.5), (0.1, 4.9, 1.5), HALL[FREE][2]), *HALL[FREE + 1 :]]
BEYOND, FARTHER, EAST = np.array([4.3, -1.0, 1.5]), np.array([4.7, 1.5, 1.6]), 3
BEFORE = [np.array(place) for place in ((-1.0, 0.3, 1.4), (-4.5, 2.0, 1.5), (1.0, -3.0, 1.6))]
BY = 0.06


def shown(places, wrong=0.0, noise=0.003):
    """Faces by scans from some places; those beyond the wall lie so far off along x, as registration halves it."""
    model = building_of(PARTED).triangles
    real, found = moved(model, FREE, (BY, 0.0, 0.0)), []
    for number, place in enumerate(places):
        scan = scan_with_errors(real, noise, place, number)
        shift = np.array([wrong if place[0] > 3.0 else 0.0, 0.0, 0.0])
        scan = scan._replace(points=(scan.points + shift).astype(np.float32), position=scan.position + shift)
        found.append(faces_of(prepare(model), rays_of_scan(scan), REGISTERED))
    return found


def told(faces):
    model = building_of(PARTED).triangles
    return deviations_by(prepare(model), agreed(faces), np.full(len(PARTED), 0.03))


@pytest.mark.parametrize("wrong", [-0.03, 0.0, -0.06])
@pytest.mark.parametrize("count", [1, 3])
def test_who_sees_but_two_walls_does_not_hide_that_one_of_them_moved(wrong, count):
    """Those that see more tell which: neither the wall that moved nor the other is left open."""
    found = told(shown([*BEFORE[:count], BEYOND], wrong))
    one, low_high = found[FREE], found[EAST].interval[0]
    assert one.offset[0] == pytest.approx(BY, abs=3e-3) and one.half < 0.01 and one.surely > 0.045
    assert found[EAST].scans == (count,) and low_high is not None
    assert -0.01 < low_high[0] <= 0.0 <= low_high[1] < 0.01 and found[EAST].coverage > 0.15


@pytest.mark.parametrize("starts", [1, 3, 128])
def test_the_order_of_scans_changes_nothing(starts, monkeypatch):
    """Also where only some of the poses that may be are begun from."""
    monkeypatch.setattr("jaxmm.deviations.agreed_poses.MOST_STARTS", starts)
    faces = shown([*BEFORE, BEYOND, FARTHER], -0.03)
    found, other = told(faces), told(faces[::-1])
    assert found.keys() == other.keys()
    for row in found:
        assert found[row].offset == pytest.approx(other[row].offset, abs=1e-8)
        assert found[row].half == pytest.approx(other[row].half, abs=1e-8)


def test_what_all_scans_leave_open_stays_open():
    """Of the two walls one moved; that two scans see no more than these makes it no surer which."""
    faces = shown([BEYOND, FARTHER], -0.03)
    both = [len(one.poses) for one in agreed(faces)]
    assert both == [2, 2] and all(one.among == 0 for each in agreed(faces) for one in each.poses)
    found = told(faces)
    for row, true in ((FREE, BY), (EAST, 0.0)):
        span = found[row].interval[0]
        assert span is None or (span[0] <= true <= span[1] and span[1] - span[0] > BY)


def test_a_scan_by_itself_is_told_as_ever():
    faces = shown([BEYOND], -0.03)
    assert agreed(faces) is faces


def test_surfaces_are_off_by_the_pose_that_scans_agree_on():
    """What a face is off is the same, whether its scan knew its pose or others told it."""
    found = agreed(shown([*BEFORE, BEYOND], -0.03))[-1]
    faces = [one for one in found.seen if one.fit.first and len(one.cell)]
    assert {FREE, EAST} < {one.element for one in faces}
    for one in faces:
        off = float(np.median(one.off[0]))
        assert off == pytest.approx(BY if one.element == FREE else 0.0, abs=4e-3)
