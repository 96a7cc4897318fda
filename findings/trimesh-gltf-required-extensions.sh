#!/usr/bin/env bash
# trimesh reads glTF files that require an extension it does not know, as if they did not, and says nothing.
#
# Library: trimesh 5.2.0 (PyPI).
# A good guess: `extensionsRequired` names what a reader must know; one that does not, refuses the file (glTF 2.0, section 3.12).
# What happens: of a mesh in three places (EXT_mesh_gpu_instancing) one stands, at the origin. Corners that are normalised
#   integers (KHR_mesh_quantization) are taken as they are: a triangle of 4 m is 131 km long.
# Seen:
#   trimesh 5.2.0
#   one triangle in three places, by EXT_mesh_gpu_instancing, which the file requires
#   expected: 3 instances, edges [6.0, 1.0, 7.0]; or an error that names the extension
#   seen:     1 instance, edges [1.0, 1.0, 0.0]
#   a triangle of 4 x 4 m, its corners normalised 16-bit integers, by KHR_mesh_quantization, which the file requires
#   expected: edges [4.0, 4.0, 0.0]; or an error that names the extension
#   seen:     edges [131068.0, 131068.0, 0.0]
# In jaxmm: glTF is read by our own reader, which knows both, and refuses by name what else a file requires of its geometry.
set -euo pipefail
VERSION=${VERSION:-5.2.0}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
"${PYTHON:-python3}" -m venv env
env/bin/pip install -qq --disable-pip-version-check "trimesh==$VERSION" numpy==2.4.6
cat > check.py <<'PY'
import json
import struct
import sys
from importlib.metadata import version

import numpy as np
import trimesh

FACE = np.array([0, 1, 2, 0], "<u2")  # the last one fills up
PLACES = np.array([[0, 0, 0], [5, 0, 0], [0, 0, 7]], "<f4")


def edges(extension: str, node: dict, corners: np.ndarray, corner: dict, *more: np.ndarray) -> tuple[int, list[float]]:
    """How many instances a scene of one node has, and the edges of what it fills."""
    arrays = (corners, FACE, *more)
    starts = np.cumsum([0, *(one.nbytes for one in arrays)]).tolist()
    tree = {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [node],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "extensionsUsed": [extension], "extensionsRequired": [extension],
        "buffers": [{"byteLength": starts[-1]}],
        "bufferViews": [
            {"buffer": 0, "byteOffset": start, "byteLength": one.nbytes}
            for start, one in zip(starts, arrays, strict=False)
        ],
        "accessors": [
            {"bufferView": 0, "count": 3, "type": "VEC3", **corner},
            {"bufferView": 1, "count": 3, "type": "SCALAR", "componentType": 5123},
            *({"bufferView": 2 + n, "count": 3, "type": "VEC3", "componentType": 5126} for n in range(len(more))),
        ],
    }  # fmt: skip
    if corners.dtype.itemsize == 2:
        tree["bufferViews"][0]["byteStride"] = 8  # each corner begins at a multiple of four bytes
    text, blob = json.dumps(tree).encode(), b"".join(one.tobytes() for one in arrays)
    text += b" " * (-len(text) % 4)
    parts = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(blob), b"BIN\0") + blob
    with open("one.glb", "wb") as file:
        file.write(struct.pack("<4sII", b"glTF", 2, 12 + len(parts)) + parts)
    scene = trimesh.load_scene("one.glb")
    return len(scene.graph.nodes_geometry), np.round(scene.extents, 6).tolist()


print("trimesh", version("trimesh"))
print("one triangle in three places, by EXT_mesh_gpu_instancing, which the file requires")
print("expected: 3 instances, edges [6.0, 1.0, 7.0]; or an error that names the extension")
floats = {"componentType": 5126, "min": [0, 0, 0], "max": [1, 1, 0]}
triangle = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], "<f4")
node = {"mesh": 0, "extensions": {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": 2}}}}
count, size = edges("EXT_mesh_gpu_instancing", node, triangle, floats, PLACES)
print(f"seen:     {count} instance, edges {size}")
print("a triangle of 4 x 4 m, its corners normalised 16-bit integers, by KHR_mesh_quantization, which the file requires")
print("expected: edges [4.0, 4.0, 0.0]; or an error that names the extension")
integers = {"componentType": 5122, "normalized": True, "min": [0, 0, 0], "max": [32767, 32767, 0]}
small = np.array([[0, 0, 0, 0], [32767, 0, 0, 0], [0, 32767, 0, 0]], "<i2")  # the fourth of each fills up
_, long = edges("KHR_mesh_quantization", {"mesh": 0, "scale": [4.0, 4.0, 4.0]}, small, integers)
print(f"seen:     edges {long}")
stated = (count, size, long) == (1, [1.0, 1.0, 0.0], [131068.0, 131068.0, 0.0])
print("as stated" if stated else "NO LONGER AS STATED")
sys.exit(0 if stated else 3)
PY
env/bin/python check.py
