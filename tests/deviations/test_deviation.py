"""Deviations of boxes whose motion is known, and what must not change them."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jaxmm.deviations.deviation import deviations_of
from jaxmm.deviations.pose_errors import EXACT, KEPT, REGISTERED
from jaxmm.deviations.shifted_columns import beside_columns, columns_of, shifts_of
from jaxmm.rays.scan_rays import PosedScan, ScanRays, rays_of_scan
from tests.cases.box_building import building_of
from warp_scanner.scenes.building import Triangles
from warp_scanner.scenes.building_edits import move_element
from warp_scanner.scenes.scenes import CEILING, FLOOR, PILLAR, WALL
from warp_scanner.sensors.scan import Rays
from warp_scanner.sensors.sensors import sensor_named
from warp_scanner.sensors.triangles import TriangleScene, cast_triangles, prepare

SENSOR = sensor_named("ouster-64")
PLACE = np.array([-1.0, 0.3, 1.4])
# A hall with a wall that stands free, and a column.
HALL = (
    ((0, 0, -0.1), (6, 5, 0.1), FLOOR), ((0, 0, 3.1), (6, 5, 0.1), CEILING),
    ((-6, 0, 1.5), (0.1, 5, 1.5), WALL), ((6, 0, 1.5), (0.1, 5, 1.5), WALL),
    ((0, -5, 1.5), (6, 0.1, 1.5), WALL), ((0, 5, 1.5), (6, 0.1, 1.5), WALL),
    ((3, 0, 1.5), (0.1, 2, 1.5), WALL), ((-3.5, -2.0, 1.5), (0.2, 0.2, 1.5), PILLAR),
)  # fmt: skip
FREE, COLUMN = 6, 7


def hall() -> Triangles:
    return building_of(HALL).triangles


def moved(triangles: Triangles, row: int, step=(0.0, 0.0, 0.0), turn=(0.0, 0.0, 0.0)) -> Triangles:
    """One element moved about its middle: by a step [m] and a rotation vector [deg]."""
    return move_element(triangles, row, np.array(step), np.radians(turn))


def scan_with_errors(triangles: Triangles, noise: float, place=PLACE, seed=0) -> PosedScan:
    """What a scanner sees of it, with errors [m] along its rays."""
    direction = SENSOR.directions()
    distance = cast_triangles(prepare(triangles), Rays(place[None], direction)).distance[0].astype(np.float64)
    distance += np.random.default_rng(seed).normal(0.0, noise, len(distance)) if noise else 0.0
    back = np.isfinite(distance)
    points = (place + direction[back] * distance[back, None]).astype(np.float32)
    return PosedScan(points, place, np.eye(3), SENSOR)


def seen(triangles: Triangles, place=PLACE, noise=0.0, seed=0) -> ScanRays:
    """The same as rays."""
    return rays_of_scan(scan_with_errors(triangles, noise, place, seed))


def told(model: Triangles | TriangleScene, *rays: ScanRays, trust=EXACT):
    scene = prepare(model) if isinstance(model, Triangles) else model
    return deviations_of(scene, list(rays), [trust] * len(rays), np.full(len(HALL), 0.03))


@pytest.mark.parametrize("trust", [EXACT, KEPT, REGISTERED])
@pytest.mark.parametrize("by", [0.0, 0.004, -0.025, 0.06, -0.12, 0.29])
def test_a_wall_that_was_shifted_is_off_by_that(by, trust):
    """To 0.1 mm, along what its face fixes, and nothing is told of the way along it."""
    one = told(hall(), seen(moved(hall(), FREE, (by, 0.0, 0.0))), trust=trust)[FREE]
    assert one.offset == pytest.approx((by, 0.0, 0.0), abs=1e-4)
    assert one.interval[0][0] <= by <= one.interval[0][1] and one.interval[1] is None and one.interval[2] is None
    assert one.direction == pytest.approx((-1.0, 0.0, 0.0), abs=1e-3) and one.distance == pytest.approx(-by, abs=1e-4)
    assert one.turn == pytest.approx(0.0, abs=0.01) and one.lean == pytest.approx(0.0, abs=0.01)
    assert one.flatness < 1e-4 and one.rays > 1000


@pytest.mark.parametrize("angle", [-3.0, -0.4, 0.2, 1.5, 3.0])
def test_a_wall_that_was_turned_or_leans_says_by_how_much(angle):
    turned = told(hall(), seen(moved(hall(), FREE, turn=(0.0, 0.0, angle))))[FREE]
    assert turned.turn == pytest.approx(angle, abs=0.01) and turned.lean == pytest.approx(0.0, abs=0.02)
    assert turned.offset == pytest.approx((0.0, 0.0, 0.0), abs=2e-4)
    leaning = told(hall(), seen(moved(hall(), FREE, turn=(0.0, angle, 0.0))))[FREE]
    assert leaning.lean == pytest.approx(abs(angle), abs=0.01) and leaning.turn == pytest.approx(0.0, abs=0.02)
    # 4 m long and 3 m high: DIN 18202 leaves 12 and 8 mm from end to end, 0.17 and 0.15 degrees.
    assert turned.classes["din18202"] == leaning.classes["din18202"] == "beyond"


@pytest.mark.parametrize("step", [(0.02, 0.01, 0.0), (-0.04, 0.05, 0.0), (0.06, 0.04, 0.0)])
def test_a_column_of_which_two_faces_show_is_off_both_ways(step):
    one = told(hall(), seen(moved(hall(), COLUMN, step)))[COLUMN]
    assert one.offset == pytest.approx(step, abs=2e-4)
    assert one.interval[0] is not None and one.interval[1] is not None and one.interval[2] is None


def test_one_wall_that_moved_drags_no_other():
    found = told(hall(), seen(moved(hall(), FREE, (0.08, 0.0, 0.0))), trust=REGISTERED)
    assert {row for row, one in found.items() if abs(one.distance) > 5e-4} == {FREE}


def test_a_pose_that_is_off_is_not_laid_at_the_elements_door():
    """By 15 mm and a fifth of a degree: all that stands is still told to stand, and the wall to be off."""
    rays = seen(moved(hall(), FREE, (0.05, 0.0, 0.0)))
    turn = Rotation.from_rotvec([0.0, 0.0, np.radians(0.2)]).as_matrix()
    off = rays._replace(
        position=rays.position + np.array([0.015, -0.01, 0.003]), direction=(rays.direction @ turn.T).astype("f4")
    )
    found = told(hall(), off, trust=REGISTERED)
    assert found[FREE].distance == pytest.approx(-0.05, abs=1e-3)
    assert max(abs(one.distance) for row, one in found.items() if row != FREE) < 1e-3
    believed = told(hall(), off, trust=EXACT)
    assert max(abs(one.distance) for row, one in believed.items() if row != FREE) > 0.01


def test_between_two_walls_alone_nobody_knows_which_moved():
    """Their distance is wrong, and no other face fixes the way between: intervals of both hold both answers."""
    box = [one for number, one in enumerate(HALL) if number not in (FREE, COLUMN)]
    model = building_of(box).triangles
    rays = seen(moved(model, 3, (0.04, 0.0, 0.0)))
    found = deviations_of(prepare(model), [rays], [REGISTERED], np.full(len(box), 0.03))
    for row, sides in ((2, (-0.04, 0.0)), (3, (0.0, 0.04))):
        low, high = found[row].interval[0]
        assert low <= sides[0] + 1e-4 and high >= sides[1] - 1e-4
    assert found[4].half < 0.005  # of the others there is no doubt


def test_scan_and_model_moved_together_give_the_same():
    scan = seen(moved(hall(), FREE, (0.03, 0.0, 0.0), (0.0, 0.0, 0.5)), noise=0.005)
    here = told(hall(), scan, trust=REGISTERED)
    turn = Rotation.from_rotvec([0.0, 0.0, 0.7]).as_matrix()
    shift = np.array([30.0, -12.0, 4.0])
    model = hall()
    there = model._replace(vertices=(model.vertices.astype(np.float64) @ turn.T + shift).astype(np.float32))
    rays = scan._replace(
        position=turn @ scan.position + shift, direction=(scan.direction @ turn.T).astype(np.float32),
        pattern=(scan.pattern @ turn.T).astype(np.float32),
    )  # fmt: skip
    again = told(there, rays, trust=REGISTERED)
    assert here.keys() == again.keys()
    for row, one in here.items():
        assert again[row].distance == pytest.approx(one.distance, abs=5e-4)
        assert again[row].offset == pytest.approx(tuple(turn @ one.offset), abs=5e-4)


def test_the_order_of_scans_changes_nothing():
    real = moved(hall(), FREE, (-0.05, 0.0, 0.0))
    one, other = seen(real, noise=0.004), seen(real, np.array([4.5, -1.0, 1.6]), 0.004, 1)
    found, swapped = told(hall(), one, other, trust=REGISTERED), told(hall(), other, one, trust=REGISTERED)
    assert found.keys() == swapped.keys()
    for row, each in found.items():
        assert swapped[row].offset == pytest.approx(each.offset, abs=1e-9)
    assert found[FREE].scans == (0, 1) and found[FREE].distance != 0.0


def test_intervals_of_halves_overlap():
    """Of odd and even rays of noisy scans, in at least 95 of 100 pairs."""
    overlaps = []
    for seed in range(6):
        rays = seen(moved(hall(), FREE, (0.02, 0.0, 0.0)), noise=0.01, seed=seed)
        halves = []
        for start in (0, 1):
            chosen = slice(start, rays.measured, 2)
            halves.append(told(hall(), rays._replace(
                direction=rays.direction[chosen], distance=rays.distance[chosen], measured=len(rays.distance[chosen])
            )))  # fmt: skip
        for row in halves[0].keys() & halves[1].keys():
            one, other = halves[0][row], halves[1][row]
            overlaps.append(abs(one.distance - other.distance) <= one.half + other.half)
    assert np.mean(overlaps) >= 0.95 and len(overlaps) > 30


def test_what_hides_a_wall_says_nothing_against_it():
    """A shelf that hides two thirds of it from the floor up, 0.2 m before it."""
    shelf = ((2.75, -0.5, 1.4), (0.05, 1.4, 1.4), WALL)
    real = building_of((*HALL, shelf)).triangles
    one = deviations_of(prepare(hall()), [seen(real)], [EXACT], np.full(len(HALL), 0.03))[FREE]
    assert abs(one.distance) < 1e-4 and one.stands > 0.9


def test_a_wall_that_is_gone_before_another_one_is_not_displaced():
    """What shows behind it is in the model, too."""
    layers = (*HALL, ((3.2, 0, 1.5), (0.05, 2, 1.5), WALL))
    model = building_of(layers).triangles
    real = building_of([one for number, one in enumerate(layers) if number != FREE]).triangles
    found = deviations_of(prepare(model), [seen(real)], [EXACT], np.full(len(layers), 0.03))
    assert FREE not in found


def test_too_few_rays_tell_nothing():
    rays = seen(hall())
    few = rays._replace(direction=rays.direction[:15], distance=rays.distance[:15], measured=15)
    assert told(hall(), few) == {}


@pytest.mark.parametrize("step", [(0.1, -0.1, 0.0), (-0.15, 0.15, 0.0), (-0.2, -0.05, 0.0), (0.2, -0.2, 0.0)])
def test_a_column_beside_its_place_is_found_by_its_shape(step):
    """Most rays that should meet it pass: its shape is laid over what belongs to nothing else."""
    real = seen(moved(hall(), COLUMN, step))
    scene = prepare(hall())
    assert COLUMN in columns_of(scene) and FREE not in columns_of(scene)
    found = shifts_of(scene, [beside_columns(scene, real, 0.3)], np.array([COLUMN]), 0.3)[COLUMN]
    assert np.all(np.abs(found.step[:2] - step[:2]) <= found.half + 0.01) and np.all(found.half <= 0.07)


@pytest.mark.parametrize("half, turned", [(0.45, 45.0), (0.65, 0.0)])
def test_a_wide_column_beside_its_place_is_found_as_a_slender_one_is(half, turned):
    column = building_of((*HALL[:COLUMN], ((-3.5, -2.0, 1.5), (half, half, 1.5), PILLAR))).triangles
    model = moved(column, COLUMN, turn=(0.0, 0.0, turned))
    step, scene = (-0.16, 0.16, 0.0), prepare(model)
    found = shifts_of(scene, [beside_columns(scene, seen(moved(model, COLUMN, step)), 0.3)], np.array([COLUMN]), 0.3)
    assert np.all(np.abs(found[COLUMN].step[:2] - step[:2]) <= found[COLUMN].half + 0.01)
    wall = building_of((*HALL[:COLUMN], ((-3.5, -2.0, 1.5), (half, half, 1.5), WALL))).triangles
    assert COLUMN not in columns_of(prepare(moved(wall, COLUMN, turn=(0.0, 0.0, turned))))


def test_a_column_is_found_beside_a_wall_that_moved_too_by_ranges_that_err():
    """What the scan shows of the wall is no part of what the column must explain."""
    step, wall = (-0.16, 0.16, 0.0), ((-4.0, 0.0, 1.5), (0.1, 5.0, 1.5), WALL)
    model = building_of((*HALL[:2], wall, *HALL[3:])).triangles
    others = moved(model, 2, (0.08, 0.0, 0.0))
    beside = beside_columns(prepare(model), seen(moved(others, COLUMN, step), noise=0.01), 0.3)
    found = shifts_of(prepare(model), [beside], np.array([COLUMN]), 0.3, prepare(others))[COLUMN]
    assert np.all(np.abs(found.step[:2] - step[:2]) <= found.half + 0.01)


def test_a_column_in_its_place_or_far_from_it_is_not_found_beside_it():
    scene, rows = prepare(hall()), np.array([COLUMN])
    for step in ((0.0, 0.0, 0.0), (0.6, 0.2, 0.0)):
        assert not shifts_of(scene, [beside_columns(scene, seen(moved(hall(), COLUMN, step)), 0.3)], rows, 0.3)
    gone = building_of(HALL[:COLUMN]).triangles
    assert not shifts_of(scene, [beside_columns(scene, seen(gone), 0.3)], rows, 0.3)
