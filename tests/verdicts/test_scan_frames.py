"""Files that say a pose and not what it is of: told by the prior, by what hides what, or not at all."""

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from jaxmm.formats.poses import OPTICAL, GivenPose
from jaxmm.formats.readers import PointScan
from jaxmm.formats.units import UNITS
from jaxmm.inputs import Misfit
from jaxmm.verdicts.alignment import fitting_prior, lay
from jaxmm.verdicts.priors import prior_of_building, prior_of_cloud, read_prior
from jaxmm.verdicts.scan_frames import by_sight, frame_that_fits, own_scan
from jaxmm.verdicts.searched_scans import searched_scan
from tests.cases.box_building import building_of
from tests.verdicts.test_pose_search import INNER, ROOM, SPINNING, seen, turned
from warp_scanner.scenes.building import ReadOptions
from warp_scanner.scenes.scenes import PILLAR

PLACE, TURN = np.array([0.7, -0.5, 1.2]), turned(35.0, 4.0, -3.0)
MIDDLE = (((0.0, 0.0, 1.4), (0.3, 0.3, 1.4), PILLAR),)


@pytest.fixture(scope="module")
def own():
    """Points (N, 3) in the sensor's frame, of a scanner in a room with two walls in it."""
    return seen(prior_of_building(building_of((*ROOM, *INNER))), PLACE, TURN)


def in_world(own):
    return own @ TURN.T + PLACE


def untold(points, position=PLACE, rotation=TURN):
    return PointScan(points, position, rotation, ())


@pytest.mark.parametrize("unit", [1.0, 0.001, 0.3048])
@pytest.mark.parametrize("given", [None, GivenPose(PLACE, 35.0, -4.0, -3.0)], ids=["by the file", "given"])
@pytest.mark.parametrize("meaning", ["world", "sensor"])
def test_the_prior_tells_what_a_pose_in_a_file_is_of(own, meaning, given, unit):
    """Whatever unit the file is in, its pose is in the same."""
    points = in_world(own) if meaning == "world" else own
    laid = lay(prior_of_cloud(in_world(own)), own_scan(untold(points / unit, PLACE / unit), given, None), None)
    np.testing.assert_allclose(laid.points, in_world(own), atol=1e-9)
    np.testing.assert_allclose(laid.pose[0], PLACE, atol=1e-9)
    np.testing.assert_allclose(laid.pose[1], TURN, atol=1e-9)
    assert f"taken to be in the {meaning}'s frame" in laid.notes[0] and "100% of them lie on the prior" in laid.notes[0]
    assert not laid.doubts and (unit == 1.0 or UNITS[unit] in laid.notes[1])


def test_where_the_prior_does_not_tell_what_hides_what_does(own):
    """A prior that fills the room all over, as of many scans with noise, holds the points wherever they are."""
    grid = np.stack(np.meshgrid(*[np.arange(-9.0, 9.0, 0.15)] * 2, np.arange(-3.0, 5.0, 0.15)), axis=-1).reshape(-1, 3)
    for way, (points, meaning) in enumerate(((in_world(own), "world"), (own, "sensor"))):
        assert by_sight(points, PLACE)[0] == way
        laid = lay(prior_of_cloud(grid), own_scan(untold(points), None, None), 1.0)
        np.testing.assert_allclose(laid.points, in_world(own), atol=1e-9)
        assert f"taken to be in the {meaning}'s frame" in laid.notes[0] and "the prior does not tell" in laid.notes[0]
        assert "others hide" in laid.notes[0] and not laid.doubts


def test_where_nothing_tells_the_points_stay_and_are_doubted():
    """From inside a square room, all is in sight from everywhere, and half a turn takes it onto itself."""
    half = Rotation.from_euler("z", 180, degrees=True).as_matrix()
    points = np.asarray(trimesh.creation.box([6.0, 6.0, 3.0]).sample(3000, seed=1))
    points = np.concatenate([points, points @ half.T])
    laid = lay(prior_of_cloud(points), own_scan(untold(points, np.zeros(3), half), None, None), None)
    np.testing.assert_array_equal(laid.points, points)
    assert len(laid.doubts) == 1 and "nothing tells in which frame its points are" in laid.doubts[0]
    assert "--frame" in laid.doubts[0] and "100%" in laid.doubts[0]
    for frame in ("world", "sensor"):  # who says it, has it
        assert not lay(prior_of_cloud(points), own_scan(untold(points, np.zeros(3), half), None, frame), None).doubts
    slightly = Rotation.from_euler("z", 0.2, degrees=True).as_matrix()
    near = lay(prior_of_cloud(points), own_scan(untold(points, np.zeros(3), slightly), None, None), None)
    assert not near.doubts and "hardly moves them" in near.notes[0]


