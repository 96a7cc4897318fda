"""PTX and PTS: every scan where its matrix takes it, from where its scanner stood; no return is no point."""

import re

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jaxmm.formats import text
from jaxmm.formats.readers import read_scans
from jaxmm.inputs import InputError

RNG = np.random.default_rng(11)
TURN = Rotation.from_euler("zyx", [40, 3, -2], degrees=True).as_matrix()
PLACE = np.array([412_345.25, 5_678_901.5, 31.25])


def rays(count=60):
    """(N, 3) in the scanner's frame; every fifth came back from nowhere."""
    points = np.round(RNG.uniform([-5, -4, -1], [5, 4, 2], (count, 3)), 4)
    points[::5] = 0.0
    return points


def ptx(points, turn=TURN, place=PLACE, matrix=None, rows=4, end=" 0.5 1 2 3"):
    """The text of one scan; `matrix` (4, 4) by rows, else that of turn and place."""
    if matrix is None:
        matrix = np.block([[turn.T, np.zeros((3, 1))], [place[None], np.ones((1, 1))]])
    lines = [str(len(points) // rows), str(rows)]
    lines += [" ".join(f"{value:.10f}" for value in row) for row in (place, *turn.T, *matrix)]
    lines += [" ".join(f"{value:g}" for value in point) + end for point in points]
    return "\n".join(lines) + "\n"


def returned(points):
    return points[points.any(axis=1)]


@pytest.mark.parametrize("end", ["", " 0.5", " 0.5 1 2 3"])
def test_every_scan_of_a_file_stands_in_the_world_with_its_pose(tmp_path, end):
    scans = [(rays(), TURN, PLACE), (rays(40), TURN.T, -PLACE)]
    (tmp_path / "a.ptx").write_text("".join(ptx(*scan, end=end) for scan in scans))
    found = read_scans(tmp_path / "a.ptx")
    assert len(found) == 2
    for scan, (points, turn, place) in zip(found, scans, strict=True):
        np.testing.assert_allclose(scan.points, returned(points) @ turn.T + place, rtol=0, atol=1e-3)
        np.testing.assert_allclose(scan.position, place, rtol=0, atol=1e-9)
        np.testing.assert_allclose(scan.rotation, turn, atol=1e-9)
        assert scan.in_world and scan.remarks == ()


def test_rays_without_a_return_are_no_points_wherever_the_scan_stands(tmp_path):
    """Were they taken along, they would lie at the scanner, or look through walls to the zero of the world."""
    points = rays()
    for turn, place in ((TURN, PLACE), (np.eye(3), np.zeros(3)), (np.eye(3), np.array([0.0, 0.0, 1.5]))):
        (tmp_path / "a.ptx").write_text(ptx(points, turn, place))
        (found,) = read_scans(tmp_path / "a.ptx")
        assert len(found.points) == len(returned(points)) < len(points)
        assert np.linalg.norm(found.points - found.position, axis=1).min() > 0.1


def test_a_matrix_by_columns_is_the_same(tmp_path):
    points = rays()
    matrix = np.block([[TURN, PLACE[:, None]], [np.zeros((1, 3)), np.ones((1, 1))]])
    (tmp_path / "a.ptx").write_text(ptx(points, matrix=matrix))
    (found,) = read_scans(tmp_path / "a.ptx")
    np.testing.assert_allclose(found.points, returned(points) @ TURN.T + PLACE, rtol=0, atol=1e-3)
    np.testing.assert_allclose(found.position, PLACE)


def test_points_in_the_world_already_keep_the_pose_of_their_scanner(tmp_path):
    points = returned(rays()) @ TURN.T + [3, -2, 1.5]
    (tmp_path / "a.ptx").write_text(ptx(points, TURN, np.array([3, -2, 1.5]), np.eye(4)))
    (found,) = read_scans(tmp_path / "a.ptx")
    np.testing.assert_allclose(found.points, points, atol=1e-4)
    np.testing.assert_allclose(found.position, [3, -2, 1.5])
    np.testing.assert_allclose(found.rotation, TURN, atol=1e-9)


def test_a_position_left_at_zero_is_that_of_the_matrix(tmp_path):
    matrix = np.block([[TURN.T, np.zeros((3, 1))], [PLACE[None], np.ones((1, 1))]])
    (tmp_path / "a.ptx").write_text(ptx(rays(), np.eye(3), np.zeros(3), matrix))
    (found,) = read_scans(tmp_path / "a.ptx")
    np.testing.assert_allclose(found.position, PLACE)
    np.testing.assert_allclose(found.rotation, TURN, atol=1e-9)


@pytest.mark.parametrize("away, posed", [((0, 0, 0), True), ((637_000, 849_000, 400), False)])
def test_a_header_that_says_nothing_tells_a_pose_only_to_what_lies_around_it(tmp_path, away, posed):
    (tmp_path / "a.ptx").write_text(ptx(returned(rays()) + away, np.eye(3), np.zeros(3)))
    (found,) = read_scans(tmp_path / "a.ptx")
    assert (found.position is not None) == posed


@pytest.mark.parametrize(
    "place, matrix, told",
    [
        (
            np.array([1.0, 2.0, 3.0]),
            np.block([[TURN.T, np.zeros((3, 1))], [PLACE[None], np.ones((1, 1))]]),
            "two places",
        ),
        (np.zeros(3), np.diag([1.0, 1.0, 2.0, 1.0]), "no rotation and shift"),
    ],
)
def test_what_contradicts_itself_is_read_without_a_pose(tmp_path, place, matrix, told):
    points = rays()
    (tmp_path / "a.ptx").write_text(ptx(points, np.eye(3), place, matrix))
    (found,) = read_scans(tmp_path / "a.ptx")
    assert found.position is None and found.rotation is None and told in found.remarks[0]
    np.testing.assert_allclose(found.points, returned(points) @ matrix[:3, :3] + matrix[3, :3], rtol=0, atol=1e-3)


def test_scans_in_which_nothing_came_back_are_left_out_beside_others(tmp_path):
    (tmp_path / "a.ptx").write_text(ptx(np.zeros((8, 3))) + ptx(rays()) + ptx(np.zeros((0, 3))))
    (found,) = read_scans(tmp_path / "a.ptx")
    assert found.remarks == ("2 of 3 scans hold no points and are left out",)
    (tmp_path / "a.ptx").write_text(ptx(np.zeros((8, 3))))
    with pytest.raises(InputError, match="got none among 0"):
        read_scans(tmp_path / "a.ptx")


@pytest.mark.parametrize(
    "before, after, why",
    [
        ("15\n", "x\n", "line 1: expected the number of columns of scan 1, got 'x'"),
        ("15\n4\n", "15\n-4\n", "line 2: expected the number of rows of scan 1, got '-4'"),
        ("15\n4\n", "15\n4.5\n", "line 2: expected the number of rows of scan 1, got '4.5'"),
        ("15\n", "1500000000\n", "scan 1: expected rays that fit into its"),
        ("15\n", "16\n", "truncated: expected 64 rays of scan 1 as its header promises, found 60"),
        ("15\n", "14\n", "line 67: expected the number of columns of scan 2, got"),
        ("1.0000000000\n0 0 0", "nan\n0 0 0", "line 10: expected row 4 of a 4x4 matrix of scan 1"),
        ("1.0000000000\n0 0 0", "2\n0 0 0", "scan 1: expected a 4x4 matrix with 0 0 0 1"),
        ("0 0 0 0.5", "0 0 a 0.5", "scan 1: expected 60 lines of x y z and more from line 11 on: could not convert"),
        ("0 0 0 0.5", "0 0", "scan 1: expected 60 lines of x y z and more from line 11 on: "),
    ],
)
def test_damage_is_told_with_its_line(tmp_path, before, after, why):
    made = ptx(rays(), end=" 0.5")
    assert before in made
    (tmp_path / "a.ptx").write_text(made.replace(before, after, 1))
    with pytest.raises(InputError, match=re.escape(f"a.ptx: {why}")) as told:
        read_scans(tmp_path / "a.ptx")
    assert "\n" not in str(told.value)


@pytest.mark.parametrize("left", ["1.5", "1.5 -", "1.5 2.5", "1.5 2.5 -", "1.5 2.5 3e"])
@pytest.mark.parametrize("whole", [30, 59])
def test_a_file_that_ends_inside_a_line_is_truncated(tmp_path, whole, left):
    lines = ptx(rays(), end=" 0.5").splitlines(keepends=True)
    (tmp_path / "a.ptx").write_text("".join(lines[: 10 + whole]) + left)
    with pytest.raises(InputError, match=r"truncated: expected 60 rays.*ends inside a line: '1.5"):
        read_scans(tmp_path / "a.ptx")


def test_damage_of_a_file_without_a_last_line_end_is_no_cut(tmp_path):
    made = ptx(rays(), end=" 0.5").rstrip("\n").replace("0 0 0 0.5", "0 0 a 0.5", 1)
    (tmp_path / "a.ptx").write_text(made)
    with pytest.raises(InputError, match="expected 60 lines of x y z"):
        read_scans(tmp_path / "a.ptx")


POINTS = np.round(RNG.uniform([-5, -4, 0], [5, 4, 3], (30, 3)), 4)


@pytest.mark.parametrize("width", [0, 1, 4, 7])
@pytest.mark.parametrize("counted", [True, False])
@pytest.mark.parametrize("block", [7, 1 << 19])
def test_pts_may_hold_any_columns_and_the_number_of_its_points(tmp_path, monkeypatch, width, counted, block):
    monkeypatch.setattr(text, "BLOCK", block)
    body = "".join(" ".join(map(str, [*point, *range(-width, 0)])) + "\n" for point in POINTS)
    (tmp_path / "a.pts").write_text(f"{len(POINTS)}\n{body}" if counted else body)
    (found,) = read_scans(tmp_path / "a.pts")
    np.testing.assert_array_equal(found.points, POINTS)


@pytest.mark.parametrize("between", ["", "\n\n"])
def test_pts_may_hold_several_scans(tmp_path, between):
    lines = ["{} {} {} -1000\n".format(*point) for point in POINTS]
    body = "20\n" + between.join(lines[:20]) + between + "10\n" + "".join(lines[20:])
    (tmp_path / "a.pts").write_text(body)
    found = read_scans(tmp_path / "a.pts")
    assert [len(scan.points) for scan in found] == [20, 10]
    np.testing.assert_array_equal(np.concatenate([scan.points for scan in found]), POINTS)
    (tmp_path / "a.pts").write_text(body.replace("10\n", "11\n", 1))
    with pytest.raises(InputError, match="truncated: expected 11 points as it says itself, found 10"):
        read_scans(tmp_path / "a.pts")


def test_a_number_that_is_too_small_loses_no_point(tmp_path):
    (tmp_path / "a.pts").write_text("8\n" + "".join("{} {} {}\n".format(*point) for point in POINTS))
    np.testing.assert_array_equal(read_scans(tmp_path / "a.pts")[0].points, POINTS)


@pytest.mark.parametrize("ending", [".xyz", ".npy"])
def test_several_points_at_zero_are_rays_without_a_return(tmp_path, ending):
    """From a pose elsewhere in the world they would look through all that stands before its zero."""
    path, points = tmp_path / f"a{ending}", POINTS.copy()
    points[3:6] = 0.0
    np.save(path, points) if ending == ".npy" else np.savetxt(path, points)
    (found,) = read_scans(path)
    np.testing.assert_array_equal(found.points, np.delete(points, [3, 4, 5], axis=0))
    assert found.remarks == ("3 of 30 points are at 0, 0, 0, where nothing came back, and are left out",)
    points[4:6] = 1.0  # one may be measured
    np.save(path, points) if ending == ".npy" else np.savetxt(path, points)
    assert len(read_scans(path)[0].points) == 30


def test_files_of_others(data_root):
    folder = data_root / "formats"
    assert [len(scan.points) for scan in read_scans(folder / "ptx" / "multiple-and-transform.ptx")] == [4, 4]
    (found,) = read_scans(folder / "ptx" / "complex-transform.ptx")
    assert len(found.points) == 4 and found.position is not None
    assert [len(read_scans(path)[0].points) for path in sorted((folder / "pts").iterdir())] == [10, 9, 8, 19]
