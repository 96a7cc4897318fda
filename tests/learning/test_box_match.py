"""Overlap and match of boxes whose answer is known, and of seeded random ones."""

import numpy as np
import pytest

from jaxmm.learning.box_match import Match, box_overlap, clip, match_boxes, polygon_area
from jaxmm.learning.boxes import Box


def turned(points, degrees):
    """Points, turned about z."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return points @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])


def block(x=0.0, y=0.0, size=(1.0, 1.0, 3.0), rotation=0.0, z=0.0, kind="pillar"):
    return Box(kind, np.array([x, y, z]), np.array(size), rotation)


@pytest.mark.parametrize(
    "a, b, expected",
    [
        pytest.param(block(), block(), 1.0, id="the same"),
        pytest.param(block(), block(x=0.5), 1 / 3, id="half beside"),
        pytest.param(block(), block(x=2), 0.0, id="apart"),
        pytest.param(block(), block(z=4), 0.0, id="above"),
        pytest.param(block(), block(z=1.5), 1 / 3, id="half above"),
        pytest.param(block(), block(size=(0.5, 0.5, 3)), 0.25, id="within"),
        pytest.param(block(), block(rotation=90), 1.0, id="a quarter turn of a square"),
        pytest.param(block(size=(4, 1, 3)), block(size=(1, 4, 3), rotation=-90), 1.0, id="edges named the other way"),
        pytest.param(block(size=(4, 1, 3)), block(size=(4, 1, 3), rotation=90), 1 / 7, id="crossing"),
        # Two unit squares an eighth of a turn apart share a regular octagon of area 2 (sqrt(2) - 1).
        pytest.param(block(), block(rotation=45), (lambda s: s / (2 - s))(2 * (2**0.5 - 1)), id="octagon"),
    ],
)
def test_overlap(a, b, expected):
    assert box_overlap(a, b) == pytest.approx(expected, abs=1e-12)
    assert box_overlap(b, a) == pytest.approx(expected, abs=1e-12)


def random_block(rng):
    return block(*rng.uniform(-1, 1, 2), rng.uniform(0.3, 3, 3), rng.uniform(-180, 180), rng.uniform(-1, 1))


@pytest.mark.parametrize("seed", range(3))
def test_overlap_agrees_with_counting_points(seed):
    rng = np.random.default_rng(seed)
    a, b = random_block(rng), random_block(rng)
    samples = rng.uniform(-3.5, 3.5, (400_000, 3))

    def holds(box):
        local = turned(samples - box.center, -box.rotation)
        return np.all(np.abs(local) <= box.dimensions / 2, axis=1)

    expected = np.mean(holds(a) & holds(b)) / np.mean(holds(a) | holds(b))
    assert box_overlap(a, b) == pytest.approx(expected, abs=0.02)


def test_overlap_is_symmetric_and_unmoved_by_shifts_and_turns_of_both():
    rng = np.random.default_rng(0)
    for _ in range(500):
        a, b = random_block(rng), random_block(rng)
        angle, shift = rng.uniform(-180, 180), rng.uniform(-1e6, 1e6, 3).round()  # national-grid coordinates
        moved = [
            box._replace(center=turned(box.center, angle) + shift, rotation=box.rotation + angle) for box in (a, b)
        ]
        overlap = box_overlap(a, b)
        assert 0.0 <= overlap <= 1.0
        assert box_overlap(b, a) == pytest.approx(overlap, abs=1e-12)
        assert box_overlap(*moved) == pytest.approx(overlap, abs=1e-6)


def test_clipping_never_grows_and_a_window_around_all_changes_nothing():
    square = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], float)
    assert polygon_area(clip(square, 10 * (square - 0.5))) == pytest.approx(1.0)
    assert len(clip(square, square + 5)) == 0


def test_match_is_one_to_one_and_finds_as_many_pairs_as_can_be():
    truth = [block(0), block(0.6)]
    found = [block(0.3), block(-0.3)]  # the second reaches the first truth only
    assert [(match.found, match.truth) for match in match_boxes(found, truth)] == [(0, 1), (1, 0)]
    assert len(match_boxes([block(0), block(0.1)], [block(0)])) == 1
    # Two poor pairs (thirds) rather than one perfect pair that strands the other two boxes.
    assert len(match_boxes([block(0), block(-0.5)], [block(0), block(0.5)])) == 2


def test_of_equally_many_pairs_the_best_overlaps_win():
    matches = match_boxes([block(0), block(0.2)], [block(0.2), block(0)])
    assert [(match.found, match.truth, match.overlap) for match in matches] == [(0, 1, 1.0), (1, 0, 1.0)]


@pytest.mark.parametrize(
    "found, truth, matches",
    [
        pytest.param(block(), block(kind="wall"), 0, id="another type"),
        pytest.param(block(size=(0.1, 0.1, 3)), block(x=0.5, size=(0.1, 0.1, 3)), 1, id="near, no overlap"),
        pytest.param(block(size=(0.1, 0.1, 3)), block(x=0.51, size=(0.1, 0.1, 3)), 0, id="a little too far"),
        pytest.param(block(size=(4, 1, 3)), block(x=2.4, size=(4, 1, 3)), 1, id="far, overlap of a quarter"),
        pytest.param(block(size=(4, 1, 3)), block(x=2.5, size=(4, 1, 3)), 0, id="overlap below a quarter"),
    ],
)
def test_what_counts_as_the_same_object(found, truth, matches):
    assert len(match_boxes([found], [truth])) == matches


def test_match_reports_overlap_and_distance():
    assert match_boxes([block(9), block(0)], [block(0, 0.5)]) == [Match(1, 0, pytest.approx(1 / 3), 0.5)]
