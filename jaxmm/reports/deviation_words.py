"""How far off its place an element stands, in words: every report, page and table takes them from here.

World frame of the prior: metres, z up. North is +y of that frame, and east +x.
"""

import itertools
import math
import re
from collections.abc import Iterable

import numpy as np

from jaxmm.deviations.deviation import Deviation
from jaxmm.deviations.tolerances import DeviationSettings
from jaxmm.verdicts.results import Detection, ElementVerdict, once
from jaxmm.verdicts.verdicts import DISPLACED, PRESENT

INTERVAL_WORDS = (
    "In brackets stands between what the measurement leaves open, in 95 of 100 cases: the errors of the ranges, how "
    "flat the faces are, and what is open of the scanner's pose."
)
NORTH_WORDS = "North is +y of the model's frame and east +x, whatever the site's own north is."
UNMEASURED_WORDS = (
    "too few rays end on a face of it, or all meet it at a flat angle, or all that is off may be the scanner's pose"
)
SIGN_WORDS = "An offset is positive toward the scanner, negative away from it."
COMPASS = ("east", "north-east", "north", "north-west", "west", "south-west", "south", "south-east")  # from +x on
NEAR = math.cos(math.radians(22.5))  # of a direction to one that has a word
LEAST_SECOND = 0.005  # [m] of an offset along the faces that tell less, to be worth words
FINE = 0.0005  # [m] half an interval, below which a tenth of a millimetre is told
SMALL = 0.001  # [m] an offset, below which it is, too
MOST_OPEN = 5  # elements named of which it is open whether they stand in their places
_PARTS = re.compile(r"[A-Z]+(?![a-z])|[A-Z][a-z]*|[0-9]+")
_VARIANTS = ("StandardCase", "ElementedCase")  # of the classes of IFC, which are the same things


def kind_of_class(ifc_class: str) -> str:
    """What people call an element of a class: "wall", "curtain wall"; "element" of a mesh, which has no classes."""
    name = ifc_class.removeprefix("Ifc")
    for variant in _VARIANTS:
        name = name.removesuffix(variant)
    return " ".join(_PARTS.findall(name)).lower() or "element"


def measured(elements: Iterable[ElementVerdict]) -> list[ElementVerdict]:
    """Those whose place was measured, the worst first: displaced ones, then by how far they are surely off.

    What is the same in several files is told of once.
    """

    def rank(one: ElementVerdict) -> tuple[float, ...]:
        keys = (one.deviation.surely, one.deviation.most)
        return one.verdict != DISPLACED, *(-key if math.isfinite(key) else math.inf for key in keys)

    return sorted((one for one in once(elements) if one.deviation is not None), key=rank)


def displaced(elements: Iterable[ElementVerdict]) -> list[ElementVerdict]:
    """Those that stand off their places, the worst first."""
    return [one for one in measured(elements) if one.verdict == DISPLACED]


def span_of(one: Deviation) -> tuple[float, float]:
    """The 95 % interval of its distance [m]."""
    return one.distance - one.half, one.distance + one.half


def millimetres(value: float, half: float = math.inf) -> str:
    """A length [m] in millimetres; with a tenth where half its interval [m] is below FINE; a dash where not finite."""
    if not math.isfinite(value):
        return "-"
    digits = 1 if half < FINE else 0
    return f"{round(1000.0 * value, digits) + 0.0:.{digits}f}"  # adding zero takes the sign off -0


def way_of(direction: Iterable[float]) -> str:
    """A direction in words: one of COMPASS, "up", "down", or its numbers where none is within 22.5 degrees."""
    x, y, z = (float(value) for value in direction)
    size = math.sqrt(x * x + y * y + z * z)
    if not (math.isfinite(size) and size > 0.0):
        return "in an unknown direction"
    if abs(z) >= NEAR * size:
        return "up" if z > 0.0 else "down"
    if math.hypot(x, y) < NEAR * size:
        return f"along ({x / size:.2f}, {y / size:.2f}, {z / size:.2f})"
    return f"to the {COMPASS[round(math.degrees(math.atan2(y, x)) / 45.0) % 8]}"


def offset_in_words(one: Deviation) -> str:
    """Its offset: "23 mm (21 to 25) to the east"; with "and 40 mm (38 to 42) to the north" of one seen from two sides.

    The second part is along what other faces fix. Its interval is no smaller than the true one: those along the axes
    are added.
    """
    sign = -1.0 if one.distance < 0.0 else 1.0
    parts = [_part(abs(one.distance), one.half, sign * np.asarray(one.direction, np.float64))]
    with np.errstate(invalid="ignore"):  # whatever is not finite is told as a gap
        rest = np.asarray(one.offset, np.float64) - one.distance * np.asarray(one.direction, np.float64)
    size = float(np.linalg.norm(rest))
    if math.isfinite(size) and size >= LEAST_SECOND:
        halves = [0.0 if span is None else (span[1] - span[0]) / 2.0 for span in one.interval]
        half = float(np.abs(rest / size) @ halves)
        if size > half:
            parts.append(_part(size, half, rest))
    return " and ".join(parts)


