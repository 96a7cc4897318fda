"""What faces tell of a pose where many of them moved, and of how sure one is of each."""

import numpy as np
import pytest

from jaxmm.deviations.deviation import deviations_of, faces_of
from jaxmm.deviations.pose_errors import EXACT, KEPT, REGISTERED
from tests.cases.box_building import building_of
from tests.deviations.test_deviation import COLUMN, FREE, HALL, hall, moved, seen, told
from warp_scanner.sensors.triangles import prepare


@pytest.mark.parametrize("by", [(0.115, 0.014), (0.03, -0.2), (-0.06, 0.06)])
def test_of_two_faces_that_both_moved_neither_is_believed(by):
    """Only a wall and a column tell the way between; the pose is as it was given, so that both moved is likely, too."""
    model = building_of([one for number, one in enumerate(HALL) if number not in (2, FREE)]).triangles
    wall, column = 2, 5
    real = moved(moved(model, wall, (by[0], 0.0, 0.0)), column, (by[1], 0.0, 0.0))
    found = deviations_of(prepare(model), [seen(real, noise=0.002)], [KEPT], np.full(6, 0.03))
    for row, true in ((wall, by[0]), (column, by[1])):
        both = found[row].interval[0]
        assert both is None or both[0] - 2e-3 <= true <= both[1] + 2e-3


@pytest.mark.parametrize("trust", [KEPT, REGISTERED])
def test_a_pose_that_leaves_one_wall_moved_is_told_where_another_leaves_three(trust):
    """Doubt where faces are few is no doubt where many agree."""
    one = told(hall(), seen(moved(hall(), FREE, (0.2, 0.0, 0.0)), noise=0.002), trust=trust)[FREE]
    assert one.distance == pytest.approx(-0.2, abs=1e-3) and one.half < 0.01


@pytest.mark.parametrize("is_turned", [False, True])
def test_walls_that_are_straight_are_told_at_their_unseen_ends(is_turned):
    """Where all stand 5 mm off but plumb and square, how one is turned is known far better than where it stands."""
    real = hall()
    for number, row in enumerate(range(2, COLUMN)):
        step = np.where(np.arange(3) == (0 if row in (2, 3, FREE) else 1), 0.005 * (-1) ** number, 0.0)
        real = moved(real, row, step, (0.0, 0.0, 0.1 * (-1) ** number) if is_turned else (0.0, 0.0, 0.0))
    pose = faces_of(prepare(hall()), seen(real), EXACT).poses[0]
    turn, lean = pose.tilt
    assert pose.place > 0.002 and (turn > 0.002) == is_turned and (turn < 0.0005) != is_turned and lean < 0.0005


def three_moved(seed, rows, alike=False):
    """A room of which three of four walls moved: model, what a scan shows whose pose fits one of each two, truth."""
    rng, model = np.random.default_rng(seed), building_of([HALL[row] for row in rows]).triangles
    real, true, both = model, dict.fromkeys(range(2, 6), 0.0), rng.uniform(-0.1, 0.1, 2)
    for row in rng.permutation(range(2, 6))[:3].tolist():
        axis = int(row > 3)
        true[row] = float(both[axis] if alike else np.exp(rng.uniform(*np.log([0.005, 0.3]))) * rng.choice((-1, 1)))
        real = moved(real, row, np.where(np.arange(3) == axis, true[row], 0.0))
    rays = seen(real, noise=0.002, seed=seed)
    fits = np.array([true[rng.choice((2, 3))], true[rng.choice((4, 5))], 0.0])
    found = deviations_of(
        prepare(model), [rays._replace(position=rays.position - fits)], [REGISTERED], np.full(len(rows), 0.03)
    )
    return found, true


def span(one, row):
    return one.interval[int(row > 3)]


@pytest.mark.parametrize(("rows", "least"), [([row for row in range(len(HALL)) if row != FREE], 24), (range(6), 0)])
def test_where_as_many_faces_speak_against_a_pose_as_for_it_nothing_is_told(rows, least):
    """Three of four walls moved: no wall has an interval without the truth, but where two that face moved alike."""
    count = 0
    for seed in range(16):
        found, true = three_moved(seed, list(rows))
        for row, off in true.items():
            both = span(found[row], row)
            if both is None:
                continue
            count += 1
            other = true[{2: 3, 3: 2, 4: 5, 5: 4}[row]]
            if abs(off) > 0.0 and abs(off - other) < 2e-3:
                assert found[row].surely <= 0.0  # as if the pose were off
            else:
                assert both[0] - 1e-3 <= off <= both[1] + 1e-3
    assert least <= count <= 32


@pytest.mark.parametrize("by", [0.04, 0.15, -0.25])
def test_a_wall_that_may_have_moved_or_not_is_told_to_be_open(by):
    """Of two that face each other one moved, and its scan fixes the way between: the interval says how open it is."""
    model = building_of(HALL[:FREE]).triangles
    found = deviations_of(
        prepare(model), [seen(moved(model, 3, (by, 0.0, 0.0)), noise=0.002)], [REGISTERED], np.full(FREE, 0.03)
    )
    for row, sides in ((2, (-by, 0.0)), (3, (0.0, by))):
        low, high = found[row].interval[0]
        assert low <= min(sides) + 2e-3 and high >= max(sides) - 2e-3 and high - low < 2.0 * abs(by) + 0.02
        assert found[row].surely <= 0.0


@pytest.mark.parametrize("seed", range(4))
def test_two_walls_that_moved_alike_are_where_the_pose_has_them(seed):
    """No scan tells that from a pose that is off: neither is told to be off its place."""
    found, true = three_moved(seed, range(6), alike=True)
    for pair in ((2, 3), (4, 5)):
        if true[pair[0]] == true[pair[1]]:
            assert all(found[row].surely <= 0.0 for row in pair)
