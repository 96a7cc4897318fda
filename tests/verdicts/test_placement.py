"""Placing scans: the fit is found, measured, and refused where there is none."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jaxmm.inputs import InputError, Misfit
from jaxmm.rays.joint_poses import Held
from jaxmm.rays.registration import register
from jaxmm.rays.scan_rays import PosedScan, rays_of_scan
from jaxmm.runs.room_scans import as_cloud, room_cases
from jaxmm.verdicts.building_evidence import passed_by, surfaces_along
from jaxmm.verdicts.cloud_comparison import visible
from jaxmm.verdicts.named_scans import held_scan, laid_scan
from jaxmm.verdicts.placement import OF_CLOUDS, FitLimits, Passed, correction_of, place
from jaxmm.verdicts.priors import prior_of_building
from jaxmm.verdicts.settings import DetectSettings
from tests.cases.box_building import building_of, scan_of, shell_of
from warp_scanner.sensors.sensors import OAK_D_PRO_SMALL, sensor_named

EYE = np.array([0.0, 0.0, 1.4])  # [m] of a sensor before walls of points


def room(scenario="wall_removed", number=5):
    """A room's prior and a true scan of it. In room 5 of this seed, the wall that is gone hid another one behind it."""
    (case,) = room_cases(scenario, "occluded", 21, range(number, number + 1))
    return case.prior, case.scan


def moved(scan, shift, degrees):
    turn = Rotation.from_euler("z", degrees, degrees=True).as_matrix()
    points = (scan.points - scan.position) @ turn.T + scan.position + shift
    return scan._replace(
        points=points.astype(np.float32), position=scan.position + shift, rotation=turn @ scan.rotation
    )


def placed(prior, scan, **options):
    """As `detect` asks it, but where a test says otherwise."""
    rays = rays_of_scan(scan)
    options = {"passed": lambda: passed_by(prior.scene, rays)} | options
    return place(scan, surfaces_along(prior.scene, rays), **options)


@pytest.mark.parametrize("number", [0, 3, 5, 8])
def test_a_scan_that_is_off_comes_back_and_one_that_is_not_stays(number):
    """Room 5 is the one where registering to what is in sight alone would move the scan by 0.4 m."""
    prior, scan = room(number=number)
    assert placed(prior, scan).shift < 0.02
    found = placed(prior, moved(scan, np.array([0.06, -0.05, 0.0]), 1.0))
    np.testing.assert_allclose(found.scan.position, scan.position, atol=0.03)
    assert found.turn == pytest.approx(1.0, abs=0.3) and found.overlap >= found.overlap_before
    np.testing.assert_allclose(found.scan.rotation, scan.rotation, atol=0.01)


@pytest.mark.parametrize("off", [-0.15, -0.05, 0.05, 0.15])
def test_a_floor_that_few_rings_cross_holds_the_height_of_a_spinning_scanner(off):
    """From 0.05 m too high its rings meet the floor 0.2 m farther on than they did: where no other ring is near."""
    boxes, place_of = shell_of(6.0, 5.0, 6.0), np.array([1.0, 0.5, 0.9])  # [m]; the ceiling is out of view
    prior, scan = prior_of_building(building_of(boxes)), scan_of(boxes, place_of, sensor_named("velodyne-16")).scan
    found = placed(prior, moved(scan, np.array([0.02, 0.01, off]), 0.5))
    assert abs(found.scan.position[2] - place_of[2]) < 0.01 and not found.open


@pytest.mark.parametrize("degrees", [0.0, 3.0])
@pytest.mark.parametrize("off", [0.0, 0.2])
def test_a_pose_that_was_far_off_is_said_to_be_put_right(off, degrees):
    prior, scan = room(number=0)
    found = placed(prior, moved(scan, np.array([off, 0.0, 0.0]), degrees))
    words = f"its pose was off by {found.shift:.2f} m and {found.turn:.1f} degrees: put right"
    assert found.shift == pytest.approx(off, abs=0.03) and found.turn == pytest.approx(degrees, abs=0.3)
    assert not found.notes
    for source in ("given", "file"):
        assert correction_of(found, source) == ((words,) if off or degrees else ())
    for source in ("estimated", "searched"):
        assert correction_of(found, source) == ()
    doubted = correction_of(found._replace(notes=("is it of this place?",)), "given")
    assert len(doubted) == bool(off or degrees) and not any("right" in line for line in doubted)


