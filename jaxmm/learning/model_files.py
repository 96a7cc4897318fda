"""Trained models as files: tensors by name, and the settings that they were trained with."""

from pathlib import Path
from typing import Any

import numpy as np
import safetensors
import safetensors.numpy
import tomli_w

from jaxmm.config import SCENARIOS, TRAINED_METHODS, Config, parse
from jaxmm.files import write_atomically
from jaxmm.inputs import InputError, clipped, one_line
from jaxmm.learning.calibration import KNOTS, Calibration
from jaxmm.learning.model import Model, Offset, offset_of, shapes_of
from jaxmm.run_folder import MODELS, as_table, read_config


def save_models(path: Path, models: dict[str, Model], config: Config) -> None:
    """Export trained models: tensors `<method>/params|batch_stats/<layer>/<name>`, S on axis 0; and the settings.

    Calibrated ones also have `<method>/calibration/logit|calibrated`, those that correct the rule
    `<method>/offset/removed|scale`.
    """
    nested = {method: _as_dict(model) for method, model in models.items()}
    tensors = {"/".join(key): np.ascontiguousarray(value) for key, value in _flat(nested).items()}
    metadata = {"config": tomli_w.dumps(as_table(config))}
    write_atomically(path, lambda temporary: temporary.write_bytes(safetensors.numpy.save(tensors, metadata)))


def load_models(path: Path) -> tuple[dict[str, Model], Config]:
    """Trained models by method, and the settings they were trained with, from a run folder or a .safetensors file.

    Raises:
        InputError: there is no such file, or it does not hold models of ours.
    """
    if path.is_dir():
        read_config(path)
        path = path / MODELS
    if not path.is_file():
        raise InputError(f"{path}: expected trained models, found no file")
    try:
        with safetensors.safe_open(path, framework="numpy") as file:
            metadata = file.metadata() or {}
            tensors = {tuple(name.split("/")): file.get_tensor(name) for name in file.keys()}
    except (safetensors.SafetensorError, OSError) as error:
        raise InputError(f"{path}: not a whole safetensors file: {one_line(error)}") from error
    if "config" not in metadata:
        raise InputError(
            f"{path}: expected settings in the metadata under `config`, found {clipped(str(sorted(metadata)))}"
        )
    config = parse(metadata["config"], where=f"{path}: config")
    for method in config.train.methods:
        kernel = tensors.get((method, "params", "conv1", "kernel"))
        if kernel is not None and kernel.ndim == 3 and kernel.shape[1] != TRAINED_METHODS[method]:
            wanted = f"{TRAINED_METHODS[method]} features for {method}, got {kernel.shape[1]}"
            raise InputError(f"{path}: expected {wanted}; it was trained by another version, train it again")
    methods = [method for method in TRAINED_METHODS if method in config.train.methods]
    if {name: (value.shape, value.dtype) for name, value in tensors.items()} != _expected(methods, config):
        raise InputError(f"{path}: expected the tensors of {', '.join(methods)} as its settings say, found others")
    if not all(np.isfinite(value).all() for value in tensors.values()):
        raise InputError(f"{path}: expected finite numbers, got NaN or infinity")
    return {method: model_of(parts) for method, parts in _nested(tensors).items()}, config


def model_of(parts: dict[str, Any]) -> Model:
    """A model of its parts by name, as a file holds them."""
    knots, offset = parts.get("calibration"), parts.get("offset")
    more = (knots and Calibration(**knots), offset and Offset(**offset))
    return Model(parts["params"], parts["batch_stats"], *more)


def _expected(methods: list[str], config: Config) -> dict[tuple[str, ...], tuple[tuple[int, ...], np.dtype]]:
    """Shape and type of each tensor of a whole file."""
    shapes = {
        (method, *name): shape
        for method in methods
        for name, shape in shapes_of(TRAINED_METHODS[method], config.network).items()
    }
    calibrated = (method for method in methods if method in config.train.calibrate)
    shapes |= {(method, "calibration", name): (KNOTS,) for method in calibrated for name in Calibration._fields}
    correcting = (method for method in methods if offset_of(method, (0,), config.train) is not None)
    shapes |= {(method, "offset", name): () for method in correcting for name in Offset._fields}
    return {name: ((len(SCENARIOS), *shape), np.dtype(np.float32)) for name, shape in shapes.items()}


def _flat(nested: dict[str, Any]) -> dict[tuple[str, ...], np.ndarray]:
    """Leaves by the path to each."""
    flat = {}
    for name, value in nested.items():
        below = _flat(value) if isinstance(value, dict) else {(): np.asarray(value)}
        flat |= {(name, *path): leaf for path, leaf in below.items()}
    return flat


def _nested(flat: dict[tuple[str, ...], np.ndarray]) -> dict[str, Any]:
    nested: dict[str, Any] = {}
    for path, leaf in flat.items():
        place = nested
        for name in path[:-1]:
            place = place.setdefault(name, {})
        place[path[-1]] = leaf
    return nested


def _as_dict(model: Model) -> dict[str, Any]:
    """Its parts, without those that are not there."""
    parts = {"params": model.params, "batch_stats": model.batch_stats}
    more = {"calibration": model.calibration, "offset": model.offset}
    return parts | {name: part._asdict() for name, part in more.items() if part is not None}
