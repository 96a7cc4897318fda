"""Found boxes against true ones: overlap and one-to-one match."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import linear_sum_assignment

from jaxmm.learning.boxes import Box

MIN_OVERLAP = 0.25  # intersection over union from which two boxes are one object
MAX_DISTANCE = 0.5  # [m] of the centers up to which they are one object, whatever their overlap


class Match(NamedTuple):
    """One found box and the true box that it stands for."""

    found: int  # index into the found boxes
    truth: int  # index into the true boxes
    overlap: float  # intersection over union of the volumes, in [0, 1]
    distance: float  # [m] of the centers


def match_boxes(found: Sequence[Box], truth: Sequence[Box]) -> list[Match]:
    """Pair found with true boxes of the same type, one to one: as many pairs as can be, then the best overlaps.

    A pair qualifies with an overlap of at least `MIN_OVERLAP` or centers within `MAX_DISTANCE`. Give it the boxes of
    one change at a time: an added box never stands for a removed one.

    Returns:
        Matches in the order of `found`.
    """
    if not found or not truth:
        return []
    overlap = np.array([[box_overlap(a, b) for b in truth] for a in found])
    distance = np.array([[np.linalg.norm(np.subtract(a.center, b.center)) for b in truth] for a in found])
    same_type = np.array([[a.object_type == b.object_type for b in truth] for a in found])
    qualifies = same_type & ((overlap >= MIN_OVERLAP) | (distance <= MAX_DISTANCE))
    # All the overlaps together weigh less than one more pair; nearness, less than any real overlap.
    quality = 1.0 + (overlap + 1e-6 / (1.0 + distance)) / (1 + min(overlap.shape))
    rows, columns = linear_sum_assignment(np.where(qualifies, quality, 0.0), maximize=True)
    return [
        Match(int(i), int(j), float(overlap[i, j]), float(distance[i, j]))
        for i, j in zip(rows, columns, strict=True)
        if qualifies[i, j]
    ]


def box_overlap(a: Box, b: Box) -> float:
    """Intersection over union of the volumes of two upright boxes, turned about z by any angle."""
    low = max(a.center[2] - a.dimensions[2] / 2, b.center[2] - b.dimensions[2] / 2)
    high = min(a.center[2] + a.dimensions[2] / 2, b.center[2] + b.dimensions[2] / 2)
    if high <= low:
        return 0.0
    # Both footprints relative to a: areas of polygons at national-grid coordinates would lose all their digits.
    origin = np.asarray(a.center[:2], dtype=np.float64)
    common = polygon_area(clip(footprint(a, origin), footprint(b, origin))) * (high - low)
    union = np.prod(a.dimensions) + np.prod(b.dimensions) - common
    return float(common / union)


def footprint(box: Box, origin: np.ndarray) -> np.ndarray:
    """(4, 2) corners seen from above, counter-clockwise [m], relative to `origin` (2,)."""
    turn = np.radians(box.rotation)
    axes = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    corners = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]]) * box.dimensions[:2]
    return corners @ axes + (np.asarray(box.center[:2], dtype=np.float64) - origin)


def clip(polygon: np.ndarray, window: np.ndarray) -> np.ndarray:
    """The part of a convex polygon (n, 2) inside a convex window (m, 2), both counter-clockwise; may be empty.

    I. Sutherland and G. Hodgman, "Reentrant polygon clipping", CACM 17, 1974.
    """
    for start, end in zip(window, np.roll(window, -1, axis=0), strict=True):
        edge = end - start
        inside = edge[0] * (polygon[:, 1] - start[1]) - edge[1] * (polygon[:, 0] - start[0])  # > 0 left of the edge
        kept = []
        for i in range(len(polygon)):
            j = (i + 1) % len(polygon)
            if inside[i] >= 0:
                kept.append(polygon[i])
            if (inside[i] >= 0) != (inside[j] >= 0):
                kept.append(polygon[i] + (polygon[j] - polygon[i]) * inside[i] / (inside[i] - inside[j]))
        polygon = np.array(kept).reshape(-1, 2)
    return polygon


def polygon_area(polygon: np.ndarray) -> float:
    """Area [m^2] of a counter-clockwise polygon (n, 2), by the shoelace formula."""
    following = np.roll(polygon, -1, axis=0)
    return float(np.sum(polygon[:, 0] * following[:, 1] - polygon[:, 1] * following[:, 0]) / 2)
