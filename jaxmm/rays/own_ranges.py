"""Ranges as a sensor measured them, of rays whose ranges have settled since. P rays, N points; metres."""

import numpy as np
import small_gicp

from jaxmm.rays.scan_rays import PosedScan, ScanRays, drawn
from jaxmm.vectors import lengths
from warp_scanner.launches import thread_count

SAME = 2e-5  # [rad] apart, up to which two rays are one: a settled point lies on its ray, but for rounding


def own_ranges(rays: ScanRays, rotation: np.ndarray, whole: PosedScan | None) -> np.ndarray:
    """(rays.measured,) float32 [m] ranges before they settled; that of the ray where it is none of the scan's own.

    Args:
        rays: of a scan where it was placed.
        rotation: (3, 3) of that scan, sensor frame to world.
        whole: the scan as it was measured, wherever it was believed to be; None: nothing has settled.
    """
    distance = rays.distance[: rays.measured]
    if whole is None or not rays.measured:
        return distance
    offset = drawn(whole.points, whole.position) - whole.position
    reach = lengths(offset)
    known = offset / reach[:, None] @ (rotation @ whole.rotation.T).T
    tree = small_gicp.KdTree(known, num_threads=thread_count(None))
    asked = rays.direction[: rays.measured].astype(np.float64)
    near, square = (found[:, 0] for found in tree.batch_knn_search(asked, 1, num_threads=thread_count(None)))
    return np.where(square < SAME**2, reach[near], distance).astype(np.float32)