def test_poses_are_believed_when_asked_to():
    prior, scan = room(number=0)
    off = moved(scan, np.array([0.05, 0.0, 0.0]), 0.5)
    found = placed(prior, off, refine=False)
    assert found.shift == found.turn == 0.0
    np.testing.assert_array_equal(found.scan.points, off.points)
    fitted = placed(prior, off)
    assert found.residual > 2 * fitted.residual and found.overlap == fitted.overlap_before  # told of where it lies


def test_a_scan_that_fits_nowhere_is_refused_with_the_number():
    prior, scan = room(number=0)
    rng = np.random.default_rng(1)
    nonsense = scan._replace(points=(scan.position + rng.normal(size=(8000, 3)) * [2, 2, 0.5]).astype(np.float32))
    with pytest.raises(InputError, match=r"does not fit the prior from there: \d+\.\d% of its points match") as told:
        placed(prior, nonsense, limits=FitLimits(least_overlap=0.4))
    assert "\n" not in str(told.value)


@pytest.mark.long
def test_a_scan_of_another_building_whose_floor_and_ceiling_fit_is_refused():
    """Two rooms of one height: the scan of one, put where the other's was taken from."""
    prior, scan = room(number=0)
    refused = 0
    for number in (1, 2, 3, 5, 6, 7):
        other, of_other = room(number=number)
        lower = scan.points[:, 2].min() - of_other.points[:, 2].min()
        by = np.array([*(of_other.position - scan.position)[:2], -lower])
        strange = scan._replace(points=(scan.points + by).astype(np.float32), position=scan.position + by)
        try:
            placed(other, strange)
        except InputError as error:
            refused += 1
            assert "does not fit the prior" in str(error) and "\n" not in str(error)
    assert refused >= 4  # by chance, walls of one room may lie on walls of another
    assert placed(prior, scan, limits=FitLimits(least_upright=0.3)).overlap > 0.4
    told = r"\d+\.\d% of what it sees of walls lies on walls, the rest on floor and ceiling; expected at least 101\.0%"
    with pytest.raises(InputError, match=told + "; is it of this building"):
        placed(prior, scan, limits=FitLimits(least_upright=1.01, least_closely=1.0))
    told += r", or more than 99\.9% beyond what may match by chance \(it has \d+\.\d%\); is it of this building"
    with pytest.raises(InputError, match=told):
        placed(prior, scan, limits=FitLimits(least_upright=1.01, least_closely=0.999))


@pytest.mark.parametrize("scenario, number", [("walls_added", 17), ("all_four", 13)])
def test_a_scan_that_sees_little_of_the_walls_but_that_closely_is_believed(scenario, number):
    """Most of what stands is new, or furniture: too little of it lies on walls, were it not upon them."""
    (case,) = room_cases(scenario, "clean", 27, range(number, number + 1))
    found = placed(case.prior, case.scan)
    assert found.shift < 0.01 and found.residual < 0.01
    assert any("of what it sees of walls lies on walls: is it of this place?" in note for note in found.notes)
    with pytest.raises(InputError, match="of what it sees of walls lies on walls, the rest"):
        placed(case.prior, case.scan, limits=FitLimits(least_closely=1.0), passed=None)