def _part(size: float, half: float, way: np.ndarray) -> str:
    fine = 0.0 if size < SMALL else half  # a table of numbers has it beside the words, and is not 0 where they say so
    low, middle, high = (millimetres(value, fine) for value in (size - half, size, size + half))
    return f"{middle} mm ({low} to {high}) {way_of(way)}"


def is_off_at_ends(one: Deviation) -> bool:
    """Whether it is turned or leans, so that its ends are farther off than its middle."""
    return bool(one.worst - one.half > abs(one.distance) + LEAST_SECOND)


def turn_in_words(one: Deviation) -> str:
    """How it is turned or leans, and how far off its ends are for that; nothing where its middle is as far off."""
    if not is_off_at_ends(one):
        return ""
    turn, lean = (0.0 if value is None or not math.isfinite(value) else value for value in (one.turn, one.lean))
    ways = (turned_by(turn), f"leaning by {abs(lean):.1f}°")
    how = " and ".join(way for way, size in zip(ways, (turn, lean), strict=True) if abs(size) > 0.1)
    return f", {how or 'bent'}: {millimetres(one.worst, one.half)} mm off at its ends"


def off_in_words(one: Deviation) -> str:
    """Both: "0 mm (-1 to 1) to the east, turned by 2.0° clockwise: 50 mm off at its ends"."""
    return offset_in_words(one) + turn_in_words(one)


def turned_by(turn: float, digits: int = 1) -> str:
    """A turn [deg] about the vertical, counter-clockwise positive: "turned by 77.0° clockwise"."""
    return f"turned by {abs(turn):.{digits}f}° {'counter-clockwise' if turn > 0.0 else 'clockwise'}"


def place_in_words(one: ElementVerdict) -> str:
    """A sentence on an element that was measured: "The wall 'W-102' stands 23 mm (21 to 25) to the east of its place".

    Names are as the file has them: whoever shows the sentence must escape it.
    """
    offset = offset_in_words(one.deviation)
    for way, words in ((" up", " above"), (" down", " below")):
        if offset.endswith(way):
            offset = f"{offset.removesuffix(way)}{words} its place"
            break
    else:
        offset += " of its place" if " to the " in offset.rpartition(")")[2] else " from its place"
    return (
        f"The {kind_of_class(one.ifc_class)} {(one.name or one.guid)!r} stands {offset}{turn_in_words(one.deviation)}."
    )


def tolerance_of(detection: Detection) -> float:
    """The general tolerance [m] that the detection was made with; the default one where it does not say."""
    told = detection.settings.get("deviations")
    return float(told["tolerance"] if isinstance(told, dict) else DeviationSettings().tolerance)


def _left_open(told: list[ElementVerdict], tolerance: float) -> str:
    """A sentence on those that may stand off their places, and are not displaced for sure; nothing where there is none.

    Of two walls that face each other a scan may leave open which of them moved.
    """
    found = [one for one in told if one.verdict == PRESENT and max(map(abs, span_of(one.deviation))) > tolerance]
    if not found:
        return ""
    spans = ("{} ({} to {})".format(one.name or one.guid, *map(millimetres, span_of(one.deviation))) for one in found)
    more = f" and {len(found) - MOST_OPEN} more" * (len(found) > MOST_OPEN)
    return (
        f" Whether {len(found)} of them {'stands' if len(found) == 1 else 'stand'} within {millimetres(tolerance)} mm "
        f"is open [mm, 95 %]: {', '.join(itertools.islice(spans, MOST_OPEN))}{more}."
    )


def summary_of(elements: Iterable[ElementVerdict], tolerance: float) -> str:
    """How many elements were measured, how near to their places they stand, and of which [m] that is open.

    Nothing where none was. Names are as the file has them: whoever shows it must escape it.
    """
    told, count = measured(elements := tuple(elements)), len(elements)
    off = np.array([one.deviation.most for one in told if math.isfinite(one.deviation.most)])
    if not len(off):
        return ""
    # Values that were measured: what lies between two of them, of few, holds less than the share that is told.
    half, most = (millimetres(float(np.quantile(off, share, method="inverted_cdf"))) for share in (0.5, 0.95))
    were, stand = ("was", "stands") if len(told) == 1 else ("were", "stand")
    others = f" Of any other {UNMEASURED_WORDS}; or it is gone." if len(told) < count else ""
    return (
        f"{len(told)} of {count} elements {were} measured: half of them {stand} within {half} mm of their places, 95 % "
        f"within {most} mm.{_left_open(told, tolerance)}{others}"
    )
