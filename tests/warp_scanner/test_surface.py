"""Incidence and intensity against analytic cases, geometric truths and the face normals of an independent mesh."""

import numpy as np
import pytest

from warp_scanner.rooms.rooms import RoomConfig, make_rooms
from warp_scanner.scenes.scenes import BOX, CYLINDER, FLOOR, WALL, Primitives, scene_mesh
from warp_scanner.sensors.poses import rotation_of
from warp_scanner.sensors.scan import Rays, cast_rays, cast_slots
from warp_scanner.sensors.sensors import Pinhole, Spinning
from warp_scanner.sensors.surface import REFLECTIVITY, UNKNOWN_REFLECTIVITY, incidence_of, intensity_of, normals_of


def one_solid(kind, half_size, yaw=0.0, center=(0.0, 0.0, 0.0)):
    return Primitives(
        np.array([[kind]], np.uint8), np.float32([[center]]), np.float32([[half_size]]), np.float32([[yaw]]),
        np.zeros((1, 1), np.int32), np.ones((1, 1), np.uint8),
    )  # fmt: skip


def seen(scene, rays):
    """Slot, distance, normals and incidence of rays cast at a scene."""
    distance, slot = cast_slots(scene, None, rays)
    normals = normals_of(scene, slot, distance, rays)
    return slot, distance, normals, incidence_of(normals, rays)


@pytest.mark.parametrize(
    "kind, yaw, origin, direction, normal, degrees",
    [
        pytest.param(BOX, 0, [-5, 0, 0], [1, 0, 0], [-1, 0, 0], 0, id="head-on"),
        pytest.param(BOX, 0, [-5, -4, 0], [1, 1, 0], [-1, 0, 0], 45, id="at an eighth turn"),
        pytest.param(BOX, 0, [0, 0, 9], [0, 0, -1], [0, 0, 1], 0, id="onto the top"),
        pytest.param(BOX, 0, [0, 0, 0], [1, 0, 0], [-1, 0, 0], 0, id="from inside the normal points inwards"),
        pytest.param(BOX, 0, [0, 0, 0], [1, 0, -4], [0, 0, 1], 14.0362, id="from inside onto the bottom"),
        pytest.param(BOX, 30, [-5, 0, 0], [1, 0, 0], [-np.sqrt(3) / 2, -0.5, 0], 30, id="a turned box"),
        pytest.param(CYLINDER, 50, [-5, 0, 0], [1, 0, 0], [-1, 0, 0], 0, id="the mantle's middle"),
        pytest.param(CYLINDER, 50, [-5, 0.5, 0], [1, 0, 0], [-np.sqrt(0.75), 0.5, 0], 30, id="off the mantle's middle"),
        pytest.param(CYLINDER, 50, [0, 0.5, 0], [1, 0, 0], [-np.sqrt(0.75), -0.5, 0], 30, id="the mantle from inside"),
        pytest.param(CYLINDER, 0, [-3, 0, 6], [1, 0, -1], [0, 0, 1], 45, id="onto the end"),
    ],
)
def test_normal_and_incidence_of_one_solid(kind, yaw, origin, direction, normal, degrees):
    direction = np.array([direction]) / np.linalg.norm(direction)
    scene = one_solid(kind, [1, 1, 3], np.radians(yaw))
    _, _, normals, incidence = seen(scene, Rays(np.array([origin], float), direction))
    np.testing.assert_allclose(normals[0, 0], normal, atol=1e-5)
    np.testing.assert_allclose(np.degrees(incidence), [[degrees]], atol=1e-3)
    assert normals.dtype == incidence.dtype == np.float32


@pytest.mark.parametrize("degrees", [0.0, 0.01, 1.0, 45.0, 89.0, 89.99])
def test_plane_at_a_known_angle_keeps_its_digits(degrees):
    """A ray down onto a floor; the arc cosine would be off by a fiftieth of a degree at 0.01."""
    angle = np.radians(degrees)
    rays = Rays(np.zeros((1, 3)), np.array([[np.sin(angle), 0, -np.cos(angle)]]))
    incidence = incidence_of(np.float32([[[0, 0, 7]]]), rays)
    np.testing.assert_allclose(np.degrees(incidence), [[degrees]], atol=2e-5)


def test_angles_agree_with_the_library_in_double_precision():
    """Over the whole quarter turn, more rays than one packet holds and no multiple of it."""
    angle = np.linspace(0, np.pi / 2, 100_001)
    rays = Rays(np.zeros((1, 3)), np.stack([np.sin(angle), 0 * angle, -np.cos(angle)], axis=-1))
    normals = np.broadcast_to(np.float32([0, 0, 1]), (1, len(angle), 3))
    np.testing.assert_allclose(incidence_of(normals, rays)[0], angle, atol=2.5e-7)


