"""The table of clouds as priors: what the thesis's filter leaves of a room, and what is counted."""

import numpy as np

from benchmarks.clouds import LEAST_TOP, table
from benchmarks.clouds import _cloud as cloud_of
from benchmarks.views.detection_scores import COUNTS
from jaxmm.files import write_json
from jaxmm.runs.room_scans import room_cases


def test_a_filtered_cloud_is_thin_and_holds_what_stands_up_floor_and_ceiling_and_a_whole_one_everything():
    (case,) = room_cases("pillar_added", "occluded", 3, range(1), preset="thesis", sensor_height=1.5)
    whole, element = cloud_of(case.pairs, 0, case.pairs.robot, "whole")
    np.testing.assert_array_equal(whole, case.scan.points)
    filtered, kept = cloud_of(case.pairs, 0, case.pairs.robot, "filtered")
    half = float(case.pairs.size[0, 2]) / 2
    assert (
        len(filtered) < len(whole) / 3 and len(filtered) == len(kept) and not np.isin(kept, element, invert=True).any()
    )
    tops = {one: whole[element == one, 2].max() + half for one in np.unique(element)}
    low = {one for one, top in tops.items() if 0.2 < top < LEAST_TOP}
    assert low and low.isdisjoint(kept) and {one for one, top in tops.items() if top >= LEAST_TOP} <= set(kept.tolist())
    assert len(np.unique(np.floor(filtered / 0.1 + 0.5), axis=0)) == len(filtered)


def test_refused_pairs_are_counted_and_what_hardly_shows_is_not_asked_for(tmp_path):
    room = dict(zip(COUNTS, (3, 2, 1, 2, 1), strict=True))  # found, right, hidden, wanted, reached
    told = [{"filtered": room, "whole": room}, {"filtered": {"refused": "why"}, "whole": room}]
    write_json(tmp_path / "wall_added_clean_5_2.json", told)
    write_json(tmp_path / "wall_added_clean_6_2.json", [])  # of another seed
    _, _, row = table(tmp_path, 2, 5).splitlines()
    assert row == "| wall added | clean | 2 | 1 | 0.500 (1/2) | 0.500 (1/2) | 0 | 0.500 (2/4) | 0.500 (2/4) |"
