"""Clouds of one place pass, whatever was changed; other units and other places are told in one line."""

import numpy as np
import pytest

from jaxmm.inputs import InputError
from jaxmm.rays.overlap import check_pair

RNG = np.random.default_rng(4)
ROOM = RNG.uniform([-5, -4, 0], [5, 4, 3], (5000, 3))


@pytest.mark.parametrize("scan", [ROOM, ROOM[ROOM[:, 0] > 4], ROOM + 0.3], ids=["same", "a corner", "misaligned"])
def test_what_overlaps_passes(scan):
    check_pair(ROOM, scan)


@pytest.mark.parametrize(
    "factor, unit",
    [(1e3, "the scan seems to be in millimetres"), (1e-3, "the prior seems to be in millimetres"),
     (1 / 0.3048, "the scan seems to be in feet"), (1 / 0.0254, "the scan seems to be in inches")],
)  # fmt: skip
def test_other_units_are_named(factor, unit):
    with pytest.raises(InputError, match=rf"^the scan spans .*{unit}; expected metres in both$"):
        check_pair(ROOM, (ROOM + np.array([200.0, 100.0, 0.0])) * factor)


def test_another_place_is_refused_with_the_share():
    with pytest.raises(InputError, match=r"^expected a scan of the prior's place, got 0.0% of its points"):
        check_pair(ROOM, ROOM + np.array([40.0, 0, 0]))


def test_feet_are_told_though_floors_overlap():
    with pytest.raises(InputError, match="the scan seems to be in feet"):
        check_pair(ROOM, ROOM / 0.3048)
    with pytest.raises(InputError, match="the prior seems to be in feet"):
        check_pair(ROOM / 0.3048, ROOM)
