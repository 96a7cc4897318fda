"""The network's answers in NumPy: `network.PointNetwork` as it is once trained, without loading or compiling JAX.

A command that asks four small networks once would wait longer for JAX to load, trace and compile than for the answers.
Axes: N points, F features, C channels.
"""

import numpy as np

from jaxmm.config import NetworkConfig
from jaxmm.learning.model import Model
from jaxmm.rays.rule import rule_logits

EPSILON = 1e-5  # of the normalisation, as in fused_layers
BLOCK = 4096  # points at once: what a layer makes of them stays in the processor's cache


class _Layer:
    """A product, and what follows it in one go: offset, normalisation by running statistics, and relu.

    relu((x @ kernel + bias - mean) * factor + shift) is relu(x @ (kernel * factor) + offset).
    """

    def __init__(self, model: Model, name: str):
        own, norm = model.params[name], name.replace("conv", "bn")
        after, stats = model.params[norm], model.batch_stats[norm]
        mean, var = (np.asarray(stats[key], np.float64) for key in ("mean", "var"))
        factor = np.asarray(after["scale"], np.float64) / np.sqrt(var + EPSILON)
        self.kernel = (np.asarray(own["kernel"], np.float64) * factor).astype(np.float32)
        self.offset = (np.asarray(after["bias"]) + (np.asarray(own["bias"]) - mean) * factor).astype(np.float32)

    def __call__(self, x: np.ndarray) -> np.ndarray:
        return _rectified(x @ self.kernel, self.offset)


def _rectified(product: np.ndarray, offset: np.ndarray) -> np.ndarray:
    product += offset
    return np.maximum(product, 0.0, out=product)


def predict(model: Model, features: np.ndarray, network: NetworkConfig) -> np.ndarray:
    """Probabilities (N,) float32 of one cloud's features (N, F) under one model, calibrated where the model is."""
    logit = logits(model, features, network).astype(np.float64)
    if model.calibration is not None:
        logit = np.interp(logit, *(np.asarray(knots, np.float64) for knots in model.calibration))
    with np.errstate(over="ignore"):  # exp of a large number is infinite, and its inverse 0
        return (1.0 / (1.0 + np.exp(-logit))).astype(np.float32)


def logits(model: Model, features: np.ndarray, network: NetworkConfig) -> np.ndarray:
    """Logits (N,) float32, before any calibration."""
    features = np.asarray(features, np.float32)
    if not len(features):
        return np.zeros(0, np.float32)
    encoder = [_Layer(model, f"conv{index}") for index in range(1, len(network.encoder) + 1)]
    first, *head = (_Layer(model, f"seg_conv{index}") for index in range(1, len(network.head) + 1))
    last = model.params[f"seg_conv{len(network.head) + 1}"]
    kernel, bias = np.asarray(last["kernel"], np.float32), np.asarray(last["bias"], np.float32)
    parts = [slice(begin, begin + BLOCK) for begin in range(0, len(features), BLOCK)]
    encoded = np.empty((len(features), network.encoder[-1]), np.float32)
    for part in parts:
        x = features[part]
        for layer in encoder:
            x = layer(x)
        encoded[part] = x
    # The summary's share of the product is one row for the whole cloud.
    own = network.encoder[-1]
    shared = encoded.max(axis=0) @ first.kernel[own:] + first.offset
    found = np.empty(len(features), np.float32)
    for part in parts:
        x = _rectified(encoded[part] @ first.kernel[:own], shared)
        for layer in head:
            x = layer(x)
        found[part] = (x @ kernel)[:, 0] + bias
    if model.offset is not None:
        found += np.float32(model.offset.scale) * rule_logits(features, model.offset.removed)
    return found
