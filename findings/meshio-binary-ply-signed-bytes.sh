#!/usr/bin/env bash
# meshio reads unsigned bytes of a binary PLY file as signed ones.
#
# Library: meshio 5.3.5 (PyPI).
# A good guess: `property uchar red` holds 0 to 255, whether the file is binary or text.
# What happens: from a text file it does. From a binary one the array is int8: 200 is read as -56, white as -1, without
#   a warning. Written again by meshio the property is `int8`, and other programs read the negative numbers, too.
# Seen:
#   meshio 5.3.5
#   two points, red 200 and 255
#   expected: uint8 [200, 255] from either file
#   seen:     text: uint8 [200, 255]
#   seen:     binary: int8 [-56, -1]
#   seen:     binary, written and read again: property int8 red
# In jaxmm: colours of PLY files are written as uchar, and read by its own reader.
set -euo pipefail
VERSION=${VERSION:-5.3.5}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
"${PYTHON:-python3}" -m venv env
env/bin/pip install -qq --disable-pip-version-check "meshio==$VERSION" plyfile==1.1.5 numpy==2.4.6
cat > check.py <<'PY'
import sys
from importlib.metadata import version
from pathlib import Path

import meshio
import numpy as np
from plyfile import PlyData, PlyElement

print("meshio", version("meshio"))
print("two points, red 200 and 255")
print("expected: uint8 [200, 255] from either file")
points = np.zeros(2, [("x", "f4"), ("y", "f4"), ("z", "f4"), ("red", "u1")])
points["x"], points["red"] = [1.0, 2.0], [200, 255]
seen = {}
for name, text in (("text", True), ("binary", False)):
    PlyData([PlyElement.describe(points, "vertex")], text=text).write(f"{name}.ply")
    assert PlyData.read(f"{name}.ply")["vertex"]["red"].tolist() == [200, 255]
    red = meshio.read(f"{name}.ply").point_data["red"]
    seen[name] = str(red.dtype), red.tolist()
    print(f"seen:     {name}: {red.dtype} {red.tolist()}")
meshio.read("binary.ply").write("again.ply")
head = Path("again.ply").read_bytes().split(b"end_header")[0].decode()
line = next(line for line in head.splitlines() if line.endswith(" red"))
print(f"seen:     binary, written and read again: {line}")
stated = seen == {"text": ("uint8", [200, 255]), "binary": ("int8", [-56, -1])} and line == "property int8 red"
print("as stated" if stated else "NO LONGER AS STATED")
sys.exit(0 if stated else 3)
PY
env/bin/python check.py
