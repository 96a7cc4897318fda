#!/usr/bin/env bash
# In Warp on the CPU a ray can leave a closed mesh through an edge without a hit.
#
# Library: warp-lang 1.19.0 (PyPI), CPU.
# A good guess: a ray from inside a closed box meets its surface, whatever its direction.
# What happens: of rays that are aimed at the box's edges, about one in sixty gets no hit from `mesh_query_ray`. None is
#   lost of those that are aimed at the diagonals of its faces, where two triangles lie in one plane, nor of 100,000
#   random ones.
# Seen:
#   warp-lang 1.19.0
#   rays from inside a closed box of 12 triangles
#   expected: every ray has a hit
#   seen:     1.7% of 66524 aimed at edges of the box have none
#             0 of 33476 aimed at diagonals of its faces
#             0 of 100000 random ones
# In jaxmm: rays meet triangles by kernels of its own, which lose none of such rays; scanners look along regular grids,
#   where edges are hit often.
set -euo pipefail
VERSION=${VERSION:-1.19.0}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
"${PYTHON:-python3}" -m venv env
env/bin/pip install -qq --disable-pip-version-check "warp-lang==$VERSION" numpy==2.4.6
cat > check.py <<'PY'
import sys
from importlib.metadata import version

import numpy as np
import warp as wp

wp.config.log_level = 30  # warnings and worse


@wp.kernel
def cast(
    mesh: wp.uint64, start: wp.array(dtype=wp.vec3), direction: wp.array(dtype=wp.vec3), found: wp.array(dtype=wp.int32)
):
    ray = wp.tid()
    query = wp.mesh_query_ray(mesh, start[ray], direction[ray], 100.0)
    found[ray] = wp.where(query.result, 1, 0)


RAYS = 100_000
corners = np.array([[x, y, z] for x in (-2.5, 2.5) for y in (-2.0, 2.0) for z in (-1.4, 1.4)], np.float32)
faces = np.array([[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [0, 2, 6],
                  [0, 6, 4], [1, 5, 7], [1, 7, 3]], np.int32)
mesh = wp.Mesh(wp.array(corners, dtype=wp.vec3, device="cpu"), wp.array(faces.ravel(), dtype=wp.int32, device="cpu"))


def lost(start: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Which rays have no hit."""
    direction = direction / np.linalg.norm(direction, axis=1, keepdims=True)
    found = wp.zeros(RAYS, dtype=wp.int32, device="cpu")
    inputs = [mesh.id, *(wp.array(one.astype(np.float32), dtype=wp.vec3, device="cpu") for one in (start, direction))]
    wp.launch(cast, dim=RAYS, inputs=inputs, outputs=[found], device="cpu")
    return found.numpy() == 0


print("warp-lang", version("warp-lang"))
rng = np.random.default_rng(0)
start = rng.uniform(-0.9, 0.9, (RAYS, 3)) * [2.5, 2.0, 1.4]
face, side, along = rng.integers(0, 12, RAYS), rng.integers(0, 3, RAYS), rng.random((RAYS, 1))
one, other = corners[faces[face, side]], corners[faces[face, (side + 1) % 3]]
on_edge, diagonal = one * (1.0 - along) + other * along, (one != other).sum(axis=1) == 2  # of a face, or else an edge
print("rays from inside a closed box of 12 triangles")
print("expected: every ray has a hit")
aimed, anywhere = lost(start, on_edge - start), lost(start, rng.normal(size=(RAYS, 3)))
edges, diagonals = aimed[~diagonal], aimed[diagonal]
print(f"seen:     {edges.mean():.1%} of {len(edges)} aimed at edges of the box have none")
print(f"          {diagonals.sum()} of {len(diagonals)} aimed at diagonals of its faces")
print(f"          {anywhere.sum()} of {RAYS} random ones")
stated = 0.005 < edges.mean() < 0.05 and not diagonals.any() and not anywhere.any()
print("as stated" if stated else "NO LONGER AS STATED")
sys.exit(0 if stated else 3)
PY
WARP_CACHE_PATH=$work/cache env/bin/python check.py
