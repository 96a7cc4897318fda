#!/usr/bin/env bash
# The Rust library e57 scales points by the square of the length of a pose's quaternion.
#
# Library: e57 0.2.3 (PyPI), the Python binding of the Rust crate; files are written and compared with pye57 0.4.19.
# A good guess: a rotation turns points and leaves their distances. ASTM E2807 asks for unit quaternions, and programs
#   that write 2, 0, 0, 0 or 0, 0, 0, 0 for "not turned" exist; readers normalise, or refuse.
# What happens: the quaternion is used as it is. Of length 2 it makes the scan four times as large, of length 0 all points
#   come to lie at the position of the scanner; no error, no warning. With unit length both libraries agree.
# Seen:
#   e57 0.2.3
#   a point at [4, 5, 6], not turned
#   expected: [4.0, 5.0, 6.0], or an error
#   seen:     quaternion of length 1: e57 [4.0, 5.0, 6.0], pye57 [4.0, 5.0, 6.0]
#   seen:     quaternion of length 2: e57 [16.0, 20.0, 24.0], pye57 [4.0, 5.0, 6.0]
#   seen:     quaternion of length 0: e57 [0.0, 0.0, 0.0], pye57 [0.0, 0.0, 0.0]
# In jaxmm: quaternions that are written have unit length; of those that are read, 0 0 0 0 is told and taken for none, and
#   any other is normalised.
set -euo pipefail
VERSION=${VERSION:-0.2.3}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
"${PYTHON:-python3}" -m venv env
env/bin/pip install -qq --disable-pip-version-check "e57==$VERSION" pye57==0.4.19 pyquaternion==0.9.9 numpy==2.4.6
cat > check.py <<'PY'
import sys
from importlib.metadata import version

import e57
import numpy as np
import pye57
from pye57 import libe57

PLACE = [4.0, 5.0, 6.0]


def write(path: str, length: float) -> None:
    """One scan of two points, the second at PLACE, with a quaternion (length, 0, 0, 0)."""
    with pye57.E57(path, mode="w") as file:
        image = file.image_file
        scan, pose, kinds = (libe57.StructureNode(image) for _ in range(3))
        file.data3d.append(scan)
        scan.set("guid", libe57.StringNode(image, "{6a1f4a52-64a5-5a66-9c39-1f0c2f8f3c57}"))
        scan.set("pose", pose)
        for part, told in (("rotation", dict(w=length, x=0.0, y=0.0, z=0.0)), ("translation", dict(x=0.0, y=0.0, z=0.0))):
            node = libe57.StructureNode(image)
            pose.set(part, node)
            for name, value in told.items():
                node.set(name, libe57.FloatNode(image, value))
        buffers, columns = libe57.VectorSourceDestBuffer(), np.array([[1.0, 2.0, 3.0], PLACE]).T.copy()
        for axis, column in zip("XYZ", columns, strict=True):
            kinds.set(f"cartesian{axis}", libe57.FloatNode(image, 0.0))
            buffers.append(libe57.SourceDestBuffer(image, f"cartesian{axis}", column, 2, True, True))
        points = libe57.CompressedVectorNode(image, kinds, libe57.VectorNode(image, True))
        scan.set("points", points)
        writer = points.writer(buffers)
        writer.write(2)
        writer.close()


print("e57", version("e57"))
print("a point at [4, 5, 6], not turned")
print(f"expected: {PLACE}, or an error")
stated = True
for length, factor in ((1, 1.0), (2, 4.0), (0, 0.0)):
    write("a.e57", float(length))
    try:
        own = np.asarray(e57.read_points("a.e57").points)[1].round(9).tolist()
    except Exception as error:
        own = type(error).__name__
    read = pye57.E57("a.e57").read_scan(0, ignore_missing_fields=True)
    other = [float(read[f"cartesian{axis}"][1]) for axis in "XYZ"]
    print(f"seen:     quaternion of length {length}: e57 {own}, pye57 {other}")
    stated &= own == [factor * value for value in PLACE]
    stated &= length == 0 or other == PLACE
print("as stated" if stated else "NO LONGER AS STATED")
sys.exit(0 if stated else 3)
PY
env/bin/python check.py
