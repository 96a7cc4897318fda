"""The table of building files: what is counted of views, and when a missing element counts as found."""

from types import SimpleNamespace

import numpy as np

from benchmarks.buildings import _by_type as by_type
from benchmarks.buildings import _case as case_of
from benchmarks.buildings import _counts as counts
from benchmarks.buildings import _held as held
from benchmarks.buildings import _is_whole as is_whole
from benchmarks.buildings import _types as types
from benchmarks.buildings import _view as view_of
from benchmarks.buildings import table
from jaxmm.config import SCENARIOS
from jaxmm.files import write_json
from jaxmm.learning.prediction import read_judges
from jaxmm.verdicts.priors import prior_of_building
from jaxmm.verdicts.results import Mismatch, box_of
from jaxmm.weights import DEFAULT
from tests.cases.box_building import building_of
from warp_scanner.buildings.pairs import MISSING
from warp_scanner.scenes.scenes import CEILING, FLOOR, WALL
from warp_scanner.sensors.sensors import OAK_D_PRO_SMALL

ALONG = np.column_stack([np.linspace(0.05, 9.95, 100), np.zeros(100), np.ones(100)])  # points of a wall of 10 m


def seen(new=100, shows=100):
    """A scan of ALONG, the first rays of which are new, and the first of those show what is missing."""
    rays = np.arange(100)[None]
    pairs = SimpleNamespace(
        robot=SimpleNamespace(distance=np.ones((1, 100))), testable_robot=rays < new, changed_robot=rays < shows
    )
    return pairs, SimpleNamespace(points=ALONG)


def box(start, end):
    return Mismatch("wall", "added", np.array([(start + end) / 2, 0, 1]), np.array([end - start, 0.2, 2.0]), 0.0, 0.9)


def test_boxes_hold_a_missing_wall_together_and_one_on_something_else_is_false():
    zero = np.zeros(3)
    assert held([box(0, 5)], *seen(), zero) == (1, 1)
    assert held([box(0, 3)], *seen(), zero) == (0, 1)  # right, but it tells of too little
    assert held([box(0, 3), box(5, 8)], *seen(), zero) == (1, 2)
    assert held([box(0, 4), box(6, 10)], *seen(shows=50), zero) == (1, 1)
    assert held([box(20, 25)], *seen(), zero) == (0, 0) and held([], *seen(), zero) == (0, 0)
    far = np.array([1e6, 0.0, 0.0])
    there = [one._replace(center=one.center + far) for one in [box(0, 6)]]
    assert held(there, *seen(), far) == (1, 1)


def test_views_are_counted_by_change_and_by_how_much_they_show(tmp_path):
    def view(scenario, shown, found, false, alike=(), verdict=None):
        counted = {"found": found, "false": false, "alike": list(alike), "verdict": verdict}
        return {"scenario": scenario, "shown": shown} | counted

    views = [
        view("wall_added", 0.9, 1, 0), view("wall_added", 0.9, 1, 1), view("wall_removed", 0.1, 0, 0),
        view("wall_removed", 0.1, 0, 2), view("wall_removed", 0.1, 0, 0, verdict="present"),
        {"scenario": "pillar_added", "shown": 0.5, "refused": "why"},
        view("wall_missing", 0.6, 1, 0), view("pillar_missing", 0.7, 0, 0, ["wall"]),
    ]  # fmt: skip
    assert counts(views, SCENARIOS) == [6, 1, 2, 1, 2, 1, 3, 1, 3]
    assert counts(views, MISSING) == [2, 0, 2, 1, 1, 1, 0, 0, 0]
    write_json(tmp_path / "house_occluded_3.json", {"views": views, "loading": 1.0, "seconds": {"warm": 0.5}})
    write_json(tmp_path / "house_occluded_4.json", {"views": [], "loading": 1.0, "seconds": {}})
    rows = [line for line in table(tmp_path, "occluded", 3).splitlines() if line.startswith("| house")]
    assert rows[0].startswith("| house | 6 | 1 | 2 | 1 | 2 | 1 | 3 | 1 | 3 | 1.0 | 0.50 |")
    assert rows[1] == "| house | 2 | 0 | 2 | 1 | 1 | 1 | 0 | 0 | 0 |"


def test_a_file_of_an_earlier_table_is_made_again(tmp_path):
    path = tmp_path / "house_occluded_3.json"
    assert not is_whole(path)
    write_json(path, {"views": [{"types": []}, {"scenario": "wall_added"}]})
    assert not is_whole(path)
    write_json(path, {"views": [{"types": []}, {"refused": "why"}]})
    assert is_whole(path)


def test_a_building_far_from_the_origin_of_its_grid_has_the_same_views():
    shell = [((0, 0, -0.1), (5, 5, 0.1), FLOOR), ((0, 0, 3.1), (5, 5, 0.1), CEILING)]
    shell += [((side * 5.1, 0, 1.5), (0.1, 5.2, 1.5), WALL) for side in (-1, 1)]
    shell += [((0, side * 5.1, 1.5), (5.2, 0.1, 1.5), WALL) for side in (-1, 1)]
    near = building_of([tuple(np.array(part, float) for part in one[:2]) + one[2:] for one in shell])
    judges, seen = read_judges(DEFAULT), []
    for building in (near, near._replace(origin=np.array([3e5, 5.2e6, 100.0]))):
        prior = prior_of_building(building)
        case = case_of(prior, ("pillar_added", "clean", 29, 1), OAK_D_PRO_SMALL)
        seen.append(view_of(prior, judges, "pillar_added", *case))
    assert seen[0]["found"] == 1 and seen[0]["types"][0][1]
    assert {**seen[0], "sentences": None} == {**seen[1], "sentences": None}


def test_types_are_told_together_by_how_probable_they_are_called():
    lines = by_type([(0.6, True), (0.7, False), (0.99, True), (1.0, True)])
    assert lines[2:] == ["| from 0.5 on | 2 | 0.650 | 0.500 |", "| from 0.99 on | 2 | 0.995 | 1.000 |"]
    there = box(0, 2)._replace(type_probability=0.8)
    wrong = there._replace(object_type="pillar", type_probability=0.6)
    beside = box(0, 2)._replace(center=np.array([1.0, 3.0, 1.0]))
    assert types([there, wrong, beside], box_of(box(0, 2))) == [(0.8, True), (0.6, False)]
