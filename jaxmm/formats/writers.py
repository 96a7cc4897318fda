"""Scan files: one scan as a point cloud (PLY, PCD, E57, LAS, LAZ, CSV) or with its misses (NPZ), whole or not at all.

P rays, N of them with a return. World frame: metres, z up. All keep national-grid coordinates; PLY and PCD write a
second file then, see cloud_files. A point cloud holds the N returns with the element of each, and but for CSV its class
and intensity; E57 the GlobalIds of the elements as well. Only NPZ holds the rays without a return, and the incidence.
"""

import errno
import uuid
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np

from jaxmm.files import write_arrays, write_atomically, write_text
from jaxmm.formats.cloud_files import Sensor, offset_of, write_pcd, write_ply
from jaxmm.inputs import CSV_COLUMNS, InputError, one_line

LAS_SCALE = 1e-4  # [m] of its whole numbers, which reach 214 km from its offset
LIGHTEST = 65535  # of the intensity in LAS
INVALID = "cartesianInvalidState"  # of E57: 0 valid, 1 a direction only, 2 nothing
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
        if path.suffix.lower() in (".las", ".laz"):
            import laspy  # noqa: F401
            import lazrs  # noqa: F401
        if path.suffix.lower() == ".e57":
            import pye57  # noqa: F401
    except ImportError as error:
        raise InputError(f"{path}: needs the extra formats: pip install 'jaxmm[formats]'") from error


def write_scan(path: Path | str, scan: SensorScan) -> tuple[Path, ...]:
    """Write a scan in the format that the ending of the path names.

    Returns:
        The files that were written: the path, and the moved one of PLY and PCD far from the origin.

    Raises:
        InputError: an unknown ending, or one whose library is not installed; no return at all.
        OSError: it cannot be written; the path stays as it was.
    """
    path = Path(path)
    check_format(path)
    if not np.isfinite(scan.distance).any() and path.suffix.lower() != ".npz":
        raise InputError(f"{path}: the scan has no return to write: every ray missed")
    return WRITERS[path.suffix.lower()](path, scan) or (path,)


def _write_ply(path: Path, scan: SensorScan) -> tuple[Path, ...]:
    fields = {f"scalar_{name}": values for name, values in _fields(scan).items()}
    return write_ply(path, world_points(scan), fields, ["metres, z up"])


def _write_pcd(path: Path, scan: SensorScan) -> tuple[Path, ...]:
    sensor = Sensor(np.asarray(scan.position, np.float64), _quaternion(scan.rotation))
    return write_pcd(path, world_points(scan), _fields(scan), sensor)


def _fields(scan: SensorScan) -> dict[str, np.ndarray]:
    """(N,) of the returns, by name: int32, uint8 and float32."""
    hit = np.isfinite(scan.distance)
    return {name: getattr(scan, name)[hit] for name in ("element", "semantic", "intensity")}


def _write_las(path: Path, scan: SensorScan) -> None:
    """Version 1.2, which all readers know, in steps of LAS_SCALE; element and semantic as extra bytes.

    Intensity has whole numbers only: LIGHTEST is the lightest point of the scan.
    """
    import laspy

    points, fields = world_points(scan), _fields(scan)
    header = laspy.LasHeader(version="1.2", point_format=0)
    header.offsets, header.scales = offset_of(points), np.full(3, LAS_SCALE)
    header.generating_software, header.system_identifier = "jaxmm", "jaxmm scan"
    for name in ("element", "semantic"):
        header.add_extra_dim(laspy.ExtraBytesParams(name=name, type=fields[name].dtype))
    cloud = laspy.LasData(header)
    cloud.x, cloud.y, cloud.z = points.T
    light = fields["intensity"].astype(np.float64)
    cloud.intensity = np.round(light * (LIGHTEST / max(float(light.max()), 1e-12))).clip(0, LIGHTEST).astype(np.uint16)
    cloud.return_number[:] = cloud.number_of_returns[:] = 1
    for name in ("element", "semantic"):
        cloud[name] = fields[name]

    def write(temporary: Path) -> None:
        with open(temporary, "wb") as file:
            cloud.write(file, do_compress=path.suffix.lower() == ".laz")

    write_atomically(path, write)


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
    columns[INVALID] = np.zeros(len(points), np.longlong)  # all are valid; pye57 refuses scans that do not say so

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
        low, high = (0, 2) if name == INVALID else (column.min().item(), column.max().item())
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
    """The thesis's columns, split by commas as in all tables of ours; categoryID is the element."""
    hit = np.isfinite(scan.distance)
    rows = zip((world_points(scan) + 0.0).tolist(), scan.element[hit].tolist(), strict=True)
    lines = [f"{x:.6f},{y:.6f},{z:.6f},{element}" for (x, y, z), element in rows]
    write_text(path, "\n".join([",".join(CSV_COLUMNS), *lines]) + "\n")


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
            "element_file": np.array(scan.elements.file),
        },
    )


def _quaternion(rotation: np.ndarray) -> np.ndarray:
    """(4,) float64 w, x, y, z of a rotation matrix."""
    from scipy.spatial.transform import Rotation

    x, y, z, w = Rotation.from_matrix(np.asarray(rotation, np.float64)).as_quat()
    return np.array([w, x, y, z])


WRITERS = {
    ".ply": _write_ply, ".pcd": _write_pcd, ".e57": _write_e57, ".las": _write_las, ".laz": _write_las,
    ".csv": _write_csv, ".npz": _write_npz,
}  # fmt: skip
