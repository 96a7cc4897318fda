#!/usr/bin/env bash
# Matplotlib's 3D axes scale the array that they are given as aspect, in place.
#
# Library: matplotlib 3.11.2 (PyPI).
# A good guess: `set_box_aspect(size)` reads the three numbers. The caller's array of a room's size stays as it was.
# What happens: it multiplies the array itself. The next line that uses the size draws a room of other dimensions. A
#   tuple or a list of the same numbers is copied and stays.
# Seen:
#   matplotlib 3.11.2
#   expected: [4.0, 3.0, 2.5] before and after set_box_aspect(size)
#   seen:     [1.3636, 1.0227, 0.8523] after, of an array
#   seen:     [4.0, 3.0, 2.5] after, of a tuple
#   seen:     [4.0, 3.0, 2.5] after, of a list
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
before = [4.0, 3.0, 2.5]
print("expected:", before, "before and after set_box_aspect(size)")
after = {}
for kind, size in (("array", np.array(before)), ("tuple", tuple(before)), ("list", list(before))):
    plt.figure().add_subplot(projection="3d").set_box_aspect(size)
    after[kind] = [float(one) for one in size]
    print("seen:    ", [round(one, 4) for one in after[kind]], f"after, of {'an' if kind == 'array' else 'a'} {kind}")
scale = np.array(after["array"]) / before
stated = abs(scale[0] - 1.0) > 0.1 and np.allclose(scale, scale[0]) and after["tuple"] == after["list"] == before
print("as stated" if stated else "NO LONGER AS STATED")
sys.exit(0 if stated else 3)
PY
MPLCONFIGDIR=$work/config env/bin/python check.py
