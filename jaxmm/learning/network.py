"""The per-point network: a shared encoder, a summary of the whole cloud, and a head that sees both.

Written for ONE cloud; `jax.vmap(..., axis_name=CLOUDS)` makes a batch of it, and batch normalisation then takes its
statistics over every real point of the batch. Axes: N points, F features, C channels.
"""

import math
import re
from functools import partial

import flax.linen as nn
import jax
import jax.numpy as jnp
import numpy as np

from jaxmm.config import NetworkConfig
from jaxmm.inputs import InputError
from jaxmm.learning.fused_layers import EPSILON, activate, dense, offset, summarise

MOMENTUM = 0.9  # share of the old running statistics that is kept; torch calls the rest its momentum of 0.1


class PointNetwork(nn.Module):
    """Maps features (N, F) and mask (N,) of one cloud to logits (N,); logits of padding are arbitrary.

    With the default widths this is the network of the 2025 thesis (section II-C), as its released weights define it:
    64-128-256-512 encoder, maximum over points, 1024-256-128-1 head. Layers carry the released names.
    """

    config: NetworkConfig

    @nn.compact
    def __call__(self, features: jax.Array, mask: jax.Array, *, train: bool, seed: jax.Array | None = None):
        """Logits of one cloud.

        Args:
            features: (N, F) float.
            mask: (N,) bool; False marks padding, which reaches neither statistics nor summary.
            train: use the batch's own statistics (and update the running ones), and drop activations.
            seed: () uint32, needed while training: another seed, another dropout mask.
        """
        config = self.config
        x = jnp.where(mask[:, None], features, 0)
        depth = len(config.encoder)
        for index, width in enumerate(config.encoder, start=1):
            x, bias = Dense(width, name=f"conv{index}")(x)
            rate = config.dropout if index == depth else 0.0
            x = Activation(rate, layer=index, name=f"bn{index}")(x, bias, mask, seed, train=train)
        # Activations are never negative, and zero at padding, which so cannot reach the maximum.
        summary = summarise(x)
        for index, width in enumerate(config.head, start=1):
            x, bias = Dense(width, name=f"seg_conv{index}")(x, *((summary, mask) if index == 1 else ()))
            x = Activation(config.dropout, depth + index, name=f"seg_bn{index}")(x, bias, mask, seed, train=train)
        x, bias = Dense(1, learn_bias=True, name=f"seg_conv{len(config.head) + 1}")(x)
        return offset(x[:, 0], bias)


class Activation(nn.Module):
    """Batch normalisation over the real points of all clouds of the vmapped axis CLOUDS, relu, and dropout.

    As in torch, the batch is normalised by its biased variance while the running variance is the unbiased one.
    """

    rate: float  # of dropout
    layer: int  # whose mask dropout draws

    @nn.compact
    def __call__(self, x: jax.Array, offset: jax.Array, mask: jax.Array, seed: jax.Array | None, *, train: bool):
        """Activations (N, C) of x + offset; zero where mask (N,) is False, as x (N, C) has to be.

        The offset (C,) is the same for all points of all clouds, so the batch's statistics cancel it.
        """
        channels = x.shape[-1]
        scale = self.param("scale", nn.initializers.ones, (channels,))
        bias = self.param("bias", nn.initializers.zeros, (channels,))
        running_mean = self.variable("batch_stats", "mean", jnp.zeros, (channels,), x.dtype)
        running_var = self.variable("batch_stats", "var", jnp.ones, (channels,), x.dtype)
        if not train:
            factor = scale * jax.lax.rsqrt(running_var.value + EPSILON)
            y = nn.relu((x - (running_mean.value - offset)) * factor + bias)
            return jnp.where(mask[:, None], y, 0)
        y, (mean, var, count) = activate(self.rate, self.layer, x, mask, scale, bias, seed)
        if not self.is_initializing():
            running_mean.value = MOMENTUM * running_mean.value + (1 - MOMENTUM) * (mean + offset)
            unbiased = var * count / jnp.maximum(count - 1, 1)
            running_var.value = MOMENTUM * running_var.value + (1 - MOMENTUM) * unbiased
        return y


