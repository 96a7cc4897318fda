"""Checked reading of the thesis's files: whatever comes back has the promised shape and finite values.

N points. Everything else ends as one InputError: a line that names the file, what was expected and what came.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from jaxmm.inputs import CSV_COLUMNS, InputError, one_line

ROUNDING = 5e-4  # [m] largest error that storing a coordinate as float32 may bring


class LabelledPoints(NamedTuple):
    """Points that know which object they were measured on."""

    points: np.ndarray  # (N, 3) float32 [m] world frame
    element: np.ndarray  # (N,) int32 categoryID


def read_points(path: Path | str) -> np.ndarray:
    """Positions from a .npy file.

    Returns:
        (N, 3) float32 [m], finite, N >= 1.

    Raises:
        InputError: missing, truncated or no .npy file; objects or text; wrong shape; empty; NaN or infinity;
            coordinates so far from the origin that float32 would shift them.
    """
    array = _read_npy(path)
    if array.ndim != 2 or array.shape[1] != 3:
        raise InputError(f"{path}: expected points of shape (N, 3), got {array.shape}")
    return _as_points(array, path)


def read_labels(path: Path | str, count: int) -> np.ndarray:
    """Labels from a .npy file, one for each of `count` points.

    Returns:
        (N,) bool; True where the file says 1.

    Raises:
        InputError: missing, truncated or no .npy file; another shape than (count,); other values than 0 and 1.
    """
    array = _read_npy(path)
    if array.shape != (count,):
        raise InputError(f"{path}: expected {count} labels, one a point, got shape {array.shape}")
    wrong = array[(array != 0) & (array != 1)]
    if len(wrong):
        raise InputError(f"{path}: expected labels 0 and 1, got {len(wrong)} others, the first {wrong[0]}")
    return array.astype(bool)


def read_csv(path: Path | str) -> LabelledPoints:
    """Points from a text file with the columns X, Y, Z and categoryID, in any order and among others, split by `;`.

    Raises:
        InputError: missing file; a column missing or twice; a value that is no finite number; no rows; a categoryID
            that is no whole number of 32 bits.
    """
    header, _, body = _read_text(path).partition("\n")
    names = [name.strip() for name in header.split(";")]
    if any(names.count(name) != 1 for name in CSV_COLUMNS):
        raise InputError(f"{path}: expected the columns {';'.join(CSV_COLUMNS)} once each, got {';'.join(names)[:200]}")
    columns = [names.index(name) for name in CSV_COLUMNS]
    lines = body.splitlines()
    if not any(line.strip() for line in lines):
        raise InputError(f"{path}: expected at least one row of points, got none")
    try:
        table = np.loadtxt(lines, delimiter=";", usecols=columns, comments=None, ndmin=2)
    except ValueError as error:
        raise InputError(f"{path}: expected rows of numbers split by `;`: {one_line(error)}") from error
    points = _as_points(table[:, :3], path)
    if not _fits_int32(table[:, 3]):
        raise InputError(f"{path}: expected categoryID to hold whole numbers of 32 bits")
    return LabelledPoints(points, table[:, 3].astype(np.int32))


def _read_npy(path: Path | str) -> np.ndarray:
    _check_file(path)
    try:
        # A map checks the promised size against the file's before any memory is taken, and admits no objects.
        with np.errstate(over="ignore"):  # sizes beyond 64 bits are refused, without a warning before
            array = np.lib.format.open_memmap(path, mode="r")
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or one_line(error)}") from error
    except Exception as error:  # NumPy parses the header as Python text, so a damaged one raises almost anything
        raise InputError(f"{path}: expected a whole .npy file of numbers: {one_line(error)}") from error
    if array.dtype.kind not in "bifu":
        raise InputError(f"{path}: expected real numbers, got dtype {array.dtype}")
    return np.array(array)


def _as_points(array: np.ndarray, path: Path | str) -> np.ndarray:
    if not len(array):
        raise InputError(f"{path}: expected at least one point, got none")
    bad = ~np.isfinite(array).all(axis=1)
    if bad.any():
        raise InputError(
            f"{path}: expected finite coordinates, got NaN or infinity in {bad.sum()} points, the first {bad.argmax()}"
        )
    with np.errstate(over="ignore"):  # an overflow is infinitely far from the original, and reported below
        points = array.astype(np.float32)
    error = np.abs(points.astype(np.float64) - array).max()
    if error > ROUNDING:
        raise InputError(f"{path}: coordinates up to {np.abs(array).max():.6g} m do not fit float32; move the origin")
    return np.ascontiguousarray(points)


def _read_text(path: Path | str) -> str:
    _check_file(path)
    try:
        return Path(path).read_text(encoding="utf-8-sig")  # spreadsheets like to put a byte order mark in front
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: expected UTF-8 text, got bytes that are none") from error


def _check_file(path: Path | str) -> None:
    if not Path(path).is_file():
        found = "a folder" if Path(path).is_dir() else "nothing there"
        raise InputError(f"{path}: expected a file, found {found}")


def _fits_int32(values: np.ndarray) -> bool:
    limits = np.iinfo(np.int32)
    return bool(np.all((values == np.rint(values)) & (values >= limits.min) & (values <= limits.max)))
