#!/usr/bin/env bash
# pye57 writes bounds whose minimum is above their maximum when a scan is turned.
#
# Library: pye57 0.4.19 (PyPI).
# A good guess: `cartesianBounds` of a scan holds the least and the greatest coordinate on each axis.
# What happens: the least and the greatest corner are found in the sensor's frame, and then turned by the pose as two
#   points. Turned by half about z they change places; who skips scans by their bounds skips the wrong ones.
# Seen:
#   pye57 0.4.19
#   points: x from 0 to 2, y from 0 to 1; the scan is turned by half about z
#   expected: minimum at most maximum on every axis (world: x -2 to 0, y -1 to 0; sensor: x 0 to 2, y 0 to 1)
#   seen:     xMinimum  0.0  xMaximum -2.0
#             yMinimum  0.0  yMaximum -1.0
#             zMinimum  0.0  zMaximum  1.0
#   not turned:
#   seen:     xMinimum  0.0  xMaximum  2.0
#             yMinimum  0.0  yMaximum  1.0
#             zMinimum  0.0  zMaximum  1.0
# In jaxmm: the E57 writer leaves the optional bounds out, and the reader never asks for them.
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

print("pye57", version("pye57"))
corners = np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [2.0, 1.0, 0.0], [0.0, 1.0, 1.0]])


def bounds(w: float, z: float) -> list[list[float]]:
    """Minimum and maximum on each axis, of the points turned about z."""
    file = pye57.E57("scan.e57", mode="w")
    columns = {f"cartesian{axis}": corners[:, i].copy() for i, axis in enumerate("XYZ")}
    file.write_scan_raw(columns, rotation=np.array([w, 0.0, 0.0, z]), translation=np.zeros(3))
    file.close()
    file = pye57.E57("scan.e57")
    found = file.get_header(0).cartesianBounds
    found = [[found[f"{axis}{end}"].value() + 0.0 for end in ("Minimum", "Maximum")] for axis in "xyz"]
    file.close()
    for start, axis, (low, high) in zip(("seen:    ", " " * 9, " " * 9), "xyz", found):
        print(f"{start} {axis}Minimum {low:4.1f}  {axis}Maximum {high:4.1f}")
    return found


print("points: x from 0 to 2, y from 0 to 1; the scan is turned by half about z")
print("expected: minimum at most maximum on every axis (world: x -2 to 0, y -1 to 0; sensor: x 0 to 2, y 0 to 1)")
turned = bounds(0.0, 1.0)
print("not turned:")
plain = bounds(1.0, 0.0)
stated = np.allclose(turned, [[0, -2], [0, -1], [0, 1]]) and np.allclose(plain, [[0, 2], [0, 1], [0, 1]])
print("as stated" if stated else "NO LONGER AS STATED")
sys.exit(0 if stated else 3)
PY
env/bin/python check.py
