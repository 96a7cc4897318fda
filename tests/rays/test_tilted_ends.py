"""What ends on another surface where an element should be is no support; what ends on the element is, at edges too."""

import numpy as np
import pytest

from jaxmm.rays.evidence import BLOCKED, SUPPORT, THROUGH, margins
from jaxmm.rays.hits import hits_of
from jaxmm.rays.scan_rays import PosedScan, rays_of_scan
from jaxmm.rays.tilted_ends import Met, tilted_ends
from jaxmm.verdicts.building_evidence import sight
from jaxmm.verdicts.priors import prior_of_building
from tests.cases.box_building import building_of, shell_of
from warp_scanner.scenes.scenes import PILLAR, TABLE, WALL
from warp_scanner.sensors.scan import Rays
from warp_scanner.sensors.sensors import OAK_D_PRO_SMALL, OUSTER_64, VELODYNE_16
from warp_scanner.sensors.triangles import cast_triangles, prepare

ROOM = shell_of(6.0, 4.0, 3.0)
PARTITION = ((3.0, 0.0, 1.5), (0.1, 3.0, 1.5), WALL)  # element 6, its near face at x = 2.9
PLACE = np.array([-1.0, 0.3, 1.4])
SENSORS = pytest.mark.parametrize("sensor", [OAK_D_PRO_SMALL, OUSTER_64, VELODYNE_16], ids=["camera", "rings", "few"])


def met_in(model, reality, sensor=OAK_D_PRO_SMALL, noise=0.0):
    """Directions, and what they meet, where boxes are modelled and others are there."""
    direction = sensor.directions()
    expected = hits_of(prepare(building_of(model).triangles), PLACE, direction)
    distance = cast_triangles(prepare(building_of(reality).triangles), Rays(PLACE[None], direction)).distance[0]
    distance = distance + noise * np.random.default_rng(0).standard_normal(len(distance)).astype(np.float32)
    margin, sigma = margins(expected.cosine, noise), np.full(len(distance), noise)
    return direction, Met(distance, expected.distance, expected.element, expected.normal, margin, sigma)


def supports(met, element=6):
    with np.errstate(invalid="ignore"):
        return (met.element == element) & (np.abs(met.distance - met.expected) <= met.margin)


@SENSORS
@pytest.mark.parametrize("noise", [0.0, 0.005, 0.02])
def test_all_that_stands_supports_itself(sensor, noise):
    """Along the edges to floor, ceiling and other walls, and on slender columns, too."""
    column = ((1.5, 1.0, 1.5), (0.1, 0.1, 1.5), PILLAR)
    direction, met = met_in((*ROOM, PARTITION, column), (*ROOM, PARTITION, column), sensor, noise)
    assert tilted_ends(direction, met).sum() <= (0 if noise == 0.0 else 1e-3 * len(direction))


@pytest.mark.parametrize("off", [-0.02, 0.01, 0.02])
def test_what_was_built_a_little_off_its_place_supports_itself(off):
    moved = (np.add(PARTITION[0], (off, 0.0, 0.0)), *PARTITION[1:])
    direction, met = met_in((*ROOM, PARTITION), (*ROOM, moved))
    tilted = tilted_ends(direction, met)
    assert not tilted[supports(met)].any()


def test_the_floor_beyond_a_gone_wall_is_no_support_of_it():
    direction, met = met_in((*ROOM, PARTITION), ROOM)
    support, tilted = supports(met), tilted_ends(direction, met)
    assert support.sum() > 20 and tilted[support].mean() > 0.9
    assert not tilted[~support].any()


def _cabinet(across):
    """One that stands across the place of the wall; one of its sides, seen from the sensor, cuts through it."""
    return (3.0, -across, 0.9), (0.4, 0.3, 0.9), TABLE


@pytest.mark.parametrize("sensor", [OAK_D_PRO_SMALL, OUSTER_64], ids=["camera", "rings"])
def test_the_side_of_a_cabinet_in_a_gone_walls_place_is_no_support_of_it(sensor):
    direction, met = met_in((*ROOM, PARTITION), (*ROOM, _cabinet(2.0)), sensor)
    support, tilted = supports(met), tilted_ends(direction, met)
    assert support.sum() > 10 and tilted[support].mean() > 0.6


