"""The frame and unit of a cloud that is a prior: as told, as scans fit it, or doubted where it may be of optics."""

import numpy as np
import pytest
import trimesh

from jaxmm import DetectSettings, Reading, detect
from jaxmm.formats.poses import OPTICAL, GivenPose
from jaxmm.formats.readers import PointScan
from jaxmm.inputs import InputError, Misfit
from jaxmm.verdicts.alignment import fitting_prior, lay
from jaxmm.verdicts.priors import prior_of_building, read_prior
from jaxmm.verdicts.scan_frames import own_scan
from tests.cases.box_building import building_of
from tests.verdicts.test_pose_search import COLUMN, INNER, ROOM, SPINNING, seen, turned
from tests.verdicts.test_scan_frames import write_pcd
from warp_scanner.scenes.building import ReadOptions
from warp_scanner.sensors.sensors import OAK_D_PRO_SMALL

PLACE, TURN = np.array([0.3, -0.6, 1.1]), turned(125.0, 4.0, -3.0)
STILL = GivenPose(np.zeros(3), 0.0, 0.0)
UP, PLACE_OF_FLAT = np.array([0.0, 0.0, 9.0]), np.array([9.0, 4.0, 1.2])  # [m]
SETTINGS = DetectSettings(propose_views=False)
Y_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])  # of rows, from z up
MAY_BE_OPTICAL = "prior and scan lie before the z axis, as in an optical frame"


def view(*more, level=False, sensor=OAK_D_PRO_SMALL):
    """Points (N, 3) in the sensor's frame, of a room, its inner walls and more."""
    turn = turned(125.0, 0.0, 0.0) if level else TURN
    return seen(prior_of_building(building_of((*ROOM, *INNER, *more))), PLACE, turn, sensor)


def plain(points):
    return PointScan(points, None, None, ())


def corners(points):
    """(2, 3) [m] lowest and highest."""
    return np.array([points.min(axis=0), points.max(axis=0)])


@pytest.mark.parametrize("axes", [np.eye(3), OPTICAL], ids=["sensor", "optical"])
@pytest.mark.parametrize("y_up", [False, True], ids=["z up", "y up"])
def test_the_pose_in_its_file_moves_a_cloud_of_which_it_is_told(tmp_path, axes, y_up):
    """Into a world of whichever axis."""
    own = view()
    world, to_file = own @ TURN.T + PLACE, Y_UP if y_up else np.eye(3)
    write_pcd(tmp_path / "own.pcd", own @ axes, PLACE @ to_file, to_file.T @ TURN @ axes)
    for frame in ("sensor", "optical"):
        read = read_prior(tmp_path / "own.pcd", ReadOptions(frame=frame, y_up=y_up))
        np.testing.assert_allclose(corners(read.cloud + read.origin), corners(world), atol=0.1)
        assert read.untold is None and not read.optical
    options = ReadOptions(y_up=True if y_up else None)  # told by the scans, it ends where one tells it
    found = fitting_prior(tmp_path / "own.pcd", options, [own_scan(plain(world), None, "world")], None)
    np.testing.assert_allclose(found.cloud, read.cloud, atol=1e-6)
    assert any("own.pcd: its points were taken to be in the sensor's frame" in note for note in found.notes)
    told = fitting_prior(
        tmp_path / "own.pcd", ReadOptions(frame="world"), [own_scan(plain(world), None, "world")], None
    )
    assert not any("frame" in note for note in told.notes)


def test_a_cloud_of_optics_without_a_pose_is_turned_about_its_zero(tmp_path):
    own = view()
    np.save(tmp_path / "kinect.npy", own @ OPTICAL)
    told = read_prior(tmp_path / "kinect.npy", ReadOptions(frame="optical"))
    np.testing.assert_allclose(corners(told.cloud), corners(own), atol=0.1)
    lying = read_prior(tmp_path / "kinect.npy", ReadOptions(frame="world"))
    np.testing.assert_allclose(corners(lying.cloud), corners(own @ OPTICAL), atol=0.1)
    assert not told.optical and not lying.optical  # who tells it has it


