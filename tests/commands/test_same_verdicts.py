"""One scan in every file that can hold all of it: the same verdicts, whatever wrote it."""

import json
import struct

import numpy as np
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation

from jaxmm import detect, parse_pose, scan, write_scan
from jaxmm.commands import cli
from jaxmm.formats.poses import OPTICAL
from jaxmm.inputs import InputError
from jaxmm.verdicts.settings import DetectSettings
from tests.cases.bags import Types, write_bag
from tests.cases.box_building import table_of
from tests.cases.house import GONE, STANDS
from warp_scanner.buildings.room_ifc import write_room
from warp_scanner.sensors.sensors import Pinhole

# The column that stands is between the camera and the zero of the world.
POSE, CAMERA = parse_pose("3.6,3.9,1.5,250,-4"), Pinhole(320, 240, 100.0, 65.0, (0.1, 12.0))
BELIEVED = DetectSettings(refine=False, propose_views=False)


@pytest.fixture(scope="module")
def house(tmp_path_factory):
    """Folder with house.ifc and a camera's scan of it after a column was taken out, all of its rays, and verdicts."""
    folder = tmp_path_factory.mktemp("house")
    write_room(folder / "house.ifc", table_of((*STANDS, GONE)), 0)
    write_room(folder / "as_built.ifc", table_of(STANDS), 0)
    view = scan(folder / "as_built.ifc", POSE, CAMERA)
    view.distance[::9] = np.inf  # what came back from nowhere
    write_scan(folder / "scan.npz", view)
    return folder, view, verdicts(folder, folder / "scan.npz")


def verdicts(folder, path, pose=None):
    """GlobalId -> verdict, and what was added or removed: kinds and places."""
    found = detect(folder / "house.ifc", path, pose, settings=BELIEVED)
    places = sorted((one.object_type, one.mismatch_type, *np.round(one.center, 1)) for one in found.mismatches)
    return {element.guid: element.verdict for element in found.elements}, places


def returns(view):
    """(P, 3) float64 [m] in the sensor's frame; zeros where nothing came back."""
    distance = np.where(np.isfinite(view.distance), view.distance, 0.0)
    return distance[:, None].astype(np.float64) * view.directions


def ptx(folder, view):
    head = [*view.position[None], *view.rotation.T, *np.column_stack([view.rotation.T, np.zeros(3)])]
    lines = ["320", "240", *(" ".join(map(str, row)) for row in head), " ".join(map(str, [*view.position, 1.0]))]
    lines += [f"{x:.6f} {y:.6f} {z:.6f} 0.5" for x, y, z in returns(view)]
    (folder / "scan.ptx").write_text("\n".join(lines) + "\n")
    return folder / "scan.ptx", None


def pts(folder, view):
    points = returns(view)[np.isfinite(view.distance)] @ view.rotation.T + view.position
    np.savetxt(
        folder / "scan.pts", np.column_stack([points, np.ones(len(points))]), header=str(len(points)), comments=""
    )
    return folder / "scan.pts", POSE


def organised_pcd(folder, view):
    """With zeros where nothing came back."""
    points = returns(view) @ view.rotation.T + view.position
    points[~np.isfinite(view.distance)] = 0.0
    head = "VERSION .7\nFIELDS x y z\nSIZE 8 8 8\nTYPE F F F\nWIDTH 320\nHEIGHT 240\nDATA binary\n"
    (folder / "scan.pcd").write_bytes(head.encode() + points.tobytes())
    return folder / "scan.pcd", POSE


def depth_folder(folder, view):
    out = folder / "depth_images"
    (out / "depth").mkdir(parents=True)
    depth = np.round(returns(view)[:, 0] * 5000).astype(np.uint16).reshape(240, 320)
    Image.fromarray(depth).save(out / "depth" / "1.0.png")
    lengths = (size / 2 / np.tan(np.radians(fov) / 2) for size, fov in ((320, 100.0), (240, 65.0)))
    camera = dict(zip(("fx", "fy"), lengths, strict=True)) | {"cx": 159.5, "cy": 119.5, "width": 320, "height": 240}
    (out / "intrinsics.json").write_text(json.dumps(camera | {"depth_scale": 5000}))
    row = [1.0, *view.position, *Rotation.from_matrix(view.rotation @ OPTICAL).as_quat()]
    (out / "trajectory.txt").write_text(" ".join(map(str, row)) + "\n")
    return out, None


def bag_of(kind):
    """A bag whose transforms tell the pose; zeros where nothing came back, and a second message at rest."""

    def bag(folder, view):
        pytest.importorskip("rosbags")
        types = Types(kind)
        pose, image = (view.position, view.rotation.astype(np.float64)), returns(view).reshape(240, 320, 3)
        messages = [("/tf", 10.0, types.tf(10.0, ("map", "lidar", pose)))]
        messages += [
            ("/points", time, types.cloud(time, "lidar", half))
            for time, half in ((10.0, image[:120]), (10.1, image[120:]))
        ]
        messages.append(("/tf", 10.1, types.tf(10.1, ("map", "lidar", pose))))
        return write_bag(folder / "bag", kind, messages), None

    bag.__name__ = f"bag_{kind}"
    return bag


def ours(ending):
    """As `jaxmm scan` writes it; the pose is given where the format holds none."""

    def write(folder, view):
        pytest.importorskip({".e57": "pye57", ".las": "laspy", ".laz": "lazrs"}.get(ending, "numpy"))
        write_scan(folder / f"scan{ending}", view)
        return folder / f"scan{ending}", None if ending in (".e57", ".pcd", ".npz") else POSE

    write.__name__ = ending[1:]
    return write