def test_points_on_the_prior_neither_way_are_refused(own):
    scan = untold(own + np.array([0.0, 0.0, 70.0]))
    with pytest.raises(Misfit, match=r"within 0\.5 m of it, moved there by the pose in its file or not; check"):
        lay(prior_of_cloud(in_world(own)), own_scan(scan, None, None), None)
    with pytest.raises(Misfit, match=r"within 0\.5 m of it; check"):
        lay(prior_of_cloud(in_world(own)), own_scan(scan, None, "world"), None)


@pytest.mark.parametrize("frame", ["world", "sensor"])
@pytest.mark.parametrize("view", ["ahead", "around"])
@pytest.mark.parametrize("turn", [TURN, turned(-140.0, 20.0, 10.0)])
def test_axes_of_optics_are_told_by_what_is_before_them(own, frame, view, turn):
    """x right, y down, z forward; of a scanner, whose elevations are few, y is the upright axis."""
    some = own if view == "around" else own[np.abs(np.arctan2(own[:, 1], own[:, 0])) < 0.7]
    world = some @ turn.T + PLACE
    for axes in (np.eye(3), OPTICAL):
        points = world if frame == "world" else some @ axes
        laid = lay(prior_of_cloud(world), own_scan(untold(points, rotation=turn @ axes), None, None), None)
        np.testing.assert_allclose(laid.points, world, atol=1e-9)
        np.testing.assert_allclose(laid.pose[1], turn, atol=1e-9)


def write_pcd(path, points, position, rotation):
    x, y, z, w = Rotation.from_matrix(rotation).as_quat()
    pose = " ".join(f"{value:.9g}" for value in (*position, w, x, y, z))
    head = f"VERSION .7\nFIELDS x y z\nSIZE 8 8 8\nTYPE F F F\nCOUNT 1 1 1\nWIDTH {len(points)}\nHEIGHT 1\n"
    path.write_bytes(f"{head}VIEWPOINT {pose}\nPOINTS {len(points)}\nDATA binary\n".encode() + points.tobytes())


def test_two_clouds_of_one_sensor_that_stands_still_are_upright(tmp_path):
    """They lie on each other as they are; but seen from the place in their files, most would be hidden."""
    scene = prior_of_building(building_of((*ROOM, *MIDDLE)))
    place, turn = np.array([2.5, 1.7, 1.3]), turned(-150.0, 0.0, 0.0) @ OPTICAL
    points = seen(scene, place, turned(-150.0, 0.0, 0.0)) @ OPTICAL
    write_pcd(tmp_path / "before.pcd", points, place, turn)
    scan = own_scan(untold(points, place, turn), None, None)
    prior = fitting_prior(tmp_path / "before.pcd", ReadOptions(), [scan], None)
    assert any("before.pcd: its points were taken to be in the sensor's frame" in note for note in prior.notes)
    laid = lay(prior, scan, None)
    assert "sensor's frame" in laid.notes[0]
    assert np.ptp(laid.points[:, 2]) < 2.9 < np.ptp(points[:, 2])
    write_pcd(tmp_path / "world.pcd", points @ turn.T + place, place, turn)
    for one in (untold(points, place, turn), untold(points @ turn.T + place, place, turn)):
        prior = fitting_prior(tmp_path / "world.pcd", ReadOptions(), [own_scan(one, None, None)], None)
        assert not any("sensor's frame" in note for note in prior.notes)
        np.testing.assert_allclose(
            lay(prior, own_scan(one, None, None), None).points, points @ turn.T + place, atol=1e-5
        )


