"""Bounds of the settings that rooms are drawn from, told apart by the endings of their names. Metres and radians."""

import dataclasses
from math import pi
from typing import Any

import numpy as np

Range = tuple[float, float]
# Bounds by the ending of the name, the first that fits; all else is a length.
LIMITS = {
    "size_spread": (0.0, 200.0),
    "size": (0.1, 200.0),
    "spacing": (0.5, 100.0),
    "share": (0.0, 1.0),
    "density": (0.0, 1.0),
    "randomness": (0.0, 1.0),
    "corner_part": (0.05, 0.6),
    "wall_rotation": (0.0, 0.35),
    "rotation": (0.0, 2 * pi),
    "limit": (0, 200),
    "count_x": (0, 6),
    "count_y": (0, 6),
    "clearance": (0.0, 1.0),
    "thickness": (0.01, 1.0),
}
LENGTH_LIMITS = (0.01, 10.0)  # [m]


def check_seed(seed: Any) -> None:
    """Refuse what is no seed: another number of the same bits would make the same data, under another name.

    Raises:
        ValueError: not a whole number from 0 to 2^63 - 1.
    """
    if isinstance(seed, bool) or not isinstance(seed, int | np.integer) or not 0 <= seed < 2**63:
        raise ValueError(f"seed must be a whole number of at least 0 and below 2^63, got {seed!r}")


def check_settings(config: Any, where: str) -> None:
    """Refuse the settings of a dataclass that are out of their bounds, and ranges upside down.

    Raises:
        ValueError: one line that names `where` and the setting, what was expected and what came.
    """
    for field in dataclasses.fields(config):
        name, value = field.name, getattr(config, field.name)
        low, high = next((limits for ending, limits in LIMITS.items() if name.endswith(ending)), LENGTH_LIMITS)
        values = np.atleast_1d(value)
        # Written so that NaN fails too.
        if not np.all((values >= low) & (values <= high)):
            raise ValueError(f"{where}.{name} must lie within {low:g} and {high:g}, got {value}")
        if field.type in (Range, tuple[int, int]) and not values[0] <= values[1]:
            raise ValueError(f"{where}.{name} must be (low, high) with low <= high, got {value}")
