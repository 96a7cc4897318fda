"""Rooms obey their ranges, nothing runs through anything else, and a room is the same in any batch."""

import dataclasses

import numpy as np
import pytest

from warp_scanner.rooms.rooms import RoomConfig, element_count, make_rooms
from warp_scanner.scenes import scenes
from warp_scanner.scenes.scenes import BOX, CHAIR, CYLINDER, DOOR, GAP, PILLAR, TABLE, WALL, is_structure, scene_mesh

CONFIG = RoomConfig()
COUNT = 1_000


@pytest.fixture(scope="module")
def rooms():
    return make_rooms(CONFIG, 11, np.arange(COUNT))


def test_a_room_is_the_same_alone_and_in_any_batch(rooms):
    for chosen in ([0], [999, 3, 64], np.arange(60, 70)):
        alone = make_rooms(CONFIG, 11, np.array(chosen))
        for a, b in zip(alone, rooms, strict=True):
            assert a.dtype == b.dtype
            np.testing.assert_array_equal(a, b[chosen])


def test_seed_index_and_variant_each_change_the_room(rooms):
    others = [make_rooms(CONFIG, 12, np.arange(1)), make_rooms(CONFIG, 11, np.arange(1), 1)]
    first = scenes.take(rooms, np.arange(2))
    assert not np.array_equal(first.center[0], first.center[1])
    assert not any(np.array_equal(other.center[0], first.center[0]) for other in others)


def test_tables_have_the_promised_shapes_and_gap_values(rooms):
    slots = rooms.kind.shape[1]
    assert rooms.center.shape == rooms.half_size.shape == (COUNT, slots, 3)
    types = [np.uint8, np.float32, np.float32, np.float32, np.int32, np.uint8]
    assert [field.dtype for field in rooms] == types
    gap = rooms.kind == GAP
    assert np.all(rooms.element[gap] == -1) and np.all(rooms.semantic[gap] == 0)
    assert np.all(rooms.element[~gap] >= 0) and rooms.element.max() < element_count(CONFIG)
    assert np.all(rooms.half_size[~gap] > 0) and np.all(np.isfinite(rooms.center))


def test_everything_is_inside_the_shell(rooms):
    inner = (rooms.kind != GAP) & ~np.isin(rooms.element, range(6))
    cosine, sine = np.abs(np.cos(rooms.yaw)), np.abs(np.sin(rooms.yaw))
    half = rooms.half_size
    square = rooms.kind == BOX
    x = np.where(square, cosine * half[..., 0] + sine * half[..., 1], half[..., 0])
    y = np.where(square, sine * half[..., 0] + cosine * half[..., 1], half[..., 1])
    reach = np.stack([x, y, half[..., 2]], axis=-1)
    assert np.all((np.abs(rooms.center) + reach)[inner] <= np.array([5.0, 5.0, 1.5]) + 1e-5)


def test_the_shell_encloses_exactly_ten_by_ten_by_three(rooms):
    floor, ceiling, west, east, south, north = ((rooms.center[:, slot], rooms.half_size[:, slot]) for slot in range(6))
    np.testing.assert_allclose(floor[0][:, 2] + floor[1][:, 2], -1.5, atol=1e-6)
    np.testing.assert_allclose(ceiling[0][:, 2] - ceiling[1][:, 2], 1.5, atol=1e-6)
    for (center, half), axis, side in ((west, 0, -1), (east, 0, 1), (south, 1, -1), (north, 1, 1)):
        np.testing.assert_allclose(center[:, axis] - side * half[:, axis], 5.0 * side, atol=1e-6)


