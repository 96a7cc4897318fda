"""Trained models as files: tensors by name, and the settings that they were trained with."""

from pathlib import Path
from typing import Any

import jax
import numpy as np
import safetensors
import safetensors.numpy
import tomli_w
from flax.traverse_util import flatten_dict, unflatten_dict

from jaxmm.config import SCENARIOS, TRAINED_METHODS, Config, parse
from jaxmm.files import write_atomically
from jaxmm.inputs import InputError, clipped, one_line
from jaxmm.learning.calibration import KNOTS, Calibration
from jaxmm.learning.train_step import Model, init_all
from jaxmm.run_folder import MODELS, as_table, read_config


def save_models(path: Path, models: dict[str, Model], config: Config) -> None:
    """Export trained models: tensors `<method>/params|batch_stats/<layer>/<name>`, S on axis 0; and the settings.

    Calibrated ones also have `<method>/calibration/logit|calibrated`.
    """
    nested = {method: jax.tree.map(np.asarray, _as_dict(model)) for method, model in models.items()}
    tensors = {"/".join(key): np.ascontiguousarray(value) for key, value in flatten_dict(nested).items()}
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
    expected = {
        method: jax.eval_shape(lambda size=size: _as_dict(init_all(jax.random.key(0), size, config).model))
        for method, size in TRAINED_METHODS.items()
        if method in config.train.methods
    }
    for method in expected.keys() & set(config.train.calibrate):
        knots = jax.ShapeDtypeStruct((len(SCENARIOS), KNOTS), np.float32)
        expected[method] |= {"calibration": Calibration(knots, knots)._asdict()}
    found = {name: (value.shape, value.dtype) for name, value in tensors.items()}
    if found != {name: (leaf.shape, leaf.dtype) for name, leaf in flatten_dict(expected).items()}:
        raise InputError(f"{path}: expected the tensors of {', '.join(expected)} as its settings say, found others")
    if not all(np.isfinite(value).all() for value in tensors.values()):
        raise InputError(f"{path}: expected finite numbers, got NaN or infinity")
    models = {}
    for method, parts in unflatten_dict(tensors).items():
        knots = parts.pop("calibration", None)
        models[method] = Model(**parts, calibration=knots and Calibration(**knots))
    return models, config


def _as_dict(model: Model) -> dict[str, Any]:
    """Its parts, without a calibration that is not there."""
    parts = {"params": model.params, "batch_stats": model.batch_stats}
    return parts if model.calibration is None else parts | {"calibration": model.calibration._asdict()}
