"""Our own records as plain arrays and back: what a station gives and keeps, as a file that holds no program.

A record is a NamedTuple or frozen dataclass of this package, a tuple, list or dict of records, an array, a number, a
text or None. Only the kinds that stand here are made of what a file says, and arrays come back to the bit.

A file is eight bytes that say what it is, the length of its head in eight more, the head in JSON (how the arrays belong
together, and of each its type, shape, order and checksum), and the bytes of one array after the other. A .npz of the
same takes three times as long to write and to read.
"""

import dataclasses
import hashlib
import itertools
import json
import os
import zlib
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from jaxmm.classes.telling_rays import Telling
from jaxmm.deviations.element_motion import Seen
from jaxmm.deviations.fits import Fit
from jaxmm.deviations.heights import Heights
from jaxmm.deviations.pose_errors import PoseError
from jaxmm.deviations.seen_surfaces import Faces
from jaxmm.deviations.shifted_columns import Beside
from jaxmm.files import REMEDY
from jaxmm.formats.dates import Taken
from jaxmm.formats.poses import GivenPose
from jaxmm.formats.readers import PointScan
from jaxmm.inputs import InputError
from jaxmm.learning.prediction import Side
from jaxmm.objects.main_directions import Uprights
from jaxmm.objects.usual_sizes import OwnElements
from jaxmm.objects.walls import KnownBuilding
from jaxmm.rays.evidence import Frame, View
from jaxmm.rays.joint_poses import Held, Station
from jaxmm.rays.patches import Patches
from jaxmm.rays.scan_rays import PosedScan, ScanRays
from jaxmm.stations.sources import ScanSource
from jaxmm.verdicts.behind_removed import Again, Past, Says
from jaxmm.verdicts.named_scans import NamedScan
from jaxmm.verdicts.placement import Placed
from jaxmm.verdicts.priors import Prior
from jaxmm.verdicts.results import PriorFile
from jaxmm.verdicts.scan_frames import Motion, OwnScan
from jaxmm.verdicts.scan_fusion import Looked
from jaxmm.verdicts.standing_alone import Alone
from jaxmm.verdicts.station_steps import Judged, Shown, Stood
from jaxmm.verdicts.verdicts import Told
from warp_scanner.scenes.building import Building, Elements, Failure, Pieced, Source, Storeys, Triangles, Twin, Whole
from warp_scanner.sensors.imperfections import Imperfections
from warp_scanner.sensors.sensors import Pinhole, Spinning

KINDS = {
    kind.__name__: kind
    for kind in (
        Again, Alone, Beside, Building, Elements, Faces, Failure, Fit, Frame, GivenPose, Heights, Held,
        Imperfections, Judged, KnownBuilding, Looked, Motion, NamedScan, OwnElements, OwnScan, Past, Patches, Pieced,
        Pinhole, Placed, PointScan, PoseError, PosedScan, Prior, PriorFile, Says, ScanRays, ScanSource, Seen, Shown,
        Side, Source, Spinning, Station, Stood, Storeys, Taken, Telling, Told, Triangles, Twin, Uprights, View, Whole,
    )
}  # fmt: skip
PLAIN = {"array", "number", "dict", "tuple", "list"}
MARK = b"jaxmm\x00r\x01"  # of a file of this kind, and how its head is to be read
SUFFIX = ".record"


def write_record(path: Path, value: Any) -> None:
    """Write a record, whole or not at all.

    It is not forced to the disk: what the loss of power leaves damaged is told when it is read, and done again.
    """
    arrays: dict[str, np.ndarray] = {}
    tree = _taken_apart(value, arrays)
    if strange := _kinds_in(tree) - KINDS.keys() - PLAIN:
        raise TypeError(f"expected a record of {', '.join(KINDS)}, got {', '.join(sorted(strange))}")
    rows, parts = zip(*map(_laid_out, arrays.values()), strict=True) if arrays else ((), ())
    head = json.dumps([tree, rows]).encode()
    temporary = path.with_name(f".{path.name}.tmp")
    try:
        with open(temporary, "wb") as file:
            for part in (MARK, len(head).to_bytes(8, "little"), head, *parts):
                file.write(part)
        os.replace(temporary, path)
    except OSError as error:  # of a full disk does not say on which file
        raise OSError(error.errno, error.strerror, str(path)) from error
    finally:
        temporary.unlink(missing_ok=True)


