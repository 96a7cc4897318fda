"""Scan files: one scan, written as a point cloud (PLY, PCD, E57, CSV) or with its misses (NPZ), whole or not at all.

P rays, N of them with a return. World frame: metres, z up. Text and double precision keep national-grid coordinates.
A point cloud holds the N returns with the element of each, and but for CSV its class and intensity; E57 the GlobalIds
of the elements as well. Only NPZ holds the rays without a return, and the incidence.
"""

import errno
import uuid
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np

from jaxmm.files import write_arrays, write_atomically, write_text
from jaxmm.inputs import CSV_COLUMNS, InputError, one_line

PCD_SINGLE = 4096.0  # [m] coordinates that single precision holds to a quarter of a millimetre
_PLY_KINDS = {"<f8": "double", "<f4": "float", "<i4": "int", "|u1": "uchar"}
E57_EXTENSION = "urn:jaxmm:e57:element"  # names what jaxmm: stands for in an E57 file


class Elements(Protocol):
    """What is known of each element, as buildings.Elements tells it; (E,) each."""

    guid: tuple[str, ...]
    ifc_class: tuple[str, ...]
    name: tuple[str, ...]
    storey: Any


class SensorScan(NamedTuple):
    """One scan from one place."""

    position: np.ndarray  # (3,) float64 [m] of the sensor, world
    rotation: np.ndarray  # (3, 3) float64 sensor frame to world
    directions: np.ndarray  # (P, 3) float32 unit vectors in the sensor frame
    distance: np.ndarray  # (P,) float32 [m]; inf = no return
    element: np.ndarray  # (P,) int32; -1 where nothing was hit
    semantic: np.ndarray  # (P,) uint8; 0 where nothing was hit
    incidence: np.ndarray  # (P,) float32 [rad]; NaN where nothing was hit
    intensity: np.ndarray  # (P,) float32, 1 = white, 1 m away and seen head-on; 0 where nothing was hit
    elements: Elements


def local_points(scan: SensorScan) -> np.ndarray:
    """Returns (N, 3) float64 [m] in the sensor frame."""
    hit = np.isfinite(scan.distance)
    return scan.distance[hit, None].astype(np.float64) * scan.directions[hit]


def world_points(scan: SensorScan) -> np.ndarray:
    """Returns (N, 3) float64 [m] in the world frame."""
    return scan.position + local_points(scan) @ np.asarray(scan.rotation, np.float64).T


def check_format(path: Path) -> None:
    """Refuse a file that `write_scan` could not write.

    Raises:
        InputError: an unknown ending, or one whose library is not installed.
    """
    if path.suffix.lower() not in WRITERS:
        raise InputError(f"{path}: expected a file ending in {', '.join(WRITERS)}, got {path.suffix or 'no ending'}")
    try:
        if path.suffix.lower() == ".pcd":
            import pypcd4  # noqa: F401
        if path.suffix.lower() == ".e57":
            import pye57  # noqa: F401
    except ImportError as error:
        raise InputError(f"{path}: needs the extra formats: pip install 'jaxmm[formats]'") from error


def write_scan(path: Path | str, scan: SensorScan) -> None:
    """Write a scan in the format that the ending of the path names.

    Raises:
        InputError: an unknown ending, or one whose library is not installed; no return at all.
        OSError: it cannot be written; the path stays as it was.
    """
    path = Path(path)
    check_format(path)
    if not np.isfinite(scan.distance).any() and path.suffix.lower() != ".npz":
        raise InputError(f"{path}: the scan has no return to write: every ray missed")
    WRITERS[path.suffix.lower()](path, scan)


def _write_ply(path: Path, scan: SensorScan) -> None:
    """Binary, with double coordinates: the writers at hand round them to float32."""
    hit, points = np.isfinite(scan.distance), world_points(scan)
    fields = [("x", "<f8"), ("y", "<f8"), ("z", "<f8"), ("element", "<i4"), ("semantic", "u1"), ("intensity", "<f4")]
    table = np.zeros(len(points), fields)
    for axis, name in enumerate("xyz"):
        table[name] = points[:, axis]
    for name in ("element", "semantic", "intensity"):
        table[name] = getattr(scan, name)[hit]
    write_ply_table(path, table)


def write_ply_table(path: Path, table: np.ndarray) -> None:
    """Write a structured array (N,) as the vertices of a binary PLY file: fields of <f8, <f4, <i4 and u1."""
    properties = "".join(f"property {_PLY_KINDS[kind.str]} {name}\n" for name, (kind, _) in table.dtype.fields.items())
    header = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(table)}\n{properties}end_header\n"
    write_atomically(path, lambda temporary: temporary.write_bytes(header.encode() + table.tobytes()))


def _write_pcd(path: Path, scan: SensorScan) -> None:
    """World coordinates in single precision where that is exact to a quarter of a millimetre, as not all readers know
    doubles; VIEWPOINT is the sensor's pose in the same frame."""
    from pypcd4 import PointCloud

    hit, points = np.isfinite(scan.distance), world_points(scan)
    columns = [*points.T, scan.element[hit], scan.semantic[hit], scan.intensity[hit]]
    names = ("x", "y", "z", "element", "semantic", "intensity")
    coordinate = np.float32 if np.abs(points).max() < PCD_SINGLE else np.float64
    cloud = PointCloud.from_points(columns, names, (*[coordinate] * 3, np.int32, np.uint8, np.float32))
    cloud.metadata.viewpoint = tuple(float(value) for value in (*scan.position, *_quaternion(scan.rotation)))
    write_atomically(path, cloud.save)


