"""Verdicts by hand, for one scan and for several; test_detection.py holds them against the simulator's truth."""

import numpy as np
import pytest

from jaxmm.classes.telling_rays import Telling
from jaxmm.verdicts.verdicts import (
    OCCLUDED,
    PRESENT,
    REMOVED,
    UNSCANNED,
    VerdictSettings,
    retold,
    told_of,
    verdicts_of,
)

PRIOR = VerdictSettings().change_prior


def told(rays, probability, scanned=True):
    """What a scan tells of one element with one point per row of rays."""
    count = np.array(rays).reshape(-1, 4)
    return told_of(np.array([scanned]), np.zeros(len(count), int), count, np.full(len(count), probability))


@pytest.mark.parametrize(
    "rays, probability, expected",
    [
        pytest.param([[30, 0, 0, 0]], 0.99, REMOVED, id="all rays went through"),
        pytest.param([[0, 30, 0, 0]], 0.01, PRESENT, id="all rays ended on it"),
        pytest.param([[7831, 0, 0, 0]], 0.24, REMOVED, id="all rays went through, and the network doubts it"),
        pytest.param([[0, 7831, 0, 0]], 0.7, PRESENT, id="all rays ended on it, and the network doubts it"),
        pytest.param([[1505, 9, 0, 429]], 0.006, REMOVED, id="an outer wall: hardly any ray ended on it"),
        pytest.param([[1400, 90, 0, 28000]], 0.0001, REMOVED, id="an outer wall, behind which little comes back"),
        pytest.param([[823, 0, 69, 31780]], 0.5, REMOVED, id="an outer wall, behind which next to nothing comes back"),
        pytest.param([[485, 1, 28, 25649]], 0.5, REMOVED, id="an outer wall: some pass, and none ends on it"),
        pytest.param([[440, 30, 28, 25649]], 0.5, OCCLUDED, id="some end on it where nothing comes back"),
        pytest.param([[55, 0, 28, 25649]], 0.5, OCCLUDED, id="too few to tell where nothing comes back"),
        pytest.param([[85, 0, 2900, 0]], 0.9, OCCLUDED, id="some pass, and nearly all end before it"),
        pytest.param([[823, 0, 31780, 69]], 0.9, OCCLUDED, id="a small share, most of it hidden"),
        pytest.param([[3, 823, 69, 31780]], 0.5, PRESENT, id="many end on it, and nothing else comes back"),
        pytest.param([[560, 310, 770, 0]], 0.02, PRESENT, id="errors send many rays through, and the network knows"),
        pytest.param([[0, 0, 500, 0]], 0.99, OCCLUDED, id="all rays ended before it"),
        pytest.param([[0, 0, 0, 500]], 0.99, OCCLUDED, id="no ray came back"),
        pytest.param([[10, 9, 0, 0]], 0.99, OCCLUDED, id="too few rays to tell"),
        pytest.param([[25, 0, 975, 0]], 0.99, OCCLUDED, id="too small a share to tell"),
        pytest.param([[40, 0, 960, 0]], 0.99, REMOVED, id="a share that is enough"),
    ],
)
def test_what_rays_tell(rays, probability, expected):
    (found,) = verdicts_of([told(rays, probability)])
    assert found.verdict == expected and found.rays == tuple(rays[0]) and found.points == 1
    if expected == OCCLUDED:
        assert found.probability == PRIOR
    else:
        assert (found.probability > 0.5) == (expected == REMOVED)


@pytest.mark.parametrize(
    "rays, telling, expected",
    [
        pytest.param((12, 14), None, OCCLUDED, id="few rays, most of which end on it"),
        pytest.param((30, 14), None, REMOVED, id="few rays, most of which pass"),
        pytest.param((120, 140), None, REMOVED, id="many rays"),
        # Of a lining before a wall most rays end where both have a surface: that tells nothing.
        pytest.param((20, 30), (24, 2), REMOVED, id="those pass that nothing else explains"),
        pytest.param((20, 30), (2, 24), PRESENT, id="those end on it that nothing else explains"),
        pytest.param((20, 30), (15, 11), OCCLUDED, id="neither"),
        pytest.param((20, 30), (9, 0), OCCLUDED, id="too few of them"),
    ],
)
def test_networks_alone_take_nothing_away_that_few_rays_end_on(rays, telling, expected):
    """They say gone; of few rays no more pass than end there."""
    before = verdicts_of([told([[*rays, 0, 5]], 0.8)])
    told_of_it = [] if telling is None else [Telling(*(np.array([count]) for count in (*telling, 0)))]
    (found,) = retold(before, told_of_it, VerdictSettings())
    assert before[0].verdict == REMOVED and found.verdict == expected
    assert (found.probability >= 0.5) == (expected == REMOVED)


