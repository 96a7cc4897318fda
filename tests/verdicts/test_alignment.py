"""Scans and priors come to lie on each other, whatever frame, unit, axis or map grid their files are in."""

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from jaxmm.formats.poses import GivenPose
from jaxmm.formats.readers import PointScan
from jaxmm.formats.units import TALLEST, UNITS, fit_of
from jaxmm.inputs import InputError
from jaxmm.verdicts.alignment import fitting_prior, lay
from jaxmm.verdicts.priors import distance_from, prior_of_cloud, read_prior
from jaxmm.verdicts.scan_frames import own_scan
from warp_scanner.scenes.building import ReadOptions, bounds

ROOM = np.array([10.0, 8.0, 3.0])
GIVEN = GivenPose(np.array([1.5, -2.0, 0.2]), 40.0, -15.0)  # where the sensor stands
WRONG = GivenPose(np.array([70.0, 9.0, -4.0]), -110.0, 5.0)
Z_UP_TO_Y_UP = trimesh.transformations.rotation_matrix(-np.pi / 2, [1, 0, 0])


@pytest.fixture(scope="module")
def room():
    """A room about its origin: its surface, and points (N, 3) that a scan of it has."""
    mesh = trimesh.creation.box(ROOM)
    points = mesh.sample(6000, seed=3) + np.random.default_rng(0).normal(0, 0.004, (6000, 3))
    return mesh, points


def plain(points):
    return PointScan(points, None, None, ())


def seen_from(points, pose):
    """Points (N, 3) of the world in the frame of a sensor."""
    return (points - pose.position) @ pose.rotation


def filed(points, pose, unit=1.0, *, in_world, moved=True):
    """A scan file of points in the sensor's frame [m] that says a pose; `moved`: the points are in the world by it."""
    there = points @ pose.rotation.T + pose.position if moved else points
    return PointScan(there / unit, pose.position / unit, pose.rotation, (), in_world)


SCANS = {
    "sensor's points and a given pose": lambda own, unit: (plain(own / unit), GIVEN, "sensor"),
    "E57": lambda own, unit: (filed(own, GIVEN, unit, in_world=True), None, "world"),
    "E57 whose points are in the sensor's frame": lambda own, unit: (
        filed(own, GIVEN, unit, in_world=True), None, "sensor"
    ),
    "E57 with a wrong pose, and the right one": lambda own, unit: (
        filed(own, WRONG, unit, in_world=True), GIVEN, "sensor"
    ),
    "PCD in the world": lambda own, unit: (filed(own, GIVEN, unit, in_world=False), None, "world"),
    "PCD in the sensor's frame": lambda own, unit: (
        filed(own, GIVEN, unit, in_world=False, moved=False), None, "sensor"
    ),
    "PCD in the sensor's frame with a wrong pose": lambda own, unit: (
        filed(own, WRONG, unit, in_world=False, moved=False), GIVEN, "sensor"
    ),
    "PCD in the world with a wrong pose": lambda own, unit: (
        PointScan(
            filed(own, GIVEN, unit, in_world=False).points, WRONG.position / unit, WRONG.rotation, ()
        ), GIVEN, "world"
    ),
}  # fmt: skip


@pytest.mark.parametrize("told", [True, False], ids=["unit told", "unit found"])
@pytest.mark.parametrize("unit", [1.0, 0.001, 0.3048])
@pytest.mark.parametrize("kind", SCANS)
def test_points_are_moved_once_and_to_where_they_were_measured(room, kind, unit, told):
    points = room[1]
    scan, given, frame = SCANS[kind](seen_from(points, GIVEN), unit)
    laid = lay(prior_of_cloud(points), own_scan(scan, given, frame), unit if told else None)
    np.testing.assert_allclose(laid.points, points, atol=1e-9)
    position, rotation = laid.pose
    np.testing.assert_allclose(position, GIVEN.position, atol=1e-9)
    np.testing.assert_allclose(rotation, GIVEN.rotation, atol=1e-12)
    assert laid.source == ("file" if given is None else "given")
    notes = tuple(note for note in laid.notes if "the one in its file" not in note)
    assert notes == (() if told or unit == 1.0 else (f"it fits the prior in {UNITS[unit]}, and was read so",))


