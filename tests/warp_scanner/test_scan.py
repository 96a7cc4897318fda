"""The ray kernel against analytic cases, geometric truths and independent ray casters."""

import numpy as np
import pytest
import trimesh

from warp_scanner.rooms.rooms import RoomConfig, make_rooms
from warp_scanner.scenes.scenes import BOX, CYLINDER, GAP, Primitives, scene_mesh
from warp_scanner.sensors.poses import rotation_of
from warp_scanner.sensors.scan import Rays, cast_rays, cast_slots
from warp_scanner.sensors.sensors import Pinhole

QUARTER = np.pi / 2


def solids(kind, center, half_size, yaw):
    """Primitives from plain (R, K, ...) values; element 10 + slot, semantic 3."""
    kind = np.asarray(kind, np.uint8)
    there = kind != GAP
    element = np.where(there, 10 + np.arange(kind.shape[1]), -1).astype(np.int32)
    center, half_size, yaw = (np.asarray(value, np.float32) for value in (center, half_size, yaw))
    return Primitives(kind, center, half_size, yaw, element, np.where(there, 3, 0).astype(np.uint8))


def cast_one(kind, half_size, yaw, origin, direction):
    direction = np.asarray(direction, float) / np.linalg.norm(direction)
    scene = solids([[kind]], [[[0, 0, 0]]], [[half_size]], [[yaw]])
    return cast_rays(scene, None, Rays(np.array([origin], float), direction[None]))


@pytest.mark.parametrize(
    "yaw, origin, direction, expected",
    [
        pytest.param(0, [-2, 0, 0], [1, 0, 0], 1.0, id="hits the near face"),
        pytest.param(0, [0, 0, 0], [1, 0, 0], 1.0, id="from inside sees the far wall"),
        pytest.param(0, [0, 0, 0], [0, 0, -1], 3.0, id="from inside sees the bottom"),
        pytest.param(0, [-2, 5, 0], [1, 0, 0], np.inf, id="misses beside"),
        pytest.param(0, [2, 0, 0], [1, 0, 0], np.inf, id="ignores what lies behind"),
        pytest.param(QUARTER, [-5, 0, 0], [1, 0, 0], 3.0, id="turned box shows its long half"),
        pytest.param(
            QUARTER / 2, [-5, 0, 0], [1, 0, 0], 5 - np.sqrt(2), id="turned by an eighth shows its oblique face"
        ),
        pytest.param(0, [0, 0, 9], [0, 0, -1], 6.0, id="straight down onto the top"),
        pytest.param(0, [-4, -4, 0], [1, 1, 0], 3 * np.sqrt(2), id="diagonally"),
    ],
)
def test_distance_to_one_box(yaw, origin, direction, expected):
    result = cast_one(BOX, [1, 2, 3], yaw, origin, direction)
    np.testing.assert_allclose(result.distance, [[expected]], atol=1e-5)
    hit = np.isfinite(expected)
    assert result.element[0, 0] == (10 if hit else -1) and result.semantic[0, 0] == (3 if hit else 0)


@pytest.mark.parametrize(
    "origin, direction, expected",
    [
        pytest.param([-5, 0, 0], [1, 0, 0], 3.0, id="hits the mantle"),
        pytest.param([-5, 1, 0], [1, 0, 0], 5 - np.sqrt(3), id="off centre"),
        pytest.param([-5, 2.001, 0], [1, 0, 0], np.inf, id="misses beside"),
        pytest.param([0, 0, 0], [0, 1, 0], 2.0, id="from inside sees the mantle"),
        pytest.param([0, 1, 0], [0, 0, 1], 3.0, id="from inside sees the top"),
        pytest.param([1, 1, 7], [0, 0, -1], 4.0, id="straight down onto the top"),
        pytest.param([1.5, 1.5, 7], [0, 0, -1], np.inf, id="straight down past the round edge"),
        pytest.param([-5, 0, 0], [-1, 0, 0], np.inf, id="ignores what lies behind"),
        pytest.param([-5, 0, 3.5], [1, 0, 0], np.inf, id="passes above"),
        pytest.param([-4, 0, 5], [1, 0, -1], 2 * np.sqrt(2), id="comes down onto the rim of the top"),
    ],
)
def test_distance_to_one_cylinder(origin, direction, expected):
    result = cast_one(CYLINDER, [2, 2, 3], 0.7, origin, direction)
    np.testing.assert_allclose(result.distance, [[expected]], atol=1e-5)
    assert result.element[0, 0] == (10 if np.isfinite(expected) else -1)


