"""What is usual in a building around a place: how its walls and columns stand, and how large they are."""

import numpy as np
import pytest

from jaxmm.objects.main_directions import UNKNOWN
from jaxmm.objects.usual_sizes import WIDEST, Habits, OwnElements, habits_around
from jaxmm.verdicts.priors import prior_of_building
from warp_scanner.buildings.changes import of_element
from warp_scanner.buildings.room_buildings import building_of_room
from warp_scanner.rooms.pairs import PRESETS, make_pairs
from warp_scanner.scenes.building_edits import without
from warp_scanner.scenes.scenes import PILLAR, WALL

HERE = np.zeros(2)


def own(*things):
    """(wall?, round?, turn [deg], width [m], place)."""
    is_wall, is_round, turn, width, place = zip(*things, strict=True)
    turn = np.radians(turn) % (np.pi / 2)
    return OwnElements(np.array(is_wall), np.array(is_round), np.array(place, float), turn, np.array(width))


def test_without_a_building_nothing_is_usual():
    assert habits_around(None, HERE, 0.3) == Habits() == Habits(0.0, 0.0, 0.0, 0.0, 0.0, UNKNOWN, UNKNOWN)


@pytest.mark.parametrize("turn", [0.0, 30.0, 89.0, -47.0])
def test_habits_are_sizes_and_angles_to_the_grid_and_turn_with_the_building(turn):
    things = own(
        (True, False, turn, 6.0, (0.0, 0.0)), (True, False, turn + 10.0, 2.0, (0.0, 0.0)),
        (False, False, turn - 20.0, 0.3, (0.0, 0.0)), (False, False, turn + 40.0 + 90.0, 0.5, (0.0, 0.0)),
        (False, True, turn + 5.0, 0.8, (0.0, 0.0)),
    )  # fmt: skip
    told = habits_around(things, HERE, np.radians(turn) % (np.pi / 2))
    # The round one stands along nothing, but is a column; walls count by their length.
    assert told == pytest.approx((np.log(3.0), 2.0, np.log(4.0), 0.3, 0.8, 30.0, 2.5))
    assert habits_around(things, HERE, None) == pytest.approx((*told[:5], UNKNOWN, UNKNOWN))


def test_what_is_far_away_tells_less_of_how_things_stand_here():
    near, far = (False, False, 0.0, 0.3, (1.0, 0.0)), (False, False, 40.0, 0.4, (61.0, 0.0))
    told = habits_around(own(near, far), HERE, 0.0)
    assert told.columns_askew == pytest.approx(40.0 / (1.0 + np.e**2))  # 60 m are twice the 30 over which it fades
    assert (told.slimmest, told.widest) == (0.3, 0.4)


def test_very_wide_columns_are_as_wide_as_the_widest_that_count():
    assert habits_around(own((False, False, 0.0, 7.0, (0, 0))), HERE, 0.0)[:5] == (
        0.0,
        0.0,
        np.log(2.0),
        WIDEST,
        WIDEST,
    )
    only_a_wall = habits_around(own((True, False, 0.0, 7.0, (0, 0))), HERE, 0.0)
    assert only_a_wall == (np.log(2.0), 7.0, 0.0, 0.0, 0.0, UNKNOWN, 0.0)


def test_of_generated_rooms_it_tells_what_their_settings_say():
    """Walls turn by 15 degrees at most, pillars of up to 1.3 m by any angle; in the thesis's rooms nothing turns."""
    told = {"varied": [], "thesis": []}
    for preset in told:
        pairs = make_pairs(PRESETS[preset], np.arange(60))
        for row in range(60):
            building, _ = building_of_room(pairs.prior, row)
            prior = prior_of_building(building)
            semantic = building.elements.semantic
            columns = [of_element(building, int(one)) for one in np.flatnonzero(semantic == PILLAR)]
            habits = habits_around(prior.known.own, HERE, 0.0)
            assert habits.columns == pytest.approx(np.log1p(len(columns)))
            assert habits.widest == pytest.approx(max([max(one.size[:2]) for one in columns], default=0.0))
            walls = [of_element(building, int(one)) for one in np.flatnonzero(semantic == WALL)]
            assert habits.walls == pytest.approx(np.log1p(len(walls)))
            assert habits.shortest == pytest.approx(min(max(one.size[:2]) for one in walls))
            told[preset].append(habits)
    askew = {name: np.array([one.columns_askew for one in each]) for name, each in told.items()}
    assert 0.0 <= askew["thesis"].max() < 0.01 and np.median(askew["varied"][askew["varied"] >= 0.0]) == pytest.approx(
        22, abs=6
    )
    for each in told.values():
        assert max(one.walls_askew for one in each) < 15.0 and max(one.widest for one in each) <= 1.301


@pytest.mark.parametrize("left", [(), (WALL,), (PILLAR,)])
def test_a_building_may_have_no_walls_or_no_columns(left):
    """What is not there has no size and no direction."""
    pairs = make_pairs(PRESETS["varied"], np.arange(8))
    for row in range(8):
        building, _ = building_of_room(pairs.prior, row)
        gone = np.flatnonzero(np.isin(building.elements.semantic, [one for one in (WALL, PILLAR) if one not in left]))
        known = prior_of_building(without(building, gone)).known
        habits = habits_around(known.own, HERE, 0.0)
        whole = habits_around(prior_of_building(building).known.own, HERE, 0.0)
        expected = Habits(
            *(whole[:2] if WALL in left else (0.0, 0.0)), *(whole[2:5] if PILLAR in left else (0.0, 0.0, 0.0)),
            whole.columns_askew if PILLAR in left else UNKNOWN, whole.walls_askew if WALL in left else UNKNOWN,
        )  # fmt: skip
        assert habits == pytest.approx(expected)