@pytest.mark.parametrize("in_world", [False, True])
@pytest.mark.parametrize("unit", [1.0, 1000.0])
def test_a_given_pose_far_from_the_one_in_the_file_is_told(room, unit, in_world):
    """It is in doubt where the file's pose took the points to where they are, and not where it is a mere remark."""
    scan = PointScan(room[1] * unit, GIVEN.position * unit, GIVEN.rotation, (), in_world)
    near, far = (GIVEN._replace(position=GIVEN.position + np.array([by, 0.0, 0.0])) for by in (0.3, 4.5))
    for given, said in ((None, False), (GIVEN, False), (near, False), (far, True)):
        laid = lay(prior_of_cloud(room[1]), own_scan(scan, given, "world"), None)
        told, silent = (laid.doubts, laid.notes) if in_world else (laid.notes, laid.doubts)
        assert ("its pose as given is 4.5 m from the one in its file" in told) == said
        assert not any("in its file" in note for note in silent)
        a_little = "the file's own pose is 0.30 m from the given one" in laid.notes
        assert a_little == (given is near) and not (a_little and laid.doubts)
    laid = lay(prior_of_cloud(room[1]), own_scan(plain(room[1]), far, "world"), None)
    assert not laid.notes and not laid.doubts


def test_the_sensors_frame_needs_a_pose(room):
    with pytest.raises(InputError, match="sensor's frame need a pose"):
        own_scan(plain(room[1]), None, "sensor")


def test_a_scan_that_lies_nowhere_is_refused_in_one_line(room):
    scan = own_scan(plain(room[1] + [0, 0, 60]), None, "world")
    with pytest.raises(InputError, match=r"expected a scan of the prior's place, got 0\.0%.*--frame.*--unit") as told:
        lay(prior_of_cloud(room[1]), scan, None)
    assert "\n" not in str(told.value)
    laid = lay(prior_of_cloud(room[1]), scan, 1.0)  # whose unit is known is believed, like its pose
    np.testing.assert_array_equal(laid.points, scan.points)


@pytest.mark.parametrize("kind", ["georeferenced", "ifc", "mesh"])
def test_a_scan_on_another_grid_is_told_how_far_it_is(room, tmp_path, kind):
    room[0].export(tmp_path / "room.stl")
    prior, to_map = read_prior(tmp_path / "room.stl"), np.eye(4)
    to_map[:3, 3] = 900_000.0
    if kind != "mesh":
        prior = prior._replace(file=prior.file._replace(kind="ifc"))
    if kind == "georeferenced":
        prior = prior._replace(building=prior.building._replace(to_map=to_map))
    scan = own_scan(plain(room[1] + [155_000.0, 463_000.0, 0.0]), None, "world")
    with pytest.raises(InputError, match=r"it is 463 km away, as on a map grid: bring both") as told:
        lay(prior, scan, None)
    assert ("has no IfcMapConversion" in str(told.value)) == (kind == "ifc") and "\n" not in str(told.value)
    assert ("IfcMapConversion" in str(told.value)) == (kind != "mesh")
    assert ("IfcMapConversion leads to 900000.00, 900000.00, 900000.00 m" in str(told.value)) == (
        kind == "georeferenced"
    )


def test_what_is_as_high_as_a_hill_may_be_on_a_map_too(room):
    hill = plain(room[1] * 30.0 + [155_000.0, 463_000.0, 0.0])
    with pytest.raises(InputError, match=r"it is 46\d km away, as on a map grid.* it is \d\d m high: check its unit"):
        lay(prior_of_cloud(room[1]), own_scan(hill, None, "world"), None)
    millimetres = plain(room[1] * 1000.0 + [9_000.0, 0.0, 60_000.0])
    with pytest.raises(InputError, match=r"check that both are in one frame"):
        lay(prior_of_cloud(room[1]), own_scan(millimetres, None, "world"), None)


