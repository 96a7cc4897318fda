"""Stations laid upon each other: what was drawn along by what moved comes back, and nothing else moves."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jaxmm.rays.joint_poses import Station, held_together
from jaxmm.rays.patches import LEAST, SIZE, patches_of
from tests.cases.box_building import building_of, scan_of
from warp_scanner.scenes.scenes import CEILING, FLOOR, WALL
from warp_scanner.sensors.sensors import Spinning
from warp_scanner.sensors.triangles import clearance, prepare

SENSOR = Spinning(channels=90, azimuth_steps=360, elevation_range=(-60.0, 60.0))
HIGH, MOVED, REACH = 2.8, np.array([-0.25, 0.2, 0.0]), 5.5  # [m]


def wall(low, high, shift=(0.0, 0.0, 0.0)):
    """An upright box between two corners in plan."""
    low, high = np.array([*low, 0.0]) + shift, np.array([*high, HIGH]) + shift
    return (low + high) / 2, (high - low) / 2, WALL


def site(shift=(0.0, 0.0, 0.0)):
    """A hall and, through a wide opening, a room whose walls may all be built elsewhere."""
    return (
        (np.array([0.0, 0.0, -0.1]), np.array([7.0, 5.0, 0.1]), FLOOR),
        (np.array([0.0, 0.0, HIGH + 0.1]), np.array([7.0, 5.0, 0.1]), CEILING),
        wall((-6.2, -4.0), (-6.0, 4.0)), wall((-6.2, 4.0), (0.0, 4.2)), wall((-6.2, -4.2), (0.0, -4.0)),
        wall((-3.0, 3.0), (-2.6, 3.4)), wall((-4.0, -2.0), (-3.2, -1.8)),
        wall((0.0, 1.5), (0.2, 4.2), shift), wall((0.0, -4.2), (0.2, -1.5), shift),
        wall((0.2, 3.0), (5.0, 3.2), shift), wall((0.2, -3.2), (5.0, -3.0), shift),
        wall((5.0, -3.2), (5.2, 3.2), shift), wall((2.0, -3.0), (2.4, -2.2), shift),
    )  # fmt: skip


PLACES = np.array([
    [-5.0, 3.0, 1.5], [-4.5, -3.0, 1.4], [-2.0, 0.0, 1.6], [-1.0, 0.9, 1.5], [-0.8, -1.0, 1.4], [3.6, 0.4, 1.5],
])  # fmt: skip
LAST = len(PLACES) - 1  # which sees the room alone


def motion_of(shift, yaw, about):
    """A pose error as a motion (4, 4)."""
    motion = np.eye(4)
    motion[:3, :3] = Rotation.from_rotvec([0.0, 0.0, np.radians(yaw)]).as_matrix()
    motion[:3, 3] = about + shift - motion[:3, :3] @ about
    return motion


def stations_of(boxes, errors, fits):
    """Stations as they were laid, off by motions."""
    found = []
    for number, (place, motion) in enumerate(zip(PLACES, errors, strict=True)):
        points = scan_of(boxes, place, SENSOR, REACH if number == LAST else np.inf).scan.points
        moved, sensor = (np.atleast_2d(one) @ motion[:3, :3].T + motion[:3, 3] for one in (points, place))
        found.append(Station(patches_of(moved.astype(np.float32), sensor[0]), sensor[0], fits[number]))
    return found


def model():
    scene = prepare(building_of(site()).triangles)
    return lambda points: clearance(scene, points.astype(np.float32), 1.0).astype(np.float64)


def test_patches_lie_on_what_is_flat_and_look_at_the_sensor():
    scan = scan_of(site(), PLACES[2], SENSOR).scan
    found = patches_of(scan.points, scan.position)
    off = model()(found.middle)
    assert len(found.middle) > 300 and np.quantile(off, 0.95) < 1e-5 and off.max() < 0.02
    assert np.all(np.einsum("kc,kc->k", found.normal, scan.position - found.middle) > 0.0)
    assert np.abs(np.linalg.norm(found.normal, axis=1) - 1.0).max() < 1e-12
    few = patches_of(scan.points[: LEAST - 1], scan.position)
    assert few.middle.shape == few.normal.shape == (0, 3)
    round_one = Rotation.random(20000, rng=0).apply([0.0, 0.0, SIZE / 3]) + SIZE / 2
    assert not len(patches_of(round_one, np.array([3.0, 0.0, 0.0])).middle)


@pytest.mark.long
@pytest.mark.parametrize("fits", [True, False])
@pytest.mark.parametrize("error", [(MOVED * -1.0, 0.0), ((0.2, -0.2, 0.02), 1.5), ((-0.1, 0.1, -0.03), -2.0)])
def test_a_station_before_what_moved_is_held_by_the_others(error, fits):
    """Whether it was drawn to where the model has it, or fits nowhere and is where it was believed to be."""
    errors = [np.eye(4)] * LAST + [motion_of(*error, PLACES[LAST])]
    stations = stations_of(site(MOVED), errors, [True] * LAST + [fits])
    *others, last = held_together(stations, model())
    assert others == [None] * LAST
    there = last.motion @ [*stations[LAST].sensor, 1.0]
    assert np.linalg.norm(there[:3] - PLACES[LAST]) < 0.03
    turn = Rotation.from_matrix(last.motion[:3, :3] @ errors[LAST][:3, :3]).magnitude()
    assert np.degrees(turn) < 0.3 and last.others >= 2


def test_the_order_of_stations_changes_no_bit():
    errors = [np.eye(4)] * LAST + [motion_of((0.2, -0.1, 0.0), 1.0, PLACES[LAST])]
    stations, order = stations_of(site(MOVED), errors, [True] * len(PLACES)), [3, 5, 0, 2, 1, 4]
    found = held_together(stations, model())
    again = held_together([stations[number] for number in order], model())
    assert [one and one.motion.tobytes() for one in again] == [
        found[number] and found[number].motion.tobytes() for number in order
    ]


def test_what_agrees_stays_though_the_room_moved():
    stations = stations_of(site(MOVED), [np.eye(4)] * len(PLACES), [True] * len(PLACES))
    assert held_together(stations, model()) == [None] * len(PLACES)
    assert held_together(stations[:1], model()) == [None]
    assert held_together([], model()) == []


def test_what_shares_too_little_fits_nowhere():
    """A scan of another building, and one that hangs on a floor alone."""
    stations = stations_of(site(), [np.eye(4)] * len(PLACES), [True] * LAST + [False])
    patches, away = stations[LAST].patches, np.array([0.0, 40.0, 0.0])
    far = stations[LAST]._replace(patches=patches._replace(middle=patches.middle + away))
    assert held_together([*stations[:LAST], far], model())[LAST] is None
    flat = patches.normal[:, 2] > 0.9
    floor = far._replace(patches=patches._replace(middle=patches.middle[flat], normal=patches.normal[flat]))
    assert held_together([*stations[:LAST], floor], model())[LAST] is None


def test_stations_of_another_building_do_not_hold_each_other():
    """They agree, but none of them fits the model."""
    stations = stations_of(site(), [np.eye(4)] * len(PLACES), [False] * len(PLACES))
    assert held_together(stations, model()) == [None] * len(PLACES)
    away = np.array([0.0, 40.0, 0.0])
    lost = [
        one._replace(patches=one.patches._replace(middle=one.patches.middle + away), sensor=one.sensor + away)
        for one in stations
    ]
    assert held_together([stations[0]._replace(fits=True), *lost], model()) == [None] * (len(PLACES) + 1)


def test_two_that_are_lost_do_not_hold_each_other():
    """They share a room far away; one of them sees a floor that the others see, too, and so hangs on them in height."""
    stations = stations_of(site(), [np.eye(4)] * len(PLACES), [True] * LAST + [False])
    away, lost = np.array([0.0, 40.0, 0.0]), stations[LAST]
    room = lost.patches._replace(middle=lost.patches.middle + away)
    here = stations[2].patches
    flat = here.normal[:, 2] > 0.9
    both = room._replace(
        middle=np.concatenate([room.middle, here.middle[flat]]), normal=np.concatenate([room.normal, here.normal[flat]])
    )
    found = held_together([*stations[:LAST], lost._replace(patches=both), lost._replace(patches=room)], model())
    assert found == [None] * (len(PLACES) + 1)


def test_who_is_held_holds_others():
    """The last sees what one other sees alone, which the rest hold."""
    errors = [np.eye(4)] * LAST + [motion_of((0.2, -0.1, 0.0), 0.0, PLACES[LAST])]
    stations = stations_of(site(), errors, [True] * LAST + [False])
    away, lost = np.array([0.0, 40.0, 0.0]), stations[LAST]
    room = lost.patches._replace(middle=lost.patches.middle + away)
    both = room._replace(
        middle=np.concatenate([room.middle, lost.patches.middle]), normal=np.tile(lost.patches.normal, (2, 1))
    )
    *others, held, last = held_together(
        [*stations[:LAST], lost._replace(patches=both), lost._replace(patches=room)], model()
    )
    assert others == [None] * LAST and held is not None and last is not None and last.others == 1
    np.testing.assert_allclose(last.motion, held.motion, atol=0.01)


def test_of_two_that_disagree_nobody_knows_who_is_right():
    errors = [np.eye(4)] * LAST + [motion_of(-MOVED, 0.0, PLACES[LAST])]
    stations = stations_of(site(MOVED), errors, [True] * len(PLACES))
    assert held_together([stations[3], stations[LAST]], model()) == [None, None]
