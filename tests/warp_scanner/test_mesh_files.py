"""Mesh files as many programs write them: every node at its place, under its name, with the surface that it has."""

import base64
import itertools
import json
import re

import numpy as np
import pytest
import trimesh

from tests.cases.glb_files import gltf, write_glb
from warp_scanner.buildings.files import read_building
from warp_scanner.buildings.gltf_files import read_gltf
from warp_scanner.buildings.obj_files import read_obj
from warp_scanner.buildings.polygons import triangles_of

SOLIDS = {"wall_s": ((8.4, 0.2, 3.0), (0, -3.1, 1.5)), "column_a": ((0.4, 0.4, 3.0), (-2, 1.2, 1.5)),
          "floor": ((8.4, 6.4, 0.2), (0, 0, -0.1))}  # fmt: skip


def boxes():
    return {
        name: trimesh.creation.box(size, trimesh.transformations.translation_matrix(place))
        for name, (size, place) in SOLIDS.items()
    }


def spans(nodes):
    """Name -> the corners of the box around each node, in order."""
    return sorted(
        (node.name, *np.round(node.vertices.min(axis=0), 5), *np.round(np.ptp(node.vertices, axis=0), 5))
        for node in nodes
    )


EXPECTED = sorted(
    (name, *np.subtract(place, np.array(size) / 2).round(5), *size) for name, (size, place) in SOLIDS.items()
)


def obj(mark, negative=False, together=False, before=()):
    """The solids under `mark`, each after its own vertices, or all vertices first."""
    head, faces, count = list(before), [], 0
    for name, mesh in boxes().items():
        vertices = ["v {} {} {}".format(*vertex) for vertex in mesh.vertices]
        count += len(vertices)
        lines = [mark.format(name)] + ([] if together else vertices)
        head += vertices if together else []
        total = 24 if together else count
        corners = mesh.faces + 1 + count - len(vertices)
        lines += [
            "f " + " ".join(f"{corner - total - 1 if negative else corner}//7" for corner in row) for row in corners
        ]
        faces.append(lines)
    return "\n".join([*head, *itertools.chain.from_iterable(faces)]) + "\n"


@pytest.mark.parametrize(
    "mark", ["o {}", "g {}", "o building\ng {}", "g default\no {}", "o {0}\ng {0}_stone", "  g\t{}  "]
)
@pytest.mark.parametrize("negative", [False, True])
@pytest.mark.parametrize("together", [False, True])
def test_elements_of_obj_files_are_objects_or_else_groups(tmp_path, mark, negative, together):
    text = obj(mark, negative, together)
    if mark.startswith("o building"):  # once, for all
        text = "o building\n" + text.replace("o building\n", "")
    (tmp_path / "a.obj").write_text(text)
    assert spans(read_obj(tmp_path / "a.obj")) == EXPECTED
    assert sorted(read_building(tmp_path / "a.obj").elements.guid) == sorted(SOLIDS)


def test_a_group_that_is_named_again_goes_on(tmp_path):
    text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\ng wall\nf 1 2 3\ng floor\nf 1 2 4\ng wall\nf 2 3 4\n"
    (tmp_path / "a.obj").write_text(text)
    assert [(node.name, len(node.faces)) for node in read_obj(tmp_path / "a.obj")] == [("wall", 2), ("floor", 1)]
    (tmp_path / "a.obj").write_text(text.replace("g ", "o "))  # but two objects may bear one name
    assert [(node.name, len(node.faces)) for node in read_obj(tmp_path / "a.obj")] == [
        ("wall", 1),
        ("floor", 1),
        ("wall", 1),
    ]


def test_lines_of_obj_files_may_go_on_and_hold_colours_and_comments(tmp_path):
    text = "v 0 0 0 0.5 0.5 0.5\nv 2 0 0 1 1 1 # red\nv 2 1 0\r\nv 0 1 0\nf 1/1/1 2/2/1 \\\n3/3/1 4/4/1 # a quad\n"
    (tmp_path / "a.obj").write_text(text, newline="")
    (node,) = read_obj(tmp_path / "a.obj")
    assert node.name == "a" and trimesh.Trimesh(node.vertices, node.faces).area == pytest.approx(2.0)


