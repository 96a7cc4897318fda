"""Casts rays at the triangles of a building: the thin host side of kernels/triangles.py.

R views of one scene, P rays each, E elements, T triangles. World frame: metres, z up; all positions are offsets from
the building's origin.
"""

from typing import NamedTuple

import numpy as np
import warp as wp

from warp_scanner.kernels import triangles as kernels
from warp_scanner.launches import load, share, share_out, thread_count
from warp_scanner.scenes.building import Triangles
from warp_scanner.sensors.scan import Rays, Scan, checked_rays

_POINTS_PER_LAUNCH = 8192
_PACKETS_PER_LAUNCH = 256  # small enough to share out evenly, large enough to hide the cost of a launch


class TriangleScene(NamedTuple):
    """Triangles with the tree that finds them; made by `prepare`."""

    triangles: Triangles
    mesh: wp.Mesh


def prepare(triangles: Triangles) -> TriangleScene:
    """The scene that rays are cast at.

    Raises:
        ValueError: no triangles; a vertex is not finite; a face or an element that does not exist.
    """
    vertices, faces = np.asarray(triangles.vertices, np.float32), np.asarray(triangles.faces, np.int32)
    if faces.ndim != 2 or faces.shape[1] != 3 or not len(faces):
        raise ValueError(f"faces must be (T >= 1, 3), got {faces.shape}")
    if vertices.ndim != 2 or vertices.shape[1] != 3 or not np.isfinite(vertices).all():
        raise ValueError(f"vertices must be (V, 3) and finite, got {vertices.shape}")
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise ValueError(f"faces must name {len(vertices)} vertices, got {faces.min()} to {faces.max()}")
    element, count = np.asarray(triangles.element), len(triangles.semantic)
    if element.shape != (len(faces),) or element.min() < 0 or element.max() >= count:
        raise ValueError(f"element must be ({len(faces)},) and name {count} elements, got {element.shape}")
    load(kernels)
    points = wp.array(vertices, dtype=wp.vec3, device="cpu")
    corners = wp.array(faces.ravel(), dtype=int, device="cpu")
    # Of Warp's trees on the CPU (sah, median, cubql; leaves of 1 to 8) the fastest, by a tenth to a factor of four.
    mesh = wp.Mesh(points, corners, bvh_constructor="sah", bvh_leaf_size=4)
    return TriangleScene(triangles, mesh)


def prepare_part(triangles: Triangles, chosen: np.ndarray) -> TriangleScene:
    """Some of the triangles, `chosen` (T,) bool, at least one, with the numbers of their elements."""
    return prepare(triangles._replace(faces=triangles.faces[chosen], element=triangles.element[chosen]))


def cast_triangles(
    scene: TriangleScene, rays: Rays, present: np.ndarray | None = None, threads: int | None = None
) -> Scan:
    """The first surface along every ray, from whichever side. Rays may start anywhere and point anywhere.

    The result depends neither on the threads nor on the other rays of the call. Rays that share an origin are fastest
    in the order of a sensor's grid.

    Args:
        scene: from `prepare`.
        rays: of R views; origins as offsets from the building's origin.
        present: (E,) or (R, E) bool, which elements are there; None means all of them.
        threads: how many to use; by default one for each core it may run on.

    Raises:
        ValueError: the shapes disagree, or a direction is not of unit length.
    """
    return cast_faces(scene, rays, present, threads)[0]


def cast_faces(
    scene: TriangleScene, rays: Rays, present: np.ndarray | None = None, threads: int | None = None
) -> tuple[Scan, np.ndarray]:
    """What cast_triangles tells, and which triangle each ray hits, (R, P) int32; -1 for none."""
    views = len(np.asarray(rays.origin))
    origin, direction, rotation = checked_rays(rays, views)
    there = _present(scene, present, views)
    shape = (views, direction.shape[1])
    # The kernel writes every entry.
    scan = Scan(np.empty(shape, np.float32), np.empty(shape, np.int32), np.empty(shape, np.uint8))
    face = np.empty(shape, np.int32)
    packet_count = views * -(-direction.shape[1] // kernels.PACKET)
    if packet_count == 0:
        return scan, face

    device_scene = kernels.TriangleScene()
    device_scene.mesh = scene.mesh.id
    device_scene.element = share(np.asarray(scene.triangles.element, np.int32), wp.int32)
    device_scene.semantic = share(np.asarray(scene.triangles.semantic, np.uint8), wp.uint8)
    device_scene.present = share(there, wp.uint8)
    inputs = [device_scene, share(origin, wp.vec3), share(direction, wp.vec3), share(rotation, wp.mat33)]
    outputs = [share(scan.distance, wp.float32), share(face, wp.int32)]
    outputs += [share(scan.element, wp.int32), share(scan.semantic, wp.uint8)]

    def launch(first: int, size: int) -> None:
        wp.launch(kernels.cast_packets, dim=size, inputs=[first, *inputs], outputs=outputs, device="cpu")

    share_out(launch, packet_count, thread_count(threads), _PACKETS_PER_LAUNCH)
    return scan, face


def face_normals(triangles: Triangles, face: np.ndarray) -> np.ndarray:
    """Normals (R, P, 3) float32 of the triangles (R, P), of any length and either side; NaN where face is -1."""
    a, b, c = (triangles.vertices[corner] for corner in triangles.faces.T)
    normals = np.append(np.cross(b - a, c - a), np.full((1, 3), np.nan, np.float32), axis=0)
    return normals[face]  # -1 picks the gap at the end


def clearance(scene: TriangleScene, points: np.ndarray, reach: float) -> np.ndarray:
    """Distance (N,) float32 [m] from points (N, 3) to the nearest triangle; `reach` where there is none within it."""
    points = np.ascontiguousarray(points, np.float32)
    distance = np.full(len(points), reach, np.float32)

    def launch(first: int, size: int) -> None:
        part = slice(first, first + size)
        inputs = [scene.mesh.id, share(points[part], wp.vec3), float(reach)]
        wp.launch(kernels.find_closest, size, inputs, [share(distance[part], wp.float32)], device="cpu")

    share_out(launch, len(points), thread_count(None), _POINTS_PER_LAUNCH)
    return distance


def _present(scene: TriangleScene, present: np.ndarray | None, views: int) -> np.ndarray:
    """(1 or R, E) uint8."""
    count = len(scene.triangles.semantic)
    there = np.ones((1, count), bool) if present is None else np.atleast_2d(np.asarray(present, bool))
    if there.shape not in ((1, count), (views, count)):
        raise ValueError(f"present must be ({count},) or ({views}, {count}), got {np.shape(present)}")
    return there.astype(np.uint8)
