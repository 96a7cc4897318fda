"""Floor and ceiling of a storey come from the whole cloud, not from what a view shows of it."""

import numpy as np
import pytest

from jaxmm.rays.cloud_levels import HIGHER_THAN_FURNITURE, UNKNOWN, levels_about, own_ceilings
from jaxmm.rays.scan_rays import PosedScan
from jaxmm.verdicts.detection import detect_scans
from jaxmm.verdicts.named_scans import NamedScan
from jaxmm.verdicts.priors import prior_of_cloud
from jaxmm.verdicts.settings import DetectSettings
from tests.cases.box_building import building_of
from warp_scanner.scenes.scenes import CEILING, FLOOR, PILLAR, WALL
from warp_scanner.sensors.poses import rotation_of
from warp_scanner.sensors.scan import Rays
from warp_scanner.sensors.sensors import OAK_D_PRO_SMALL
from warp_scanner.sensors.triangles import cast_triangles, prepare

STEP = 0.08  # [m] between points
HEIGHT = 4.0  # [m] of a room, of which a view that looks down shows no ceiling
PLACE = np.array([-3.0, 0.2, 1.4])
NEW = ((0.4, 0.0, HEIGHT / 2), (0.2, 0.2, HEIGHT / 2), PILLAR)


def level(x, y, z):
    """Points of a level rectangle, x and y from lowest to highest."""
    x, y = np.meshgrid(np.arange(*x, STEP), np.arange(*y, STEP))
    return np.column_stack([x.ravel(), y.ravel(), np.full(x.size, z)])


def walls(low, high):
    along, z = (axis.ravel() for axis in np.meshgrid(np.arange(-4, 4, STEP), np.arange(low, high, STEP)))
    sides = [(along, np.full_like(along, way)) for way in (-4.0, 4.0)]
    return np.vstack([np.column_stack([*plan, z]) for x, y in sides for plan in ((x, y), (y, x))])


def storey(floor, ceiling):
    square = (-4, 4), (-4, 4)
    return np.vstack([level(*square, floor), level(*square, ceiling), walls(floor, ceiling)])


CASES = {
    "a room": (storey(0.0, 2.7), 1.4, 0.0, 2.7),
    "a hall": (storey(-1.0, 7.0), 0.5, -1.0, 7.0),
    "the middle one of three storeys": (np.vstack([storey(3.3 * s, 3.3 * s + 3.0) for s in (-1, 0, 1)]), 1.4, 0.0, 3.0),
    "the highest of three storeys": (np.vstack([storey(3.3 * s, 3.3 * s + 3.0) for s in (-2, -1, 0)]), 1.4, 0.0, 3.0),
    "tables and a robot lower than them": (np.vstack([storey(0.0, 2.7), level((-3, 1), (-3, 3), 0.75)]), 0.4, 0.0, 2.7),
    "tables and a camera above them": (np.vstack([storey(0.0, 2.7), level((-3, 1), (-3, 3), 0.75)]), 1.2, 0.0, 2.7),
    "lamps": (np.vstack([storey(0.0, 3.5), level((-1, 1), (-0.2, 0.2), 2.4)]), 1.2, 0.0, 3.5),
    "on a bridge": (np.vstack([level((-4, 4), (-4, 4), 0.0), level((-4, 4), (-4, 4), 9.0)]), 5.0, 0.0, 9.0),
    "no ceiling": (np.vstack([level((-4, 4), (-4, 4), 0.0), walls(0.0, 3.0)]), 1.4, 0.0, None),
    "no floor": (np.vstack([level((-4, 4), (-4, 4), 3.0), walls(0.0, 3.0)]), 1.4, None, 3.0),
    "walls alone": (walls(0.0, 3.0), 1.4, None, None),
    "hardly any points": (np.zeros((3, 3)), 1.4, None, None),
}


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("off", [0.0, 217.43])
def test_the_storey_about_a_sensor_is_told_by_what_is_level_around_it(case, off):
    points, height, *expected = CASES[case]
    noise = np.random.default_rng(42).normal(0.0, 0.005, points.shape)
    found = levels_about(points + noise + [0, 0, off], np.array([0.0, 0.0, height + off]))
    for one, right in zip(found, expected, strict=True):
        assert (one is None) == (right is None)
        assert right is None or one == pytest.approx(right + off, abs=0.03)


