"""The triangle caster against analytic cases, Embree, and itself: packets and single rays must not differ."""

import numpy as np
import pytest
import trimesh

from warp_scanner.kernels import triangles as triangle_kernels
from warp_scanner.rooms.rooms import RoomConfig, make_rooms
from warp_scanner.scenes.building import Triangles
from warp_scanner.scenes.scenes import CYLINDER, PILLAR, WALL, scene_mesh
from warp_scanner.sensors.poses import rotation_of
from warp_scanner.sensors.scan import Rays, cast_rays
from warp_scanner.sensors.sensors import Pinhole
from warp_scanner.sensors.triangles import cast_triangles, clearance, prepare


def scene_of(*meshes):
    """One element per mesh, the first a wall, all others pillars."""
    start = np.cumsum([0] + [len(mesh.vertices) for mesh in meshes[:-1]])
    return prepare(
        Triangles(
            np.concatenate([mesh.vertices for mesh in meshes]).astype(np.float32),
            np.concatenate([mesh.faces + first for mesh, first in zip(meshes, start, strict=True)]).astype(np.int32),
            np.repeat(np.arange(len(meshes), dtype=np.int32), [len(mesh.faces) for mesh in meshes]),
            np.array([WALL] + [PILLAR] * (len(meshes) - 1), np.uint8),
        )
    )


def unit(directions):
    directions = np.asarray(directions, float)
    return directions / np.linalg.norm(directions, axis=-1, keepdims=True)


@pytest.fixture(scope="module")
def two_boxes():
    far = trimesh.creation.box(extents=[2, 2, 2]).apply_translation([5, 0, 0])
    return scene_of(trimesh.creation.box(extents=[2, 2, 2]), far)


@pytest.mark.parametrize(
    "origin, direction, distance, element",
    [
        pytest.param([-3, 0.3, 0.2], [1, 0, 0], 2.0, 0, id="hits the near face"),
        pytest.param([0, 0.3, 0.2], [1, 0, 0], 1.0, 0, id="from inside sees the back of a face"),
        pytest.param([2, 0.3, 0.2], [1, 0, 0], 2.0, 1, id="between the two"),
        pytest.param([2, 0.3, 0.2], [-1, 0, 0], 1.0, 0, id="looking back"),
        pytest.param([0, 3, 0], [1, 0, 0], np.inf, -1, id="misses beside"),
        pytest.param([0.1, 0.3, 4], [0, 0, -1], 3.0, 0, id="straight down"),
        pytest.param([7, 0.3, 0.2], [1, 0, 0], np.inf, -1, id="ignores what lies behind"),
        pytest.param([-3, 0, 0], [1, 0, 0], 2.0, 0, id="on the diagonal that two triangles share"),
    ],
)
@pytest.mark.parametrize("together", [True, False])
def test_analytic_cases(two_boxes, origin, direction, distance, element, together):
    origins = np.array([origin], float) if together else np.array([[origin]], float)
    result = cast_triangles(two_boxes, Rays(origins, unit([direction])))
    np.testing.assert_allclose(result.distance, [[distance]], atol=1e-6)
    assert result.element[0, 0] == element
    assert result.semantic[0, 0] == {-1: 0, 0: WALL, 1: PILLAR}[element]


def room_scene(seed=5):
    primitives = make_rooms(RoomConfig(), seed, np.arange(1))
    vertices, faces, slot = scene_mesh(primitives, 0, sections=24)
    slots, element = np.unique(slot, return_inverse=True)
    triangles = Triangles(
        vertices.astype(np.float32), faces.astype(np.int32), element.astype(np.int32), primitives.semantic[0, slots]
    )
    return primitives, slots, prepare(triangles)


@pytest.fixture(scope="module")
def room():
    return room_scene()


def grid_rays(views=4):
    rng = np.random.default_rng(2)
    origin = rng.uniform([-4, -4, -1], [4, 4, 1], (views, 3)).astype(np.float32)
    yaw, pitch = rng.uniform(-180, 180, views), rng.uniform(-60, 60, views)
    return Rays(origin, Pinhole(160, 100).directions(), rotation_of(yaw, pitch))


def test_agrees_with_the_primitives_of_the_room(room):
    primitives, slots, scene = room
    rays = grid_rays()
    ours = cast_triangles(scene, rays)
    truth = cast_rays(type(primitives)(*(np.repeat(field, 4, axis=0) for field in primitives)), None, rays)
    assert np.isfinite(truth.distance).all()
    round_slots = np.isin(truth.element, primitives.element[primitives.kind == CYLINDER])
    same = np.abs(ours.distance - truth.distance) < 1e-4
    element = np.where(ours.element >= 0, primitives.element[0, slots][ours.element], -1)
    assert np.mean(same[~round_slots]) > 0.9995
    np.testing.assert_array_equal(element[same & ~round_slots], truth.element[same & ~round_slots])
    np.testing.assert_array_equal(ours.semantic[same & ~round_slots], truth.semantic[same & ~round_slots])


