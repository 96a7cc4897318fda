#!/usr/bin/env bash
# What laspy reads from a COPC file it cannot write, not even as plain LAS.
#
# Library: laspy 2.7.0 with lazrs 0.8.2 (PyPI); the file is one of those that its source distribution has for its tests.
# A good guess: COPC is LAZ with an index. `laspy.read` reads it as LAZ, so `write("copy.las")` makes a plain copy. That
#   laspy does not make a new index is no matter for a file without one.
# What happens: the data keep the two records of the index, and writing either raises NotImplementedError, whatever the
#   ending of the new file. When both are taken out by hand, the same points are written.
# Seen:
#   laspy 2.7.0
#   simple.copc.laz: COPC 1.0, 65 chunks of 6 to 24 points; read as LAZ: 1065 points
#   expected: they can be written as plain LAS
#   seen:     copy.las: NotImplementedError: Writing COPC is not supported
#   seen:     copy.laz: NotImplementedError: Writing COPC is not supported
#   with both records of the index taken out: 1065 points in bare.las, the same
#   with both records of the index taken out: 1065 points in bare.laz, the same
# In jaxmm: the LAS reader takes points out of a file, COPC as well, and never hands its header to a writer.
set -euo pipefail
VERSION=${VERSION:-2.7.0}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
"${PYTHON:-python3}" -m venv env
env/bin/pip install -qq --disable-pip-version-check "laspy==$VERSION" lazrs==0.8.2 numpy==2.4.6
env/bin/pip download -qq --disable-pip-version-check --no-deps --no-binary laspy laspy==2.7.0
tar -xzf laspy-2.7.0.tar.gz --strip-components 3 laspy-2.7.0/tests/data/simple.copc.laz
cat > check.py <<'PY'
import struct
import sys
from importlib.metadata import version

import laspy
import lazrs
import numpy as np

COPC = "simple.copc.laz"


def sizes_of_chunks(path: str) -> list[int]:
    """How many points each chunk has, of a file that has what the standard of COPC 1.0 asks for."""
    with open(path, "rb") as file:
        raw = file.read()
        assert raw[:4] == b"LASF" and raw[24:26] == bytes((1, 4)) and raw[104] & 63 in (6, 7, 8)
        assert raw[377:381] == b"copc" and struct.unpack_from("<HH", raw, 393) == (1, 160)  # the first record, at 375
        assert not any(raw[375 + 54 + 72 : 375 + 54 + 160])  # reserved
        at, packing = 375, None
        for _ in range(struct.unpack_from("<I", raw, 100)[0]):
            record, length = struct.unpack_from("<HH", raw, at + 18)
            if record == 22204:
                packing = lazrs.LazVlr(raw[at + 54 : at + 54 + length])
            at += 54 + length
        assert packing.uses_variable_size_chunks()
        file.seek(struct.unpack_from("<I", raw, 96)[0])
        chunks = [count for count, _ in lazrs.read_chunk_table(file, packing)]
    with laspy.CopcReader.open(path) as reader:
        assert len(reader.query()) == sum(chunks)  # by way of the index
    return chunks


print("laspy", version("laspy"))
chunks = sizes_of_chunks(COPC)
las = laspy.read(COPC)
points = las.points.array.copy()
told = f"{len(chunks)} chunks of {min(chunks)} to {max(chunks)} points"
print(f"{COPC}: COPC 1.0, {told}; read as LAZ: {len(points)} points")
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
for name in ("bare.las", "bare.laz"):
    las.write(name)
    again = laspy.read(name).points.array
    same = np.array_equal(again, points)
    told = "the same" if same else "others"
    print(f"with both records of the index taken out: {len(again)} points in {name}, {told}")
    stated &= same
print("as stated" if stated else "NO LONGER AS STATED")
sys.exit(0 if stated else 3)
PY
env/bin/python check.py
