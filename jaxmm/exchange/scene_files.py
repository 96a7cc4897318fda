"""One scene of an exported benchmark as a folder of plain files, and back."""

import dataclasses
import json
import math
import os
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from jaxmm.exchange.scenes import Scene, Truth
from jaxmm.exchange.tasks import SPLITS, TEST, Task
from jaxmm.files import load_arrays, load_json, write_arrays, write_atomically, write_folder, write_json
from jaxmm.formats.ply_header import read_header
from jaxmm.inputs import InputError
from warp_scanner.buildings.room_ifc import write_room

SCENE, SCAN, MISSES, REFERENCE, MODEL, TRUTH = (
    "scene.json", "scan.ply", "misses.ply", "reference.ply", "model.ifc", "truth.npz",
)  # fmt: skip
_PLY_KINDS = {"<f8": "double", "<f4": "float", "<i4": "int"}
SINGLE = 4096.0  # [m] coordinates that single precision holds to a quarter of a millimetre


class SceneFiles(NamedTuple):
    """What others are given of one scene."""

    name: str
    model: Path
    about: dict[str, Any]  # what scene.json says
    scan: np.ndarray  # (N, 3) float64 [m]
    misses: np.ndarray  # (K, 3) float64 unit vectors
    reference: np.ndarray  # (M, 3) float64 [m]
    element: np.ndarray  # (M,) int32 row of about["elements"]; -1 for all else


def write_scene(folder: Path, scene: Scene, task: Task) -> None:
    """Write the folder of a scene, whole or not at all; with its truth, unless it is of the test split."""
    write_folder(folder, lambda work: _write(work, scene, task, folder))


def _write(work: Path, scene: Scene, task: Task, folder: Path) -> None:
    model, guids = MODEL, {one.number: one.guid for one in scene.elements}
    if isinstance(scene.model, Path):
        model = os.path.relpath(folder.parents[1] / "buildings" / scene.model.name, folder)
    else:
        guids = write_room(work / MODEL, scene.model, 0, f"scene {task.name}")
    write_ply_table(work / SCAN, points_table(scene.scan))
    write_ply_table(work / MISSES, points_table(scene.misses))
    write_ply_table(work / REFERENCE, points_table(scene.reference, {"element": scene.element}))
    about = {
        "name": task.name,
        "split": task.split,
        "model": Path(model).as_posix(),
        "pose": {
            "position": scene.position.tolist(), "yaw": scene.angles[0], "pitch": scene.angles[1],
            "rotation": scene.rotation.tolist(),
        },
        "sensor": {"name": task.sensor, "kind": type(scene.sensor).__name__.lower()} | _plain(scene.sensor),
        "points": {"scan": len(scene.scan), "misses": len(scene.misses), "reference": len(scene.reference)},
        "elements": [{"guid": guids[one.number], "class": one.kind} for one in scene.elements],
    }  # fmt: skip
    write_json(work / SCENE, about)
    if task.split != TEST:
        write_arrays(work / TRUTH, scene.truth._asdict())


def points_table(points: np.ndarray, more: dict[str, np.ndarray] | None = None) -> np.ndarray:
    """(N,) structured array of points (N, 3) [m] and of further columns; single precision where that is exact."""
    kind = "<f8" if len(points) and np.abs(points).max() >= SINGLE else "<f4"
    columns = {axis: points[:, number].astype(kind) for number, axis in enumerate("xyz")} | (more or {})
    table = np.zeros(len(points), [(name, column.dtype) for name, column in columns.items()])
    for name, column in columns.items():
        table[name] = column
    return table


def write_ply_table(path: Path, table: np.ndarray) -> None:
    """Write a structured array (N,) as the vertices of a binary PLY file, in the types that it has."""
    fields = table.dtype.fields.items()
    properties = "".join(f"property {_PLY_KINDS[kind.str]} {name}\n" for name, (kind, _) in fields)
    header = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(table)}\n{properties}end_header\n"
    write_atomically(path, lambda temporary: temporary.write_bytes(header.encode() + table.tobytes()))


def _plain(sensor: Any) -> dict[str, Any]:
    """Settings of a sensor without what JSON cannot say: null is no limit."""
    text = json.dumps(dataclasses.asdict(sensor))
    return json.loads(text, parse_constant=lambda word: None if "Infinity" in word else math.nan)


