"""E57 scans through pye57: every scan of the file in world coordinates, with the pose that it was taken from.

Points are read in blocks by the library below pye57, whose own `read_scan` holds five copies of them.
"""

import struct
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np

from jaxmm.formats.dates import from_gps
from jaxmm.formats.raw_scans import (
    BLOCK,
    FARTHEST,
    RawScan,
    check_count,
    check_name,
    check_swelling,
    returned,
    to_world,
)
from jaxmm.inputs import InputError

PROBE = 1 << 12  # points read at once where it is only asked whether there are any
PAGE, CONTENT = 1024, 1020  # [bytes] of a page, and before its checksum
CARTESIAN = ("cartesianX", "cartesianY", "cartesianZ")
SPHERICAL = ("sphericalRange", "sphericalAzimuth", "sphericalElevation")


def read_e57(path: Path, only: int | None = None) -> list[RawScan]:
    """All scans of a file, or the one of a number.

    Raises:
        InputError: one without coordinates, or fewer points than promised.
    """
    return _opened(path, lambda file: _scans(path, file, only))


def scans_with_points(path: Path) -> tuple[list[int], int]:
    """Numbers of the scans of a file that hold points, and how many scans there are.

    Of each scan no more is read than up to its first points that came back. One that cannot be read counts as if it
    held some: whoever reads it whole says what is wrong.

    Raises:
        InputError: it is no whole E57 file.
    """

    def counted(file: Any) -> tuple[list[int], int]:
        headers = [file.get_header(number) for number in range(file.scan_count)]
        some = [number for number, header in enumerate(headers) if _holds_points(path, file.image_file, header)]
        return some, len(headers)

    return _opened(path, counted)


def _opened(path: Path, what: Callable[[Any], Any]) -> Any:
    """What is asked of a file that is opened, and closed again."""
    try:
        import pye57
    except ImportError as error:
        raise InputError(f"{path}: needs the extra formats: pip install 'jaxmm[formats]'") from error
    _check_header(path)
    try:
        file = pye57.E57(str(path))
        try:
            return what(file)
        finally:
            file.close()
    except pye57.libe57.E57Exception as error:  # what follows the stars is for those who debug the library
        reason = " ".join(str(error).split("****")[0].split())[:200]
        raise InputError(f"{path}: expected a whole E57 file: {reason}") from error


