"""Several files as one building: rays, places, storeys and elements of the whole, whatever the order of its files."""

import itertools
import zipfile

import numpy as np
import pytest

from tests.cases.box_building import building_of, shell_of, table_of
from warp_scanner.buildings.arrays import packed, unpacked
from warp_scanner.buildings.frames import Read, moved
from warp_scanner.buildings.model_files import model_of
from warp_scanner.buildings.projects import named, read_model, together
from warp_scanner.buildings.room_ifc import write_room
from warp_scanner.scenes.building import Storeys, WithoutSurfacesError, bounds, element_bounds
from warp_scanner.scenes.building_edits import without
from warp_scanner.scenes.scenes import OTHER, PILLAR, WALL
from warp_scanner.sensors.scan import Rays
from warp_scanner.sensors.triangles import cast_triangles, prepare

SHELL = shell_of(6.0, 5.0, 3.0)
COLUMN, PIER = ((2.0, 2.0, 1.5), (0.15, 0.15, 1.5), PILLAR), ((-3.0, 1.0, 1.5), (0.2, 0.2, 1.5), PILLAR)


def read(name, boxes, is_ifc=True, **more):
    building = building_of(boxes)._replace(**more)
    classes = tuple("IfcBuildingElementProxy" if one == OTHER else "IfcThing" for one in building.elements.semantic)
    building = building._replace(elements=building.elements._replace(ifc_class=classes))
    return Read(name, named(building, name), is_ifc)


def lying(one, matrix):
    """The same file, of a building that stands elsewhere in its frame."""
    world = moved(one.building.triangles.vertices.astype(float) + one.building.origin, matrix)
    origin = np.rint(world.mean(axis=0))
    triangles = one.building.triangles._replace(vertices=(world - origin).astype(np.float32))
    storeys = one.building.storeys
    storeys = storeys._replace(elevation=storeys.elevation + one.building.origin[2] - origin[2])
    return one._replace(building=one.building._replace(triangles=triangles, origin=origin, storeys=storeys))


