"""Columns and walls up to 60 m away in a hall: told wherever some twenty rays of the scan end on them."""

import numpy as np
import pytest

from jaxmm.rays.hits import hits_of
from jaxmm.rays.scan_rays import PosedScan, rays_of_scan
from jaxmm.verdicts import far_elements
from jaxmm.verdicts.detection import detect_scans
from jaxmm.verdicts.far_elements import spacing_of, toward_far_elements
from jaxmm.verdicts.priors import prior_of_building
from jaxmm.verdicts.station_steps import look_at
from jaxmm.verdicts.verdicts import PRESENT, REMOVED, VerdictSettings
from tests.cases.box_building import building_of
from tests.cases.exact_poses import AS_IS, named
from warp_scanner.scenes.scenes import CEILING, FLOOR, FURNITURE, PILLAR, WALL
from warp_scanner.sensors.poses import rotation_of
from warp_scanner.sensors.scan import Rays
from warp_scanner.sensors.sensors import OUSTER_64, PRESETS
from warp_scanner.sensors.triangles import cast_triangles, prepare

TLS, PLACE, LEAST = PRESETS["tls"], np.array([0.0, 0.1, 1.6]), VerdictSettings().least_rays
SHELL = (
    ((30, 0, -0.1), (32, 6, 0.1), FLOOR), ((30, 0, 5.1), (32, 6, 0.1), CEILING),
    ((-2.1, 0, 2.5), (0.1, 6, 2.5), WALL), ((62.1, 0, 2.5), (0.1, 6, 2.5), WALL),
    ((30, 6.1, 2.5), (32, 0.1, 2.5), WALL), ((30, -6.1, 2.5), (32, 0.1, 2.5), WALL),
)  # fmt: skip
STAND = tuple(
    ((x, way * (4.2 - 0.3 * number), 2.5), (0.2, 0.2, 2.5), PILLAR)
    for number, x in enumerate(range(10, 61, 10)) for way in (-1, 1)
) + tuple(((x, y, 2.5), (0.1, 0.4, 2.5), WALL) for x, y in ((37, 0.9), (48, -0.4), (57, 0.6)))  # fmt: skip
GONE = (1, 4, 6, 9, 11, 13)  # of STAND
PRIOR = prior_of_building(building_of((*SHELL, *STAND)))


def scan_of(sensor, gone=(), known=True):
    """The hall without some of what should stand there."""
    left = tuple(one for number, one in enumerate(STAND) if number not in gone)
    turned = rotation_of([0.12], [0.0])[0]
    direction = (sensor.directions() @ turned.T).astype(np.float32)
    scene = prepare(building_of((*SHELL, *left)).triangles)
    reach = cast_triangles(scene, Rays(PLACE[None], direction)).distance[0]
    back = np.isfinite(reach) & (reach <= sensor.range_limits[1])
    points = (PLACE + direction[back] * reach[back, None].astype(np.float64)).astype(np.float32)
    return PosedScan(points, PLACE, turned.astype(float), sensor if known else None)


def erring(scan, sigma):
    """The scan with ranges that err by so much [m]."""
    offset = scan.points.astype(np.float64) - PLACE
    reach = np.linalg.norm(offset, axis=1, keepdims=True)
    errors = sigma * np.random.default_rng(0).standard_normal(reach.shape)
    return scan._replace(points=(PLACE + offset * (1.0 + errors / reach)).astype(np.float32))


def aimed(direction):
    """How many of some rays each element of the hall would stop, as it is in the model."""
    element = cast_triangles(PRIOR.scene, Rays(PLACE[None], direction)).element[0]
    return np.bincount(element[element >= 0], minlength=len(SHELL) + len(STAND))


@pytest.mark.parametrize("known", [True, False])
def test_all_rays_of_the_scan_toward_what_the_drawn_ones_rarely_meet_are_there_and_none_twice(known):
    scan = scan_of(TLS, known=known)
    rays = rays_of_scan(scan)
    more = toward_far_elements(PRIOR, scan, rays)
    offset = scan.points - PLACE
    own = aimed((offset / np.linalg.norm(offset, axis=1, keepdims=True)).astype(np.float32))
    drawn, now, shown = (
        aimed(one) for one in (rays.direction[: rays.measured], more.direction[: more.measured], more.pattern)
    )
    rare = (own >= LEAST) & (aimed(rays.pattern) * min(1.0, rays.measured / len(rays.pattern)) < LEAST)
    assert rare.sum() >= 5 and np.all(drawn[rare] < own[rare] / 2)
    np.testing.assert_array_less(0.9 * own[rare], now[rare] + 1)
    assert np.all(now <= own) and np.all(shown[rare] >= LEAST / 2)
    assert len(more.direction) == len(more.distance) <= 1.2 * len(rays.direction)
    assert len(np.unique(more.direction[: more.measured], axis=0)) >= 0.999 * more.measured
    assert spacing_of(rays, len(scan.points)) == pytest.approx(np.radians(0.2), rel=0.3)