def random_rays(seed, rooms=8, count=2_000, span=4.0):
    rng = np.random.default_rng(seed)
    origin = rng.uniform(-span, span, (rooms, count, 3))
    direction = rng.normal(size=origin.shape)
    return rng, Rays(origin, direction / np.linalg.norm(direction, axis=-1, keepdims=True))


def random_scene(seed, kinds=(GAP, BOX, CYLINDER), rooms=8, slots=500):
    """Many small turned solids with gaps between them, and rays of every kind; more slots than one batch holds."""
    rng, rays = random_rays(seed, rooms)
    half = rng.uniform(0.05, 0.5, (rooms, slots, 3))
    kind = rng.choice(kinds, (rooms, slots))
    half[..., 1] = np.where(kind == CYLINDER, half[..., 0], half[..., 1])
    center = rng.uniform(-4, 4, (rooms, slots, 3))
    return solids(kind, center, half, rng.uniform(-7, 7, (rooms, slots))), rays


def brute_force(scene: Primitives, rays: Rays):
    """Nearest hit of every ray with every solid in float64, by other formulas than the kernel's."""
    origin, direction = (np.asarray(array, float)[:, None] for array in rays[:2])
    offset = origin - scene.center.astype(float)[:, :, None]
    cosine, sine = np.cos(scene.yaw.astype(float))[:, :, None], np.sin(scene.yaw.astype(float))[:, :, None]

    def turned(v):
        return np.stack([cosine * v[..., 0] + sine * v[..., 1], cosine * v[..., 1] - sine * v[..., 0],
                         np.broadcast_to(v[..., 2], np.broadcast_shapes(v.shape[:-1], cosine.shape))], -1)  # fmt: skip

    o, d = turned(offset), turned(np.broadcast_to(direction, offset.shape))
    half = scene.half_size.astype(float)[:, :, None]
    planes = np.sort(np.stack([(-half - o) / d, (half - o) / d]), axis=0)
    a, b, c = (np.sum(p * q, -1) for p, q in ((d[..., :2],) * 2, (o[..., :2], d[..., :2]), (o[..., :2],) * 2))
    with np.errstate(invalid="ignore"):
        root = np.sqrt(b * b - a * (c - half[..., 0] ** 2))
    cylinder = (scene.kind == CYLINDER)[:, :, None]
    near = np.maximum(planes[0, ..., 2], np.where(cylinder, (-b - root) / a, planes[0, ..., :2].max(-1)))
    far = np.minimum(planes[1, ..., 2], np.where(cylinder, (-b + root) / a, planes[1, ..., :2].min(-1)))
    hit = (near <= far) & (far >= 0) & (scene.kind != GAP)[:, :, None]
    t = np.where(hit, np.where(near >= 0, near, far), np.inf)
    return t.min(1), np.where(np.isfinite(t.min(1)), t.argmin(1), -1)


@pytest.mark.parametrize("seed", range(2))
def test_agrees_with_brute_force_in_double_precision(seed):
    scene, rays = random_scene(seed, rooms=4)
    rays = Rays(*(np.float32(array[:, :500]) for array in rays[:2]))
    distance, slot = cast_slots(scene, None, rays)
    expected, expected_slot = brute_force(scene, rays)
    assert 0 < np.isfinite(expected).sum() < expected.size  # hits and misses are really mixed
    same = slot == expected_slot
    assert same.mean() > 0.9995  # a ray that grazes an edge may fall either way
    np.testing.assert_allclose(distance[same], expected[same], atol=2e-5)


