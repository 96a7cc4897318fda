"""Pairs of scans of a building: true labels, free poses, and the same whatever else is asked for."""

import itertools

import numpy as np
import pytest
import trimesh

from warp_scanner.buildings import pairs as building_pairs
from warp_scanner.buildings.changes import of_element, of_elements, removable
from warp_scanner.buildings.files import read_building
from warp_scanner.buildings.pairs import MISSING, BuildingPairConfig, make_building_pairs
from warp_scanner.buildings.positions import draw_positions, element_around
from warp_scanner.clouds.points import points_of
from warp_scanner.draws import keys
from warp_scanner.rooms.pairs import Pairs
from warp_scanner.rooms.scenarios import CONDITIONS, SCENARIOS
from warp_scanner.rooms.standing import Standing
from warp_scanner.scenes.building import Building, Storeys
from warp_scanner.scenes.building_edits import without
from warp_scanner.scenes.scenes import PILLAR, WALL
from warp_scanner.sensors.poses import rotation_of
from warp_scanner.sensors.scan import Rays
from warp_scanner.sensors.sensors import Pinhole
from warp_scanner.sensors.triangles import cast_triangles, clearance, prepare

Y_UP = trimesh.transformations.rotation_matrix(-np.pi / 2, [1, 0, 0])  # as glTF wants it

SENSOR = Pinhole(96, 60)
FILES = (
    "IfcOpenHouse_IFC4",
    "Schependomlaan_V_L_Constructief",
    "Schependomlaan_XELLA_Begane_grond",
    "bimwhale_LargeBuilding",
    "bimwhale_TallBuilding",
    "duplex_A",
    "xbim_House",
    "xbim_wall_door_column_4x3",
)
SHORT = ("IfcOpenHouse_IFC4", "duplex_A", "xbim_wall_door_column_4x3")  # small; the others tell the same at size


def built(folder, parts) -> Building:
    """The building of these boxes, {name: (size, center)} [m], by way of a mesh file."""
    scene = trimesh.Scene()
    for name, (size, center) in parts.items():
        box = trimesh.creation.box(extents=size).apply_translation(center)
        scene.add_geometry(box, node_name=name, geom_name=f"geometry {name}")
    path = folder / "building.glb"
    path.write_bytes(scene.apply_transform(Y_UP).export(file_type="glb"))
    return read_building(path)


@pytest.fixture(scope="module")
def hall(tmp_path_factory):
    """A hall of 12 x 8 x 3 m, with two columns and a wall that stands free."""
    # The storey that stands in for those of the file is the bounding box's floor, 0.2 m under the slab's top.
    parts = {
        "floor": ([12.4, 8.4, 0.2], [0, 0, -0.1]),
        "ceiling": ([12.4, 8.4, 0.2], [0, 0, 3.1]),
        "wall east": ([0.2, 8.4, 3], [6.1, 0, 1.5]),
        "wall west": ([0.2, 8.4, 3], [-6.1, 0, 1.5]),
        "wall north": ([12, 0.2, 3], [0, 4.1, 1.5]),
        "wall south": ([12, 0.2, 3], [0, -4.1, 1.5]),
        "wall inside": ([3, 0.2, 3], [2, 1, 1.5]),
        "column a": ([0.5, 0.5, 3], [-2, 0, 1.5]),
        "column b": ([0.4, 0.6, 3], [3, -2, 1.5]),
    }
    return built(tmp_path_factory.mktemp("hall"), parts)


def pairs_of(building, count=3, **more) -> Pairs:
    return make_building_pairs(building, BuildingPairConfig(sensor=SENSOR, **more), np.arange(count))


@pytest.mark.parametrize("condition", ["clean", "occluded"])
@pytest.mark.parametrize("scenario", [*SCENARIOS, *MISSING])
def test_labels_are_true(hall, scenario, condition):
    pairs, own = pairs_of(hall, scenario=scenario, condition=condition), len(hall.elements.guid)
    removed = scenario.endswith("removed")
    positive, other = (pairs.changed_dt, pairs.changed_robot) if removed else (pairs.changed_robot, pairs.changed_dt)
    assert positive.any(axis=1).all() if condition == "clean" else positive.any()
    assert not other.any()
    # The prior is the building; only reality holds what is added or stands around.
    assert pairs.dt.element.max() < own
    scan = pairs.dt if removed else pairs.robot
    semantic = WALL if "wall" in scenario else PILLAR
    assert np.all(scan.semantic[positive] == semantic) and np.all(pairs.box.object_type == semantic)
    # Positive points lie on the changed object's box, and where the scans agree nothing is testable.
    points = points_of(pairs.pose, pairs.directions, scan.distance)
    for room in range(3):
        box = pairs.box
        turn = rotation_of(box.yaw[room], np.zeros(1))[0]
        inside = np.abs((points[room, positive[room]] - box.center[room, 0]) @ turn) - box.size[room, 0] / 2
        assert inside.max(initial=-1.0) < 1e-3
    same = pairs.dt.distance == pairs.robot.distance
    assert not (pairs.testable_dt & same).any() and not (pairs.testable_robot & same).any()
    assert np.all((pairs.observable_fraction >= 0) & (pairs.observable_fraction <= 1))
    furniture = pairs.robot.element > (own if scenario.endswith("added") else own - 1)
    assert furniture.any() == (condition == "occluded")