def _write_e57(path: Path, scan: SensorScan) -> None:
    """Points in the sensor's frame beside its pose, as the format wants them.

    The standard has no field for what a point belongs to: jaxmm:element and jaxmm:semantic of each point, and
    jaxmm:guid of the scan with the GlobalIds, are fields of an extension. Readers pass over it, some only when asked to
    (pye57: read_scan, or read_scan_raw with ignore_unsupported_fields=True).
    """
    import pye57
    from pye57 import libe57

    hit, points = np.isfinite(scan.distance), local_points(scan)
    columns = {f"cartesian{axis}": np.ascontiguousarray(points[:, i]) for i, axis in enumerate("XYZ")}
    columns["intensity"] = scan.intensity[hit].astype(np.float64)
    # The one integer that pye57 reads as what it is: it takes every other long for one of 32 bits.
    columns["jaxmm:element"] = scan.element[hit].astype(np.longlong)
    columns["jaxmm:semantic"] = scan.semantic[hit].astype(np.longlong)

    def write(temporary: Path) -> None:
        try:
            file = pye57.E57(str(temporary), mode="w")
            try:
                file.image_file.extensionsAdd("jaxmm", E57_EXTENSION)
                _add_e57_scan(file, scan, columns)
            finally:
                file.close()
        except libe57.E57Exception as error:  # the library's only kind, which does not say what the system said
            reason = one_line(error)
            raise OSError(errno.EIO, f"cannot be written as E57: {reason}", str(path)) from error

    write_atomically(path, write)


def _add_e57_scan(file: Any, scan: SensorScan, columns: dict[str, np.ndarray]) -> None:
    """Append one scan of the columns, (N,) each, to an open pye57 file; its own writer knows standard fields only."""
    from pye57 import libe57

    image = file.image_file

    def structure(**numbers: float) -> Any:
        node = libe57.StructureNode(image)
        for name, value in numbers.items():
            node.set(name, libe57.FloatNode(image, float(value)))
        return node

    node, pose, guids = structure(), structure(), libe57.VectorNode(image, False)
    file.data3d.append(node)
    node.set("guid", libe57.StringNode(image, f"{{{uuid.uuid4()}}}"))
    node.set("pose", pose)
    pose.set("rotation", structure(**dict(zip("wxyz", _quaternion(scan.rotation), strict=True))))
    pose.set("translation", structure(**dict(zip("xyz", scan.position, strict=True))))
    node.set("jaxmm:guid", guids)
    for guid in scan.elements.guid:
        guids.append(libe57.StringNode(image, guid))
    prototype, buffers = libe57.StructureNode(image), libe57.VectorSourceDestBuffer()
    for name, column in columns.items():
        low, high = column.min().item(), column.max().item()
        if column.dtype == np.longlong:
            field = libe57.IntegerNode(image, low, low, high)
        else:
            field = libe57.FloatNode(image, low, libe57.E57_DOUBLE, low, high)
        prototype.set(name, field)
        buffers.append(libe57.SourceDestBuffer(image, name, column, len(column), True, True))
    table = libe57.CompressedVectorNode(image, prototype, libe57.VectorNode(image, True))
    node.set("points", table)
    writer = table.writer(buffers)
    try:
        writer.write(len(columns["cartesianX"]))
    finally:
        writer.close()  # a writer that outlives its file takes the process with it


def _write_csv(path: Path, scan: SensorScan) -> None:
    """The thesis's layout; categoryID is the element."""
    hit = np.isfinite(scan.distance)
    rows = zip(world_points(scan).tolist(), scan.element[hit].tolist(), strict=True)
    lines = [f"{x:.6f};{y:.6f};{z:.6f};{element}" for (x, y, z), element in rows]
    write_text(path, "\n".join([";".join(CSV_COLUMNS), *lines]) + "\n")


def _write_npz(path: Path, scan: SensorScan) -> None:
    """Every ray, misses too, as the fields of a SensorScan; origin and direction of the rays; a table of elements."""
    write_arrays(
        path,
        {
            "distance": scan.distance,
            "element": scan.element,
            "semantic": scan.semantic,
            "incidence": scan.incidence,
            "intensity": scan.intensity,
            "direction": scan.directions,
            "origin": np.asarray(scan.position, np.float64),
            "rotation": np.asarray(scan.rotation, np.float64),
            **{name: np.array(getattr(scan.elements, name)) for name in ("guid", "ifc_class", "name", "storey")},
        },
    )


def _quaternion(rotation: np.ndarray) -> np.ndarray:
    """(4,) float64 w, x, y, z of a rotation matrix."""
    from scipy.spatial.transform import Rotation

    x, y, z, w = Rotation.from_matrix(np.asarray(rotation, np.float64)).as_quat()
    return np.array([w, x, y, z])


WRITERS = {".ply": _write_ply, ".pcd": _write_pcd, ".e57": _write_e57, ".csv": _write_csv, ".npz": _write_npz}
