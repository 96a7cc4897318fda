"""Rays by the height at which they meet an element: what stands in its place and is lower is something else."""

import numpy as np
import pytest

from jaxmm.deviations.heights import heights_of, passed_above
from jaxmm.deviations.meetings import meetings_of
from jaxmm.rays.scan_rays import rays_of_scan
from tests.cases.box_building import building_of, scan_of, shell_of
from warp_scanner.scenes.scenes import PILLAR, TABLE, WALL
from warp_scanner.sensors.sensors import OAK_D_PRO_SMALL, OUSTER_64
from warp_scanner.sensors.triangles import prepare

HIGH, ROW = 3.0, 6
SHELL, PLACE = shell_of(6.0, 4.0, HIGH), np.array([-1.5, 0.4, 1.4])
COLUMN = ((2.0, 0.0, HIGH / 2), (0.2, 0.2, HIGH / 2), PILLAR)
PARTITION = ((2.0, 0.0, HIGH / 2), (0.1, 1.5, HIGH / 2), WALL)
SENSORS = pytest.mark.parametrize("sensor", [OUSTER_64, OAK_D_PRO_SMALL], ids=["rings", "camera"])


def thing(x, y, edges, top, foot=0.0, semantic=TABLE):
    """A box from `foot` to `top` about a place in plan [m]."""
    return (x, y, (foot + top) / 2), (edges[0] / 2, edges[1] / 2, (top - foot) / 2), semantic


def passed(element, *scans, in_place=True):
    """Whether rays pass above what stands there; scans are what stands, the place, and the sensor."""
    triangles = building_of((*SHELL, element)).triangles
    shown = []
    for there, place, sensor in scans:
        rays = rays_of_scan(scan_of((*SHELL, *there), place, sensor).scan)
        shown.append(heights_of(triangles, meetings_of(prepare(triangles), rays)))
    found = passed_above(triangles, shown, in_place=in_place)
    assert not found[:ROW].any()  # the shell stands
    return bool(found[ROW])


@SENSORS
@pytest.mark.parametrize("share", [0.3, 0.5, 0.7, 0.85])
@pytest.mark.parametrize("element", [COLUMN, PARTITION], ids=["column", "wall"])
def test_rays_pass_above_what_is_lower(element, share, sensor):
    """Whatever its front: in front of the face, about it, or behind."""
    x, y = (2.0 * edge for edge in element[1][:2])
    for off in (-0.1, 0.1, 0.22):
        there = thing(2.0 + off, 0.0, (x + 0.3, y + 0.1), share * HIGH)
        assert passed(element, ((there,), PLACE, sensor))


@SENSORS
@pytest.mark.parametrize("element", [COLUMN, PARTITION], ids=["column", "wall"])
def test_none_pass_above_what_stands(element, sensor):
    """Alone, behind what is low, behind what hides its head, and with its head out of view."""
    before = [(), (thing(1.2, 0.0, (0.4, 4.0), 1.6),), (thing(1.2, 0.0, (0.4, 4.0), HIGH, 1.3),)]
    for there in before:
        assert not passed(element, ((element, *there), PLACE, sensor))
    near = np.array([1.0, 0.0, 0.5])
    assert not passed(element, ((element,), near, sensor))
    hidden = thing(2.0, 0.0, (0.56, 3.1), 1.5), thing(1.0, 0.0, (0.1, 4.0), HIGH, 1.3)
    assert not passed(element, (hidden, PLACE, sensor))  # where no ray passes nobody knows


def test_its_own_lower_part_is_no_other_thing():
    """A column of which half stands is not gone, where it is in its place; it is where it is asked for beside it."""
    half = (thing(2.0, 0.0, (0.4, 0.4), 1.5, semantic=PILLAR),)
    assert not passed(COLUMN, (half, PLACE, OUSTER_64))
    assert passed(COLUMN, (half, PLACE, OUSTER_64), in_place=False)
    assert passed(COLUMN, ((thing(2.0, 0.0, (0.5, 0.5), 1.5),), PLACE, OUSTER_64))


@SENSORS
def test_a_front_that_goes_on_beside_a_column_is_no_part_of_it(sensor):
    """The front of a cabinet where the column's face was, and off it by less than ranges tell; not its own half."""
    half = thing(2.0, 0.0, (0.4, 0.4), 1.5, semantic=PILLAR)
    for off, middle in ((0.0, 0.0), (0.02, 0.2), (-0.02, -0.2)):
        cabinet = thing(2.05 + off, middle, (0.5, 1.0), 1.5)
        assert passed(COLUMN, ((cabinet,), PLACE, sensor))
    # What stands well before or behind its plane is no part of it, nor what stands across, which meets it in a line.
    across = np.array([0.8, 1.2, 1.4])
    for beside, place in (
        (thing(1.6, 0.7, (0.3, 0.9), 1.5), PLACE), (thing(2.2, 0.7, (0.3, 0.9), 1.5), PLACE),
        (thing(1.8, -0.3, (0.6, 0.04), 1.5), across),
    ):  # fmt: skip
        assert not passed(COLUMN, ((half, beside), place, sensor))


def test_an_opening_in_a_wall_is_not_above_it():
    """A window over nearly all of its length: its lintel stands, or it does not reach over the whole length."""
    sill = thing(2.0, 0.0, (0.2, 3.0), 0.9, semantic=WALL)
    lintel = thing(2.0, 0.0, (0.2, 3.0), HIGH, 2.6, semantic=WALL)
    jamb = thing(2.0, -0.9, (0.2, 1.2), HIGH, semantic=WALL)
    front = thing(1.9, 0.0, (0.2, 3.0), 0.9)  # a bench before the sill, which the rule must not take for the wall's end
    assert not passed(PARTITION, ((sill, lintel, front), PLACE, OUSTER_64))
    assert not passed(PARTITION, ((sill, jamb, front), PLACE, OUSTER_64))
    assert passed(PARTITION, ((sill, front), PLACE, OUSTER_64))
    # What hides the jamb, or the lintel, hides whether there is one.
    for hides in (thing(1.5, -0.9, (0.2, 1.4), HIGH, 0.9), thing(1.5, 0.0, (0.2, 4.0), HIGH, 2.2)):
        assert not passed(PARTITION, ((sill, front, hides), PLACE, OUSTER_64))


def test_scans_tell_together():
    """One sees what stands below, another the free place above it."""
    there = thing(1.95, 0.0, (0.5, 0.5), 1.5)
    low, high = thing(0.8, 0.0, (0.1, 4.0), HIGH, 1.2), thing(0.8, 0.0, (0.1, 4.0), 1.4)
    assert not passed(COLUMN, ((there, low), PLACE, OUSTER_64))
    one, other = ((there, low), PLACE, OUSTER_64), ((there, high), PLACE, OUSTER_64)
    assert passed(COLUMN, one, other) and passed(COLUMN, other, one)
