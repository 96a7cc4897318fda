"""Valid files whose packed content is damaged, with the packing made whole again, and layouts that are seldom written.

A flipped bit in a packed file rarely gets past what unpacks it. Here what was packed is damaged, packed again, and its
lengths and checksums put right, so that the damage reaches what reads it.
"""

import datetime
import io
import struct
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np

from tests.cases.valid_beside import SIGNATURE, recorded
from tests.cases.valid_files import GRID, POINTS, ValidFile, bag, e57_content, e57_pages, pcd, saved

MCAP = b"\x89MCAP0\r\n"  # begins and ends a file
MCAP_HEADER, MCAP_FOOTER, MCAP_CHUNK, MCAP_END = 1, 2, 6, 15  # kinds of records
BAG_CHUNK = 13 + 4096  # [bytes] before the first chunk of a ROS 1 bag


def pcd_lump() -> ValidFile:
    """All x, then all y, then all z, behind the lengths of both the packed and the unpacked."""
    data = pcd("binary_compressed").data
    start = data.index(b"DATA binary_compressed\n") + 23

    def unwrap(data: bytes) -> bytes:
        import lzf

        packed, size = struct.unpack("<II", data[start : start + 8])
        return lzf.decompress(data[start + 8 : start + 8 + packed], size)

    def wrap(data: bytes, content: bytes) -> bytes:
        import lzf

        lump = lzf.compress(content, 2 * len(content) + 64) or b""
        return data[:start] + struct.pack("<II", len(lump), len(content)) + lump

    return ValidFile(".pcd", data, unwrap, wrap)


def depth_pixels() -> ValidFile:
    """An image of depths whose rows of pixels are damaged."""
    return recorded("plain", "depth/100.100000.png")._replace(unwrap=_pixels, wrap=_with_pixels)


def _png_chunks(data: bytes) -> list[tuple[bytes, bytes]]:
    found, at = [], SIGNATURE
    while at < len(data):
        length = struct.unpack(">I", data[at : at + 4])[0]
        found.append((data[at + 4 : at + 8], data[at + 8 : at + 8 + length]))
        at += 12 + length
    return found


def _pixels(data: bytes) -> bytes:
    return zlib.decompress(b"".join(content for kind, content in _png_chunks(data) if kind == b"IDAT"))


def _with_pixels(data: bytes, pixels: bytes) -> bytes:
    made, left = data[:SIGNATURE], zlib.compress(pixels)
    for kind, content in _png_chunks(data):
        if kind == b"IDAT":
            content, left = left, b""
        made += struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))
    return made


def e57_scaled() -> ValidFile:
    """Whole numbers with a scale, of two scans: one in cartesian coordinates and one in spherical ones."""
    import pye57
    from pye57 import libe57

    def write(path: Path) -> None:
        with pye57.E57(str(path), mode="w") as file:
            image = file.image_file
            for cartesian in (True, False):
                axes = "XYZ" if cartesian else ("Range", "Azimuth", "Elevation")
                scan, kinds = libe57.StructureNode(image), libe57.StructureNode(image)
                file.data3d.append(scan)
                buffers, columns = libe57.VectorSourceDestBuffer(), (np.abs(POINTS - GRID) / 4.0).T.copy()
                for axis, column in zip(axes, columns, strict=True):
                    name = f"{'cartesian' if cartesian else 'spherical'}{axis}"
                    kinds.set(name, libe57.ScaledIntegerNode(image, 0, -100_000, 100_000, 1e-3, 0.0))
                    buffers.append(libe57.SourceDestBuffer(image, name, column, len(column), True, True))
                points = libe57.CompressedVectorNode(image, kinds, libe57.VectorNode(image, True))
                scan.set("points", points)
                writer = points.writer(buffers)
                writer.write(len(POINTS))
                writer.close()

    data = saved(".e57", write)
    return ValidFile(".e57", e57_pages(data, e57_content(data)), e57_content, e57_pages)


def laz_chunks(variable: bool) -> ValidFile:
    """Several chunks, each of its own number of points as in COPC files, or of five."""
    import laspy
    import lazrs

    cloud = laspy.create(point_format=6, file_version="1.4")
    cloud.header.creation_date = datetime.date(2000, 1, 1)
    cloud.header.offsets, cloud.header.scales = POINTS[0], [1e-3] * 3
    cloud.x, cloud.y, cloud.z = POINTS.T
    record = bytearray(lazrs.LazVlr.new_for_compression(6, 0, variable).record_data())
    if not variable:
        record[12:16] = struct.pack("<I", 5)
    told = struct.pack("<H16sHH32s", 0, b"laszip encoded", 22204, len(record), b"")
    plain = saved(".las", cloud.write)
    head = bytearray(plain[: struct.unpack_from("<I", plain, 96)[0]])
    start = len(head) + len(told) + len(record)
    head[96:104] = struct.pack("<II", start, 1)
    head[104] |= 128
    packed, raw, size = io.BytesIO(bytes(start)), cloud.points.array.tobytes(), cloud.header.point_format.size
    packed.seek(start)
    packer = lazrs.LasZipCompressor(packed, lazrs.LazVlr(bytes(record)))
    for first in range(0, len(POINTS), 10):
        packer.compress_many(np.frombuffer(raw[first * size : (first + 10) * size], np.uint8))
        if variable:
            packer.finish_current_chunk()
    packer.done()
    return ValidFile(".laz", bytes(head) + told + bytes(record) + packed.getvalue()[start:])


