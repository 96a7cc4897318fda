"""LAS and LAZ scans through laspy and lazrs, block by block; scaled integers become float64, so grids lose nothing.

The header is checked before laspy sees it, which counts for minutes to a number of records that are not there.
"""

import struct
from pathlib import Path

import numpy as np

from jaxmm.formats.laz_chunks import check_chunks
from jaxmm.formats.raw_scans import BLOCK, RawScan, check_count, check_swelling, filled
from jaxmm.inputs import InputError
from warp_scanner.quiet import silent

HEAD = 375  # [bytes] of the largest header
RECORD = 54  # [bytes] of the smallest record between header and points


def read_las(path: Path) -> list[RawScan]:
    """The points of a file.

    Raises:
        InputError: no header, or one that promises what the file does not hold.
    """
    import laspy

    _check_header(path)
    with silent("laspy"), laspy.open(path, read_evlrs=False) as file:
        header = file.header
        if not (np.isfinite(header.scales).all() and np.isfinite(header.offsets).all()):
            raise InputError(f"{path}: expected a finite scale and offset, got {header.scales} and {header.offsets}")
        check_count(path, header.point_count, 0 if header.are_points_compressed else header.point_format.size)
        if header.are_points_compressed:
            check_swelling(path, header.point_count * header.point_format.size)
            check_chunks(path, header)
        chunks = file.chunk_iterator(BLOCK)
        blocks = (np.column_stack([np.asarray(getattr(chunk, axis), np.float64) for axis in "xyz"]) for chunk in chunks)
        return [RawScan(filled(path, header.point_count, blocks))]


def _check_header(path: Path) -> None:
    with open(path, "rb") as file:
        head = file.read(HEAD)
    if head[:4] != b"LASF" or len(head) < 227:
        raise InputError(f"{path}: expected a LAS header (LASF and 223 bytes more), found none")
    start, count = struct.unpack("<II", head[96:104])
    if start > path.stat().st_size or count * RECORD > start:
        raise InputError(f"{path}: expected {count} records before its points at byte {start}, which do not fit")
