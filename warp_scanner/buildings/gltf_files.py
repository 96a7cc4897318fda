"""glTF files, .gltf and .glb: the meshes of all nodes where they stand.

Read here and not by trimesh, which passes over extensions: it would leave out the instances of a mesh, take quantised
corners for metres, and find nothing in a compressed mesh. Source: the Khronos Group's specification of glTF 2.0.

V vertices, T triangles. The file's frame: y up, metres.
"""

import base64
import json
import struct
import urllib.parse
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from warp_scanner.buildings.obj_files import MeshNode

KNOWN = ("KHR_mesh_quantization", "EXT_mesh_gpu_instancing")
OF_LOOKS = ("KHR_materials_", "KHR_texture_", "KHR_lights_", "EXT_texture_", "EXT_lights_", "MSFT_texture_", "KHR_xmp")
KINDS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}
INSTANCING, DRACO = "EXT_mesh_gpu_instancing", "KHR_draco_mesh_compression"
TRIANGLES, STRIP, FAN = 4, 5, 6  # modes of primitives; points and lines have no surface
MOST_COPIES = 100_000  # nodes and their instances; more would be damage


def read_gltf(path: Path) -> list[MeshNode]:
    """All nodes with a surface; an instance of a mesh is a node of its own.

    Raises:
        ValueError: an extension that is required and not known, by name; what is not whole, or contradicts itself.
    """
    try:
        with np.errstate(all="ignore"):  # corners that are not finite are refused by who reads all meshes
            return _File(path).nodes()
    except (LookupError, TypeError, AttributeError, OverflowError, RecursionError, struct.error) as error:
        raise _wrong(path, f"its parts do not fit together ({type(error).__name__})") from error


def _wrong(path: Path, why: str) -> ValueError:
    return ValueError(f"{path}: not a readable mesh file: {why}")


