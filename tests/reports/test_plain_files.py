"""The plain files of a detection, read back by other readers: every number, every name, and nothing that runs."""

import struct

import numpy as np
import pytest
import trimesh

from jaxmm.rays.evidence import SUPPORT
from jaxmm.reports.plain_files import (
    ADDED_COLOR,
    PLAIN_FILES,
    REMOVED_COLOR,
    elements_csv,
    mismatches_csv,
    write_mismatch_points,
    write_plain,
)
from jaxmm.verdicts.mismatch_points import MARGIN, inside, mismatch_points
from jaxmm.verdicts.results import Mismatch
from tests.cases.detections import HOSTILE, named, rows_of
from tests.verdicts.test_results import random_detection

GRID = np.array([192_340.125, 444_123.375, 12.5])  # [m] a place on a national grid


def moved_to_grid(detection):
    """The same, far from the origin."""
    mismatches = tuple(one._replace(center=one.center + GRID) for one in detection.mismatches)
    drawing = detection.drawing._replace(origin=detection.drawing.origin + GRID)
    return detection._replace(mismatches=mismatches, drawing=drawing)


def test_all_files_are_there_and_no_others(removed, tmp_path):
    write_plain(tmp_path, removed)
    write_plain(tmp_path, removed)  # older files are replaced
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(PLAIN_FILES)
    assert (tmp_path / "sentences.txt").read_text().splitlines() == list(removed.sentences)


def test_doubts_stand_first_in_the_sentences_a_line_each(removed, tmp_path):
    first, *others = removed.scans
    doubted = removed._replace(scans=(first._replace(doubts=("is it of\nthis place?", "was it?")), *others))
    write_plain(tmp_path, doubted)
    lines = (tmp_path / "sentences.txt").read_text().splitlines()
    doubts, sentences = lines[: len(doubted.doubts)], lines[len(doubted.doubts) :]
    assert len(doubts) >= 2 and all(line.startswith("In doubt: ") for line in doubts)
    assert doubts[1].endswith("was it?") and sentences == list(removed.sentences)
    told = {row["in_doubt"] for row in rows_of((tmp_path / "mismatches.csv").read_bytes().decode())}
    assert told == {f"{doubts[0].removeprefix('In doubt: ')} (and {len(doubts) - 1} more: see report.md)"}


def test_whatever_was_found_can_be_written(tmp_path):
    for seed in range(30):
        detection = random_detection(seed)
        write_plain(tmp_path, detection)
        elements = (tmp_path / "elements.csv").read_bytes().decode("utf-8")
        assert len(rows_of(elements)) == len(detection.elements)
        (tmp_path / "report.md").read_bytes().decode("utf-8")


def test_the_csv_of_mismatches_says_all(removed):
    rows = rows_of(mismatches_csv(removed.mismatches))
    assert len(rows) == len(removed.mismatches) == 2
    for index, (row, one) in enumerate(zip(rows, removed.mismatches, strict=True), 1):
        center = [float(row[f"center_{axis} [m]"]) for axis in "xyz"]
        size = [float(row[f"dimension_{axis} [m]"]) for axis in "xyz"]
        np.testing.assert_allclose([*center, *size], [*one.center, *one.dimensions], atol=1e-6)
        assert (row["number"], row["element"], row["mismatch_type"]) == (str(index), one.element, "removed")
        assert float(row["observable_fraction"]) == pytest.approx(one.observable_fraction, abs=1e-6)
        assert row["measured"] == "x y z"


def test_a_moved_object_names_the_number_that_it_was():
    gone = Mismatch("pillar", "removed", np.zeros(3), np.ones(3), 0.0, 0.9, "abc")
    new = Mismatch("pillar", "added", np.ones(3), np.ones(3), 0.0, 0.9, None, 0)
    rows = rows_of(mismatches_csv([gone, new]))
    assert [row["moved_from"] for row in rows] == ["", "1"] and rows[0]["number"] == "1"


def test_what_is_not_known_is_an_empty_cell():
    (row,) = rows_of(mismatches_csv([Mismatch("wall", "added", np.full(3, np.nan), np.ones(3), np.inf, 0.5)]))
    assert [row[name] for name in ("center_x [m]", "rotation [deg]", "element", "observable_fraction")] == [""] * 4


def test_the_csv_of_elements_names_parts_and_wholes():
    whole, part, _ = named("abc")
    keys = ("a.ifc", "b"), ("", "c")
    told = [whole._replace(parts=keys, parts_gone=keys[1:]), part._replace(part_of=keys[:1])]
    first, second = rows_of(elements_csv(told))
    names = ("parts", "parts_gone", "part_of")
    assert [first[name] for name in names] == ["b of a.ifc; c", "c", ""]
    assert [second[name] for name in names] == ["", "", "b of a.ifc"]


def test_names_survive_in_the_csv_and_none_is_a_formula():
    text = elements_csv(named(HOSTILE))
    assert text.replace("two\r\nlines", "").count("\r\n") == text.replace("two\r\nlines", "").count("\n")
    for row, name in zip(rows_of(text), HOSTILE, strict=True):
        for column in ("guid", "ifc_class", "name", "storey"):
            assert row[column][0] not in "=+-@\t\r\n"
            assert row[column].removeprefix("'") == name
        assert row["rays_through"] == "1" and row["rays_unseen"] == "4" and row["next_view_x [m]"] == ""