@pytest.mark.parametrize("kind", [BOX, CYLINDER])
@pytest.mark.parametrize("seed", range(3))
def test_every_hit_lies_on_the_surface(kind, seed):
    rng, rays = random_rays(seed)
    half = rng.uniform(0.2, 2.0, (8, 1, 3))
    half[..., 1] = half[..., 0] if kind == CYLINDER else half[..., 1]
    zero = np.zeros((8, 1, 3))
    distance = cast_rays(solids(np.full((8, 1), kind), zero, half, zero[..., 0]), None, rays).distance
    hit = np.isfinite(distance)
    assert 0 < hit.sum() < hit.size
    point = rays.origin + np.where(hit, distance, 0.0)[..., None] * rays.direction
    if kind == CYLINDER:
        outside = np.maximum(
            np.hypot(point[..., 0], point[..., 1]) - half[..., 0], np.abs(point[..., 2]) - half[..., 2]
        )
    else:
        outside = np.max(np.abs(point) - half, axis=-1)
    np.testing.assert_allclose(outside[hit], 0.0, atol=1e-4)


def test_rays_aimed_at_a_center_always_hit():
    rng, rays = random_rays(0)
    for kind in (BOX, CYLINDER):
        half = np.repeat(rng.uniform(0.2, 2.0, (8, 1, 1)), 3, axis=2)
        scene = solids(np.full((8, 1), kind), np.zeros((8, 1, 3)), half, np.ones((8, 1)))
        to_center = -rays.origin / np.linalg.norm(rays.origin, axis=-1, keepdims=True)
        assert np.all(cast_rays(scene, None, Rays(rays.origin, to_center)).element == 10)


def test_agrees_with_trimesh_on_boxes():
    scene, rays = random_scene(3, kinds=(GAP, BOX), rooms=2, slots=60)
    distance, slot = cast_slots(scene, None, rays)
    for room in range(2):
        vertices, triangles, triangle_slot = scene_mesh(scene, room)
        mesh = trimesh.Trimesh(vertices, triangles, process=False)
        outside = ~np.any(
            mesh_contains(scene, room, rays.origin[room]), axis=1
        )  # within overlapping solids they differ
        hit_triangle = mesh.ray.intersects_first(rays.origin[room], rays.direction[room])
        expected = np.where(hit_triangle >= 0, triangle_slot[hit_triangle], -1)
        agree = slot[room] == expected
        assert agree[outside].mean() > 0.999  # edges may fall either way
        point = rays.origin[room] + distance[room][:, None] * rays.direction[room]
        seen = agree & (expected >= 0) & outside
        plane = mesh.triangles_center[hit_triangle[seen]]
        off_plane = np.sum((point[seen] - plane) * mesh.face_normals[hit_triangle[seen]], axis=1)
        np.testing.assert_allclose(off_plane, 0.0, atol=1e-4)


def mesh_contains(scene, room, points):
    """(P, K) bool: the point is inside the turned box."""
    offset = points[:, None] - scene.center[room]
    c, s = np.cos(scene.yaw[room]), np.sin(scene.yaw[room])
    x, y = c * offset[..., 0] + s * offset[..., 1], c * offset[..., 1] - s * offset[..., 0]
    local = np.stack([x, y, offset[..., 2]], -1)
    return np.all(np.abs(local) <= scene.half_size[room], -1) & (scene.kind[room] != GAP)


