"""A whole in pieces moves as one body: how it is turned no piece tells by itself."""

import itertools

import numpy as np
import pytest

from jaxmm.deviations.deviation import deviations_by, faces_of
from jaxmm.deviations.pose_errors import EXACT, REGISTERED
from jaxmm.deviations.wholes import deviations_of_wholes
from tests.cases.box_building import building_of
from tests.deviations.test_deviation import HALL, seen
from warp_scanner.scenes.building_edits import move_element
from warp_scanner.scenes.scenes import WALL
from warp_scanner.sensors.triangles import prepare

# The free wall of the hall, end to end, of unequal lengths: its middle is in none of theirs.
ENDS = (-2.0, -0.9, 0.1, 2.0)
PIECES = tuple(((3.0, (a + b) / 2.0, 1.5), (0.1, (b - a) / 2.0, 1.5), WALL) for a, b in itertools.pairwise(ENDS))
ROWS = [6, 7, 8]
MODEL = building_of((*HALL[:6], *PIECES)).triangles
MIDDLE = np.array([3.0, 0.0, 1.5])


def as_one(real, trust=EXACT, tolerance=0.03, noise=0.0):
    scene = prepare(MODEL)
    shown = [faces_of(scene, seen(real, noise=noise), trust)]
    pieces = deviations_by(scene, shown, np.full(len(MODEL.semantic), tolerance))
    return deviations_of_wholes(scene, shown, {"whole": (ROWS, tolerance)}, pieces)["whole"], pieces


def turned(step, turn, rows=ROWS):
    real = MODEL
    for row in rows:
        real = move_element(real, row, np.array(step), np.radians(turn), MIDDLE)
    return real


@pytest.mark.parametrize("trust", [EXACT, REGISTERED])
@pytest.mark.parametrize(
    "step, turn",
    [((0.0, 0.0, 0.0), (0.0, 0.0, 2.0)), ((0.05, 0.0, 0.0), (0.0, 0.0, -1.0)), ((-0.06, 0.0, 0.0), (0.0, 0.5, 0.0))],
)
def test_a_whole_that_was_moved_as_one_is_told_as_one(step, turn, trust):
    """To 0.3 mm and a hundredth of a degree, about its own middle."""
    one, pieces = as_one(turned(step, turn), trust)
    assert one.offset == pytest.approx(step, abs=3e-4)
    assert one.interval[0][0] <= step[0] <= one.interval[0][1]
    assert one.turn == pytest.approx(turn[2], abs=0.01) and one.lean == pytest.approx(abs(turn[1]), abs=0.02)
    assert np.degrees(one.turned) == pytest.approx(turn, abs=0.02)
    assert one.rays == sum(pieces[row].rays for row in ROWS) and one.surely > 0.03
    if turn[2] == 2.0:  # its last piece is farther off than its middle, by what it is farther out
        assert pieces[8].offset[0] == pytest.approx(-1.05 * np.sin(np.radians(2.0)), abs=2e-3)


def test_a_piece_that_moved_alone_makes_no_body_of_them():
    assert as_one(turned((0.15, 0.0, 0.0), (0.0, 0.0, 0.0), ROWS[1:2]))[0] is None


def test_pieces_that_scatter_leave_their_whole_less_sure():
    """One of them stands 10 mm before the others."""
    flush, apart = (as_one(turned((0.01, 0.0, 0.0), (0.0, 0.0, 0.0), rows))[0] for rows in (ROWS, ROWS[1:2]))
    assert apart.half > 2.0 * flush.half
    assert apart.interval[0][0] <= 0.01 / 3.0 <= apart.interval[0][1]
