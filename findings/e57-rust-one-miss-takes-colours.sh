#!/usr/bin/env bash
# The Rust library e57 gives no colours and no intensities at all as soon as one ray of the file has no return.
#
# Library: e57 0.2.3 (PyPI), the Python binding of the Rust crate; files are written and compared with pye57 0.4.19.
# A good guess: a point whose cartesianInvalidState is 2 has no place and is left out; the others keep colour and
#   intensity. Laser scanners write such points for every ray into the sky.
# What happens: the point is left out, and with it the colours and intensities of all points, of every scan of the
#   file. The arrays are empty, as in a file that has none. Without such a point they are there. pye57 gives them in
#   either case.
# Seen:
#   e57 0.2.3
#   expected: a colour and an intensity for each point that is left
#   seen:     three points: e57 3 points, 3 colours, 3 intensities
#   seen:     three points: pye57 3 points, 3 colours, 3 intensities
#   seen:     one of three without a return: e57 2 points, 0 colours, 0 intensities
#   seen:     one of three without a return: pye57 2 points, 2 colours, 2 intensities
#   seen:     two scans, one such point: e57 5 points, 0 colours, 0 intensities
#   seen:     two scans, one such point: pye57 5 points, 5 colours, 5 intensities
# In jaxmm: E57 files that it writes hold valid points only, so their intensities are there for this reader, too.
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

KEPT = ("cartesianX", "cartesianY", "cartesianZ", "intensity", "colorRed", "colorGreen", "colorBlue")


def scan(states: list[int]) -> dict[str, np.ndarray]:
    """One point for each state, with colour and intensity."""
    row = np.arange(1.0, 1.0 + len(states))
    colours = dict.fromkeys(KEPT[4:], np.full(len(row), 200, np.uint8))
    values = dict.fromkeys(KEPT[:3], row) | {"intensity": row / 10.0} | colours
    return values | {"cartesianInvalidState": np.array(states, np.int8)}


print("e57", version("e57"))
print("expected: a colour and an intensity for each point that is left")
seen = {}
for name, scans in (
    ("three points", [[0, 0, 0]]), ("one of three without a return", [[0, 0, 2]]),
    ("two scans, one such point", [[0, 0, 0], [0, 0, 2]]),
):  # fmt: skip
    with pye57.E57("a.e57", mode="w") as file:
        for states in scans:
            file.write_scan_raw(scan(states))
    own, other = e57.read_points("a.e57"), pye57.E57("a.e57")
    parts = [other.read_scan(number, intensity=True, colors=True) for number in range(other.scan_count)]
    seen[name] = (
        tuple(len(values) for values in (own.points, own.color, own.intensity)),
        tuple(sum(len(part[field]) for part in parts) for field in ("cartesianX", "colorRed", "intensity")),
    )
    for library, counts in zip(("e57", "pye57"), seen[name], strict=True):
        print(f"seen:     {name}: {library} {counts[0]} points, {counts[1]} colours, {counts[2]} intensities")
stated = seen == {
    "three points": ((3, 3, 3), (3, 3, 3)),
    "one of three without a return": ((2, 0, 0), (2, 2, 2)),
    "two scans, one such point": ((5, 0, 0), (5, 5, 5)),
}
print("as stated" if stated else "NO LONGER AS STATED")
sys.exit(0 if stated else 3)
PY
env/bin/python check.py