def turned(degrees, shift):
    matrix, angle = np.eye(4), np.radians(degrees)
    matrix[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    matrix[:3, 3] = shift
    return matrix


def ranges(building, seed=0, count=4000):
    rng = np.random.default_rng(seed)
    direction = rng.normal(size=(count, 3))
    direction = (direction / np.linalg.norm(direction, axis=1, keepdims=True)).astype(np.float32)
    origin = np.array([[0.5, -1.0, 1.4]]) - building.origin
    return cast_triangles(prepare(building.triangles), Rays(origin, direction)).distance[0]


def spans(building):
    """World corners (6,) [m] of every element, by file and id."""
    low, high = element_bounds(building.triangles)
    keys = zip(building.elements.file, building.elements.guid, strict=True)
    return dict(zip(keys, np.hstack([low + building.origin, high + building.origin]).round(3).tolist(), strict=True))


@pytest.mark.parametrize(
    "parts", [(SHELL[:3], (*SHELL[3:], COLUMN)), (SHELL, (COLUMN,)), (SHELL[:1], SHELL[1:5], (*SHELL[5:], COLUMN))]
)
def test_rays_meet_the_union_as_they_meet_one_file(parts):
    whole = building_of((*SHELL, COLUMN))
    joined = together([read(f"{number}.ifc", boxes) for number, boxes in enumerate(parts)])
    assert len(joined.elements.guid) == len(whole.elements.guid)
    np.testing.assert_allclose(ranges(joined), ranges(whole), atol=1e-5)


def test_the_order_of_files_changes_nothing():
    files = [read("b.ifc", SHELL), read("a.ifc", (*SHELL[2:4], PIER)), read("c.ifc", (COLUMN, PIER))]
    packs = [packed(together(order)) for order in itertools.permutations(files)]
    for one in packs[1:]:
        assert one.words == packs[0].words
        for name, array in one.arrays.items():
            np.testing.assert_array_equal(array, packs[0].arrays[name])


def test_what_two_files_have_is_one_element_with_a_twin():
    shifted = tuple((tuple(np.add(center, 0.004)), half, kind) for center, half, kind in SHELL)
    joined = together([read("architect.ifc", (*SHELL, COLUMN)), read("mason.ifc", (*shifted, PIER))])
    assert len(joined.elements.guid) == len(SHELL) + 2
    twins = [twin for own in joined.elements.twins for twin in own]
    assert len(twins) == len(SHELL) and {twin.file for twin in twins} | set(joined.elements.file) == {
        "architect.ifc", "mason.ifc",
    }  # fmt: skip
    assert sum("same extent" in note for note in joined.notes) == 1
    back = unpacked(packed(joined))
    assert back.elements.twins == joined.elements.twins and len(back.sources) == 2
    # A row that goes takes its twin along; all others keep theirs.
    row = next(row for row, own in enumerate(joined.elements.twins) if own)
    less = without(joined, np.array([row]))
    assert sum(map(len, less.elements.twins)) == len(SHELL) - 1


def test_layers_side_by_side_and_equal_ids_stay_two_elements():
    inner, outer = ((0.0, 4.0, 1.5), (3.0, 0.05, 1.5), WALL), ((0.0, 4.1, 1.5), (3.0, 0.05, 1.5), WALL)
    joined = together([read("a.ifc", (*SHELL, inner)), read("b.ifc", (outer,))])
    assert not any(joined.elements.twins)
    keys = list(zip(joined.elements.file, joined.elements.guid, strict=True))
    assert len(set(keys)) == len(keys) == len(SHELL) + 2
    assert len(set(joined.elements.guid)) < len(keys)  # the same names in both


@pytest.mark.parametrize("which", ["both", "grid", "local"])
def test_files_meet_over_their_map_grids(which):
    """One in a frame of its own, the other in another, or on the grid itself; the whole has that of the first."""
    maps = {"a.ifc": turned(20.0, (155_000.0, 463_000.0, 12.0)), "b.ifc": turned(-35.0, (155_040.0, 462_990.0, 10.0))}
    if which == "local":
        maps["a.ifc"] = np.eye(4)
    if which == "grid":
        maps["b.ifc"] = np.eye(4)
    on_map = turned(20.0, (155_000.0, 463_000.0, 12.0))
    parts = {"a.ifc": SHELL, "b.ifc": (COLUMN, PIER)}
    files = []
    for name, boxes in parts.items():
        one = lying(read(name, boxes), np.linalg.solve(maps[name], on_map))
        says = not np.array_equal(maps[name], np.eye(4))
        files.append(one._replace(building=one.building._replace(to_map=maps[name] if says else None)))
    joined = together(files, "a.ifc")
    assert any("map grid" in note for note in joined.notes)
    into = np.linalg.solve(maps["a.ifc"], on_map)
    expected = spans(lying(read("b.ifc", parts["b.ifc"]), into).building)
    found = spans(joined)
    for key, corners in expected.items():
        np.testing.assert_allclose(found[key], corners, atol=2e-2)  # float32 of what was on the grid
    np.testing.assert_allclose(joined.to_map @ into, on_map, atol=1e-6)


@pytest.mark.parametrize(("unit", "up"), [(1.0, "y"), (0.001, "z"), (0.001, "y"), (0.3048, "z"), (1.0, "z")])
def test_a_mesh_beside_is_read_in_the_unit_and_axes_that_fit(unit, up):
    boxes = (*SHELL[2:], COLUMN)
    to_world = np.diag([unit, unit, unit, 1.0])
    if up == "y":
        to_world = to_world @ np.array([[1.0, 0, 0, 0], [0, 0, -1.0, 0], [0, 1.0, 0, 0], [0, 0, 0, 1.0]])
    mesh = lying(read("m.obj", boxes, is_ifc=False), np.linalg.inv(to_world))
    joined = together([read("a.ifc", (*SHELL, PIER)), mesh])
    assert any("fits the others" in note for note in joined.notes) == (unit != 1.0 or up == "y")
    np.testing.assert_allclose(bounds(joined.triangles), bounds(building_of(SHELL).triangles), atol=2e-3)
    assert sum(map(len, joined.elements.twins)) == len(SHELL) - 2
    assert joined.sources[1].unit == pytest.approx(unit)


@pytest.mark.parametrize("count", [1, 2])
def test_a_file_without_surfaces_is_named_and_left_out(tmp_path, count):
    ifcopenshell = pytest.importorskip("ifcopenshell")
    write_room(tmp_path / "a.ifc", table_of((*SHELL, COLUMN)), 0)
    if count == 2:
        write_room(tmp_path / "c.ifc", table_of((PIER,)), 0)
    schedule = ifcopenshell.open(str(tmp_path / "a.ifc"))
    for one in schedule.by_type("IfcElement"):
        schedule.remove(one)
    schedule.create_entity("IfcTask", ifcopenshell.guid.new(), Name="shell", IsMilestone=False)
    schedule.write(str(tmp_path / "b.ifc"))
    model = model_of(tmp_path)
    found = read_model(model)
    assert any("b.ifc has no element with a surface" in note for note in found.notes)
    assert len(found.elements.guid) == len(SHELL) + count and set(found.elements.file) == {"a.ifc", "c.ifc"} - (
        {"c.ifc"} if count == 1 else set()
    )
    # Whoever writes the model back asks where its files lie.
    assert {one.file for one in found.sources} == set(found.elements.file)
    first = model_of(tmp_path / "b.ifc", [tmp_path / "a.ifc"])
    assert len(read_model(first).elements.guid) == len(SHELL) + 1
    (tmp_path / "alone").mkdir()
    for name in ("b.ifc", "d.ifc"):
        (tmp_path / "alone" / name).write_bytes((tmp_path / "b.ifc").read_bytes())
    with pytest.raises(WithoutSurfacesError, match=r"b\.ifc: expected a building with surfaces, found none"):
        read_model(model_of(tmp_path / "alone"))
    with zipfile.ZipFile(tmp_path / "e.ifczip", "w") as archive:
        archive.write(tmp_path / "b.ifc", "b.ifc")
    with pytest.raises(WithoutSurfacesError, match=r"e\.ifczip: expected a building with surfaces"):
        read_model(model_of(tmp_path / "e.ifczip"))


def test_why_a_file_has_no_surfaces_is_told(tmp_path):
    pytest.importorskip("ifcopenshell")
    write_room(tmp_path / "a.ifc", table_of(SHELL), 0)
    (tmp_path / "flat.obj").write_text("o line\nv 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n")
    found = read_model(model_of(tmp_path))
    why = "flat.obj has no element with a surface; the first of 1 elements failed because all its triangles have zero"
    assert any(note.startswith(why) for note in found.notes)


def test_files_of_two_places_are_refused_and_how_far_they_are():
    far = lying(read("b.ifc", SHELL), turned(0.0, (300.0, 0.0, 0.0)))
    with pytest.raises(ValueError, match=r"b\.ifc: .* as a\.ifc, found it 288 m away"):
        together([read("a.ifc", (*SHELL, COLUMN)), far])
    assert (
        len(together([read("a.ifc", SHELL), lying(read("b.ifc", SHELL), turned(0.0, (30.0, 0.0, 0.0)))]).sources) == 2
    )


def test_a_mark_at_the_zero_of_files_neither_drags_nor_enlarges():
    mark = ((-0.5, -0.5, 0.5), (0.5, 0.5, 0.5), OTHER)
    away = turned(0.0, (400.0, 300.0, 0.0))
    files = []
    for name, boxes in (("a.ifc", SHELL), ("b.ifc", (COLUMN, PIER))):
        one = lying(read(name, boxes), away).building
        both = read(name, (*boxes, mark)).building.elements
        both = both._replace(name=(*both.name[:-1], "zero"))
        part = lying(read(name, (mark,)), np.eye(4)).building
        count = len(one.triangles.vertices)
        shift = (part.origin - one.origin).astype(np.float32)
        triangles = one.triangles._replace(
            vertices=np.concatenate([one.triangles.vertices, part.triangles.vertices + shift]),
            faces=np.concatenate([one.triangles.faces, part.triangles.faces + np.int32(count)]),
            element=np.concatenate([one.triangles.element, part.triangles.element + np.int32(len(boxes))]),
            semantic=both.semantic,
        )
        files.append(Read(name, one._replace(triangles=triangles, elements=both), True))
    joined = together(files)
    assert joined.notes[-1].endswith("marks the zero of a.ifc, b.ifc: left out")
    low, high = bounds(joined.triangles)
    np.testing.assert_allclose(
        [low + joined.origin, high + joined.origin], [[393.8, 294.8, -0.2], [406.2, 305.2, 3.2]], atol=1e-3
    )


def test_storeys_of_one_height_are_one_whatever_their_files_say():
    """One file has both at their heights, one all at zero, one other names, one a name that is no storey."""
    up = tuple(((x, y, z + 3.4), half, kind) for (x, y, z), half, kind in SHELL)

    def with_storeys(name, boxes, names, elevation, rows):
        one = read(name, boxes)
        guid = tuple(f"{name}-{row}" for row in range(len(names)))
        table = one.building.elements._replace(storey=np.array(rows, np.int32))
        storeys = Storeys(guid, names, np.array(elevation, float))
        return one._replace(building=one.building._replace(elements=table, storeys=storeys))

    low_columns = [((x, 3.0, 1.5), (0.1, 0.1, 1.5), PILLAR) for x in (-2.0, 0.0)]
    high_columns = [((x, 3.0, 4.9), (0.1, 0.1, 1.5), PILLAR) for x in (-2.0, 0.0)]
    files = [
        with_storeys("a.ifc", (*SHELL, *up), ("ground", "first"), (0.0, 3.4), [0] * 6 + [1] * 6),
        with_storeys("b.ifc", high_columns, ("1STE",), (0.0,), [0, 0]),
        with_storeys("c.ifc", [((4.0, 3.0, 1.5), (0.1, 0.1, 1.5), PILLAR)], ("Level 0",), (-0.1,), [0]),
        with_storeys(
            "d.ifc", [((x + 1.0, y, z), half, kind) for (x, y, z), half, kind in low_columns + high_columns],
            ("Undefined",), (0.0,), [0] * 4,
        ),
    ]  # fmt: skip
    joined = together(files)
    assert joined.storeys.name == ("ground", "first")
    np.testing.assert_allclose(joined.storeys.elevation + joined.origin[2], [0.0, 3.4])
    table = joined.elements
    found = {name: table.storey[np.array(table.file) == name].tolist() for name in ("b.ifc", "c.ifc", "d.ifc")}
    assert found == {"b.ifc": [1, 1], "c.ifc": [0], "d.ifc": [0, 0, 1, 1]}
    assert any("'first' of a.ifc is also '1STE' of b.ifc" in note for note in joined.notes)
    assert any("'Undefined' stands on several storeys" in note for note in joined.notes)
