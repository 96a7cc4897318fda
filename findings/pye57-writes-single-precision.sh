#!/usr/bin/env bash
# pye57 writes float64 coordinates in single precision.
#
# Library: pye57 0.4.19 (PyPI).
# A good guess: `write_scan_raw` keeps what it is given. The format knows doubles, and reading gives float64 back.
# What happens: coordinates are stored as single floats. At 4,500 km from the origin, where national grids are, that is
#   half a metre from one value to the next. As the array that is read is of doubles, nothing shows it. Written by the
#   library below, to nodes of double precision, and read by pye57, the same numbers come back.
# Seen:
#   pye57 0.4.19
#   expected: [4500000.12, 4500000.25, 4500000.37, 4500000.88]
#   seen:     [4500000.0, 4500000.0, 4500000.5, 4500001.0] float64 (off by up to 0.25 m)
#   from nodes of double precision: [4500000.12, 4500000.25, 4500000.37, 4500000.88]
# In jaxmm: the E57 writer makes its own nodes, of double precision, with points about the sensor and the pose beside.
set -euo pipefail
VERSION=${VERSION:-0.4.19}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
"${PYTHON:-python3}" -m venv env
env/bin/pip install -qq --disable-pip-version-check "pye57==$VERSION" numpy==2.4.6
cat > check.py <<'PY'
import sys
from importlib.metadata import version

import numpy as np
import pye57
from pye57 import libe57


def write_doubles(path: str, values: np.ndarray) -> None:
    """The same numbers on all three axes, by the library below, in double precision."""
    file = pye57.E57(path, mode="w")
    image = file.image_file
    scan, prototype = libe57.StructureNode(image), libe57.StructureNode(image)
    file.data3d.append(scan)
    scan.set("guid", libe57.StringNode(image, "{8d0e4a3c-6a2b-4b37-9a55-0c6d35d4e003}"))
    buffers = libe57.VectorSourceDestBuffer()
    columns = {f"cartesian{axis}": values.copy() for axis in "XYZ"}
    for name, column in columns.items():
        prototype.set(name, libe57.FloatNode(image, 0.0, libe57.E57_DOUBLE, -1e7, 1e7))
        buffers.append(libe57.SourceDestBuffer(image, name, column, len(column), True, True))
    points = libe57.CompressedVectorNode(image, prototype, libe57.VectorNode(image, True))
    scan.set("points", points)
    writer = points.writer(buffers)
    writer.write(len(values))
    writer.close()
    file.close()


print("pye57", version("pye57"))
given = 4_500_000.0 + np.array([0.12, 0.25, 0.37, 0.88])
file = pye57.E57("scan.e57", mode="w")
file.write_scan_raw({f"cartesian{axis}": given for axis in "XYZ"})
file.close()
found = pye57.E57("scan.e57").read_scan_raw(0)["cartesianX"]
error = np.abs(found - given).max()
print("expected:", given.tolist())
print("seen:    ", found.tolist(), found.dtype, f"(off by up to {error:.2f} m)")
write_doubles("doubles.e57", given)
doubles = pye57.E57("doubles.e57").read_scan_raw(0)["cartesianX"]
print("from nodes of double precision:", doubles.tolist())
in_floats = found.dtype == np.float64 and np.array_equal(found, given.astype(np.float32)) and error > 0.1
stated = in_floats and np.array_equal(doubles, given)
print("as stated" if stated else "NO LONGER AS STATED")
sys.exit(0 if stated else 3)
PY
env/bin/python check.py
