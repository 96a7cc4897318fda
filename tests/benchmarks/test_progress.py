"""The table of half-built buildings: which elements count as seen, and what is counted of them."""

import numpy as np
import pytest

from benchmarks.progress import _can_be_told as can_be_told
from benchmarks.progress import table
from benchmarks.views.kept_views import KeptViews
from jaxmm.verdicts.behind_removed import filling
from jaxmm.verdicts.priors import prior_of_building
from tests.cases.box_building import building_of
from warp_scanner.scenes.scenes import DOOR, WALL
from warp_scanner.sensors.scan import Rays
from warp_scanner.sensors.sensors import OAK_D_PRO_SMALL
from warp_scanner.sensors.triangles import cast_triangles


def wall(x, y=0.0, width=3.0, semantic=WALL):
    return ((x, y, 1.5), (0.1, width, 1.5), semantic)


@pytest.mark.parametrize("gone, told", [((), [0]), ((0,), [0, 1]), ((0, 1), [0, 1, 2]), ((0, 1, 2), [])])
def test_what_the_rays_reach_or_pass_can_be_told(gone, told):
    """Three walls, one behind the other: with nothing behind it, no ray that comes back passes any."""
    prior = prior_of_building(building_of([wall(2.0), wall(3.0), wall(4.0)]))
    rays = Rays(np.array([[-1.0, 0.0, 1.5]]), OAK_D_PRO_SMALL.directions())
    stands = ~np.isin(np.arange(3), gone)
    reach = cast_triangles(prior.scene, rays, stands).distance[0]
    assert can_be_told(prior, (np.arange(3), ~stands), rays, reach) == told


def test_of_what_is_gone_nothing_can_be_told_where_something_else_stands():
    prior = prior_of_building(building_of([wall(2.0), wall(2.0), wall(4.0)]))
    rays = Rays(np.array([[-1.0, 0.0, 1.5]]), OAK_D_PRO_SMALL.directions())
    reach = cast_triangles(prior.scene, rays, np.array([False, True, True])).distance[0]
    assert can_be_told(prior, (np.arange(3), np.array([True, False, False])), rays, reach) == [1]


def test_a_door_is_gone_with_its_wall():
    building = building_of([wall(2.0), wall(4.0), ((4.0, 0, 1.0), (0.12, 0.4, 1.0), DOOR)])
    assert filling(building, np.array([False, True, False])).tolist() == [False, False, True]
    assert not filling(building, np.array([True, False, False])).any()


def test_right_open_and_wrong_are_counted_by_look(tmp_path):
    told = [("removed", "unscanned", "removed"), ("present", "present", "present"), ("removed", "present", "present")]
    views = [{"told": told, "new": 0}, {"told": [("present", "occluded", "removed")], "new": 2}]
    refused = {"refused": "why", "told": [], "new": 0}
    files = (("house_ouster-64_3", views), ("house_ouster-64_4", views), ("shed_ouster-64_3", [refused]))
    for name, of_file in files:  # the second is of another seed
        kept = KeptViews(tmp_path / f"{name}.jsonl")
        for number, one in enumerate(of_file):
            kept.add((number,), one)
    *_, one, every = table(tmp_path, 3).splitlines()
    assert one == "| ouster-64 | 3 | 1 | one look | 4 | 0.250 (1/4) | 0.500 (2/4) | 1 | 0 | - |"
    assert every == "| ouster-64 | 3 | 1 | all looks | 4 | 0.500 (2/4) | 0.000 (0/4) | 1 | 1 | 2 |"
