"""Scan files, read: the points of one scan or several, and where they were taken from if the file says so.

PLY (ascii, binary), PCD (ascii, binary, compressed), E57 (several scans, with poses), LAS and LAZ, CSV (`;` or `,`),
NPY and NPZ, XYZ text. N points. World frame of the file, in its units. Coordinates come as float64, as national grids
need.
"""

import warnings
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from jaxmm.inputs import InputError

MOST_POINTS = 2_000_000_000  # more than that is a damaged header
LEAST_BYTES = {".ply": 3, ".las": 20}  # of a point, by which a promised number is checked against the file
EXTRA = "needs the extra formats: pip install 'jaxmm[formats]'"


class PointScan(NamedTuple):
    """The points of one scan."""

    points: np.ndarray  # (N, 3) float64, finite
    position: np.ndarray | None  # (3,) float64 of the sensor, same frame; None where the file does not say
    rotation: np.ndarray | None  # (3, 3) float64 sensor frame to world
    remarks: tuple[str, ...]  # what was left out, in words


class _Raw(NamedTuple):
    points: np.ndarray
    position: np.ndarray | None = None
    rotation: np.ndarray | None = None


def read_scans(path: Path) -> list[PointScan]:
    """All scans of a file; one, but for E57.

    Raises:
        InputError: one line that names the file and what is wrong with it: missing, of an unknown ending, of another
            format than its ending says, truncated, without points, or without a library to read it.
    """
    if not path.is_file():
        raise InputError(f"{path}: expected a scan file, found {'a folder' if path.is_dir() else 'nothing there'}")
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        raise InputError(f"{path}: expected a scan ending in {', '.join(READERS)}, got {path.suffix or 'no ending'}")
    if not path.stat().st_size:
        raise InputError(f"{path}: expected a scan, found an empty file")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            found = reader(path)
    except InputError:
        raise
    except ImportError as error:
        raise InputError(f"{path}: {EXTRA}") from error
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or _line(error)}") from error
    except MemoryError as error:
        raise InputError(f"{path}: promises more points than fit into memory") from error
    except Exception as error:  # libraries raise almost anything on a damaged file
        raise InputError(f"{path}: expected a whole {path.suffix} file: {_line(error)}") from error
    return [_checked(path, raw) for raw in found]


def _checked(path: Path, raw: _Raw) -> PointScan:
    points = np.asarray(raw.points, np.float64)
    if points.ndim != 2 or points.shape[1] != 3:
        raise InputError(f"{path}: expected points of shape (N, 3), got {points.shape}")
    finite = np.isfinite(points).all(axis=1)
    if not finite.any():
        raise InputError(f"{path}: expected points with finite coordinates, got none among {len(points)}")
    lost = int((~finite).sum())
    remarks = (f"{lost} of {len(points)} points have no finite coordinates and are left out",) if lost else ()
    points = points[finite] if lost else points
    if np.all(points == points[0]):
        raise InputError(f"{path}: expected points in space, got {len(points)} times the same one")
    posed = raw.position is not None and np.isfinite(raw.position).all()
    return PointScan(points, raw.position if posed else None, raw.rotation if posed else None, remarks)


def _read_ply(path: Path) -> list[_Raw]:
    from trimesh.exchange import ply

    with open(path, "rb") as file:
        elements, is_ascii, _ = ply._parse_header(file)
        vertex = elements.get("vertex")
        if vertex is None or not {"x", "y", "z"} <= set(vertex["properties"]):
            raise InputError(f"{path}: expected vertices with x, y and z, found {', '.join(elements) or 'no element'}")
        _check_count(path, vertex["length"])
        if next(iter(elements)) != "vertex":
            raise InputError(f"{path}: expected vertices before all other elements")
        if is_ascii:
            names = list(vertex["properties"])
            lines = [line for _, line in zip(range(vertex["length"]), file, strict=False)]
            if len(lines) < vertex["length"] or not all(len(line.split()) == len(names) for line in lines):
                raise InputError(f"{path}: expected {vertex['length']} vertices of {len(names)} numbers, found others")
            return [_Raw(np.loadtxt(lines, usecols=[names.index(axis) for axis in "xyz"], ndmin=2))]
        if any("LIST" in kind for kind in vertex["properties"].values()):
            raise InputError(f"{path}: expected vertices of plain numbers, found lists in them")
        kind = np.dtype(list(vertex["properties"].items()))
        table = np.fromfile(file, kind, vertex["length"])
    if len(table) < vertex["length"]:
        raise InputError(f"{path}: truncated: expected {vertex['length']} vertices, found {len(table)}")
    return [_Raw(np.column_stack([table[axis].astype(np.float64) for axis in "xyz"]))]


def _read_pcd(path: Path) -> list[_Raw]:
    from pypcd4 import PointCloud
    from scipy.spatial.transform import Rotation

    _check_count(path, _pcd_count(path))
    cloud = PointCloud.from_path(path)
    if not {"x", "y", "z"} <= set(cloud.fields):
        raise InputError(f"{path}: expected fields x, y and z, got {', '.join(cloud.fields)}")
    points = np.column_stack([np.asarray(cloud.pc_data[axis], np.float64) for axis in "xyz"])
    x, y, z, w, i, j, k = cloud.metadata.viewpoint
    if (x, y, z, w, i, j, k) == (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0):
        return [_Raw(points)]  # the default, which most writers leave as it is: it says nothing
    return [_Raw(points, np.array([x, y, z]), Rotation.from_quat([i, j, k, w]).as_matrix())]


