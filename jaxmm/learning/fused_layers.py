"""The layers that cost a training step most, with hand-written gradients that pass over memory seldom.

Each function is written for ONE cloud; axes: N points, C channels. Rows of padding are zero on the way in and out.

XLA's CPU backend sums several times faster where the sum takes in the products before it than where it reads an array
that another pass has written, but it takes in only what nobody else needs. So a difference or a factor that two sums
share is written in two ways here: `mean - x` and `x + -mean`, `sign(y)` and `sign(ceil(y))`. It costs nothing, and
tests/learning/test_fused_layers.py compares with the plain formulation.
"""

import math
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.custom_batching import custom_vmap

CLOUDS = "clouds"  # the name that the batch axis must carry under vmap while training
EPSILON = 1e-5


class Moments(NamedTuple):
    """Of every channel, over the real points of all clouds of the axis CLOUDS; no gradient flows into them."""

    mean: jax.Array  # (C,)
    var: jax.Array  # (C,) biased
    count: jax.Array  # () number of real points, at least 1, as a float


@custom_vmap
def dense(points: jax.Array, kernel: jax.Array) -> jax.Array:
    """points (N, C) @ kernel (C, D)."""
    return points @ kernel


@dense.def_vmap
def _dense_of_each(size, batched, points, kernel):
    """A product a cloud, of equal speed, in place of one tall product.

    The tall one would see its operand in another shape than all else, and XLA would compute it once for each shape.
    Its gradient would contract clouds and points at once, for which XLA writes a transposed copy, slowly.
    """
    points, kernel = (
        array if own else jnp.broadcast_to(array, (size, *array.shape))
        for array, own in zip((points, kernel), batched, strict=True)
    )
    return _products(points, kernel), True


@jax.custom_vjp
def _products(points: jax.Array, kernel: jax.Array) -> jax.Array:
    """points (B, N, C) @ kernel (B, C, D)."""
    return points @ kernel


def _products_forward(points, kernel):
    return points @ kernel, (points, kernel)


def _products_backward(saved, slope):
    """With the narrower operand transposed before the product, not within it: YNNPACK takes no other kind.

    Eigen, which then would, makes other bits on another processor: it seems to split the sum over N by the size of
    caches.
    """
    points, kernel = saved
    still = jax.lax.optimization_barrier  # or XLA makes one product of it again, transposed within
    if points.shape[2] <= slope.shape[2]:
        to_kernel = still(jnp.swapaxes(points, 1, 2)) @ slope
    else:
        to_kernel = jnp.swapaxes(still(still(jnp.swapaxes(slope, 1, 2)) @ points), 1, 2)
    return slope @ jnp.swapaxes(kernel, 1, 2), to_kernel


_products.defvjp(_products_forward, _products_backward)


@partial(jax.custom_vjp, nondiff_argnums=(0, 1))
def activate(rate: float, layer: int, x, mask, scale, bias, seed) -> tuple[jax.Array, Moments]:
    """Dropout of relu of batch normalisation (Ioffe and Szegedy, 2015), within vmap over the axis CLOUDS.

    Args:
        rate: share of activations that dropout takes.
        layer: number of the layer: another layer, another dropout mask.
        x: (N, C), zero where mask is False.
        mask: (N,) bool; False marks padding.
        scale: (C,) of the normalisation.
        bias: (C,) of the normalisation.
        seed: () uint32 of this cloud's dropout.

    Returns:
        (N, C) activations, zero where mask is False; the moments of x.
    """
    return _activate_forward(rate, layer, x, mask, scale, bias, seed)[0]


def _activate_forward(rate, layer, x, mask, scale, bias, seed):
    count = jnp.maximum(jax.lax.psum(jnp.sum(mask), CLOUDS), 1).astype(x.dtype)
    mean = jax.lax.psum(jnp.sum(x, axis=0), CLOUDS) / count
    # The same ones for every layer would be an array of their own; halved from layer to layer, which is exact.
    one = 0.5**layer
    weight = jnp.where(mask, one, 0).astype(x.dtype)[:, None]
    # The mean is taken off first: E[x^2] - E[x]^2 loses half the digits of float32 where the mean is large.
    var = jax.lax.psum(jnp.sum(weight * jnp.square(mean - x), axis=0), CLOUDS) / (one * count)
    spread = jax.lax.rsqrt(var + EPSILON)
    # Not x * factor + (bias - mean * factor): where the mean is large those two terms cancel, digits and all.
    y = jnp.maximum((x + -mean) * (scale * spread) + bias, 0)
    y = jnp.where(mask[:, None], drop(y, rate, seed, layer), 0)
    return (y, Moments(mean, var, count)), (x, y, mean, spread, scale, mask, count)


