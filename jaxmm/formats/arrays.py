"""Scans as NumPy arrays: NPY and NPZ with points, NPZ with the rays of `jaxmm scan`; nothing is ever unpickled."""

import math
import zipfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import IO

import numpy as np

from jaxmm.formats.raw_scans import BLOCK, GrowingPoints, RawScan, axes_of, check_swelling, few_of, filled, to_world
from jaxmm.inputs import InputError

LEAST_ACROSS = 20  # columns of three rows, from which on these are no three points
POINTS = ("points", "xyz", "arr_0")  # what arrays of points are called; the last by NumPy, where nobody names them
RAYS = {"distance", "direction", "origin", "rotation"}


def read_npy(path: Path) -> list[RawScan]:
    """The points of a file: the first three columns of its array, or its fields x, y and z.

    Raises:
        InputError: no array of numbers with three columns or more, or with such fields; shorter than its header
            promises.
    """
    with path.open("rb") as file:
        shape, by_column, kind = _header(path, file, "the array")
        _check_size(path, "the array", shape, kind, path.stat().st_size - file.tell())
        return [RawScan(_points(path, file, shape, by_column, kind))]


def read_npz(path: Path) -> list[RawScan]:
    """The points under one of POINTS, or the returns of rays as `jaxmm scan` writes them, with their sensor's pose.

    Raises:
        InputError: neither is there; an archive that swells, or promises more than it holds.
    """
    with zipfile.ZipFile(path) as archive:
        check_swelling(path, sum(entry.file_size for entry in archive.infolist()))
        held = {entry.filename.removesuffix(".npy"): entry.file_size for entry in archive.infolist()}
        for name in (RAYS | {*POINTS}) & held.keys():
            with archive.open(f"{name}.npy") as file:
                shape, _, kind = _header(path, file, name)
            _check_size(path, name, shape, kind, held[name])
        name = next((name for name in POINTS if name in held), None)
        if name is not None and not held.keys() >= RAYS:
            with archive.open(f"{name}.npy") as file:
                return [RawScan(_points(path, file, *_header(path, file, name)))]
    if held.keys() >= RAYS:
        with np.load(path, allow_pickle=False) as arrays:
            return [_returns(path, arrays)]
    wanted = "an array points, or rays as `jaxmm scan` writes them"
    raise InputError(f"{path}: expected {wanted}, got {', '.join(sorted(held))[:200] or 'nothing'}")


def _points(path: Path, file: IO[bytes], shape: tuple[int, ...], by_column: bool, kind: np.dtype) -> np.ndarray:
    """(N, 3) float64 of an array that comes next in a file: its first three columns, or its fields x, y and z.

    Read in blocks: as a whole it may be several times as large.
    """
    axes = _axes(path, shape, kind)
    if kind.names is not None:
        return filled(path, math.prod(shape), _blocks(file, math.prod(shape), kind, 1, axes))
    if by_column and len(shape) == 2:  # all x come first
        points = np.zeros((shape[0], 3))
        for axis in range(3):
            filled(path, shape[0], _blocks(file, shape[0], kind, 1, [0]), points[:, axis : axis + 1])
        return points
    if by_column:
        array = np.frombuffer(file.read(math.prod(shape) * kind.itemsize), kind).reshape(shape, order="F")
        return np.array(array[..., :3].reshape(-1, 3), np.float64)
    count = math.prod(shape[:-1])
    return filled(path, count, _blocks(file, count, kind, shape[-1], axes))


def _blocks(file: IO[bytes], count: int, kind: np.dtype, width: int, axes: Sequence[int]) -> Iterator[np.ndarray]:
    """Blocks (n, axes) float64 of so many rows of `width` numbers, or of one record."""
    row = width * kind.itemsize
    for start in range(0, count, BLOCK):
        data = file.read(row * min(BLOCK, count - start))
        table = np.frombuffer(data, kind, len(data) // row * width)
        if kind.names is not None:
            yield np.column_stack([table[kind.names[axis]].astype(np.float64) for axis in axes])
        else:
            yield table.reshape(-1, width)[:, axes].astype(np.float64)


def _axes(path: Path, shape: tuple[int, ...], kind: np.dtype) -> list[int]:
    """Which columns or fields of an array are x, y and z."""
    if kind.names is not None:
        axes = axes_of(kind.names)
        if axes is None or any(kind[axis].kind not in "iuf" for axis in axes):
            told = ", ".join(kind.names)[:200]
            raise InputError(f"{path}: expected fields x, y and z of numbers once each, got {told}")
        return axes
    across = len(shape) == 2 and shape[0] == 3 < LEAST_ACROSS <= shape[1]  # a row for each axis
    # Of three axes, the first two are rows and columns as an image has them.
    if kind.kind not in "iuf" or len(shape) not in (2, 3) or shape[-1] < 3 or across:
        raise InputError(f"{path}: expected points (N, 3) of numbers, got {str(kind)[:80]} {shape}")
    return [0, 1, 2]


def _check_size(path: Path, name: str, shape: tuple[int, ...], kind: np.dtype, size: int) -> None:
    """Refuse an array that promises more than there is, before any memory is taken for it."""
    if np.prod([float(length) for length in shape]) * kind.itemsize > size:
        raise InputError(
            f"{path}: expected {name} to fit into {size} bytes, its header promises {str(kind)[:80]} {shape}"
        )


def _header(path: Path, file: IO[bytes], name: str) -> tuple[tuple[int, ...], bool, np.dtype]:
    """Shape, whether by columns, and type that an array promises, which no pickled objects may be."""
    version = np.lib.format.read_magic(file)
    read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, by_column, kind = read(file)
    if kind.hasobject:
        raise InputError(f"{path}: expected {name} to hold numbers, got pickled objects")
    return shape, by_column, kind


def _returns(path: Path, arrays: np.lib.npyio.NpzFile) -> RawScan:
    distance, direction, origin, rotation = (
        np.asarray(arrays[name]) for name in ("distance", "direction", "origin", "rotation")
    )
    if any(array.dtype.kind != "f" for array in (distance, direction, origin, rotation)) or (
        distance.ndim != 1 or direction.shape != (len(distance), 3) or origin.shape != (3,) or rotation.shape != (3, 3)
    ):
        raise InputError(f"{path}: expected rays with one direction each, and origin and rotation of one sensor")
    if not (np.isfinite(origin).all() and np.isfinite(rotation).all()):
        raise InputError(f"{path}: expected a finite origin and rotation of the sensor, got {origin} and {rotation}")
    if np.any(distance < 0.0):
        raise InputError(f"{path}: expected distances of 0 and more, got {np.nanmin(distance):g}")
    if len(distance) and not np.isfinite(distance).any():
        raise InputError(f"{path}: expected rays that come back, got {len(distance)} of which none does")
    origin, rotation = origin.astype(np.float64), rotation.astype(np.float64)
    points, unseen = GrowingPoints(), [np.zeros((0, 3), np.float32)]
    for start in range(0, len(distance), BLOCK):
        block = slice(start, start + BLOCK)
        back = np.isfinite(distance[block])
        points.append(distance[block][back, None].astype(np.float64) * direction[block][back])
        nowhere = direction[block][~back]
        unseen.append(few_of(nowhere[np.isfinite(nowhere).all(axis=1)]))
    found = points.points()
    to_world(found, rotation, origin)
    return RawScan(found, origin, rotation, in_world=True, unseen=few_of(np.concatenate(unseen)))