def test_moving_scene_and_rays_together_changes_nothing():
    scene, rays = random_scene(4)
    still, still_slot = cast_slots(scene, None, rays)
    turn, shift = 0.83, np.array([3.0, -2.0, 1.0])
    matrix = rotation_of(np.array([np.degrees(turn)]), np.zeros(1))[0].astype(float)
    moved_scene = scene._replace(
        center=(scene.center @ matrix.T + shift).astype(np.float32), yaw=scene.yaw + np.float32(turn)
    )
    moved, moved_slot = cast_slots(moved_scene, None, Rays(rays.origin @ matrix.T + shift, rays.direction @ matrix.T))
    same = still_slot == moved_slot
    assert np.mean(same) > 0.999
    np.testing.assert_allclose(moved[same], still[same], atol=1e-3)


def test_rotation_turns_directions_into_the_world():
    scene, rays = random_scene(5)
    rotation = rotation_of(np.linspace(-170, 170, 8), np.linspace(-60, 60, 8))
    turned = np.einsum("rij,pj->rpi", rotation, rays.direction[0].astype(np.float32))
    a, slot_a = cast_slots(scene, None, Rays(rays.origin[:, 0], rays.direction[0], rotation))
    b, slot_b = cast_slots(scene, None, Rays(rays.origin[:, 0], turned))
    same = slot_a == slot_b
    assert same.mean() > 0.999
    np.testing.assert_allclose(a[same], b[same], atol=1e-4)


def test_results_do_not_depend_on_rooms_rays_or_threads_of_the_call():
    scene, rays = random_scene(6)
    whole = cast_rays(scene, None, rays, threads=2)
    order = np.random.default_rng(0).permutation(2_000)
    shuffled = cast_rays(scene, None, Rays(rays.origin[:, order], rays.direction[:, order]), threads=1)
    few = cast_rays(Primitives(*(f[5:6] for f in scene)), None, Rays(rays.origin[5:6, :7], rays.direction[5:6, :7]))
    for name in whole._fields:
        np.testing.assert_array_equal(getattr(shuffled, name), getattr(whole, name)[:, order])
        np.testing.assert_array_equal(getattr(few, name), getattr(whole, name)[5:6, :7])


@pytest.mark.parametrize("step", [0.0, 0.01], ids=["one origin", "moving origin"])
@pytest.mark.parametrize("seed", range(3))
def test_culling_for_neighbouring_rays_loses_no_hit(seed, step):
    """In order, rays of a packet look the same way and most primitives are culled; in random order next to none are."""
    scene, _ = random_scene(20 + seed)
    half_size = scene.half_size * np.float32([0.3, 0.3, 3.0])  # thin and tall, so that bounds turn with the yaw
    scene.kind[:, 0], half_size[:, 0] = BOX, 9.0  # around everything, so that no ray looks for ever
    scene = scene._replace(half_size=half_size)
    rng = np.random.default_rng(seed)
    directions = Pinhole(160, 100).directions()
    turned = directions @ rotation_of(rng.uniform(-180, 180, 8), rng.uniform(-80, 80, 8)).transpose(0, 2, 1)
    origin = rng.uniform(-2, 2, (8, 1, 3)) + step * (np.arange(len(directions)) % 128)[:, None]
    distance, slot = cast_slots(scene, None, Rays(origin, turned))
    order = rng.permutation(len(directions))
    shuffled = cast_slots(scene, None, Rays(origin[:, order], turned[:, order]))
    np.testing.assert_array_equal(shuffled[0], distance[:, order])
    np.testing.assert_array_equal(shuffled[1], slot[:, order])
    assert np.all(slot >= 0) and len(np.unique(slot)) > 100


def test_a_tight_bound_behind_a_loose_one_is_still_tried():
    """A turned box, whose bounds begin long before its surface does, hides nothing that stands in front of it."""
    scene = solids([[BOX, BOX]], [[[2.5, 0, 0], [1.7, 0.65, 0]]], [[[1, 1, 5], [0.1, 0.2, 5]]], [[np.pi / 4, 0]])
    origin = np.zeros((1, 200, 3))
    origin[..., 1] = np.linspace(0.6, 0.7, 200)
    distance, slot = cast_slots(scene, None, Rays(origin, np.tile([1.0, 0, 0], (200, 1))))
    assert np.all(slot == 1)
    np.testing.assert_allclose(distance, 1.6, atol=1e-6)


