"""The rule: pooled evidence without any learning, the control of the evidence method. N points, F features."""

import numpy as np

from jaxmm.rays.evidence import FEATURES

RULE = "rule"
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
    at = {name: features[:, column] for name, column in _AT.items()}
    if removed:
        pooled = at["pool through"] / (at["pool through"] + at["pool support"] + 0.02)
        return np.where(at["pooled"] > 0, pooled, 0.5 * at["through"]).astype(np.float32)
    upright = np.clip(at["column high"] - 2.0 * at["column ceiling gap"], 0.0, 1.0)
    new = (at["blocked"] + at["unseen"]) * np.clip(at["apart"] / 0.1, 0.0, 1.0)
    return (new * (0.1 + 0.9 * upright)).astype(np.float32)
