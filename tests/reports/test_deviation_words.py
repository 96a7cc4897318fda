"""What stands off its place, in words and tables: which, by how much, which way, and how surely."""

from html import unescape

import numpy as np
import pytest

from jaxmm.reports.deviation_words import (
    INTERVAL_WORDS,
    NORTH_WORDS,
    kind_of_class,
    measured,
    offset_in_words,
    place_in_words,
    summary_of,
    turn_in_words,
    way_of,
)
from jaxmm.reports.markdown import as_markdown, escaped
from jaxmm.reports.notebook import detection_html
from jaxmm.reports.plain_files import deviations_csv, elements_csv, sentences_of
from jaxmm.verdicts.results import ElementVerdict
from tests.cases.detections import HOSTILE, rows_of
from tests.cases.displaced import deviation, with_displaced
from tests.verdicts.test_results import random_detection


def element(told, ifc_class="IfcWall", name="W-102", verdict="displaced"):
    return ElementVerdict("guid", ifc_class, name, "storey", verdict, 0.01, 3, (1, 2, 3, 4), None, told)


@pytest.mark.parametrize(
    "told, words",
    [
        (deviation(0.023), "The wall 'W-102' stands 23 mm (21 to 25) to the east of its place."),
        (deviation(-0.023), "The wall 'W-102' stands 23 mm (21 to 25) to the west of its place."),
        (deviation(-0.04, (0, -1, 0)), "The wall 'W-102' stands 40 mm (38 to 42) to the north of its place."),
        (deviation(0.04, (1, -1, 0)), "The wall 'W-102' stands 40 mm (38 to 42) to the south-east of its place."),
        (deviation(0.012, (0, 0.1, -1)), "The wall 'W-102' stands 12 mm (10 to 14) below its place."),
        (deviation(-0.012, (0, 0, -1)), "The wall 'W-102' stands 12 mm (10 to 14) above its place."),
        (
            deviation(0.1, (1, 0, 1), half=0.03),
            "The wall 'W-102' stands 100 mm (70 to 130) along (0.71, 0.00, 0.71) from its place.",
        ),
        (
            deviation(0.0123, half=0.0002),
            "The wall 'W-102' stands 12.3 mm (12.1 to 12.5) to the east of its place.",
        ),
    ],
)
def test_a_sentence_says_which_by_how_much_which_way_and_how_surely(told, words):
    assert place_in_words(element(told)) == words


@pytest.mark.parametrize(
    "turn, lean, words",
    [
        (1.5, 0.02, ", turned by 1.5° counter-clockwise: 52 mm off at its ends."),
        (-0.4, 0.7, ", turned by 0.4° clockwise and leaning by 0.7°: 52 mm off at its ends."),
        (None, 0.7, ", leaning by 0.7°: 52 mm off at its ends."),
        (0.0, None, ", bent: 52 mm off at its ends."),
    ],
)
def test_what_is_turned_is_told_by_its_ends_and_ranked_by_them(turn, lean, words):
    one = deviation(0.001, worst=0.052)._replace(turn=turn, lean=lean)
    assert place_in_words(element(one)).endswith(words) and one.surely == pytest.approx(0.05)
    ranked = measured([element(deviation(0.03), name="shifted"), element(one, name="turned")])
    assert [each.name for each in ranked] == ["turned", "shifted"]
    (row,) = rows_of(deviations_csv([element(one)]))
    assert row["in_words"].endswith(words.removesuffix("."))
    assert turn_in_words(one._replace(worst=0.006)) == ""


def test_what_is_seen_from_two_sides_is_told_along_both():
    both = deviation(0.05)._replace(offset=(0.05, 0.04, 0.0), interval=((0.048, 0.052), (0.037, 0.043), None))
    assert offset_in_words(both) == "50 mm (48 to 52) to the east and 40 mm (37 to 43) to the north"
    # What its interval leaves open is not told as an offset.
    open_ = both._replace(interval=((0.048, 0.052), (-0.01, 0.09), None))
    assert offset_in_words(open_) == "50 mm (48 to 52) to the east"


