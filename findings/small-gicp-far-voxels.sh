#!/usr/bin/env bash
# small_gicp thins a cloud that is far from the origin to one single point.
#
# Library: small_gicp 1.0.1 (PyPI: small-gicp).
# A good guess: `voxelgrid_sampling` gives about as many points wherever the cloud lies; doubles are exact there.
# What happens: voxels are counted from the origin. Beyond 2^20 of them along an axis (105 km at 0.1 m) every point is
#   out of range. Each prints a warning to standard error, nothing raises, and one of the points is all that is left.
#   It is the same with `preprocess_points`, which thins first.
# Seen:
#   small_gicp 1.0.1
#   1000 points within 10 m, thinned by voxels of 0.1 m
#   expected: nearly 1000 points, wherever they lie
#   seen:     999 points, 0 km from the origin
#   seen:     999 points, 100 km from the origin
#   seen:     1 points, 155 km from the origin
# In jaxmm: registration takes both clouds relative to the sensor before anything else.
set -euo pipefail
VERSION=${VERSION:-1.0.1}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
"${PYTHON:-python3}" -m venv env
env/bin/pip install -qq --disable-pip-version-check "small-gicp==$VERSION" numpy==2.4.6
cat > check.py <<'PY'
import sys
from importlib.metadata import version

import numpy as np
import small_gicp

print("small_gicp", version("small-gicp"))
points = np.random.default_rng(0).uniform(0.0, 10.0, (1000, 3))
print("1000 points within 10 m, thinned by voxels of 0.1 m")
print("expected: nearly 1000 points, wherever they lie")
seen = {}
for east in (0.0, 100_000.0, 155_000.0):
    seen[east] = small_gicp.voxelgrid_sampling(points + [east, 0.0, 0.0], 0.1).size()
    print(f"seen:     {seen[east]} points, {east / 1000:.0f} km from the origin")
stated = min(seen[0.0], seen[100_000.0]) > 900 and seen[155_000.0] == 1
print("as stated" if stated else "NO LONGER AS STATED")
sys.exit(0 if stated else 3)
PY
env/bin/python check.py 2> said || {
    status=$?
    tail -n 5 said >&2
    exit "$status"
}