def test_how_far_a_scan_is_counts_from_where_its_pose_takes_it(room):
    """Points of a sensor's frame are near zero, wherever it stood; millimetres are far from it, and no map."""
    grid = np.array([155_000.0, 463_000.0, 0.0])
    there = GIVEN._replace(position=GIVEN.position + grid + [0.0, 60.0, 0.0])
    carried = own_scan(plain(seen_from(room[1], GIVEN)), there, "sensor")
    in_millimetres = own_scan(plain(room[1] * 1000.0 + 9e4), None, "world")
    for origin, scan in ((grid, carried), (np.zeros(3), in_millimetres)):
        with pytest.raises(InputError, match=r"check that both are in one frame"):
            lay(prior_of_cloud(room[1] + origin), scan, None)


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("unit", [1.0, 0.001])
@pytest.mark.parametrize("posed", ["by the file", "on the map", "in the building", "not"])
def test_scans_on_a_map_grid_come_back_to_the_building(room, tmp_path, seed, unit, posed):
    rng, points = np.random.default_rng(seed), room[1]
    room[0].export(tmp_path / "room.stl")
    prior = read_prior(tmp_path / "room.stl")
    turn = Rotation.from_euler("z", rng.uniform(-180, 180), degrees=True).as_matrix()
    to_map = np.eye(4)
    to_map[:3, :3], to_map[:3, 3] = turn * rng.uniform(0.9996, 1.0004), [155_000.3, 463_000.7, rng.uniform(-5, 400)]
    prior = prior._replace(building=prior.building._replace(to_map=to_map))

    def on_map(some):
        return some @ to_map[:3, :3].T + to_map[:3, 3]

    given = {"in the building": GIVEN, "on the map": GIVEN._replace(position=on_map(GIVEN.position))}.get(posed)
    if posed == "on the map":
        given = given._replace(yaw=GIVEN.yaw + np.degrees(np.arctan2(turn[1, 0], turn[0, 0])))
    scan = plain(on_map(points) / unit)
    if posed == "by the file":
        scan = scan._replace(position=on_map(GIVEN.position) / unit, rotation=turn @ GIVEN.rotation)
    laid = lay(prior, own_scan(scan, given, "world"), None)
    np.testing.assert_allclose(laid.points, points, atol=1e-8)
    assert "IfcMapConversion" in laid.notes[-1] and len(laid.notes) == 1 + (unit != 1.0)
    if posed == "not":
        assert laid.pose is None
        return
    np.testing.assert_allclose(laid.pose[0], GIVEN.position, atol=1e-8)
    np.testing.assert_allclose(laid.pose[1], GIVEN.rotation, atol=1e-8)


def test_a_scan_in_the_building_stays_there_whatever_map_there_is(room, tmp_path):
    room[0].export(tmp_path / "room.stl")
    prior = read_prior(tmp_path / "room.stl")
    to_map = np.eye(4)
    to_map[:3, 3] = 4.0
    prior = prior._replace(building=prior.building._replace(to_map=to_map))
    laid = lay(prior, own_scan(plain(room[1]), GIVEN, "world"), None)
    np.testing.assert_array_equal(laid.points, room[1])
    assert laid.notes == ()


def fitted(path, points, options=None, unit=None):
    scans = [own_scan(plain(some), None, "world") for some in points]
    return fitting_prior(path, options or ReadOptions(), scans, unit)


def size_of(prior):
    low, high = bounds(prior.building.triangles)
    return high - low


def with_ground(points, share=0.4):
    """The scan with flat ground around the room, so that `share` of it is of the room."""
    rng = np.random.default_rng(1)
    turn, reach = rng.uniform(0, 2 * np.pi, 40000), rng.uniform(7, 60, 40000)
    ground = np.column_stack([reach * np.cos(turn), reach * np.sin(turn), np.full(40000, -1.5)])
    return rng.permutation(np.concatenate([points, ground[: round(len(points) * (1 - share) / share)]]))