def test_a_surface_without_a_normal_has_no_incidence():
    rays = Rays(np.zeros((1, 3)), np.eye(3))
    normals = np.float32([[[0, 0, 0], [np.nan, 0, 1], [0, 0, 2]]])
    np.testing.assert_array_equal(np.isnan(incidence_of(normals, rays)), [[True, True, False]])


def test_misses_have_no_incidence_and_send_nothing_back():
    rays = Rays(np.array([[-5.0, 0, 0]]), np.array([[1.0, 0, 0], [0, 1, 0]]))
    slot, distance, normals, incidence = seen(one_solid(BOX, [1, 1, 1]), rays)
    assert slot.tolist() == [[0, -1]]
    np.testing.assert_array_equal(np.isnan(incidence), [[False, True]])
    assert np.all(np.isnan(normals[0, 1]))
    intensity = intensity_of(distance, np.array([[WALL, 0]], np.uint8), incidence)
    assert intensity[0, 0] > 0 and intensity[0, 1] == 0


@pytest.mark.parametrize("seed", range(2))
def test_incidence_agrees_with_the_face_normals_of_a_mesh(seed):
    """Witness: trimesh's boxes, and prisms of 720 corners whose flat faces differ from a cylinder's by 1/4 degree."""
    import trimesh

    rooms = make_rooms(RoomConfig(), seed, np.arange(3))
    rng = np.random.default_rng(seed)
    origin = rng.uniform([-4, -4, -1], [4, 4, 1], (3, 3))
    rotation = rotation_of(rng.uniform(-180, 180, 3), rng.uniform(-60, 60, 3))
    rays = Rays(origin.astype(np.float32), Spinning(60, 30, (-80.0, 80.0)).directions(), rotation)
    slot, distance, _, incidence = seen(rooms, rays)
    for room in range(3):
        vertices, triangles, triangle_slot = scene_mesh(rooms, room, sections=720)
        mesh = trimesh.Trimesh(vertices, triangles, process=False)
        world = rays.direction.astype(float) @ rotation[room].T.astype(float)
        point = origin[room] + distance[room][:, None] * world
        for number in np.unique(slot[room]):
            rows, own = np.flatnonzero(slot[room] == number), np.flatnonzero(triangle_slot == number)
            part = mesh.submesh([own], append=True, repair=False)
            _, gap, face = trimesh.proximity.closest_point(part, point[rows])
            cosine = np.abs(np.sum(part.face_normals[face] * world[rows], axis=1))
            off = np.degrees(np.abs(np.arccos(np.minimum(cosine, 1)) - incidence[room, rows]))
            assert gap.max() < 1e-3
            assert np.mean(off < (0.3 if rooms.kind[room, number] == CYLINDER else 0.02)) > 0.995  # edges: either face


def test_explicit_normals_of_triangles_give_what_primitives_give():
    import trimesh

    scene = one_solid(BOX, [1, 2, 3], 0.4)
    vertices, triangles, _ = scene_mesh(scene, 0)
    mesh = trimesh.Trimesh(vertices, triangles, process=False)
    pose = rotation_of(np.array([10.0]), np.array([-5.0]))
    rays = Rays(np.float32([[-6, 0.3, 1.0]]), Pinhole(40, 25, 60, 60).directions(), pose)
    slot, _, _, expected = seen(scene, rays)
    world = rays.direction @ pose[0].T
    face = mesh.ray.intersects_first(np.repeat(rays.origin, len(world), 0), world)
    normals = np.where(face[:, None] >= 0, mesh.face_normals[face], np.nan)[None]
    both = (face >= 0) & (slot[0] >= 0)
    assert 100 < both.sum() < both.size
    found = incidence_of(normals, rays)
    assert np.mean(np.abs(found[0, both] - expected[0, both]) < 1e-4) > 0.99
    np.testing.assert_array_equal(np.isnan(found[0]), face < 0)
    np.testing.assert_allclose(incidence_of(-3 * normals, rays), found, atol=1e-5)  # neither sign nor length counts


