#!/usr/bin/env bash
# Open3D reads binary PCD files of doubles as points that are all at 0, 0, 0.
#
# Library: open3d 0.20.0 (PyPI); the files are written by pypcd4 1.5.1.
# A good guess: PCD allows TYPE F SIZE 8, and Open3D holds points as doubles, so `o3d.io.read_point_cloud` reads them.
# What happens: from text files it does. From binary and compressed ones come the right number of points, each at the
#   origin, without a warning. The newer `o3d.t.io` reads all three rightly. Written by `o3d.io`, PCD is of floats.
# Seen:
#   open3d 0.20.0
#   two points, the first at [155000.25, 463000.5, 1.75]
#   expected: both read to the last digit, by either function
#   seen:     ascii: io 2 points, the first at [155000.25, 463000.5, 1.75]; t.io right
#   seen:     binary: io 2 points, the first at [0.0, 0.0, 0.0]; t.io right
#   seen:     binary_compressed: io 2 points, the first at [0.0, 0.0, 0.0]; t.io right
#   written by io: SIZE 4 4 4, TYPE F F F
# In jaxmm: the PCD writer uses floats as long as they are exact to a tenth of a millimetre; beyond, it writes doubles,
#   and beside them a file of floats that is moved by whole kilometres.
#
# Open3D needs libGL, libX11, libgomp and libusb of the system; the last is taken from PyPI where it is missing.
set -euo pipefail
VERSION=${VERSION:-0.20.0}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
"${PYTHON:-python3}" -m venv env
env/bin/pip install -qq --disable-pip-version-check "open3d==$VERSION" pypcd4==1.5.1 numpy==2.4.6 \
    libusb-package==1.0.30.0
if ! env/bin/python -c "import open3d" 2> reason; then
    mkdir lib
    ln -s "$(find "$work/env" -name 'libusb-1.0.so*' | head -n 1)" lib/libusb-1.0.so.0
    export LD_LIBRARY_PATH=$work/lib${LD_LIBRARY_PATH:+:$LD_LIBRARY_PATH}
fi
cat > check.py <<'PY'
import sys
from importlib.metadata import version

import numpy as np
import open3d as o3d
import pypcd4

print("open3d", version("open3d"))
points = np.array([[155_000.25, 463_000.5, 1.75], [155_001.25, 463_002.5, 2.75]])
print("two points, the first at", points[0].tolist())
print("expected: both read to the last digit, by either function")
seen = {}
for encoding in (pypcd4.Encoding.ASCII, pypcd4.Encoding.BINARY, pypcd4.Encoding.BINARY_COMPRESSED):
    name = encoding.name.lower()
    cloud = pypcd4.PointCloud.from_points(list(points.T), ("x", "y", "z"), (np.float64,) * 3)
    cloud.save(f"{name}.pcd", encoding=encoding)
    assert np.allclose(pypcd4.PointCloud.from_path(f"{name}.pcd").numpy(("x", "y", "z")), points, rtol=0, atol=1e-6)
    found = np.asarray(o3d.io.read_point_cloud(f"{name}.pcd").points)
    newer = o3d.t.io.read_point_cloud(f"{name}.pcd").point.positions.numpy()
    right = np.allclose(newer, points, rtol=0, atol=1e-6)
    told = "right" if right else "wrong"
    seen[name] = found, right
    print(f"seen:     {name}: io {len(found)} points, the first at {found[0].tolist()}; t.io {told}")
ascii_points, _ = seen["ascii"]
stated = ascii_points.shape == points.shape and np.allclose(ascii_points, points, rtol=0, atol=1e-6)
lost = seen["binary"][0], seen["binary_compressed"][0]
stated &= all(found.shape == points.shape and not found.any() for found in lost)
stated &= all(right for _, right in seen.values())
o3d.io.write_point_cloud("own.pcd", o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points)))
with open("own.pcd", "rb") as file:
    header = [line.decode().split() for line in file.read(400).split(b"\n") if line.startswith((b"SIZE", b"TYPE"))]
print("written by io:", ", ".join(" ".join(line) for line in header))
stated &= header == [["SIZE", "4", "4", "4"], ["TYPE", "F", "F", "F"]]
print("as stated" if stated else "NO LONGER AS STATED")
sys.exit(0 if stated else 3)
PY
env/bin/python check.py