@pytest.mark.parametrize("ending", [".obj", ".stl", ".ply", ".glb"])
@pytest.mark.parametrize("around", [False, True], ids=["indoors", "with ground"])
@pytest.mark.parametrize("usual", [True, False])
def test_a_mesh_stands_upright_whichever_axis_it_has(room, tmp_path, ending, around, usual):
    """About its origin, a room on its side comes near all of a scan of it, and even lies on a third."""
    mesh, points = room
    points = with_ground(points) if around else points
    other = "z" if ending == ".glb" else "y"
    mesh = mesh.copy()
    if (ending == ".glb") == usual:
        mesh.apply_transform(Z_UP_TO_Y_UP)
    mesh.export(tmp_path / f"room{ending}")
    prior = fitted(tmp_path / f"room{ending}", [points])
    np.testing.assert_allclose(size_of(prior), ROOM, atol=1e-4)
    assert [f"{other} up" in note for note in prior.notes if "--up" in note] == ([] if usual else [True])
    told = ReadOptions(y_up=(other == "y") == usual)  # who says an axis has it
    assert not np.allclose(size_of(fitted(tmp_path / f"room{ending}", [points], told)), ROOM, atol=1.0)


def test_a_room_that_is_nearly_as_high_as_wide_is_told_too(tmp_path):
    """On its side, it comes near all of a scan of it."""
    mesh = trimesh.creation.box([10, 3.9, 3])
    points = mesh.sample(6000, seed=4)
    mesh.apply_transform(Z_UP_TO_Y_UP).export(tmp_path / "room.obj")
    lying = read_prior(tmp_path / "room.obj")
    assert fit_of(points, distance_from(lying)).share == 1.0
    np.testing.assert_allclose(size_of(fitted(tmp_path / "room.obj", [points])), [10, 3.9, 3], atol=1e-4)


def test_the_axis_stays_where_another_fits_hardly_better(room, tmp_path):
    """Ends that lie in the same place either way, a few points on the room on its side only, and some on neither."""
    mesh, points = room
    mesh.export(tmp_path / "room.obj")
    ends = points[(np.abs(points[:, 0]) > 4.95) & (np.abs(points[:, 1:]) < 1.4).all(axis=1)]
    some = np.concatenate([ends, ends[::8] * [0, 1, 0] + [0, 0, 4], ends[::3] * 9.0])
    lying = read_prior(tmp_path / "room.obj", ReadOptions(y_up=True))
    shares = [fit_of(some, distance_from(one)).on for one in (read_prior(tmp_path / "room.obj"), lying)]
    assert shares == pytest.approx([0.69, 0.77], abs=0.02)
    np.testing.assert_allclose(size_of(fitted(tmp_path / "room.obj", [some])), ROOM, atol=1e-4)


def test_all_scans_have_a_say_in_the_axis(room, tmp_path):
    """What the first one sees lies in the same place whichever axis is up."""
    mesh, points = room
    mesh.copy().apply_transform(Z_UP_TO_Y_UP).export(tmp_path / "room.obj")
    ends = points[(np.abs(points[:, 0]) > 4.95) & (np.abs(points[:, 1]) < 1.4) & (np.abs(points[:, 2]) < 1.4)]
    np.testing.assert_allclose(size_of(fitted(tmp_path / "room.obj", [ends])), ROOM[[0, 2, 1]], atol=1e-4)
    np.testing.assert_allclose(size_of(fitted(tmp_path / "room.obj", [ends, points])), ROOM, atol=1e-4)


@pytest.mark.parametrize("factor", UNITS)
@pytest.mark.parametrize("corner", [(0, 0, 0), (5, 4, 1.5), (900, 700, 10)])
@pytest.mark.parametrize("upright", [True, False])
def test_a_mesh_in_another_unit_is_told_by_scans_in_metres(room, tmp_path, factor, corner, upright):
    mesh, points = room
    mesh = mesh.copy().apply_translation(corner).apply_scale(1 / factor)
    if not upright:
        mesh.apply_transform(Z_UP_TO_Y_UP)
    mesh.export(tmp_path / "room.obj")
    prior = fitted(tmp_path / "room.obj", [points + corner])
    np.testing.assert_allclose(size_of(prior), ROOM, atol=1e-2)
    assert prior.file.unit == factor and any(UNITS[factor] in note and "--prior-unit" in note for note in prior.notes)
    assert fitted(tmp_path / "room.obj", [points + corner], ReadOptions(unit=0.5)).file.unit == 0.5  # as told