def test_the_more_rays_go_through_the_likelier_an_element_is_gone():
    """Whatever the network says, and nowhere with a jump."""
    draw = np.random.default_rng(4)
    for _ in range(200):
        through, probability = np.arange(2001), draw.uniform(0.0, 1.0) ** 4
        rays = np.column_stack([through, 2000 - through, *np.zeros((2, 2001), int)])
        logit = told_of(np.ones(2001, bool), np.arange(2001), rays, np.full(2001, probability)).logit
        assert np.all(np.diff(logit) > 0.0) and np.diff(logit)[50:-50].max() < 0.2


def test_what_no_ray_counts_for_is_unscanned_though_directions_meet_it():
    """A thin column between two rays, or one whose whole surface another element has, too: nothing hides it."""
    (alone,) = verdicts_of([told([[0, 0, 0, 0]], 0.5)])
    assert alone.verdict == UNSCANNED and alone.probability == PRIOR
    (seen,) = verdicts_of([told([[0, 0, 0, 0]], 0.5), told([[0, 0, 3, 0]], 0.5)])
    assert seen.verdict == OCCLUDED


def test_what_is_not_in_the_scan_is_unscanned():
    one = told_of(np.array([False, True, True]), np.array([2]), np.array([[0, 30, 0, 0]]), np.array([0.1]))
    found = verdicts_of([one])
    assert [each.verdict for each in found] == [UNSCANNED, UNSCANNED, PRESENT] and found[0].rays == (0, 0, 0, 0)
    assert found[0].probability == found[1].probability == PRIOR


def test_points_that_no_ray_tells_of_do_not_vote():
    rays = np.array([[30, 0, 0, 0], [0, 0, 500, 0]])
    with_blind = told_of(np.array([True]), np.zeros(2, int), rays, np.array([0.9, 0.0]))
    assert with_blind.logit[0] == pytest.approx(told(rays[0], 0.9).logit[0])


def test_scans_that_agree_are_surer_than_each_and_order_does_not_matter():
    one, two = told([[60, 40, 0, 0]], 0.7), told([[80, 30, 0, 0]], 0.8)
    alone = [verdicts_of([each])[0].probability for each in (one, two)]
    (both,), (turned,) = verdicts_of([one, two]), verdicts_of([two, one])
    assert both.probability > max(alone) and both == turned and both.rays == (140, 70, 0, 0) and both.points == 2


def test_log_odds_beyond_the_prior_add_up():
    one, two = told([[60, 40, 0, 0]], 0.7), told([[5, 90, 0, 0]], 0.2)
    start = np.log(PRIOR / (1 - PRIOR))
    expected = start + sum(float(each.logit[0]) - start for each in (one, two))
    (found,) = verdicts_of([one, two])
    assert found.probability == pytest.approx(1 / (1 + np.exp(-expected)))


def test_a_scan_that_saw_nothing_changes_nothing():
    seen, blocked, away = told([[0, 50, 10, 0]], 0.05), told([[0, 0, 900, 0]], 0.9), told([], 0.5, scanned=False)
    (alone,), (all_three,) = verdicts_of([seen]), verdicts_of([blocked, seen, away])
    assert all_three.verdict == PRESENT and all_three.probability == pytest.approx(alone.probability)
    assert verdicts_of([blocked, away])[0].verdict == OCCLUDED and verdicts_of([away])[0].verdict == UNSCANNED


def test_two_hidden_halves_are_enough_together_only_where_one_is_enough_alone():
    """Odds are taken from scans that tell; two that do not tell each do not tell together."""
    half = told([[0, 15, 10, 0]], 0.05)
    assert verdicts_of([half, half])[0].verdict == OCCLUDED


@pytest.mark.parametrize(
    ("each", "gone", "there"), [(210, REMOVED, PRESENT), (150, REMOVED, OCCLUDED), (15, OCCLUDED, OCCLUDED)]
)
def test_many_rays_tell_whether_they_are_of_one_scan_or_of_three(each, gone, there):
    """Of an outer wall, behind which next to nothing comes back."""
    cases = (([each, 0, 20, 9000], gone), ([0, each, 20, 9000], there), ([each, 0, 9000, 20], OCCLUDED))
    for rays, expected in cases:
        (three,) = verdicts_of([told([rays], 0.5)] * 3)
        (one,) = verdicts_of([told([(3 * np.array(rays)).tolist()], 0.5)])
        assert three.verdict == one.verdict == expected


def test_shapes_that_disagree_are_refused():
    with pytest.raises(ValueError, match="must be"):
        told_of(np.array([True]), np.zeros(2, int), np.zeros((3, 4), int), np.zeros(2))
