"""Our own records as plain arrays and back: what a station gives and keeps, as a .npz that holds no program.

A record is a NamedTuple or frozen dataclass of this package, a tuple, list or dict of records, an array, a number, a
text or None. Only the kinds that stand here are made of what a file says, and arrays come back to the bit.
"""

import dataclasses
import hashlib
import itertools
import json
from pathlib import Path
from typing import Any

import numpy as np

from jaxmm.classes.telling_rays import Telling
from jaxmm.deviations.deviation import Faces
from jaxmm.deviations.element_motion import Seen
from jaxmm.deviations.fits import Fit
from jaxmm.deviations.pose_errors import PoseError
from jaxmm.deviations.shifted_columns import Beside
from jaxmm.files import load_arrays, write_arrays
from jaxmm.formats.dates import Taken
from jaxmm.formats.poses import GivenPose
from jaxmm.formats.readers import PointScan
from jaxmm.inputs import InputError
from jaxmm.learning.prediction import Side
from jaxmm.objects.main_directions import Uprights
from jaxmm.objects.usual_sizes import OwnElements
from jaxmm.objects.walls import KnownBuilding
from jaxmm.rays.evidence import Frame, View
from jaxmm.rays.scan_rays import PosedScan, ScanRays
from jaxmm.stations.sources import ScanSource
from jaxmm.verdicts.behind_removed import Again, Past, Says
from jaxmm.verdicts.mismatches import Looked
from jaxmm.verdicts.named_scans import NamedScan
from jaxmm.verdicts.placement import Placed
from jaxmm.verdicts.priors import Prior
from jaxmm.verdicts.results import PriorFile
from jaxmm.verdicts.scan_frames import OwnScan
from jaxmm.verdicts.standing_alone import Alone
from jaxmm.verdicts.station_steps import Judged, Shown, Stood
from jaxmm.verdicts.verdicts import Told
from warp_scanner.scenes.building import Building, Elements, Failure, Source, Storeys, Triangles, Twin, Whole
from warp_scanner.sensors.imperfections import Imperfections
from warp_scanner.sensors.sensors import Pinhole, Spinning

KINDS = {
    kind.__name__: kind
    for kind in (
        Again, Alone, Beside, Building, Elements, Faces, Failure, Fit, Frame, GivenPose, Imperfections, Judged,
        KnownBuilding, Looked, NamedScan, OwnElements, OwnScan, Past, Pinhole, Placed, PointScan, PosedScan, PoseError,
        Prior, PriorFile, Says, ScanRays, Seen, Shown, Side, ScanSource, Spinning, Stood, Storeys, Told, Triangles,
        Source, Taken, Telling, Twin, Uprights, View, Whole,
    )
}  # fmt: skip
PLAIN = {"array", "number", "dict", "tuple", "list"}
TREE = "tree"  # the array that says how the others belong together


def write_record(path: Path, value: Any) -> None:
    """Write a record, whole or not at all."""
    arrays: dict[str, np.ndarray] = {}
    tree = _taken_apart(value, arrays)
    if strange := _kinds_in(tree) - KINDS.keys() - PLAIN:
        raise TypeError(f"expected a record of {', '.join(KINDS)}, got {', '.join(sorted(strange))}")
    arrays[TREE] = np.frombuffer(json.dumps(tree).encode(), np.uint8)
    write_arrays(path, arrays)


def read_record(path: Path) -> Any:
    """What `write_record` wrote.

    Raises:
        InputError: the file is missing, damaged, or holds something else.
    """
    arrays = load_arrays(path)
    try:
        return _put_together(json.loads(arrays[TREE].tobytes()), arrays)
    except (KeyError, ValueError, TypeError) as error:
        raise InputError(f"{path}: expected a record of a station, found something else") from error


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