def test_a_cloud_in_millimetres_is_told_likewise(room, tmp_path):
    np.save(tmp_path / "before.npy", room[1] * 1000.0)
    prior = fitted(tmp_path / "before.npy", [room[1]])
    assert prior.file.unit == 0.001 and "millimetres" in prior.notes[0]


def test_a_cloud_lower_than_the_scan_is_no_prior_of_it_in_any_unit(tmp_path):
    """A pose half a metre off, and most points on what is near: shrunk to feet, the room would be near most of them."""
    rng = np.random.default_rng(0)

    def plate(count, low, high, z):
        return np.column_stack([rng.uniform(low, high, (count, 2)), np.full(count, z)])

    walls = trimesh.creation.box((4.4, 3.2, 2.5)).sample(3000, seed=0)
    points = np.concatenate([walls, plate(5000, -0.25, 0.25, -0.1), plate(1000, (0.3, -0.2), (2.0, 1.5), -0.2)])
    np.save(tmp_path / "room.npy", points.astype(np.float32))
    prior = fitted(tmp_path / "room.npy", [points + np.array([0.34, 0.2, 0.12])], ReadOptions(y_up=False))
    assert prior.file.unit == 1.0 and not prior.notes


def test_a_mesh_and_scans_in_millimetres_are_both_told(room, tmp_path):
    mesh, points = room
    mesh.copy().apply_scale(1000.0).export(tmp_path / "room.obj")
    prior = fitted(tmp_path / "room.obj", [points * 1000.0])
    assert prior.file.unit == 0.001
    laid = lay(prior, own_scan(plain(points * 1000.0), None, "world"), None)
    np.testing.assert_allclose(laid.points, points, atol=1e-9)


@pytest.mark.parametrize("scale", [1.0, *(1 / factor for factor in UNITS)])
def test_a_mesh_in_metres_stays_so_whatever_the_scans_are_in(room, tmp_path, scale):
    room[0].export(tmp_path / "room.obj")
    for points in (room[1], with_ground(room[1]), room[1] + [0.3, 0.2, 0.2], room[1] + [300, 0, 0]):
        prior = fitted(tmp_path / "room.obj", [points * scale])
        assert prior.file.unit == 1.0 and not any("--" in note for note in prior.notes)


@pytest.mark.parametrize("unit", [0.001, 0.01, 0.0254])
def test_a_scan_and_a_whole_mesh_in_the_same_small_unit_are_told_by_their_height(room, tmp_path, unit):
    """An exact scan fits it as it is, as in any other unit; but no room is 3 km high."""
    mesh, points = room[0], room[0].sample(6000, seed=5)
    mesh.copy().apply_transform(trimesh.transformations.scale_and_translate(1 / unit, [900, 0, 0])).export(
        tmp_path / "room.ply"
    )
    moved = points / unit + [900, 0, 0]
    prior = fitted(tmp_path / "room.ply", [moved])
    tall = 3.0 / unit > TALLEST
    assert prior.file.unit == (unit if tall else 1.0)
    laid = lay(prior, own_scan(plain(moved), None, "world"), None)
    assert np.ptp(laid.points[:, 2]) == pytest.approx(3.0 if tall else 3.0 / unit, rel=0.02)


def test_clouds_in_millimetres_that_share_a_fifth_of_their_surface_are_told(room, tmp_path):
    left, right = (room[1][sign * room[1][:, 0] > -1.0] for sign in (-1.0, 1.0))
    right = right[right[:, 0] > -0.4]
    for prior_scale, scan_scale in ((1.0, 1.0), (1.0, 1000.0), (1000.0, 1000.0)):
        np.save(tmp_path / "left.npy", left * prior_scale)
        prior = fitted(tmp_path / "left.npy", [right * scan_scale])
        laid = lay(prior, own_scan(plain(right * scan_scale), None, "world"), None)
        assert prior.file.unit == 1.0 / prior_scale
        np.testing.assert_allclose(laid.points, right, atol=1e-9)
