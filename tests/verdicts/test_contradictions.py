"""A place that a scan was not taken from shows by rays that pass through what the scan itself shows to stand."""

import dataclasses

import numpy as np
import pytest
import trimesh

from jaxmm.learning.prediction import read_judges
from jaxmm.runs.room_scans import room_cases
from jaxmm.verdicts.contradictions import MOST_CONTRADICTED, contradicted
from jaxmm.verdicts.detection import detect_scans
from jaxmm.verdicts.named_scans import NamedScan
from jaxmm.verdicts.priors import prior_of_building
from jaxmm.verdicts.settings import DetectSettings
from jaxmm.weights import DEFAULT
from tests.cases.box_building import building_of, scan_of
from warp_scanner.scenes.scenes import CEILING, DOOR, FLOOR, TABLE, WALL
from warp_scanner.sensors.sensors import OAK_D_PRO_SMALL, OUSTER_64, VELODYNE_16
from warp_scanner.sensors.triangles import prepare

SHELL = (
    ((0, 0, -0.1), (8, 4, 0.1), FLOOR), ((0, 0, 2.7), (8, 4, 0.1), CEILING),
    ((0, -3.9, 1.3), (8, 0.1, 1.3), WALL), ((0, 3.9, 1.3), (8, 0.1, 1.3), WALL),
    ((-7.9, 0, 1.3), (0.1, 3.8, 1.3), WALL), ((7.9, 0, 1.3), (0.1, 3.8, 1.3), WALL),
)  # fmt: skip
BESIDE_A_DOORWAY = (((2, -2.4, 1.3), (0.1, 1.4, 1.3), WALL), ((2, 2.4, 1.3), (0.1, 1.4, 1.3), WALL))  # 2 m wide
PLACE = np.array([-3.0, 0.2, 1.5])  # it looks along x
ASIDE, OUTSIDE = np.array([0.0, 2.5, 0.0]), np.array([12.0, 0.0, 0.0])  # of where it was
SENSOR = dataclasses.replace(OAK_D_PRO_SMALL, width=160, height=100)


def share(model, real, aside, sensor=SENSOR, fine=0, noise=0.0):
    """Of a scan of what is real that is believed to be taken from some way aside [m] of where it was.

    Each triangle of the model is split into four `fine` times; ranges have a normal error of `noise` [m].
    """
    scan, triangles = scan_of(real, PLACE, sensor).scan, building_of(model).triangles
    offset = scan.points - PLACE
    longer = (
        1.0 + np.random.default_rng(0).normal(0.0, noise, (len(offset), 1)) / np.linalg.norm(offset, axis=1)[:, None]
    )
    for _ in range(fine):
        vertices, faces = trimesh.remesh.subdivide(triangles.vertices, triangles.faces)
        triangles = triangles._replace(vertices=vertices, faces=faces, element=np.repeat(triangles.element, 4))
    believed = scan._replace(points=(PLACE + offset * longer).astype(np.float32), position=PLACE + aside)
    return contradicted(prepare(triangles), believed)


@pytest.mark.parametrize("sensor", [SENSOR, VELODYNE_16, OUSTER_64], ids=["camera", "16 rings", "64 rings"])
def test_rays_through_a_wall_that_the_scan_shows_are_of_another_place(sensor):
    house = (*SHELL, *BESIDE_A_DOORWAY)
    assert share(house, house, np.zeros(3), sensor) == 0.0
    assert share(house, house, ASIDE, sensor) > MOST_CONTRADICTED
    assert share(house, house, OUTSIDE, sensor) > MOST_CONTRADICTED  # points are on the far side of a wall


@pytest.mark.parametrize("left", [(), BESIDE_A_DOORWAY[:1], BESIDE_A_DOORWAY[1:]], ids=["neither", "first", "second"])
def test_rays_through_a_wall_that_is_gone_contradict_nothing(left):
    assert share((*SHELL, *BESIDE_A_DOORWAY), (*SHELL, *left), np.zeros(3)) == 0.0


