"""GLB files out of arrays, as no exporter at hand writes them: instances, quantised corners, required extensions."""

import json
import struct


def gltf(nodes, accessors, required=()):
    """A tree with one mesh for each pair of accessors: arrays, with how they are stored."""
    blob, views, told = b"", [], []
    for array, more in accessors:
        kinds = {"f4": 5126, "i2": 5122, "u2": 5123, "i1": 5120, "u1": 5121, "u4": 5125}
        width = {1: "SCALAR", 3: "VEC3", 4: "VEC4"}[1 if array.ndim == 1 else array.shape[1]]
        views.append({"buffer": 0, "byteOffset": len(blob), "byteLength": array.nbytes})
        told.append(
            {
                "bufferView": len(views) - 1,
                "componentType": kinds[array.dtype.str[1:]],
                "count": len(array),
                "type": width,
                **more,
            }
        )
        blob += array.tobytes() + bytes(-array.nbytes % 4)
    meshes = [
        {"primitives": [{"attributes": {"POSITION": n}, "indices": n + 1}]} for n in range(0, len(accessors) - 1, 2)
    ]
    tree = {"asset": {"version": "2.0"}, "scenes": [{"nodes": [0]}], "nodes": nodes, "meshes": meshes}
    tree |= {"accessors": told, "bufferViews": views, "buffers": [{"byteLength": len(blob)}]}
    tree["extensionsRequired"] = list(required)
    return tree, blob


def write_glb(path, tree, blob):
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(blob), 0x4E4942) + blob
    path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)
