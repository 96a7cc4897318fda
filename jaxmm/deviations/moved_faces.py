"""What a scan shows of some elements that were moved, where its pose is told already by all faces."""

import numpy as np

from jaxmm.deviations.deviation import fits_of, seen_of_each
from jaxmm.deviations.heights import heights_of
from jaxmm.deviations.meetings import meetings_of
from jaxmm.deviations.pose_errors import PoseError
from jaxmm.deviations.seen_surfaces import Faces
from jaxmm.deviations.shifted_columns import columns_of
from jaxmm.rays.scan_rays import ScanRays
from warp_scanner.sensors.triangles import TriangleScene


def faces_of_moved(
    scene: TriangleScene,
    rays: ScanRays,
    rows: np.ndarray,
    poses: list[PoseError],
    own: np.ndarray | None = None,
    clear: np.ndarray | None = None,
) -> Faces:
    """What one scan shows of some elements: their faces, and the heights of all.

    Args:
        scene: the model with them where they may stand.
        rays: of the scan.
        rows: (n,) int of the elements.
        poses: what its faces in the model told of its pose.
        own: as of `meetings_of`,
        clear: and this too.
    """
    met = meetings_of(scene, rays, own, clear)
    found = fits_of(scene, met.of(np.isin(met.element, rows)), columns_of(scene))
    # Without numbers, for no such face had a vote: what stands beside its place has none there.
    return Faces(rays.position, poses, seen_of_each(found, poses, rays.position), heights_of(scene.triangles, met))
