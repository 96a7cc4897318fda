"""Mirror images leave a scan; what only looks like them stays. One room, x < 3 m, and what lies beyond its wall."""

import numpy as np
import pytest

from jaxmm.rays.mirror_images import Surfaces, without_images
from jaxmm.rays.scan_rays import PosedScan
from warp_scanner.scenes.scenes import BOX, GAP, WALL, Tags, join, solids
from warp_scanner.sensors.reflections import Sheen, reflected, room_caster
from warp_scanner.sensors.scan import Rays, cast_slots
from warp_scanner.sensors.sensors import Spinning
from warp_scanner.sensors.surface import incidence_of, normals_of
from warp_scanner.sensors.surface_distance import surface_distance

PLACE = np.array([0.4, -0.3, 0.1])
SENSOR = Spinning(1200, 100, (-40.0, 40.0))
FACE = 3.0  # [m] of the wall that may mirror, or be gone
THICK = 0.2
CLEARLY = 0.4  # [m] behind the face
MIRRORING = 0  # element of that wall

# Middle and half size [m] of what stands in the room, but for the wall: shell and furniture.
SHELL = [
    ((0.0, 0.0, -1.5), (3.2, 2.7, 0.1)), ((0.0, 0.0, 1.5), (3.2, 2.7, 0.1)),
    ((-3.1, 0.0, 0.0), (0.1, 2.7, 1.4)), ((0.0, -2.6, 0.0), (3.0, 0.1, 1.4)), ((0.0, 2.6, 0.0), (3.0, 0.1, 1.4)),
]  # fmt: skip
FURNITURE = [
    ((-2.2, 1.2, -0.9), (0.4, 0.5, 0.5)), ((1.9, -1.6, -0.4), (0.3, 0.3, 1.0)), ((-0.6, -2.0, -0.9), (0.5, 0.3, 0.5)),
    ((1.6, 1.9, -0.6), (0.5, 0.25, 0.8)),
]  # fmt: skip


def nowhere(points, _):
    return np.full(len(points), np.inf)


UNKNOWN = Surfaces(lambda: np.zeros((0, 3)), nowhere, nowhere)


def boxes(parts, first):
    center, half = (np.array(field, np.float64)[None] for field in zip(*parts, strict=True))
    there, element = np.ones(center.shape[:2], bool), first + np.arange(len(parts))
    return solids(there, list(np.moveaxis(center, 2, 0)), list(np.moveaxis(half, 2, 0)), 0.0, Tags(BOX, element, WALL))


def turned_over(parts, about):
    """The same things mirrored about the plane x = about."""
    return [((2 * about - x, y, z), half) for (x, y, z), half in parts]


WALL_THERE = [((FACE + THICK / 2, 0.0, 0.0), (THICK / 2, 2.7, 1.4))]
ROOM = join(boxes(WALL_THERE, MIRRORING), boxes(SHELL, 10))


def scan_of(scene, mirrored=0.0, passed=0.0):
    """A scan, and which of its points came by way of the mirror."""
    sheen = Sheen(np.array([mirrored]), np.array([passed]))
    rays = Rays(PLACE[None], SENSOR.directions())
    found = reflected(room_caster(scene), rays, sheen, (3, np.arange(1)))
    back = np.isfinite(found.scan.distance[0])
    points = PLACE + SENSOR.directions()[back].astype(np.float64) * found.scan.distance[0][back, None]
    return PosedScan(points.astype(np.float32), PLACE, np.eye(3), SENSOR), found.mirrored[0][back] > 0


def prior_of(scene):
    """What a model of the scene knows."""
    shown, _ = scan_of(scene)

    def distance(points, reach):
        return np.minimum(surface_distance(scene, None, [points.astype(np.float32)])[0], reach)

    def off(starts, ends):
        way = ends - starts
        reach = np.linalg.norm(way, axis=1)
        rays = Rays(starts.astype(np.float32)[None], (way / reach[:, None]).astype(np.float32)[None])
        met, slot = cast_slots(scene, None, rays)
        cosine = np.cos(incidence_of(normals_of(scene, slot, met, rays), rays))[0]
        return np.where(np.abs(met[0] - reach) < 0.5, np.abs(met[0] - reach) * cosine, np.inf)

    return Surfaces(lambda: shown.points, distance, off)


def left_of(scan, found):
    """(N,) bool: which points of a scan stayed."""
    kinds = [("", np.float32)] * 3
    whole, kept = (np.ascontiguousarray(one.points).view(kinds).ravel() for one in (scan, found.scan))
    return np.isin(whole, kept)