@pytest.mark.parametrize("kind", ["grid", "any direction", "any origin"])
def test_agrees_with_embree_on_every_ray(room, kind):
    open3d = pytest.importorskip("open3d")
    _, _, scene = room
    rng = np.random.default_rng(3)
    if kind == "grid":
        rays = grid_rays()
        directions = np.einsum("rij,pj->rpi", rays.rotation, rays.direction)
        origins = np.broadcast_to(rays.origin[:, None], directions.shape)
    else:
        directions = unit(rng.normal(size=(2, 20_000, 3))).astype(np.float32)
        origins = rng.uniform(-6, 6, (2, 20_000, 3)).astype(np.float32)
        origins = origins if kind == "any origin" else np.broadcast_to(origins[:, :1], directions.shape)
        rays = Rays(origins if kind == "any origin" else origins[:, 0], directions)
    witness = open3d.t.geometry.RaycastingScene()
    witness.add_triangles(
        open3d.core.Tensor(scene.triangles.vertices), open3d.core.Tensor(scene.triangles.faces.astype(np.uint32))
    )
    answer = witness.cast_rays(open3d.core.Tensor(np.concatenate([origins, directions], -1).astype(np.float32)))
    ours, theirs = cast_triangles(scene, rays).distance, answer["t_hit"].numpy()
    with np.errstate(invalid="ignore"):
        differs = ~((np.abs(ours - theirs) <= 1e-4) | (np.isinf(ours) & np.isinf(theirs)))
    assert np.isinf(theirs).any() == (kind != "grid") or kind == "any direction"
    assert differs.sum() <= 1e-4 * differs.size  # rays that graze an edge may fall either way


def test_no_ray_slips_through_a_closed_surface():
    ball = trimesh.creation.icosphere(subdivisions=4, radius=2.0)
    scene = scene_of(ball)
    # Rays through vertices and through the middles of edges, where two to six triangles meet.
    edges = ball.vertices[ball.edges_unique].mean(axis=1)
    for origin in ([0.0, 0.0, 0.0], [0.3, -0.7, 1.1], [1.9, 0.0, 0.0]):
        directions = unit(np.concatenate([ball.vertices, edges]) - origin).astype(np.float32)
        for rays in (
            Rays(np.array([origin], np.float32), directions),
            Rays(np.broadcast_to(np.float32(origin), (1, *directions.shape)), directions),
        ):
            assert np.isfinite(cast_triangles(scene, rays).distance).all()


def test_travelling_together_or_alone_changes_no_bit(room):
    _, _, scene = room
    rays = grid_rays()
    packets = cast_triangles(scene, rays)
    directions = np.einsum("rij,pj->rpi", rays.rotation, rays.direction).astype(np.float32)
    shuffle = np.random.default_rng(0).permutation(directions.shape[1])
    shuffled = cast_triangles(scene, Rays(rays.origin, rays.direction[shuffle], rays.rotation), threads=1)
    assert np.ptp(directions[0, shuffle[: triangle_kernels.PACKET], 0]) > triangle_kernels.COHERENT / 2
    for a, b in zip(packets, shuffled, strict=True):
        np.testing.assert_array_equal(a[:, shuffle], b)


def test_absent_elements_are_air_as_if_their_triangles_were_gone(room):
    _, _, scene = room
    rays, count = grid_rays(), len(scene.triangles.semantic)
    everything = cast_triangles(scene, rays)
    shares = np.bincount(everything.element.ravel(), minlength=count)
    present = np.ones((4, count), bool)
    present[:, np.argsort(shares)[-3:]] = False
    present[2] = True  # every view has its own reality
    ours = cast_triangles(scene, rays, present)
    stays = present[0][scene.triangles.element]
    without = prepare(
        scene.triangles._replace(faces=scene.triangles.faces[stays], element=scene.triangles.element[stays])
    )
    expected = cast_triangles(without, rays)
    for view in (0, 1, 3):
        np.testing.assert_array_equal(ours.distance[view], expected.distance[view])
        np.testing.assert_array_equal(ours.element[view], expected.element[view])
    np.testing.assert_array_equal(ours.distance[2], everything.distance[2])
    assert (ours.distance[0] > everything.distance[0]).any()


def test_clearance_is_the_distance_to_the_nearest_surface(two_boxes):
    points = np.array([[0, 0, 0], [2, 0, 0], [3, 0, 0], [0, 2.5, 0], [2, 2, 2], [40, 0, 0]])
    expected = [1, 1, 1, 1.5, np.sqrt(3), 3.0]
    np.testing.assert_allclose(clearance(two_boxes, points, 3.0), expected, atol=1e-6)


@pytest.mark.parametrize(
    "change, words",
    [
        pytest.param({"faces": np.zeros((0, 3), int), "element": np.zeros(0, int)}, "faces must be", id="no faces"),
        pytest.param({"faces": np.array([[0, 1, 9]])}, "name 3 vertices", id="face without vertex"),
        pytest.param({"vertices": np.full((3, 3), np.nan)}, "finite", id="NaN"),
        pytest.param({"element": np.array([4])}, "name 1 elements", id="unknown element"),
    ],
)
def test_refuses_broken_triangles(change, words):
    good = Triangles(np.eye(3, dtype=np.float32), np.array([[0, 1, 2]]), np.array([0]), np.array([WALL], np.uint8))
    prepare(good)
    with pytest.raises(ValueError, match=words):
        prepare(good._replace(**change))


def test_refuses_rays_and_masks_of_wrong_shape(two_boxes):
    with pytest.raises(ValueError, match="unit vectors"):
        cast_triangles(two_boxes, Rays(np.zeros((1, 3)), np.array([[2.0, 0, 0]])))
    with pytest.raises(ValueError, match="present must be"):
        cast_triangles(two_boxes, Rays(np.zeros((1, 3)), np.array([[1.0, 0, 0]])), np.ones(3, bool))
