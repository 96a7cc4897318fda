"""One scan in any frame ends in the same verdicts, and whoever states a wrong frame hears of the right one."""

import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jaxmm import DetectSettings, Reading, detect
from jaxmm.formats.poses import OPTICAL, GivenPose, read_poses
from jaxmm.inputs import InputError
from jaxmm.verdicts.priors import prior_of_building
from tests.cases.box_building import building_of, table_of
from tests.verdicts.test_pose_search import COLUMN, INNER, ROOM, SPINNING, seen, turned
from warp_scanner.buildings.room_ifc import write_room
from warp_scanner.scenes.building import ReadOptions
from warp_scanner.sensors.sensors import OAK_D_PRO_SMALL

POSITION, ROTATION = np.array([0.3, -0.6, 1.1]), turned(125.0, 0.0, 0.0)
GIVEN = GivenPose(POSITION, 125.0, 0.0)
Y_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])  # of rows, from z up
SETTINGS = DetectSettings(propose_views=False)
IN_WORLD, IN_SENSOR = "taken to be in the world's frame", "taken to be in the sensor's frame"


def write_pcd(path, points, viewpoint):
    """As PCL has it: VIEWPOINT is a translation, then a quaternion w, x, y, z."""
    words = " ".join(f"{value:.9g}" for value in viewpoint)
    head = f"VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH {len(points)}\nHEIGHT 1\n"
    path.write_bytes(
        f"{head}VIEWPOINT {words}\nPOINTS {len(points)}\nDATA binary\n".encode() + points.astype("<f4").tobytes()
    )


def viewpoint_of(position, rotation):
    x, y, z, w = Rotation.from_matrix(rotation).as_quat()
    return (*position, w, x, y, z)


class Taken:
    """A scan of the room without its column: `own` points (N, 3) in the sensor's frame, and those of the world."""

    def __init__(self, folder: Path, sensor):
        self.folder, self.sensor = folder, sensor
        self.own = seen(prior_of_building(building_of((*ROOM, *INNER))), POSITION, ROTATION, sensor)
        self.world = self.own @ ROTATION.T + POSITION

    def file(self, way):
        """The scan in one of the ways that files have it, the frame to state and the pose to give."""
        points = {"world": self.world, "sensor": self.own, "optical": self.own @ OPTICAL}
        kind, _, in_file = way.partition(" with VIEWPOINT of the ")
        if in_file:
            path = self.folder / f"{way}.pcd"
            axes = np.eye(3) if in_file == "sensor" else OPTICAL
            write_pcd(path, points[kind], viewpoint_of(POSITION, ROTATION @ axes))
            return path, None, None
        path = self.folder / f"{way}.npy"
        np.save(path, points[kind])
        return path, kind, GIVEN


WAYS = {
    "sensor": None, "optical": None,
    "world with VIEWPOINT of the sensor": IN_WORLD, "world with VIEWPOINT of the optics": IN_WORLD,
    "sensor with VIEWPOINT of the sensor": IN_SENSOR, "optical with VIEWPOINT of the optics": IN_SENSOR,
}  # fmt: skip


@pytest.fixture(scope="module")
def room(tmp_path_factory):
    """A room's room.ifc, and what a camera and a scanner that looks around saw after its column was taken out."""
    folder = tmp_path_factory.mktemp("frames")
    write_room(folder / "room.ifc", table_of((*ROOM, *INNER, *COLUMN)), 0)
    for name in ("camera", "scanner"):
        (folder / name).mkdir()
    return folder / "room.ifc", Taken(folder / "camera", OAK_D_PRO_SMALL), Taken(folder / "scanner", SPINNING)


def told_of(found):
    """What a detection says, without how it came to it."""
    return [one.verdict for one in found.elements], [(one.object_type, one.mismatch_type) for one in found.mismatches]


@pytest.fixture(scope="module")
def expected(room):
    ifc, *scans = room
    found = []
    for scan in scans:
        path, frame, pose = scan.file("world")
        found.append(detect(ifc, path, pose, reading=Reading(frame=frame, sensor=scan.sensor), settings=SETTINGS))
    assert all(told_of(one)[1] == [("pillar", "removed")] for one in found)
    return found


