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
#   seen:     yMinimum  0.0  yMaximum -1.0
#   seen:     zMinimum  0.0  zMaximum  1.0
# In jaxmm: the E57 writer leaves the optional bounds out, and the reader never asks for them.
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

print("pye57", version("pye57"))
corners = np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [2.0, 1.0, 0.0], [0.0, 1.0, 1.0]])
file = pye57.E57("scan.e57", mode="w")
file.write_scan_raw(
    {f"cartesian{axis}": corners[:, i].copy() for i, axis in enumerate("XYZ")},
    rotation=np.array([0.0, 0.0, 0.0, 1.0]),  # half a turn about z, as w, x, y, z
    translation=np.zeros(3),
)
file.close()
file = pye57.E57("scan.e57")
bounds = file.get_header(0).cartesianBounds
print("points: x from 0 to 2, y from 0 to 1; the scan is turned by half about z")
print("expected: minimum at most maximum on every axis (world: x -2 to 0, y -1 to 0; sensor: x 0 to 2, y 0 to 1)")
upside_down = []
for axis in "xyz":
    low, high = (bounds[f"{axis}{end}"].value() + 0.0 for end in ("Minimum", "Maximum"))
    print(f"seen:     {axis}Minimum {low:4.1f}  {axis}Maximum {high:4.1f}")
    upside_down.append(low > high)
print("as stated" if any(upside_down) else "NO LONGER AS STATED")
sys.exit(0 if any(upside_down) else 3)
PY
env/bin/python check.py
