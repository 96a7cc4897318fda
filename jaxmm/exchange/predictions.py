"""What a method says of one scene, in a file of its own: NPZ arrays, or CSV.

N returns of the robot scan, M of the scan of the model, E walls and pillars of the model, K objects found.
"""

import csv
import math
import zipfile
from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from jaxmm.exchange.scenes import LABELS, SAME, UNOBSERVABLE
from jaxmm.inputs import InputError, clipped, one_line
from jaxmm.learning.boxes import Box

COLUMNS = ("kind", "index", "score", "label", "x", "y", "z", "length", "width", "height", "rotation")
POINTS, ELEMENTS, OBJECTS = ("scan", "reference"), "elements", "objects"
_NUMBERS = COLUMNS[3:]  # of an object, before its score
MOST_OBJECTS = 10_000  # of one scene


class Prediction(NamedTuple):
    """What a method says; None of what it does not say anything about."""

    scan: np.ndarray | None  # (N,) float64, the higher the rather new
    reference: np.ndarray | None  # (M,) float64, the higher the rather gone
    elements: np.ndarray | None  # (E,) float64 P(removed); NaN: it does not tell
    objects: list[tuple[str, Box]] | None  # "added" | "removed", and the box with its probability


def read_prediction(folder: Path, name: str, counts: dict[str, int]) -> Prediction:
    """The prediction for a scene.

    Args:
        folder: of one file a scene.
        name: of the scene.
        counts: {"scan": N, "reference": M, "elements": E}.

    Raises:
        InputError: it is missing or ill-formed; the line names the scene and the column.
    """
    paths = [path for path in (folder / f"{name}.npz", folder / f"{name}.csv") if path.is_file()]
    if not paths:
        raise InputError(f"{folder}: scene {name}: expected {name}.npz or {name}.csv, found neither")
    path = paths[0]
    columns = _from_npz(path, name, counts) if path.suffix == ".npz" else _from_csv(path, name, counts)
    for column, values in columns.items():
        _check(values, column, f"{path}: scene {name}: column {column}", counts)
    objects = columns.get(OBJECTS)
    return Prediction(
        *(columns.get(column) for column in (*POINTS, ELEMENTS)),
        objects=None if objects is None else [_box(row) for row in objects],
    )


def _check(values: np.ndarray, column: str, where: str, counts: dict[str, int]) -> None:
    if column == OBJECTS:
        if values.ndim != 2 or values.shape[1] != 9 or len(values) > MOST_OBJECTS:
            raise InputError(f"{where}: expected (K, 9) numbers, got {values.shape}")
        known = np.isin(values[:, 0], range(SAME + 1, UNOBSERVABLE))
        if not known.all():
            got = values[~known, 0][0]
            raise InputError(f"{where}: expected labels {SAME + 1} to {UNOBSERVABLE - 1}, got {got:g}")
        if not np.isfinite(values).all() or np.any(values[:, 4:7] <= 0.0):
            raise InputError(f"{where}: expected finite numbers, and edges above 0")
        probability = values[:, 8]
    else:
        if values.shape != (counts[column],):
            raise InputError(f"{where}: expected {counts[column]} numbers, got {_shape(values)}")
        if column in POINTS:
            if not np.isfinite(values).all():
                raise InputError(f"{where}: expected finite numbers, got {np.sum(~np.isfinite(values))} that are not")
            return
        probability = values[~np.isnan(values)]
    if np.any((probability < 0.0) | (probability > 1.0)):
        raise InputError(f"{where}: expected probabilities from 0 to 1, got {probability.min():g} to "
                         f"{probability.max():g}")  # fmt: skip


def _shape(values: np.ndarray) -> str:
    return str(len(values)) if values.ndim == 1 else str(values.shape)


def _box(row: np.ndarray) -> tuple[str, Box]:
    kind, change = LABELS[int(row[0])].split("_")
    return change, Box(kind, row[1:4], row[4:7], float(row[7]), probability=float(row[8]))


