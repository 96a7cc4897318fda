"""What a reader of scan files hands over, and the checks that all of them share: what a header promises must be true.

N points. World frame of the file, in its units. Points arrive in blocks and land in one array, so a scan of 50 million
points is never held twice; its memory is taken as it fills, so a lying header costs nothing.
"""

from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple, TypeVar

import numpy as np

from jaxmm.inputs import InputError
from jaxmm.vectors import directions

BLOCK = 1 << 19  # points read at once
IN_CACHE = 1 << 15  # points moved at once, in a third of the time of a BLOCK
FARTHEST = 1e12  # coordinates beyond are damage, and their squares would not fit
MOST_POINTS = 2_000_000_000  # more than that is a damaged header
MOST_SWELLING = 200  # times that a packed file may grow; real ones grow 3 to 20 times
PLACE = np.radians(0.3)  # of rays that came back from nowhere, one is kept in each
SMALL = 10_000  # [bytes] a file below this may swell as if it had them: packing has a fixed cost


Block = TypeVar("Block")
_END = object()


class RawScan(NamedTuple):
    """One scan as a reader found it, unchecked."""

    points: np.ndarray  # (N, 3 or more) numbers
    position: np.ndarray | None = None  # (3,) float64 of the sensor
    rotation: np.ndarray | None = None  # (3, 3) float64 sensor frame to world
    remarks: tuple[str, ...] = ()
    in_world: bool = False  # the reader took the points from the sensor's frame to the world by that pose
    frame: str | None = None  # "sensor" or "optical", where the format says what the frame of the sensor is
    taken: str | None = None  # when, as of `dates`; None where the format or the file does not say
    # (K, 3) float32 unit vectors, in the sensor's frame, of rays that brought nothing back; None: the file tells none.
    unseen: np.ndarray | None = None


def few_of(direction: np.ndarray) -> np.ndarray:
    """(k, 3) float32 unit vectors: of directions (K, 3) of any length one for each place, as patterns of rays have."""
    from warp_scanner.clouds.sightlines import cells_of  # loads Warp, which few files need to be read

    unit = directions(direction).astype(np.float32)
    return unit[np.unique(cells_of(unit, PLACE)[0], return_index=True)[1]] if len(unit) else unit


def check_count(path: Path, count: int, least_bytes: float = 0.0) -> None:
    """Refuse a number of points that no file holds, or not this one.

    Args:
        path: the file.
        count: points that its header promises.
        least_bytes: of the file that each of them takes.

    Raises:
        InputError: none, more than MOST_POINTS, or more than fit.
    """
    size = path.stat().st_size
    if not 0 < count <= MOST_POINTS or count * least_bytes > size:
        raise InputError(f"{path}: expected points that fit into its {size} bytes, its header promises {count}")


def check_name(path: Path) -> None:
    """Refuse a name that libraries which want UTF-8 cannot open.

    Raises:
        InputError: it is none.
    """
    try:
        str(path).encode()
    except UnicodeEncodeError as error:
        raise InputError(f"{path}: expected a name in UTF-8, which its library needs; rename it") from error


def check_swelling(path: Path, unpacked: int) -> None:
    """Refuse a packed file that would fill the memory.

    Raises:
        InputError: `unpacked` bytes are more than MOST_SWELLING times those of the file.
    """
    if unpacked > MOST_SWELLING * max(path.stat().st_size, SMALL):
        raise InputError(f"{path}: expected a scan, found a packed file that swells to {unpacked / 1e9:.3g} GB")


def filled(path: Path, count: int, blocks: Iterable[np.ndarray], points: np.ndarray | None = None) -> np.ndarray:
    """All blocks in one array.

    Args:
        path: the file, for the error.
        count: points that its header promises.
        blocks: (n, 3) numbers each.
        points: where they are to be put; None: into a new array.

    Returns:
        (N, 3) float64, N = count, or `points`.

    Raises:
        InputError: the blocks hold another number of points.
    """
    points, found = np.zeros((count, 3)) if points is None else points, 0
    for block in blocks:
        if found + len(block) > count:
            raise InputError(f"{path}: expected {count} points as its header promises, found more")
        points[found : found + len(block)] = block
        found += len(block)
    if found < count:
        raise InputError(f"{path}: truncated: expected {count} points as its header promises, found {found}")
    return points


