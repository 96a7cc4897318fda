"""A small valid file for every reader, and how to mutate what is inside of those that guard it with checksums."""

import datetime
import functools
import io
import json
import re
import struct
import tempfile
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from tests.cases.valid_ifc import ifc_text

GRID = np.array([400_000.0, 5_600_000.0, 30.0])
POINTS = np.round(np.random.default_rng(7).uniform([-5, -4, 0], [5, 4, 3], (40, 3)), 3) + GRID
PAGE = 1024  # bytes of a page of an E57 file; the last four are a checksum


class ValidFile(NamedTuple):
    """A file that its reader accepts."""

    ending: str
    data: bytes
    # Takes the content out of what guards it (checksums, lengths, compression) and puts another one back.
    unwrap: Callable[[bytes], bytes] | None = None
    wrap: Callable[[bytes, bytes], bytes] | None = None  # of the valid file and the new content
    place: str = ""  # in the folder that its reader is given; empty where the reader is given the file
    beside: Mapping[str, bytes] = {}  # what else is in that folder


def saved(ending: str, write: Callable[[Path], object]) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"file{ending}"
        write(path)
        return path.read_bytes()


def ply_text() -> ValidFile:
    header = "ply\nformat ascii 1.0\ncomment hand-made\nelement vertex 40\nproperty double x\nproperty double y\n"
    header += "property double z\nproperty uchar red\nelement face 1\nproperty list uchar int vertex_indices\n"
    rows = "".join(f"{x} {y} {z} 7\n" for x, y, z in POINTS)
    return ValidFile(".ply", f"{header}end_header\n{rows}3 0 1 2\n".encode())


def ply_lists() -> ValidFile:
    """With lists among the vertices, of 0 to 3 numbers."""
    header = "ply\nformat binary_big_endian 1.0\nelement vertex 40\nproperty list uchar int views\n"
    header += "".join(f"property double {axis}\n" for axis in "xyz") + "end_header\n"
    rows = (struct.pack(f">B{n % 4}i3d", n % 4, *range(n % 4), *point) for n, point in enumerate(POINTS))
    return ValidFile(".ply", header.encode() + b"".join(rows))


def ply_binary() -> ValidFile:
    header = "ply\nformat binary_little_endian 1.0\nelement vertex 40\nproperty double x\nproperty double y\n"
    return ValidFile(".ply", f"{header}property double z\nend_header\n".encode() + POINTS.astype("<f8").tobytes())


def pcd(encoding: str) -> ValidFile:
    from pypcd4 import Encoding, PointCloud

    cloud = PointCloud.from_points(list(POINTS.T), ("x", "y", "z"), (np.float64,) * 3)
    cloud.metadata.viewpoint = (1.0, 2.0, 3.0, 1.0, 0.0, 0.0, 0.0)
    return ValidFile(".pcd", saved(".pcd", lambda path: cloud.save(path, encoding=Encoding(encoding))))


def e57() -> ValidFile:
    import pye57

    def write(path: Path) -> None:
        with pye57.E57(str(path), mode="w") as file:
            for turn in (0.0, 0.6):
                columns = {f"cartesian{axis}": POINTS[:, number] - 30.0 for number, axis in enumerate("XYZ")}
                columns["cartesianInvalidState"] = np.zeros(40, np.int8)
                rotation = np.array([np.cos(turn), 0.0, 0.0, np.sin(turn)])
                file.write_scan_raw(columns, rotation=rotation, translation=np.array([1.0, 2.0, 3.0]))

    data = saved(".e57", write)
    content = re.sub(rb"\{[0-9a-f-]{36}\}", b"{" + b"0" * 36 + b"}", e57_content(data))  # the same in every run
    return ValidFile(".e57", e57_pages(data, content), e57_content, e57_pages)


def e57_content(data: bytes) -> bytes:
    return b"".join(data[start : start + PAGE - 4] for start in range(0, len(data), PAGE))