@pytest.mark.parametrize("unit", [1.0, 0.001])
def test_scans_tell_that_a_cloud_is_of_optics(tmp_path, unit):
    own = view()
    np.save(tmp_path / "kinect.npy", own @ OPTICAL / unit)
    scan = own_scan(plain(own @ OPTICAL), STILL, "optical")
    found = fitting_prior(tmp_path / "kinect.npy", ReadOptions(), [scan], None)
    np.testing.assert_allclose(corners(found.cloud), corners(own), atol=0.1)
    (note,) = [note for note in found.notes if "frame" in note]
    assert note == (
        "kinect.npy fits the scans in an optical frame (x right, y down, z forward), and was read so; "
        "--prior-frame says its frame"
    )
    assert found.file.unit == unit and not lay(found, scan, None).doubts
    stated = fitting_prior(tmp_path / "kinect.npy", ReadOptions(frame="world", unit=unit), [scan], None)
    with pytest.raises(Misfit, match=r"--frame, --prior-frame"):
        lay(stated, scan._replace(points=scan.points + UP), None)


def test_what_lies_on_its_side_as_a_whole_is_doubted(tmp_path):
    """Prior and scan lie on each other, z forward, and nobody said so."""
    own = view()
    np.save(tmp_path / "kinect.npy", own @ OPTICAL)
    scan = own_scan(plain(own @ OPTICAL), STILL, None)
    laid = lay(fitting_prior(tmp_path / "kinect.npy", ReadOptions(), [scan], None), scan, None)
    (doubt,) = laid.doubts
    assert MAY_BE_OPTICAL in doubt and "--prior-frame optical and --frame optical" in doubt


@pytest.mark.parametrize(
    "points, place",
    [
        pytest.param(lambda: view(), None, id="a camera, z up"),
        pytest.param(lambda: view(sensor=SPINNING), STILL.position, id="a scanner"),
        pytest.param(lambda: view(sensor=SPINNING), np.array([0.0, 0.0, 6.0]), id="a scanner on a storey above zero"),
        pytest.param(lambda: view() @ TURN.T, np.array([0.5, 0.3, 6.0]), id="a camera on a storey above zero"),
        pytest.param(lambda: view(sensor=SPINNING), np.array([0.0, 0.0, 400.0]), id="high above the sea"),
        pytest.param(lambda: view() @ TURN.T, np.array([4.0, 3.0, 0.0]), id="in a building"),
    ],
)
def test_clouds_that_have_z_up_are_not_doubted(tmp_path, points, place):
    points = points() + (0.0 if place is None else place)
    np.save(tmp_path / "room.npy", points)
    scan = own_scan(plain(points), None if place is None else STILL._replace(position=place), None)
    assert not lay(fitting_prior(tmp_path / "room.npy", ReadOptions(), [scan], None), scan, None).doubts


def test_two_views_of_a_camera_are_compared_in_their_optical_frame(tmp_path):
    """A column is new: told where the frames are told, and as it is told of the same clouds with z up."""
    before, now, found = view(level=True), view(*COLUMN, level=True), []
    for name, axes, frame in (("upright", np.eye(3), "sensor"), ("optical", OPTICAL, "optical")):
        for kind, points in (("before", before), ("now", now)):
            np.save(tmp_path / f"{kind} {name}.npy", points @ axes)
        reading = Reading(prior=ReadOptions(frame=frame), frame=frame, sensor=OAK_D_PRO_SMALL)
        paths = [tmp_path / f"{kind} {name}.npy" for kind in ("before", "now")]
        found.append(detect(*paths, STILL, reading=reading, settings=SETTINGS))
    usual, optical = found
    assert [(one.object_type, one.mismatch_type) for one in usual.mismatches] == [("pillar", "added")]
    assert not usual.doubts and not optical.doubts
    (one,), (other,) = usual.mismatches, optical.mismatches
    assert one.object_type == other.object_type
    np.testing.assert_allclose(one.center, other.center, atol=0.03)