@pytest.mark.long
@pytest.mark.parametrize("way", WAYS)
def test_one_scan_in_any_frame_ends_in_the_same_verdicts(room, expected, way):
    ifc, *scans = room
    for scan, known in zip(scans, expected, strict=True):
        path, frame, pose = scan.file(way)
        found = detect(ifc, path, pose, reading=Reading(frame=frame, sensor=scan.sensor), settings=SETTINGS)
        assert told_of(found) == told_of(known)
        np.testing.assert_allclose(found.scans[0].pose[:3], known.scans[0].pose[:3], atol=0.003)
        assert not found.scans[0].doubts
        if scan.sensor is OAK_D_PRO_SMALL or "optic" not in way:  # where one that looks around began makes no odds
            np.testing.assert_allclose(found.scans[0].pose[3:], known.scans[0].pose[3:], atol=0.1)
        meant = [note for note in found.scans[0].notes if IN_WORLD in note or IN_SENSOR in note]
        assert len(meant) == (WAYS[way] is not None) and all(WAYS[way] in note for note in meant)


@pytest.mark.parametrize("way", [way for way in WAYS if "VIEWPOINT" in way])
def test_a_pose_that_is_given_moves_no_points_of_a_viewpoint(room, expected, way):
    """It counts for where the sensor is, as for E57; the points stay where the file's has them."""
    ifc, scan, _ = room
    found = detect(ifc, scan.file(way)[0], GIVEN, reading=Reading(sensor=scan.sensor), settings=SETTINGS)
    assert told_of(found) == told_of(expected[0]) and found.scans[0].pose_source == "given"
    assert any(WAYS[way] in note for note in found.scans[0].notes)


@pytest.mark.parametrize(
    "way, stated, right",
    [
        ("sensor", "world", "--frame sensor"), ("sensor", "optical", "--frame sensor"),
        ("sensor", None, "--frame sensor"), ("optical", "world", "--frame optical"),
        ("optical", "sensor", "--frame optical"), ("world", "sensor", "--frame world"),
        ("world", "optical", "--frame world"), ("sensor with VIEWPOINT of the sensor", "world", "--frame sensor"),
        ("optical with VIEWPOINT of the optics", "world", "--frame optical"),
        ("world with VIEWPOINT of the sensor", "sensor", "--frame world"),
    ],
)  # fmt: skip
def test_a_frame_that_does_not_fit_is_refused_by_the_name_of_the_one_that_does(room, way, stated, right):
    ifc, scan, _ = room
    path, _, pose = scan.file(way)
    with pytest.raises(InputError, match=rf"its points do lie on the prior with {right}$") as told:
        detect(ifc, path, pose, reading=Reading(frame=stated), settings=SETTINGS)
    assert "\n" not in str(told.value) and path.name in str(told.value)


@pytest.mark.parametrize(
    "factor, unit, right", [(10.0, None, r"decimetres \(--unit 0\.1\)"), (1.0, 0.001, r"metres \(--unit 1\)")]
)
def test_a_unit_that_does_not_fit_is_refused_by_the_name_of_the_one_that_does(room, factor, unit, right):
    """And by none of a frame, in which more of it lies on the prior by chance."""
    ifc, _, scan = room
    np.save(scan.folder / "sized.npy", scan.world * factor)
    with pytest.raises(InputError, match=rf"its points do lie on the prior at .* its size: are its units {right}\?$"):
        detect(ifc, scan.folder / "sized.npy", GIVEN, reading=Reading(unit=unit), settings=SETTINGS)


@pytest.mark.parametrize("axes", ["sensor", "optics"])
def test_a_pose_of_the_points_axes_names_the_frame_by_where_they_lie(room, axes):
    """A matrix or quaternion takes the points to the same place in either frame; a camera sees what is before it."""
    ifc, scan, _ = room
    points, turn = (scan.own, np.eye(3)) if axes == "sensor" else (scan.own @ OPTICAL, OPTICAL)
    np.save(scan.folder / "turned.npy", points)
    (scan.folder / "turned.json").write_text(
        str(np.block([[ROTATION @ turn, POSITION[:, None]], [np.zeros((1, 3)), 1.0]]).tolist())
    )
    poses = read_poses([str(scan.folder / "turned.json")])
    right = "sensor" if axes == "sensor" else "optical"
    with pytest.raises(InputError, match=rf"--frame {right}$"):
        detect(ifc, scan.folder / "turned.npy", poses, settings=SETTINGS)


