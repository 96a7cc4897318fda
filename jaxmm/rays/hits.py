"""What rays from one place meet in a building model: how far off, which element, and how its surface lies there.

P rays. Positions are offsets from the model's origin, world axes: metres, z up.
"""

from typing import NamedTuple

import numpy as np

from jaxmm.vectors import lengths
from warp_scanner.sensors.scan import Rays
from warp_scanner.sensors.surface import incidence_of
from warp_scanner.sensors.triangles import TriangleScene, cast_faces, face_normals


class Hits(NamedTuple):
    """What some rays meet in the prior."""

    distance: np.ndarray  # (P,) float32 [m], inf = nothing
    element: np.ndarray  # (P,) int32, -1
    cosine: np.ndarray  # (P,) float32 of the incidence, NaN = nothing
    normal: np.ndarray  # (P, 3) float32 unit normals of the surfaces, toward either side; NaN = nothing
    face: np.ndarray  # (P,) int32 triangle, -1


def hits_of(
    scene: TriangleScene, position: np.ndarray, direction: np.ndarray, present: np.ndarray | None = None
) -> Hits:
    """Cast rays from one place (3,) [m], along directions (P, 3), at all elements or those that are present (E,)."""
    rays = Rays(np.asarray(position, np.float64)[None], direction)
    scan, face = cast_faces(scene, rays, present)
    normal = face_normals(scene.triangles, face)
    cosine = np.cos(incidence_of(normal, rays))[0]
    with np.errstate(invalid="ignore"):  # triangles without an area, which no ray meets
        unit = normal[0] / lengths(normal[0])[:, None]
    return Hits(scan.distance[0], scan.element[0], cosine, unit, face[0])
