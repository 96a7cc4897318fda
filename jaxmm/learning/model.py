"""What a trained network is: arrays by layer and name. Needs no JAX, so that detections start without it.

S scenarios: the leading axis of every array of a stacked model.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from jaxmm.config import SCENARIOS, NetworkConfig, TrainConfig
from jaxmm.learning.calibration import Calibration


class Offset(NamedTuple):
    """The rule's share of a model's logits, which the network corrects; (S,) when stacked."""

    removed: Any  # () float32, 1 where the model judges points of the prior, which may be gone
    scale: Any  # () float32, of the rule's log-odds


class Model(NamedTuple):
    """What a network needs to predict."""

    params: Any  # pytree of float arrays
    batch_stats: Any  # pytree of float arrays: running mean and variance of each normalisation
    calibration: Calibration | None = None  # of the logits, once training is over; None: as they are
    offset: Offset | None = None  # None: the network's logits are all


def pick_model(stacked: Model, scenario: str) -> Model:
    """One scenario's model out of the four."""
    index = SCENARIOS.index(scenario)

    def picked(part: Any) -> Any:
        if isinstance(part, dict):
            return {name: picked(value) for name, value in part.items()}
        return part[index]

    own = stacked.calibration and Calibration(*(picked(knots) for knots in stacked.calibration))
    offset = stacked.offset and Offset(*(picked(part) for part in stacked.offset))
    return Model(picked(stacked.params), picked(stacked.batch_stats), own, offset)


def offset_of(method: str, scenarios: Sequence[int], config: TrainConfig) -> Offset | None:
    """Where the rule stands in the models of a method, for some scenarios by their numbers; None where it does not."""
    if method != "evidence" or not config.rule_scale:
        return None
    removed = [SCENARIOS[number].endswith("removed") for number in scenarios]
    return Offset(np.array(removed, np.float32), np.full(len(removed), config.rule_scale, np.float32))


def shapes_of(features: int, network: NetworkConfig) -> dict[tuple[str, ...], tuple[int, ...]]:
    """Shapes of a model's parameters and statistics, by the path to each: "params" or "batch_stats", layer, name.

    Args:
        features: of each point.
        network: its widths.
    """
    shapes, width_in = {}, features
    layers = [(f"conv{i}", f"bn{i}", width) for i, width in enumerate(network.encoder, 1)]
    layers += [(f"seg_conv{i}", f"seg_bn{i}", width) for i, width in enumerate(network.head, 1)]
    for layer, norm, width in [*layers, (f"seg_conv{len(network.head) + 1}", "", 1)]:
        width_in *= 2 if layer == "seg_conv1" else 1  # from here on each point also sees the summary
        shapes["params", layer, "kernel"], shapes["params", layer, "bias"] = (width_in, width), (width,)
        if norm:
            shapes |= {("params", norm, name): (width,) for name in ("scale", "bias")}
            shapes |= {("batch_stats", norm, name): (width,) for name in ("mean", "var")}
        width_in = width
    return shapes
