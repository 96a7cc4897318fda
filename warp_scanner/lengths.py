"""Lengths in words, as people read them."""

import math

# Below how many metres, in what unit [m], its name, and decimals.
_STEPS = ((0.01, 1e-3, "mm", 0), (1.0, 1.0, "m", 2), (10.0, 1.0, "m", 1), (1e3, 1.0, "m", 0), (1e4, 1e3, "km", 1))
_FARTHEST = (1e3, "km", 0)


def length_in_words(length: float) -> str:
    """A length [m], or how far away something is: "4 mm", "0.35 m", "4.2 m", "463 m", "4.6 km", "5,679 km"."""
    for limit, unit, name, decimals in _STEPS:
        # What is rounded up to the limit is of the next step: no "1000 m" beside "1.0 km".
        if round(abs(length) / unit, decimals) * unit < limit and not math.isclose(abs(length), limit):
            return f"{length / unit:.{decimals}f} {name}"
    unit, name, decimals = _FARTHEST
    return f"{length / unit:,.{decimals}f} {name}"
