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
#   seen:     0.0 km from the origin: 999 points, 999 by preprocess_points
#   seen:     104.8 km from the origin: 999 points, 999 by preprocess_points
#   seen:     104.9 km from the origin: 1 points, 1 by preprocess_points
#   seen:     155.0 km from the origin: 1 points, 1 by preprocess_points
#   warnings on standard error: 4000
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
from pathlib import Path

import numpy as np
import small_gicp

print("small_gicp", version("small-gicp"))
points = np.random.default_rng(0).uniform(0.0, 10.0, (1000, 3))
print("1000 points within 10 m, thinned by voxels of 0.1 m")
print("expected: nearly 1000 points, wherever they lie")
stated = True
for east, near in ((0.0, True), (104_800.0, True), (104_900.0, False), (155_000.0, False)):
    cloud = points + [east, 0.0, 0.0]
    left = small_gicp.voxelgrid_sampling(cloud, 0.1).size()
    first, _ = small_gicp.preprocess_points(cloud, downsampling_resolution=0.1)
    print(f"seen:     {east / 1000:.1f} km from the origin: {left} points, {first.size()} by preprocess_points")
    stated &= min(left, first.size()) > 900 if near else left == first.size() == 1
warnings = Path("said").read_text().count("out of range")
print("warnings on standard error:", warnings)
stated &= warnings == 4 * len(points)  # one a point, at either far place, by either function
print("as stated" if stated else "NO LONGER AS STATED")
sys.exit(0 if stated else 3)
PY
env/bin/python check.py 2> said || {
    status=$?
    tail -n 5 said >&2
    exit "$status"
}