def _from_npz(path: Path, name: str, counts: dict[str, int]) -> dict[str, np.ndarray]:
    most = {column: 16 * counts[column] for column in (*POINTS, ELEMENTS)} | {OBJECTS: 16 * 9 * MOST_OBJECTS}
    columns = {}
    try:
        with zipfile.ZipFile(path) as archive:
            sizes = {one.filename.removesuffix(".npy"): one.file_size for one in archive.infolist()}
        for column in most.keys() & sizes.keys():
            if sizes[column] > most[column] + 1000:  # before any memory is taken for it
                raise InputError(f"{path}: scene {name}: column {column}: expected {counts.get(column, 'a few')} "
                                 f"numbers, got {sizes[column]} bytes")  # fmt: skip
        with np.load(path, allow_pickle=False) as arrays:
            for column in most:
                if column in sizes:
                    columns[column] = arrays[column]
    except InputError:
        raise
    except Exception as error:  # a damaged archive raises almost anything
        raise InputError(f"{path}: scene {name}: expected an NPZ file of plain numbers: {one_line(error)}") from error
    for column, values in columns.items():
        if values.dtype.kind not in "biuf":
            raise InputError(f"{path}: scene {name}: column {column}: expected real numbers, got dtype {values.dtype}")
    if not columns:
        raise InputError(f"{path}: scene {name}: expected some of the columns {', '.join(most)}, found none")
    return {column: values.astype(np.float64) for column, values in columns.items()}


def _from_csv(path: Path, name: str, counts: dict[str, int]) -> dict[str, np.ndarray]:
    kinds = {"scan": "scan", "reference": "reference", "element": ELEMENTS}
    columns: dict[str, np.ndarray] = {}
    objects: list[list[float]] = []
    for row in _rows(path, name):
        where, kind = f"{path}: scene {name}: line {row['line']}", row["kind"]
        if kind == "object":
            objects.append([_number(row, column, where) for column in (*_NUMBERS, "score")])
            if len(objects) > MOST_OBJECTS:
                raise InputError(f"{where}: column kind: expected up to {MOST_OBJECTS} objects")
            continue
        if kind not in kinds:
            raise InputError(f"{where}: column kind: expected {', '.join(kinds)} or object, got {clipped(repr(kind))}")
        column, index = kinds[kind], _number(row, "index", where)
        values = columns.setdefault(column, np.full(counts[column], np.inf))
        if not 0 <= index < len(values) or index != int(index) or values[int(index)] != np.inf:
            raise InputError(f"{where}: column index: expected each of 0 to {len(values) - 1} once, got {index:g}")
        told = kind != "element" or row["score"] != ""
        values[int(index)] = _number(row, "score", where) if told else np.nan
    for column, values in columns.items():
        if missing := int(np.sum(values == np.inf)):
            raise InputError(
                f"{path}: scene {name}: column {column}: expected {len(values)} rows, {missing} are missing"
            )
    return columns | ({OBJECTS: np.array(objects)} if objects else {})


def _rows(path: Path, name: str) -> Iterable[dict[str, Any]]:
    try:
        with open(path, encoding="utf-8-sig", newline="") as file:
            rows = csv.reader(file)
            header = [cell.strip() for cell in next(rows, [])]
            for column in ("kind", "index", "score"):
                if header.count(column) != 1:
                    raise InputError(
                        f"{path}: scene {name}: column {column}: expected once, found {header.count(column)}"
                    )
            for number, row in enumerate(rows, 2):
                if any(row):
                    yield dict(zip(header, map(str.strip, row), strict=False)) | {"line": number}
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path}: scene {name}: expected a CSV file: {one_line(error)}") from error


def _number(row: dict[str, Any], column: str, where: str) -> float:
    text = row.get(column, "")
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(f"{where}: column {column}: expected a finite number, got {clipped(repr(text))}")
    return value