def scene_names(folder: Path, split: str) -> list[str]:
    """Names of the scenes of a split.

    Raises:
        InputError: there are none.
    """
    if names := _names(folder, split):
        return names
    others = [f"--split {other} has {count}" for other in SPLITS if (count := len(_names(folder, other)))]
    told = f"; {', '.join(others)}" if others else ""
    raise InputError(
        f"{folder}: expected a folder of jaxmm benchmark export with scenes of the split {split}, found none{told}"
    )


def split_of(folder: Path, predictions: Path, split: str) -> str:
    """The split whose scenes all have a file in a folder of predictions, if it is not the one asked for; else empty."""
    told = {path.stem for path in predictions.iterdir()}
    whole = [one for one in SPLITS if (names := _names(folder, one)) and told.issuperset(names)]
    return "" if split in whole or not whole else whole[0]


def _names(folder: Path, split: str) -> list[str]:
    return sorted(path.parent.name for path in (folder / split).glob(f"*/{SCENE}"))


def read_about(folder: Path, split: str, name: str) -> dict[str, Any]:
    """What scene.json says.

    Raises:
        InputError: it is missing or damaged.
    """
    about = load_json(folder / split / name / SCENE)
    try:
        counts = [int(about["points"][what]) for what in ("scan", "misses", "reference")]
        known = all(isinstance(one["guid"], str) and isinstance(one["class"], str) for one in about["elements"])
        if not known or min(counts) < 0 or about["name"] != name or not isinstance(about["model"], str):
            raise ValueError("contents")
    except (TypeError, KeyError, ValueError) as error:
        raise InputError(f"{folder / split / name / SCENE}: expected what jaxmm benchmark export wrote") from error
    return about


def read_scene(folder: Path, split: str, name: str) -> SceneFiles:
    """What others are given of a scene.

    Raises:
        InputError: a file is missing or damaged.
    """
    place, about = folder / split / name, read_about(folder, split, name)
    scan, misses, reference = (
        _read_table(place / file, about["points"][what])
        for file, what in ((SCAN, "scan"), (MISSES, "misses"), (REFERENCE, "reference"))
    )
    element = reference["element"].astype(np.int32)
    return SceneFiles(
        name, (place / about["model"]).resolve(), about, _points(scan), _points(misses), _points(reference), element
    )


def _points(table: np.ndarray) -> np.ndarray:
    return np.column_stack([table[axis].astype(np.float64) for axis in "xyz"])


def _read_table(path: Path, count: int) -> np.ndarray:
    """(N,) structured array of the vertices of one of our own files."""
    if not path.is_file():
        raise InputError(f"{path}: expected a file that jaxmm benchmark export wrote, found none")
    with open(path, "rb") as file:
        elements, order, *_ = read_header(path, file)
        (vertex, *others), begin = elements, file.tell()
        kind = np.dtype([(one.name, one.kind) for one in vertex.properties])
        whole = begin + count * kind.itemsize == path.stat().st_size
        if order != "<" or others or vertex.count != count or not whole or not set("xyz") <= set(kind.names):
            raise InputError(f"{path}: expected {count} points as jaxmm benchmark export wrote them")
        return np.fromfile(file, kind, count)


def read_truth(folder: Path, split: str, names: list[str], truth: Path) -> dict[str, Truth]:
    """The truth about some scenes; that of the test split is in the file `truth`.

    Raises:
        InputError: it is missing or damaged.
    """
    if split != TEST:
        return {name: _truth(load_arrays(folder / split / name / TRUTH), folder / split / name / TRUTH)
                for name in names}  # fmt: skip
    if not truth.is_file():
        raise InputError(f"--truth: expected the truth of the test split, found no file {truth}")
    arrays = load_arrays(truth)
    by_name: dict[str, dict[str, np.ndarray]] = {name: {} for name in names}
    for key, value in arrays.items():
        name, _, field = key.partition("/")
        if name in by_name:
            by_name[name][field] = value
    return {name: _truth(fields, f"{truth}: {name}") for name, fields in by_name.items()}


def _truth(arrays: dict[str, np.ndarray], where: Path | str) -> Truth:
    if set(arrays) != set(Truth._fields):
        raise InputError(
            f"{where}: expected the arrays {', '.join(Truth._fields)}, found {', '.join(arrays) or 'none'}"
        )
    return Truth(**arrays)