def test_a_ray_without_a_return_tests_nothing_of_the_prior(tmp_path):
    """Columns on a floor under the sky: behind one that is gone lies the floor, or nothing that would return."""
    ground = {"floor": ([12, 8, 0.2], [0, 0, -0.1])}
    ground |= {f"column {x}": ([0.5, 0.5, 3], [x, 0, 1.5]) for x in (-4, -1, 2, 5)}
    building = built(tmp_path, ground)
    gone = pairs_of(building, scenario="pillar_removed")
    returned = np.isfinite(gone.robot.distance)
    assert (gone.changed_dt & ~returned).any() and (gone.changed_dt & gone.testable_dt).any()
    assert not gone.testable_dt[~returned].any()
    np.testing.assert_array_equal(gone.testable_dt, returned & (gone.dt.distance + 0.1 < gone.robot.distance))
    # The other way round a return in front of nothing tells all.
    come = pairs_of(building, scenario="pillar_added")
    before_sky = come.changed_robot & np.isinf(come.dt.distance)
    assert before_sky.any() and come.testable_robot[before_sky].all() and not come.testable_dt.any()


def test_removed_elements_are_the_buildings_own(hall):
    pairs = pairs_of(hall, count=8, scenario="pillar_removed")
    found = {hall.elements.name[element] for element in np.unique(pairs.dt.element[pairs.changed_dt])}
    assert found == {"column a", "column b"}
    assert not np.isin(pairs.robot.element, np.unique(pairs.dt.element[pairs.changed_dt]))[pairs.changed_dt].any()


@pytest.mark.parametrize("condition", CONDITIONS)
def test_what_is_missing_in_the_prior_is_what_is_removed_the_other_way_round(hall, condition):
    gone, missing = (pairs_of(hall, scenario=f"pillar_{way}", condition=condition) for way in ("removed", "missing"))
    np.testing.assert_array_equal(gone.pose.position, missing.pose.position)
    np.testing.assert_array_equal(gone.box.element, missing.box.element)
    assert np.all(gone.box.change == -1) and np.all(missing.box.change == 1)
    if condition == "clean":  # what one scan shows, the other does not
        np.testing.assert_array_equal(gone.dt.element, missing.robot.element)
        np.testing.assert_array_equal(gone.robot.distance, missing.dt.distance)
    for row in range(3):  # the prior that the pair is of
        left = without(hall, missing.box.element[row])
        rays = Rays(
            missing.pose.position[row : row + 1], missing.directions,
            rotation_of(missing.pose.yaw[row : row + 1], missing.pose.pitch[row : row + 1]),
        )  # fmt: skip
        np.testing.assert_array_equal(
            cast_triangles(prepare(left.triangles), rays).distance[0], missing.dt.distance[row]
        )


def test_a_building_without_some_elements_keeps_the_others_in_order(hall):
    names = ("column a", "wall inside")
    left = without(hall, np.array([hall.elements.name.index(name) for name in names]))
    assert left.elements.name == tuple(name for name in hall.elements.name if name not in names)
    assert len(left.elements.semantic) == len(left.triangles.semantic) == len(hall.elements.guid) - 2
    for row, guid in enumerate(left.elements.guid):
        ours, whole = of_element(left, row), of_element(hall, hall.elements.guid.index(guid))
        np.testing.assert_array_equal(ours.center, whole.center)
        np.testing.assert_array_equal(ours.size, whole.size)
    assert without(hall, np.zeros(0, int)).elements.guid == hall.elements.guid


def test_elements_together_are_those_one_by_one(hall):
    triangles, rng = hall.triangles, np.random.default_rng(0)
    mixed = rng.permutation(len(triangles.faces))  # of a file that has an element's triangles here and there
    other = hall._replace(triangles=triangles._replace(faces=triangles.faces[mixed], element=triangles.element[mixed]))
    for building in (hall, other):
        rows = rng.permutation(len(hall.elements.guid))
        for row, one in zip(rows, of_elements(building, rows), strict=True):
            alone = of_element(building, int(row))
            for ours, expected in zip(one.triangles, alone.triangles, strict=True):
                np.testing.assert_array_equal(ours, expected, strict=True)
            assert one.semantic == alone.semantic and one.yaw == alone.yaw
            np.testing.assert_array_equal(one.center, alone.center)
            np.testing.assert_array_equal(one.size, alone.size)