def sampled_overlaps(table, room, samples=9):
    """Independent witness: pairs of elements of a room that share a sampled point well inside both."""
    slots = 6 + np.flatnonzero(table.kind[room, 6:] != GAP)  # the shell has its own tests
    grid = np.linspace(-0.98, 0.98, samples)
    u, v = (axis.ravel() for axis in np.meshgrid(grid, grid))
    # A grid on the footprint at three heights; thin things are found from the other partner's grid or their own.
    local = np.concatenate([np.stack([u, v, np.full_like(u, w)], -1) for w in (-0.95, 0.0, 0.95)])
    overlaps = set()
    for slot in slots:
        half, yaw = table.half_size[room, slot], table.yaw[room, slot]
        keep = local if table.kind[room, slot] == BOX else local[np.hypot(local[:, 0], local[:, 1]) < 0.98]
        p = keep * half
        c, s = np.cos(yaw), np.sin(yaw)
        p = np.stack([c * p[:, 0] - s * p[:, 1], s * p[:, 0] + c * p[:, 1], p[:, 2]], -1) + table.center[room, slot]
        offset = p[:, None] - table.center[room, slots]
        c, s = np.cos(table.yaw[room, slots]), np.sin(table.yaw[room, slots])
        x, y = np.abs(c * offset[..., 0] + s * offset[..., 1]), np.abs(c * offset[..., 1] - s * offset[..., 0])
        hx, hy, hz = (table.half_size[room, slots, axis] - 1e-4 for axis in range(3))
        within = np.where(table.kind[room, slots] == CYLINDER, np.hypot(x, y) < hx, (x < hx) & (y < hy))
        within &= np.abs(offset[..., 2]) < hz
        others = table.element[room, slots[np.any(within, axis=0)]]
        overlaps |= {(table.element[room, slot], other) for other in others if other != table.element[room, slot]}
    return overlaps


def test_nothing_runs_through_anything_else(rooms):
    assert not set().union(*(sampled_overlaps(rooms, room) for room in range(10)))


def test_the_witness_of_overlaps_sees_one(rooms):
    moved = rooms.center.copy()
    room, slot = np.argwhere(rooms.semantic == PILLAR)[0]
    moved[room, slot, :2] = rooms.center[room, np.flatnonzero(rooms.semantic[room] == TABLE)[0], :2]
    assert sampled_overlaps(rooms._replace(center=moved), room)


def within(values, limits, tolerance=1e-5):
    return values.min() >= limits[0] - tolerance and values.max() <= limits[1] + tolerance


def spread(values, limits):
    """The values really use their range."""
    return np.ptp(values) > 0.8 * (limits[1] - limits[0])


def test_sizes_follow_the_ranges(rooms):
    size = 2.0 * rooms.half_size
    pillar = size[rooms.semantic == PILLAR]
    assert within(pillar[:, 0], CONFIG.pillar_width) and spread(pillar[:, 0], CONFIG.pillar_width)
    np.testing.assert_allclose(pillar[:, 2], 3.0, atol=1e-6)
    interior = (rooms.semantic == WALL) & (rooms.element >= 6)
    thickness = np.minimum(size[interior][:, 0], size[interior][:, 1])
    assert thickness.min() > 0.05 and np.quantile(thickness, 0.95) <= 0.3 + 1e-5
    top = (rooms.semantic == TABLE) & np.isclose(size[..., 2], 0.05)
    assert within(size[top][:, :2], CONFIG.table_size) and spread(size[top][:, :2], CONFIG.table_size)
    np.testing.assert_allclose((rooms.center + rooms.half_size)[top][:, 2], -0.5, atol=1e-5)
    leg = (rooms.semantic == TABLE) & ~top
    assert within(rooms.half_size[leg][:, :2], CONFIG.table_leg_radius)
    assert {BOX, CYLINDER} == set(rooms.kind[leg]) == set(rooms.kind[rooms.semantic == PILLAR])
    chair_top = (rooms.center + rooms.half_size)[rooms.semantic == CHAIR][:, 2] + 1.5
    assert chair_top.max() <= 1.2 + 1e-5


def test_doors_have_an_opening_two_metres_ten_high_under_a_lintel(rooms):
    bottom = (rooms.center - rooms.half_size)[..., 2] + 1.5
    lintel = (rooms.semantic == WALL) & (rooms.element >= 6) & (bottom > 0.1)
    np.testing.assert_allclose(bottom[lintel], 2.1, atol=1e-5)
    width = 2.0 * rooms.half_size[lintel][:, :2].max(axis=1)
    assert within(width, CONFIG.door_width) and spread(width, CONFIG.door_width)
    room, slot = np.nonzero(lintel)
    # Left piece, right piece and lintel are one element, so a removed wall takes its lintel along.
    same = (rooms.element[room] == rooms.element[room, slot][:, None]).sum(axis=1)
    assert np.all(same == 3)
    leaf = rooms.semantic == DOOR
    assert 0 < leaf.sum() <= lintel.sum()
    assert np.all((rooms.center + rooms.half_size)[leaf][:, 2] + 1.5 < 2.1)


