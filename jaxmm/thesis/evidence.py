"""Evidence of the thesis's scan pairs: two filtered clouds, seen from a viewpoint that only they can tell.

N points of the scored scan. World frame: metres, z up.
"""

from functools import lru_cache

import numpy as np

from jaxmm.inputs import InputError
from jaxmm.rays.cloud_evidence import CloudPair, frame_of_pair, prior_view, robot_view
from jaxmm.rays.evidence import features_of
from jaxmm.rays.overlap import check_pair
from jaxmm.rays.viewpoint import Viewpoint, estimate
from jaxmm.thesis.repository import ThesisScan

FIELD_OF_VIEW = (80.0, 60.0)  # [deg] what the released scans fill, though the thesis says 80 x 55


def viewpoint_of(scan: ThesisScan) -> Viewpoint:
    """Where both scans of a pair were taken from: of the two estimates the one that is surer.

    Raises:
        InputError: neither scan tells, or they are of different units or places.
    """
    check_pair(scan.other, scan.points)
    found, failed = [], []
    for points in (scan.points, scan.other):
        try:
            found.append(_estimated(np.ascontiguousarray(points, np.float32).tobytes()))
        except InputError as error:
            failed.append(error)
    if not found:
        raise failed[0]
    return min(found, key=lambda viewpoint: float(np.linalg.norm(viewpoint.deviation[:3])))


@lru_cache(maxsize=4)
def _estimated(points: bytes) -> Viewpoint:
    """The estimate from one scan, given as its bytes: with and without elements, a scan is asked twice."""
    return estimate(np.frombuffer(points, np.float32).reshape(-1, 3), *FIELD_OF_VIEW)


def evidence_features(
    scan: ThesisScan, scenario: str, viewpoint: Viewpoint, *, elements: bool, threads: int | None = None
) -> np.ndarray:
    """What rays say of the points of the scored scan, (N, F) float32, columns as evidence.FEATURES.

    Args:
        scan: both clouds.
        scenario: fixes which of them is the prior's.
        viewpoint: of both.
        elements: whether to know the elements of the prior's points; the robot's never are.
        threads: how many to use; by default one for each core it may run on.
    """
    removed = scenario.endswith("removed")
    prior, robot = (scan.points, scan.other) if removed else (scan.other, scan.points)
    element = _numbered(scan.element) if removed and elements and scan.element is not None else None
    pair = CloudPair(prior, robot, viewpoint.position, element)
    view = (prior_view if removed else robot_view)(pair, scan.distance, threads)
    return features_of(view, frame_of_pair(pair))


def _numbered(element: np.ndarray) -> np.ndarray:
    """Elements numbered from 0: categoryIDs may be negative, which here means unknown."""
    return np.unique(element, return_inverse=True)[1].ravel()