@pytest.mark.long
def test_a_unit_that_nearly_fits_is_told_by_its_name(room):
    """Of yards that are read as metres hardly more than one wall of each pair comes to lie on the model."""
    ifc, _, scan = room
    np.save(scan.folder / "yards.npy", scan.world / 0.9144)
    words = r"at 0\.91. times its size: are its units yards \(--unit 0\.9144\)\?"
    with pytest.raises(InputError, match=rf"{words}$"):
        detect(ifc, scan.folder / "yards.npy", GIVEN, settings=SETTINGS)
    believed = dataclasses.replace(SETTINGS, refine=False)
    found = detect(ifc, scan.folder / "yards.npy", GIVEN, settings=believed)
    assert re.search(words, " ".join(found.doubts))


def test_a_viewpoint_that_fits_neither_way_is_refused_saying_so(room):
    ifc, scan, _ = room
    path = scan.folder / "nowhere.pcd"
    write_pcd(
        path, scan.own + np.array([0.0, 0.0, 40.0]), viewpoint_of(POSITION + np.array([0.0, 90.0, 0.0]), ROTATION)
    )
    with pytest.raises(
        InputError, match=r"nowhere\.pcd: expected a scan of .*, moved there by the pose in its file or not"
    ):
        detect(ifc, path, settings=SETTINGS)


@pytest.mark.long
def test_a_viewpoint_is_told_before_its_place_is_searched(room, expected):
    ifc, _, scan = room
    for way in ("world with VIEWPOINT of the sensor", "sensor with VIEWPOINT of the sensor"):
        found = detect(ifc, scan.file(way)[0], "search", settings=SETTINGS)
        assert told_of(found) == told_of(expected[1]) and found.scans[0].pose_source == "searched"
        np.testing.assert_allclose(found.scans[0].pose[:3], POSITION, atol=0.03)
        assert any(WAYS[way] in note for note in found.scans[0].notes)


@pytest.mark.parametrize("told", [True, False], ids=["told", "found"])
def test_a_cloud_with_y_up_is_a_prior_like_any_other(room, expected, told):
    """Its scans have z up, as those of a mesh with y up; one with y up is doubted, saying so."""
    _, _, scan = room
    before = seen(prior_of_building(building_of((*ROOM, *INNER, *COLUMN))), POSITION, ROTATION, SPINNING)
    before, found = before @ ROTATION.T + POSITION, []
    for name, points, y_up in (("z up", before, None), ("y up", before @ Y_UP, True if told else None)):
        np.save(scan.folder / f"{name}.npy", points)
        reading = Reading(prior=ReadOptions(y_up=y_up), sensor=scan.sensor)
        found.append(
            detect(scan.folder / f"{name}.npy", scan.file("world")[0], GIVEN, reading=reading, settings=SETTINGS)
        )
    usual, lying = found
    assert told_of(lying) == told_of(usual) and usual.mismatches
    np.testing.assert_allclose(lying.mismatches[0].center, usual.mismatches[0].center, atol=0.02)
    assert [note for note in lying.notes if "y up" in note] == ([] if told else [
        "y up.npy fits the scans with y up, and was read that way; --up says which axis it is"
    ])  # fmt: skip
    np.save(scan.folder / "lying scan.npy", scan.world @ Y_UP)
    if told:
        found = detect(
            scan.folder / "y up.npy", scan.folder / "lying scan.npy", GIVEN, reading=reading, settings=SETTINGS
        )
        assert any("turned from y up to z up, which scans must have" in doubt for doubt in found.doubts)
    assert not usual.doubts and not lying.doubts


def test_a_cloud_with_a_viewpoint_is_a_prior_in_either_meaning(room):
    """So are two clouds of one writer, whose points are both in their sensor's frames."""
    _, _, scan = room
    place = POSITION + np.array([0.3, 0.4, 0.1]), turned(20.0, 0.0, 0.0)
    before = seen(prior_of_building(building_of((*ROOM, *INNER, *COLUMN))), *place, SPINNING)
    viewpoint, said = viewpoint_of(*place), []
    write_pcd(scan.folder / "before world.pcd", before @ place[1].T + place[0], viewpoint)
    write_pcd(scan.folder / "before sensor.pcd", before, viewpoint)
    for prior in ("before world", "before sensor"):
        for way in ("world with VIEWPOINT of the sensor", "sensor with VIEWPOINT of the sensor"):
            path, _, pose = scan.file(way)
            found = detect(scan.folder / f"{prior}.pcd", path, pose, settings=SETTINGS)
            said.append(
                [(one.object_type, one.mismatch_type, tuple(np.round(one.center, 1))) for one in found.mismatches]
            )
            assert any(IN_SENSOR in note for note in found.notes) == (prior == "before sensor")
    assert said[0] and all(one == said[0] for one in said)