@pytest.mark.parametrize(("mirrored", "passed"), [(1.0, 0.0), (0.9, 0.0), (0.5, 0.4)])
def test_images_leave_and_the_mirror_is_met(mirrored, passed):
    """Behind the wall there is nothing but what it shows; what passes a pane does not come back."""
    scan, image = scan_of(join(ROOM, boxes(FURNITURE, 20)), mirrored, passed)
    found = without_images(scan, prior_of(ROOM))
    kept = left_of(scan, found)
    assert image.mean() > 0.03
    assert kept[~image].mean() > 0.99
    assert kept[image & (scan.points[:, 0] > FACE + CLEARLY)].mean() < 0.02
    assert len(found.mirrors) == 1
    np.testing.assert_allclose(np.abs(found.mirrors[0].plane.normal), [1, 0, 0], atol=1e-3)
    added = found.scan.points[-(len(found.scan.points) - kept.sum()) :]
    np.testing.assert_allclose(added[:, 0], FACE, atol=0.01)
    assert len(added) >= (~kept).sum() and found.share == pytest.approx(np.mean(~kept))


def test_without_a_mirror_a_scan_is_what_it_was():
    scan, _ = scan_of(join(ROOM, boxes(FURNITURE, 20)))
    found = without_images(scan, prior_of(ROOM))
    assert found.scan is scan and not found.mirrors and found.share == 0.0


def test_a_real_room_laid_out_as_a_mirror_image_stays_where_the_wall_is_gone():
    """About the middle of the wall, as such rooms are built; the model knows nothing of it."""
    beyond = turned_over(SHELL + FURNITURE, FACE + THICK / 2)
    reality = join(boxes(SHELL + FURNITURE, 10), boxes(beyond, 50))
    scan, _ = scan_of(reality)
    assert (scan.points[:, 0] > FACE + 0.5).mean() > 0.1
    assert without_images(scan, prior_of(ROOM)).scan is scan


def test_what_the_model_has_behind_the_wall_is_real_however_it_looks():
    """Even mirrored about the very face of the wall."""
    beyond = boxes(turned_over(SHELL + FURNITURE, FACE), 50)
    scan, _ = scan_of(join(boxes(SHELL + FURNITURE, 10), beyond))
    assert without_images(scan, prior_of(join(ROOM, beyond))).scan is scan


def test_one_new_wall_that_stands_where_an_image_would_stays():
    """As far behind the wall that is gone as the back wall is before it: that alone may be by chance."""
    new = [((9.0 + 0.1, 0.0, 0.0), (0.1, 6.0, 1.4))]
    floors = [((9.0, 0.0, -1.5), (8.0, 8.0, 0.1)), ((9.0, 0.0, 1.5), (8.0, 8.0, 0.1))]
    model = join(ROOM, boxes(floors, 40))
    scan, _ = scan_of(join(boxes(SHELL + FURNITURE, 10), boxes(floors, 40), boxes(new, 50)))
    assert (scan.points[:, 0] > 8.9).mean() > 0.03
    assert without_images(scan, prior_of(model)).scan is scan


def test_real_things_behind_glass_stay():
    """Another room beyond: the model holds it, but not what stands in it."""
    beyond = [((x + 6.2, y, z), half) for (x, y, z), half in SHELL]
    cabinet = [((5.0, 0.9, -0.4), (0.3, 0.4, 1.0))]
    model = join(ROOM, boxes(beyond, 40))
    scan, image = scan_of(join(model, boxes(FURNITURE, 20), boxes(cabinet, 70)), 0.7, 0.2)
    found = without_images(scan, prior_of(model))
    kept, (x, y, z) = left_of(scan, found), scan.points.T
    on_cabinet = ~image & (np.abs(x - 5.0) < 0.31) & (np.abs(y - 0.9) < 0.41) & (np.abs(z + 0.4) < 1.01)
    assert on_cabinet.sum() > 100 and kept[on_cabinet].mean() > 0.9
    unknown = prior_of(model).distance(scan.points, 0.15) >= 0.15
    assert kept[image & unknown].mean() < 0.2


def test_no_points_and_no_surface_are_no_trouble():
    nothing = PosedScan(np.zeros((0, 3), np.float32), PLACE, np.eye(3))
    assert without_images(nothing, prior_of(ROOM)).scan is nothing
    scan, _ = scan_of(ROOM._replace(kind=np.where(ROOM.element == 10, GAP, ROOM.kind)), 1.0)
    far = without_images(scan, UNKNOWN)
    assert len(far.scan.points) >= 0.9 * len(scan.points)