def _plane_met(angle, noise=0.0, sensor=OAK_D_PRO_SMALL, told=None):
    """Rays that should meet an upright plane 3 m ahead, and end on one turned by an angle [deg] about their axis.

    Of the noise [m] as much is told.
    """
    direction = sensor.directions()
    turn = np.radians(angle)
    expected = (3.0 / direction[:, 0]).astype(np.float32)
    distance = 3.0 * np.cos(turn) / (direction @ [np.cos(turn), np.sin(turn), 0.0])
    distance = np.where((distance > 0.3) & (distance < 30.0), distance, np.inf)
    distance = distance + noise * np.random.default_rng(1).standard_normal(len(distance))
    normal, flat = np.tile(np.float32([1.0, 0.0, 0.0]), (len(expected), 1)), np.zeros(len(expected), np.int32)
    margin, sigma = margins(direction[:, 0], noise), np.full(len(expected), noise if told is None else told)
    met = Met(distance.astype(np.float32), expected, flat, normal, margin, sigma)
    return supports(met, 0), tilted_ends(direction, met)


COARSE = OAK_D_PRO_SMALL.resampled(81, 51)  # of which one column ends on the axis


@pytest.mark.parametrize("sensor, noise", [(OAK_D_PRO_SMALL, 0.0), (OAK_D_PRO_SMALL, 0.003), (COARSE, 0.0)])
@pytest.mark.parametrize("angle, is_tilted", [(0, False), (10, False), (30, False), (50, True), (70, True)])
def test_only_what_lies_clearly_otherwise_is_tilted(angle, is_tilted, sensor, noise):
    support, tilted = _plane_met(angle, noise, sensor)
    assert support.sum() > 20
    assert not tilted[~support].any()
    assert np.mean(tilted[support]) > 0.9 if is_tilted else not tilted[support].any()


def test_where_ranges_err_by_more_than_neighbours_are_apart_nothing_is_sure():
    _, tilted = _plane_met(70, noise=0.05)
    assert not tilted.any()


def test_of_one_line_of_rays_nothing_is_sure():
    support, tilted = _plane_met(70, sensor=OAK_D_PRO_SMALL.resampled(321, 1))
    assert support.any() and not tilted.any()


def test_leaves_lie_in_no_way():
    support, tilted = _plane_met(0, noise=0.05, told=0.0)
    assert support.sum() > 1000 and not tilted.any()


@pytest.mark.parametrize("high", [0.03, 0.06, 0.1])
def test_a_kerb_supports_itself_though_most_around_is_floor(high):
    kerb = ((3.0, 0.0, high / 2), (0.1, 3.0, high / 2), WALL)
    direction, met = met_in((*ROOM, kerb), (*ROOM, kerb))
    assert supports(met).sum() > 50 and not tilted_ends(direction, met).any()


def test_where_too_few_rays_come_back_none_is_tilted():
    direction, met = met_in((*ROOM, PARTITION), ROOM)
    few = np.arange(len(direction)) % 7000 == 0
    assert not tilted_ends(direction, met._replace(distance=np.where(few, met.distance, np.inf))).any()


def test_of_a_gone_wall_a_cabinet_in_its_place_blocks_and_does_not_support():
    reality, prior = (*ROOM, _cabinet(2.0)), prior_of_building(building_of((*ROOM, PARTITION)))
    direction = OUSTER_64.directions()
    distance = cast_triangles(prepare(building_of(reality).triangles), Rays(PLACE[None], direction)).distance[0]
    scan = PosedScan((PLACE + direction * distance[:, None]).astype(np.float32), PLACE, np.eye(3), OUSTER_64)
    seen = sight(prior, rays_of_scan(scan)).prior
    through, support, blocked = seen.count[seen.element == 6].sum(axis=0)[[THROUGH, SUPPORT, BLOCKED]]
    assert through > 1000 and blocked > 100
    assert support < 5e-3 * through
