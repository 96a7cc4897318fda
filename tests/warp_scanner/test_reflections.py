"""Mirrors and panes: where rays end that are thrown back or pass, by geometry that can be worked out by hand."""

import numpy as np
import pytest

from warp_scanner.rooms.rooms import RoomConfig, make_rooms
from warp_scanner.scenes.building import Triangles
from warp_scanner.scenes.scenes import BOX, GAP, OTHER, WALL, Tags, scene_mesh, solids
from warp_scanner.sensors.poses import rotation_of
from warp_scanner.sensors.reflections import Sheen, building_caster, reflected, room_caster
from warp_scanner.sensors.scan import Rays, cast_rays
from warp_scanner.sensors.sensors import OAK_D_PRO_SMALL, Spinning
from warp_scanner.sensors.triangles import prepare

NUMBERS = (5, np.arange(1))
PLACE = np.float32([[0.0, 0.0, 0.0]])


def slab(x, element, half=0.05):
    """A wide upright slab across x."""
    there = np.ones((1, 1), bool)
    return solids(there, [x, 0.0, 0.0], [half, 20.0, 20.0], 0.0, Tags(BOX, element, WALL))


def table(*parts):
    return type(parts[0])(*(np.concatenate(fields, axis=1) for fields in zip(*parts, strict=True)))


def towards(*directions):
    directions = np.float32(directions)
    return Rays(PLACE, directions / np.linalg.norm(directions, axis=1, keepdims=True))


def sheen(count, mirrored=None, passed=None):
    shares = Sheen(np.zeros(count), np.zeros(count))
    for share, given in zip(shares, (mirrored, passed), strict=True):
        for element, value in (given or {}).items():
            share[element] = value
    return shares


@pytest.fixture(scope="module")
def room():
    rooms = make_rooms(RoomConfig(), 3, np.arange(2))
    return rooms, Rays(
        np.float32([[0.3, 0.1, 0.2]] * 2), OAK_D_PRO_SMALL.resampled(80, 50).directions(), rotation_of([10, 80], [0, 5])
    )


def test_without_sheen_it_is_the_scan_itself(room):
    rooms, rays = room
    expected = cast_rays(rooms, None, rays)
    found = reflected(room_caster(rooms), rays, sheen(300), (1, np.arange(2)))
    np.testing.assert_allclose(found.scan.distance, expected.distance, rtol=1e-5)
    np.testing.assert_array_equal(found.scan.element, expected.element)
    np.testing.assert_array_equal(found.scan.semantic, expected.semantic)
    assert not found.mirrored.any() and not found.passed.any()


def test_a_mirror_shows_what_is_behind_the_scanner_at_the_whole_way():
    """Mirror face at x = 2, wall face at x = -3: 2 m there and 5 m back, and as much longer as rays slant."""
    scene, slants = table(slab(2.05, 0), slab(-3.05, 1)), ([1, 0, 0], [1, 0.5, 0], [1, 0.2, -0.3])
    found = reflected(room_caster(scene), towards(*slants), sheen(2, mirrored={0: 1.0}), NUMBERS)
    length = np.linalg.norm(np.float64(slants), axis=1)
    np.testing.assert_allclose(found.scan.distance[0], 7.0 * length, atol=2e-3)
    assert (found.scan.element == 1).all() and (found.mirrored == 1).all()
    np.testing.assert_allclose(found.incidence[0], np.arccos(1.0 / length), atol=1e-3)


def test_points_of_a_mirror_are_the_mirrored_points_of_the_room(room):
    """The image mirrored at the plane lies on what the thrown ray hits: seen from the mirrored place of the scanner."""
    rooms, rays = room
    found = reflected(room_caster(rooms), rays, sheen(300, mirrored={3: 1.0}), (1, np.arange(2)))
    plane = 5.0  # inner face of outer wall 3 of the thesis's room, across x
    world = np.einsum("rij,pj->rpi", rays.rotation, rays.direction)
    points = (
        rays.origin[:, None] + world * np.where(np.isfinite(found.scan.distance), found.scan.distance, 0)[..., None]
    )
    once = (found.mirrored == 1) & np.isfinite(found.scan.distance)
    assert once.sum() > 500 and (points[once][:, 0] > plane).all()
    image = points[once] * [-1, 1, 1] + [2 * plane, 0, 0]
    place, ahead = rays.origin * [-1, 1, 1] + [2 * plane, 0, 0], world * [-1, 1, 1]
    kept = rooms._replace(kind=np.where(rooms.element == 3, GAP, rooms.kind))
    seen = cast_rays(kept, None, Rays(place.astype(np.float32), ahead.astype(np.float32)))
    # From outside the shell, those that meet nothing before the mirror's place.
    again = place[:, None] + ahead * seen.distance[..., None]
    inside = again[once][:, 0] < plane - 1e-3
    assert inside.mean() > 0.95
    np.testing.assert_allclose(again[once][inside], image[inside], atol=5e-3)


