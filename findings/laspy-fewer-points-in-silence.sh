#!/usr/bin/env bash
# laspy reads a LAS file that is cut off without a word: its points are simply fewer than its header says.
#
# Library: laspy 2.7.0 with lazrs 0.8.2 (PyPI).
# A good guess: the header states the number of points, so a file that ends before is an error, as it is for LAZ.
# What happens: `laspy.read` gives the points that are there, without an error and without a warning, while
#   `header.point_count` still states the old number. Whoever counts by the header indexes beyond the array; whoever does
#   not takes half of a scan for a whole one. The same points as LAZ raise an error.
# Seen:
#   laspy 2.7.0
#   100 points, the file cut off behind 60 of them
#   expected: an error, for the header states 100 points
#   seen:     LAS: 60 points, header.point_count 100, 0 warnings
#   seen:     LAZ: LazrsError
# In jaxmm: the LAS reader counts the points that come, and refuses a file that holds fewer than its header promises.
set -euo pipefail
VERSION=${VERSION:-2.7.0}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
"${PYTHON:-python3}" -m venv env
env/bin/pip install -qq --disable-pip-version-check "laspy==$VERSION" lazrs==0.8.2 numpy==2.4.6
cat > check.py <<'PY'
import struct
import sys
import warnings
from importlib.metadata import version

import laspy
import numpy as np

COUNT, LEFT = 100, 60

print("laspy", version("laspy"))
header = laspy.LasHeader(version="1.2", point_format=0)
header.scales = np.full(3, 1e-3)
cloud = laspy.LasData(header)
cloud.x, cloud.y, cloud.z = np.arange(3.0 * COUNT).reshape(3, COUNT) / 8
for name in ("whole.las", "whole.laz"):
    cloud.write(name)
    assert len(laspy.read(name).points) == COUNT
with open("whole.las", "rb") as file:
    raw = file.read()
start, size = struct.unpack_from("<I", raw, 96)[0], struct.unpack_from("<H", raw, 105)[0]
assert len(raw) == start + COUNT * size  # nothing stands behind the points
with open("cut.las", "wb") as file:
    file.write(raw[: start + LEFT * size])
with open("whole.laz", "rb") as file:
    packed = file.read()
with open("cut.laz", "wb") as file:
    file.write(packed[: len(packed) * 6 // 10])
print(f"{COUNT} points, the file cut off behind {LEFT} of them")
print(f"expected: an error, for the header states {COUNT} points")
try:
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        found = laspy.read("cut.las")
    told = f"{len(found.points)} points, header.point_count {found.header.point_count}, {len(said)} warnings"
    stated = (len(found.points), found.header.point_count, len(said)) == (LEFT, COUNT, 0)
except Exception as error:
    told, stated = type(error).__name__, False
print(f"seen:     LAS: {told}")
try:
    laspy.read("cut.laz")
    print("seen:     LAZ: no error")
    stated = False
except Exception as error:
    print(f"seen:     LAZ: {type(error).__name__}")
print("as stated" if stated else "NO LONGER AS STATED")
sys.exit(0 if stated else 3)
PY
env/bin/python check.py
