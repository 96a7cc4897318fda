#!/usr/bin/env bash
# Matplotlib's 3D axes scale the array that they are given as aspect, in place.
#
# Library: matplotlib 3.11.2 (PyPI).
# A good guess: `set_box_aspect(size)` reads the three numbers. The caller's array of a room's size stays as it was.
# What happens: it multiplies the array itself. The next line that uses the size draws a room of other dimensions. A
#   tuple or a list is copied and stays.
# Seen:
#   matplotlib 3.11.2
#   expected: [4.0, 3.0, 2.5] before and after set_box_aspect(size)
#   seen:     [1.3636, 1.0227, 0.8523] after
# In jaxmm: the figures of rooms hand over a tuple.
set -euo pipefail
VERSION=${VERSION:-3.11.2}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
"${PYTHON:-python3}" -m venv env
env/bin/pip install -qq --disable-pip-version-check "matplotlib==$VERSION" numpy==2.4.6
cat > check.py <<'PY'
import sys
from importlib.metadata import version

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

print("matplotlib", version("matplotlib"))
size = np.array([4.0, 3.0, 2.5])
before = size.tolist()
plt.figure().add_subplot(projection="3d").set_box_aspect(size)
print("expected:", before, "before and after set_box_aspect(size)")
print("seen:    ", size.round(4).tolist(), "after")
print("as stated" if size.tolist() != before else "NO LONGER AS STATED")
sys.exit(0 if size.tolist() != before else 3)
PY
MPLCONFIGDIR=$work/config env/bin/python check.py
