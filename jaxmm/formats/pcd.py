"""PCD scans: text, binary and compressed, with the sensor's pose where VIEWPOINT tells it.

Read here and not by pypcd4, which holds several copies of all fields and knows version 0.7 only; what
unpacks comes with it.
"""

import io
import struct
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from jaxmm.formats.pcd_header import PcdHeader, read_pcd_header
from jaxmm.formats.raw_scans import BLOCK, RawScan, check_count, check_swelling, filled, records
from jaxmm.formats.text import rows
from jaxmm.formats.text_header import remarks_on_end
from jaxmm.inputs import InputError

# The default, which most writers leave as it is, and what PCL's grabbers write of every Kinect: they say nothing.
NO_VIEWPOINTS = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0]


def read_pcd(path: Path) -> list[RawScan]:
    """The points of a file.

    Raises:
        InputError: no header, or one that contradicts itself; no x, y and z; fewer points than promised.
    """
    with open(path, "rb") as file:
        header = read_pcd_header(path, file)
        count = header.points
        if header.data == "ascii":
            check_count(path, count, 2.0 * sum(header.counts))  # a digit and a gap each
            blocks = _text_points(path, file, header)
        elif header.data == "binary":
            check_count(path, count, header.record)
            blocks = records(file, _kind(header), count)
        else:
            check_count(path, count)
            check_swelling(path, count * header.record)
            blocks = _unpacked(path, file, header)
        points = filled(path, count, blocks)
        points += header.offset
        position, rotation = _pose(header.sensor or header.viewpoint)
        if position is not None:
            position = position + header.offset
        remarks = remarks_on_end(path) if header.data == "ascii" else ()
        return [RawScan(points, position, rotation, remarks, in_world=header.sensor is not None)]


def _kind(header: PcdHeader) -> np.dtype:
    return np.dtype(
        {"names": list("xyz"), "formats": header.kinds, "offsets": header.offsets(), "itemsize": header.record}
    )


def _text_points(path: Path, file: io.BufferedReader, header: PcdHeader) -> Iterator[np.ndarray]:
    columns, width = header.columns(), sum(header.counts)
    lines = io.TextIOWrapper(file, "latin-1")
    try:
        for block in rows(lines, width=width):
            yield block[:, columns]
    except ValueError as error:
        raise InputError(f"{path}: expected points of {width} numbers: {error}") from error


def _unpacked(path: Path, file: io.BufferedReader, header: PcdHeader) -> Iterable[np.ndarray]:
    """Blocks of what one compressed lump holds: all x, then all y, and so on."""
    import lzf  # comes with pypcd4

    size, sizes = header.points * header.record, file.read(8)
    packed, unpacked = struct.unpack("<II", sizes) if len(sizes) == 8 else (0, 0)
    if unpacked != size:
        raise InputError(f"{path}: expected {size} bytes of points as its header promises, got {unpacked}")
    lump = file.read(packed) if packed <= path.stat().st_size else b""
    if len(lump) != packed or not packed:
        raise InputError(f"{path}: truncated: expected {packed} bytes of compressed points, got {len(lump)}")
    lump = lzf.decompress(lump, size)
    if lump is None or len(lump) != size:
        raise InputError(f"{path}: expected compressed points, got what does not unpack to {size} bytes")
    axes = [
        np.frombuffer(lump, kind, header.points, header.points * offset)
        for kind, offset in zip(header.kinds, header.offsets(), strict=True)
    ]
    for start in range(0, header.points, BLOCK):
        yield np.column_stack([axis[start : start + BLOCK].astype(np.float64) for axis in axes])


def _pose(viewpoint: list[float]) -> tuple[np.ndarray | None, np.ndarray | None]:
    """Position and rotation; None where the file says nothing, or what is no rotation."""
    from scipy.spatial.transform import Rotation

    x, y, z, w, i, j, k = viewpoint
    if viewpoint in NO_VIEWPOINTS or not 0.5 < np.linalg.norm([w, i, j, k]) < 2.0:
        return None, None
    return np.array([x, y, z]), Rotation.from_quat([i, j, k, w]).as_matrix()
