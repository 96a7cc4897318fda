"""Scan files, read: the points of one scan or several, and where they were taken from if the file says so.

PLY (ascii, binary), PCD (ascii, binary, compressed), E57 and PTX (several scans, with poses), LAS and LAZ, CSV (`;` or
`,`), NPY and NPZ, XYZ and PTS text, legacy VTK, bags of ROS, folders of depth images.

N points. World frame of the file, in its units. Coordinates come as float64, as national grids need.
"""

import functools
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from jaxmm.formats.arrays import read_npy, read_npz
from jaxmm.formats.bags import ENDINGS as BAGS
from jaxmm.formats.bags import is_bag, read_bag
from jaxmm.formats.depth_images import read_depth_folder
from jaxmm.formats.e57 import read_e57
from jaxmm.formats.las import read_las
from jaxmm.formats.pcd import read_pcd
from jaxmm.formats.ply import read_ply
from jaxmm.formats.ptx import read_ptx
from jaxmm.formats.raw_scans import FARTHEST, RawScan, drawn_together, nearer, returned
from jaxmm.formats.text import read_text
from jaxmm.formats.vtk import read_vtk
from jaxmm.inputs import InputError, one_line

READERS: dict[str, Callable[[Path], list[RawScan]]] = {
    ".ply": read_ply, ".pcd": read_pcd, ".e57": read_e57, ".las": read_las, ".laz": read_las, ".csv": read_text,
    ".npy": read_npy, ".npz": read_npz, ".xyz": read_text, ".txt": read_text, ".asc": read_text,
    ".pts": read_text, ".ptx": read_ptx, ".vtk": read_vtk,
}  # fmt: skip
EXTRA = "needs the extra formats: pip install 'jaxmm[formats]'"


class NoPoints(InputError):
    """A scan in which nothing came back; beside others in a file it is left out."""


class PointScan(NamedTuple):
    """The points of one scan."""

    points: np.ndarray  # (N, 3) float64, finite
    position: np.ndarray | None  # (3,) float64 of the sensor, same frame; None where the file does not say
    rotation: np.ndarray | None  # (3, 3) float64 sensor frame to world
    remarks: tuple[str, ...]  # what was left out, in words
    in_world: bool = False  # the file's points are in the sensor's frame, and were taken to the world by that pose
    frame: str | None = None  # "sensor" or "optical" where the file says what its points' own frame is; None: untold
    taken: str | None = None  # when, as of `dates`; None where the file does not say
    # (K, 3) float32 unit vectors, in the sensor's frame, of rays that brought nothing back; None: the file tells none.
    unseen: np.ndarray | None = None


def read_scans(path: Path | str, topic: str | None = None, only: int | None = None) -> list[PointScan]:
    """All scans of a file, or of a folder of depth images; one, but for these, E57, PTX, PTS and bags.

    Scans without points beside others are left out, and the first one's remarks say so.

    Args:
        path: of the file or folder.
        topic: of the clouds in a bag; None: the only one. Other files have none.
        only: number of one of the scans in an E57 file; None: all.

    Raises:
        InputError: one line that names the file and what is wrong with it: missing, of an unknown ending, of another
            format than its ending says, truncated, without points, or without a library to read it.
    """
    path = Path(path)
    reader = _reader(path, topic) if only is None else functools.partial(read_e57, only=only)
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            found = reader(path)
    except InputError:
        raise
    except ImportError as error:
        raise InputError(f"{path}: {EXTRA}") from error
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or _line(error)}") from error
    except MemoryError as error:
        raise InputError(f"{path}: promises more points than fit into memory") from error
    except Exception as error:  # libraries raise almost anything on a damaged file
        kind = "folder" if path.is_dir() else f"{path.suffix} file"
        raise InputError(f"{path}: expected a whole {kind}: {_line(error)}") from error
    return _with_points(path, found)


def _reader(path: Path, topic: str | None) -> Callable[[Path], list[RawScan]]:
    if path.exists() and is_bag(path):
        return functools.partial(read_bag, topic=topic)
    if path.is_dir():
        return read_depth_folder
    if not path.is_file():
        raise InputError(f"{path}: expected a scan file, or a folder of depth images, found nothing there")
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        endings = ", ".join((*READERS, *BAGS))
        raise InputError(f"{path}: expected a scan ending in {endings}, got {path.suffix or 'no ending'}")
    if not path.stat().st_size:
        raise InputError(f"{path}: expected points, found an empty file")
    return reader


def _with_points(path: Path, found: list[RawScan]) -> list[PointScan]:
    """The scans that hold points, checked; `found` is emptied, as a large scan is let go when it is copied."""
    count, kept, empty = len(found), [], InputError(f"{path}: expected at least one scan, found none")
    for _ in range(count):
        try:
            kept.append(_checked(path, found.pop(0)))
        except NoPoints as error:
            empty = error
    if not kept:
        raise empty
    if len(kept) < count:
        left = f"{count - len(kept)} of {count} scans hold no points and are left out"
        kept[0] = kept[0]._replace(remarks=(left, *kept[0].remarks))
    return kept


def _checked(path: Path, raw: RawScan) -> PointScan:
    points = np.asarray(raw.points, np.float64)
    if points.ndim != 2 or points.shape[1] != 3:
        raise InputError(f"{path}: expected points of shape (N, 3), got {points.shape}")
    count, there = len(points), nearer(points, FARTHEST)
    if not there.any():
        raise NoPoints(f"{path}: expected points with finite coordinates, got none among {count}")
    remarks = raw.remarks
    if lost := count - int(there.sum()):
        remarks += (f"{lost} of {count} points have no finite coordinates and are left out",)
        points = drawn_together(points, there)
    points, told = returned(points)
    if all(np.ptp(points[:, axis]) == 0.0 for axis in range(3)):
        raise NoPoints(f"{path}: expected points in space, got {len(points)} times the same one")
    posed = raw.position is not None and np.isfinite(raw.position).all() and np.isfinite(raw.rotation).all()
    position, rotation = (raw.position, raw.rotation) if posed else (None, None)
    in_world, unseen = posed and raw.in_world, raw.unseen if posed else None
    return PointScan(points, position, rotation, (*remarks, *told), in_world, raw.frame, raw.taken, unseen)


def _line(error: Exception) -> str:
    """What a library says, where it is worth saying: a missing key or place in a list tells no user anything."""
    if isinstance(error, LookupError | AttributeError | TypeError | AssertionError):
        return f"its parts do not fit together ({type(error).__name__})"
    return one_line(error)