def test_ways_turn_with_the_direction():
    """Each word holds within 22.5 degrees of what it names, and no word beyond."""
    names = ["east", "north-east", "north", "north-west", "west", "south-west", "south", "south-east"]
    for degrees in np.arange(0.25, 360.0, 0.5):
        angle = np.radians(degrees)
        number = int(((degrees + 22.5) % 360.0) // 45.0)
        assert way_of((3 * np.cos(angle), 3 * np.sin(angle), 0.0)) == f"to the {names[number]}"
        away = abs((degrees + 90.0) % 180.0 - 90.0)  # from level
        upright = "up" if degrees < 180.0 else "down"
        expected = "to the " if away <= 22.5 else "along (" if away <= 67.5 else upright
        assert way_of((np.cos(angle), 0.0, np.sin(angle))).startswith(expected)
    assert way_of((0.0, 0.0, 0.0)) == way_of((np.nan, 1.0, 0.0)) == "in an unknown direction"


@pytest.mark.parametrize(
    "ifc_class, kind",
    [("IfcWallStandardCase", "wall"), ("IfcColumn", "column"), ("IfcCurtainWall", "curtain wall"), ("", "element")],
)
def test_elements_are_called_what_people_call_them(ifc_class, kind):
    assert kind_of_class(ifc_class) == kind


def test_the_worst_comes_first_by_what_is_sure():
    """A large offset that is hardly known is not worse than a smaller one that is sure; displaced ones lead."""
    ones = [
        element(deviation(0.02), name="in place", verdict="present"),
        element(deviation(0.200, half=0.195), name="open"),
        element(deviation(-0.060), name="sure"),
        element(deviation(0.05), name="less"),
        element(None, name="unseen", verdict="occluded"),
        element(deviation(0.5, half=0.01), name="present", verdict="present"),
    ]
    assert [one.name for one in measured(ones)] == ["sure", "less", "open", "present", "in place"]
    rows = rows_of(deviations_csv(ones))
    assert [row["name"] for row in rows] == ["sure", "less", "open", "present", "in place"]
    assert "5 of 6 elements were measured" in summary_of(ones, 0.03) and summary_of(ones[4:5], 0.03) == ""
    assert summary_of(ones, 0.03).endswith("or it is gone.") and "Of any other" not in summary_of(ones[:4], 0.03)


@pytest.mark.parametrize("zeros, half, most", [(7, 0, 80), (19, 0, 0), (18, 0, 80), (1, 0, 80), (0, 80, 80)])
def test_the_shares_told_hold_of_what_was_measured(zeros, half, most):
    ones = [*(element(deviation(0.0), verdict="present") for _ in range(zeros)), element(deviation(0.08))]
    told = summary_of(ones, 0.03)
    assert f"within {half} mm of their places, 95 % within {most} mm." in told


def test_what_may_stand_off_its_place_is_named_with_its_interval(removed):
    """Of two walls that face each other a scan may leave open which one moved: neither is displaced."""
    ones = [
        element(deviation(-0.050, half=0.0504), name="east", verdict="present"),
        element(deviation(0.0, half=0.0506), name="partition", verdict="present"),
        element(deviation(0.01), name="in place", verdict="present"),
        element(deviation(0.2), name="told", verdict="displaced"),
    ]
    words = "Whether 2 of them stand within 30 mm is open"
    told = summary_of(ones, 0.03)
    assert words in told and "partition (-51 to 51)" in told and "east (-100 to 0)" in told
    assert "in place" not in told and "told (" not in told and "is open" not in summary_of(ones, 0.2)
    several = removed._replace(elements=tuple(ones[:3]))
    assert words in as_markdown(several) and "No element surely stands off its place" in as_markdown(several)
    many = summary_of([one._replace(name=f"W{number}") for number, one in enumerate(ones[:1] * 9)], 0.03)
    assert many.count("W") == 6 and "and 4 more" in many


def test_every_report_tells_what_is_displaced(removed):
    told = with_displaced(removed)
    words = "The wall 'W-102' stands 23 mm (21 to 25) to the east of its place."
    assert sentences_of(told) == (*removed.sentences, words) and sentences_of(removed) == removed.sentences
    text, html = as_markdown(told), unescape(detection_html(told))
    assert text.index("## Displaced") < text.index(escaped(words)) < text.index("## Elements")
    assert text.count(NORTH_WORDS) == text.count(INTERVAL_WORDS) == 1
    assert "23 mm (21 to 25) to the east of its place" in html and NORTH_WORDS in html
    assert "Displaced" not in as_markdown(removed) and "1 displaced" in told.summary()
    unchanged = told._replace(elements=tuple(one._replace(verdict="present") for one in told.elements))
    assert "No element surely stands off its place" in as_markdown(unchanged)


def test_tables_hold_the_numbers_and_gaps_where_nothing_is_known(removed):
    told = with_displaced(removed)
    worst, *others = rows_of(deviations_csv(told.elements))
    assert (worst["name"], worst["verdict"]) == ("W-102", "displaced")
    assert worst["in_words"] == "23 mm (21 to 25) to the east"
    names = [f"offset_x{end} [m]" for end in ("", "_low", "_high")]
    assert [float(worst[name]) for name in names] == [0.023, 0.021, 0.025]
    assert worst["offset_y_low [m]"] == worst["lean [deg]"] == "" and float(worst["offset_y [m]"]) == 0.0
    assert [float(worst[f"distance{end} [m]"]) for end in ("", "_low", "_high")] == [0.023, 0.021, 0.025]
    assert (worst["rays_on_it"], worst["loa"], worst["din18202"]) == ("1234", "LOA20", "beyond")
    assert len(others) == sum(one.deviation is not None for one in told.elements) - 1 > 0
    rows = rows_of(elements_csv(told.elements))
    for row, one in zip(rows, told.elements, strict=True):
        assert (row["loa"] == "") == (one.deviation is None) and row["guid"] == one.guid


def test_hostile_names_are_shown_and_whatever_was_measured_can_be_told(removed):
    for name in HOSTILE:
        told = with_displaced(removed, name=name)
        assert "<script" not in as_markdown(told) and "<img" not in as_markdown(told)
    html = detection_html(with_displaced(removed, name="".join(HOSTILE)))
    assert "<script" not in html and html.count("<img") == 1  # the plan
    for seed in range(60):
        detection = random_detection(seed)
        assert len(rows_of(deviations_csv(detection.elements))) == len(measured(detection.elements))
        assert ("\n".join(sentences_of(detection)) + as_markdown(detection)).encode("utf-8")


def test_an_offset_that_a_table_has_is_not_nothing_in_words():
    assert offset_in_words(deviation(-0.0003)) == "0.3 mm (-1.7 to 2.3) to the west"
    assert offset_in_words(deviation(0.023)) == "23 mm (21 to 25) to the east"
