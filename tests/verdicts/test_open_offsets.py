"""Walls of which it is open how far off their places they stand, for the pose may be what is off."""

import numpy as np
import pytest

from jaxmm.deviations.deviation import faces_of
from jaxmm.deviations.pose_errors import EXACT, REGISTERED
from jaxmm.verdicts.as_built import as_built
from jaxmm.verdicts.priors import prior_of_building
from jaxmm.verdicts.settings import DetectSettings
from tests.cases.box_building import building_of
from tests.deviations.test_deviation import FREE, HALL, moved, seen
from warp_scanner.sensors.triangles import prepare

EAST = 3


def stands(by, pose_off, trust):
    """Rows of what stands within reach of its place, of a hall of which a scan shows one wall, floor and ceiling."""
    prior = prior_of_building(building_of(HALL[:FREE]))
    rays = seen(moved(prior.building.triangles, EAST, (by, 0.0, 0.0)), np.array([3.5, 0.0, 1.5]) - prior.origin, 0.003)
    ahead = (rays.direction[: rays.measured, 0] > 0.75) & (np.abs(rays.direction[: rays.measured, 1]) < 0.5)
    rays = rays._replace(
        direction=rays.direction[: rays.measured][ahead], distance=rays.distance[: rays.measured][ahead],
        measured=int(ahead.sum()), position=rays.position + np.array([pose_off, 0.0, 0.0]),
    )  # fmt: skip
    faces = faces_of(prepare(prior.building.triangles), rays, trust)
    return as_built(prior, [faces], [], lambda there, rows: [], DetectSettings()).found


@pytest.mark.parametrize(("by", "pose_off"), [(0.27, 0.06), (0.25, 0.09), (0.29, 0.08)])
def test_a_wall_that_stands_within_reach_but_for_the_pose_is_not_gone(by, pose_off):
    """As of a camera that sees one wall: by the pose that it has it stands more than 0.3 m off."""
    assert EAST in stands(by, pose_off, REGISTERED)
    assert EAST not in stands(by, pose_off, EXACT)


@pytest.mark.parametrize("by", [0.43, -0.44])
def test_a_wall_that_stands_farther_off_than_a_pose_may_be_is_another(by):
    assert EAST not in stands(by, 0.0, REGISTERED)


@pytest.mark.parametrize("wall", [EAST, EAST - 1])
@pytest.mark.parametrize("by", [0.36, 0.40, -0.36, -0.40])
def test_of_two_walls_one_of_which_moved_farther_neither_is_taken_for_near_by_the_other(wall, by):
    """In a closed room it is open which of the two moved, so that each may be in its place or far beyond."""
    prior = prior_of_building(building_of(HALL[:FREE]))
    there = moved(prior.building.triangles, wall, (by, 0.0, 0.0))
    rays = seen(there, np.array([0.5, 0.3, 1.5]) - prior.origin, 0.003)
    rays = rays._replace(position=rays.position + np.array([0.03, 0.0, 0.0]))
    faces = faces_of(prepare(prior.building.triangles), rays, REGISTERED)
    assert wall not in as_built(prior, [faces], [], lambda there, rows: [], DetectSettings()).found