def test_nothing_changes_in_unchanged_pairs(hall):
    pairs = pairs_of(hall, scenario="unchanged")
    for a, b in zip(pairs.dt, pairs.robot, strict=True):
        np.testing.assert_array_equal(a, b)
    assert not pairs.changed_dt.any() and not pairs.testable_dt.any() and pairs.observable_fraction.shape == (3, 0)


@pytest.mark.parametrize("copied", [0.0, 1.0])
def test_added_objects_touch_nothing_and_copies_have_the_size_of_an_original(hall, copied):
    pairs = pairs_of(hall, count=6, scenario="pillar_added", copied_share=copied)
    originals = [np.sort(of_element(hall, number).size) for number in removable(hall, PILLAR)]
    scene = prepare(hall.triangles)
    for center, size in zip(pairs.box.center[:, 0], pairs.box.size[:, 0], strict=True):
        assert clearance(scene, center[None], 5.0)[0] > min(size[:2]) / 2
        alike = any(np.allclose(np.sort(size), original, atol=1e-5) for original in originals)
        assert alike == (copied == 1.0)
        assert center[2] - size[2] / 2 == pytest.approx(0.0, abs=1e-4) and size[2] == pytest.approx(3.0, abs=1e-4)


def test_nothing_stands_on_furniture(tmp_path):
    parts = {"floor": ([10, 8, 0.2], [0, 0, -0.1]), "ceiling": ([10, 8, 0.2], [0, 0, 3.1])}
    parts |= {f"furniture {x}": ([2.4, 7, 0.5], [x, 0, 0.25]) for x in (-3, 0, 3)}
    pairs = pairs_of(built(tmp_path, parts), count=6, scenario="pillar_added", standing=Standing(height=1.2))
    np.testing.assert_allclose(pairs.pose.position[:, 2], 1.2, atol=1e-4)
    np.testing.assert_allclose(pairs.box.size[:, 0, 2], 3.0, atol=1e-4)
    beside = np.abs(pairs.box.center[:, 0] - np.array([[-3, 0, 0], [0, 0, 0], [3, 0, 0]])[:, None]) - [1.2, 3.5, 0]
    assert np.all(beside[..., :2].max(axis=-1) > 0.0)  # the middle is above no piece
    assert np.all(np.abs(pairs.box.center[:, 0, :2]) < [5, 4])  # and inside, though nothing ends the view


def test_furniture_stands_on_the_floor_with_all_its_feet(tmp_path):
    """On a platform of 4 x 3 m most of what is drawn around the sensor would stand on air."""
    parts = {"floor": ([4, 3, 0.2], [0, 0, -0.1]), "column": ([0.2, 0.2, 3], [1.8, 1.3, 1.5])}
    platform = built(tmp_path, parts)
    pairs = pairs_of(platform, count=8, scenario="unchanged", condition="occluded")
    furniture = pairs.robot.element >= 2
    assert furniture.any(axis=1).sum() >= 3
    points = points_of(pairs.pose, pairs.directions, pairs.robot.distance)[furniture]
    assert np.all(np.abs(points[:, :2]) < [2, 1.5])


def test_a_pair_depends_on_nothing_but_its_number_and_conditions_share_the_scene(hall):
    config = BuildingPairConfig(sensor=SENSOR, scenario="wall_added", range_noise=0.01)
    many, one = (make_building_pairs(hall, config, np.array(index)) for index in ([4, 2, 0], [2]))
    np.testing.assert_array_equal(many.robot.distance[1], one.robot.distance[0])
    np.testing.assert_array_equal(many.pose.position[1], one.pose.position[0])
    occluded = pairs_of(hall, scenario="wall_added", condition="occluded")
    clean = pairs_of(hall, scenario="wall_added")
    np.testing.assert_array_equal(occluded.pose.position, clean.pose.position)
    np.testing.assert_array_equal(occluded.box.center, clean.box.center)
    assert np.all(occluded.robot.distance <= clean.robot.distance)
    empty = make_building_pairs(hall, config, np.zeros(0, int))
    assert empty.dt.distance.shape == (0, 96 * 60) and empty.box.center.shape == (0, 1, 3)


def test_two_hundred_poses_stand_free_inside(hall):
    scene = prepare(hall.triangles)
    pose, found = draw_positions(hall, scene, Standing(), keys(0, np.arange(200)))
    assert found.mean() > 0.95
    position = pose.position[found]
    assert np.all(np.abs(position) <= [6, 4, 3]) and np.allclose(position[:, 2], 1.0, atol=1e-4)
    witness = trimesh.Trimesh(hall.triangles.vertices, hall.triangles.faces, process=False)
    _, distance, _ = trimesh.proximity.closest_point(witness, position)
    assert distance.min() >= 0.3
    assert all(element_around(hall, point) == -1 for point in position)
    assert hall.elements.name[element_around(hall, np.array([-2.0, 0.0, 1.0]))] == "column a"


