"""The rule: pooled evidence without any learning, the control of the evidence method. N points, F features."""

from types import ModuleType
from typing import Any

import numpy as np

from jaxmm.rays.evidence import FEATURES

RULE = "rule"
SOFT = 0.01  # that is added to both sides of the odds: a score of 0 or 1 is not beyond all doubt
_AT = {name: column for column, name in enumerate(FEATURES)}


def rule_scores(features: np.ndarray, *, removed: bool) -> np.ndarray:
    """Score (N,) float32 in [0, 1] of every point, from the columns of evidence.FEATURES.

    Removed: the share of its pool's rays that went through, of those that went through or met it; outside of pools
    half of what the point's own rays say. Added: how far the point stands before the prior, as far as what stands in
    its column reaches up to whatever could be seen there.

    Args:
        features: (N, F).
        removed: whether the points are the prior's, and may be gone, or the robot's, and may be new.
    """
    return (_gone if removed else _new)(features, np).astype(np.float32)


def rule_logits(features: Any, removed: Any, arrays: ModuleType = np) -> Any:
    """Log-odds (..., N) of the rule's scores s, as log((s + SOFT) / (1 - s + SOFT)): finite, and in the same order.

    Args:
        features: (..., N, F), as of `rule_scores`.
        removed: () whether the points are the prior's; it may be known only when compiled code runs.
        arrays: the module that computes, NumPy or one of its kind.
    """
    score = arrays.where(removed, _gone(features, arrays), _new(features, arrays))
    score = arrays.clip(score, 0.0, 1.0)  # of features that are no evidence nothing is promised but a number
    return arrays.log((score + SOFT) / (1.0 - score + SOFT))


def _gone(features: Any, arrays: ModuleType) -> Any:
    at = _columns(features)
    pooled = at["pool through"] / (at["pool through"] + at["pool support"] + 0.02)
    return arrays.where(at["pooled"] > 0, pooled, 0.5 * at["through"])


def _new(features: Any, arrays: ModuleType) -> Any:
    at = _columns(features)
    upright = arrays.clip(at["column high"] - 2.0 * at["column ceiling gap"], 0.0, 1.0)
    new = (at["blocked"] + at["unseen"]) * arrays.clip(at["apart"] / 0.1, 0.0, 1.0)
    return new * (0.1 + 0.9 * upright)


def _columns(features: Any) -> dict[str, Any]:
    return {name: features[..., column] for name, column in _AT.items()}
