#!/usr/bin/env bash
# laspy.create() rounds coordinates to centimetres, without a word.
#
# Library: laspy 2.7.0 (PyPI).
# A good guess: a new file keeps the coordinates that are assigned to it, as nearly as its integers can.
# What happens: its scale is 0.01 m from the beginning, and assigning x, y and z does not change that, though integers of
#   32 bits would hold the same points at 0.1 mm. `las.x` reads back rounded at once. With a scale that is set before, the
#   same coordinates are kept.
# Seen:
#   laspy 2.7.0
#   expected: 12.3456 is kept to 0.1 mm, as 32 bits allow
#   seen:     laspy.create(): scale 0.01, 12.3456 is read as 12.35
#   with scales of 0.0001 set before: 12.3456 is read as 12.3456
# In jaxmm: the LAS writer states a scale of 0.1 mm and an offset near the points, whatever the library takes by default.
set -euo pipefail
VERSION=${VERSION:-2.7.0}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
"${PYTHON:-python3}" -m venv env
env/bin/pip install -qq --disable-pip-version-check "laspy==$VERSION" numpy==2.4.6
cat > check.py <<'PY'
import sys
from importlib.metadata import version

import laspy
import numpy as np

VALUE = 12.3456


def read_back(cloud: laspy.LasData) -> float:
    """The coordinate after it was assigned, written and read."""
    cloud.x = cloud.y = cloud.z = np.array([VALUE, -VALUE])
    cloud.write("a.las")
    return float(laspy.read("a.las").x[0])


print("laspy", version("laspy"))
print(f"expected: {VALUE} is kept to 0.1 mm, as 32 bits allow")
plain = laspy.create()
found = read_back(plain)
print(f"seen:     laspy.create(): scale {plain.header.scales[0]:g}, {VALUE} is read as {found:.6g}")
stated = plain.header.scales[0] == 0.01 and abs(found - 12.35) < 1e-9
fine = laspy.create()
fine.header.scales = np.full(3, 1e-4)
kept = read_back(fine)
print(f"with scales of 0.0001 set before: {VALUE} is read as {kept:.6g}")
stated &= abs(kept - VALUE) < 1e-9
print("as stated" if stated else "NO LONGER AS STATED")
sys.exit(0 if stated else 3)
PY
env/bin/python check.py
