#!/usr/bin/env bash
# pye57 does not read, as its defaults stand, a file that pye57 has just written.
#
# Library: pye57 0.4.19 (PyPI).
# A good guess: `read_scan(0)` reads any scan with cartesianX, cartesianY and cartesianZ. The format has a field that
#   marks points as invalid, and a file may leave it out: then all points are valid.
# What happens: `read_scan(0)` raises ValueError when that field is missing. Points that `write_scan_raw` writes by
#   itself lack it. `ignore_missing_fields=True` helps, but then nothing else that is missing is told either: who asks
#   for the intensity of such a scan gets none, without a word.
# Seen:
#   pye57 0.4.19
#   expected: read_scan(0) gives 2 points
#   seen:     ValueError: Requested to read a field (cartesianInvalidState) with is absent fr ...
#   with ignore_missing_fields=True: 2 points; with intensity=True as well: cartesianX, cartesianY, cartesianZ
#   of a scan with the field: 2 points
# In jaxmm: the E57 reader takes the points from the library below pye57, and asks for the field only where it is.
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
points = np.array([[0.0, 1.0, 2.0], [3.0, 4.0, 5.0]])
columns = {f"cartesian{axis}": points[:, i].copy() for i, axis in enumerate("XYZ")}
for name, more in (("scan", {}), ("marked", {"cartesianInvalidState": np.zeros(2, np.int8)})):
    file = pye57.E57(f"{name}.e57", mode="w")
    file.write_scan_raw(columns | more)
    file.close()


def right(scan: dict[str, np.ndarray]) -> bool:
    return all(np.array_equal(scan[name], column) for name, column in columns.items())


print("expected: read_scan(0) gives 2 points")
file = pye57.E57("scan.e57")
try:
    seen, refused = f"{len(file.read_scan(0)['cartesianX'])} points", False
except ValueError as error:
    seen, refused = f"ValueError: {str(error)[:67]} ...", "InvalidState" in str(error)
print("seen:    ", seen)
lenient = file.read_scan(0, ignore_missing_fields=True)
asked = sorted(file.read_scan(0, intensity=True, ignore_missing_fields=True))
told = len(lenient["cartesianX"])
print(f"with ignore_missing_fields=True: {told} points; with intensity=True as well: {', '.join(asked)}")
marked = pye57.E57("marked.e57").read_scan(0)
print("of a scan with the field:", len(marked["cartesianX"]), "points")
stated = refused and right(lenient) and right(marked) and asked == sorted(columns)
print("as stated" if stated else "NO LONGER AS STATED")
sys.exit(0 if stated else 3)
PY
env/bin/python check.py