def test_a_pane_lets_rays_pass_as_if_it_were_not_there():
    scene, rays = table(slab(2.0, 0), slab(4.05, 1)), towards([1, 0, 0], [1, 0.4, 0.1])
    found = reflected(room_caster(scene), rays, sheen(2, passed={0: 1.0}), NUMBERS)
    without = cast_rays(scene, np.array([[False, True]]), rays)
    np.testing.assert_allclose(found.scan.distance, without.distance, atol=5e-3)
    assert (found.passed == 1).all() and (found.scan.element == 1).all()


def test_shares_are_shares_of_the_rays():
    scene = table(slab(2.05, 0), slab(-3.05, 1), slab(6.05, 2))
    rays = towards(*[[1.0, y, 0.0] for y in np.linspace(-0.5, 0.5, 20_000)])
    found = reflected(room_caster(scene), rays, sheen(3, {0: 0.3}, {0: 0.5}), NUMBERS)
    for element, share in ((0, 0.2), (1, 0.3), (2, 0.5)):
        assert abs(np.mean(found.scan.element == element) - share) < 4 * np.sqrt(share * (1 - share) / 20_000)


def test_the_same_seed_gives_the_same_and_another_another(room):
    rooms, rays = room
    shares = sheen(300, {2: 0.4, 3: 0.4, 4: 0.4, 5: 0.4}, {2: 0.3, 3: 0.3})
    first, again, other = (reflected(room_caster(rooms), rays, shares, (seed, np.arange(2))) for seed in (4, 4, 5))
    np.testing.assert_array_equal(first.scan.distance, again.scan.distance)
    assert (first.scan.distance != other.scan.distance).mean() > 0.2
    alone = reflected(
        room_caster(type(rooms)(*(field[1:] for field in rooms))),
        Rays(rays.origin[1:], rays.direction, rays.rotation[1:]), shares, (4, np.array([1])),
    )  # fmt: skip
    np.testing.assert_array_equal(alone.scan.distance[0], first.scan.distance[1])


def test_triangles_reflect_as_the_primitives_they_are_made_of(room):
    rooms, rays = room
    vertices, faces, slot = scene_mesh(rooms, 0, sections=256)
    element = rooms.element[0, slot]
    triangles = Triangles(
        vertices.astype(np.float32), faces.astype(np.int32), element.astype(np.int32),
        np.full(element.max() + 1, OTHER, np.uint8),
    )  # fmt: skip
    one = type(rays)(rays.origin[:1], rays.direction, rays.rotation[:1])
    shares = sheen(300, mirrored=dict.fromkeys((2, 3, 4, 5), 1.0))
    found, expected = (
        reflected(cast, one, shares, NUMBERS)
        for cast in (building_caster(prepare(triangles)), room_caster(type(rooms)(*(field[:1] for field in rooms))))
    )
    same = np.abs(found.scan.distance - expected.scan.distance) < 0.01
    both_lost = np.isinf(found.scan.distance) & np.isinf(expected.scan.distance)
    assert (same | both_lost).mean() > 0.97  # but at edges, and on round things


def test_between_two_mirrors_a_ray_gets_lost():
    scene = table(slab(2.05, 0), slab(-3.05, 1))
    found = reflected(room_caster(scene), towards([1, 0, 0]), sheen(2, {0: 1.0, 1: 1.0}), NUMBERS)
    assert np.isinf(found.scan.distance).all() and (found.scan.element == -1).all()


@pytest.mark.parametrize(
    "shares", [Sheen(np.zeros(2), np.zeros(3)), Sheen(np.array([0.7]), np.array([0.6])), Sheen(np.array([-0.1]), [0])]
)
def test_impossible_shares_are_refused(shares):
    with pytest.raises(ValueError, match="sheen must give"):
        reflected(room_caster(slab(2.0, 0)), towards([1, 0, 0]), shares, NUMBERS)


def test_numbers_of_rooms_must_agree():
    rays = Rays(PLACE, Spinning(4, 1).directions())
    with pytest.raises(ValueError, match="which must name 1 rooms, got 2"):
        reflected(room_caster(slab(2.0, 0)), rays, sheen(1), (0, np.arange(2)))
