"""How far off its place an element may stand: settings, and the classes of two standards.

USIBD Level of Accuracy (Document C120, "Level of Accuracy Specification Guide", version 3.0, 2019): the 95 % deviation
of what was measured; LOA10 down to 0.05 m, LOA20 to 0.015 m, LOA30 to 0.005 m, LOA40 to 0.001 m, LOA50 below. Where
LOA10 ends is for its user to say, so it has no end here.
DIN 18202:2019, "Tolerances in building construction": limits of sizes in plan and of heights (Table 1), and of angles,
as the offset over a length (Table 2).
"""

import dataclasses
from collections.abc import Iterable
from typing import NamedTuple

from jaxmm.config import bounded

LOA = ((0.001, "LOA50"), (0.005, "LOA40"), (0.015, "LOA30"), (0.05, "LOA20"), (float("inf"), "LOA10"))
# Nominal size up to [m], and the limit [m].
SIZES = ((1.0, 0.010), (3.0, 0.012), (6.0, 0.016), (15.0, 0.020), (30.0, 0.024), (float("inf"), 0.030))
ANGLES = (
    (0.5, 0.003), (1.0, 0.006), (3.0, 0.008), (6.0, 0.012), (15.0, 0.016), (30.0, 0.020), (float("inf"), 0.030),
)  # fmt: skip
WITHIN, BEYOND, OPEN = "within", "beyond", "open"
NAMES = ("wall", "column", "door", "window", "slab")


@dataclasses.dataclass(frozen=True)
class DeviationSettings:
    """When an element is off its place; in metres. 0 for a class stands for `tolerance`."""

    tolerance: float = bounded(0.03, 0.0, 0.3)  # beyond which, and beyond its interval, an element is displaced
    most: float = bounded(0.3, 0.0, 0.4)  # up to which it is the same element; farther it is removed, and new there
    wall: float = bounded(0.0, 0.0, 0.3)
    column: float = bounded(0.0, 0.0, 0.3)
    door: float = bounded(0.0, 0.0, 0.3)
    window: float = bounded(0.0, 0.0, 0.3)
    slab: float = bounded(0.0, 0.0, 0.3)

    def __post_init__(self):
        for name in ("tolerance", *NAMES):
            if getattr(self, name) > self.most:
                value = getattr(self, name)
                raise ValueError(f"{name}: expected a tolerance up to most, which is {self.most:g} m, got {value:g}")

    def of(self, name: str) -> float:
        """The tolerance [m] of a class of NAMES; of any other the general one."""
        return (getattr(self, name) if name in NAMES else 0.0) or self.tolerance


def loa_of(distance: float) -> str:
    """The Level of Accuracy that a deviation [m] is still within."""
    return next(name for most, name in LOA if abs(distance) <= most)


class Slope(NamedTuple):
    """How far one end of an element is off the other, as it is turned or leans."""

    off: float  # [m]
    half: float  # [m] half the width of its interval
    length: float  # [m] from end to end


def din_of(off: float, half: float, size: float, slopes: Iterable[Slope]) -> str:
    """Whether a place is within DIN 18202, or beyond it, or its interval leaves that open.

    Args:
        off: [m] of the element off its place.
        half: [m] half the width of its interval.
        size: [m] the nominal one, the element's longest edge in plan.
        slopes: by its turn, and its lean, as far as they are known.
    """
    checks = [(abs(off), half, _limit(SIZES, size))]
    checks += [(abs(one.off), one.half, _limit(ANGLES, one.length)) for one in slopes]
    if any(value - error > limit for value, error, limit in checks):
        return BEYOND
    return WITHIN if all(value + error <= limit for value, error, limit in checks) else OPEN


def _limit(table: tuple[tuple[float, float], ...], size: float) -> float:
    return next(limit for most, limit in table if size <= most)
