"""Boxes that stand about as furniture, each an element."""

import numpy as np

from warp_scanner.scenes.building import Triangles
from warp_scanner.scenes.scenes import OTHER
from warp_scanner.sensors.scan import Rays
from warp_scanner.sensors.triangles import TriangleScene, cast_triangles

BOXES = 8


def furniture_before_walls(scene: TriangleScene, rays: Rays, rng: np.random.Generator) -> Triangles:
    """Boxes of 0.7 to 2.1 m before walls, up to 0.3 m from them, about where rays (R = 1) start."""
    import trimesh  # slow to import

    found = []
    origin = rays.origin[0].astype(np.float64)
    for turn in rng.uniform(0.0, 2.0 * np.pi, BOXES):
        way = np.array([np.cos(turn), np.sin(turn), 0.0], np.float32)
        down = np.array([0.0, 0.0, -1.0], np.float32)
        reach = cast_triangles(scene, Rays(origin[None], np.stack([way, down]))).distance[0]
        size = np.array([rng.uniform(0.3, 0.6), rng.uniform(0.5, 1.5), rng.uniform(0.7, 2.1)])
        reach[0] -= size[0] / 2.0 + rng.uniform(0.02, 0.3)
        if not np.isfinite(reach).all() or reach[0] < 1.2:
            continue
        box = trimesh.creation.box(size, trimesh.transformations.rotation_matrix(turn, [0.0, 0.0, 1.0]))
        box.apply_translation(origin + way * reach[0] - [0.0, 0.0, reach[1] - size[2] / 2.0])
        found.append(box)
    whole = trimesh.util.concatenate(found) if found else trimesh.Trimesh()
    element = np.repeat(np.arange(len(found)), [len(box.faces) for box in found]).astype(np.int32)
    vertices, faces = np.asarray(whole.vertices, np.float32), np.asarray(whole.faces, np.int32)
    return Triangles(vertices.reshape(-1, 3), faces.reshape(-1, 3), element, np.full(len(found), OTHER, np.uint8))