def _activate_backward(rate, layer, saved, slopes):
    """All of the gradient out of two sums per channel.

    An activation is above zero exactly where relu and dropout let it pass, so neither mask is stored or drawn again.
    """
    x, y, mean, spread, scale, mask, count = saved
    slope, gain = slopes[0], 1 / (1 - rate)
    own_bias = gain * jnp.sum(slope * jnp.sign(y), axis=0)
    own_scale = gain * jnp.sum(slope * (jnp.sign(jnp.ceil(y)) * (x * spread - mean * spread)), axis=0)
    to_mean = jax.lax.psum(own_bias, CLOUDS) / count
    to_spread = jax.lax.psum(own_scale, CLOUDS) / count
    slope = jnp.where(y > 0, slope * gain, 0) - to_mean - (x + -mean) * (spread * to_spread)
    # vmap adds up what the clouds have to say about scale and bias.
    return jnp.where(mask[:, None], slope * (scale * spread), 0), None, own_scale, own_bias, None


activate.defvjp(_activate_forward, _activate_backward)


@jax.custom_vjp
def summarise(y: jax.Array) -> jax.Array:
    """Maximum (C,) over the points of y (N, C); its gradient goes to one point, the first of the largest, as in torch.

    Not to all that equal the maximum: XLA may compute y anew where it is compared, and rounds it differently there.
    """
    return jnp.max(y, axis=0)


def _summarise_forward(y):
    # Maxima of blocks first, for XLA is quick at maxima and slow at their places. A prime count makes it the slow way.
    count, channels = y.shape
    size = max(divisor for divisor in range(1, math.isqrt(count) + 1) if count % divisor == 0)
    blocks = y.reshape(-1, size, channels)
    block = jnp.argmax(jnp.max(blocks, axis=1), axis=0)
    inside = jnp.take_along_axis(blocks, block[None, None], axis=0)[0]
    index = block * size + jnp.argmax(inside, axis=0)
    return jnp.max(inside, axis=0), (index, jnp.arange(count))


def _summarise_backward(saved, slope):
    index, places = saved
    return (jnp.where(places[:, None] == index, slope, 0),)


summarise.defvjp(_summarise_forward, _summarise_backward)


@jax.custom_vjp
def total(x: jax.Array) -> jax.Array:
    """Sum () of x (N,), in an order that hangs on N alone: halves are added until one number is left.

    XLA sums short arrays in as many strands as the processor has registers for.
    """
    while x.shape[0] > 1:
        half = -(-x.shape[0] // 2)
        # Without barriers XLA would fuse all halvings, and compute what is under each of them anew.
        x = jax.lax.optimization_barrier(x[:half] + jnp.pad(x[half:], (0, 2 * half - x.shape[0])))
    return x.sum()


total.defvjp(lambda x: (total(x), x), lambda x, slope: (jnp.full_like(x, slope),))


@custom_vmap
def offset(x: jax.Array, bias: jax.Array) -> jax.Array:
    """x (N,) + bias (1,); under vmap over clouds the bias's gradient is a `total` over all of their points."""
    return x + bias


@offset.def_vmap
def _offset_of_each(size, batched, x, bias):
    if batched[1]:
        return x + bias, True
    return _offset_all(x, bias), True


@jax.custom_vjp
def _offset_all(x: jax.Array, bias: jax.Array) -> jax.Array:
    return x + bias


_offset_all.defvjp(lambda x, bias: (x + bias, None), lambda _, slope: (slope, total(slope.reshape(-1))[None]))


def drop(x: jax.Array, rate: float, seed: jax.Array, layer: int) -> jax.Array:
    """Dropout (Srivastava et al., 2014) whose mask is a hash of (seed, layer, position): nothing to store or split.

    The seed is scrambled before it meets the position. Added to it, two seeds would give shifted copies of one mask.
    """
    if rate == 0.0:
        return x
    position = jax.lax.broadcasted_iota(jnp.uint32, x.shape, 0) * jnp.uint32(x.shape[1])
    position = position + jax.lax.broadcasted_iota(jnp.uint32, x.shape, 1)
    stream = scramble(seed.astype(jnp.uint32) ^ scramble(jnp.uint32(layer + 1)))
    bits = scramble(position * jnp.uint32(0x9E3779B1) ^ stream)
    keep = (bits >> 8) >= jnp.uint32(round(rate * 2**24))
    return jnp.where(keep, x * (1 / (1 - rate)), 0)


def scramble(bits: jax.Array) -> jax.Array:
    """Mix 32 bits so that each one depends on all (finaliser of MurmurHash3, Appleby, 2011)."""
    bits = (bits ^ (bits >> 16)) * jnp.uint32(0x85EBCA6B)
    bits = (bits ^ (bits >> 13)) * jnp.uint32(0xC2B2AE35)
    return bits ^ (bits >> 16)
