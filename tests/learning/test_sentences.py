"""Mismatches in words, as the thesis prints them."""

import numpy as np
import pytest

from jaxmm.learning.boxes import Box, sentence


@pytest.mark.parametrize(
    "box, mismatch_type, expected",
    [
        (
            Box("pillar", np.array([-0.301, -0.4, -0.001]), np.array([0.34, 0.338, 3.0], np.float32)),
            "added",
            "A pillar has been added at [-0.3 -0.4 0.] with dimensions [0.34 0.34 3.].",
        ),
        (
            Box("wall", np.array([196.754, 75.84, 10.0]), np.array([12.0, 0.15, 7.85])),
            "removed",
            "A wall has been removed at [196.75 75.84 10.] with dimensions [12. 0.15 7.85].",
        ),
        (  # along y
            Box("wall", np.array([1.0, 2.0, 1.5]), np.array([4.0, 0.2, 3.0]), -89.8),
            "added",
            "A wall has been added at [1. 2. 1.5] with dimensions [0.2 4. 3.].",
        ),
        (
            Box("wall", np.array([1.0, 2.0, 1.5]), np.array([4.0, 0.2, 3.0]), 30.0),
            "added",
            "A wall has been added at [1. 2. 1.5] with dimensions [4. 0.2 3.], turned by 30° counter-clockwise.",
        ),
        (
            Box("wall", np.array([1.0, 2.0, 1.5]), np.array([4.0, 0.2, 3.0]), 75.0),
            "removed",
            "A wall has been removed at [1. 2. 1.5] with dimensions [0.2 4. 3.], turned by 15° clockwise.",
        ),
        (  # half a degree is not none
            Box("wall", np.array([1.0, 2.0, 1.5]), np.array([4.0, 0.2, 3.0]), 90.5),
            "added",
            "A wall has been added at [1. 2. 1.5] with dimensions [0.2 4. 3.], turned by 0.5° counter-clockwise.",
        ),
        (  # a round one looks the same from all sides
            Box("pillar", np.array([1.0, 2.0, 1.5]), np.array([0.4, 0.4, 3.0]), 30.0, "round"),
            "added",
            "A pillar has been added at [1. 2. 1.5] with dimensions [0.4 0.4 3.].",
        ),
    ],
)
def test_sentence(box, mismatch_type, expected):
    assert sentence(box, mismatch_type) == expected


def test_sentence_rejects_other_changes():
    with pytest.raises(ValueError, match="mismatch_type must be one of"):
        sentence(Box("wall", np.zeros(3), np.ones(3)), "moved")