class Dense(nn.Module):
    """A dense layer (a convolution of kernel 1) on points (N, C), and on a summary (D,) of their cloud if there is one.

    Returns the product (N, W) and, not yet added to it, the bias (W,): a pass over memory that a normalisation spares.
    [points, summary] is never built either: the summary's share of the product is one row for the whole cloud.
    """

    width: int
    # Before a normalisation a bias cancels, and its gradient is zero but for rounding. Adam would blow that rounding up
    # to full steps, which the running mean then lags behind.
    learn_bias: bool = False

    @nn.compact
    def __call__(
        self, points: jax.Array, summary: jax.Array | None = None, mask: jax.Array | None = None
    ) -> tuple[jax.Array, jax.Array]:
        """A summary comes with the mask (N,) of its cloud, for rows of padding stay zero."""
        channels = points.shape[-1]
        fan_in = channels + (0 if summary is None else summary.shape[-1])
        # torch's default for a convolution: uniform within 1 / sqrt(fan_in), kernel and bias alike.
        draw = partial(_draw_uniform, bound=1 / math.sqrt(fan_in))
        kernel = self.param("kernel", draw, (fan_in, self.width))
        bias = self.param("bias", draw, (self.width,))
        bias = bias if self.learn_bias else jax.lax.stop_gradient(bias)
        product = dense(points, kernel[:channels])
        if summary is not None:
            product = jnp.where(mask[:, None], product + summary @ kernel[channels:], 0)
        return product, bias


def _draw_uniform(key: jax.Array, shape: tuple[int, ...], dtype=jnp.float32, *, bound: float) -> jax.Array:
    return jax.random.uniform(key, shape, dtype, -bound, bound)


def from_torch(state: dict[str, np.ndarray]) -> tuple[dict, dict, NetworkConfig]:
    """Parameters, running statistics and widths of a network from torch's names for its tensors.

    Args:
        state: `conv<i>.weight` (out, in, 1), `conv<i>.bias` (out,), `bn<i>.weight|bias|running_mean|running_var`
            (out,), and likewise `seg_conv<i>`, `seg_bn<i>`, as in the thesis's released state dicts.

    Raises:
        InputError: a tensor is missing, left over, or of a shape that does not fit the others.
    """
    convolutions = [name.removesuffix(".weight") for name in state if re.fullmatch(r"(seg_)?conv\d+\.weight", name)]
    encoder = sorted((name for name in convolutions if name.startswith("conv")), key=_number)
    head = sorted((name for name in convolutions if name.startswith("seg_")), key=_number)
    whole = encoder == [f"conv{i + 1}" for i in range(len(encoder))]
    whole &= head == [f"seg_conv{i + 1}" for i in range(len(head))]
    if not encoder or len(head) < 2 or not whole or any(state[f"{n}.weight"].ndim != 3 for n in encoder + head):
        raise InputError(f"expected tensors conv1.weight ... seg_conv3.bias of the network, got {sorted(state)[:4]}")
    params, batch_stats, used = {}, {}, set()

    def take(name: str, shape: tuple[int, ...]) -> np.ndarray:
        if name not in state or state[name].shape != shape:
            found = state[name].shape if name in state else "nothing"
            raise InputError(f"{name}: expected shape {shape}, got {found}")
        used.add(name)
        return np.asarray(state[name], np.float32)

    fan_in = state["conv1.weight"].shape[1]
    for name in encoder + head:
        if name == head[0]:
            fan_in *= 2  # from here on each point also sees the summary
        width = len(state[f"{name}.weight"])
        kernel = take(f"{name}.weight", (width, fan_in, 1))[:, :, 0].T
        params[name] = {"kernel": kernel, "bias": take(f"{name}.bias", (width,))}
        if name != head[-1]:
            norm = norm_of(name)
            params[norm] = {"scale": take(f"{norm}.weight", (width,)), "bias": take(f"{norm}.bias", (width,))}
            mean, var = take(f"{norm}.running_mean", (width,)), take(f"{norm}.running_var", (width,))
            batch_stats[norm] = {"mean": mean, "var": var}
        fan_in = width
    counters = {name for name in state if name.endswith("num_batches_tracked")}
    left = sorted(state.keys() - used - counters)
    if fan_in != 1 or left:
        raise InputError(f"expected one output and no other tensors, got {fan_in} outputs and {left}")
    widths = [params[name]["bias"].shape[0] for name in encoder], [params[name]["bias"].shape[0] for name in head[:-1]]
    return params, batch_stats, NetworkConfig(tuple(widths[0]), tuple(widths[1]))


def norm_of(layer: str) -> str:
    """Name of the normalisation that follows a layer (of itself, for a normalisation)."""
    return layer.replace("conv", "bn")


def _number(name: str) -> int:
    return int(re.sub(r"\D", "", name))