def test_it_is_said_that_nothing_tells_of_a_cloud(own, tmp_path):
    """A pose that only turns: the sensor is at zero either way."""
    write_pcd(tmp_path / "before.pcd", own, np.zeros(3), TURN)
    scan = own_scan(untold(own, np.zeros(3)), None, None)
    prior = fitting_prior(tmp_path / "before.pcd", ReadOptions(), [scan], None)
    (note,) = prior.notes
    assert "before.pcd: its points were taken to be in the world's frame: nothing tells" in note
    np.testing.assert_allclose(lay(prior, scan, None).points, own)


def test_clouds_are_read_with_y_up_and_their_poses_with_them(own, tmp_path):
    points, lying = in_world(own), np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    write_pcd(tmp_path / "y.pcd", points @ lying, PLACE @ lying, lying.T @ TURN)
    prior = read_prior(tmp_path / "y.pcd", ReadOptions(y_up=True))
    position, rotation = prior.untold
    np.testing.assert_allclose(position, PLACE, atol=1e-7)
    np.testing.assert_allclose(rotation, TURN, atol=1e-7)
    np.testing.assert_allclose(prior.cloud.max(axis=0), points.max(axis=0), atol=0.1)
    found = fitting_prior(tmp_path / "y.pcd", ReadOptions(), [own_scan(untold(points), None, "world")], None)
    assert any("y.pcd fits the scans with y up" in note for note in found.notes)
    told = fitting_prior(tmp_path / "y.pcd", ReadOptions(y_up=False), [own_scan(untold(points), None, "world")], None)
    assert not any("y up" in note for note in told.notes)


def test_a_search_tries_both_where_nothing_is_hidden():
    """A bare room with a wall in a corner: either way all is in sight, and only one way it is a scan of the room."""
    prior = prior_of_building(building_of((*ROOM, *INNER)))
    position, believed = np.array([0.3, -0.4, 1.1]), (np.array([0.0, 0.0, 30.0]), turned(0.0, 0.0, 50.0))
    scan = PointScan(seen(prior, position, turned(50.0, 0.0, 0.0), SPINNING), *believed, ())
    found = searched_scan(prior, scan, None, None)
    assert any("taken to be in the sensor's frame" in note for note in found.notes)
    np.testing.assert_allclose(found.position, position, atol=0.03)


@pytest.mark.parametrize("to_map", [None, (155_000.0, 463_000.0)], ids=["own frame", "map grid"])
def test_columns_in_which_northings_stand_first_are_told(own, to_map):
    """A mirror image of the scan: no frame and no unit brings it onto the prior."""
    building, shift = building_of((*ROOM, *INNER)), np.zeros(3)
    if to_map is not None:
        shift = np.array([*to_map, 0.0])
        matrix = np.eye(4)
        matrix[:3, 3] = shift
        building = building._replace(to_map=matrix)
    prior, points = prior_of_building(building), in_world(own) + shift
    swapped = PointScan(points[:, [1, 0, 2]], None, None, ())
    for pose in (None, GivenPose(PLACE, 35.0, -4.0, -3.0)):
        told = frame_that_fits(prior, swapped, pose, None, None)
        assert told == "with x and y swapped, as of columns in which northings stand first"
        assert frame_that_fits(prior, swapped._replace(points=points), pose, None, None) == ""


@pytest.mark.parametrize("frame", [None, "world", "sensor", "optical"])
@pytest.mark.parametrize("pose", [None, GivenPose(PLACE, 35.0, -4.0, -3.0)], ids=["by the file", "given"])
@pytest.mark.parametrize("moved", [False, True])
def test_no_copy_of_a_scan_is_held_whatever_frame_it_is_in(own, frame, pose, moved):
    """50 million points take a gigabyte."""
    scan = untold(own)._replace(in_world=moved)
    held = own_scan(scan, pose, frame)
    assert all(one.points is own for one in held.ways())


def test_a_searched_scan_is_no_copy_either():
    prior = prior_of_building(building_of((*ROOM, *INNER)))
    position, turn = np.array([0.3, -0.4, 1.1]), turned(50.0, 0.0, 0.0)
    points = seen(prior, position, turn, SPINNING) @ OPTICAL * 1000.0
    found = searched_scan(prior, PointScan(points, None, None, ()), "optical", None)
    assert found.points is points
    near = found.world(points)
    assert np.abs(near - (points @ OPTICAL.T / 1000.0 @ turn.T + position)).max() < 0.05