def _check_header(path: Path) -> None:
    """Refuse what is no E57 file, is cut off, or declares entities, which could swell in the parser without end."""
    check_name(path)
    size = path.stat().st_size
    with open(path, "rb") as file:
        head = file.read(48)
        if len(head) < 48 or head[:8] != b"ASTM-E57":
            raise InputError(f"{path}: expected an E57 file (ASTM-E57 and a header), found something else")
        whole, start, length = struct.unpack("<QQQ", head[16:40])
        if whole != size or start + length > size:
            raise InputError(f"{path}: truncated: expected {whole} bytes as its header promises, found {size}")
        file.seek(start)
        raw = file.read(length + (length // CONTENT + 2) * (PAGE - CONTENT))
    first = max(0, CONTENT - start % PAGE)  # the rest of the page that it begins in
    text = raw[:first] + b"".join(raw[at : at + CONTENT] for at in range(first + PAGE - CONTENT, len(raw), PAGE))
    if b"<!DOCTYPE" in text[:length] or b"\0" in text[:length]:
        raise InputError(f"{path}: expected E57 whose XML is UTF-8 without a document type, found another")


def _scans(path: Path, file: Any, only: int | None) -> list[RawScan]:
    numbers = range(file.scan_count) if only is None else [only]
    headers = [file.get_header(number) for number in numbers]
    check_swelling(path, sum(24 * max(header.point_count, 0) for header in headers))
    return [_scan(path, file.image_file, header) for header in headers]


def _scan(path: Path, image: Any, header: Any) -> RawScan:
    if not header.point_count:
        return RawScan(np.zeros((0, 3)))
    points = _points(path, image, header)
    taken = _taken(header.node)
    if not header.has_pose():
        return RawScan(points, taken=taken)
    points, none = returned(points)  # in the sensor's frame, where their zero is
    position, rotation, remarks = _pose(header.node)
    to_world(points, rotation, position)
    return RawScan(points, position, rotation, (*remarks, *none), in_world=True, taken=taken)


def _points(path: Path, image: Any, header: Any) -> np.ndarray:
    """(N, 3) in the sensor's frame, without those that the file calls invalid."""
    check_count(path, header.point_count)
    points, kept = np.zeros((header.point_count, 3)), 0
    for block in _blocks(path, image, header, BLOCK):
        points[kept : kept + len(block)] = block
        kept += len(block)
    return points[:kept]


def _holds_points(path: Path, image: Any, header: Any) -> bool:
    """Whether rays of a scan came back from two places at least; a ray from nowhere is often written as 0, 0, 0."""
    from pye57 import libe57

    first = None
    try:
        with closing(_blocks(path, image, header, PROBE)) as blocks:
            for block in blocks:
                some = block[(np.abs(block) < FARTHEST).all(axis=1) & block.any(axis=1)]
                first = some[0] if first is None and len(some) else first
                if (some != first).any():
                    return True
    except (InputError, libe57.E57Exception):
        return header.point_count > 0
    return False


def _blocks(path: Path, image: Any, header: Any, size: int) -> Iterator[np.ndarray]:
    """Blocks of the points of a scan, up to `size` (n, 3) each, as of `_points`."""
    from pye57 import libe57

    axes = next((axes for axes in (CARTESIAN, SPHERICAL) if set(axes) <= set(header.point_fields)), None)
    if axes is None:
        raise InputError(f"{path}: expected points in cartesian or spherical coordinates, got others")
    count, invalid = header.point_count, axes[0].replace("X", "InvalidState").replace("Range", "InvalidState")
    columns = {axis: np.zeros(size) for axis in axes}
    if invalid in header.point_fields:
        columns[invalid] = np.zeros(size, np.int8)
    buffers, read = libe57.VectorSourceDestBuffer(), 0
    for name, column in columns.items():
        buffers.append(libe57.SourceDestBuffer(image, name, column, size, True, True))
    reader = header.points.reader(buffers)
    try:
        while found := reader.read():
            if read + found > count:
                raise InputError(f"{path}: expected {count} points as its header promises, found more")
            block = _cartesian(np.column_stack([columns[axis][:found] for axis in axes]), axes)
            yield block[columns[invalid][:found] == 0] if invalid in columns else block
            read += found
    finally:
        reader.close()
    if read < count:
        raise InputError(f"{path}: truncated: expected {count} points as its header promises, found {read}")


def _cartesian(block: np.ndarray, axes: tuple[str, ...]) -> np.ndarray:
    if axes is CARTESIAN:
        return block
    distance, azimuth, elevation = block.T
    level = distance * np.cos(elevation)
    return np.column_stack([level * np.cos(azimuth), level * np.sin(azimuth), distance * np.sin(elevation)])


def _taken(node: Any) -> str | None:
    """When the scan began, as far as the file says so."""
    if not (node.isDefined("acquisitionStart") and node["acquisitionStart"].isDefined("dateTimeValue")):
        return None
    return from_gps(float(node["acquisitionStart"]["dateTimeValue"].value()))


def _pose(node: Any) -> tuple[np.ndarray, np.ndarray, tuple[str, ...]]:
    """Position and rotation of a scan, and a remark; either may be left out of the file, and then there is none."""
    from scipy.spatial.transform import Rotation

    def numbers(part: str, names: str, default: tuple[float, ...]) -> np.ndarray:
        if not node["pose"].isDefined(part):
            return np.array(default)
        return np.array([float(node["pose"][part][name].value()) for name in names])

    position = numbers("translation", "xyz", (0.0, 0.0, 0.0))
    quaternion = numbers("rotation", "xyzw", (0.0, 0.0, 0.0, 1.0))
    if not quaternion.any():  # some write that for no rotation
        return position, np.eye(3), ("the quaternion of its rotation is 0 0 0 0, which was taken for none",)
    return position, Rotation.from_quat(quaternion).as_matrix(), ()
