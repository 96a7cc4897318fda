"""Sizes that a building has already tell columns from short walls, and nothing of whether a thing is real."""

import numpy as np
import pytest

from jaxmm.objects.face_ends import as_all_rays_show
from jaxmm.objects.familiar_sizes import by_length, by_size, by_width
from jaxmm.objects.finder import ObjectSettings, examine, find_objects
from jaxmm.objects.solids import solid_of
from jaxmm.objects.usual_sizes import OwnElements
from jaxmm.objects.walls import KnownBuilding
from tests.cases.known_rooms import judged, pillar, says, wall
from warp_scanner.scenes.scenes import CYLINDER

UNSURE = says(0.02, 0.03, 0.95)
EDGE = np.array([np.cos(np.radians(40.0)), np.sin(np.radians(40.0))])  # of the view, to the left
COLUMNS = KnownBuilding(columns=((0.3, 0.3, False),))


def moved(seen, share, known, off_grid=0.0):
    """What sizes make of the judge's probabilities of the largest candidate."""
    settings = ObjectSettings()
    sight, looks, candidates, _ = examine(seen, settings)
    one = as_all_rays_show(sight, looks, candidates[0], settings.tolerance)
    pillar_like = solid_of(sight, one, False, settings, known)
    return by_size(np.array(share), one, pillar_like, known, settings, lambda: off_grid)


def elements(walls, columns=0, width=1.0):
    row = np.ones(walls + columns)
    is_wall = np.arange(len(row)) < walls
    return OwnElements(is_wall, row > 1, np.zeros((len(row), 2)), 0 * row, np.where(is_wall, row, width))


def told(seen, known, judge=UNSURE):
    (found,) = find_objects(seen, known=known, judge=judge)
    return found.box


@pytest.mark.parametrize("y", [0.0, 0.1, 0.2])
def test_what_is_as_slender_as_a_column_of_the_building_is_one(y):
    """Of whose depth nothing is known: it may be the end of a wall."""
    seen = judged(pillar(2.5, y, 0.3))
    assert told(seen, KnownBuilding()).object_type == "wall"
    assert told(seen, COLUMNS).object_type == "pillar"
    assert told(seen, KnownBuilding(columns=((0.6, 0.6, False),))).object_type == "wall"


def test_a_round_one_is_a_round_column_only_if_it_is_as_thick():
    seen = judged(pillar(2.5, 0.2, 0.4, kind=CYLINDER))
    for width, kind in ((0.4, "pillar"), (0.8, "wall")):
        assert told(seen, KnownBuilding(columns=((width, width, True),))).object_type == kind


def test_two_faces_as_those_of_a_short_wall_are_one():
    seen = judged(wall(2.8, 0.2, 1.2, 0.4, 55))
    sure = says(0.02, 0.95, 0.03)
    assert told(seen, KnownBuilding(), sure).object_type == "pillar"
    assert told(seen, KnownBuilding(short_walls=((0.4, 1.2),)), sure).object_type == "wall"
    both = KnownBuilding(columns=((0.4, 1.2, False),), short_walls=((0.4, 1.2),))
    assert told(seen, both, sure).object_type == "pillar"


def test_one_wide_face_moves_the_odds_less_than_two_or_a_slender_one():
    settings = ObjectSettings()
    face = moved(judged(pillar(3.0, 0.0, 0.8)), [0.1, 0.45, 0.45], KnownBuilding(columns=((0.8, 0.8, False),)))
    slender = moved(judged(pillar(3.0, 0.0, 0.3)), [0.1, 0.45, 0.45], COLUMNS)
    assert face[1] / face[2] == pytest.approx(0.8 / 0.12)
    assert slender[1] / slender[2] == pytest.approx(settings.end_on * 0.8 / 0.12)
    many = KnownBuilding(columns=tuple((width, width, False) for width in (0.3, 0.5, 0.8, 1.0)))
    one_of_four = moved(judged(pillar(3.0, 0.0, 0.8)), [0.1, 0.45, 0.45], many)
    assert one_of_four[1] / one_of_four[2] == pytest.approx(0.8 / 0.48)


def test_the_end_of_what_is_as_thick_as_a_wall_too_is_a_columns_only_if_no_wall_stands_in_that_direction():
    share, known = [0.1, 0.45, 0.45], COLUMNS._replace(walls=(0.12, 0.3))
    seen = judged(pillar(3.0, 0.0, 0.3))
    assert moved(seen, share, known, 5.0)[1] == moved(seen, share, known, 5.0)[2]
    assert moved(seen, share, known, 40.0)[1] > 0.89
    assert moved(seen, share, COLUMNS._replace(walls=(0.12, 0.2)), 5.0)[1] > 0.89


def test_a_side_that_is_made_up_from_a_column_does_not_fit_it():
    """Of a wall that leaves the view: a part of its face, and its end."""
    known, share = KnownBuilding(columns=((0.3, 0.45, False),)), [0.1, 0.2, 0.7]
    found = moved(judged(wall(2.29, 2.56, 1.85, 0.45, 103.6)), share, known)
    assert found[2] > 0.2