@pytest.mark.parametrize("off, noise", [(0.06, 0.0), (0.06, 0.02), (0.0, 0.08)])
def test_walls_that_are_built_a_little_off_and_ranges_that_err_do_not_refuse_a_scan(off, noise):
    """A bare room of 6 by 5 m, walls all around; nothing of those that are off lies closely."""
    rng = np.random.default_rng(5)

    def room_of(shrunk, count):
        face, along, height = rng.integers(6, size=count), rng.uniform(-1, 1, count), rng.uniform(0.0, 2.3, count)
        x, y = 3.0 - shrunk, 2.5 - shrunk
        across = rng.uniform(-1, 1, count)
        walls = [(x, y * along), (-x, y * along), (x * along, y), (x * along, -y)]
        points = np.empty((count, 3))
        for number, (at_x, at_y) in enumerate((*walls, *2 * [(x * along, y * across)])):
            mine = face == number
            points[mine] = np.column_stack(np.broadcast_arrays(at_x, at_y, height))[mine]
        points[face == 4, 2], points[face == 5, 2] = 0.0, 2.3
        return points

    sensor = np.array([0.3, -0.2, 1.4])
    points = room_of(off, 30_000) - sensor
    points *= 1.0 + rng.normal(0.0, noise, (len(points), 1)) / np.linalg.norm(points, axis=1, keepdims=True)
    scan = PosedScan((points + sensor).astype(np.float32), sensor, np.eye(3), None)
    prior = room_of(0.0, 60_000).astype(np.float32)
    assert not off or register(scan.points, prior, sensor).closely == 0.0
    found = place(scan, prior)
    assert found.shift < 0.05 and not found.notes


@pytest.mark.long
def test_a_scan_of_another_room_is_refused_by_a_cloud_too():
    """Each room's own scan fits its cloud; those of others, put where it was taken from, do not, but for a chance.

    In room 5 the scan looks past the wall that is gone, to one that no cloud shows.
    """
    cases = list(room_cases("wall_removed", "occluded", 21, range(6)))
    refused = 0
    for case, other in zip(cases, cases[1:] + cases[:1], strict=True):
        cloud = as_cloud(case).cloud

        def lies_on(scan, cloud=cloud):
            return place(scan, visible(cloud, rays_of_scan(scan)), limits=OF_CLOUDS, in_sight_only=True)

        assert lies_on(case.scan).shift < 0.05 and not lies_on(case.scan).notes
        turn = case.scan.rotation @ other.scan.rotation.T
        points = ((other.scan.points - other.scan.position) @ turn.T + case.scan.position).astype(np.float32)
        try:
            lies_on(case.scan._replace(points=points))
        except InputError as error:
            refused += 1
            assert "does not fit the prior" in str(error) or "nothing in view" in str(error)
    assert refused >= 5


def test_where_a_prior_could_show_hardly_any_of_the_walls_that_is_said_and_nothing_is_asked_of_them():
    """Of a prior that is floor and a strip of a wall."""
    (case,) = room_cases("unchanged", "clean", 21, range(1))
    scan, cloud = case.scan, as_cloud(case).cloud
    seen = visible(cloud, rays_of_scan(scan))
    ahead = (seen - scan.position) @ scan.rotation[:, 1]
    little = seen[(seen[:, 2] < seen[:, 2].min() + 0.05) | (np.abs(ahead) < 0.15)]
    kept = place(scan, little, limits=dataclasses.replace(OF_CLOUDS, least_upright=1.01), in_sight_only=True)
    assert len(kept.notes) == 1 and "could show only" in kept.notes[0]
    assert not place(scan, seen, limits=OF_CLOUDS, in_sight_only=True).notes


def test_a_scan_of_which_few_walls_fit_is_asked_about():
    """Two walls of a room are moved by 1.5 m in its prior, so that what fits is floor, ceiling and hardly any wall."""
    prior, scan = room(number=0)
    before = placed(prior, scan)
    assert not before.notes
    prior = surfaces_along(prior.scene, rays_of_scan(scan))
    low, high = np.percentile(prior[:, 2], [1, 99])
    wall = (prior[:, 2] > low + 0.1) & (prior[:, 2] < high - 0.1)
    ahead = (prior - scan.position) @ scan.rotation[:, 1]
    kept = prior[~wall | (np.abs(ahead) < 0.3)]
    found = place(scan, kept, limits=FitLimits(least_upright=0.0))
    assert len(found.notes) == 1 and found.notes[0].startswith("only ") and "is it of this place?" in found.notes[0]


