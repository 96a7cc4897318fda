"""What moved, out of maps of many scans: their measures by hand, and rooms in which somebody walks."""

import numpy as np
import pytest

from benchmarks.dynamic_maps import MAP, as_evaluated, is_dynamic, read_map, scans_of, scores, votes
from benchmarks.views.moving_rooms import write_pcd, write_rooms
from jaxmm.inputs import InputError


def test_their_measures_of_a_case_by_hand():
    truth = np.array([True] * 4 + [False] * 10)
    found = np.array([True, True, True, False] + [False] * 9 + [True])
    told = scores(found, truth)
    assert (told.sa, told.da) == (90.0, 75.0)
    assert told.aa == pytest.approx(np.sqrt(90.0 * 75.0)) and told.ha == pytest.approx(2 * 90 * 75 / 165)
    assert scores(np.zeros(14, bool), truth).ha == 0.0  # nothing found: no dynamic accuracy, no accuracy


def test_a_point_beside_what_is_left_of_the_map_counts_as_static():
    points = np.array([[0.0, 0.0, 0.0], [0.04, 0.0, 0.0], [0.2, 0.0, 0.0]])
    assert as_evaluated(points, np.array([False, True, True])).tolist() == [False, False, True]
    assert as_evaluated(points, np.ones(3, bool)).all()


def test_a_point_is_dynamic_where_enough_scans_pass_through_it():
    passed, ended = np.array([0, 1, 2, 2, 9]), np.array([9, 0, 0, 8, 9])
    assert is_dynamic(passed, ended).tolist() == [False, False, True, False, True]


def test_what_stands_behind_is_passed_by_none_and_what_is_gone_by_all(tmp_path):
    """A wall, seen by four scans; before it stood a board in the first of them."""
    y, z = (axis.ravel() for axis in np.meshgrid(np.arange(-1.0, 1.0, 0.02), np.arange(-1.0, 1.0, 0.02)))
    wall = np.column_stack([np.full_like(y, 4.0), y, z])
    board = wall[(abs(y) < 0.3) & (abs(z) < 0.3)] * 0.5
    hidden = np.abs(wall[:, 1:]).max(axis=1) < 0.6
    scans = [(np.concatenate([wall[~hidden], board]), np.zeros(3)), *[(wall, np.zeros(3))] * 3]
    points = np.concatenate([wall, board])
    passed, ended, count = votes(points, iter(scans))
    assert count == 4 and passed[: len(wall)].max() == 0 and ended[: len(wall)].min() >= 3
    inner = np.abs(board[:, 1:]).max(axis=1) < 0.1
    assert set(passed[len(wall) :][inner]) == {3} and set(ended[len(wall) :][inner]) == {1}
    assert np.array_equal(is_dynamic(passed, ended)[: len(wall)], np.zeros(len(wall), bool))


def test_somebody_who_walks_and_a_box_that_goes_are_found_in_a_generated_room(tmp_path):
    (folder,) = write_rooms(tmp_path, 1, 6, "velodyne-16-real", 42)
    points, truth = read_map(folder / MAP)
    scans = list(scans_of(folder))
    assert len(scans) == 6 and len({tuple(sensor) for _, sensor in scans}) == 6
    low, high = points.min(axis=0) - 0.06, points.max(axis=0) + 0.06
    assert all(np.all((scan > low) & (scan < high)) for scan, _ in scans)  # all in the frame of the map
    passed, ended, _ = votes(points, iter(scans))
    found = scores(as_evaluated(points, is_dynamic(passed, ended)), truth)
    assert truth.any() and found.sa > 95.0 and found.da > 80.0


@pytest.mark.parametrize("intensity, word", [(np.zeros(3), "intensities"), (np.array([0.0, 1.0, 2.0]), "intensities")])
def test_a_map_without_ground_truth_is_one_line(tmp_path, intensity, word):
    with pytest.raises(InputError, match="found none"):
        read_map(tmp_path / MAP)
    write_pcd(tmp_path / MAP, np.eye(3), intensity, None)
    with pytest.raises(InputError, match=word):
        read_map(tmp_path / MAP)
    (tmp_path / MAP).write_text("no points")
    with pytest.raises(InputError, match="PCD") as error:
        read_map(tmp_path / MAP)
    assert "\n" not in str(error.value)
    with pytest.raises(InputError, match="expected PCD files, found none"):
        next(scans_of(tmp_path))