class _File:
    """The tree of a file, and the bytes that it points into."""

    def __init__(self, path: Path):
        self.path = path
        text, self.blob = self._chunks(path.read_bytes())
        try:
            self.tree = json.loads(text)
        except ValueError as error:
            raise _wrong(path, "expected JSON") from error
        required = self.tree.get("extensionsRequired", [])
        unknown = [name for name in required if name not in KNOWN and not str(name).startswith(OF_LOOKS)]
        if unknown:
            told = ", ".join(map(str, unknown))[:200]
            raise _wrong(path, f"expected no extensions of the geometry but {', '.join(KNOWN)}, it requires {told}")
        self.buffers = [self._buffer(one) for one in self.tree.get("buffers", [])]

    def _chunks(self, data: bytes) -> tuple[bytes, bytes]:
        """The JSON, and what follows it in a .glb."""
        if not data.startswith(b"glTF"):
            return data, b""
        version, length, size, kind = struct.unpack("<IIII", data[4:20])
        if version != 2 or length > len(data) or kind != 0x4E4F534A or 20 + size > length:
            raise _wrong(self.path, f"expected a whole GLB of version 2, got version {version} of {len(data)} bytes")
        start = 20 + size
        if start + 8 > length:
            return data[20:start], b""
        (held,) = struct.unpack("<I", data[start : start + 4])
        return data[20:start], data[start + 8 : start + 8 + held]

    def _buffer(self, told: dict[str, Any]) -> bytes:
        uri, data = told.get("uri"), self.blob
        if uri is not None and uri.startswith("data:"):
            try:
                data = base64.b64decode(uri.partition(",")[2])
            except ValueError as error:
                raise _wrong(self.path, "expected a buffer in base 64") from error
        elif uri is not None:
            place = Path(urllib.parse.unquote(uri))
            if place.is_absolute() or ".." in place.parts:
                raise _wrong(self.path, f"expected buffers beside the file, got {uri[:80]!r}")
            try:
                data = (self.path.parent / place).read_bytes()
            except OSError as error:
                raise _wrong(self.path, f"its buffer {uri[:80]!r} cannot be read: {error.strerror}") from error
        if len(data) < told["byteLength"]:
            raise _wrong(self.path, f"truncated: expected a buffer of {told['byteLength']} bytes, got {len(data)}")
        return data

    def nodes(self) -> list[MeshNode]:
        """All nodes with a surface, in the order of the tree."""
        nodes = self.tree.get("nodes", [])
        children = {child for node in nodes for child in node.get("children", [])}
        roots = [number for number in range(len(nodes)) if number not in children]
        scenes = self.tree.get("scenes")
        if scenes:
            roots = scenes[self.tree.get("scene", 0)].get("nodes", [])
        found, seen, waiting = [], set(), [(root, np.eye(4)) for root in reversed(roots)]
        while waiting:
            number, above = waiting.pop()
            if number in seen or not 0 <= number < len(nodes):
                raise _wrong(self.path, f"expected each node once in the tree, got {number} again or beyond the last")
            seen.add(number)
            node = nodes[number]
            place = above @ self._placed(node)
            waiting += [(child, place) for child in reversed(node.get("children", []))]
            if "mesh" in node:
                mesh = self.tree["meshes"][node["mesh"]]
                name = str(node.get("name") or mesh.get("name") or f"node_{number}")
                found += self._copies(name, self._surface(mesh), place, node)
                if len(found) > MOST_COPIES:
                    raise _wrong(self.path, f"expected at most {MOST_COPIES} nodes and instances, got more")
        return found

    def _copies(
        self, name: str, surface: tuple[np.ndarray, np.ndarray], place: np.ndarray, node: dict[str, Any]
    ) -> Iterator[MeshNode]:
        """The node, or each of its instances."""
        vertices, faces = surface
        if not len(faces):
            return
        told = node.get("extensions", {}).get(INSTANCING, {}).get("attributes", {})
        parts = {key: self._accessor(told[key]) for key in ("TRANSLATION", "ROTATION", "SCALE") if key in told}
        count = min(map(len, parts.values()), default=1)
        if count > MOST_COPIES:
            raise _wrong(self.path, f"expected at most {MOST_COPIES} instances, got {count}")
        for number in range(count):
            one = {key.lower(): values[number].tolist() for key, values in parts.items()}
            matrix = place @ self._placed(one)
            turned = faces if np.linalg.det(matrix[:3, :3]) >= 0.0 else faces[:, ::-1]  # a mirror turns them about
            yield MeshNode(name, vertices @ matrix[:3, :3].T + matrix[:3, 3], turned)

    def _surface(self, mesh: dict[str, Any]) -> tuple[np.ndarray, np.ndarray]:
        """All triangles of a mesh: vertices (V, 3) and faces (T, 3)."""
        vertices, faces, count = [np.zeros((0, 3))], [np.zeros((0, 3), np.int64)], 0
        for primitive in mesh["primitives"]:
            mode = primitive.get("mode", TRIANGLES)
            if mode not in (TRIANGLES, STRIP, FAN) or "POSITION" not in primitive["attributes"]:
                continue
            places = self._accessor(primitive["attributes"]["POSITION"])
            if DRACO in primitive.get("extensions", {}) and not places.any():
                raise _wrong(self.path, f"expected corners that are not compressed, found {DRACO} alone")
            order = self._accessor(primitive["indices"])[:, 0] if "indices" in primitive else np.arange(len(places))
            corners = _triangles(order.astype(np.int64), mode)
            if places.shape[1] != 3 or (len(corners) and not corners.max() < len(places)):
                raise _wrong(self.path, f"expected triangles of {len(places)} vertices, got others")
            vertices.append(places)
            faces.append(corners + count)
            count += len(places)
        return np.concatenate(vertices), np.concatenate(faces)

    def _placed(self, node: dict[str, Any]) -> np.ndarray:
        """(4, 4) of a node, or an instance, to its parent."""
        try:
            return _matrix(node)
        except ValueError as error:  # other numbers of values than a matrix, a rotation or a scale has
            raise _wrong(self.path, f"a node is placed by no matrix, rotation, scale and shift: {error}") from error

    def _accessor(self, number: int) -> np.ndarray:
        """(n, width) float64."""
        told = self.tree["accessors"][number]
        kind, width, count = np.dtype(KINDS[told["componentType"]]), WIDTHS[told["type"]], told["count"]
        if "bufferView" in told:
            values = self._numbers(told["bufferView"], told.get("byteOffset", 0), kind, width, count)
        elif count * kind.itemsize * width <= sum(map(len, self.buffers)):  # all zero, but for what is sparse
            values = np.zeros((count, width), kind)
        else:
            raise _wrong(self.path, f"expected values that fit into its buffers, got {count} without any")
        if "sparse" in told:
            sparse, values = told["sparse"], values.copy()
            where, what = sparse["indices"], sparse["values"]
            place_kind, some = np.dtype(KINDS[where["componentType"]]), sparse["count"]
            places = self._numbers(where["bufferView"], where.get("byteOffset", 0), place_kind, 1, some)
            values[places[:, 0]] = self._numbers(what["bufferView"], what.get("byteOffset", 0), kind, width, some)
        found = values.astype(np.float64)
        if told.get("normalized") and kind.kind != "f":
            found = np.maximum(found / np.iinfo(kind).max, -1.0)
        return found

    def _numbers(self, view: int, offset: int, kind: np.dtype, width: int, count: int) -> np.ndarray:
        told = self.tree["bufferViews"][view]
        data, start = self.buffers[told["buffer"]], told.get("byteOffset", 0)
        step = told.get("byteStride", kind.itemsize * width)
        end = start + min(told["byteLength"], len(data))
        last = start + offset + (count - 1) * step + kind.itemsize * width
        if min(start, offset, count) < 0 or step < kind.itemsize * width or (count and last > min(end, len(data))):
            raise _wrong(
                self.path, f"expected {count} values within {told['byteLength']} bytes of a buffer, got others"
            )
        return (
            np.ndarray((count, width), kind, data, start + offset, (step, kind.itemsize))
            if count
            else np.zeros((0, width), kind)
        )


def _matrix(node: dict[str, Any]) -> np.ndarray:
    """(4, 4) of a node to its parent: its matrix, by columns, or scale, rotation (x, y, z, w) and translation."""
    if "matrix" in node:
        return np.array(node["matrix"], np.float64).reshape(4, 4).T
    from scipy.spatial.transform import Rotation

    made = np.eye(4)
    quaternion = np.array(node.get("rotation", (0.0, 0.0, 0.0, 1.0)), np.float64)
    turn = Rotation.from_quat(quaternion).as_matrix() if quaternion.any() else np.eye(3)
    made[:3, :3] = turn * np.array(node.get("scale", (1.0, 1.0, 1.0)), np.float64)
    made[:3, 3] = node.get("translation", (0.0, 0.0, 0.0))
    return made


def _triangles(order: np.ndarray, mode: int) -> np.ndarray:
    """(T, 3) of the corners in their order; every second triangle of a strip runs the other way."""
    if mode == TRIANGLES:
        return order[: len(order) // 3 * 3].reshape(-1, 3)
    if len(order) < 3:
        return np.zeros((0, 3), np.int64)
    if mode == FAN:
        return np.column_stack([np.full(len(order) - 2, order[0]), order[1:-1], order[2:]])
    strip = np.column_stack([order[:-2], order[1:-1], order[2:]])
    strip[1::2] = strip[1::2, ::-1]
    return strip
