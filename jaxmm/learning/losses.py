"""The focal loss of one cloud; vmap it over clouds and scenarios."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import optax

from jaxmm.config import LossConfig
from jaxmm.learning.fused_layers import total


class LossSum(NamedTuple):
    """A loss before its mean is taken, so that clouds of different length weigh by their points."""

    total: jax.Array  # () sum over real points [nat]
    count: jax.Array  # () number of real points


def focal_loss(logits: jax.Array, labels: jax.Array, mask: jax.Array, config: LossConfig) -> LossSum:
    """Focal loss (Lin et al., 2017) of one cloud.

    With p_t the probability given to the true class and CE the cross-entropy, a point costs
    `alpha_t (1 - p_t)^gamma CE`. Form "released" takes alpha_t = alpha for both classes, which is what the thesis's
    code does. Its equation 3 says alpha and 1 - alpha; with its alpha of 10 the negatives would weigh -9 and the loss
    have no lower bound, so form "balanced" (alpha and 1 - alpha) admits only alpha in [0, 1] (see LossConfig).

    Args:
        logits: (N,) float.
        labels: (N,) 0 or 1, any dtype.
        mask: (N,) bool; False marks padding.
    """
    target = labels.astype(logits.dtype)
    cross_entropy = optax.sigmoid_binary_cross_entropy(logits, target)
    # 1 - p_t, straight from the logit: exp(-cross_entropy) would round to 1 for confident points.
    miss = jax.nn.sigmoid(jnp.where(target > 0.5, -logits, logits))
    alpha = config.alpha if config.form == "released" else jnp.where(target > 0.5, config.alpha, 1 - config.alpha)
    losses = alpha * miss**config.gamma * cross_entropy
    return LossSum(total(jnp.where(mask, losses, 0)), jnp.sum(mask))