def mcap_packed(coding: str) -> ValidFile:
    """One packed chunk and no index: what is packed is damaged, and packed again."""
    records = dict(_mcap_records(bag("mcap").data))
    chunk = records[MCAP_CHUNK]
    held = chunk[40 + struct.unpack("<I", chunk[28:32])[0] :]

    def wrap(_: bytes, held: bytes) -> bytes:
        packed, name = _packer(coding)(held), coding.encode()
        body = chunk[:16] + struct.pack("<QI", len(held), 0) + struct.pack("<I", len(name)) + name
        body += struct.pack("<Q", len(packed)) + packed
        parts = (
            (MCAP_HEADER, records[MCAP_HEADER]),
            (MCAP_CHUNK, body),
            (MCAP_END, bytes(4)),
            (MCAP_FOOTER, bytes(20)),
        )
        return MCAP + b"".join(bytes([kind]) + struct.pack("<Q", len(one)) + one for kind, one in parts) + MCAP

    return ValidFile(".mcap", wrap(b"", held), lambda _: held, wrap)


def _mcap_records(data: bytes) -> list[tuple[int, bytes]]:
    """Kind and content of each, the last first, so that the first of a kind is what a dictionary of them keeps."""
    found, at = [], len(MCAP)
    while at + 9 <= len(data) - len(MCAP):
        length = struct.unpack("<Q", data[at + 1 : at + 9])[0]
        found.append((data[at], data[at + 9 : at + 9 + length]))
        at += 9 + length
    return found[::-1]


def _packer(coding: str) -> Callable[[bytes], bytes]:
    """What rosbags unpacks it with."""
    if not coding:
        return bytes
    if coding == "bz2":
        import bz2

        return bz2.compress
    if coding == "lz4":
        from lz4.frame import compress

        return compress
    from backports.zstd import compress

    return compress


def bag_packed(coding: str) -> ValidFile:
    """A packed chunk, of which what is packed is damaged, and packed again; the index moves with its length."""
    data = bag("ros1").data
    (head,) = struct.unpack_from("<I", data, BAG_CHUNK)
    start = BAG_CHUNK + 4 + head
    (size,) = struct.unpack_from("<I", data, start)
    held, behind = data[start + 4 : start + 4 + size], data[start + 4 + size :]
    place = data.index(b"index_pos=") + 10
    (index,) = struct.unpack_from("<Q", data, place)

    def field(name: bytes, value: bytes) -> bytes:
        return struct.pack("<I", len(name) + 1 + len(value)) + name + b"=" + value

    def wrap(_: bytes, held: bytes) -> bytes:
        packed = _packer(coding)(held)
        told = (
            field(b"op", b"\5") + field(b"compression", coding.encode()) + field(b"size", struct.pack("<I", len(held)))
        )
        chunk = struct.pack("<I", len(told)) + told + struct.pack("<I", len(packed)) + packed
        moved = index + BAG_CHUNK + len(chunk) - (start + 4 + size)
        return data[:place] + struct.pack("<Q", moved) + data[place + 8 : BAG_CHUNK] + chunk + behind

    return ValidFile(".bag", wrap(b"", held), lambda _: held, wrap)


def pts_blocks() -> ValidFile:
    """Two scans, each behind the number of its points."""
    block = f"{len(POINTS)}\r\n" + "".join(f"{x} {y} {z} -1200 1 2 3\r\n" for x, y, z in POINTS)
    return ValidFile(".pts", (2 * block).encode())


def vtk_text() -> ValidFile:
    rows = "".join(f"{x} {y} {z}\n" for x, y, z in POINTS)
    head = f"# vtk DataFile Version 3.0\nmade here\nASCII\nDATASET POLYDATA\nPOINTS {len(POINTS)} double\n"
    return ValidFile(".vtk", f"{head}{rows}VERTICES 1 2\n1 0\n".encode())


def npy_fields() -> ValidFile:
    """A field for each axis, of different types, and one more."""
    table = np.zeros(len(POINTS), [("intensity", "u2"), ("X", "<f8"), ("Y", ">f8"), ("Z", "<f4")])
    for axis, column in zip("XYZ", POINTS.T, strict=True):
        table[axis] = column
    return ValidFile(".npy", saved(".npy", lambda path: np.save(path, table)))


INSIDE: dict[str, Callable[[], ValidFile]] = {
    "pcd-lump": pcd_lump,
    "depth-pixels": depth_pixels,
    "e57-scaled": e57_scaled,
    "laz-chunks": lambda: laz_chunks(False),
    "laz-variable": lambda: laz_chunks(True),
    "bag-lz4": lambda: bag_packed("lz4"),
    "bag-bz2": lambda: bag_packed("bz2"),
    "bag-zstd": lambda: mcap_packed("zstd"),
    "bag-mcap-lz4": lambda: mcap_packed("lz4"),
    "bag-unindexed": lambda: mcap_packed(""),
    "bag-messages": lambda: bag("sqlite3", packed="message", name="file.db3"),
    "bag-metadata": lambda: bag("sqlite3", packed="message", name="metadata.yaml"),
    "pts-blocks": pts_blocks,
    "vtk-text": vtk_text,
    "npy-fields": npy_fields,
}