def e57_pages(_: bytes, content: bytes) -> bytes:
    """Pages with right checksums, and the length of the file in its header put right."""
    count = -(-len(content) // (PAGE - 4))
    content = content.ljust(count * (PAGE - 4), b"\0")
    content = content[:16] + struct.pack("<Q", count * PAGE) + content[24:]
    pages = (content[start : start + PAGE - 4] for start in range(0, len(content), PAGE - 4))
    return b"".join(page + struct.pack(">I", crc32c(page)) for page in pages)


@functools.cache
def _crc_table() -> tuple[int, ...]:
    def entry(value: int) -> int:
        for _ in range(8):
            value = (value >> 1) ^ (0x82F63B78 if value & 1 else 0)
        return value

    return tuple(map(entry, range(256)))


def crc32c(data: bytes) -> int:
    """Castagnoli's checksum, which E57 files have on every page."""
    table, value = _crc_table(), 0xFFFFFFFF
    for byte in data:
        value = table[(value ^ byte) & 0xFF] ^ (value >> 8)
    return value ^ 0xFFFFFFFF


def _las(ending: str, kind: int, version: str) -> ValidFile:
    import laspy

    cloud = laspy.create(point_format=kind, file_version=version)
    cloud.header.creation_date = datetime.date(2000, 1, 1)  # the same in every run
    cloud.add_extra_dim(laspy.ExtraBytesParams("quality", "uint8"))
    cloud.header.offsets, cloud.header.scales = POINTS[0], [1e-3] * 3
    cloud.x, cloud.y, cloud.z = POINTS.T
    return ValidFile(ending, saved(ending, cloud.write))


def csv_thesis() -> ValidFile:
    rows = "".join(f"{x};{y};{z};3\n" for x, y, z in POINTS)
    return ValidFile(".csv", f"X;Y;Z;categoryID\n{rows}".encode())


def csv_commas() -> ValidFile:
    rows = "".join(f'9,{z},{y},{x},"wall"\r\n' for x, y, z in POINTS)
    return ValidFile(".csv", f"id,z,y,x,name\r\n{rows}".encode())


def xyz() -> ValidFile:
    return ValidFile(".xyz", "".join(f"{x} {y} {z} 0.5\n" for x, y, z in POINTS).encode())


def pts() -> ValidFile:
    return ValidFile(".pts", ("40\n" + "".join(f"{x} {y} {z} -1200 1 2 3\n" for x, y, z in POINTS)).encode())


def vtk() -> ValidFile:
    """Big-endian numbers."""
    points = np.asarray(POINTS, ">f4")
    header = f"# vtk DataFile Version 3.0\nmade here\nBINARY\nDATASET POLYDATA\nPOINTS {len(points)} float\n"
    return ValidFile(".vtk", header.encode() + points.tobytes())


def ptx() -> ValidFile:
    """Two scans of 40 points, with a ray without a return after each of them."""
    head = "2\n40\n1 2 3\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n1 2 3 1\n"
    scan = head + "".join(f"{x} {y} {z} 0.5\n0 0 0 0\n" for x, y, z in POINTS)
    return ValidFile(".ptx", (2 * scan).encode())


def bag(kind: str, livox: bool = False, packed: str = "", name: str = "") -> ValidFile:
    """Two clouds of 40 points of a sensor that moves, and its transforms; with a `name` one file of its folder."""
    from tests.cases.bags import Types, write_bag

    types, messages = Types(kind), []
    for number in range(2):
        time, place = 100.0 + number, np.array([0.5 * number, 0.0, 1.5])
        messages.append(("/tf", time, types.tf(time, ("map", "lidar", (place, np.eye(3))))))
        cloud = (types.livox if livox else types.cloud)(time, "lidar", POINTS - GRID)
        messages.append(("/points", time, cloud))
    with tempfile.TemporaryDirectory() as folder:
        path = write_bag(Path(folder) / "file", kind, messages, packed)
        if name:
            held = {one.name: one.read_bytes() for one in path.iterdir()}
            return ValidFile(Path(name).suffix, held.pop(name), place=name, beside=held)
        path = path if path.is_file() else next(one for one in path.iterdir() if one.suffix in (".db3", ".mcap"))
        return ValidFile(path.suffix, path.read_bytes())


def npy() -> ValidFile:
    return ValidFile(".npy", saved(".npy", lambda path: np.save(path, POINTS)))


def npz_points() -> ValidFile:
    data = saved(".npz", lambda path: np.savez(path, points=POINTS))
    return ValidFile(".npz", data, _first_member, _with_first_member)


def npz_rays() -> ValidFile:
    direction = np.random.default_rng(8).normal(size=(40, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    arrays = {"distance": np.full(40, 2.0), "direction": direction, "origin": POINTS[0], "rotation": np.eye(3)}
    data = saved(".npz", lambda path: np.savez_compressed(path, **arrays))
    return ValidFile(".npz", data, _first_member, _with_first_member)


def _first_member(data: bytes) -> bytes:
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        return archive.read(archive.namelist()[0])


def _with_first_member(data: bytes, content: bytes) -> bytes:
    made = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(data)) as archive, zipfile.ZipFile(made, "w", zipfile.ZIP_DEFLATED) as new:
        for number, name in enumerate(archive.namelist()):
            new.writestr(zipfile.ZipInfo(name), archive.read(name) if number else content)
    return made.getvalue()


def ifczip() -> ValidFile:
    made = io.BytesIO()
    with zipfile.ZipFile(made, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(zipfile.ZipInfo("model.ifc"), ifc_text("IFC4"), zipfile.ZIP_DEFLATED)
    return ValidFile(".ifczip", made.getvalue(), _first_member, _with_first_member)


def _solid():
    import trimesh

    return trimesh.Scene({"wall_1": trimesh.creation.box((4, 0.2, 3)), "column_2": trimesh.creation.box((0.3, 0.3, 3))})


def _mesh(ending: str, **how: object) -> ValidFile:
    made = _solid().export(file_type=ending[1:], **how)
    return ValidFile(ending, made.encode() if isinstance(made, str) else made)


def obj() -> ValidFile:
    made = _mesh(".obj").data
    return ValidFile(".obj", b"mtllib file.mtl\n" + made + b"usemtl stone\nf -1 -2 -3 -4\n")


def stl_text() -> ValidFile:
    made = _solid().to_mesh().export(file_type="stl_ascii")
    return ValidFile(".stl", made.encode() if isinstance(made, str) else made)


def glb() -> ValidFile:
    return ValidFile(".glb", _mesh(".glb").data, _glb_tree, _with_glb_tree)


def glb_instances() -> ValidFile:
    """A box of quantised corners, which stands at three places."""
    import trimesh

    from tests.cases.glb_files import gltf as arrays_to_gltf
    from tests.cases.glb_files import write_glb

    box, places = trimesh.creation.box((0.4, 3.0, 0.4)), np.array([[-2, 1.5, -1.2], [2, 1.5, 1.2], [0, 1.5, 3.0]], "f4")
    corners = (box.vertices * 10000).astype("i2"), box.faces.astype("u2").ravel(), places, np.ones((3, 3), "f4")
    told = {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": 2, "SCALE": 3}}}
    node = {"name": "column", "mesh": 0, "scale": [1e-4] * 3, "extensions": told}
    tree, blob = arrays_to_gltf([node], [(one, {}) for one in corners], [*told, "KHR_mesh_quantization"])
    tree["meshes"] = tree["meshes"][:1]
    made = saved(".glb", lambda path: write_glb(path, tree, blob))
    return ValidFile(".glb", made, _glb_tree, _with_glb_tree)


def _glb_tree(data: bytes) -> bytes:
    (length,) = struct.unpack("<I", data[12:16])
    return data[20 : 20 + length]


def _with_glb_tree(data: bytes, tree: bytes) -> bytes:
    tree = tree.ljust(-(-len(tree) // 4) * 4)
    rest = data[20 + struct.unpack("<I", data[12:16])[0] :]
    return data[:8] + struct.pack("<II", 20 + len(tree) + len(rest), len(tree)) + data[16:20] + tree + rest


def gltf() -> ValidFile:
    """With its buffers inside, as data."""
    import base64

    files = _solid().export(file_type="gltf")
    tree = json.loads(files.pop("model.gltf"))
    for buffer in tree["buffers"]:
        buffer["uri"] = "data:application/octet-stream;base64," + base64.b64encode(files[buffer["uri"]]).decode()
    return ValidFile(".gltf", json.dumps(tree).encode())


def safetensors() -> ValidFile:
    import jaxmm.weights

    data = (Path(jaxmm.weights.__file__).parent / "default.safetensors").read_bytes()
    return ValidFile(".safetensors", data, _tensor_header, _with_tensor_header)


def _tensor_header(data: bytes) -> bytes:
    return data[8 : 8 + struct.unpack("<Q", data[:8])[0]]


def _with_tensor_header(data: bytes, header: bytes) -> bytes:
    return struct.pack("<Q", len(header)) + header + data[8 + struct.unpack("<Q", data[:8])[0] :]


SCANS: dict[str, Callable[[], ValidFile]] = {
    "ply-text": ply_text,
    "ply-binary": ply_binary,
    "ply-lists": ply_lists,
    "pcd-ascii": lambda: pcd("ascii"),
    "pcd-binary": lambda: pcd("binary"),
    "pcd-compressed": lambda: pcd("binary_compressed"),
    "e57": e57,
    "las": lambda: _las(".las", 0, "1.2"),
    "las-1.4": lambda: _las(".las", 6, "1.4"),
    "laz": lambda: _las(".laz", 0, "1.2"),
    "laz-1.4": lambda: _las(".laz", 6, "1.4"),
    "csv-thesis": csv_thesis,
    "csv-commas": csv_commas,
    "xyz": xyz,
    "pts": pts,
    "ptx": ptx,
    "vtk": vtk,
    "bag-ros1": lambda: bag("ros1"),
    "bag-mcap": lambda: bag("mcap"),
    "bag-sqlite3": lambda: bag("sqlite3"),
    "bag-livox": lambda: bag("ros1", livox=True),
    "npy": npy,
    "npz-points": npz_points,
    "npz-rays": npz_rays,
}
PRIORS: dict[str, Callable[[], ValidFile]] = {
    "ifc2x3": lambda: ValidFile(".ifc", ifc_text("IFC2X3")),
    "ifc4": lambda: ValidFile(".ifc", ifc_text("IFC4")),
    "ifczip": ifczip,
    "mesh-obj": obj,
    "mesh-ply": lambda: _mesh(".ply"),
    "mesh-ply-text": lambda: _mesh(".ply", encoding="ascii"),
    "mesh-glb": glb,
    "mesh-glb-instances": glb_instances,
    "mesh-gltf": gltf,
    "mesh-stl": lambda: _mesh(".stl"),
    "mesh-stl-text": stl_text,
}
MODELS: dict[str, Callable[[], ValidFile]] = {"safetensors": safetensors}