@pytest.mark.parametrize("scale", [1000.0, 1000 / 25.4])
def test_a_low_cloud_is_told_in_its_unit_where_it_lies_on_the_scan(tmp_path, scale):
    """Of a flat 2.4 m high nothing is kept but what is below a table; a shrunken one would hang in the air."""
    points = trimesh.creation.box((7.0, 5.0, 2.4)).sample(40_000, seed=2) + PLACE_OF_FLAT
    np.save(tmp_path / "low.npy", points[points[:, 2] < 0.75][:4000] * scale)
    prior = fitting_prior(tmp_path / "low.npy", ReadOptions(), [own_scan(plain(points), None, "world")], None)
    assert prior.file.unit == pytest.approx(1 / scale) and "--prior-unit says its unit" in prior.notes[0]
    far = own_scan(plain(points + UP), None, "world")
    with pytest.raises(InputError, match=r"and their units \(--unit, --prior-unit\)") as told:
        lay(read_prior(tmp_path / "low.npy"), far, None)
    assert "map grid" not in str(told.value)


def test_no_other_frame_is_known():
    with pytest.raises((ValueError, InputError), match="frame must be one of"):
        ReadOptions(frame="camera")


def test_a_file_that_tells_the_frame_of_its_points_is_asked_in_no_other(tmp_path):
    """An NPZ of rays has them in the sensor's frame, with its pose: nothing is turned that was moved by that."""
    own = view().astype(np.float32)
    rays = {"direction": own / np.linalg.norm(own, axis=1, keepdims=True), "distance": np.linalg.norm(own, axis=1)}
    rays |= {"origin": PLACE.astype(np.float32), "rotation": TURN.astype(np.float32)}
    np.savez(tmp_path / "rays.npz", **{name: np.asarray(values, np.float32) for name, values in rays.items()})
    for frame in (None, "world", "sensor"):
        read = read_prior(tmp_path / "rays.npz", ReadOptions(frame=frame))
        np.testing.assert_allclose(corners(read.cloud + read.origin), corners(own @ TURN.T + PLACE), atol=0.1)
    with pytest.raises(
        InputError,
        match=r"rays\.npz: its file tells .*: --prior-frame optical .* --prior-frame sensor$",
    ):
        read_prior(tmp_path / "rays.npz", ReadOptions(frame="optical"))
    lying = own_scan(plain((own @ TURN.T + PLACE) @ OPTICAL.T), None, "world")
    assert not any(
        "optical" in note for note in fitting_prior(tmp_path / "rays.npz", ReadOptions(), [lying], None).notes
    )


def test_what_was_told_of_a_frame_is_not_told_as_found(tmp_path):
    own = view()
    np.save(tmp_path / "kinect.npy", own @ OPTICAL / 0.001)
    scan = own_scan(plain(own), STILL, "sensor")
    found = fitting_prior(tmp_path / "kinect.npy", ReadOptions(frame="optical"), [scan], None)
    np.testing.assert_allclose(corners(found.cloud), corners(own), atol=0.1)
    assert any("fits the scans in millimetres" in note for note in found.notes)
    assert not any("--prior-frame" in note for note in found.notes)


@pytest.mark.parametrize("frame", ["sensor", "optical", "world", None])
def test_a_frame_of_a_sensor_whose_pose_nobody_says_is_remarked(tmp_path, frame):
    own = view()
    np.save(tmp_path / "kinect.npy", own)
    write_pcd(tmp_path / "posed.pcd", own, PLACE, TURN)
    told = [note for note in read_prior(tmp_path / "kinect.npy", ReadOptions(frame=frame)).notes if "no pose" in note]
    assert told == (
        ["kinect.npy says no pose: its sensor was taken to be at zero, level, and to look along x"]
        if frame in ("sensor", "optical")
        else []
    )
    assert not any("no pose" in note for note in read_prior(tmp_path / "posed.pcd", ReadOptions(frame=frame)).notes)


def test_a_wrong_frame_of_a_prior_is_refused_with_the_one_that_fits(tmp_path):
    own = view() + 0.0
    world = own @ TURN.T + [40.0, 25.0, 1.1]
    write_pcd(tmp_path / "prior.pcd", own, np.array([40.0, 25.0, 1.1]), TURN)
    np.save(tmp_path / "scan.npy", world)
    place = GivenPose(np.array([40.0, 25.0, 1.1]), 125.0, 4.0, -3.0)
    with pytest.raises(Misfit, match=r"lie on the prior with --prior-frame sensor$"):
        reading = Reading(ReadOptions(frame="world"))
        detect(tmp_path / "prior.pcd", tmp_path / "scan.npy", place, reading=reading, settings=SETTINGS)