def test_rooms_are_varied_and_furnished(rooms):
    primitives = (rooms.kind != GAP).sum(axis=1)
    assert 50 <= np.median(primitives) <= 150
    walls = [len(set(rooms.element[r][(rooms.semantic[r] == WALL) & (rooms.element[r] >= 6)])) for r in range(COUNT)]
    assert min(walls) == 0 and max(walls) >= 9
    assert np.mean(np.any(rooms.semantic == TABLE, axis=1)) > 0.9
    assert np.mean(np.any(rooms.semantic == CHAIR, axis=1)) > 0.9
    assert np.mean(np.any(rooms.semantic == PILLAR, axis=1)) > 0.7


def test_structure_is_everything_but_furniture(rooms):
    structure = is_structure(rooms)
    assert np.array_equal(structure, (rooms.kind != GAP) & ~np.isin(rooms.semantic, (TABLE, CHAIR)))


def test_mesh_holds_the_volume_and_bounds_of_the_room(rooms):
    vertices, triangles, slot = scene_mesh(rooms, 0, sections=256)
    np.testing.assert_allclose(np.ptp(vertices, axis=0), [10.2, 10.2, 3.2], atol=1e-5)
    corner = vertices[triangles]
    volume = np.sum(np.einsum("ti,ti->t", corner[:, 0], np.cross(corner[:, 1], corner[:, 2]))) / 6
    half = rooms.half_size[0].astype(float)
    expected = np.prod(half, axis=1) * np.where(rooms.kind[0] == CYLINDER, 2 * np.pi, 8)
    np.testing.assert_allclose(volume, expected.sum(), rtol=1e-4)
    assert set(slot) == set(np.flatnonzero(rooms.kind[0] != GAP))


def test_settings_are_respected():
    bare = dataclasses.replace(
        CONFIG, wall_count_x=(0, 0), wall_count_y=(2, 2), wall_density=(1.0, 1.0), door_share=0.0
    )
    rooms = make_rooms(bare, 0, np.arange(50))
    assert not np.any(rooms.semantic == DOOR)
    walls = [set(rooms.element[room][rooms.semantic[room] == WALL]) - set(range(6)) for room in range(50)]
    assert all(len(found) == 2 for found in walls)


@pytest.mark.parametrize(
    "settings, message",
    [
        ({"pillar_width": (1.0, 0.5)}, "room.pillar_width"),
        ({"pillar_spacing": (0.1, 1.0)}, "room.pillar_spacing"),
        ({"chair_height": (0.8, np.nan)}, "room.chair_height"),
        ({"table_limit": -1}, "room.table_limit"),
        ({"wall_count_x": (0, 7)}, "room.wall_count_x"),
        ({"wall_rotation": (0.0, 1.0)}, "room.wall_rotation"),
        ({"size_spread": (9.0, 0.0, 0.0)}, "room.size"),
        ({"cabinet_limit": 1, "cabinet_height": (1.0, 3.0)}, "room.size"),
        ({"corner_part": (0.2, 0.9)}, "room.corner_part"),
        ({"size": (10.0, 10.0, 2.0)}, "room.size"),
        ({"size": (0.5, 0.5, 3.0)}, "room.size"),
        ({"shell_thickness": -1.0}, "room.shell_thickness"),
        ({"door_share": 5.0}, "room.door_share"),
        ({"door_height": -1.0}, "room.door_height"),
        ({"clearance": 50.0}, "room.clearance"),
        ({"pillar_density": (0.0, 5.0)}, "room.pillar_density"),
        ({"pillar_width": (0.0, 0.0)}, "room.pillar_width"),
        ({"wall_thickness": (5.0, 6.0)}, "room.wall_thickness"),
        ({"chair_limit": 2_000_000_000}, "room.chair_limit"),
    ],
)
def test_rejects_impossible_settings(settings, message):
    with pytest.raises(ValueError, match=message):
        RoomConfig(**settings)
