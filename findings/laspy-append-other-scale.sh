#!/usr/bin/env bash
# laspy appends points whose scale or offset is another as if it were that of the file.
#
# Library: laspy 2.7.0 (PyPI).
# A good guess: points know their scale and offset, and `write_points` brings them to those of a new file; so
#   `append_points` brings them to those of the file that it opens, as when the scans of two days become one file.
# What happens: it copies the whole numbers as they are. Coordinates of 101 and 102 m are read again as 0.1 and 0.2 m,
#   without a warning.
# Seen:
#   laspy 2.7.0
#   a file of scale 0.001 and offset 0; points at x = 101 and 102 of scale 0.01 and offset 100
#   expected: 101.0 and 102.0, either way
#   seen:     write_points: [101.0, 102.0]
#   seen:     append_points, behind 1.0 and 2.0: [1.0, 2.0, 0.1, 0.2]
# In jaxmm: LAS files are written whole, in one go, with one scale and offset.
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

print("laspy", version("laspy"))
print("a file of scale 0.001 and offset 0; points at x = 101 and 102 of scale 0.01 and offset 100")
print("expected: 101.0 and 102.0, either way")


def header(scale, offset):
    """Of LAS 1.2, with one scale and offset for all axes."""
    made = laspy.LasHeader(point_format=3, version="1.2")
    made.scales, made.offsets = [scale] * 3, [offset] * 3
    return made


def cloud(scale, offset, x):
    """Points along x."""
    made = laspy.LasData(header(scale, offset))
    made.x, made.y, made.z = np.array(x), np.array(x), np.array(x)
    return made


def along(path):
    """x of all points, as it is read."""
    return np.round(np.asarray(laspy.read(path).x), 6).tolist()


later = cloud(0.01, 100.0, [101.0, 102.0])
assert np.asarray(later.x).tolist() == [101.0, 102.0]
with laspy.open("new.las", mode="w", header=header(0.001, 0.0)) as file:
    file.write_points(later.points)
written = along("new.las")
print(f"seen:     write_points: {written}")

later = cloud(0.01, 100.0, [101.0, 102.0])
cloud(0.001, 0.0, [1.0, 2.0]).write("old.las")
with laspy.open("old.las", mode="a") as file:
    file.append_points(later.points)
appended = along("old.las")
print(f"seen:     append_points, behind 1.0 and 2.0: {appended}")
stated = written == [101.0, 102.0] and appended == [1.0, 2.0, 0.1, 0.2]
print("as stated" if stated else "NO LONGER AS STATED")
sys.exit(0 if stated else 3)
PY
env/bin/python check.py
