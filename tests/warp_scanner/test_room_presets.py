"""Ten thousand rooms of each preset: nothing touches what it should not, and sensors keep their distance."""

import numpy as np
import pytest
from scipy import stats

from warp_scanner import draws
from warp_scanner.rooms.rooms import PRESETS, THESIS, VARIED, RoomConfig, element_count, make_rooms, room_sizes
from warp_scanner.rooms.standing import Standing, draw_poses
from warp_scanner.scenes.scenes import (
    BOX,
    CABINET,
    CARTON,
    CEILING,
    CHAIR,
    DOOR,
    FLOOR,
    GAP,
    PERSON,
    PILLAR,
    STRUCTURE,
    TABLE,
    WALL,
    Primitives,
    is_structure,
    take,
)

COUNT = 5_000
MOVABLE = (TABLE, CHAIR, CABINET, CARTON, PERSON)


@pytest.fixture(scope="module", params=PRESETS)
def preset(request):
    config, index = PRESETS[request.param], np.arange(COUNT)
    return config, make_rooms(config, 23, index), room_sizes(config, 23, index)


def corners_of(center, half_size, yaw):
    """(..., 4, 2) corners of turned rectangles, float64."""
    signs = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    local = signs * half_size[..., None, :].astype(float)
    c, s = np.cos(yaw.astype(float))[..., None], np.sin(yaw.astype(float))[..., None]
    turned = np.stack([c * local[..., 0] - s * local[..., 1], s * local[..., 0] + c * local[..., 1]], -1)
    return turned + center[..., None, :]


def projected_gaps(a, b):
    """Gap (N,) of pairs of rectangles given by their corners (N, 4, 2): the largest over the four face normals."""
    best = np.full(len(a), -np.inf)
    for one in (a, b):
        for edge in (one[:, 1] - one[:, 0], one[:, 2] - one[:, 1]):
            axis = edge / np.linalg.norm(edge, axis=1, keepdims=True)
            u, v = (np.einsum("nkc,nc->nk", corners, axis) for corners in (a, b))
            gap = np.maximum(u.min(axis=1) - v.max(axis=1), v.min(axis=1) - u.max(axis=1))
            best = np.maximum(best, gap)
    return best


def outlines(table):
    """Rooms and slots (room, slot) of what keeps things apart seen from above: of an object its largest footprint."""
    room, slot = np.nonzero((table.kind != GAP) & (table.semantic != FLOOR) & (table.semantic != CEILING))
    area = np.prod(table.half_size[room, slot, :2], axis=1)
    thing = room * 1_000 + table.element[room, slot]
    largest = np.zeros((len(table.kind) + 1) * 1_000, np.float32)
    np.maximum.at(largest, thing, area)
    keep = (area == largest[thing]) | np.isin(table.semantic[room, slot], (WALL, DOOR))
    return room[keep], slot[keep]


def close_pairs(table, reach):
    """Rooms and slots (room, a, b) of outlines of different elements whose gap may be less than `reach`."""
    room, slot = outlines(table)
    column = np.arange(len(room)) - np.searchsorted(room, room)
    order = np.full((len(table.kind), column.max() + 1), -1)
    order[room, column] = slot
    rows = np.arange(len(order))[:, None]
    center, half = table.center[rows, order], table.half_size[rows, order]
    radius = np.hypot(half[..., 0], half[..., 1]) + np.float32(reach / 2)
    radius[order < 0] = -1e6
    a, b = np.triu_indices(order.shape[1], k=1)
    x, y = (center[:, a, axis] - center[:, b, axis] for axis in (0, 1))
    room, pair = np.nonzero(x * x + y * y < np.maximum(radius[:, a] + radius[:, b], 0.0) ** 2)
    a, b = order[room, a[pair]], order[room, b[pair]]
    keep = table.element[room, a] != table.element[room, b]
    return room[keep], a[keep], b[keep]


def least_gaps(table):
    """Least gap between elements: among walls and leaves, and of anything else to anything."""
    fixed = other = np.inf
    for start in range(0, len(table.kind), 200):
        part = take(table, slice(start, start + 200))
        room, a, b = close_pairs(part, 0.1)
        corners = (corners_of(part.center[room, s, :2], part.half_size[room, s, :2], part.yaw[room, s]) for s in (a, b))
        gap = projected_gaps(*corners)
        walls = np.isin(part.semantic[room, a], (WALL, DOOR)) & np.isin(part.semantic[room, b], (WALL, DOOR))
        fixed, other = min(fixed, gap[walls].min()), min(other, gap[~walls].min())
    return fixed, other