def test_rays_to_a_wall_that_stands_a_little_behind_its_place_contradict_nothing():
    """Seen askew, rays to it pass through where it should be, amid what lies 0.15 m off that."""
    (x, y, z), half, kind = SHELL[3]
    built = (*SHELL[:3], ((x, y + 0.15, z), half, kind), *SHELL[4:])
    for fine in (0, 3):
        assert share(SHELL, built, np.zeros(3), OUSTER_64, fine=fine) == 0.0


@pytest.mark.parametrize("noise", [0.0, 0.003, 0.01])
def test_neither_noise_nor_how_fine_a_mesh_is_changes_much(noise):
    house = (*SHELL, *BESIDE_A_DOORWAY)
    for aside in (ASIDE, OUTSIDE):
        coarse, fine = (share(house, house, aside, OUSTER_64, fine=times, noise=noise) for times in (0, 3))
        assert coarse == pytest.approx(fine, rel=0.02) and coarse > MOST_CONTRADICTED
    assert share(house, house, np.zeros(3), OUSTER_64, noise=noise) < MOST_CONTRADICTED / 10


def test_a_stray_point_far_away_is_no_matter():
    house = (*SHELL, *BESIDE_A_DOORWAY)
    scene, scan = prepare(building_of(house).triangles), scan_of(house, PLACE, SENSOR).scan
    far = scan._replace(points=np.concatenate([scan.points, [[1.2e5, 0.0, 0.0]]]).astype(np.float32))
    assert contradicted(scene, far) < MOST_CONTRADICTED / 10
    assert contradicted(scene, far._replace(points=far.points[-1:])) == 0.0


def test_rays_that_meet_nothing_of_the_model_contradict_nothing():
    house, beside = SHELL[:1], ((0, 9, 1.3), (9, 0.1, 3.0), WALL)  # a floor, and what is new stands beside it
    assert share(house, (*house, beside), np.zeros(3), VELODYNE_16) == 0.0
    assert share((*SHELL[2:], beside), (beside,), np.zeros(3), VELODYNE_16) == 0.0  # its rays pass what is gone


def test_what_is_full_of_holes_contradicts_nothing():
    """A railing that the model has as a plate: bars of 4 cm, one every 12 cm, and the floor seen between them."""
    plate = ((0, 0, 0.6), (0.02, 3.8, 0.6), TABLE)
    bars = tuple(((0, y, 0.6), (0.02, 0.02, 0.6), TABLE) for y in np.arange(-3.6, 3.61, 0.12))
    assert share((*SHELL, plate), (*SHELL, *bars), np.zeros(3)) == 0.0
    as_walls = (*SHELL, (*plate[:2], WALL)), (*SHELL, *bars)
    assert share(*as_walls, np.zeros(3)) > 0.0  # which is why only what has no holes is asked


def test_glass_that_returns_some_rays_contradicts_nothing():
    pane = ((2, 0, 1.3), (0.02, 1.0, 1.3), DOOR)
    house = (*SHELL, *BESIDE_A_DOORWAY, pane)
    through, on = (scan_of(real, PLACE, SENSOR).scan for real in (house[:-1], house))
    half = np.arange(len(through.points)) % 2 == 0
    scan = through._replace(points=np.concatenate([through.points[half], on.points[::2]]))
    assert contradicted(prepare(building_of(house).triangles), scan) == 0.0


@pytest.mark.parametrize("change", ["wall_removed", "pillar_added", "wall_added"])
def test_right_places_in_furnished_rooms_are_contradicted_by_next_to_nothing(change):
    found = [contradicted(case.prior.scene, case.scan) for case in room_cases(change, "occluded", 21, range(12))]
    assert max(found) < MOST_CONTRADICTED / 10


def test_a_contradicted_place_is_doubted_and_a_right_one_is_not():
    house, judges = (*SHELL, *BESIDE_A_DOORWAY), read_judges(DEFAULT)
    scan = scan_of(house, PLACE, SENSOR).scan._replace(sensor=None)
    for aside, doubted in ((np.zeros(3), False), (ASIDE, True)):
        one = NamedScan(scan._replace(position=PLACE + aside), "scan", len(scan.points), "given")
        (record,) = detect_scans(prior_of_building(building_of(house)), [one], judges, DetectSettings()).scans
        assert any("would pass through what its own points show" in told for told in record.doubts) == doubted