def ahead(blocks: Iterable[Block]) -> Iterator[Block]:
    """The same blocks, each made in another thread while the one before it is worked on."""
    made = iter(blocks)
    with ThreadPoolExecutor(1) as thread:
        coming = thread.submit(next, made, _END)
        while (block := coming.result()) is not _END:
            coming = thread.submit(next, made, _END)
            yield block


class GrowingPoints:
    """Points of a file that does not say how many it holds; the array grows in place, so it is never held twice."""

    def __init__(self):
        self._held, self._count = np.zeros((0, 3)), 0

    def __len__(self) -> int:
        return self._count

    def append(self, block: np.ndarray) -> None:
        """Take over a block (n, 3) of numbers."""
        wanted, room = self._count + len(block), len(self._held)
        if wanted > room:
            self._held.resize((max(wanted, room + room // 8), 3), refcheck=False)
        self._held[self._count : wanted] = block
        self._count = wanted

    def points(self) -> np.ndarray:
        """(N, 3) float64: all of them; nothing may be appended any more."""
        self._held.resize((self._count, 3), refcheck=False)
        return self._held


def axes_of(names: Sequence[str]) -> list[int] | None:
    """Where x, y and z stand among the names of columns or fields; None where they do not stand there once each.

    Where a file names both, capitals are the coordinates: small ones are then often pixels, or of another frame.
    """
    lower = [name.lower() for name in names]
    for found, axes in ((names, "XYZ"), (names, "xyz"), (lower, "xyz")):
        if all(axis in found for axis in axes):
            once = all(found.count(axis) == 1 for axis in axes)
            return [found.index(axis) for axis in axes] if once else None
    return None


def returned(points: np.ndarray) -> tuple[np.ndarray, tuple[str, ...]]:
    """Points (N, 3) without those at exactly 0, 0, 0, and a remark on them; they are moved together in place.

    Many devices write a ray so that came back from nowhere. One point may be measured there, and so it stays if it is
    the only one; and all stay if there are no others.
    """
    some = points[:, 0] != 0.0
    rows = np.flatnonzero(~some)  # few, mostly
    some[rows] = (points[rows, 1:] != 0.0).any(axis=1)
    count, none = len(points), len(points) - int(some.sum())
    if not 1 < none < count:
        return points, ()
    told = f"{none} of {count} points are at 0, 0, 0, where nothing came back, and are left out"
    return drawn_together(points, some), (told,)


def nearer(points: np.ndarray, farthest: float) -> np.ndarray:
    """(N,) bool: points (N, 3) whose coordinates are all finite and below `farthest`, whatever their sign."""
    found = np.zeros(len(points), bool)
    for start in range(0, len(points), BLOCK):  # what is held of all of them at once would be a third of the points
        block = slice(start, start + BLOCK)
        # Nearly always all are, which two passes tell; no comparison with NaN holds.
        near = points[block].min() > -farthest and points[block].max() < farthest
        found[block] = near or (np.abs(points[block]) < farthest).all(axis=1)
    return found


def drawn_together(points: np.ndarray, kept: np.ndarray) -> np.ndarray:
    """Those of points (N, 3) that are kept, (N,) bool; moved together in place, as two copies may not fit."""
    if kept.all():
        return points
    if not points.flags.writeable:
        return points[kept]
    count = 0
    for start in range(0, len(points), BLOCK):
        block = points[start : start + BLOCK][kept[start : start + BLOCK]]
        points[count : count + len(block)] = block
        count += len(block)
    return points[:count]


def to_world(points: np.ndarray, rotation: np.ndarray, position: np.ndarray) -> None:
    """Take points (N, 3) from a sensor's frame to the world, in place and in blocks: they are never held twice."""
    for start in range(0, len(points), IN_CACHE):
        block = slice(start, start + IN_CACHE)
        points[block] = points[block] @ rotation.T + position


def records(file: object, kind: np.dtype, count: int, axes: tuple[str, ...] = ("x", "y", "z")) -> Iterable[np.ndarray]:
    """Blocks (n, 3) float64 of the binary records that come next in an open file.

    Args:
        file: open for reading bytes, at the first record.
        kind: fields of a record, x, y and z among them.
        count: records to read; fewer come back where the file ends before.
        axes: names of the fields.
    """
    while count > 0:
        table = np.fromfile(file, kind, min(BLOCK, count))
        if not len(table):
            return
        yield np.column_stack([table[axis].astype(np.float64) for axis in axes])
        count -= len(table)