def _pcd_count(path: Path) -> int:
    """Points that the header promises."""
    with open(path, "rb") as file:
        for line in file.read(4096).splitlines():
            words = line.split()
            if words[:1] == [b"POINTS"] and len(words) == 2:
                return int(words[1])
    raise InputError(f"{path}: expected a PCD header with POINTS, found none")


def _read_e57(path: Path) -> list[_Raw]:
    import pye57
    from scipy.spatial.transform import Rotation

    file = pye57.E57(str(path))
    try:
        found = []
        for number in range(file.scan_count):
            header = file.get_header(number)
            _check_count(path, header.point_count)
            data = file.read_scan(number, ignore_missing_fields=True)
            points = np.column_stack([data[f"cartesian{axis}"] for axis in "XYZ"])
            pose = (None, None)
            if header.has_pose():
                w, x, y, z = np.asarray(header.rotation)
                pose = (np.asarray(header.translation, np.float64), Rotation.from_quat([x, y, z, w]).as_matrix())
            found.append(_Raw(points, *pose))
    finally:
        file.close()
    if not found:
        raise InputError(f"{path}: expected at least one scan, found none")
    return found


def _read_las(path: Path) -> list[_Raw]:
    import laspy

    with laspy.open(path) as file:
        _check_count(path, file.header.point_count)
        cloud = file.read()
    return [_Raw(np.column_stack([np.asarray(getattr(cloud, axis), np.float64) for axis in "xyz"]))]


def _read_csv(path: Path) -> list[_Raw]:
    """A header that names X, Y and Z, or three columns or more of plain numbers."""
    with open(path, encoding="utf-8-sig", errors="strict") as file:
        first = file.readline()
        delimiter = next((mark for mark in (";", ",", "\t") if mark in first), None)
        names = [name.strip().strip('"').lower() for name in first.split(delimiter)]
        if all(axis in names for axis in "xyz"):
            columns = [names.index(axis) for axis in "xyz"]
        elif _all_numbers(names) and len(names) >= 3:
            columns = [0, 1, 2]
            file.seek(0)
        else:
            raise InputError(f"{path}: expected columns X, Y and Z, got {', '.join(names)[:200]}")
        return [_Raw(np.loadtxt(file, delimiter=delimiter, usecols=columns, comments=None, ndmin=2))]


def _all_numbers(words: list[str]) -> bool:
    try:
        return all(np.isfinite(float(word)) or True for word in words)
    except ValueError:
        return False


def _read_npy(path: Path) -> list[_Raw]:
    array = np.lib.format.open_memmap(path, mode="r")  # checks the size that is promised, and admits no objects
    if array.dtype.kind not in "iuf" or array.ndim != 2 or array.shape[1] < 3:
        raise InputError(f"{path}: expected points (N, 3) of numbers, got {array.dtype} {array.shape}")
    return [_Raw(np.array(array[:, :3], np.float64))]


def _read_npz(path: Path) -> list[_Raw]:
    """Points under `points`, or rays as `jaxmm scan` writes them."""
    with zipfile.ZipFile(path) as archive:
        total = sum(entry.file_size for entry in archive.infolist())
    if total > 200 * max(path.stat().st_size, 10_000):
        raise InputError(f"{path}: expected scans, found an archive that swells to {total / 1e9:.3g} GB")
    with np.load(path, allow_pickle=False) as arrays:
        names = set(arrays.files)
        if {"distance", "direction", "origin", "rotation"} <= names:
            distance, hit = arrays["distance"], np.isfinite(arrays["distance"])
            origin, rotation = (np.asarray(arrays[name], np.float64) for name in ("origin", "rotation"))
            if rotation.shape != (3, 3) or origin.shape != (3,) or arrays["direction"].shape != (len(distance), 3):
                raise InputError(
                    f"{path}: expected rays with one direction each, and origin and rotation of one sensor"
                )
            points = origin + (distance[hit, None].astype(np.float64) * arrays["direction"][hit]) @ rotation.T
            return [_Raw(points, origin, rotation)]
        if "points" not in names:
            raise InputError(
                f"{path}: expected an array points, or rays as `jaxmm scan` writes them, got {sorted(names)}"
            )
        points = arrays["points"]
    if points.dtype.kind not in "iuf" or points.ndim != 2 or points.shape[1] < 3:
        raise InputError(f"{path}: expected points (N, 3) of numbers, got {points.dtype} {points.shape}")
    return [_Raw(points[:, :3])]


def _check_count(path: Path, count: int) -> None:
    """Refuse a number of points that no file holds or, where they are not packed, not this one."""
    least = LEAST_BYTES.get(path.suffix.lower(), 0)
    size = path.stat().st_size
    if not 0 < count <= MOST_POINTS or count * least > size:
        raise InputError(f"{path}: expected points that fit into its {size} bytes, its header promises {count}")


def _line(error: Exception) -> str:
    return " ".join(str(error).split())[:200] or type(error).__name__


READERS: dict[str, Callable[[Path], Any]] = {
    ".ply": _read_ply, ".pcd": _read_pcd, ".e57": _read_e57, ".las": _read_las, ".laz": _read_las, ".csv": _read_csv,
    ".npy": _read_npy, ".npz": _read_npz, ".xyz": _read_csv, ".txt": _read_csv, ".asc": _read_csv,
}  # fmt: skip