def test_what_is_seen_of_a_face_that_leaves_the_view_is_no_size():
    """As long as a short wall of the building, or as wide as a column, by chance: the view cuts it anywhere."""
    settings, told_of = ObjectSettings(), 0
    for seed in range(40):
        rng = np.random.default_rng(seed)
        distance, width = rng.uniform(1.5, 4.0), rng.uniform(0.7, 1.2)
        x, y = (distance + width / 2) * EDGE
        seen = judged(pillar(x, y, width, 40.0))
        sight, looks, candidates, _ = examine(seen, settings)
        one = as_all_rays_show(sight, looks, candidates[0], settings.tolerance)
        if one.crossing is not None or any(solid_of(sight, one, False, settings, KnownBuilding()).measured):
            continue
        told_of += 1
        length, share = one.first.face.length, np.array([0.1, 0.5, 0.4])
        for known in (KnownBuilding(short_walls=((0.3, length),)), KnownBuilding(columns=((length, length, False),))):
            np.testing.assert_array_equal(moved(seen, share, known), share)
    assert told_of >= 30


def test_oblong_columns_fit_no_shaft():
    seen = judged(pillar(2.5, 0.2, 0.4, kind=CYLINDER))
    assert told(seen, KnownBuilding(columns=((0.2, 1.2, False),))).object_type == "wall"


def test_whether_it_is_real_stays_as_the_judge_has_it():
    """Of 40 pillars nearly all show a size of their building's columns, and of the others nothing changes."""
    moved_on = 0
    for seed in range(40):
        rng = np.random.default_rng(seed)
        share, width = rng.dirichlet(np.ones(3)), rng.uniform(0.25, 1.0)
        seen = judged(pillar(rng.uniform(2, 4), rng.uniform(-0.8, 0.8), width, rng.uniform(0, 90)))
        found = moved(seen, share, KnownBuilding(columns=((width, width, False),)))
        assert found[0] == share[0] and found.sum() == pytest.approx(1.0) and found[1] >= share[1]
        moved_on += found[1] > share[1]
    assert moved_on >= 32


@pytest.mark.parametrize("yaw", [0.0, 3.0])
def test_a_wide_face_alone_is_no_columns_where_a_building_has_walls_alone_or_slender_columns(yaw):
    """Others keep what the judge says: of which no element is known, that have a wide column, or few walls."""
    sure = says(0.02, 0.95, 0.03)

    def told_of(width, own):
        return told(judged(pillar(2.5, 0.0, width, yaw)), KnownBuilding(own=own), sure)

    alone, wide, slender = elements(16), elements(16, columns=1, width=0.5), elements(16, columns=3, width=0.45)
    assert told_of(1.1, alone).object_type == told_of(1.1, slender).object_type == "wall"
    assert told_of(1.1, alone).probability == told_of(1.1, wide).probability
    few = elements(15, columns=1, width=0.22)
    for other in (told_of(0.9, alone), told_of(0.9, slender), told_of(1.1, wide), told_of(1.1, few)):
        assert other.object_type == "pillar"
    assert told(judged(pillar(2.5, 0.0, 1.1, yaw)), KnownBuilding(), sure).object_type == "pillar"
    assert told_of(1.1, alone).dimensions[:2].min() < 0.3


def test_two_wide_faces_are_a_columns_in_any_building():
    seen = judged(pillar(3.0, 0.0, 1.1, 40.0))
    assert told(seen, KnownBuilding(own=elements(16)), says(0.02, 0.95, 0.03)).object_type == "pillar"


@pytest.mark.parametrize("share", [(0.2, 0.4, 0.4), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)])
def test_a_wide_face_moves_the_odds_of_its_type_and_not_whether_it_is_real(share):
    settings = ObjectSettings()
    _, _, candidates, _ = examine(judged(pillar(2.5, 0.0, 1.1)), settings)
    nothing, column, wall = by_width(np.array(share), candidates[0], KnownBuilding(own=elements(16)), settings)
    assert nothing == share[0] and nothing + column + wall == pytest.approx(1.0)
    assert column * share[2] * settings.seldom_wider == pytest.approx(wall * share[1])


def test_what_is_longer_than_any_column_is_a_wall():
    """A curved wall has more than one side, as pillars have."""
    angles = np.radians(np.arange(0.0, 91.0, 10.0))
    middle = (angles[1:] + angles[:-1]) / 2
    arc = [wall(2.0 + 2.0 * np.cos(one), -1.0 + 2.0 * np.sin(one), 0.4, 0.2, 90.0 + np.degrees(one)) for one in middle]
    assert told(judged(*arc), KnownBuilding(), says(0.02, 0.9, 0.08)).object_type == "wall"
    settings, share = ObjectSettings(), np.array([0.2, 0.6, 0.2])
    corner = np.array([[0.0, 0.0], [0.0, 1.7], [1.7, 1.7]])
    assert by_length(share, corner, KnownBuilding(), settings) is share
    np.testing.assert_allclose(by_length(share, 1.1 * corner, KnownBuilding(), settings), [0.2, 0.0, 0.8])
    pier = KnownBuilding(columns=((0.4, 3.0, False),))
    assert by_length(share, 1.1 * corner, pier, settings) is share
