"""The chunks of a LAZ file, checked before lazrs unpacks them: it takes the memory that their lengths ask for.

Where that is more than there is, lazrs ends the whole process. A chunk begins with one plain point; in the newer,
layered format the number of its points and the length in bytes of each of its layers follow.
"""

import struct
from pathlib import Path
from typing import Any

import numpy as np

from jaxmm.inputs import InputError

LAYERED = 3  # the compressor whose chunks have layers
LAYERS = {10: 9, 11: 1, 12: 2, 13: 1}  # of each kind of item; one a byte in those of 14, which hold extra bytes
EXTRA_BYTES = 14
VARIABLE = 0xFFFFFFFF  # points of a chunk, where each has its own number
USUAL = 1_000_000  # points of a chunk; writers take 50,000


def check_chunks(path: Path, header: Any) -> bool:
    """Refuse a packed file whose chunks do not fit into it.

    Args:
        path: the file.
        header: of it, as laspy reads it.

    Returns:
        Whether one of its chunks is empty.

    Raises:
        InputError: points of another size than the header says; more or longer chunks than the file holds.
    """
    import lazrs

    size, start = path.stat().st_size, header.offset_to_point_data
    record = header.vlrs.get("LasZipVlr")
    if not record:
        raise InputError(f"{path}: expected the record that tells how its points are packed, found none")
    layout, point = lazrs.LazVlr(record[0].record_data), header.point_format.size
    if layout.item_size() != point:
        raise InputError(f"{path}: expected points of {point} bytes, got {layout.item_size()}")
    if layout.chunk_size() != VARIABLE and layout.chunk_size() > max(USUAL, header.point_count):
        raise InputError(f"{path}: expected chunks of at most {USUAL} points, got {layout.chunk_size()}")
    with open(path, "rb") as file:
        _check_table(path, file, start)
        file.seek(start)
        chunks = lazrs.read_chunk_table(file, layout)
        promised = sum(length for _, length in chunks)
        if promised > size - start:
            raise InputError(f"{path}: expected chunks that fit into its {size} bytes, got {promised} bytes of them")
        _check_filled(path, chunks, header.point_count)
        if layers := _layers(record[0].record_data):
            _check_layers(path, file, [start + 8, *(length for _, length in chunks)], point, layers)
    return any(length == 0 for _, length in chunks)


def _check_table(path: Path, file: Any, start: int) -> None:
    """The table must lie behind the points' beginning, with no more entries than there are bytes."""
    size = path.stat().st_size
    file.seek(start)
    place = int.from_bytes(file.read(8), "little", signed=True)
    if place == -1:  # a writer that could not go back put it at the end
        file.seek(max(0, size - 8))
        place = int.from_bytes(file.read(8), "little", signed=True)
    if not start < place <= size - 8:
        raise InputError(f"{path}: expected a table of chunks within its {size} bytes, its header says at {place}")
    file.seek(place)
    _, count = struct.unpack("<II", file.read(8))
    if count > size // 4:
        raise InputError(f"{path}: expected chunks that fit into its {size} bytes, its table promises {count}")


def _check_filled(path: Path, chunks: list[tuple[int, int]], count: int) -> None:
    """Chunks without a byte may only stand behind all points: lazrs would take what follows for such a one."""
    held = 0
    for points, length in chunks:
        if not length and held < count:
            raise InputError(f"{path}: expected {count} points in its chunks, got an empty one after {held}")
        held += points


def _layers(record: bytes) -> int:
    """How many layers a chunk has; 0 in the older format."""
    (compressor,), (count,) = struct.unpack("<H", record[:2]), struct.unpack("<H", record[32:34])
    if compressor != LAYERED:
        return 0
    items = [struct.unpack("<HHH", record[34 + 6 * number : 40 + 6 * number]) for number in range(count)]
    return sum(size if kind == EXTRA_BYTES else LAYERS.get(kind, 0) for kind, size, _ in items)


def _check_layers(path: Path, file: Any, lengths: list[int], point: int, layers: int) -> None:
    """`lengths`: first the byte at which the first chunk begins, then the bytes of each."""
    places = np.cumsum(lengths)
    for place, length in zip(places, lengths[1:], strict=False):
        if not length:  # some writers begin a last one that no point comes into
            continue
        file.seek(int(place) + point + 4)
        told = np.frombuffer(file.read(4 * layers), "<u4")
        if len(told) < layers or told.sum(dtype=np.int64) + point + 4 + 4 * layers > length:
            raise InputError(f"{path}: expected layers that fit into their chunk of {length} bytes at byte {place}")