@pytest.mark.parametrize(
    "text, why",
    [
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n", "line 4: expected a face of three corners or more, of 3 v"),
        ("v 0 0 0\nv 1 0 0\nf -1 -2 -3\nv 0 1 0\n", "line 3: expected a face of three corners"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 0 1 2\n", "line 4: expected a face of three corners"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2\n", "line 4: expected a face of three corners"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 x\n", "line 4: expected a face of three corners"),
        ("v 0 0 0\nv 1 0\nv 0 1 0\nf 1 2 3\n", "expected vertices of three numbers"),
        ("v 0 0 0\nv\nv 0 1 0\nf 1 2 3\n", "expected vertices of three numbers"),
    ],
)  # fmt: skip
def test_faces_of_obj_files_that_are_none_are_told_with_their_line(tmp_path, text, why):
    (tmp_path / "a.obj").write_text(text)
    with pytest.raises(ValueError, match=re.escape(f"a.obj: {why}")) as told:
        read_building(tmp_path / "a.obj")
    assert "\n" not in str(told.value)


def test_an_obj_file_that_was_cut_off_says_so(tmp_path):
    """Within a face, wherever it was cut: what is left of its line is no face, or may be another one."""
    text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 10\nf 1 2 3\nf -1/7 -2/7 -3/7\n"
    file, start = tmp_path / "a.obj", text.rindex("f ")
    for length in range(start + 1, len(text) + 1):
        file.write_text(text[:length])
        if len(text[start:length].split()) < 4 or text[:length].endswith(" -"):
            with pytest.raises(ValueError, match=r"a\.obj: truncated: it ends within a line: 'f"):
                read_building(file)
        else:
            notes = " ".join(read_building(file).notes)
            assert ("its last line has no end" in notes) == (length < len(text))
    file.write_text(text[: text.index("10")])
    with pytest.raises(ValueError, match=r"a\.obj: truncated: it ends within a line: 'v 0 0'"):
        read_building(file)


SHAPES = {
    "square": [(0, 0), (1, 0), (1, 1), (0, 1)],
    "L": [(0, 0), (4, 0), (4, 1), (1, 1), (1, 3), (0, 3)],
    "U": [(0, 0), (4, 0), (4, 3), (3, 3), (3, 1), (1, 1), (1, 3), (0, 3)],
    "star": [(np.cos(n) * (1 + n % 2), np.sin(n) * (1 + n % 2)) for n in np.arange(14) * 2 * np.pi / 14 * 1.0],
    "with a hole": [(0, 0), (4, 0), (4, 4), (0, 4), (0, 0), (1, 1), (1, 3), (3, 3), (3, 1), (1, 1)],
    "corners on a line": [(0, 0), (2, 0), (4, 0), (4, 1), (1, 1), (1, 3), (0, 3)],
}


@pytest.mark.parametrize("name", SHAPES)
@pytest.mark.parametrize("turned", range(5))
def test_triangles_of_a_polygon_cover_it_once(name, turned):
    """Their areas sum to the polygon's, so none lies in a notch; whichever corner is first, however it is turned."""
    flat = np.array(SHAPES[name], float)
    for shift in range(len(flat) if name != "with a hole" else 1):
        corners = np.roll(np.column_stack([flat, np.zeros(len(flat))]), shift, axis=0)[:: 1 if turned % 2 else -1]
        corners = trimesh.transform_points(
            corners, trimesh.transformations.random_rotation_matrix(np.random.default_rng(turned).random(3))
        )
        triangles = triangles_of(corners)
        x, y = flat.T
        area = abs(np.dot(x, np.roll(y, 1)) - np.dot(y, np.roll(x, 1))) / 2
        assert len(triangles) == len(flat) - 2
        assert trimesh.triangles.area(corners[triangles]).sum() == pytest.approx(area)


BOX = trimesh.creation.box((0.4, 3.0, 0.4))  # y up
CORNERS, FACES = BOX.vertices.astype("f4"), BOX.faces.astype("u2").ravel()
PLACES = np.array([[-2, 1.5, -1.2], [2, 1.5, 1.2], [0, 1.5, 3.0]], "f4")


def test_every_instance_of_a_mesh_stands_at_its_place(tmp_path):
    turn = np.array([[0, 0, 0, 1], [0, np.sqrt(0.5), 0, np.sqrt(0.5)], [0, 0, 0, 1]], "f4")
    scale = np.array([[1, 1, 1], [1, 1, 1], [2, 1, 1]], "f4")
    told = {"TRANSLATION": 2, "ROTATION": 3, "SCALE": 4}
    nodes = [
        {
            "name": "column",
            "mesh": 0,
            "translation": [10, 0, 0],
            "extensions": {"EXT_mesh_gpu_instancing": {"attributes": told}},
        }
    ]
    tree, blob = gltf(
        nodes, [(CORNERS, {}), (FACES, {}), (PLACES, {}), (turn, {}), (scale, {})], ["EXT_mesh_gpu_instancing"]
    )
    tree["meshes"] = tree["meshes"][:1]
    write_glb(tmp_path / "a.glb", tree, blob)
    found = read_gltf(tmp_path / "a.glb")
    for node, place, size in zip(found, PLACES, ([0.4, 3, 0.4], [0.4, 3, 0.4], [0.8, 3, 0.4]), strict=True):
        np.testing.assert_allclose(node.vertices.mean(axis=0), place + np.array([10, 0, 0]), atol=1e-6)
        np.testing.assert_allclose(np.ptp(node.vertices, axis=0), size, atol=1e-6)
    assert list(read_building(tmp_path / "a.glb").elements.guid) == ["column", "column_1", "column_2"]


@pytest.mark.parametrize("kind, normalized", [("i2", True), ("i2", False), ("u2", True), ("i1", True), ("u1", False)])
def test_quantised_corners_are_where_their_node_takes_them(tmp_path, kind, normalized):
    """The corners of a box are the ends of what the integers can say."""
    info = np.iinfo(kind)
    low, high = (-info.max if kind[0] == "i" else 0), info.max
    corners = np.where(BOX.vertices > 0, high, low).astype(kind)
    reach = (high - low) / (info.max if normalized else 1)
    scale = np.array([0.4, 3.0, 0.4]) / reach
    shift = -scale * low / (info.max if normalized else 1) - [0.2, 1.5, 0.2] + PLACES[0]
    nodes = [{"name": "column", "mesh": 0, "translation": shift.tolist(), "scale": scale.tolist()}]
    tree, blob = gltf(nodes, [(corners, {"normalized": normalized}), (FACES, {})], ["KHR_mesh_quantization"])
    write_glb(tmp_path / "a.glb", tree, blob)
    (node,) = read_gltf(tmp_path / "a.glb")
    order = np.lexsort(node.vertices.T), np.lexsort(BOX.vertices.T)
    np.testing.assert_allclose(node.vertices[order[0]], BOX.vertices[order[1]] + PLACES[0], atol=1e-6)


@pytest.mark.parametrize(
    "names", [["KHR_draco_mesh_compression"], ["EXT_meshopt_compression", "KHR_mesh_quantization"], ["X_y"]]
)
def test_extensions_that_are_required_and_not_known_are_refused_by_name(tmp_path, names):
    tree, blob = gltf([{"mesh": 0}], [(CORNERS, {}), (FACES, {})], names)
    write_glb(tmp_path / "a.glb", tree, blob)
    with pytest.raises(ValueError, match=f"a.glb: not a readable mesh file: .* it requires {names[0]}$"):
        read_building(tmp_path / "a.glb")


@pytest.mark.parametrize("names", [["KHR_materials_unlit", "KHR_texture_transform"], ["EXT_texture_webp"]])
def test_extensions_of_looks_alone_are_passed_over(tmp_path, names):
    tree, blob = gltf([{"mesh": 0}], [(CORNERS, {}), (FACES, {})], names)
    write_glb(tmp_path / "a.glb", tree, blob)
    assert read_building(tmp_path / "a.glb").elements.guid == ("node_0",)


@pytest.mark.parametrize("mode, order", [(4, [0, 1, 2, 0, 2, 3]), (5, [1, 2, 0, 3]), (6, [0, 1, 2, 3])])
def test_strips_fans_strides_and_sparse_corners(tmp_path, mode, order):
    square = np.array([[0, 0, 0], [2, 0, 0], [2, 1, 0], [9, 9, 9]], "f4")
    wide = np.column_stack([square, np.full((4, 1), 7, "f4")])  # something else lies between
    tree, blob = gltf(
        [{"name": "wall", "mesh": 0}],
        [(wide, {}), (np.array(order, "u2"), {}), (np.array([3], "u1"), {}), (np.array([[0, 1, 0]], "f4"), {})],
    )
    tree["meshes"] = [
        {
            "primitives": [
                {"attributes": {"POSITION": 0}, "indices": 1, "mode": mode},
                {"attributes": {"POSITION": 0}, "mode": 1},
            ]
        }
    ]
    tree["bufferViews"][0]["byteStride"] = 16
    sparse = {"count": 1, "indices": {"bufferView": 2, "componentType": 5121}, "values": {"bufferView": 3}}
    tree["accessors"][0] |= {"type": "VEC3", "sparse": sparse}
    write_glb(tmp_path / "a.glb", tree, blob)
    (node,) = read_gltf(tmp_path / "a.glb")
    made = trimesh.Trimesh(node.vertices, node.faces, process=False)
    assert made.area == pytest.approx(2.0) and np.allclose(made.face_normals, [0, 0, 1])


def test_a_mirror_keeps_the_outside_outside(tmp_path):
    tree, blob = gltf([{"mesh": 0, "scale": [-1, 1, 1]}], [(CORNERS, {}), (FACES, {})])
    write_glb(tmp_path / "a.glb", tree, blob)
    (node,) = read_gltf(tmp_path / "a.glb")
    assert trimesh.Trimesh(node.vertices, node.faces).volume == pytest.approx(BOX.volume, rel=1e-6)


@pytest.mark.parametrize("ending", ["glb", "gltf"])
def test_agrees_with_trimesh(tmp_path, ending):
    """On a scene of nodes in nodes, with the buffers in the file, beside it, or as data."""
    rng, scene = np.random.default_rng(1), trimesh.Scene()
    parent = None
    for name in ("wall", "column 1", "Tür"):
        matrix = trimesh.transformations.random_rotation_matrix(rng.random(3))
        matrix[:3, 3] = rng.uniform(-5, 5, 3)
        mesh = trimesh.creation.icosphere(1, float(rng.uniform(0.5, 2)))
        parent = scene.add_geometry(
            mesh, node_name=name, geom_name=f"{name} mesh", parent_node_name=parent, transform=matrix
        )
    made = scene.export(file_type=ending)
    for name, data in (made if ending == "gltf" else {"model.glb": made}).items():
        (tmp_path / name).write_bytes(data)
    files = [tmp_path / f"model.{ending}"]
    if ending == "gltf":
        tree = json.loads(made["model.gltf"])
        for buffer in tree["buffers"]:
            buffer["uri"] = "data:application/octet-stream;base64," + base64.b64encode(made[buffer["uri"]]).decode()
        files.append(tmp_path / "inside.gltf")
        files[1].write_text(json.dumps(tree))
    for file in files:
        found = {node.name: node for node in read_gltf(file)}
        assert found.keys() == {"wall", "column 1", "Tür"}
        for name, node in found.items():
            matrix, geometry = scene.graph[name]
            expected = scene.geometry[geometry].copy().apply_transform(matrix)
            np.testing.assert_allclose(node.vertices[node.faces], expected.triangles, atol=1e-5)


@pytest.mark.parametrize(
    "breaks, why",
    [
        (lambda tree: tree["nodes"][0].update(children=[0]), "expected each node once in the tree"),
        (lambda tree: tree["nodes"][0].update(children=[9]), "expected each node once in the tree"),
        (lambda tree: tree["accessors"][0].update(count=9), "expected 9 values within 96 bytes of a buffer"),
        (lambda tree: tree["accessors"][1].update(componentType=5126), "expected 36 values within 72 bytes"),
        (lambda tree: tree["accessors"][0].update(count=4), "expected triangles of 4 vertices, got others"),
        (lambda tree: tree["buffers"][0].update(byteLength=10**9), "truncated: expected a buffer of 1000000000 bytes"),
        (lambda tree: tree["buffers"][0].update(uri="../x.bin"), "expected buffers beside the file, got '../x.bin'"),
        (lambda tree: tree["buffers"][0].update(uri="x.bin"), "its buffer 'x.bin' cannot be read"),
        (lambda tree: tree["nodes"][0].update(mesh=3), "its parts do not fit together (IndexError)"),
    ],
)
def test_trees_that_contradict_themselves_are_refused(tmp_path, breaks, why):
    tree, blob = gltf([{"mesh": 0}], [(CORNERS, {}), (FACES, {})])
    breaks(tree)
    write_glb(tmp_path / "a.glb", tree, blob)
    with pytest.raises(ValueError, match=re.escape(f"a.glb: not a readable mesh file: {why}")):
        read_building(tmp_path / "a.glb")


def test_files_of_others(data_root):
    faults = data_root / "faults"
    for name in ("obj_groups/g.obj", "obj_negative_interleaved/neg_inter.obj"):
        building = read_building(faults / name)
        assert len(building.elements.guid) == 9 and "column_b" in building.elements.guid
    assert len(read_building(faults / "glb_extensions" / "instance.glb").elements.guid) == 9
    with pytest.raises(ValueError, match="it requires KHR_draco_mesh_compression"):
        read_building(faults / "glb_extensions" / "draco.glb")


@pytest.mark.parametrize("odd", [{"scale": [1, 1, 1, 1]}, {"rotation": [0, 0, 1]}, {"matrix": [1, 2]}])
def test_nodes_that_are_placed_by_other_numbers_are_refused_by_name(tmp_path, odd):
    tree, blob = gltf([{"mesh": 0, **odd}], [(CORNERS, {}), (FACES, {})])
    write_glb(tmp_path / "a.glb", tree, blob)
    with pytest.raises(ValueError, match=r"a\.glb: not a readable mesh file: a node is placed by no matrix"):
        read_gltf(tmp_path / "a.glb")