def test_a_view_that_is_all_new_is_believed_where_nothing_contradicts_it():
    """One wall right before the camera: of the room it sees nothing, or a strip of the floor."""
    (case,) = room_cases("unchanged", "clean", 21, range(1, 2))
    prior, scan = case.prior, case.scan
    direction = (scan.points - scan.position) / np.linalg.norm(scan.points - scan.position, axis=1, keepdims=True)
    upright = scan.rotation[:, 0] * [1.0, 1.0, 0.0] / np.linalg.norm(scan.rotation[:2, 0])

    def wall_at(depth, kept=slice(0, 0)):
        points = scan.position + direction * (depth / (direction @ upright))[:, None]
        return scan._replace(points=np.concatenate([points, scan.points[kept]]).astype(np.float32))

    near = 0.9
    assert np.all(near / (direction @ upright) < np.linalg.norm(scan.points - scan.position, axis=1))
    lowest = np.flatnonzero(scan.points[:, 2] < scan.points[:, 2].min() + 0.02)[:40]
    for view, least, most in ((wall_at(near), 0.0, 0.0), (wall_at(near, lowest), 0.01, 0.15)):  # once thinned
        found = placed(prior, view)
        assert found.shift == found.turn == 0.0 and found.overlap == found.overlap_before
        np.testing.assert_array_equal(found.scan.points, view.points)
        assert len(found.notes) == 1 and "taken for new; is it of this place?" in found.notes[0]
        assert least <= found.overlap <= most
    rng = np.random.default_rng(0)
    blob = scan._replace(points=(scan.position + direction * rng.uniform(0.2, 0.8, (len(direction), 1))).astype("f4"))
    few = wall_at(near)._replace(points=wall_at(near).points[::20_000])
    for strange, asked in (
        (wall_at(9.0), {}), (blob, {}), (few, {}), (wall_at(near), {"passed": None}),
        (wall_at(near), {"passed": lambda: Passed(0.0, 0.9)}), (wall_at(near), {"passed": lambda: Passed(0.01, 0.0)}),
    ):  # fmt: skip
        with pytest.raises(InputError, match="does not fit the prior"):
            placed(prior, strange, **asked)


def lone_walls():
    """An old wall 1.5 m before the sensor, and a part of it that fills the view, as points (N, 3)."""
    y, z = np.meshgrid(np.arange(-3.0, 3.0, 0.03), np.arange(0.0, 3.0, 0.03))
    old = np.column_stack([np.full(y.size, 1.5), y.ravel(), z.ravel()]).astype(np.float32)
    return old, old[(np.abs(old[:, 1]) < 0.6) & (np.abs(old[:, 2] - 1.4) < 0.4)]


def at_sensor(points, by=0.0):
    return PosedScan(np.float32(points), EYE + by, np.eye(3), None)


def test_a_wall_that_fills_the_view_moves_no_scan_onto_an_old_one():
    """It lies on the old one 0.7 m behind, once moved there, so either may be meant, and that is said."""
    old, part = lone_walls()
    new = at_sensor(part - [0.7, 0.0, 0.0])
    stays = place(new, old)
    assert stays.shift < 0.02 and stays.overlap == stays.overlap_before == 0.0 and np.isnan(stays.residual)
    assert len(stays.notes) == 1 and stays.notes[0].startswith("moved by 0.70 m along x, one more surface")
    assert not place(new, old, refine=False).notes
    turned = place(moved(new, np.zeros(3), 2.0), old)
    assert turned.shift < 0.02 and "turned by 2°, one more surface" in turned.notes[0]
    little = place(at_sensor(part - [0.04, 0.0, 0.0]), old)
    assert little.shift < 0.1 and not little.notes


def test_a_wall_that_moved_back_moves_no_scan_onto_its_old_place():
    old, part = lone_walls()
    found = place(at_sensor(part + np.array([0.5, 0.0, 0.0])), old)
    assert found.shift < 0.02 and found.notes[0].startswith("moved by 0.50 m along x")