def test_a_ceiling_that_slopes_counts_by_its_highest_places():
    sloped = level((-4, 4), (-4, 4), 0.0)
    sloped[:, 2] = 3.0 + 0.2 * sloped[:, 0]
    found = levels_about(np.vstack([level((-4, 4), (-4, 4), 0.0), sloped]), np.array([0.0, 0.0, 1.4]))
    assert found.ceiling == pytest.approx(3.8, abs=0.1) and found.floor == pytest.approx(0.0, abs=0.01)


def test_where_nobody_knows_the_ceiling_what_is_highest_right_there_is_one():
    post, crate = np.array([[0.0, 0.0, z] for z in (0.5, 2.6)]), np.array([[2.0, 0.0, z] for z in (0.2, 1.1)])
    points = np.vstack([post, crate])
    found = own_ceilings(points, points, (0.0, 5.0))
    assert found[:2].tolist() == [[0.0, 2.6]] * 2  # it reaches up to its own end
    assert 1.1 < HIGHER_THAN_FURNITURE and found[2:].tolist() == [[0.0, 5.0]] * 2
    assert own_ceilings(points[:0], points, (0.0, 5.0)).shape == (0, 2)


ROOM = (
    ((0, 0, -0.1), (4, 3, 0.1), FLOOR), ((0, 0, HEIGHT + 0.1), (4, 3, 0.1), CEILING),
    ((0, -3.1, HEIGHT / 2), (4.2, 0.1, HEIGHT / 2), WALL), ((0, 3.1, HEIGHT / 2), (4.2, 0.1, HEIGHT / 2), WALL),
    ((-4.1, 0, HEIGHT / 2), (0.1, 3.2, HEIGHT / 2), WALL), ((4.1, 0, HEIGHT / 2), (0.1, 3.2, HEIGHT / 2), WALL),
)  # fmt: skip


def measured(boxes, directions, rotation=None):
    rotation = np.eye(3) if rotation is None else rotation
    along = (directions @ rotation.T).astype(np.float32)
    distance = cast_triangles(prepare(building_of(boxes).triangles), Rays(PLACE[None], along)).distance[0]
    back = np.isfinite(distance)
    return PLACE + along[back].astype(float) * distance[back, None]


@pytest.mark.parametrize("pitch, sign", [(-20.0, 1), (-30.0, 1), (-30.0, -1)])
@pytest.mark.parametrize("roofed", [True, False], ids=["whole prior", "prior without a ceiling"])
def test_a_camera_that_looks_down_tells_how_high_a_pillar_is(judges, pitch, sign, roofed):
    around = np.random.default_rng(42).normal(size=(150_000, 3)).astype(np.float32)
    around /= np.linalg.norm(around, axis=1, keepdims=True)
    before, now = (ROOM, (*ROOM, NEW))[::sign]
    cloud = measured(before, around)
    cloud = cloud if roofed else cloud[cloud[:, 2] < HEIGHT - 0.05]
    rotation = rotation_of(np.zeros(1, np.float32), np.array([pitch], np.float32))[0].astype(float)
    points = measured(now, OAK_D_PRO_SMALL.directions(), rotation)
    assert points[:, 2].max() < HEIGHT - 0.5  # no ceiling shows
    scan = NamedScan(PosedScan(points.astype(np.float32), PLACE, rotation, OAK_D_PRO_SMALL), "scan", 1, "given")
    found = detect_scans(prior_of_cloud(cloud), [scan], judges, DetectSettings(refine=False))
    (one,) = found.mismatches
    assert (one.object_type, one.mismatch_type) == ("pillar", "added" if sign > 0 else "removed")
    ends = one.center[2] + np.array([-0.5, 0.5]) * one.dimensions[2]
    np.testing.assert_allclose(ends, [0.0, HEIGHT], atol=0.05 if roofed else 0.15)  # walls end at points, not at edges
    assert (UNKNOWN in found.scans[0].notes) == (not roofed)