def test_shared_origins_and_directions_equal_repeated_ones():
    rooms = make_rooms(RoomConfig(), 0, np.arange(3))
    directions = Pinhole(33, 21).directions()
    origin = np.tile(np.float32([0.1, 0.2, -0.5]), (3, 1))
    shared = cast_rays(rooms, None, Rays(origin, directions))
    shape = (3, len(directions), 3)
    full = Rays(np.broadcast_to(origin[:, None], shape), np.broadcast_to(directions, shape))
    repeated = cast_rays(rooms, None, full)
    for a, b in zip(shared, repeated, strict=True):
        np.testing.assert_array_equal(a, b)


def test_only_what_is_present_is_hit():
    scene, rays = random_scene(7)
    present = np.random.default_rng(1).random(scene.kind.shape) < 0.5
    _, slot = cast_slots(scene, present, rays)
    removed = scene._replace(kind=np.where(present, scene.kind, 0).astype(np.uint8))
    np.testing.assert_array_equal(slot, cast_slots(removed, None, rays)[1])
    room, _ = np.nonzero(slot >= 0)
    assert np.all(present[room, slot[slot >= 0]])


def test_of_equal_distances_the_lower_slot_wins():
    box = solids([[BOX, CYLINDER, BOX]], np.zeros((1, 3, 3)), np.ones((1, 3, 3)), [[0, 0, QUARTER * 4]])
    for present, expected in (([True] * 3, 0), ([False, True, True], 1)):
        result = cast_slots(box, [present], Rays(np.array([[-3.0, 0, 0]]), np.array([[1.0, 0, 0]])))
        assert result[1][0, 0] == expected


def test_a_closed_room_returns_every_ray():
    rooms = make_rooms(RoomConfig(), 9, np.arange(20))
    _, rays = random_rays(9, rooms=20, span=1.4)
    assert np.all(np.isfinite(cast_rays(rooms, None, rays).distance))


@pytest.mark.parametrize("rooms, count", [(0, 5), (2, 0)])
def test_nothing_to_cast_gives_an_empty_scan(rooms, count):
    scene = Primitives(*(field[:rooms] for field in random_scene(0)[0]))
    result = cast_rays(scene, None, Rays(np.zeros((rooms, 3)), np.tile([1.0, 0, 0], (count, 1))))
    assert result.distance.shape == result.element.shape == result.semantic.shape == (rooms, count)


def test_a_scene_of_gaps_returns_only_misses():
    scene = solids(np.zeros((1, 4)), np.zeros((1, 4, 3)), np.ones((1, 4, 3)), np.zeros((1, 4)))
    result = cast_rays(scene, None, Rays(np.zeros((1, 3)), np.eye(3)))
    assert np.all(np.isinf(result.distance)) and np.all(result.element == -1) and np.all(result.semantic == 0)


@pytest.mark.parametrize(
    "rays, message",
    [
        (Rays(np.zeros((1, 3)), np.array([[2.0, 0, 0]])), "unit vectors"),
        (Rays(np.zeros((1, 3)), np.array([[np.nan, 0, 0]])), "unit vectors"),
        (Rays(np.full((1, 3), np.inf), np.eye(3)), "origin must be finite"),
        (Rays(np.zeros((2, 3)), np.eye(3)), "origin must be"),
        (Rays(np.zeros((1, 3)), np.eye(4)), "direction must be"),
        (Rays(np.zeros((1, 3)), np.eye(3), np.eye(3)), "rotation must be"),
    ],
)
def test_rejects_rays_that_make_no_sense(rays, message):
    scene = solids([[BOX]], [[[0, 0, 0]]], [[[1, 1, 1]]], [[0]])
    with pytest.raises(ValueError, match=message):
        cast_rays(scene, None, rays)