def test_every_normal_is_of_unit_length_and_faces_its_ray():
    rooms = make_rooms(RoomConfig(), 4, np.arange(6))
    rng = np.random.default_rng(0)
    direction = rng.normal(size=(6, 3_000, 3)).astype(np.float32)
    direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
    rays = Rays(rng.uniform(-1.4, 1.4, (6, 3_000, 3)), direction)
    slot, _, normals, incidence = seen(rooms, rays)
    assert np.all(slot >= 0)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=-1), 1.0, atol=1e-5)
    cosine = -np.sum(normals * direction, axis=-1)
    assert np.all(cosine >= 0)
    np.testing.assert_allclose(np.cos(incidence), cosine, atol=1e-5)


def test_results_do_not_depend_on_the_other_rooms():
    rooms = make_rooms(RoomConfig(), 1, np.arange(4))
    rays = Rays(np.tile(np.float32([0.1, 0.2, 0.3]), (4, 1)), Pinhole(33, 21).directions(), rotation_of(
        np.arange(4) * 50.0, np.zeros(4)))  # fmt: skip
    whole = seen(rooms, rays)
    single = seen(Primitives(*(f[2:3] for f in rooms)), Rays(rays.origin[2:3], rays.direction, rays.rotation[2:3]))
    for a, b in zip(whole, single, strict=True):
        np.testing.assert_array_equal(a[2:3], b)


def test_intensity_is_lamberts_law_with_the_square_of_the_range():
    distance = np.float32([[1, 2, 1, 1, np.inf]])
    semantic = np.uint8([[FLOOR, FLOOR, FLOOR, 200, 0]])
    incidence = np.float32([[0, 0, np.pi / 3, 0, np.nan]])
    white = REFLECTIVITY[FLOOR]
    expected = [[white, white / 4, white / 2, UNKNOWN_REFLECTIVITY, 0]]
    np.testing.assert_allclose(intensity_of(distance, semantic, incidence), expected, rtol=1e-6)
    np.testing.assert_allclose(intensity_of(distance, semantic, incidence, {FLOOR: 1.0})[0, 0], 1.0)


def test_a_wall_is_brightest_where_it_is_nearest():
    """Along a wall the range is d / cos(i), so the light is that of the foot times the cube of the cosine."""
    scene = one_solid(BOX, [0.1, 50, 50], center=(3.1, 0, 0))
    rays = Rays(np.zeros((1, 3)), Pinhole(41, 31).directions())
    _, distance, _, incidence = seen(scene, rays)
    light = intensity_of(distance, cast_rays(scene, None, rays).semantic, incidence, {1: 1.0})
    np.testing.assert_allclose(light, np.cos(incidence) ** 3 / 9, rtol=1e-4)
    assert light.argmax() == light.size // 2


@pytest.mark.parametrize("shape", [(0, 5), (1, 0)])
def test_nothing_to_see_gives_empty_arrays(shape):
    scene = Primitives(*(field[: shape[0]] for field in one_solid(BOX, [1, 1, 1])))
    rays = Rays(np.zeros((shape[0], 3)), np.tile([1.0, 0, 0], (shape[1], 1)))
    slot = np.zeros(shape, np.int32)
    normals = normals_of(scene, slot, np.zeros(shape, np.float32), rays)
    assert normals.shape == (*shape, 3) and incidence_of(normals, rays).shape == shape


@pytest.mark.parametrize(
    "slot, rays, message",
    [
        ([[0, 0]], Rays(np.zeros((1, 3)), np.eye(3)), "slot and distance must be"),
        ([[0, 1, 0]], Rays(np.zeros((1, 3)), np.eye(3)), "slot must lie within -1 and 0, got 0 to 1"),
        ([[0, 0, 0]], Rays(np.zeros((2, 3)), np.eye(3)), "origin must be"),
        ([[0, 0, 0]], Rays(np.zeros((1, 3)), np.eye(4)), "direction must be"),
        ([[0, 0, 0]], Rays(np.zeros((1, 3)), np.eye(3), np.zeros((2, 3, 3))), "rotation must be"),
    ],
)
def test_rejects_shapes_that_disagree(slot, rays, message):
    with pytest.raises(ValueError, match=message):
        normals_of(one_solid(BOX, [1, 1, 1]), slot, np.ones((1, 3), np.float32), rays)


def test_rejects_what_is_no_reflectivity():
    one = np.ones((1, 1), np.float32)
    with pytest.raises(ValueError, match="reflectivity must give"):
        intensity_of(one, one.astype(np.uint8), one, {FLOOR: 1.5})
    with pytest.raises(ValueError, match="one shape"):
        intensity_of(one, one.astype(np.uint8)[0], one)
    with pytest.raises(ValueError, match="normals must be"):
        incidence_of(np.zeros((3, 3)), Rays(np.zeros((1, 3)), np.eye(3)))