def test_a_scan_all_of_whose_rays_are_there_stays_as_it_is_and_so_does_what_is_out_of_view():
    scan = scan_of(OUSTER_64)
    rays = rays_of_scan(scan)
    assert toward_far_elements(PRIOR, scan, rays) is rays
    scan = scan_of(TLS)
    offset = scan.points - PLACE
    back = scan._replace(points=scan.points[offset[:, 0] < 0.0], sensor=None)  # as if it looked the other way
    assert aimed(toward_far_elements(PRIOR, back, rays_of_scan(back)).pattern)[len(SHELL) :].sum() == 0


@pytest.mark.parametrize(
    "sensor, known, sigma",
    [
        pytest.param(TLS, True, 0.0, marks=pytest.mark.long),
        (TLS, True, 0.002),
        pytest.param(TLS, False, 0.0, marks=pytest.mark.long),
        (OUSTER_64, True, 0.0),
    ],
)
def test_what_stands_far_away_is_told_standing_and_what_is_gone_removed(judges, sensor, known, sigma):
    """Also where ranges err by some millimetres: to settle, they are drawn from the scan before."""
    scan = erring(scan_of(sensor, GONE, known), sigma)
    offset = scan.points - PLACE
    own = aimed((offset / np.linalg.norm(offset, axis=1, keepdims=True)).astype(np.float32))
    found = {one.guid: one.verdict for one in detect_scans(PRIOR, [named(scan)], judges, AS_IS).elements}
    told = 0
    for number, guid in enumerate(PRIOR.building.elements.guid[len(SHELL) :]):
        right = REMOVED if number in GONE else PRESENT
        if own[len(SHELL) + number] >= 1.25 * LEAST:
            assert found[guid] == right, (number, STAND[number], own[len(SHELL) + number])
            told += 1
        else:
            assert found[guid] != (PRESENT if number in GONE else REMOVED)
    assert told >= (13 if sensor is TLS else 7)


def test_of_what_is_in_sight_all_rays_are_there_however_many_near_things_are_hidden(monkeypatch):
    """Behind a wall stand more pillars, nearer by, than directions are added for."""
    monkeypatch.setattr(far_elements, "MOST_ADDED", 3000)
    hidden = tuple(((x, 5.0 + y, 1.0), (0.02, 0.02, 1.0), PILLAR) for x in np.arange(1.0, 6.0, 0.1) for y in (0.0, 0.3))
    screen, far = ((3.5, 4.0, 2.5), (3.5, 0.05, 2.5), WALL), STAND[8:12]
    boxes = (*SHELL, screen, *far, *hidden)
    prior = prior_of_building(building_of(boxes))
    direction = TLS.directions()
    met = cast_triangles(prior.scene, Rays(PLACE[None], direction))
    points = (PLACE + direction * met.distance[0][:, None].astype(np.float64)).astype(np.float32)
    scan = PosedScan(points[np.isfinite(points).all(axis=1)], PLACE, np.eye(3), TLS)
    more = toward_far_elements(prior, scan, rays_of_scan(scan))
    rows = slice(len(SHELL) + 1, len(SHELL) + 1 + len(far))
    now = cast_triangles(prior.scene, Rays(PLACE[None], more.direction[: more.measured])).element[0]
    own, now = (np.bincount(one[one >= 0], minlength=len(boxes))[rows] for one in (met.element[0], now))
    assert np.all(own > LEAST) and np.all(now >= 0.9 * own)


def test_every_element_that_rays_meet_gets_its_count(judges):
    """Small things on a wall, between the directions of the pattern, or in one voxel with what is larger."""
    rng = np.random.default_rng(3)
    wall = ((6.1, 0.0, 2.5), (0.1, 6.0, 2.5), WALL)
    edge = rng.uniform(0.004, 0.03, (40, 3))
    things = tuple(
        ((6.0 - size[0], y, z), tuple(size), FURNITURE)
        for size, y, z in zip(edge, rng.uniform(-4, 4, 40), rng.uniform(0.3, 4.0, 40), strict=True)
    )
    boxes = (*SHELL[:2], wall, *things)
    prior = prior_of_building(building_of(boxes))
    direction = OUSTER_64.directions()
    met = cast_triangles(prior.scene, Rays(PLACE[None], direction))
    back = np.isfinite(met.distance[0])
    points = (PLACE + direction[back] * met.distance[0][back, None].astype(np.float64)).astype(np.float32)
    for sensor in (OUSTER_64, None):
        looked, told = look_at(prior, rays_of_scan(PosedScan(points, PLACE, np.eye(3), sensor)), judges)
        expected = hits_of(prior.scene, PLACE, looked.rays.direction).element
        rays = np.bincount(expected[expected >= 0], minlength=len(boxes))
        assert 10 < np.sum(rays[3:] > 0) and np.sum(rays[3:] == 0) > 0
        assert np.all((told.rays.sum(axis=1) > 0) == (rays > 0)) and np.all(told.scanned[rays > 0])