def read_record(path: Path) -> Any:
    """What `write_record` wrote.

    Raises:
        InputError: the file is missing, damaged, or holds something else.
    """
    try:
        with open(path, "rb") as file:
            if file.read(len(MARK)) != MARK:
                raise ValueError("another kind of file")
            tree, rows = json.loads(file.read(int.from_bytes(file.read(8), "little")))
            arrays = {str(number): _read_array(file, *row) for number, row in enumerate(rows)}
    except (OSError, ValueError, TypeError, OverflowError, MemoryError) as error:
        raise InputError(f"{path}: expected a file that a run wrote, found it missing or damaged; {REMEDY}") from error
    try:
        return _put_together(tree, arrays)
    except (KeyError, ValueError, TypeError) as error:
        raise InputError(f"{path}: expected a record of a station, found something else") from error


def _laid_out(array: np.ndarray) -> tuple[tuple[str, tuple[int, ...], str, int], memoryview]:
    """Type, shape, order and checksum of an array, and its bytes in that order."""
    if array.dtype.hasobject or array.dtype.names:
        raise TypeError(f"expected a record of plain arrays, got one of {array.dtype}")
    # In the order that it has: products of the same numbers in another order come out otherwise.
    by_column = array.flags.f_contiguous and not array.flags.c_contiguous
    plain = np.ascontiguousarray(array.T if by_column else array)
    content = plain.reshape(-1).view(np.uint8).data
    return (array.dtype.str, array.shape, "F" if by_column else "C", zlib.crc32(content)), content


def _read_array(file: BinaryIO, kind: str, shape: list[int], order: str, checksum: int) -> np.ndarray:
    array = np.zeros(shape[::-1] if order == "F" else shape, np.dtype(kind))
    content = array.reshape(-1).view(np.uint8).data
    if file.readinto(content) != len(content) or zlib.crc32(content) != checksum:
        raise ValueError("fewer bytes than were written, or others")
    return array.T if order == "F" else array


def digest_of(*values: Any) -> str:
    """Half of the sha256 of some records: equal ones have the same, in any process."""
    arrays: dict[str, np.ndarray] = {}
    digest = hashlib.sha256(json.dumps(_taken_apart(values, arrays)).encode())
    for one in arrays.values():
        digest.update(str((one.dtype.str, one.shape)).encode() + np.ascontiguousarray(one).tobytes())
    return digest.hexdigest()[:32]


def _taken_apart(value: Any, arrays: dict[str, np.ndarray]) -> Any:
    """A record as JSON, with the names of its arrays in place of these."""
    if value is None or (isinstance(value, bool | int | float | str) and not isinstance(value, np.generic)):
        return value
    if isinstance(value, np.ndarray | np.generic):
        name = str(len(arrays))
        arrays[name] = np.asarray(value)
        return ["number" if isinstance(value, np.generic) else "array", name]
    if isinstance(value, dict):
        return ["dict", [[_taken_apart(one, arrays) for one in pair] for pair in value.items()]]
    kind = type(value).__name__
    if dataclasses.is_dataclass(value):
        return [kind, [_taken_apart(getattr(value, one.name), arrays) for one in dataclasses.fields(value)]]
    if isinstance(value, tuple | list):
        return [kind, [_taken_apart(one, arrays) for one in value]]
    raise TypeError(f"expected a record, got {kind}")


def _kinds_in(tree: Any) -> set[str]:
    """Names of all kinds that a record is made of."""
    if not isinstance(tree, list):
        return set()
    kind, parts = tree
    if kind in ("array", "number"):
        return {kind}
    parts = itertools.chain(*parts) if kind == "dict" else parts
    return {kind}.union(*(_kinds_in(one) for one in parts))


def _put_together(tree: Any, arrays: dict[str, np.ndarray]) -> Any:
    if not isinstance(tree, list):
        return tree
    kind, parts = tree
    if kind == "array":
        return arrays[parts]
    if kind == "number":
        return arrays[parts][()]
    if kind == "dict":
        return {_put_together(name, arrays): _put_together(value, arrays) for name, value in parts}
    values = [_put_together(one, arrays) for one in parts]
    if kind in ("tuple", "list"):
        return tuple(values) if kind == "tuple" else values
    return KINDS[kind](*values)
