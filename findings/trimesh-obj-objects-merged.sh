#!/usr/bin/env bash
# trimesh makes one mesh of all objects of an OBJ file, and calls it by the name of the first.
#
# Library: trimesh 5.2.0 (PyPI).
# A good guess: `load_scene` of a file with two `o` lines has two meshes by those names, as it has for a GLB.
# What happens: without `split_objects=True` there is one mesh. A building whose walls and columns are objects of one
#   file becomes one single wall. `split_objects` is an option of the OBJ reader, passed on through `load_scene`.
# Seen:
#   trimesh 5.2.0
#   two objects of one triangle each: wall, column
#   expected: {'column': 1, 'wall': 1}
#   seen:     {'wall': 2}
#   with split_objects=True: {'column': 1, 'wall': 1}
#   of the same two as GLB: {'column': 1, 'wall': 1}
# In jaxmm: OBJ files are read by our own reader, object by object, as every element needs a verdict of its own.
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

import trimesh

OBJ = """o wall
v 0 0 0
v 4 0 0
v 0 0 3
f 1 2 3
o column
v 9 0 0
v 9 1 0
v 9 0 3
f 4 5 6
"""
print("trimesh", version("trimesh"))
with open("house.obj", "w") as file:
    file.write(OBJ)


def faces(path: str, **options) -> dict[str, int]:
    return {name: len(mesh.faces) for name, mesh in sorted(trimesh.load_scene(path, **options).geometry.items())}


print("two objects of one triangle each: wall, column")
print("expected: {'column': 1, 'wall': 1}")
plain, split = faces("house.obj"), faces("house.obj", split_objects=True)
print("seen:    ", plain)
print("with split_objects=True:", split)
corners = {"wall": [[0, 0, 0], [4, 0, 0], [0, 0, 3]], "column": [[9, 0, 0], [9, 1, 0], [9, 0, 3]]}
trimesh.Scene({name: trimesh.Trimesh(three, [[0, 1, 2]]) for name, three in corners.items()}).export("house.glb")
glb = faces("house.glb")
print("of the same two as GLB:", glb)
stated = plain == {"wall": 2} and split == glb == {"column": 1, "wall": 1}
print("as stated" if stated else "NO LONGER AS STATED")
sys.exit(0 if stated else 3)
PY
env/bin/python check.py
