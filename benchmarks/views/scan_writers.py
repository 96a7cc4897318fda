"""Scan files of any size in every format, written block by block, so that writing takes less memory than reading.

N points of a scan, n of a block. Metres. Coordinates are rounded where the format does so: LAS, LAZ and text to a tenth
of a millimetre, PCD to single precision.
"""

import struct
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

STEP = 1e-4  # [m] of rounded coordinates
BLOCK = 1_000_000  # points


class Blocks(NamedTuple):
    """A scan that is made while it is written."""

    count: int  # N
    make: Callable[[int, int], np.ndarray]  # number of the block, n -> (n, 3) float64 [m]
    viewpoint: tuple[float, ...] = (0.0, 0.0, 0.0)  # [m] of the sensor, where a PCD file tells it

    def __iter__(self) -> Iterator[np.ndarray]:
        for number, first in enumerate(range(0, self.count, BLOCK)):
            yield self.make(number, min(BLOCK, self.count - first))


def _write_ply(path: Path, blocks: Blocks) -> None:
    properties = "".join(f"property double {axis}\n" for axis in "xyz")
    with open(path, "wb") as file:
        head = f"ply\nformat binary_little_endian 1.0\nelement vertex {blocks.count}\n{properties}end_header\n"
        file.write(head.encode())
        for block in blocks:
            block.astype("<f8").tofile(file)


def _pcd_header(blocks: Blocks, data: str) -> bytes:
    place = " ".join(f"{value:.6f}" for value in blocks.viewpoint)
    return (
        "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\n"
        f"WIDTH {blocks.count}\nHEIGHT 1\nVIEWPOINT {place} 1 0 0 0\nPOINTS {blocks.count}\nDATA {data}\n"
    ).encode()


def _write_pcd(path: Path, blocks: Blocks) -> None:
    with open(path, "wb") as file:
        file.write(_pcd_header(blocks, "binary"))
        for block in blocks:
            block.astype("<f4").tofile(file)


def _write_packed_pcd(path: Path, blocks: Blocks) -> None:
    """One lump of all x, then all y, then all z."""
    import lzf

    axes = np.zeros((3, blocks.count), "<f4")
    first = 0
    for block in blocks:
        axes[:, first : first + len(block)] = block.T
        first += len(block)
    lump = lzf.compress(axes.tobytes(), axes.nbytes + axes.nbytes // 16)  # noise may not pack at all
    with open(path, "wb") as file:
        file.write(_pcd_header(blocks, "binary_compressed") + struct.pack("<II", len(lump), axes.nbytes))
        file.write(lump)


def _write_e57(path: Path, blocks: Blocks) -> None:
    import pye57
    from pye57 import libe57

    with pye57.E57(str(path), mode="w") as file:
        image = file.image_file
        node, prototype = libe57.StructureNode(image), libe57.StructureNode(image)
        node.set("guid", libe57.StringNode(image, "{6a1f4a52-64a5-5a66-9c39-1f0c2f8f3c57}"))
        file.data3d.append(node)
        columns = {f"cartesian{axis}": np.zeros(BLOCK) for axis in "XYZ"}
        buffers = libe57.VectorSourceDestBuffer()
        for name, column in columns.items():
            prototype.set(name, libe57.FloatNode(image, 0.0, libe57.E57_DOUBLE, -1e6, 1e6))
            buffers.append(libe57.SourceDestBuffer(image, name, column, BLOCK, True, True))
        points = libe57.CompressedVectorNode(image, prototype, libe57.VectorNode(image, True))
        node.set("points", points)
        writer = points.writer(buffers)
        try:
            for block in blocks:
                for column, values in zip(columns.values(), block.T, strict=True):
                    column[: len(block)] = values
                writer.write(len(block))
        finally:
            writer.close()  # a writer that outlives its file takes the process with it


def _write_las(path: Path, blocks: Blocks) -> None:
    """Packed where the ending says so."""
    import laspy

    header = laspy.LasHeader(version="1.4", point_format=6)
    header.scales = np.full(3, STEP)
    with laspy.open(path, mode="w", header=header) as file:
        for block in blocks:
            record = laspy.ScaleAwarePointRecord.zeros(len(block), header=header)
            record.x, record.y, record.z = block.T
            file.write_points(record)


def _write_text(path: Path, blocks: Blocks) -> None:
    """In the thesis's layout where the ending is csv, else split by blanks."""
    csv = path.suffix == ".csv"
    gap, end = (";", ";7\n") if csv else (" ", "\n")
    with open(path, "wb") as file:
        file.write(b"X;Y;Z;categoryID\n" if csv else b"")
        for block in blocks:
            file.write(text_of(block, gap, end))


def _write_ptx(path: Path, blocks: Blocks) -> None:
    """One column, points in the world, and a header that tells no pose."""
    axes = "1 0 0\n0 1 0\n0 0 1\n"
    head = f"1\n{blocks.count}\n0 0 0\n{axes}1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n"
    with open(path, "wb") as file:
        file.write(head.encode())
        for block in blocks:
            file.write(text_of(block, " ", " 0.5\n"))


def text_of(points: np.ndarray, gap: str, end: str) -> bytes:
    """Lines such as `+0012.3456 -0000.0300 +0001.2000` of points within 10 km, 20 times as fast as formatting each."""
    units = np.rint(points / STEP).astype(np.int64)
    digits = np.abs(units)[..., None] // 10 ** np.arange(7, -1, -1) % 10 + ord("0")
    sign, dot = np.where(units < 0, ord("-"), ord("+"))[..., None], np.full((*units.shape, 1), ord("."))
    words = np.concatenate([sign, digits[..., :4], dot, digits[..., 4:]], axis=-1).astype(np.uint8)
    marks = [np.tile(np.frombuffer(mark.encode(), np.uint8), (len(points), 1)) for mark in (gap, gap, end)]
    return np.hstack([part for axis in range(3) for part in (words[:, axis], marks[axis])]).tobytes()


def _write_npy(path: Path, blocks: Blocks) -> None:
    with open(path, "wb") as file:
        _npy(file, blocks)


def _write_npz(path: Path, blocks: Blocks) -> None:
    """Packed, as numpy.savez_compressed does."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        with archive.open("points.npy", "w", force_zip64=True) as file:
            _npy(file, blocks)


def _npy(file: object, blocks: Blocks) -> None:
    header = {"descr": "<f8", "fortran_order": False, "shape": (blocks.count, 3)}
    np.lib.format.write_array_header_1_0(file, header)
    for block in blocks:
        file.write(block.astype("<f8").tobytes())


class Format(NamedTuple):
    """How a format is written."""

    suffix: str
    write: Callable[[Path, Blocks], None]


FORMATS = {
    "ply": Format("ply", _write_ply), "pcd": Format("pcd", _write_pcd),
    "pcd-compressed": Format("pcd", _write_packed_pcd), "e57": Format("e57", _write_e57),
    "las": Format("las", _write_las), "laz": Format("laz", _write_las), "xyz": Format("xyz", _write_text),
    "csv": Format("csv", _write_text), "npy": Format("npy", _write_npy), "npz": Format("npz", _write_npz),
    "ptx": Format("ptx", _write_ptx),
}  # fmt: skip