def test_objects_stay_within_their_outlines(preset):
    """So that outlines suffice to tell objects apart: legs under tops, and so on."""
    rooms = take(preset[1], slice(0, 500))
    room, slot = outlines(rooms)
    outline = np.zeros((500, rooms.element.max() + 1), int)
    outline[room, rooms.element[room, slot]] = slot
    room, slot = np.nonzero(np.isin(rooms.semantic, MOVABLE))
    top = outline[room, rooms.element[room, slot]]
    # People's legs and heads are cylinders, and the squares around them are not turned.
    square = np.where(rooms.semantic[room, slot] == PERSON, rooms.yaw[room, top], rooms.yaw[room, slot])
    offset = corners_of(rooms.center[room, slot, :2], rooms.half_size[room, slot, :2], square)
    offset -= rooms.center[room, top, None, :2]
    c, s = np.cos(rooms.yaw[room, top])[:, None], np.sin(rooms.yaw[room, top])[:, None]
    local = np.stack([c * offset[..., 0] + s * offset[..., 1], c * offset[..., 1] - s * offset[..., 0]], -1)
    assert np.all(np.abs(local) <= rooms.half_size[room, top, None, :2] + 1e-5)


def test_objects_keep_their_clearance_and_walls_only_touch(preset):
    config, rooms, _ = preset
    walls, others = least_gaps(rooms)
    # Float32 coordinates of up to 10 m are good to a micrometre.
    assert walls > -2e-5 and others > config.clearance - 2e-5


def test_the_witness_of_gaps_sees_a_nudge():
    rooms = make_rooms(VARIED, 23, np.arange(250))
    room = np.flatnonzero(np.any(rooms.semantic == CARTON, axis=1) & np.any(rooms.semantic == PILLAR, axis=1))[0]
    carton, pillar = (np.flatnonzero(rooms.semantic[room] == kind)[0] for kind in (CARTON, PILLAR))
    center = rooms.center.copy()
    center[room, pillar, :2] = center[room, carton, :2]
    assert least_gaps(rooms._replace(center=center))[1] < -0.05


def test_everything_stands_inside_its_own_shell(preset):
    config, rooms, size = preset
    room, slot = np.nonzero((rooms.kind != GAP) & (rooms.element >= 6))
    center, half, semantic = rooms.center[room, slot], rooms.half_size[room, slot], rooms.semantic[room, slot]
    beyond = np.abs(corners_of(center[:, :2], half[:, :2], rooms.yaw[room, slot])) - size[room, None, :2] / 2
    beyond = beyond.max(axis=(1, 2))
    assert beyond.max() <= 1e-5
    assert beyond[np.isin(semantic, (*MOVABLE, PILLAR))].max() <= 1e-5 - config.clearance
    assert (np.abs(center[:, 2]) + half[:, 2] - size[room, 2] / 2).max() <= 1e-5
    bottom = center[:, 2] - half[:, 2] + size[room, 2] / 2
    grounded = [bottom[semantic == kind].min() for kind in set(semantic) - {DOOR}]
    np.testing.assert_allclose(grounded, 0.0, atol=1e-5)


def test_shells_have_the_sizes_that_room_sizes_tells(preset):
    config, rooms, size = preset
    np.testing.assert_allclose(rooms.center[:, 3, 0] - rooms.half_size[:, 3, 0], size[:, 0] / 2, atol=1e-5)
    np.testing.assert_allclose(rooms.center[:, 5, 1] - rooms.half_size[:, 5, 1], size[:, 1] / 2, atol=1e-5)
    np.testing.assert_allclose(rooms.center[:, 0, 2] + rooms.half_size[:, 0, 2], -size[:, 2] / 2, atol=1e-5)
    assert np.array_equal(room_sizes(config, 23, np.array([77, 3])), size[[77, 3]])
    for axis in range(3):
        spread, greatest = config.size_spread[axis], config.size[axis]
        assert (
            stats.kstest((greatest - size[:, axis]) / (spread or 1.0), "uniform").pvalue > 1e-3
            if spread
            else (np.all(size[:, axis] == greatest))
        )


