#!/usr/bin/env bash
# What laspy reads from a COPC file it cannot write, not even as plain LAS.
#
# Library: laspy 2.7.0 with lazrs 0.8.2 (PyPI).
# A good guess: COPC is LAZ with an index. `laspy.read` reads it as LAZ, so `write("copy.las")` makes a plain copy. That
#   laspy does not make a new index is no matter for a file without one.
# What happens: the data keep the two records of the index, and writing either raises NotImplementedError, whatever the
#   ending of the new file. When both are taken out by hand, the same points are written.
# Seen:
#   laspy 2.7.0
#   read as LAZ: 1000 points
#   expected: they can be written as plain LAS
#   seen:     copy.las: NotImplementedError: Writing COPC is not supported
#   seen:     copy.laz: NotImplementedError: Writing COPC is not supported
#   with both records of the index taken out: 1000 points in bare.las
# In jaxmm: the LAS reader takes points out of a file, COPC as well, and never hands its header to a writer.
set -euo pipefail
VERSION=${VERSION:-2.7.0}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
"${PYTHON:-python3}" -m venv env
env/bin/pip install -qq --disable-pip-version-check "laspy==$VERSION" lazrs==0.8.2 numpy==2.4.6
cat > check.py <<'PY'
import struct
import sys
from importlib.metadata import version

import laspy
import numpy as np


def write_copc(path: str, count: int) -> None:
    """A COPC file of one octree cell: a LAZ file, then the cell's entry, then what of the header tells of both."""
    header = laspy.LasHeader(version="1.4", point_format=6)
    header.scales = [0.001] * 3
    header.vlrs.append(laspy.VLR("copc", 1, "", bytes(160)))
    las = laspy.LasData(header)
    las.x, las.y, las.z = np.random.default_rng(0).uniform(0.0, 10.0, (3, count))
    las.write(path)
    with open(path, "rb") as file:
        raw = bytearray(file.read())
    record, points = struct.unpack_from("<H", raw, 94)[0], struct.unpack_from("<I", raw, 96)[0]
    assert raw[record + 2 : record + 6] == b"copc"  # the standard wants it to be the first record
    first, (chunks,) = points + 8, struct.unpack_from("<q", raw, points)
    end = len(raw)
    entry = struct.pack("<4iQii", 0, 0, 0, 0, first, chunks - first, count)
    raw += struct.pack("<H16sHQ32s", 0, b"copc", 1000, len(entry), b"") + entry
    centre_half_size_spacing = (5.0, 5.0, 5.0, 5.0, 1.0)
    struct.pack_into("<5dQQdd", raw, record + 54, *centre_half_size_spacing, end + 60, len(entry), 0.0, 0.0)
    struct.pack_into("<QI", raw, 235, end, 1)
    with open(path, "wb") as file:
        file.write(raw)


print("laspy", version("laspy"))
write_copc("scan.copc.laz", 1000)
with laspy.CopcReader.open("scan.copc.laz") as reader:
    assert len(reader.query()) == 1000  # its index is sound
las = laspy.read("scan.copc.laz")
print("read as LAZ:", len(las.points), "points")
print("expected: they can be written as plain LAS")
stated = True
for name in ("copy.las", "copy.laz"):
    try:
        las.write(name)
        print(f"seen:     {name} with {len(laspy.read(name).points)} points")
        stated = False
    except NotImplementedError as error:
        print(f"seen:     {name}: NotImplementedError: {error}")
las.header.vlrs = [one for one in las.header.vlrs if one.user_id != "copc"]
las.evlrs = [one for one in las.evlrs if one.user_id != "copc"]
las.write("bare.las")
print("with both records of the index taken out:", len(laspy.read("bare.las").points), "points in bare.las")
print("as stated" if stated else "NO LONGER AS STATED")
sys.exit(0 if stated else 3)
PY
env/bin/python check.py
