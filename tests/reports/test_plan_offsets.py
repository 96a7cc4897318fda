"""Displaced elements in the plan: arrows in their place, to scale, and the worst in words."""

import re

import numpy as np
import pytest
from matplotlib.text import Annotation

from jaxmm.reports.deviation_words import offset_in_words
from jaxmm.reports.offset_arrows import offsets_of
from jaxmm.reports.plan_figure import draw_plan
from jaxmm.reports.plan_offsets import LONGEST_ARROW, MISSING, MOST_WORST, arrow_times, shown_name
from tests.cases.displaced import deviation, with_displaced


def arrows(figure):
    """Tail and tip (2,) of every arrow of an offset, and the letters at tips."""
    notes = [one for axes in figure.axes for one in axes.texts if isinstance(one, Annotation)]
    offsets = [one for one in notes if one.arrowprops and one.arrowprops.get("linewidth") == 2.2]
    letters = {one.get_text(): np.array(one.xy) for one in notes if re.fullmatch("[A-Z]", one.get_text())}
    return [(np.array(one.xyann), np.array(one.xy)) for one in offsets], letters


def bounds_of(detection, guid):
    drawing = detection.drawing
    corners = drawing.vertices[drawing.faces[drawing.face_element == drawing.guid.index(guid)]].reshape(-1, 3)
    return (corners.min(axis=0) + drawing.origin)[:2], (corners.max(axis=0) + drawing.origin)[:2]


@pytest.mark.parametrize("distance", [0.02, 0.06, -0.12, 0.31])
def test_an_arrow_begins_in_the_element_and_is_to_scale(removed, distance):
    told = with_displaced(removed, distance=distance)
    (one,) = [one for one in told.elements if one.verdict == "displaced"]
    figure = draw_plan(told)
    ((tail, tip),), letters = arrows(figure)
    times, (axes,) = arrow_times(told.drawing, [one]), figure.axes
    np.testing.assert_allclose(tip - tail, [times * distance, 0.0], atol=1e-9)
    np.testing.assert_allclose(letters["A"], tip)
    assert abs(times * distance) <= LONGEST_ARROW or times == 5
    low, high = bounds_of(told, one.guid)
    assert (low <= tail).all() and (tail <= high).all()
    assert tail[0] == pytest.approx(
        (low[0] + high[0]) / 2.0, abs=1e-5
    )  # across the wall, which reaches out of the plan
    assert axes.get_ylim()[0] < tail[1] < axes.get_ylim()[1]
    words = [text.get_text() for text in figure.legends[0].get_texts()]
    table = " ".join(" ".join(words).split())
    assert f"A: wall W-102, {offset_in_words(one.deviation)}" in table
    assert f"the arrow {times} times as long" in table and "displaced" in words
    assert not any("arrow" in text.get_text() for text in draw_plan(removed).legends[0].get_texts())


@pytest.mark.parametrize("turn", [2.0, -0.7])
def test_a_turned_wall_has_an_arrow_at_each_end_and_one_letter(removed, turn):
    """Its middle is where it should be: what is off are its ends, each the other way."""
    told = with_displaced(removed)
    row = next(row for row, one in enumerate(told.elements) if one.verdict == "displaced")
    turned = deviation(0.0)._replace(turned=(0.0, 0.0, np.radians(turn)), turn=turn, worst=0.06)
    elements = list(told.elements)
    elements[row] = elements[row]._replace(deviation=turned)
    told = told._replace(elements=tuple(elements))
    (first, second), letters = arrows(draw_plan(told))
    assert list(letters) == ["A"]
    low, high = bounds_of(told, elements[row].guid)
    times, turning = arrow_times(told.drawing, [elements[row]]), np.radians(turn)
    for tail, tip in (first, second):  # of an end that the plan does not show, where the plan ends
        assert (low - 1e-5 <= tail).all() and (tail <= high + 1e-5).all()
        x, y = tail - (low + high) / 2.0
        np.testing.assert_allclose(tip - tail, times * turning * np.array([-y, x]), atol=1e-6)
    assert np.linalg.norm(first[0] - second[0]) > 1.0


def test_what_leans_has_an_arrow_at_its_head():
    corners = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-0.1, 0.1) for z in (0.0, 3.0)])
    one = deviation(0.0, (0.0, 1.0, 0.0))._replace(turned=(np.radians(1.0), 0.0, 0.0), lean=1.0, worst=0.04)
    ((place, step),) = offsets_of(one, corners)
    np.testing.assert_allclose(place, (0.0, 0.0, 3.0), atol=1e-12)
    np.testing.assert_allclose(step, (0.0, -1.5 * np.radians(1.0), 0.0), atol=1e-12)


def test_the_table_is_short_and_stays_within_the_figure(removed):
    """However many there are, and with names that no font has, or that would be formulas."""
    told = with_displaced(removed)
    elements = list(told.elements)
    row = next(row for row, one in enumerate(elements) if one.verdict == "displaced")
    for number in range(MOST_WORST + 5):
        name = ("$x^2$ " * 3, "柱" * 60, "a\nb" * 9)[number % 3]
        off = deviation(0.04 + 0.001 * number, (1, 0, 0))._replace(offset=(0.04, 0.03, 0.0))
        elements.append(elements[row]._replace(guid=f"other {number}", name=name, deviation=off))
    figure = draw_plan(told._replace(elements=tuple(elements)))
    figure.draw_without_rendering()
    words = [text.get_text() for text in figure.legends[0].get_texts()]
    assert f"and {6} more displaced: see deviations.csv" in words
    assert sum(text[1:3] == ": " and text[0].isalpha() for text in words) == MOST_WORST
    box = figure.legends[0].get_window_extent()
    assert box.y0 >= 0 and box.x1 <= figure.bbox.x1 + 1


def test_what_the_font_cannot_show_is_marked():
    assert shown_name("W-102\n ü") == "W-102 ü" and shown_name("\U0001f3e0") == MISSING