@pytest.mark.parametrize("scenario", SCENARIOS)
def test_what_changes_lies_within_the_reach_of_the_sensor(hall, scenario):
    sensor = Pinhole(96, 60, range_limits=(0.8, 2.5))
    config = BuildingPairConfig(sensor=sensor, scenario=scenario, minimum_share=0.01)
    pairs = make_building_pairs(hall, config, np.arange(6))
    changed = pairs.changed_dt if scenario.endswith("removed") else pairs.changed_robot
    assert np.all(changed.mean(axis=1) >= 0.01)


def test_refuses_what_the_building_lacks_and_wrong_settings(hall, tmp_path):
    path = tmp_path / "floor.glb"
    scene = trimesh.Scene()
    scene.add_geometry(trimesh.creation.box(extents=[9, 9, 0.2]), node_name="floor")
    path.write_bytes(scene.apply_transform(Y_UP).export(file_type="glb"))
    with pytest.raises(ValueError, match="needs a wall at least 1 m high; this building has none"):
        pairs_of(read_building(path), scenario="wall_removed")
    with pytest.raises(ValueError, match="index must be"):
        make_building_pairs(hall, BuildingPairConfig(), np.array([-1]))
    for storey in (7, 1, -1, 0.5):  # the hall has one
        for scenario in ("pillar_removed", "wall_added"):
            with pytest.raises(ValueError, match=rf"storey must be .* 0 to 0, got {storey}"):
                pairs_of(hall, scenario=scenario, storey=storey)
    for name, value in {"scenario": "x", "condition": "x", "range_noise": -1.0, "copied_share": 2.0}.items():
        with pytest.raises(ValueError, match=name):
            BuildingPairConfig(**{name: value})


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[] if name in SHORT else pytest.mark.long) for name in FILES]
)
def test_every_real_file_yields_every_pair_that_it_can(real_building, name):
    building = real_building(name)
    scene = prepare(building.triangles)
    for scenario, condition in itertools.product(SCENARIOS, CONDITIONS):
        config = BuildingPairConfig(sensor=Pinhole(64, 40), scenario=scenario, condition=condition)
        removed = scenario.endswith("removed")
        if removed and not len(removable(building, config.semantic)):
            with pytest.raises(ValueError, match="needs a pillar at least 1 m high; this building has none"):
                make_building_pairs(building, config, np.arange(1))
            continue
        pairs = make_building_pairs(building, config, np.arange(1))
        changed = pairs.changed_dt if removed else pairs.changed_robot
        assert changed.any() and np.all(clearance(scene, pairs.pose.position, 1.0) > 0.3)
        assert np.all(pairs.box.size < 60.0)  # metres, whatever the file counts in
        rays = Rays(pairs.pose.position, pairs.directions, rotation_of(pairs.pose.yaw, pairs.pose.pitch))
        np.testing.assert_array_equal(cast_triangles(scene, rays).distance, pairs.dt.distance)


def test_a_column_that_few_places_see_is_found_soon(tmp_path, monkeypatch):
    """Out of 101 rooms one has a column: nine in ten places in the building would see none."""
    monkeypatch.setattr(building_pairs, "_ATTEMPTS", 12)
    parts = {"floor": ([606, 6, 0.2], [0, 0, -0.1]), "column": ([0.4, 0.4, 3], [60, 1, 1.5])}
    parts |= {f"wall {row}": ([0.2, 6, 3], [row * 6 - 303, 0, 1.5]) for row in range(102)}
    pairs = pairs_of(built(tmp_path, parts), count=10, scenario="pillar_removed")
    assert pairs.changed_dt.any(axis=1).all()
    assert np.all(np.abs(pairs.pose.position[:, 0] - 60.0) <= 8.2)


def test_a_storey_asked_for_holds_the_sensor_and_what_is_removed(tmp_path):
    parts = {f"floor {z}": ([12, 8, 0.2], [0, 0, z - 0.1]) for z in (0, 3)}
    parts |= {f"column {z}": ([0.5, 0.5, 2.8], [4 * z - 6, 0, z + 1.4]) for z in (0, 3)}
    building = built(tmp_path, parts)
    building = building._replace(storeys=Storeys(("a", "b"), ("a", "b"), np.array([0.0, 3.0])))
    for storey, name in enumerate(("column 0", "column 3")):
        added, removed = (
            pairs_of(building, scenario=f"pillar_{change}", storey=storey) for change in ("added", "removed")
        )
        for pairs in (added, removed):
            np.testing.assert_allclose(pairs.pose.position[:, 2], 3.0 * storey + 1.0, atol=1e-4)
        assert {building.elements.name[row] for row in removed.box.element.ravel()} == {name}