def by_hand(name, ending, head, body):
    """World points (N, 3) float64 as another program lays them out."""

    def write(folder, view):
        points = returns(view)[np.isfinite(view.distance)] @ view.rotation.T + view.position
        (folder / f"scan{ending}").write_bytes(head.format(len(points)).encode() + body(points))
        return folder / f"scan{ending}", POSE

    write.__name__ = name
    return write


def as_text(points):
    return "".join(f"{x:.6f} {y:.6f} {z:.6f}\n" for x, y, z in points).encode()


def as_german_csv(points):
    return as_text(points).replace(b" ", b";").replace(b".", b",")


def as_lump(points):
    """All x, then all y, then all z, packed, as PCD has them."""
    plain = points.T.astype("<f8").tobytes()
    lump = pytest.importorskip("lzf").compress(plain, 2 * len(plain))
    return struct.pack("<II", len(lump), len(plain)) + lump


def npy(folder, view):
    points = returns(view)[np.isfinite(view.distance)] @ view.rotation.T + view.position
    np.save(folder / "scan.npy", points)
    return folder / "scan.npy", POSE


PLY = "ply\nformat {} 1.0\nelement vertex {{}}\nproperty double x\nproperty double y\nproperty double z\nend_header\n"
VTK = "# vtk DataFile Version 3.0\nscan\n{}\nDATASET POLYDATA\nPOINTS {{}} double\n"
PCD = "VERSION .7\nFIELDS x y z\nSIZE 8 8 8\nTYPE F F F\nWIDTH {{}}\nHEIGHT 1\nDATA {}\n"
WRITERS = [
    ptx, pts, organised_pcd, depth_folder, npy, *map(ours, (".ply", ".pcd", ".e57", ".las", ".laz", ".csv", ".npz")),
    by_hand("ply_text", ".ply", PLY.format("ascii"), as_text),
    by_hand("ply_big", ".ply", PLY.format("binary_big_endian"), lambda points: points.astype(">f8").tobytes()),
    by_hand("pcd_text", ".pcd", PCD.format("ascii"), as_text),
    by_hand("pcd_packed", ".pcd", PCD.format("binary_compressed"), as_lump),
    by_hand("vtk_text", ".vtk", VTK.format("ASCII"), as_text),
    by_hand("vtk", ".vtk", VTK.format("BINARY"), lambda points: points.astype(">f8").tobytes()),
    by_hand("xyz", ".xyz", "", as_text),
    by_hand("csv_german", ".csv", "Rechtswert;Hochwert;Höhe\n", as_german_csv),
    bag_of("ros1"), bag_of("sqlite3"), bag_of("mcap"),
]  # fmt: skip


# One of every kind that says another thing of rays or pose; what other layouts of the same points give, tests of the
# readers tell as well.
SHORT = {
    "ptx", "organised_pcd", "depth_folder", "npy", "ply", "e57", "npz", "pcd_packed", "csv_german", "bag_mcap",
}  # fmt: skip
EVERY = [pytest.param(one, marks=[] if one.__name__ in SHORT else pytest.mark.long) for one in WRITERS]


@pytest.mark.parametrize("write", EVERY, ids=lambda write: write.__name__)
def test_verdicts_are_the_same_in_every_file(house, tmp_path, write):
    folder, view, expected = house
    assert {"present", "removed", "unscanned"} == set(expected[0].values()) and len(expected[1]) == 1
    assert verdicts(folder, *write(tmp_path, view)) == expected


@pytest.mark.parametrize("write", [ptx, organised_pcd, depth_folder, WRITERS[-1]], ids=lambda write: write.__name__)
def test_what_no_ray_came_back_from_is_hidden_not_gone(house, tmp_path, write):
    """Nothing comes back from where the column stands: a ray without a return never passed through it."""
    folder, view, expected = house
    place = view.elements.ifc_class.index("IfcColumn")
    guid = view.elements.guid[place]
    assert expected[0][guid] == "present"
    hidden = view._replace(distance=np.where(view.element == place, np.float32(np.inf), view.distance))
    found, mismatches = verdicts(folder, *write(tmp_path, hidden))
    assert found == expected[0] | {guid: "occluded"} and mismatches == expected[1]


def test_the_command_takes_folders_and_says_what_it_cannot_take(house, tmp_path, capsys):
    folder, view, _ = house
    images, _ = depth_folder(tmp_path, view)

    def said(*words):
        code = cli.main(["detect", str(folder / "house.ifc"), *map(str, words), "--out", str(tmp_path / "out")])
        return code, capsys.readouterr()

    code, told = said(images)
    (tmp_path / "out").rename(tmp_path / "found")
    assert code == 0 and "A pillar has been removed at [4.5 1. 1.5]" in told.out
    for words, why in (
        ((images, "--topic", "/points"), "--topic: expected a bag among the scans, got none"),
        ((tmp_path / "none",), "none: expected a scan file, or a folder of depth images, found nothing there"),
        ((tmp_path,), "expected depth/*.png of depth images, found none"),
    ):
        code, told = said(*words)
        assert code == 2 and why in told.err and told.err.count("\n") == 1 and not (tmp_path / "out").exists()


def test_a_wrong_number_of_poses_is_told_with_the_scans_that_are_left_out(house, tmp_path):
    folder, view, _ = house
    path, _ = ptx(tmp_path, view)
    empty = "\n".join(
        ["1", "1", "0 0 0", "1 0 0", "0 1 0", "0 0 1", "1 0 0 0", "0 1 0 0", "0 0 1 0", "0 0 0 1", "0 0 0"]
    )
    path.write_text(path.read_text() + empty + "\n")
    with pytest.raises(InputError, match=r"of 1 scans .* got 2; scan\.ptx: 1 of 2 scans hold no points"):
        detect(folder / "house.ifc", path, [POSE, POSE])