def test_beside_a_new_wall_floor_and_ceiling_still_tell_the_height():
    old, _ = lone_walls()
    x, y = np.meshgrid(np.arange(0.5, 1.5, 0.03), np.arange(-0.6, 0.6, 0.03))
    levels = [np.column_stack([x.ravel(), y.ravel(), np.full(x.size, z)]) for z in (0.0, 3.0)]
    wall = old[np.abs(old[:, 1]) < 0.6]
    scan = np.concatenate([wall - [0.5, 0.0, 0.0], *(level[level[:, 0] < 1.0] for level in levels)])
    found = place(at_sensor(scan - [0.0, 0.0, 0.12]), np.concatenate([old, *levels]))
    np.testing.assert_allclose(found.scan.position, [0.0, 0.0, 1.4 + 0.12], atol=0.03)
    assert "is held for new" in found.notes[-1] and found.residual < 0.02


def test_two_walls_that_match_move_a_scan_without_a_turn_too():
    """As where a survey's frame is off: one wall before and one beside, or two behind each other through a gap."""
    y, z = np.meshgrid(np.arange(-2.0, 2.0, 0.03), np.arange(0.0, 3.0, 0.03))
    front = np.column_stack([np.full(y.size, 2.0), y.ravel(), z.ravel()])
    beside = np.column_stack([y.ravel(), np.full(y.size, 2.0), z.ravel()])
    behind = front[np.abs(front[:, 1]) < 0.7] + [1.0, 0.0, 0.0]
    ajar = np.concatenate([front[np.abs(front[:, 1]) > 0.7], behind])
    for walls, by in ((np.concatenate([front, beside]), [0.3, 0.3, 0.0]), (ajar, [0.42, 0.0, 0.0])):
        off = PosedScan((walls - by).astype(np.float32), np.array([0.0, 0.0, 1.4]), np.eye(3), None)
        found = place(off, walls)
        assert found.shift == pytest.approx(0.42, abs=0.05), found
        assert found.overlap > 0.95 and "left where" not in str(found.notes), found


def test_where_one_wall_alone_tells_how_far_off_a_pose_is_along_a_direction_that_is_said():
    """Whatever else tells how far off it is along others: a new wall 0.4 m before the old one draws it by 0.2 m."""
    one, other = (each.ravel() for each in np.meshgrid(np.arange(-1.5, 1.5, 0.03), np.arange(-1.2, 1.2, 0.03)))
    ends = [np.column_stack([np.full(one.size, x), one, other + 1.5]) for x in (-2.0, 2.0)]
    levels = [np.column_stack([one, other, np.full(one.size, height)]) for height in (0.0, 3.0)]
    shell, old = np.concatenate([*ends, *levels]), np.column_stack([one, np.full(one.size, 2.0), other + 1.5])
    prior, by = np.concatenate([shell, old]), np.array([0.15, 0.2, 0.08])
    for beside, told in ((old - [0.0, 0.4, 0.0], 0.4), (old, 0.0)):  # for all that it sees, that may be a new one, too
        found = place(at_sensor(np.concatenate([shell, beside]) + by, by), prior)
        np.testing.assert_allclose(found.scan.position, (0.0, told, 1.4), atol=0.02)
        assert "little more than one surface tells that its pose was off by 0.20 m along 90°" in found.notes[0]


def test_a_scan_that_others_hold_where_the_model_shows_nothing_is_refused_by_its_name():
    shell = shell_of(4.0, 3.0, 3.0)
    prior = prior_of_building(building_of(shell))
    one = scan_of(shell, np.array([0.5, 0.3, 1.5]), OAK_D_PRO_SMALL)._replace(file="north.e57")
    laid, away = laid_scan(prior, one, DetectSettings()), np.eye(4)
    away[2, 3] = 500.0
    assert held_scan(prior, one, laid, None) is laid[0]
    assert held_scan(prior, one, laid, Held(np.eye(4), 2, 100)).held
    with pytest.raises(Misfit, match=r"^north\.e57: the prior has nothing in view"):
        held_scan(prior, one, laid, Held(away, 2, 100))
    with pytest.raises(Misfit, match=r"^north\.e57: it fits nowhere$"):
        held_scan(prior, one, (laid[0], "north.e57: it fits nowhere"), None)
