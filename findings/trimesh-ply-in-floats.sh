#!/usr/bin/env bash
# trimesh holds vertices as doubles and writes them to PLY as floats.
#
# Library: trimesh 5.2.0 (PyPI).
# A good guess: PLY knows doubles, and a mesh or cloud of float64 that is written and read again stays where it was.
# What happens: the header says `property float x`. On a national grid corners move by up to a quarter of a metre, and
#   thin walls get thick or lose their thickness. OBJ keeps the digits.
# Seen:
#   trimesh 5.2.0
#   a wall 0.1 m thick, 5,335 km from the origin
#   expected: 0.1 m thick when it is read again
#   seen:     0.0000 m from PLY
#   seen:     0.0000 m from PLY, its corners as a cloud
#   seen:     0.1000 m from OBJ
#   the header of the PLY: property float x
# In jaxmm: the PLY writer is its own, with `property double`.
set -euo pipefail
VERSION=${VERSION:-5.2.0}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
"${PYTHON:-python3}" -m venv env
env/bin/pip install -qq --disable-pip-version-check "trimesh==$VERSION" numpy==2.4.6
cat > check.py <<'PY'
import sys
from importlib.metadata import version

import numpy as np
import trimesh

print("trimesh", version("trimesh"))
wall = trimesh.creation.box((4.0, 0.1, 3.0))
wall.apply_translation((691_000.0, 5_335_000.1, 0.0))  # as in UTM
print("a wall 0.1 m thick, 5,335 km from the origin")
print("expected: 0.1 m thick when it is read again")


def thick(shape) -> float:
    return float(np.ptp(np.asarray(shape.vertices), axis=0)[1])


wall.export("wall.ply")
wall.export("wall.obj")
trimesh.PointCloud(wall.vertices).export("cloud.ply")
mesh, obj = (thick(trimesh.load_mesh(f"wall.{ending}", process=False)) for ending in ("ply", "obj"))
cloud = thick(trimesh.load("cloud.ply"))
print(f"seen:     {mesh:.4f} m from PLY")
print(f"seen:     {cloud:.4f} m from PLY, its corners as a cloud")
print(f"seen:     {obj:.4f} m from OBJ")
with open("wall.ply", "rb") as file:
    kind = next(line for line in file if line.startswith(b"property")).decode().strip()
print("the header of the PLY:", kind)
stated = mesh == cloud == 0.0 and kind == "property float x" and abs(obj - 0.1) < 1e-6
print("as stated" if stated else "NO LONGER AS STATED")
sys.exit(0 if stated else 3)
PY
env/bin/python check.py
