#!/usr/bin/env bash
# PyMeshLab's greatest distance between a scan and a model leaves out what is farthest, and so can be 0.
#
# Library: pymeshlab 2025.7.post1 (PyPI).
# A good guess: `get_hausdorff_distance` tells as `max` how far the farthest point of one mesh is from the other.
# What happens: points that are farther than `maxdist` count for nothing, neither in `max` nor in the mean, and unless
#   told otherwise that is half of the diagonal around both. Nine points in ten lie on the model: if the tenth is 24 m
#   away, the greatest distance is 0. Only n_samples tells that fewer were compared. With maxdist=100 % it is right,
#   and so is the filter that writes the distance of each point.
# Seen:
#   pymeshlab 2025.7.post1
#   a floor of 4 x 3 m; of a scan of 1000 points 900 lie on it and 100 above it
#   expected: the greatest distance is how high these are
#   seen:     1 m above: max 1 m of 1000 points; with maxdist 100 % 1 m of 1000;
#             greatest of each point's own 1 m
#   seen:     24 m above: max 0 m of 900 points; with maxdist 100 % 24 m of 1000;
#             greatest of each point's own 24 m
# In jaxmm: what of a scan is far from the model is not left out: it is told as new, or as unexplained.
#
# PyMeshLab needs libGL and libX11 of the system.
set -euo pipefail
VERSION=${VERSION:-2025.7.post1}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
"${PYTHON:-python3}" -m venv env
env/bin/pip install -qq --disable-pip-version-check "pymeshlab==$VERSION" numpy==2.4.6
cat > check.py <<'PY'
import sys
from importlib.metadata import version

import numpy as np
import pymeshlab

CORNERS = np.array([[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [4.0, 3.0, 0.0], [0.0, 3.0, 0.0]])
ON = np.random.default_rng(0).uniform((0.0, 0.0), (4.0, 3.0), (1000, 2))

print("pymeshlab", version("pymeshlab"))
print("a floor of 4 x 3 m; of a scan of 1000 points 900 lie on it and 100 above it")
print("expected: the greatest distance is how high these are")
seen = {}
for above in (1.0, 24.0):
    scan = np.column_stack([ON, np.where(np.arange(1000) < 100, above, 0.0)])
    meshes = pymeshlab.MeshSet()
    meshes.add_mesh(pymeshlab.Mesh(CORNERS, np.array([[0, 1, 2], [0, 2, 3]])), "model")
    meshes.add_mesh(pymeshlab.Mesh(scan), "scan")
    pair = {"sampledmesh": 1, "targetmesh": 0}
    plain = meshes.get_hausdorff_distance(**pair)
    whole = meshes.get_hausdorff_distance(**pair, maxdist=pymeshlab.PercentageValue(100))
    meshes.compute_scalar_by_distance_from_another_mesh_per_vertex(measuremesh=1, refmesh=0)
    each = float(meshes.mesh(1).vertex_scalar_array().max())
    seen[above] = [(round(one["max"], 3), one["n_samples"]) for one in (plain, whole)] + [round(each, 3)]
    (first, count), (second, other), _ = seen[above]
    print(f"seen:     {above:g} m above: max {first:g} m of {count} points; with maxdist 100 % {second:g} m of {other};")
    print(f"          greatest of each point's own {each:g} m")
stated = seen == {
    1.0: [(1.0, 1000), (1.0, 1000), 1.0],
    24.0: [(0.0, 900), (24.0, 1000), 24.0],
}
print("as stated" if stated else "NO LONGER AS STATED")
sys.exit(0 if stated else 3)
PY
env/bin/python check.py
