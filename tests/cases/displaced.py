"""Detections of which some elements stand off their places, by known offsets."""

import numpy as np

from jaxmm.deviations.deviation import Deviation
from jaxmm.verdicts.results import Detection
from jaxmm.verdicts.verdicts import DISPLACED, PRESENT


def deviation(distance, direction=(1.0, 0.0, 0.0), half=0.002, **more) -> Deviation:
    """Off its place by a distance [m] along a direction, and along no other that anything fixes."""
    way = np.asarray(direction, float) / np.linalg.norm(direction)
    offset = distance * way
    spans = tuple(
        (float(value - half), float(value + half)) if abs(part) > 0.05 else None
        for value, part in zip(offset, way, strict=True)
    )
    told = Deviation(
        tuple(map(float, offset)), spans, float(distance), tuple(map(float, way)), 0.12, None, 0.004, 0.6, 1234,
        {"loa": "LOA20", "din18202": "beyond"},
    )  # fmt: skip
    return told._replace(half=half, scans=(0,), **more)


def with_displaced(detection: Detection, name: str = "W-102", distance: float = 0.023) -> Detection:
    """The same, its first present element displaced to the east, and all others that are present measured in place."""
    rows = [row for row, one in enumerate(detection.elements) if one.verdict == PRESENT]
    elements = list(detection.elements)
    for row in rows:
        elements[row] = elements[row]._replace(deviation=deviation(0.001, (0.0, 1.0, 0.0)))
    first = rows[0]
    elements[first] = elements[first]._replace(
        verdict=DISPLACED, name=name, ifc_class="IfcWallStandardCase", deviation=deviation(distance)
    )
    return detection._replace(elements=tuple(elements))