def test_points_of_the_true_objects_are_told_apart(removed, added):
    assert (mismatch_points(removed).robot == -1).all()
    gone = removed.drawing.prior_probability > 0.5
    np.testing.assert_array_equal(mismatch_points(removed).prior >= 0, gone)
    new = added.drawing.robot_probability > 0.5
    assert new.sum() > 50
    np.testing.assert_array_equal(mismatch_points(added).robot >= 0, new)
    assert (mismatch_points(added).prior == -1).all()


def test_what_the_model_has_in_an_added_box_is_not_of_it(added):
    """The floor below a new pillar and the wall beside it lie in its box, or nearly."""
    drawing = added.drawing
    chosen = np.flatnonzero(mismatch_points(added).robot >= 0)[::2]
    evidence = drawing.robot_evidence.copy()
    evidence[chosen] = SUPPORT
    shown = mismatch_points(added._replace(drawing=drawing._replace(robot_evidence=evidence)))
    assert (shown.robot[chosen] == -1).all() and (shown.robot >= 0).any()


def test_without_elements_a_removed_box_owns_what_rays_went_through(removed):
    cloud = removed._replace(mismatches=tuple(one._replace(element=None) for one in removed.mismatches))
    expected = mismatch_points(removed).prior
    np.testing.assert_array_equal(mismatch_points(cloud).prior, expected)
    np.testing.assert_array_equal(mismatch_points(moved_to_grid(cloud)).prior, expected)


def test_a_turned_box_holds_what_its_own_axes_reach():
    rng = np.random.default_rng(0)
    for _ in range(50):
        yaw, size, center = rng.uniform(-360, 360), rng.uniform(0.2, 3, 3), rng.uniform(-5, 5, 3)
        one = Mismatch("wall", "added", center + GRID, size, yaw, 0.9)
        local = rng.uniform(-2.5, 2.5, (500, 3))
        turn = np.array([np.exp(1j * np.radians(yaw))])
        level = (local[:, 0] + 1j * local[:, 1]) * turn
        points = np.column_stack([level.real, level.imag, local[:, 2]]) + center
        within = (np.abs(local) <= size / 2 + MARGIN).all(axis=1)
        np.testing.assert_array_equal(inside(one, points, GRID), within)


def test_the_ply_loses_nothing_and_its_colours_tell_the_objects(added, tmp_path):
    path, detection = tmp_path / "points.ply", moved_to_grid(added)
    write_mismatch_points(path, detection)
    drawing, shown = detection.drawing, mismatch_points(detection)
    data = trimesh.load(path).metadata["_ply_raw"]["vertex"]["data"]
    points = np.concatenate([drawing.robot, drawing.prior]).astype(np.float64) + drawing.origin
    np.testing.assert_array_equal(np.stack([data[axis] for axis in "xyz"], axis=1), points)
    np.testing.assert_array_equal(data["scalar_side"], np.repeat([0, 1], [len(drawing.robot), len(drawing.prior)]))
    np.testing.assert_array_equal(
        data["scalar_probability"], np.concatenate([drawing.robot_probability, drawing.prior_probability])
    )
    color = np.stack([data[name] for name in ("red", "green", "blue")], axis=1)
    robot, prior = np.split(color, [len(drawing.robot)])
    np.testing.assert_array_equal((robot == ADDED_COLOR).all(axis=1), shown.robot >= 0)
    np.testing.assert_array_equal((prior == REMOVED_COLOR).all(axis=1), shown.prior >= 0)
    grey = robot[shown.robot < 0]
    assert (grey == grey[:, :1]).all()
    kinds = {kind: set(grey[drawing.robot_evidence[shown.robot < 0] == kind][:, 0]) for kind in range(4)}
    assert all(len(values) <= 1 for values in kinds.values()) and len(set().union(*kinds.values())) >= 2


def test_open3d_reads_the_same_points(removed, tmp_path):
    open3d = pytest.importorskip("open3d")
    detection = moved_to_grid(removed)
    write_mismatch_points(tmp_path / "points.ply", detection)
    cloud = open3d.io.read_point_cloud(str(tmp_path / "points.ply"))
    drawing = detection.drawing
    points = np.concatenate([drawing.robot, drawing.prior]).astype(np.float64) + drawing.origin
    np.testing.assert_array_equal(np.asarray(cloud.points), points)
    gone = (np.round(np.asarray(cloud.colors) * 255) == REMOVED_COLOR).all(axis=1)
    assert gone.sum() == (mismatch_points(detection).prior >= 0).sum() > 100


def test_the_ply_is_as_long_as_its_header_says(removed, tmp_path):
    write_mismatch_points(tmp_path / "points.ply", removed)
    header, body = (tmp_path / "points.ply").read_bytes().split(b"end_header\n", 1)
    count = len(removed.drawing.robot) + len(removed.drawing.prior)
    assert f"element vertex {count}\n".encode() in header and len(body) == count * struct.calcsize("<3f3BfB")
