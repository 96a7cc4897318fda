"""Labels in the thesis's manner, from distances and clusters. Where a simulator knows the truth, its labels are better.

N points of the scored scan of one pair, world frame, metres, z up.
"""

import dataclasses
from typing import NamedTuple

import numpy as np

from jaxmm.learning.density_clusters import density_clusters

LABEL_DISTANCE = 0.09  # [m] to the other scan, beyond which a point counts as changed


@dataclasses.dataclass(frozen=True)
class LabelFilterSettings:
    """Which clusters of changed points are one removed object; the defaults are the thesis's."""

    radius: float = 0.175  # [m] DBSCAN eps
    min_neighbours: int = 3  # DBSCAN min_samples
    min_purity: float = 0.95  # share of the cluster that one element must have
    min_height: float = 2.4  # [m] extent in z
    max_variance_ratio: float = 10.0  # of the two horizontal principal axes; pillars only
    min_verticality: float = 0.99


class ElementLabels(NamedTuple):
    """Labels of the points of one changed element."""

    label: np.ndarray  # (N,) bool
    void: np.ndarray  # (N,) bool; True where a point of that element is too near to the other scan to be scored


def heuristic_labels(distance: np.ndarray, threshold: float = LABEL_DISTANCE) -> np.ndarray:
    """True where a point lies farther than `threshold` [m] from the other scan; (N,) bool."""
    return np.asarray(distance) > threshold


def filter_labels(
    points: np.ndarray,
    element: np.ndarray,
    labels: np.ndarray,
    object_type: str,
    settings: LabelFilterSettings = LabelFilterSettings(),
) -> np.ndarray:
    """Keep the labels of clusters that look like one removed pillar or wall; the others are shadows.

    Verticality is 1 minus the vertical part of the flattest direction (Demantke et al., 2012) for a wall, whose normal
    must be level. A pillar is nearly as thick as it is wide, so that direction says little: there it is the vertical
    part of the longest direction, which must point up. Released labels agree with this reading.

    Args:
        points: (N, 3) [m].
        element: (N,) int, the object that each point was measured on.
        labels: (N,) bool, changed points by distance.
        object_type: "pillar" or "wall".
        settings: thresholds.

    Returns:
        (N,) bool, True for some of the points where `labels` is.

    Raises:
        ValueError: lengths differ, or an unknown object type.
    """
    if object_type not in ("pillar", "wall"):
        raise ValueError(f"object_type must be pillar or wall, got {object_type!r}")
    points, element, labels = np.asarray(points, np.float64), np.asarray(element), np.asarray(labels).astype(bool)
    if points.shape != (len(labels), 3) or element.shape != labels.shape or labels.ndim != 1:
        raise ValueError(
            f"points, element, labels must be (N, 3), (N,), (N,), got {points.shape}, {element.shape}, {labels.shape}"
        )
    kept = np.zeros(len(points), bool)
    changed = np.flatnonzero(labels)
    if not len(changed):
        return kept
    cluster = density_clusters(points[changed], settings.radius, settings.min_neighbours)
    for number in range(cluster.max() + 1):
        members = changed[cluster == number]
        if _is_object(points[members], element[members], object_type, settings):
            kept[members] = True
    return kept


def labels_by_element(
    released: np.ndarray, element: np.ndarray, distance: np.ndarray, threshold: float = LABEL_DISTANCE
) -> ElementLabels:
    """Labels of the one changed element: the one with most released positives (the lowest id among equals).

    Its points farther than `threshold` from the other scan are positive, its other points void, all else negative.

    Args:
        released: (N,) bool, labels that say which element changed.
        element: (N,) int.
        distance: (N,) [m] to the other scan.
        threshold: [m].

    Raises:
        ValueError: there is no released positive, so no element to choose.
    """
    released, element = np.asarray(released).astype(bool), np.asarray(element)
    if not released.any():
        raise ValueError("released must have at least one positive to tell which element changed, got none")
    ids, counts = np.unique(element[released], return_counts=True)
    changed = element == ids[counts.argmax()]
    far = heuristic_labels(distance, threshold)
    return ElementLabels(changed & far, changed & ~far)


def _is_object(points: np.ndarray, element: np.ndarray, object_type: str, settings: LabelFilterSettings) -> bool:
    if len(points) < 3:  # too few for directions
        return False
    if np.unique(element, return_counts=True)[1].max() < settings.min_purity * len(element):
        return False
    if np.ptp(points[:, 2]) < settings.min_height:
        return False
    if object_type == "pillar":
        least, most = np.linalg.eigvalsh(np.cov(points[:, :2].T))
        if most > settings.max_variance_ratio * max(least, 0.0):  # rounding makes a flat face's variance negative
            return False
    _, direction = np.linalg.eigh(np.cov(points.T))  # columns, flattest direction first
    upright = abs(direction[2, 2]) if object_type == "pillar" else 1 - abs(direction[2, 0])
    return bool(upright >= settings.min_verticality)
