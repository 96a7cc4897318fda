"""Scans as NumPy arrays: NPY and NPZ with points, NPZ with the rays of `jaxmm scan`; nothing is ever unpickled."""

import zipfile
from pathlib import Path
from typing import IO

import numpy as np

from jaxmm.formats.raw_scans import BLOCK, RawScan, axes_of, check_swelling, filled
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
        _header(path, file, "the array")
        array = np.lib.format.open_memmap(path, mode="r")  # checks the size that is promised, and admits no objects
        columns = _columns(path, array)
        if array.dtype.names is not None or not array.flags.c_contiguous:
            return [RawScan(np.array(columns, np.float64))]
        width = array.shape[-1]
        rows = (  # read, not mapped: pages of a file that are looked at count as memory
            np.fromfile(file, columns.dtype, width * BLOCK).reshape(-1, width)[:, :3]
            for _ in range(0, len(columns), BLOCK)
        )
        return [RawScan(filled(path, len(columns), rows))]


def read_npz(path: Path) -> list[RawScan]:
    """The points under one of POINTS, or the returns of rays as `jaxmm scan` writes them, with their sensor's pose.

    Raises:
        InputError: neither is there; an archive that swells, or promises more than it holds.
    """
    with zipfile.ZipFile(path) as archive:
        check_swelling(path, sum(entry.file_size for entry in archive.infolist()))
        held = {entry.filename.removesuffix(".npy"): entry.file_size for entry in archive.infolist()}
        for name in (RAYS | {*POINTS}) & held.keys():
            _check_array(path, archive, name, held[name])
    with np.load(path, allow_pickle=False) as arrays:
        if held.keys() >= RAYS:
            return [_returns(path, arrays)]
        name = next((name for name in POINTS if name in held), None)
        if name is None:
            wanted = "an array points, or rays as `jaxmm scan` writes them"
            raise InputError(f"{path}: expected {wanted}, got {', '.join(sorted(held))[:200] or 'nothing'}")
        return [RawScan(_columns(path, arrays[name]))]


def _columns(path: Path, array: np.ndarray) -> np.ndarray:
    """(N, 3) of an array with the columns x, y and z, or with fields of these names."""
    if array.dtype.names is not None:
        names = array.dtype.names
        axes = axes_of(names)
        if axes is None or any(array.dtype[axis].kind not in "iuf" for axis in axes):
            raise InputError(f"{path}: expected fields x, y and z of numbers once each, got {', '.join(names)[:200]}")
        return np.column_stack([array[names[axis]].ravel().astype(np.float64) for axis in axes])
    if array.ndim == 3 and array.shape[2] >= 3:  # as an image has them, rows and columns
        array = array.reshape(-1, array.shape[2])
    across = array.ndim == 2 and array.shape[0] == 3 < LEAST_ACROSS <= array.shape[1]  # a row for each axis
    if array.dtype.kind not in "iuf" or array.ndim != 2 or array.shape[1] < 3 or across:
        raise InputError(f"{path}: expected points (N, 3) of numbers, got {str(array.dtype)[:80]} {array.shape}")
    return array[:, :3]


def _check_array(path: Path, archive: zipfile.ZipFile, name: str, size: int) -> None:
    """Refuse an array that promises more than the archive holds, before NumPy takes the memory for it."""
    with archive.open(f"{name}.npy") as file:
        shape, kind = _header(path, file, name)
    if np.prod([float(length) for length in shape]) * kind.itemsize > size:
        raise InputError(
            f"{path}: expected {name} to fit into {size} bytes, its header promises {str(kind)[:80]} {shape}"
        )


def _header(path: Path, file: IO[bytes], name: str) -> tuple[tuple[int, ...], np.dtype]:
    """Shape and type that an array promises, which no pickled objects may be."""
    version = np.lib.format.read_magic(file)
    read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, _, kind = read(file)
    if kind.hasobject:
        raise InputError(f"{path}: expected {name} to hold numbers, got pickled objects")
    return shape, kind


def _returns(path: Path, arrays: np.lib.npyio.NpzFile) -> RawScan:
    distance, direction, origin, rotation = (
        np.asarray(arrays[name]) for name in ("distance", "direction", "origin", "rotation")
    )
    if any(array.dtype.kind != "f" for array in (distance, direction, origin, rotation)) or (
        distance.ndim != 1 or direction.shape != (len(distance), 3) or origin.shape != (3,) or rotation.shape != (3, 3)
    ):
        raise InputError(f"{path}: expected rays with one direction each, and origin and rotation of one sensor")
    hit = np.isfinite(distance)
    origin, rotation = origin.astype(np.float64), rotation.astype(np.float64)
    points = origin + (distance[hit, None].astype(np.float64) * direction[hit]) @ rotation.T
    return RawScan(points, origin, rotation, in_world=True)
