#!/usr/bin/env bash
# pye57 takes a column of numpy.int64 for one of 32-bit integers, so half of the numbers that it writes are others.
#
# Library: pye57 0.4.19 (PyPI), on Linux, where NumPy has two types of 64 bits: int64 (a C long) and longlong.
# A good guess: an integer column of int64, NumPy's usual integer, is written and read as it is.
# What happens: the buffer is walked in steps of four bytes. From small positive numbers 5, 6, 7 the file gets 5, 0, 6;
#   of an array that is read into only half is filled. `numpy.longlong` of the same size works.
# Seen:
#   pye57 0.4.19
#   expected: [5, 6, 7] from both types of 64 bits
#   seen:     [5, 0, 6] written from numpy.int64, read as numpy.longlong
#             [25769803781, 7, 0] written from numpy.longlong, read as numpy.int64
#             [5, 6, 7] written from numpy.longlong, read as numpy.longlong
# In jaxmm: the E57 writer hands over its element numbers as numpy.longlong.
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


def through_a_file(kind: type, read_as: type) -> list[int]:
    """5, 6, 7 as rowIndex, written from an array of one type, and read into an array of the other."""
    file = pye57.E57("scan.e57", mode="w")
    image = file.image_file
    scan = libe57.StructureNode(image)
    file.data3d.append(scan)
    scan.set("guid", libe57.StringNode(image, "{8d0e4a3c-6a2b-4b37-9a55-0c6d35d4e002}"))
    prototype, buffers = libe57.StructureNode(image), libe57.VectorSourceDestBuffer()
    columns = {f"cartesian{axis}": np.zeros(3) for axis in "XYZ"} | {"rowIndex": np.array([5, 6, 7], kind)}
    for name, column in columns.items():
        whole = name == "rowIndex"
        prototype.set(name, libe57.IntegerNode(image, 0, 0, 100) if whole else libe57.FloatNode(image, 0.0))
        buffers.append(libe57.SourceDestBuffer(image, name, column, 3, True, True))
    points = libe57.CompressedVectorNode(image, prototype, libe57.VectorNode(image, True))
    scan.set("points", points)
    writer = points.writer(buffers)
    writer.write(3)
    writer.close()
    file.close()

    file = pye57.E57("scan.e57")
    found, buffers = np.zeros(3, read_as), libe57.VectorSourceDestBuffer()
    buffers.append(libe57.SourceDestBuffer(file.image_file, "rowIndex", found, 3, True, True))
    reader = file.get_header(0).points.reader(buffers)
    reader.read()
    reader.close()
    file.close()
    return found.tolist()


print("pye57", version("pye57"))
print("expected: [5, 6, 7] from both types of 64 bits")
written = through_a_file(np.int64, np.longlong)
read = through_a_file(np.longlong, np.int64)
neither = through_a_file(np.longlong, np.longlong)
print("seen:    ", written, "written from numpy.int64, read as numpy.longlong")
print("         ", read, "written from numpy.longlong, read as numpy.int64")
print("         ", neither, "written from numpy.longlong, read as numpy.longlong")
stated = written == [5, 0, 6] and read == [5 + 6 * 2**32, 7, 0] and neither == [5, 6, 7]
print("as stated" if stated else "NO LONGER AS STATED")
sys.exit(0 if stated else 3)
PY
env/bin/python check.py