def test_sensors_keep_their_distance(preset):
    _, rooms, size = preset
    standing = Standing((0.4, 2.2), 0.3, pitch=(-15.0, 15.0))
    pose, found = draw_poses(rooms, size, standing, draws.keys(4, np.arange(COUNT)))
    assert found.mean() > 0.97
    room, slot = np.nonzero((rooms.kind != GAP) & ~np.isin(rooms.semantic, (FLOOR, CEILING)) & found[:, None])
    offset = pose.position[room, :2].astype(float) - rooms.center[room, slot, :2]
    c, s = np.cos(rooms.yaw[room, slot].astype(float)), np.sin(rooms.yaw[room, slot].astype(float))
    local = np.stack([c * offset[:, 0] + s * offset[:, 1], c * offset[:, 1] - s * offset[:, 0]], -1)
    # A cylinder lies inside the square that is tested here.
    assert np.linalg.norm(np.maximum(np.abs(local) - rooms.half_size[room, slot, :2], 0.0), axis=-1).min() >= 0.3
    height = pose.position[:, 2] + size[:, 2] / 2
    assert height.min() >= 0.4 - 1e-5 and height.max() <= 2.2 + 1e-5 and np.all(size[:, 2] - height >= 0.3 - 1e-5)
    assert np.abs(pose.pitch).max() <= 15.0 and np.ptp(pose.pitch) > 29.0


def test_varied_rooms_use_every_range():
    rooms = make_rooms(VARIED, 5, np.arange(2_000))
    interior = (rooms.semantic == WALL) & (rooms.element > 6)
    turn = np.abs(rooms.yaw[interior])
    assert turn.max() <= 0.26 + 1e-6 and turn.max() > 0.25 and np.mean(turn > 0.05) > 0.7
    turn = rooms.yaw[(rooms.semantic == PILLAR) & (rooms.kind == BOX)]
    assert turn.min() >= 0.0 and turn.max() <= np.pi / 2 + 1e-6 and np.ptp(turn) > 1.4
    for kind in MOVABLE:
        assert np.mean(np.any(rooms.semantic == kind, axis=1)) > 0.6
    closed = rooms.kind[:, 6] != GAP
    assert abs(closed.mean() - 0.3) < 0.05 and np.all(rooms.element[closed, 6] == 6)
    # Plans of one room and of many.
    walls = [len(set(rooms.element[r][interior[r]])) for r in range(500)]
    assert min(walls) == 0 and max(walls) >= 12
    assert rooms.element.max() < element_count(VARIED)


def test_closed_corners_fill_one_corner():
    rooms, size = make_rooms(VARIED, 5, np.arange(500)), room_sizes(VARIED, 5, np.arange(500))
    closed = np.flatnonzero(rooms.kind[:, 6])
    reach = np.abs(rooms.center[closed, 6]) + rooms.half_size[closed, 6]
    np.testing.assert_allclose(reach[:, :2], size[closed, :2] / 2, atol=1e-5)
    part = 2 * rooms.half_size[closed, 6, :2] / size[closed, :2]
    assert part.min() >= 0.25 - 1e-5 and part.max() <= 0.5 + 1e-5


def test_the_thesis_preset_has_no_clutter_and_keeps_its_axes():
    rooms = make_rooms(THESIS, 5, np.arange(500))
    assert THESIS == RoomConfig() and not np.any(np.isin(rooms.semantic, (CABINET, CARTON, PERSON)))
    assert np.all(rooms.yaw[np.isin(rooms.semantic, (WALL, PILLAR))] == 0.0)


def test_clutter_is_furniture():
    rooms = make_rooms(VARIED, 5, np.arange(200))
    assert set(STRUCTURE).isdisjoint(MOVABLE)
    assert np.array_equal(is_structure(rooms), (rooms.kind != GAP) & ~np.isin(rooms.semantic, MOVABLE))


def test_a_varied_room_is_the_same_alone_and_with_any_threads():
    rooms = make_rooms(VARIED, 11, np.arange(400), threads=2)
    assert isinstance(rooms, Primitives)
    for chosen in ([0], [399, 3, 64]):
        alone = make_rooms(VARIED, 11, np.array(chosen), threads=1)
        for a, b in zip(alone, rooms, strict=True):
            np.testing.assert_array_equal(a, b[chosen])
