#!/usr/bin/env bash
# pye57 reads the quaternion of a pose by the position of its parts in the file, not by their names.
#
# Library: pye57 0.4.19 (PyPI).
# A good guess: the children w, x, y, z of `rotation` are named, so their order in the file does not matter.
# What happens: the first child is taken for w, the second for x, and so on. A file that lists x, y, z, w, a common
#   order of quaternions, is read without a word, with another rotation. The library below pye57 finds each by name.
# Seen:
#   pye57 0.4.19
#   a quarter turn to the left about z, of the point (1, 0, 0)
#   expected: (0, 1, 0), in whatever order the file lists the four numbers
#   seen:     listed w x y z: [0.0, 1.0, 0.0]
#             listed x y z w: [-1.0, 0.0, 0.0]
#   each part found by its name, by the library below: in both
# In jaxmm: the E57 reader asks for every child by its name.
set -euo pipefail
VERSION=${VERSION:-0.4.19}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
"${PYTHON:-python3}" -m venv env
env/bin/pip install -qq --disable-pip-version-check "pye57==$VERSION" numpy==2.4.6 \
    pyquaternion==0.9.9
cat > check.py <<'PY'
import sys
from importlib.metadata import version

import numpy as np
import pye57
from pye57 import libe57

QUARTER_TURN = {"w": 0.5**0.5, "x": 0.0, "y": 0.0, "z": 0.5**0.5}  # about z, to the left


def scan_at(order: str) -> tuple[np.ndarray, bool]:
    """Where pye57 puts the point (1, 0, 0) of a scan whose rotation lists its parts in that order.

    And whether the library below finds each part by its name.
    """
    file = pye57.E57("scan.e57", mode="w")
    image = file.image_file
    scan, pose, rotation = (libe57.StructureNode(image) for _ in range(3))
    file.data3d.append(scan)
    scan.set("guid", libe57.StringNode(image, "{8d0e4a3c-6a2b-4b37-9a55-0c6d35d4e001}"))
    scan.set("pose", pose)
    pose.set("rotation", rotation)
    for part in order:
        rotation.set(part, libe57.FloatNode(image, QUARTER_TURN[part]))
    prototype, buffers = libe57.StructureNode(image), libe57.VectorSourceDestBuffer()
    columns = {f"cartesian{axis}": np.array([value]) for axis, value in zip("XYZ", (1.0, 0.0, 0.0))}
    for name, column in columns.items():
        prototype.set(name, libe57.FloatNode(image, column[0], libe57.E57_DOUBLE, -1.0, 1.0))
        buffers.append(libe57.SourceDestBuffer(image, name, column, 1, True, True))
    points = libe57.CompressedVectorNode(image, prototype, libe57.VectorNode(image, True))
    scan.set("points", points)
    writer = points.writer(buffers)
    writer.write(1)
    writer.close()
    file.close()

    file = pye57.E57("scan.e57")
    named = file.get_header(0).node["pose"]["rotation"]
    by_name = all(abs(named[part].value() - QUARTER_TURN[part]) < 1e-12 for part in "wxyz")
    found = file.read_scan(0, ignore_missing_fields=True)
    return np.array([found[f"cartesian{axis}"][0] for axis in "XYZ"]).round(6) + 0.0, by_name


print("pye57", version("pye57"))
print("a quarter turn to the left about z, of the point (1, 0, 0)")
print("expected: (0, 1, 0), in whatever order the file lists the four numbers")
(usual, named), (other, named_too) = scan_at("wxyz"), scan_at("xyzw")
print("seen:     listed w x y z:", usual.tolist())
print("          listed x y z w:", other.tolist())
print("each part found by its name, by the library below:", "in both" if named and named_too else "not in both")
stated = np.allclose(usual, [0, 1, 0]) and np.allclose(other, [-1, 0, 0]) and named and named_too
print("as stated" if stated else "NO LONGER AS STATED")
sys.exit(0 if stated else 3)
PY
env/bin/python check.py
