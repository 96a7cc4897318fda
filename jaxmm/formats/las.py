"""LAS and LAZ scans through laspy and lazrs, block by block; scaled integers become float64, so grids lose nothing.

The header is checked before laspy sees it, which counts for minutes to a number of records that are not there.
"""

import contextlib
import struct
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np

from jaxmm.formats.dates import from_day
from jaxmm.formats.laz_chunks import check_chunks
from jaxmm.formats.raw_scans import BLOCK, RawScan, ahead, check_count, check_swelling
from jaxmm.inputs import InputError
from warp_scanner.quiet import silent

HEAD = 375  # [bytes] of the largest header
NOISE = (7, 18)  # classes: of low points, and of high ones
MANY_CLASSES = 6  # the first point format with more than 32 classes, of which 18 is one
RECORD = 54  # [bytes] of the smallest record between header and points


def read_las(path: Path) -> list[RawScan]:
    """The points of a file, without those that it calls withheld or noise.

    Raises:
        InputError: no header, or one that promises what the file does not hold.
    """
    import laspy

    _check_header(path)
    # Of points in layers, as of LAS 1.4, colours, times and the like stay packed.
    wanted = laspy.DecompressionSelection.base().decompress_z().decompress_classification().decompress_flags()
    with silent("laspy"):
        with laspy.open(path, read_evlrs=False) as file:
            backends = _backends(path, file.header)
        with laspy.open(path, read_evlrs=False, laz_backend=backends, decompression_selection=wanted) as file:
            return [_believed(path, file)]


def _backends(path: Path, header: Any) -> Any:
    """The header checked, and what is to unpack the file."""
    from laspy import LazBackend

    if not (np.isfinite(header.scales).all() and np.isfinite(header.offsets).all()):
        raise InputError(f"{path}: expected a finite scale and offset, got {header.scales} and {header.offsets}")
    check_count(path, header.point_count, 0 if header.are_points_compressed else header.point_format.size)
    if not header.are_points_compressed:
        return None
    check_swelling(path, header.point_count * header.point_format.size)
    # Many threads unpack a chunk as if it were full, unless it is the last, behind which an empty one may stand.
    return LazBackend.Lazrs if check_chunks(path, header) else LazBackend.LazrsParallel


def _believed(path: Path, file: Any) -> RawScan:
    """The points that the file itself takes for some."""
    count, kind = file.header.point_count, file.header.point_format.id
    left_out = np.zeros(256, bool)  # by class
    left_out[list(NOISE if kind >= MANY_CLASSES else NOISE[:1])] = True
    scale, shift = file.header.scales, file.header.offsets
    points, kept, found = np.zeros((count, 3)), 0, 0
    for chunk in ahead(file.chunk_iterator(BLOCK)):
        found += len(chunk)
        stays = ~(np.asarray(chunk.withheld, bool) | left_out[np.asarray(chunk.classification)])
        block, every = points[kept : kept + int(stays.sum())], stays.all()
        for axis, name in enumerate("XYZ"):
            steps = np.asarray(chunk[name])
            np.multiply(steps if every else steps[stays], scale[axis], out=block[:, axis])
            block[:, axis] += shift[axis]
        kept += len(block)
    if found < count:
        raise InputError(f"{path}: truncated: expected {count} points as its header promises, found {found}")
    if not kept:
        raise InputError(f"{path}: expected points, got {found}, all withheld or noise")
    told = f"{found - kept} of {found} points are withheld or noise, as the file says, and are left out"
    taken = from_day(_created(file.header))
    return RawScan(points[:kept], remarks=(told,) if kept < found else (), taken=taken)


def _created(header: Any) -> date | None:
    """The day that the header states; None without one, and where its day of the year is none."""
    with contextlib.suppress(ValueError, OverflowError):
        return header.creation_date
    return None


def _check_header(path: Path) -> None:
    with open(path, "rb") as file:
        head = file.read(HEAD)
    if head[:4] != b"LASF" or len(head) < 227:
        raise InputError(f"{path}: expected a LAS header (LASF and 223 bytes more), found none")
    start, count = struct.unpack("<II", head[96:104])
    if start > path.stat().st_size or count * RECORD > start:
        raise InputError(f"{path}: expected {count} records before its points at byte {start}, which do not fit")
